"""Every shipped map drives a whole robot trip: call, enter, ride, leave, release.

On the lift that is simulated from it, and on a controller written by hand, which shares no code with the maps and the simulator.
"""

import ast
import struct
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from drivers.modbus.writes import block_write, timed_pulse
from drivers.model import Command, CommandKind, Proof
from lift_manager.lift.observation import RobotDoor
from register_maps import frames
from register_maps.arbitration import NO_CLAIM, claim_alone
from register_maps.codec import compile_map
from register_maps.frames import Request
from register_maps.load import load, shipped
from register_maps.words import Motion
from simulator.registers import BEATS_PER_S
from simulator.state import ShownState
from tests.support import second_controllers
from tests.support.rows import each_row
from tests.support.second_controllers.cast import CAST
from tests.support.second_controllers.lift import NaiveLift, Shows, Still
from tests.support.trip import Trip, on_trip
from tests.support.trip_second import SecondPlant, naive_lift
from tests.support.trip_simulator import Mirror, SimulatedPlant, foreign_writes, requests, simulated_trip
from tests.support.trip_sites import (
    COMPLETIONS,
    NO_TRIP,
    Incomplete,
    Site,
    completed_site,
    lacking,
    site_of,
    stops,
)
from tests.support.virtual_time import elapse, run_virtual

CALLS = frozenset({"go_to", "call", "go"})
RIDEABLE = [name for name in shipped() if name not in NO_TRIP]
"""Every other map that is shipped, or comes later, is tried; one that lacks something fails until it is told what."""
HEARS_WORDS = ("seer-lps3-two-stop", "seer-siemens-chengdu", "seer-siemens-chengdu-block")
TRIPS = [(name, True) for name in RIDEABLE] + [(name, False) for name in ("generic-registers", *HEARS_WORDS)]
"""Each map, with a robot that says that it is inside, and that it is out; by requests alone where the map has commands for these
words, and on one that has none, for there the map makes no difference."""
SOURCES = sorted(Path(second_controllers.__path__[0]).glob("*.py"))


@each_row(("name", "in_words"), TRIPS)
def test_a_robot_is_invited_only_where_the_lift_stands_open_for_it_and_everything_is_let_go(
    name: str, in_words: bool
) -> None:
    plant, made = simulated_trip(name, in_words=in_words)
    site = made.site
    pickup, destination = stops(site)
    assert made.opened > 50
    assert foreign_writes(site, made.exchanges) == []
    mirror = Mirror(site)
    asked = [mirror.take(*one) for one in requests(made.exchanges)]
    assert asked[-1] == {}
    assert mirror.not_at_rest(made.exchanges[-1].at) == []
    pressed = [str(outcome.command) for outcome in made.outcomes]
    assert len(pressed) == len(set(pressed)), "repeats of a request press nothing"
    floors = list(site.floors)
    called = {command[call] for command in asked for call in ("go_to", "call") if call in command}
    assert floors.index(pickup) in called
    assert plant.face.picture.floor == floors.index(destination)


def test_every_map_with_commands_for_the_words_of_a_robot_is_ridden_without_them_too() -> None:
    assert tuple(name for name in RIDEABLE if "robot_in_place" in load(name).map.commands) == HEARS_WORDS


@each_row("name", sorted(COMPLETIONS))
def test_a_map_that_is_completed_is_none_that_could_do_without(name: str) -> None:
    loaded = load(name)
    assert [*loaded.unset, *loaded.map.needs, *lacking(compile_map(loaded.map))] != []


@each_row("name", sorted(NO_TRIP))
def test_a_map_that_makes_no_trip_has_no_door(name: str) -> None:
    assert [signal for signal in load(name).map.signals if signal.startswith("door.")] == []


@each_row("name", sorted(COMPLETIONS))
def test_a_map_that_lacks_something_and_is_not_told_what_fails(name: str) -> None:
    with pytest.raises(Incomplete, match=f"{name} has no "):
        completed_site(name, {})


