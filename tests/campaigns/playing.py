"""Plays a schedule: the whole manager, one simulated lift, on virtual time, with the judge watching."""

import asyncio
import traceback
from collections.abc import Callable, Coroutine, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from lift_manager import app
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.disk import SimulatedDisk
from lift_manager.lab.world.lift_under_test import Finding, SuspectValues
from lift_manager.lab.world.oracle_setup import oracle_of
from lift_manager.lab.world.press_rows import PressRows
from lift_manager.lab.world.rules import Rules
from lift_manager.lab.world.witness import FloorRequest, Witness
from lift_manager.lab.world.world import JOURNAL_ROWS, World
from lift_manager.lift.config import CLEARS_IN_A_LIMIT
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refused
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.runtime.errors import RequestRefused
from register_maps.load import LoadedMap, MapChanges, load
from simulator import faults as device
from simulator.faults import Fault
from simulator.modes import Key
from simulator.people import People, Traffic
from simulator.state import Inputs, Parameters
from tests.campaigns.aboard import Aboard
from tests.campaigns.schedules import (
    LASTS_S,
    POLL_S,
    Asks,
    DeviceFails,
    DiskFails,
    Event,
    HandsOver,
    KeyTurned,
    Patience,
    PeopleCome,
    PersonActs,
    Restarts,
    RobotRides,
    Schedule,
    WireFails,
)
from tests.support.trip_sites import COMPLETIONS, Completion, site_of

LIFT = "lift"
AS_THE_MAP_SAYS = Patience()
HOLD = {
    "action": "hold",
    "max_hold_s": 30,
    "refresh_s": 1,
    "on_link_loss": "device_watchdog",
    "confirm": {"any_of": ["readback"], "within_s": 2},
}
CLOSE = {"action": "pulse", "width_s": 0.5, "confirm": {"any_of": ["effect"], "within_s": 10}}
ASKS_EVERY_S = 1.0
"""How often a client repeats itself: as the workshop's adapter does."""
BOARDS_S = 3.0
"""How long a robot takes through the door."""


@dataclass
class Played:
    """What became of one schedule."""

    schedule: Schedule
    findings: list[Finding]
    excused: dict[tuple[str, str, str], int] = field(default_factory=dict)
    judged: int = 0
    invitations: int = 0
    rides: int = 0
    """Robots that were let out where they wanted to go."""
    people: list[tuple[float, PersonActs, Refused | None]] = field(default_factory=list)
    """What people with the right to do so did, when, and why that was refused; None where it was taken."""
    aboard: Aboard = field(init=False)
    """Whose robots stand in the cars."""

    def __post_init__(self) -> None:
        self.aboard = Aboard(self.findings)

    @property
    def failed(self) -> bool:
        return bool(self.findings)


REAR_DOOR: Mapping[str, Mapping[str, Any]] = {
    "generic-coils": {
        "served": {"discrete": [[0, 32]], "coil": [[0, 12]]},
        "signals": {"door.rear": {"open_limit": "discrete:30", "closed_limit": "discrete:31"}},
        "commands": {
            "hold_door.rear": {**HOLD, "at": "coil:11", "excludes": ["close_door.rear"]},
            "close_door.rear": {**CLOSE, "at": "coil:12", "excludes": ["hold_door.rear"]},
        },
    },
    "generic-registers": {
        "served": {"holding": [[0, 8], [16, 21]]},
        "signals": {
            "door.rear": {"at": "holding:8", "values": {1: "closed", 2: "opening", 3: "open", 4: "closing", 5: "fault"}}
        },
        "commands": {
            "hold_door.rear": {**HOLD, "at": "holding:20", "excludes": ["close_door.rear"]},
            "close_door.rear": {**CLOSE, "at": "holding:21", "excludes": ["hold_door.rear"]},
        },
    },
}
"""What a site adds for a second door at each floor."""


@cache
def loaded_map(name: str, *, two_doors: bool = False) -> tuple[LoadedMap, Mapping[str, int]]:
    """Return a shipped map, completed where a site has to, and codes of the floors of a lift on it."""
    added = COMPLETIONS.get(name, Completion())
    if two_doors:
        added = Completion(added.parameters, {**added.override, **REAR_DOOR[name]})
    return load(name, changes=MapChanges(added.parameters, added.override)), site_of(name).floors


