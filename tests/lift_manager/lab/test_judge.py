"""The judge excuses nothing with a fault that could not have caused it, and nothing without an end."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.lift_under_test import DoorEvidence, Excuse, MapEvidence, PolledBlock, SuspectValues
from lift_manager.lab.world.oracle import Oracle
from lift_manager.lab.world.oracle_setup import oracle_of
from lift_manager.lab.world.requested_outputs import is_output_requested
from lift_manager.lab.world.rules import Rules
from lift_manager.lab.world.witness import RESTART, FaultChange, FloorRequest
from lift_manager.lab.world.world import World
from lift_manager.lift.events import CommandEnded, HandedOver, SessionOpened, SessionRestored
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from register_maps import frames
from register_maps.words import Door, Mode, Motion, Side, Table
from simulator import faults as device
from simulator import wire_faults as wire
from simulator.faults import Fault
from simulator.state import Parameters
from simulator.wire_faults import Exchange, WireFault
from tests.campaigns.playing import LIFT, loaded_site
from tests.lift_manager.lab.test_oracle import DRIVES, HELD, ROBOT, SHUT, STANDS_OPEN, answered, judge, polled, state
from tests.support.rows import each_row

WORKSHOP = Holder("workshop", "workshop")
OTHER = Holder("fleet", "r2")
FRONT = frozenset({"hold_door.front"})
CELL = ("plc", 1, Table.COIL, 2, 1)
"""Where `failed_write` writes 0."""


def judged(name: str, check: Callable[[World], Awaitable[None]]) -> list[str]:
    """Let something happen in a world of one lift of a map, and return the rules that it breaks."""
    oracle = oracle_of(loaded_site(name, 900.0, 300.0, 5.0))

    async def main() -> list[str]:
        world = World(
            loaded_site(name, 900.0, 300.0, 5.0), (oracle, Rules(oracle)), settings={LIFT: Parameters(speed=4.0)}
        )
        async with world.running():
            await elapse(2)
            await check(world)
            return found(oracle)

    return run_virtual(main)


def found(oracle: Oracle) -> list[str]:
    return [finding.rule for finding in oracle.findings]


def write(world: World, request: frames.Request) -> None:
    """Write as the manager does: the world takes it for a press of ours."""
    world.controller("plc").answer(frames.frame(request, 7))


async def locked_out(world: World) -> None:
    world.site.lock_out(LIFT, "guard", "moving")
    await elapse(3)


def test_another_floor_on_a_call_that_is_still_on_is_a_press() -> None:
    async def check(world: World) -> None:
        await locked_out(world)
        write(world, frames.write_register(1, 1, 0))
        write(world, frames.write_register(1, 3, 0))

    assert judged("seer-siemens-chengdu", check).count("pressed in a lockout") == 2


@each_row(
    ("name", "fault", "coil"),
    [
        ("generic-coils", None, 9),
        ("generic-coils", device.FrozenRegisters(), 9),
        ("generic-coils", device.ForeignWriter("close_door.front", pressed=False), 9),
        ("generic-coils", device.ForeignWriter("robot_mode", pressed=False), 9),
        ("wago-750", device.FrozenRegisters(), 0),
        ("wago-750", device.IgnoredWrites(stored=False), None),
    ],
)
def test_no_fault_excuses_a_press_in_a_lockout(name: str, fault: Fault | None, coil: int | None) -> None:
    async def check(world: World) -> None:
        await locked_out(world)
        if fault is not None:
            world.begin(LIFT, fault)
            await elapse(0.3)
        if coil is not None:
            write(world, frames.write_coil(coil, True, 1))

    assert ("pressed in a lockout" in judged(name, check)) is (coil is not None)


@pytest.mark.parametrize("fault", [None, wire.Delay(0.02), wire.DuplicateAnswer(0.0)])
def test_a_wire_that_is_a_little_slow_does_not_excuse_an_output_for_nobody(fault: WireFault | None) -> None:
    async def check(world: World) -> None:
        if fault is not None:
            world.begin_wire_fault("plc", fault)
        for _ in range(40):
            world.lifts[LIFT].face.write(Table.COIL, 3, (1,), asyncio.get_running_loop().time())
            await elapse(0.5)

    assert "output on too long" in judged("two-stop-agv", check)


@pytest.mark.parametrize("works_every_s", [0.4, 4.0])
def test_a_wire_that_fails_now_and_then_gives_only_the_time_that_it_takes(works_every_s: float) -> None:
    oracle = judge(blocks=frozenset())
    oracle.on_truth(0.0, "lift", HELD)
    oracle.on_state(0.0, "lift", state(holder=None, robot_door=RobotDoor.MOVING))
    at = 0.2
    while at < 10.0:
        fails = at % works_every_s > works_every_s / 2
        oracle.on_exchange(at, "plc", answered(at, came=b"" if fails else b"right"))
        oracle.on_truth(at, "lift", HELD)
        at += 0.2
    assert found(oracle) == ["output on too long"]


def test_a_release_that_fails_is_tried_again_soon_and_a_manager_that_does_not_try_is_found() -> None:
    def on_for(seconds: float, *, writes_every_s: float | None) -> list[str]:
        oracle = judge(blocks=frozenset())
        oracle.on_truth(0.0, "lift", HELD)
        oracle.on_state(0.0, "lift", state(holder=None, robot_door=RobotDoor.MOVING))
        at, wrote_at = 0.2, 0.0
        while at < seconds:
            oracle.on_exchange(at, "plc", answered(at))
            if writes_every_s is not None and at - wrote_at >= writes_every_s:
                wrote_at = at
                oracle.on_exchange(at, "plc", failed_write(at))
            oracle.on_truth(at, "lift", HELD)
            at += 0.2
        return found(oracle)

    assert on_for(12.0, writes_every_s=2.0) == []
    assert on_for(5.0, writes_every_s=None) == ["output on too long"]


def failed_write(at: float) -> Exchange:
    request = frames.frame(frames.write_coil(2, False, 1), 7)
    return Exchange(sent_at=at, request=request, executed=False, right=b"ok", answers=(), honest=True, faults=())


def test_a_close_button_that_stays_on_is_not_wanted_by_a_robot_that_asks_for_an_open_door() -> None:
    async def check(world: World) -> None:
        for _ in range(20):
            world.request(FloorRequest(LIFT, WORKSHOP, world.lifts[LIFT].floors[0], hold_door=True))
            world.lifts[LIFT].face.write(Table.COIL, 20, (1,), asyncio.get_running_loop().time())
            await elapse(1)

    assert "output on too long" in judged("adam-pushbutton", check)


@each_row(
    ("given", "hold_door", "is_found"),
    [
        (("go_to", 0), True, False),
        (("go_to", 1), True, True),
        (("hold_door.front", 1), True, True),
        (("robot_mode", 1), True, False),
    ],
)
def test_an_output_is_wanted_for_what_its_holder_asked_for(
    given: tuple[str, int], hold_door: bool, is_found: bool
) -> None:
    oracle = judge()
    oracle.on_truth(0.0, "lift", replace(SHUT, given=(given,)))
    oracle.on_request(0.0, FloorRequest("lift", ROBOT, "L1", hold_door=hold_door), None)
    oracle.on_state(0.0, "lift", state(robot_door=RobotDoor.MOVING))
    polled(oracle, 5.0, replace(SHUT, given=(given,)), since=0.2)
    assert ("output on too long" in found(oracle)) is is_found


# -- what a live state says beside its open door


def lies(truth: object = STANDS_OPEN, *, shows: MapEvidence | None = None, **said: object) -> list[str]:
    """Publish a state over a lift that has long been like this, and return the rules that it breaks."""
    oracle = judge(shows=shows or MapEvidence())
    polled(oracle, 9.8, truth)  # type: ignore[arg-type]  # a Truth
    oracle.on_state(9.9, "lift", state(age_s=0.1, **({"robot_door": RobotDoor.MOVING} | said)))
    return found(oracle)


AT_L2 = replace(STANDS_OPEN, passed="L2", doors=((Side.FRONT, Door.OPEN),), heading=0)
UP = replace(DRIVES, passed="L2", heading=1, doors=((Side.FRONT, Door.CLOSED),))


def test_a_state_that_says_what_is_so_breaks_no_rule() -> None:
    assert lies(AT_L2, doors={Side.FRONT: Door.OPEN}) == []
    assert lies(UP, standing=False, motion=Motion.UP, robot_door=RobotDoor.CLOSED) == []
    assert lies(UP, standing=False, motion=Motion.MOVING, floor=None) == []


@each_row(
    ("truth", "said", "rule"),
    [
        (UP, {"floor": "L1", "standing": False, "motion": Motion.UP}, "said another floor"),
        (UP, {"motion": Motion.UP}, "said standing and moved"),
        (UP, {"standing": False, "motion": Motion.STOPPED}, "said another motion"),
        (UP, {"standing": False, "motion": Motion.DOWN}, "said another motion"),
        (AT_L2, {"motion": Motion.UP}, "said another motion"),
        (replace(AT_L2, mode=Mode.FIRE), {"mode": Mode.NORMAL}, "said another mode"),
        (AT_L2, {"mode": Mode.FIRE}, "said another mode"),
        (AT_L2, {"doors": {Side.FRONT: Door.CLOSED}}, "said another door"),
        (replace(AT_L2, doors=((Side.FRONT, Door.CLOSING),)), {"doors": {Side.FRONT: Door.OPEN}}, "said another door"),
        (AT_L2, {"robot_door": RobotDoor.CLOSED}, "said another door"),
    ],
)
def test_floor_motion_mode_and_doors_of_a_live_state_are_judged(
    truth: object, said: dict[str, object], rule: str
) -> None:
    assert lies(truth, **said) == [rule]  # type: ignore[arg-type]  # words of a state


def test_one_contact_or_a_mode_that_nothing_tells_is_not_held_against_the_manager() -> None:
    half = replace(AT_L2, doors=((Side.FRONT, Door.CLOSING),))
    assert lies(half, shows=MapEvidence(door_by=DoorEvidence.OPEN_CONTACT), doors={Side.FRONT: Door.CLOSED}) == []
    assert lies(replace(AT_L2, mode=Mode.FIRE), shows=MapEvidence(modes=frozenset()), mode=Mode.NORMAL) == []
    assert lies(AT_L2, shows=MapEvidence(door_by=DoorEvidence.OPEN_CONTACT), doors={Side.FRONT: Door.CLOSED}) == [
        "said another door"
    ]


def test_registers_that_stand_still_excuse_only_what_was_so_when_they_came_to() -> None:
    def said_open_at(floor: str) -> list[str]:
        excuse = {"frozen_registers": Excuse(frozenset({SuspectValues.EFFECT, SuspectValues.OUTPUT}), None)}
        oracle = judge(excuses=excuse)
        polled(oracle, 2.0)
        oracle.on_fault(2.0, FaultChange("lift", device.FrozenRegisters(), began=True))
        polled(oracle, 6.0, SHUT, since=2.2)
        oracle.on_state(6.1, "lift", state(floor=floor))
        return found(oracle)

    assert said_open_at("L2") == []
    assert said_open_at("L1") == ["said open and was not"]


def test_registers_that_stand_still_go_on_to_say_what_another_fault_has_put_there() -> None:
    def said_l1_long_after(*, shown: bool) -> list[str]:
        lasting = Excuse(frozenset({SuspectValues.OPEN, SuspectValues.FLOOR}), None)
        still = Excuse(frozenset({SuspectValues.EFFECT, SuspectValues.OUTPUT}), None)
        oracle = judge(excuses={"says_wrong_floor": lasting, "frozen_registers": still})
        polled(oracle, 1.0)
        if shown:
            oracle.on_fault(1.0, FaultChange("lift", device.SaysWrongFloor(by=1), began=True))
        oracle.on_fault(2.0, FaultChange("lift", device.FrozenRegisters(), began=True))
        if shown:
            oracle.on_fault(3.0, FaultChange("lift", device.SaysWrongFloor(by=1), began=False))
        polled(oracle, 60.0, AT_L2, since=59.8)
        oracle.on_state(60.1, "lift", state(floor="L1"))
        return found(oracle)

    assert said_l1_long_after(shown=True) == []
    assert said_l1_long_after(shown=False) == ["said open and was not"]


def test_an_invitation_that_the_lift_itself_does_not_give_is_found() -> None:
    shows = MapEvidence(permits=True)
    assert lies(AT_L2, shows=shows, robot_door=RobotDoor.OPEN) == ["said open without permission"]
    assert lies(replace(AT_L2, awaits=True), shows=shows, robot_door=RobotDoor.OPEN) == []


def test_a_press_into_a_lift_that_keeps_robots_off_is_found_where_it_tells_so() -> None:
    def pressed(bars: frozenset[str]) -> list[str]:
        oracle = judge(shows=MapEvidence(bars=bars))
        polled(oracle, 9.8, replace(STANDS_OPEN, bars=frozenset({"robots_allowed"})))
        oracle.on_press(9.9, "lift", frozenset({"go_to"}))
        return found(oracle)

    assert pressed(frozenset({"robots_allowed"})) == ["pressed while kept off"]
    assert pressed(frozenset()) == []


def test_a_read_back_of_our_own_call_confirms_nothing_where_the_car_has_to() -> None:
    oracle = judge(shows=MapEvidence(proofs={"go_to": frozenset({Proof.EFFECT})}))
    polled(oracle, 1.0, replace(STANDS_OPEN, calls=frozenset({"L1"})))
    outcome = Outcome(Command(CommandKind.GO_TO, "L1"), Result.CONFIRMED, "", Proof.READBACK, (), grant_missing=False)
    oracle.on_event(1.1, CommandEnded("lift", outcome))
    assert found(oracle) == ["confirmed by what proves nothing"]


def test_a_door_that_was_at_both_ends_was_between_them_as_well() -> None:
    oracle = judge()
    polled(oracle, 4.0, replace(AT_L2, doors=((Side.FRONT, Door.CLOSED),)))
    oracle.on_truth(4.1, "lift", AT_L2)
    oracle.on_state(4.2, "lift", state(age_s=0.3, robot_door=RobotDoor.MOVING, doors={Side.FRONT: Door.MOVING}))
    assert found(oracle) == []


# -- the hold behind an open door


def said_open(after_s: float, *, age_s: float = 0.0, ours: bool = False) -> list[str]:
    """A robot is invited so long after the hold fell, by a write of ours or by itself."""
    oracle = judge(holds=FRONT)
    rules = Rules(oracle)
    rules.on_truth(0.0, "lift", STANDS_OPEN)
    rules.on_truth(1.0, "lift", HELD)
    rules.on_truth(9.0, "lift", STANDS_OPEN)
    if ours:
        released = replace(failed_write(9.0), executed=True, answers=((9.0, b"ok"),))
        rules.on_exchange(9.0, "plc", released)
    rules.on_state(9.0 + after_s, "lift", state(age_s=age_s))
    return found(oracle)


def test_a_hold_that_fell_by_itself_is_missed_within_a_look_whatever_the_age_of_the_data() -> None:
    assert said_open(2.5) == []
    assert said_open(2.7) == ["said open and not held"]
    assert said_open(2.7, age_s=1.0) == ["said open and not held"]


def test_a_hold_that_we_released_is_missed_at_once() -> None:
    assert said_open(0.2, ours=True) == []
    assert said_open(0.5, ours=True) == ["said open and not held"]


def test_a_hold_that_somebody_clears_before_the_drive_obeys_it_did_not_fall_by_our_release_of_long_ago() -> None:
    oracle = judge(holds=FRONT)
    rules = Rules(oracle)
    rules.on_truth(1.0, "lift", HELD)
    rules.on_truth(3.0, "lift", STANDS_OPEN)
    rules.on_exchange(3.0, "plc", replace(failed_write(3.0), executed=True, answers=((3.0, b"ok"),)))
    rules.on_truth(9.0, "lift", replace(HELD, fallen=FRONT))
    rules.on_truth(9.1, "lift", STANDS_OPEN)
    rules.on_state(10.0, "lift", state())
    assert found(oracle) == []
    rules.on_state(12.0, "lift", state())
    assert found(oracle) == ["said open and not held"]


def test_an_invitation_on_a_reading_from_before_the_hold_is_found() -> None:
    oracle = judge(holds=FRONT)
    rules = Rules(oracle)
    rules.on_truth(0.0, "lift", STANDS_OPEN)
    rules.on_truth(9.0, "lift", HELD)
    rules.on_state(9.1, "lift", state(age_s=0.2))
    assert found(oracle) == ["said open on a reading from before the hold"]
    rules.on_state(9.3, "lift", state(age_s=0.1))
    assert len(found(oracle)) == 1


def test_a_hold_that_stands_in_the_register_and_fell_by_the_controllers_own_watchdog_is_none() -> None:
    async def check(world: World) -> None:
        floor = world.lifts[LIFT].floors[1]
        for _ in range(20):
            world.request(FloorRequest(LIFT, WORKSHOP, floor, hold_door=True))
            await elapse(1)
        assert "hold_door.front" in world.lifts[LIFT].truth.obeyed
        world.begin_wire_fault("plc", wire.DropRequest(on=wire.Target(access=wire.Access.WRITES)))
        for _ in range(8):
            world.request(FloorRequest(LIFT, WORKSHOP, floor, hold_door=True))
            await elapse(1)
        truth = world.lifts[LIFT].truth
        assert "hold_door.front" in truth.commands
        assert "hold_door.front" not in truth.obeyed
        assert truth.doors_shut

    judged("generic-registers", check)


# -- restarts, fires and releases


def restarted(*, by: Holder, floor: str) -> list[str]:
    """After a restart somebody asks, and the call to L2 is pressed for the robot whose session goes on."""
    oracle = judge()
    rules = Rules(oracle)
    rules.on_truth(0.0, "lift", replace(SHUT, at="L1"))
    rules.on_event(0.5, SessionOpened("lift", ROBOT, "L2"))
    rules.on_fault(1.2, FaultChange("manager", RESTART, began=True))
    rules.on_event(1.2, SessionRestored("lift", ROBOT, "L2", ""))
    rules.on_request(4.3, FloorRequest("lift", by, floor, hold_door=True), None)
    rules.on_truth(4.4, "lift", replace(SHUT, at="L1", given=(("go_to", 1),)))
    rules.on_press(4.4, "lift", frozenset({"go_to"}))
    return [rule for rule in found(oracle) if rule.startswith("pressed")]


def test_after_a_restart_only_the_holder_frees_presses_and_only_for_the_floor_that_it_asks_for() -> None:
    assert restarted(by=ROBOT, floor="L2") == []
    assert restarted(by=OTHER, floor="L2") == ["pressed by a restart"]
    assert restarted(by=ROBOT, floor="L1") == ["pressed by a restart"]


@pytest.mark.parametrize("hands_over", [True, False])
def test_after_a_restart_a_holder_that_hands_its_session_over_was_heard(*, hands_over: bool) -> None:
    oracle = judge()
    rules = Rules(oracle)
    oracle.on_request(1.0, FloorRequest("lift", ROBOT, "L2", hold_door=True), None)
    rules.on_fault(1.2, FaultChange("manager", RESTART, began=True))
    rules.on_event(1.2, SessionRestored("lift", ROBOT, "L2", ""))
    if hands_over:
        rules.on_event(4.1, HandedOver("lift", ROBOT, OTHER))
    rules.on_truth(4.2, "lift", HELD)
    rules.on_press(4.2, "lift", FRONT)
    assert ("pressed by a restart" in found(oracle)) is not hands_over


@pytest.mark.parametrize("has_call", [True, False])
def test_a_call_that_the_lift_still_has_is_not_pressed_again_after_a_restart(*, has_call: bool) -> None:
    oracle = judge()
    rules = Rules(oracle)
    request = FloorRequest("lift", ROBOT, "L2", hold_door=True)
    called = replace(SHUT, at="L1", calls=frozenset({"L2"}), given=(("go_to", 1),))
    rules.on_event(0.5, SessionOpened("lift", ROBOT, "L2"))
    rules.on_request(0.5, request, None)
    rules.on_truth(0.6, "lift", called)
    rules.on_press(0.6, "lift", frozenset({"go_to"}))
    rules.on_fault(4.0, FaultChange("manager", RESTART, began=True))
    rules.on_event(4.0, SessionRestored("lift", ROBOT, "L2", ""))
    rules.on_request(5.0, request, None)
    rules.on_truth(5.1, "lift", called if has_call else replace(called, calls=frozenset()))
    rules.on_press(5.1, "lift", frozenset({"go_to"}))
    assert found(oracle) == (["pressed again after a restart"] if has_call else [])


@pytest.mark.parametrize("session_ends", [True, False])
def test_a_visible_fire_gives_a_hold_no_more_time_because_its_session_ends(*, session_ends: bool) -> None:
    def said(holder: Holder | None) -> LiftState:
        return state(age_s=0.0, holder=holder, robot_door=RobotDoor.MOVING, mode=Mode.FIRE)

    oracle, burning = judge(blocks=frozenset()), replace(HELD, mode=Mode.FIRE)
    oracle.on_truth(0.0, "lift", burning)
    at = 0.0
    while at < 5.0:
        oracle.on_state(at, "lift", said(None if session_ends and at >= 2.5 else ROBOT))
        oracle.on_truth(at, "lift", burning)
        at += 0.25
    assert found(oracle)[-1:] == ["output on too long"]
    assert len([one for one in found(oracle) if one == "output on too long"]) == 1


@each_row(
    ("clear_s", "request", "truth", "rules_broken"),
    [
        (
            10.0,
            FloorRequest("lift", ROBOT, "L2", hold_door=True),
            STANDS_OPEN,
            ["the door fell while a robot was invited"],
        ),
        (0.0, FloorRequest("lift", ROBOT, "L2", hold_door=True), STANDS_OPEN, []),
        (10.0, FloorRequest("lift", ROBOT, "L1", hold_door=True), STANDS_OPEN, []),
        (10.0, FloorRequest("lift", ROBOT, "L2", hold_door=False), STANDS_OPEN, []),
        (10.0, FloorRequest("lift", ROBOT, "L2", hold_door=True), replace(STANDS_OPEN, mode=Mode.FIRE), []),
    ],
)
def test_a_door_that_we_let_fall_on_a_robot_that_was_invited_is_found(
    clear_s: float, request: FloorRequest, truth: object, rules_broken: list[str]
) -> None:
    oracle = judge(holds=FRONT, clear_s=clear_s)
    rules = Rules(oracle)
    oracle.on_request(0.0, request, None)
    rules.on_truth(1.0, "lift", HELD)
    rules.on_state(4.0, "lift", state(age_s=0.0))
    rules.on_truth(5.0, "lift", truth)  # type: ignore[arg-type]  # a Truth
    rules.on_exchange(5.0, "plc", replace(failed_write(5.0), executed=True, answers=((5.0, b"ok"),)))
    assert found(oracle) == rules_broken


@each_row(
    ("refreshes", "is_ours"),
    [({}, True), ({CELL: 0}, False), ({CELL: None}, False), ({CELL: 1}, True)],
)
def test_a_hold_that_is_seen_to_have_fallen_when_something_else_is_refreshed_fell_by_itself(
    refreshes: dict[PolledBlock, int | None], is_ours: bool
) -> None:
    oracle = judge(holds=FRONT, clear_s=10.0, refreshes=refreshes)
    rules = Rules(oracle)
    oracle.on_request(0.0, FloorRequest("lift", ROBOT, "L2", hold_door=True), None)
    rules.on_truth(1.0, "lift", HELD)
    rules.on_state(4.0, "lift", state(age_s=0.0))
    rules.on_truth(5.0, "lift", STANDS_OPEN)
    rules.on_exchange(5.0, "plc", replace(failed_write(5.0), executed=True, answers=((5.0, b"ok"),)))
    assert found(oracle) == (["the door fell while a robot was invited"] if is_ours else [])


@pytest.mark.parametrize(("output", "address"), [("hold_door.front", 8), ("robot_mode", 10)])
def test_writing_an_output_once_more_is_not_taken_for_its_release(output: str, address: int) -> None:
    about = oracle_of(loaded_site("generic-coils", 900.0, 300.0, 5.0)).lifts[LIFT]
    assert about.refreshes["plc", 1, Table.COIL, address, 1] == 1, output


def test_a_release_that_its_holder_asked_for_may_come_after_the_next_request() -> None:
    oracle = judge(holds=FRONT, clear_s=10.0)
    rules = Rules(oracle)

    def asks(at: float, floor: str) -> None:
        request = FloorRequest("lift", ROBOT, floor, hold_door=True)
        oracle.on_request(at, request, None)
        rules.on_request(at, request, None)

    asks(0.0, "L2")
    rules.on_truth(1.0, "lift", HELD)
    rules.on_state(4.0, "lift", state(age_s=0.0))
    asks(4.5, "L1")
    asks(4.8, "L2")
    rules.on_truth(5.0, "lift", STANDS_OPEN)
    rules.on_exchange(5.0, "plc", replace(failed_write(5.0), executed=True, answers=((5.0, b"ok"),)))
    assert found(oracle) == []


@pytest.mark.parametrize("reported_at", [None, 3.0])
def test_a_call_that_keeps_the_door_open_stays_until_the_lift_knows_of_the_robot_inside(
    reported_at: float | None,
) -> None:
    about = replace(judge(blocks=frozenset()).lifts["lift"], handshake=True)
    report_due = reported_at is not None
    request = FloorRequest("lift", ROBOT, "L1", hold_door=True)
    requested = is_output_requested(
        about, "call", 1, SHUT, (request, replace(request, floor="L3")), on_s=9.0, report_due=report_due
    )
    assert requested is report_due
