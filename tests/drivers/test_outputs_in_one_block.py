"""Several outputs in one block: over a new connection, on a slow controller, and calls that are levels."""

import asyncio
from contextlib import suppress

import pytest

from drivers.errors import ConnectProblem, DriverError
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import Fault, MemoryDevice, exception, hang_up, silence
from drivers.model import Command, CommandKind
from register_maps.words import Side, Table
from tests.drivers.caller import Caller
from tests.drivers.linked import now
from tests.drivers.rig import HOLD_FRONT, SIGNALS, Rig, allowed, ended, on_rig
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual
from tests.support.written_maps import written_map

MODE = Command(CommandKind.ROBOT_MODE)
REAR = Command(CommandKind.HOLD_DOOR, side=Side.REAR)
GO2 = Command(CommandKind.GO_TO, "L2")
LEVEL = "action: hold, max_hold_s: 60, on_link_loss: device_watchdog, confirm: {any_of: [readback], within_s: 2}"
TWO = (
    f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:1", refresh_s: 2, {LEVEL}}}\n'
    f'  robot_mode: {{at: "coil:2", refresh_s: 2, {LEVEL}}}\n'
    'write_blocks: [{at: "coil:1", count: 2, function: 15}]\n'
)
THREE = (
    f'{SIGNALS.rstrip().removesuffix("}")}, door.rear: {{at: "discrete:2"}}}}\ncommands:\n'
    f'  hold_door.front: {{at: "holding:20", refresh_s: 1, {LEVEL}}}\n'
    f'  hold_door.rear: {{at: "holding:21", refresh_s: 1, {LEVEL}}}\n'
    f'  robot_mode: {{at: "holding:22", refresh_s: 1, {LEVEL}}}\n'
    'write_blocks: [{at: "holding:20", count: 3, function: 16, every_s: 0.5}]\n'
)


async def keep(made: Rig, seconds: float, *commands: Command) -> None:
    """Want these for so long, as a session does."""
    end = now() + seconds
    while now() < end:
        for command in commands:
            made.lift.hold(command, allowed)
        await elapse(0.1)


def images(made: Rig, since: float) -> list[tuple[int, ...]]:
    return [heard.request.values for heard in made.device.received if heard.at_s >= since and heard.request.is_write]


@each_row("away_s", [0.0, 0.5, 3.0])
@each_row("delay_s", [0.0, 0.05, 0.15, 0.2, 0.3])
def test_a_release_that_is_due_on_a_new_connection_takes_no_wanted_hold_with_it(delay_s: float, away_s: float) -> None:
    async def check(made: Rig) -> None:
        await keep(made, 8, HOLD_FRONT, MODE)
        assert made.cells(Table.COIL, 1, 2) == [1, 1]
        made.lift.let_go(MODE)
        made.device.fail_next(hang_up(executes=False), on=lambda request: request.is_write)
        since = now()
        if away_s:
            made.device.connect_problem = ConnectProblem.REFUSED
            await keep(made, away_s, HOLD_FRONT)
            made.device.connect_problem = None
        await keep(made, 10, HOLD_FRONT)
        assert {image[0] for image in images(made, since)} == {1}
        assert made.cells(Table.COIL, 1, 2) == [1, 0]

    on_rig(check, TWO, {"": MemoryDevice(delay_s=delay_s)})


def test_a_release_waits_a_second_at_most_for_the_first_reading_of_a_connection() -> None:
    async def check(made: Rig) -> None:
        await keep(made, 5, HOLD_FRONT, MODE)
        made.device.fail_next(exception(4), times=10**6, on=lambda request: not request.is_write)
        made.device.disconnect()
        made.lift.let_go(MODE)
        lost = now()
        await keep(made, 4, HOLD_FRONT)
        released = [heard.at_s for heard in made.device.received if heard.at_s > lost and heard.request.is_write]
        # the reconnect, the second, and a pause between two tries
        assert released[0] - lost <= 0.2 + 1.0 + 2.0
        assert made.cells(Table.COIL, 2) == [0]

    on_rig(check, TWO)


def test_a_hold_that_was_wanted_before_the_first_reading_and_is_on_is_adopted() -> None:
    async def main() -> None:
        device = MemoryDevice(delay_s=0.02)
        device.values[Table.INPUT][1] = 1
        device.values[Table.COIL].update({1: 1, 2: 1})
        link = Link(device.wire, LinkSettings(), name="plc")
        lift = Caller(
            ModbusLift(written_map(TWO), link, LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, control=True))
        )

        async def poll() -> None:
            while True:
                # a restored session wants its hold from the first moment on
                lift.hold(HOLD_FRONT, allowed)
                with suppress(DriverError):
                    await lift.read()
                await elapse(0.1)

        running = [asyncio.ensure_future(part) for part in (link.run(), lift.run(), poll())]
        await elapse(5)
        await ended(running)
        writes = [request.values for request in device.writes]
        assert writes
        assert set(writes) == {(1, 0)}

    run_virtual(main)


