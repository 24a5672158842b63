"""Trials of single commands: what is shown is what reaches the controller, and what becomes of it is told."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace

import httpx
import pytest

from drivers.modbus.write_plan import command_info
from drivers.model import OutputState
from lift_manager.api.lifts import Lift, LiftCommand, LiftCommands, PlannedWrites
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import Refused
from lift_manager.commissioning.poke.perform import Outcome, perform, plan_writes, read_lift
from lift_manager.commissioning.poke.trial import KnownLift, NotPossible, Trial, plan_trial
from lift_manager.commissioning.poke.wording import command_lines, latching_lines, trial_lines
from lift_manager.lift.commands import CommandState
from lift_manager.lift.refusals import Refusal
from lift_manager.web.app import make_app
from lift_manager.web.examples import CAPABILITIES
from register_maps import frames
from register_maps.frames import Request
from register_maps.words import Side
from simulator.controller import Inputs
from simulator.modes import Key
from tests.drivers.rig import HOLD, SIGNALS
from tests.lift_manager.client.manager import IDLE
from tests.support.rows import each_row
from tests.support.spine import Spine, on_spine
from tests.support.virtual_time import elapse
from tests.support.written_maps import written_map

ADDRESS = "http://127.0.0.1"


@dataclass
class Poked:
    """A trial, and what was seen of it."""

    trial: Trial
    shown: PlannedWrites
    outcome: Outcome
    text: str


@asynccontextmanager
async def client_of(made: Spine) -> AsyncIterator[LiftManagerClient]:
    async with LiftManagerClient(ADDRESS, transport=httpx.ASGITransport(make_app(made.site))) as client:
        yield client


async def poke(made: Spine, command: str, floor: str = "", *, hold_s: float = 2.0) -> Poked:
    """Try a command through the API of a manager, as the command line does."""
    lines: list[str] = []
    async with client_of(made) as client:
        trial, shown = await plan_writes(client, await read_lift(client, "lift"), command, floor)
        assert writes_of(made) == []
        outcome = await perform(client, trial, shown, who="poke", hold_s=hold_s, show=lines.append)
    return Poked(trial, shown, outcome, "\n".join(lines))


def writes_of(made: Spine) -> list[Request]:
    """Every write that any device of the lift got, in order."""
    devices = (made.device, *made.endpoints.values())
    timed = sorted((one for device in devices for one in device.writes), key=lambda one: one[0])
    return [request for _, request in timed]


def requests_of(shown: PlannedWrites) -> list[Request]:
    """The writes that were shown, parsed from their bytes."""
    parsed = []
    for write in shown.writes:
        data = bytes.fromhex(write.frame)
        parsed.append(frames.parse_request(b"\0\0\0\0\0" + bytes([len(data)]) + data, timed_coils=True))
    return parsed


def changes(requests: Iterable[Request]) -> Iterator[Request]:
    """Writes that change the cells of a device, unlike repetitions; one that the device ends changes them each time."""
    cells: dict[tuple[int, str, int], int] = {}
    for request in requests:
        before = dict(cells)
        values = request.values
        if request.function == frames.MASK_WRITE:
            keep, put = request.values
            values = (cells.get((request.unit, request.table, request.address), 0) & keep | put,)
        written = {(request.unit, str(request.table), request.address + i): value for i, value in enumerate(values)}
        cells |= written
        if request.duration is not None or any(before.get(cell, 0) != value for cell, value in written.items()):
            yield request


TRIALS = [
    ("generic-coils", "go_to", "L3"),
    ("generic-coils", "close_door.front", ""),
    ("generic-registers", "go_to", "L3"),
    ("generic-registers", "hold_door.front", ""),
    ("generic-registers", "robot_mode", ""),
    ("two-stop-agv", "go_to", "L2"),
    ("two-stop-agv", "close_door.front", ""),
    ("adam-io", "hold_door.front", ""),
    ("robotnik-il-eth", "go_to", "L2"),
    ("seer-generic", "close_door.front", ""),
    ("thingweb-elevator", "go_to", "L2"),
    ("seer-lps3-two-stop", "robot_in_place", ""),
    ("seer-siemens-chengdu", "robot_left", ""),
    ("seer-siemens-chengdu-block", "go", "L4"),
]


@each_row(("map_name", "command", "floor"), TRIALS)
def test_the_frames_shown_are_exactly_those_that_reach_the_controller(map_name: str, command: str, floor: str) -> None:
    async def check(made: Spine) -> None:
        made.device.writes.clear()
        poked = await poke(made, command, floor)
        shown = requests_of(poked.shown)
        assert list(changes(writes_of(made))) == list(changes(shown))
        assert set(writes_of(made)) <= {*shown, *cyclic(map_name)}
        assert poked.outcome.state is CommandState.CONFIRMED, poked.text
        assert poked.outcome.is_released
        assert "verified: " in poked.text
        assert made.state.holder is None
        assert made.state.restrictions.maybe_aboard is None

    on_spine(check, map_name)


def cyclic(map_name: str) -> list[Request]:
    """What is written whether or not anything is requested: the block of one map, at rest."""
    return [frames.write_registers(0, [0, 0, 0, 0])] if map_name.endswith("block") else []


def test_signals_and_outputs_are_told_as_they_change() -> None:
    async def check(made: Spine) -> None:
        made.device.writes.clear()
        text = (await poke(made, "go_to", "L2")).text
        assert "output robot_mode: at rest -> " in text
        assert "signal car_floor: L1 -> L2   (holding:1)" in text
        assert "the car stands at L2" in text
        assert "signal alive" not in text

    on_spine(check)


def test_a_command_that_the_lift_ignores_is_unconfirmed_and_released() -> None:
    async def check(made: Spine) -> None:
        made.device.ignores_calls = True
        poked = await poke(made, "go_to", "L3")
        assert (poked.outcome.state, poked.outcome.is_released) == (CommandState.UNCONFIRMED, True)

    on_spine(check)


def test_a_command_that_the_controller_refuses_is_rejected_with_its_reason() -> None:
    async def check(made: Spine) -> None:
        made.device.refuses = True
        poked = await poke(made, "go_to", "L2")
        assert (poked.outcome.state, poked.outcome.is_released) == (CommandState.REJECTED, True)
        assert "exception 04" in poked.outcome.text
        assert not any(any(request.values) for request in writes_of(made))

    on_spine(check, "adam-io")


async def fire(made: Spine) -> None:
    made.people(Inputs(fire=True))
    await elapse(1.0)


async def inspection(made: Spine) -> None:
    made.people(Inputs(key=Key.INSPECTION))
    await elapse(1.0)


async def lockout(made: Spine) -> None:
    made.site.lock_out("lift", "M. Weber", "new ropes")


async def another_holder(made: Spine) -> None:
    made.opened()


async def nothing(_: Spine) -> None:
    return


Happens = Callable[[Spine], Awaitable[None]]


@each_row(
    ("happens", "control", "code"),
    [
        (fire, True, Refusal.FIRE_LATCHED),
        (inspection, True, Refusal.MODE),
        (lockout, True, Refusal.LOCKED_OUT),
        (another_holder, True, Refusal.HELD),
        (nothing, False, Refusal.MONITOR_ONLY),
    ],
)
def test_what_no_robot_may_command_now_is_refused_with_the_reason(
    happens: Happens, control: bool, code: Refusal
) -> None:
    async def check(made: Spine) -> None:
        await happens(made)
        await elapse(1.0)
        made.device.writes.clear()
        with pytest.raises(Refused) as refused:
            await poke(made, "close_door.front")
        assert refused.value.code == code
        assert writes_of(made) == []

    on_spine(check, control=control)


def test_nothing_is_sent_where_the_car_has_moved_since_the_frames_were_shown() -> None:
    async def check(made: Spine) -> None:
        async with client_of(made) as client:
            known = await read_lift(client, "lift")
            trial, shown = await plan_writes(client, known, "close_door.front", "")
            moved = replace(trial, requests=(replace(trial.requests[0], floor="L2"), *trial.requests[1:]))
            with pytest.raises(NotPossible, match="has changed since its frames were shown"):
                await perform(client, moved, shown, who="poke", hold_s=0.0, show=lambda _: None)
        assert writes_of(made) == []

    on_spine(check)


def test_a_fire_ends_a_trial_before_its_time() -> None:
    async def check(made: Spine) -> None:
        async def burn() -> None:
            await elapse(5.0)
            await fire(made)

        burning = asyncio.create_task(burn())
        poked = await poke(made, "hold_door.front", hold_s=50.0)
        await burning
        assert asyncio.get_running_loop().time() < 30
        assert "it had ended before: " in poked.text
        assert "fire" in poked.text
        assert poked.outcome.is_released

    on_spine(check)


def test_one_that_is_cancelled_releases_everything_and_says_that_it_verified_it() -> None:
    async def check(made: Spine) -> None:
        lines: list[str] = []
        async with client_of(made) as client:
            trial, shown = await plan_writes(client, await read_lift(client, "lift"), "hold_door.front", "")
            work = perform(client, trial, shown, who="poke", hold_s=50.0, show=lines.append)
            task = asyncio.create_task(work)
            await elapse(5.0)
            assert any(writes_of(made)[-1].values)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
        assert lines[-1].endswith("verified: hold_door.front is at rest")
        assert list(changes(writes_of(made))) == list(changes(requests_of(shown)))
        assert made.state.holder is None

    on_spine(check, "adam-io")


# -- plans


GO_TO = "action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 5}"
ONE_DOOR = (
    f'{SIGNALS}commands:\n  go_to: {{at: "holding:40", as: floor, rest: 0, {GO_TO}}}\n'
    f'  hold_door.front: {{at: "coil:8", {HOLD}}}\n'
    f'  close_door.front: {{at: "coil:9", {GO_TO}}}\n'
    '  heartbeat: {at: "coil:22", action: toggle, every_s: 0.5}\n'
)
TWO_DOORS = (
    f'{SIGNALS.rstrip().removesuffix("}")}, door.rear: {{at: "discrete:2"}}}}\ncommands:\n'
    f'  go_to.front: {{at: "holding:40", as: floor, rest: 0, {GO_TO}}}\n'
    f'  go_to.rear: {{at: "holding:41", as: floor, rest: 0, {GO_TO}}}\n'
    f'  hold_door.front: {{at: "coil:8", {HOLD}}}\n'
    f'  hold_door.rear: {{at: "coil:9", {HOLD}}}\n'
)


def known_lift(text: str, lift: Lift = IDLE) -> KnownLift:
    """A lift of a map, as a manager tells of it: at L1 with its door shut, and a rear door at L2 only."""
    codec = written_map(text)
    commands = [LiftCommand.model_validate(command_info(one, OutputState.AT_REST)) for one in codec.commands.values()]
    doors_at = {"L1": (Side.FRONT,), "L2": (Side.FRONT, Side.REAR)}
    able = CAPABILITIES.model_copy(update={"doors_at": doors_at, "map": "written", "name": lift.name})
    return KnownLift(LiftCommands(name=lift.name, same_floor_call=False, commands=tuple(commands)), able, lift)


OFFLINE = IDLE.unread(7.0, "plc does not answer")
MOVING = IDLE.model_copy(update={"standing": False})


@each_row(
    ("text", "command", "floor", "lift", "why"),
    [
        (ONE_DOOR, "close_door", "", IDLE, "no command 'close_door'; did you mean `close_door.front`"),
        (ONE_DOOR, "heartbeat", "", IDLE, "heartbeat is written all the time"),
        (ONE_DOOR, "go_to", "", IDLE, "go_to needs a floor, such as `lift-manager poke lift go_to L2`"),
        (ONE_DOOR, "go_to", "L9", IDLE, "no floor 'L9'; its floors are L1, L2"),
        (ONE_DOOR, "hold_door.front", "L2", IDLE, "hold_door.front takes no floor"),
        (ONE_DOOR, "go_to", "L1", IDLE, "the car stands at L1 already"),
        (ONE_DOOR, "hold_door.front", "", MOVING, "nobody knows at which floor the car stands"),
        (ONE_DOOR, "go_to", "L2", OFFLINE, "cannot be read, and nothing is pressed .*: plc does not answer"),
        (TWO_DOORS, "hold_door.rear", "", IDLE, "L1, which has no rear door; bring the car to L2 first"),
        (TWO_DOORS, "go_to.rear", "L2", IDLE, "to L2 with go_to.front, never with go_to.rear"),
    ],
)
def test_what_cannot_be_tried_is_said_with_what_to_do(
    text: str, command: str, floor: str, lift: Lift, why: str
) -> None:
    with pytest.raises(NotPossible, match=why):
        plan_trial(known_lift(text, lift), command, floor)


def test_a_session_holds_every_door_of_the_floor() -> None:
    known = known_lift(TWO_DOORS, IDLE.model_copy(update={"floor": "L2"}))
    assert plan_trial(known, "hold_door.rear").steps == ("press hold_door.front", "press hold_door.rear")


# -- words


def words(lines: Iterable[str]) -> str:
    shown = list(lines)
    assert max(map(len, shown)) < 80
    return " ".join(" ".join(shown).split())


def test_the_commands_are_listed_with_their_addresses_and_what_ends_them() -> None:
    text = words(command_lines(known_lift(ONE_DOOR).commands))
    assert "go_to FLOOR brings the car to a floor; pressed for 0.5 s, then released; if this" in text
    assert "hold_door.front opens the front door" in text
    assert "heartbeat the heartbeat of the lift manager; written all the time" in text


def test_frames_are_shown_with_function_address_and_bytes() -> None:
    async def check(made: Spine) -> None:
        async with client_of(made) as client:
            trial, shown = await plan_writes(client, await read_lift(client, "lift"), "hold_door.front", "")
        text = words(trial_lines(trial, shown, 5.0))
        assert (
            "press hold_door.front at holding:17: FC06 write holding register 17 := 1, unit 1 01 06 00 11 00 01" in text
        )
        assert "the watchdog of the controller releases it; released here after 5 s" in text
        assert words(["", *latching_lines(trial)]) == ""
        assert made.device.writes == []

    on_spine(check)


def test_what_would_stay_on_is_said_where_nothing_releases_it() -> None:
    text = words(latching_lines(plan_trial(known_lift(ONE_DOOR), "hold_door.front")))
    assert "while hold_door.front is on, coil:8 STAYS ON and nothing releases it; a closed lid is enough" in text
