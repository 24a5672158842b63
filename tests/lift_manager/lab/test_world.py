"""A site of simulated lifts on virtual time: the real manager on wires without a network, with everything on record."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.oracle_setup import oracle_of
from lift_manager.lab.world.rules import Rules
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest, Witness
from lift_manager.lab.world.world import World, WorldError
from lift_manager.lift.events import RestrictionBegun, RestrictionEnded, RestrictionKind
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from lift_manager.runtime.bus import QUEUE_LENGTH, Event
from lift_manager.runtime.errors import RequestRefused
from register_maps.load import load
from register_maps.words import Mode
from simulator.faults import InMode, PowerLoss, SlotKept, StuckDoor
from simulator.people import People
from simulator.state import Inputs
from simulator.wire_faults import Delay, Exchange, HalfOpen

ROBOT = Holder("fleet", "r1")


class Recorder:
    """A witness that keeps everything."""

    def __init__(self) -> None:
        self.truths: list[tuple[float, Truth]] = []
        self.presses: list[tuple[float, frozenset[str]]] = []
        self.states: list[tuple[float, LiftState]] = []
        self.exchanges: list[Exchange] = []
        self.events: list[Event] = []
        self.requests: list[tuple[FloorRequest, RequestRefused | None]] = []
        self.faults: list[tuple[float, FaultChange]] = []

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        self.truths.append((at, truth))

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        self.presses.append((at, commands))

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        self.states.append((at, state))

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        self.exchanges.append(exchange)

    def on_event(self, at: float, event: Event) -> None:
        self.events.append(event)

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        self.requests.append((request, refused))

    def on_fault(self, at: float, change: FaultChange) -> None:
        self.faults.append((at, change))


def site(*lifts: str, units: bool = True) -> LoadedSite:
    """Lifts behind one controller, each a unit of its own."""
    spec = {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2, "L3": 3}}
    made = {
        "schema": 1,
        "name": "world",
        "controllers": {"plc": {"host": "memory", "port": 1, "map": "generic-registers"}},
        "lifts": {name: spec | ({"unit_id": n} if units else {}) for n, name in enumerate(lifts, start=1)},
    }
    return LoadedSite(Site.model_validate(made), {name: load("generic-registers") for name in lifts}, Path("world"))


def in_world(check: Callable[[World], Awaitable[None]], *lifts: str, judges: Sequence[Witness] = ()) -> Recorder:
    seen = Recorder()

    async def main() -> None:
        world = World(site(*(lifts or ("lift",))), (seen, *judges))
        async with world.running():
            await check(world)
        assert world.released

    run_virtual(main)
    return seen


async def until(world: World, true: Callable[[LiftState], bool], lift: str = "lift") -> float:
    loop = asyncio.get_running_loop()
    began = loop.time()
    async with asyncio.timeout(60):
        while True:
            if true(world.site.state(lift)):
                return loop.time() - began
            await elapse(0.05)


def is_open_at(floor: str) -> Callable[[LiftState], bool]:
    return lambda state: (state.floor, state.robot_door) == (floor, RobotDoor.OPEN)


def test_a_robot_rides_and_everything_about_it_is_told_to_the_witnesses() -> None:
    async def check(world: World) -> None:
        await elapse(2)
        assert world.request(FloorRequest("lift", ROBOT, "L3", hold_door=True)) is None
        await until(world, is_open_at("L3"))

    seen = in_world(check)
    assert any(truth.open_at == "L3" for _, truth in seen.truths)
    assert any("go_to" in commands for _, commands in seen.presses)
    assert any(is_open_at("L3")(state) for _, state in seen.states)
    assert {type(event).__name__ for event in seen.events} >= {"SessionOpened", "CommandEnded", "SessionEnded"}
    assert seen.requests == [(FloorRequest("lift", ROBOT, "L3", hold_door=True), None)]
    assert all(exchange.honest for exchange in seen.exchanges)
    assert seen.truths[-1][1].given == ()  # everything was let go at the end


def test_the_truth_is_that_of_the_lift_and_not_of_its_registers() -> None:
    async def check(world: World) -> None:
        await elapse(1)
        world.begin("lift", StuckDoor())
        world.set_inputs("lift", Inputs(landing_buttons=frozenset({0})))
        await elapse(5)

    seen = in_world(check)
    assert all(truth.doors_shut for _, truth in seen.truths)
    assert [change for _, change in seen.faults][:1] == [FaultChange("lift", StuckDoor(), began=True)]


def test_a_device_without_power_is_off_the_network_until_it_has_it_again() -> None:
    async def check(world: World) -> None:
        await until(world, lambda state: state.quality is Quality.LIVE)
        world.begin("lift", PowerLoss())
        await until(world, lambda state: state.quality is Quality.OFFLINE)
        await elapse(10)
        world.end("lift", PowerLoss())
        assert await until(world, lambda state: state.quality is Quality.LIVE) < 3

    in_world(check)


def test_a_slot_that_is_kept_lets_nobody_in() -> None:
    async def check(world: World) -> None:
        await until(world, lambda state: state.quality is Quality.LIVE)
        world.begin("lift", SlotKept())
        world.begin("lift", PowerLoss())
        world.end("lift", PowerLoss())
        await elapse(10)
        state = world.site.state("lift")
        assert state.quality is Quality.OFFLINE
        world.end("lift", SlotKept())
        await until(world, lambda state: state.quality is Quality.LIVE)

    in_world(check)


def test_weather_is_that_of_one_controller() -> None:
    async def check(world: World) -> None:
        await until(world, lambda state: state.quality is Quality.LIVE)
        world.begin_wire_fault("plc", HalfOpen())
        await until(world, lambda state: state.quality is Quality.OFFLINE)
        world.end_wire_fault("plc", HalfOpen())
        await until(world, lambda state: state.quality is Quality.LIVE)

    in_world(check)


@pytest.mark.parametrize("phase_s", [0.0, 0.05, 0.1, 0.15])
def test_a_controller_that_pauses_for_nearly_a_second_keeps_its_connection(phase_s: float) -> None:
    pause = Delay(0.9, times=1)

    async def check(world: World) -> None:
        await until(world, lambda state: state.quality is Quality.LIVE)
        for _ in range(3):
            await elapse(5 + phase_s)
            world.begin_wire_fault("plc", pause)
            await elapse(2)
            world.end_wire_fault("plc", pause)
        stats = world.links[0].stats
        assert (stats.connects, stats.timeouts) == (1, 1)  # the late answer shows how long it may take

    in_world(check)


def test_several_lifts_may_stand_behind_one_controller_as_units() -> None:
    async def check(world: World) -> None:
        await until(world, lambda state: state.quality is Quality.LIVE, "west")
        world.begin("east", InMode(Mode.FIRE))
        await until(world, lambda state: state.mode is Mode.FIRE, "east")
        state = world.site.state("west")
        assert state.mode is Mode.NORMAL

    in_world(check, "east", "west")


def test_two_lifts_behind_one_unit_cannot_be_simulated_and_the_message_says_which() -> None:
    with pytest.raises(WorldError, match=r"west: unit 1 of plc is another lift already"):
        World(site("east", "west", units=False), ())


def test_people_use_the_lift_when_they_are_let_in() -> None:
    async def check(world: World) -> None:
        world.populate("lift", People(seed=3, floors=3))
        await elapse(100)

    seen = in_world(check)
    assert len({truth.open_at for _, truth in seen.truths} - {None}) > 1


def test_the_same_seed_tells_the_same_story() -> None:
    async def check(world: World) -> None:
        world.populate("lift", People(seed=5, floors=3))
        world.begin_wire_fault("plc", HalfOpen(probability=0.02, times=1))
        world.request(FloorRequest("lift", ROBOT, "L2", hold_door=True))
        await elapse(30)

    def story(seen: Recorder) -> list[object]:
        return [seen.truths, [(at, replace(state, not_visible={})) for at, state in seen.states], seen.presses]

    assert story(in_world(check)) == story(in_world(check))


def test_what_a_killed_manager_still_hears_of_changes_nothing_that_the_next_one_finds() -> None:
    async def check(world: World) -> None:
        world.site.lock_out("lift", "somebody", "ropes")
        killed = world.site
        await world.restart()
        killed.end_lockout("lift", "somebody")
        await world.restart()
        durable = world.site.durable("lift")
        assert durable.restriction(RestrictionKind.LOCKOUT) is not None

    in_world(check)


def test_one_manager_is_left_of_two_restarts_at_once() -> None:
    async def check(world: World) -> None:
        await asyncio.gather(world.restart(), world.restart())
        await elapse(5)

    in_world(check)  # a manager that nobody ends would keep it from ending


def test_no_word_of_a_person_is_missed_around_a_restart() -> None:
    async def check(world: World) -> None:
        world.site.lock_out("lift", "somebody", "ropes")
        restarting = asyncio.ensure_future(world.restart())
        await asyncio.sleep(0)
        world.site.end_lockout("lift", "somebody")
        await restarting
        world.site.lock_out("lift", "somebody", "more ropes")

    seen = in_world(check)
    words = [type(event) for event in seen.events if isinstance(event, RestrictionBegun | RestrictionEnded)]
    assert words == [RestrictionBegun, RestrictionEnded, RestrictionBegun]


def test_a_witness_is_told_of_more_at_once_than_any_listener_can_keep() -> None:
    async def check(world: World) -> None:
        for _ in range(QUEUE_LENGTH):
            world.site.lock_out("lift", "somebody", "ropes")
            world.site.end_lockout("lift", "somebody")

    seen = in_world(check)
    assert sum(isinstance(event, RestrictionEnded) for event in seen.events) == QUEUE_LENGTH


@pytest.mark.parametrize("heard", [False, True])
def test_a_hold_that_a_controller_loses_after_a_restart_is_pressed_again_only_for_a_holder_that_was_heard(
    *, heard: bool
) -> None:
    request = FloorRequest("lift", ROBOT, "L2", hold_door=True)
    oracle = oracle_of(site("lift"))

    async def check(world: World) -> None:
        await elapse(2)
        world.request(request)
        await until(world, is_open_at("L2"))
        await world.restart()
        await until(world, is_open_at("L2"))
        if heard:
            assert world.request(request) is None
            await elapse(1)
        world.begin("lift", PowerLoss())
        await elapse(4)
        world.end("lift", PowerLoss())
        await elapse(5)
        state = world.site.state("lift")
        assert (state.holder, state.robot_door is RobotDoor.OPEN) == (ROBOT, heard)
        assert world.request(request) is None
        await until(world, is_open_at("L2"))

    seen = in_world(check, judges=(oracle, Rules(oracle)))
    assert oracle.findings == []
    assert [commands for _, commands in seen.presses].count(frozenset({"hold_door.front"})) == 2