@pytest.mark.parametrize("second", [False, True], ids=["simulated", "second controller"])
def test_the_demo_without_doors_is_called_and_confirmed_and_never_invites_a_robot(second: bool) -> None:
    site = site_of("thingweb-elevator")
    plant = SecondPlant(site, naive_lift(site)) if second else SimulatedPlant(site)

    async def check(made: Trip) -> None:
        made.ask("L3", hold=False)
        await made.until(lambda state: state.motion is Motion.MOVING)
        assert made.state.floor is None, "the number it shows is where it is going"
        await made.until(lambda state: state.floor == "L3")
        assert made.state.standing
        await made.until(lambda state: state.holder is None)
        await elapse(10)
        made.check()

    made = on_trip(check, site, plant)
    command = Command(CommandKind.GO_TO, "L3")
    assert [(outcome.command, outcome.proof) for outcome in made.outcomes] == [(command, Proof.EFFECT)]
    assert made.opened == 0
    assert [request.values for _, _, request in requests(made.exchanges) if request.is_write] == [(site.floors["L3"],)]
    assert foreign_writes(site, made.exchanges) == []


def test_a_door_with_a_closed_contact_only_is_held_but_never_open_for_a_robot() -> None:
    site = Site("robotnik-il-eth", compile_map(load("robotnik-il-eth").map), {"0": 0, "1": 1, "2": 2})
    plant = SimulatedPlant(site)

    async def check(made: Trip) -> None:
        made.ask("2")
        await made.until(lambda state: state.floor == "2" and state.robot_door is RobotDoor.MOVING)
        await elapse(20)
        assert plant.face.picture.door_open_floor == 2
        made.ask("2", hold=False)
        await made.until(lambda state: state.robot_door is RobotDoor.CLOSED)
        made.check()

    assert on_trip(check, site, plant).opened == 0


# -- the second controllers


def test_every_shipped_map_has_a_second_controller() -> None:
    assert sorted(CAST) == list(shipped())


@each_row("path", SOURCES)
def test_a_second_controller_uses_nothing_but_the_standard_library_and_its_own_kind(path: Path) -> None:
    imported = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            imported |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module or ".")
    own = {name for name in imported if name.startswith("tests.support.second_controllers.")}
    assert imported - own <= {"struct", "dataclasses", "collections.abc", "typing"}


@cache
def ridden(name: str, *, in_words: bool) -> tuple[SecondPlant, Trip]:
    """Make a whole trip on the second controller, once for everybody who asks; fails as it fails."""
    site = site_of(name)
    plant = SecondPlant(site, naive_lift(site))
    pickup, destination = stops(site)

    async def check(made: Trip) -> None:
        await made.make(pickup=pickup, destination=destination)

    return plant, on_trip(check, site, plant, in_words=in_words)


@each_row(("name", "in_words"), TRIPS)
def test_a_robot_makes_its_trip_on_the_second_controller_too(name: str, in_words: bool) -> None:
    plant, made = ridden(name, in_words=in_words)
    assert made.opened > 50
    assert plant.devices[""].asked() == {}
    assert plant.lift.shows.floor == list(made.site.floors).index(stops(made.site)[1])


@each_row(
    ("name", "command", "for_s"),
    [
        ("adam-pushbutton", "go_to", 0.5),
        ("waveshare-relay", "go_to", 0.5),
        ("generic-registers", "go_to", 0.5),
        ("seer-siemens-chengdu", "robot_in_place", 5.0),
        ("seer-siemens-chengdu-block", "robot_left", 5.0),
    ],
)
def test_a_press_lasts_as_long_as_its_source_says(name: str, command: str, for_s: float) -> None:
    _, trip = ridden(name, in_words=True)
    pressed = [one.at for one in trip.exchanges if command in one.truth.asked]
    gone = next(one.at for one in trip.exchanges if one.at > pressed[0] and command not in one.truth.asked)
    assert gone - pressed[0] == pytest.approx(for_s, abs=0.21)