@cache
def loaded_site(
    name: str,
    max_session_hold_s: float,
    lease_s: float,
    between_sessions_s: float,
    patience: Patience = AS_THE_MAP_SAYS,
    *,
    two_doors: bool = False,
) -> LoadedSite:
    """Return a site with one lift of a shipped map; its devices are where nothing is."""
    loaded, floors = loaded_map(name, two_doors=two_doors)
    endpoints = loaded.map.endpoints
    lift = {
        "controller": "plc",
        "access": "control",
        "floors": dict(floors),
        "poll_s": max(POLL_S, loaded.map.link.min_poll_s),
        "poll_ridden_s": max(POLL_S / 2, loaded.map.link.min_poll_s),
        "endpoints": {endpoint: {"controller": endpoint} for endpoint in endpoints},
        "infer_occupancy": True,
        "accept_latching": "the controller is simulated",
        "max_session_hold_s": max_session_hold_s,
        "lease_s": lease_s,
        "clear_s": min(10.0, min(max_session_hold_s, lease_s) / CLEARS_IN_A_LIMIT),
        "between_sessions_s": between_sessions_s,
        "max_age_s": patience.max_age_s,
    }
    devices: dict[str, dict[str, Any]] = {"plc": {"host": "memory", "port": 1, "map": name}} | {
        endpoint: {"host": "memory", "port": number} for number, endpoint in enumerate(endpoints, start=2)
    }
    for one in devices.values():
        one |= {"timeout_s": patience.timeout_s}
        one |= {"max_registers_per_read": patience.at_once, "max_bits_per_read": patience.at_once}
    site = Site.model_validate({"schema": 1, "name": "campaign", "controllers": devices, "lifts": {LIFT: lift}})
    return LoadedSite(site, {LIFT: loaded}, Path("campaign"))


def site_for(schedule: Schedule) -> LoadedSite:
    """Return the site that a schedule is played on."""
    return loaded_site(
        schedule.map,
        schedule.max_session_hold_s,
        schedule.lease_s,
        schedule.between_sessions_s,
        schedule.patience,
        two_doors=schedule.two_doors,
    )


def disk_for(schedule: Schedule) -> SimulatedDisk:
    """Return a disk for one play of a schedule."""
    return SimulatedDisk(schedule.disk, seed=schedule.seed, keep=JOURNAL_ROWS)


More = Callable[[World], Iterable[Coroutine[Any, Any, None]]]


def _nobody(world: World) -> Iterable[Coroutine[Any, Any, None]]:
    return ()


def play(
    schedule: Schedule,
    *,
    witnesses: Iterable[Witness] = (),
    disk: SimulatedDisk | None = None,
    steady: bool = False,
    more: More = _nobody,
) -> Played:
    """Play a schedule to its end and judge it; a crash is a finding.

    `disk` is one of `disk_for`, `steady` as in WireFaults; `more` makes what else is done beside the events.
    """
    loaded, disk = site_for(schedule), disk or disk_for(schedule)
    oracle = oracle_of(loaded)
    played = Played(schedule, oracle.findings)

    async def main() -> None:
        settings = {LIFT: Parameters(speed=schedule.speed)}
        ours = (oracle, Rules(oracle), PressRows(oracle, disk), played.aboard)
        world = World(loaded, (*ours, *witnesses), seed=schedule.seed, settings=settings, disk=disk)
        for faults in world.wire_faults.values():
            faults.steady = steady
        async with world.running():
            doing = [*(act(world, LIFT, event, played) for event in schedule.events), *more(world)]
            actors = [asyncio.ensure_future(one) for one in doing]
            await elapse(LASTS_S)
            for actor in actors:
                actor.cancel()
            ended = await asyncio.gather(*actors, return_exceptions=True)
        for error in ended:
            if isinstance(error, Exception):
                raise error
        if not world.released and oracle.is_clean(LIFT, LASTS_S, app.RELEASE_WITHIN_S):
            oracle.report(
                LASTS_S, LIFT, "held at the end", "nothing stood against letting go of everything", SuspectValues.OUTPUT
            )

    try:
        run_virtual(main, limit_s=10 * LASTS_S)
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        text = "".join(traceback.format_exception(error))
        oracle.findings.append(Finding(LASTS_S, LIFT, "crash", text))
    played.excused, played.judged, played.invitations = oracle.excused, oracle.judged, oracle.invitations
    return played


async def act(world: World, lift: str, event: Event, played: Played) -> None:
    """Let one event happen, from the moment it is due; it begins to count when this is called."""
    await elapse(event.at)
    match event:
        case RobotRides():
            await _ride(world, lift, event, played)
        case Asks():
            floors = world.lifts[lift].floors
            world.request(FloorRequest(lift, _holder(event.holder), floors[event.floor % len(floors)], event.hold))
        case DeviceFails() | WireFails() | DiskFails():
            await _fail(world, lift, event)
        case Restarts():
            await world.restart()
        case PersonActs():
            played.people.append((asyncio.get_running_loop().time(), event, _person_acts(world, lift, event.what)))
        case KeyTurned():
            await _turn_key(world, lift, event)
        case HandsOver():
            _hand_over(world, lift, event)
        case PeopleCome():
            traffic = Traffic(per_minute=event.per_minute)
            world.populate(lift, People(seed=event.seed, floors=len(world.lifts[lift].floors), traffic=traffic))