def test_every_hold_of_a_block_gets_its_turn_on_a_controller_too_slow_for_all_of_them() -> None:
    async def check(made: Rig) -> None:
        await keep(made, 30, HOLD_FRONT, REAR, MODE)
        assert made.cells(Table.HOLDING, 20, 21, 22) == [1, 1, 1]

    on_rig(check, THREE, {"": MemoryDevice(delay_s=0.15)})


def test_a_press_is_not_kept_waiting_by_holds_that_are_refreshed_all_the_time() -> None:
    text = THREE.replace(
        "write_blocks", '  go_to: {at: "holding:30", as: floor, action: pulse, width_s: 0.5, rest: 0}\nwrite_blocks'
    )

    async def check(made: Rig) -> None:
        await keep(made, 10, HOLD_FRONT, REAR)
        began = now()
        _ = made.lift.press(GO2, allowed)
        await keep(made, 2, HOLD_FRONT, REAR)
        pressed = next(
            heard.at_s for heard in made.device.received if heard.request.is_write and heard.request.address == 30
        )
        # what is in hand, a write and its look, and nothing more
        assert pressed - began <= 0.15 * 4 + 0.1

    on_rig(check, text, {"": MemoryDevice(delay_s=0.15)})


@pytest.mark.parametrize("fault", [Fault(lambda _request, answer: ((0.0, answer),), executes=False), None])
def test_a_call_that_is_a_level_and_is_taken_back_at_once_is_not_pressed_again(fault: Fault | None) -> None:
    text = (
        f'{SIGNALS}commands:\n  go_to: {{at: "holding:16", as: floor, rest: 0, action: hold, until: arrived, max_hold_s: 60,'
        " on_link_loss: latches, confirm: {any_of: [readback, effect], within_s: 10}}\n"
    )

    async def check(made: Rig) -> None:
        if fault is None:
            # written, but its read-back is lost
            made.device.fail_next(silence(), on=lambda request: request.table is Table.HOLDING and not request.is_write)
        else:
            made.device.fail_next(fault, times=1000, on=lambda request: request.is_write)
        _ = made.lift.press(GO2, allowed)
        await elapse(20)
        assert [image for image in images(made, 0) if image != (0,)] == [(2,)]

    on_rig(check, text)


@each_row("delay_s", [0.1, 0.3, 0.45, 0.6])
def test_everything_is_written_to_rest_before_any_of_it_is_looked_at(delay_s: float) -> None:
    level = LEVEL.replace("device_watchdog", "latches")
    names = ("hold_door.front", "hold_door.rear", "robot_mode", "robot_in_place")
    lines = "".join(f'  {name}: {{at: "coil:{place}", {level}}}\n' for place, name in enumerate(names))
    both = f'{SIGNALS.rstrip().removesuffix("}")}, door.rear: {{at: "discrete:2"}}}}\n'

    async def check(made: Rig) -> None:
        await keep(made, 40, HOLD_FRONT, REAR, MODE, Command(CommandKind.ROBOT_IN_PLACE))
        assert made.cells(Table.COIL, 0, 1, 2, 3) == [1, 1, 1, 1]
        releasing = asyncio.ensure_future(made.lift.release_all())
        await elapse(4)
        assert made.cells(Table.COIL, 0, 1, 2, 3) == [0, 0, 0, 0]
        # and each was seen to be at rest in the end
        await elapse(8)
        assert releasing.done()

    on_rig(check, f"{both}commands:\n{lines}", {"": MemoryDevice(delay_s=delay_s)})


def test_a_release_that_is_looked_at_later_is_repeated_if_it_has_not_come_about() -> None:
    text = TWO.replace('write_blocks: [{at: "coil:1", count: 2, function: 15}]\n', "")

    async def check(made: Rig) -> None:
        await keep(made, 3, HOLD_FRONT, MODE)
        nothing = Fault(lambda _request, answer: ((0.0, answer),), executes=False)
        made.device.fail_next(nothing, times=4, on=lambda request: request.is_write)
        made.lift.let_go(HOLD_FRONT)
        made.lift.let_go(MODE)
        await elapse(3)
        assert made.cells(Table.COIL, 1, 2) == [0, 0]

    on_rig(check, text, {"": MemoryDevice(delay_s=0.05)})


def test_a_refresh_that_the_controller_refuses_is_not_written_at_the_pace_of_the_polls() -> None:
    async def check(made: Rig) -> None:
        await keep(made, 5, HOLD_FRONT)
        refused = exception(4)
        made.device.fail_next(refused, times=10**6, on=lambda request: request.is_write)
        since = now()
        await keep(made, 60, HOLD_FRONT)
        assert len([heard for heard in made.device.received if heard.at_s >= since and heard.request.is_write]) <= 31
        assert not made.lift.held(HOLD_FRONT)

    on_rig(check, TWO, {"": MemoryDevice(delay_s=0.02)})