@each_row("name", ["seer-siemens-chengdu", "seer-siemens-chengdu-block"])
def test_the_permission_to_leave_invites_nobody_in_and_that_to_enter_nobody_out(name: str) -> None:
    site = site_of(name)
    lift = NaiveLift(len(site.floors))
    lift.mistaken_s = 5.0
    pickup, destination = stops(site)

    async def check(made: Trip) -> None:
        await made.make(pickup=pickup, destination=destination)

    trip = on_trip(check, site, SecondPlant(site, lift))
    mistaken = [one for one in trip.exchanges if one.truth.may_leave and one.truth.open_at == len(site.floors) - 1]
    assert len(mistaken) > 20


def shown(picture: ShownState, at: float) -> Shows:
    """Put what the simulated lift did into the words of the second controllers."""
    door = next(iter(picture.doors.values()), "closed")
    return Shows(
        floor=picture.floor,
        at_floor=picture.in_door_zone,
        level=picture.level_floor is not None,
        door=str(door),
        motion=str(picture.motion),
        robot_mode=picture.robot_mode_on,
        accepted=picture.accepted,
        destination=picture.destination,
        may_enter=picture.may_enter,
        may_leave=picture.may_leave,
        beat=int(at * BEATS_PER_S) % 65536,
    )


def agree(plant: SimulatedPlant, trip: Trip) -> list[str]:
    """Put every request of a trip to the second controller, which sees the same lift; returns the calls that it heard."""
    site, still = trip.site, Still(Shows())
    second = SecondPlant(site, still)
    mirror = Mirror(site)
    heard: list[str] = []
    before: dict[str, int] = {}
    for number, (exchange, request) in enumerate(zip(trip.exchanges, requests(trip.exchanges), strict=True)):
        still.shows = shown(plant.shown[number], exchange.at)
        said = second.answer(exchange.device, exchange.request, exchange.at)
        assert said == exchange.answer, _at(plant, number, request)
        meant = mirror.take(*request)
        if not exchange.is_write:
            continue
        asked = second.devices[""].asked()
        assert asked == meant, _at(plant, number, request)
        for call in asked.keys() & CALLS:
            if before.get(call) != asked[call]:
                heard.append(f"{call} {asked[call]}")
                assert _follows(asked[call], number, plant, trip), _at(plant, number, request)
        before = asked
    return heard


def _at(plant: SimulatedPlant, number: int, request: tuple[float, str, Request]) -> str:
    return f"{plant.site.name} at {request[0]:.3f} s, {request[2]}, while {plant.shown[number]}"


def _follows(floor: int, number: int, plant: SimulatedPlant, trip: Trip) -> bool:
    """Whether the simulated lift takes a call within a second."""
    until = trip.exchanges[number].at + 1
    after = zip(trip.exchanges[number:], plant.shown[number:], strict=True)
    soon = [picture for exchange, picture in after if exchange.at < until]
    return any(floor in {*picture.car_calls, picture.destination, picture.level_floor} for picture in soon)


@each_row("name", RIDEABLE)
def test_the_second_controller_answers_every_byte_of_a_trip_alike_and_hears_the_same_commands(name: str) -> None:
    plant, trip = simulated_trip(name, in_words=True)
    pickup, destination = (list(trip.site.floors).index(floor) for floor in stops(trip.site))
    commands = trip.site.codec.commands
    ride = [f"go_to {pickup}", f"go_to {destination}"]
    if "call" in commands:
        ride = [f"call {pickup}", *([f"go {destination}"] if "go" in commands else [])]
    assert agree(plant, trip) == ride


def test_the_second_controller_hears_a_call_of_the_demo_without_doors_alike() -> None:
    site = site_of("thingweb-elevator")
    plant = SimulatedPlant(site)

    async def check(made: Trip) -> None:
        for floor in ("L3", "L2"):
            made.ask(floor, hold=False)
            await made.until(lambda state: state.holder is None)
            await elapse(10)  # the simulated lift has doors, which nobody sees here, and they close before it goes on
        made.check()

    trip = on_trip(check, site, plant)
    assert agree(plant, trip) == ["go_to 2", "go_to 1"]