async def _fail(world: World, lift: str, event: DeviceFails | WireFails | DiskFails) -> None:
    match event:
        case DeviceFails():
            if applies(world, lift, event.fault):
                world.begin(lift, event.fault)
                await elapse(event.for_s)
                world.end(lift, event.fault)
        case WireFails():
            for controller in world.lifts[lift].controllers:
                world.begin_wire_fault(controller, event.fault)
            await elapse(event.for_s)
            for controller in world.lifts[lift].controllers:
                world.end_wire_fault(controller, event.fault)
        case DiskFails():
            world.begin_disk_fault(event.fault)
            await elapse(event.for_s)
            world.end_disk_fault(event.fault)


def _person_acts(world: World, lift: str, what: str) -> Refused | None:
    site = world.site
    try:
        match what:
            case "acknowledge":
                site.acknowledge(lift, "the guard")
            case "lock_out":
                site.lock_out(lift, "the guard", "moving furniture")
            case _:
                site.end_lockout(lift, "the guard")
    except RequestRefused as error:
        return Refused(error.code, error.message, error.blocking)  # the exception keeps its manager alive
    return None


async def _turn_key(world: World, lift: str, event: KeyTurned) -> None:
    before = world.lifts[lift].inputs.key
    world.set_inputs(lift, _key(world, lift, event.key))
    await elapse(event.for_s)
    world.set_inputs(lift, replace(world.lifts[lift].inputs, key=before, robots_allowed=True))


def _key(world: World, lift: str, key: str) -> Inputs:
    inputs = world.lifts[lift].inputs
    return replace(inputs, robots_allowed=False) if key == "no_robots" else replace(inputs, key=Key(key))


def _hand_over(world: World, lift: str, event: HandsOver) -> None:
    state = world.site.state(lift)
    if state.holder == _holder(event.holder):
        with suppress(RequestRefused):
            world.site.hand_over(lift, _holder(event.holder), _holder(event.to))


def applies(world: World, name: str, fault: Fault) -> bool:
    """Whether the lift has what fails, and it does not fail already."""
    lift = world.lifts[name]
    if isinstance(fault, device.ForeignWriter) and fault.command not in lift.codec.commands:
        return False
    return fault not in lift.face.faults


async def _ride(world: World, lift: str, robot: RobotRides, played: Played) -> None:
    """Call, wait, enter, ride, wait, leave; as a client that believes nothing but the state."""
    floors = world.lifts[lift].floors
    pickup, destination = floors[robot.pickup % len(floors)], floors[robot.destination % len(floors)]
    holder = _holder(robot.holder)
    word = RobotWord.IN_PLACE if robot.in_words else None
    try:
        async with asyncio.timeout(robot.gives_up_after_s):
            await _until_open(world, FloorRequest(lift, holder, pickup, hold_door=True))
            played.aboard.entered(lift, holder)
            await _repeat(world, FloorRequest(lift, holder, pickup, hold_door=True), BOARDS_S)
            await _until_open(world, FloorRequest(lift, holder, destination, hold_door=robot.holds, robot=word))
            played.aboard.left(lift)
            await _repeat(world, FloorRequest(lift, holder, destination, hold_door=True), BOARDS_S)
            played.rides += 1
    except TimeoutError:
        if not robot.releases:
            return
    word = RobotWord.LEFT if robot.in_words else None
    if robot.releases:
        world.request(FloorRequest(lift, holder, destination, hold_door=False, robot=word))


async def _until_open(world: World, request: FloorRequest) -> None:
    while True:
        world.request(request)
        for _ in range(4):
            await elapse(ASKS_EVERY_S / 4)
            if _invited(world.site.state(request.lift), request):
                return


def _invited(state: LiftState, request: FloorRequest) -> bool:
    if (state.floor, state.robot_door) != (request.floor, RobotDoor.OPEN):
        return False
    # who did not want the door held does not hold the lift any more once it is there
    return state.holder == request.holder or (state.holder is None and not request.hold_door)


async def _repeat(world: World, request: FloorRequest, for_s: float) -> None:
    for _ in range(round(for_s / ASKS_EVERY_S)):
        world.request(request)
        await elapse(ASKS_EVERY_S)


def _holder(text: str) -> Holder:
    face, _, name = text.partition(":")
    return Holder(face, name or face)


Fails = Callable[[Schedule], bool]


def still_fails(finding: Finding) -> Fails:
    """Return the question whether a schedule still breaks the same rule."""
    return lambda schedule: any(found.rule == finding.rule for found in play(schedule).findings)