def test_the_demo_is_never_asked_sooner_than_a_second_after_the_last_time() -> None:
    site = site_of("thingweb-elevator")
    plant = SecondPlant(site, naive_lift(site))

    async def check(made: Trip) -> None:
        made.ask("L3", hold=False)
        await made.until(lambda state: state.holder is None)

    trip = on_trip(check, site, plant)
    looked_at = [one.at for one in trip.exchanges if one.request[7] == 2]
    assert len(looked_at) > 5
    assert min(after - before for before, after in pairwise(looked_at)) > 1.0


EDGES = (0, 8, 16, 20, 29, 99, 104, 200, 384, 512, 1024, 4096, 4108, 4144, 10001, 30001, 40001, 40003, 65535)
"""Numbers at, before and after which some device begins or ends."""


@each_row("name", sorted(CAST))
def test_both_answer_for_the_same_addresses_and_refuse_all_others_alike(name: str) -> None:
    site = site_of(name)
    plant = SimulatedPlant(site)
    still = Still(shown(plant.face.picture, 0.0))
    second = SecondPlant(site, still)
    addresses = sorted({near for edge in EDGES for near in range(edge - 4, edge + 5) if 0 <= near <= 65535})

    async def ask() -> list[str]:
        differ = []
        for device in second.devices:
            unit = site.codec.map.unit_of(device)
            for function in (1, 2, 3, 4, 7, 23):
                for address in addresses:
                    frame = struct.pack(">HHHBBHH", 1, 0, 6, unit, function, address, 1)
                    answers = plant.answer(device, frame, 0.0), second.answer(device, frame, 0.0)
                    head = 8 if answers[0] is not None and answers[0][7] == function else None
                    # what is said at an address that the map does not use is nobody's business
                    if answers[0] is None or answers[1] is None or answers[0][:head] != answers[1][:head]:
                        differ.append(f"{device} {frame.hex(' ')}: {answers}")
        return differ

    assert run_virtual(ask) == []


def every_write(site: Site) -> Iterator[tuple[str, Request]]:
    """Give and take back every command of a map, to every floor: the device, and what is written to it by one write."""
    image = {cell: 0 for command in site.codec.commands.values() for block in command.blocks for cell in block.cells}
    claim = {} if site.codec.arbitration is None else site.codec.arbitration.encode(claim_alone(NO_CLAIM))
    image |= {point.cell: value for point, value in claim.items()}
    for command in site.codec.commands.values():
        codes = site.floors.values() if command.is_call else (1,)
        # what the device ends by itself is never taken back
        for code in codes if command.spec.ends_itself else (given for pressed in codes for given in (pressed, None)):
            contents = command.encode(code)
            for point, value in contents.items():
                image[point.cell] = point.into(image[point.cell], value)
            for block, function in zip(command.blocks, command.functions, strict=True):
                unit = site.codec.map.unit_of(block.endpoint)
                if not command.is_timed_coil:
                    yield block.endpoint, block_write(block, function, image, unit)
                elif image[block.cells[0]]:
                    yield block.endpoint, timed_pulse(command, block, unit)


@each_row("name", sorted(CAST))
def test_both_hear_every_command_to_every_floor_alike_and_read_it_back_alike(name: str) -> None:
    site = site_of(name)
    plant = SimulatedPlant(site)
    still = Still(Shows())
    second = SecondPlant(site, still)
    mirror = Mirror(site)

    async def ask() -> set[tuple[str, int]]:
        heard: set[tuple[str, int]] = set()
        for number, (device, request) in enumerate(every_write(site)):
            await elapse(6)  # a device that ends a command by itself has ended the one before
            now = 6.0 * (number + 1)
            read = frames.read(request.table, request.address, request.count, request.unit)
            for asking in (request, read):
                frame = frames.frame(asking, number)
                said = plant.answer(device, frame, now)
                still.shows = shown(plant.face.picture, now)
                assert second.answer(device, frame, now) == said, asking
            asked = mirror.take(now, device, request)
            assert second.devices[""].asked() == asked, request
            heard |= set(asked.items())
        return heard

    calls = {(name, index) for name in CALLS & site.codec.commands.keys() for index in range(len(site.floors))}
    others = {(name, 1) for name in site.codec.commands.keys() - CALLS}
    assert run_virtual(ask) == calls | others
