"""What one output may do to another: in one block or word, on a slow controller, after a lost answer, on a new connection."""

import asyncio

import pytest

from drivers.modbus.memory import Fault, MemoryDevice, exception, silence
from drivers.model import Command, CommandKind, Result
from register_maps.words import Side, Table
from tests.drivers.rig import CLOSE_FRONT, HOLD, HOLD_FRONT, SIGNALS, Rig, allowed, on_rig, rig
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse, run_virtual
from tests.support.written_maps import HEAD, written_map

GO2 = Command(CommandKind.GO_TO, "L2")
REAR = Command(CommandKind.HOLD_DOOR, side=Side.REAR)
MODE = Command(CommandKind.ROBOT_MODE)
BOX = HEAD + "endpoints: {box: {unit_id: 1, served: {coil: [[0, 9]], holding: [[0, 9]]}}}\n"
DOES_NOTHING = Fault(lambda _request, answer: ((0.0, answer),), executes=False)
EFFECT = "confirm: {any_of: [effect], within_s: 5}"
LEVEL_CALL = f"action: hold, until: arrived, max_hold_s: 100, on_link_loss: latches, {EFFECT}"
CONTROL_WORD = (
    f"{SIGNALS}commands:\n"
    '  heartbeat: {at: "holding:9.0", action: toggle, every_s: 0.5, shared_word: owned}\n'
    '  go_to: {one_of: ["holding:9.1", "holding:9.2", "holding:9.3"], refresh_s: 2, shared_word: owned, '
    f"{LEVEL_CALL}}}\n"
)
BLOCK = (
    f'{SIGNALS}commands:\n  go_to: {{one_of: ["coil:0", "coil:1", "coil:2"], {LEVEL_CALL}}}\n'
    f'  hold_door.front: {{at: "coil:3", refresh_s: 1, {HOLD}}}\n'
    'write_blocks: [{at: "coil:0", count: 4, function: 15}]\n'
)


def test_a_cycle_does_not_repeat_a_call_whose_release_was_not_answered() -> None:
    async def main() -> None:
        device = MemoryDevice(unit=0)
        device.values[Table.HOLDING][8] = 1
        async with rig(compiled("seer-siemens-chengdu-block"), {"": device}) as made:
            call = Command(CommandKind.CALL, "L2")
            _ = made.lift.press(call, allowed)
            await elapse(1.2)
            assert device.values[Table.HOLDING][1] == 2
            device.fail_next(silence(), on=lambda request: request.is_write and request.values[0] == 0)
            before = len(device.writes)
            made.lift.let_go(call)
            await elapse(3.0)
            assert len(device.writes) > before + 1
            assert all(request.values[0] == 0 for request in device.writes[before:])

    run_virtual(main)


def test_a_refresh_does_not_press_a_neighbour_whose_release_was_not_answered() -> None:
    async def main() -> None:
        device, floors = MemoryDevice(), {"L1": 0, "L2": 1, "L3": 2}
        device.values[Table.HOLDING][0] = 1
        async with rig(compiled("robotnik-il-eth"), {"": device}, floors) as made:
            made.lift.hold(MODE, allowed)
            await elapse(0.5)
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(1.0)
            assert device.values[Table.HOLDING][385] & 1
            device.fail_next(silence(), on=lambda request: request.is_write and not request.values[0] & 1)
            before = len(device.writes)
            made.lift.let_go(HOLD_FRONT)
            await elapse(3.0)
            assert len(device.writes) > before + 1
            assert not any(request.values[0] & 1 for request in device.writes[before:])

    run_virtual(main)


@pytest.mark.parametrize("since_beat_s", [0.0, 0.2, 0.4])
def test_a_heartbeat_in_the_word_of_a_call_does_not_repeat_it_on_a_new_connection(since_beat_s: float) -> None:
    async def check(made: Rig) -> None:
        _ = made.lift.press(GO2, allowed)
        await elapse(1.0 + since_beat_s)
        assert made.cells(Table.HOLDING, 9)[0] & 0b1000
        made.device.values[Table.HOLDING][9] = 0
        made.device.disconnect()
        before = len(made.device.writes)
        await elapse(5.0)
        assert len(made.device.writes) > before
        assert not any(request.values[0] & 0b1000 for request in made.device.writes[before:])

    on_rig(check, CONTROL_WORD)


def test_a_heartbeat_does_not_keep_a_call_on_that_may_not_be_pressed() -> None:
    said: list[str | None] = [None]

    async def check(made: Rig) -> None:
        _ = made.lift.press(GO2, lambda: said[0])
        await elapse(1.0)
        said[0] = "the last reading is too old"
        before = len(made.device.writes)
        await elapse(5.0)
        assert not any(request.values[0] & 0b1000 for request in made.device.writes[before:])

    on_rig(check, CONTROL_WORD)


def test_a_release_in_the_block_of_a_call_does_not_repeat_it_on_a_new_connection() -> None:
    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.3)
        _ = made.lift.press(GO2, allowed)
        await elapse(1.0)
        made.device.values[Table.COIL].clear()
        made.device.disconnect()
        made.lift.let_go(HOLD_FRONT)
        before = len(made.device.writes)
        await elapse(5.0)
        assert not any(request.values[2] for request in made.device.writes[before:])

    on_rig(check, BLOCK)


def test_a_press_that_may_go_out_does_so_without_a_neighbour_that_may_not() -> None:
    said: list[str | None] = [None]

    async def check(made: Rig) -> None:
        _ = made.lift.press(GO2, lambda: said[0])
        await elapse(0.5)
        assert made.cells(Table.COIL, 2) == [1]
        said[0] = "the session has ended"
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.5)
        assert made.cells(Table.COIL, 2, 3) == [0, 1]

    on_rig(check, BLOCK)


def test_outputs_that_cannot_be_let_go_keep_no_other_from_it_and_no_reading_away() -> None:
    device = MemoryDevice(delay_s=0.12)
    text = (
        f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:0", {HOLD}}}\n  hold_door.rear: {{at: "coil:1", {HOLD}}}\n'
        f'  go_to: {{one_of: ["coil:4", "coil:5", "coil:6"], {LEVEL_CALL}}}\n'
        '  heartbeat: {at: "holding:3", action: count, every_s: 1}\n'
    )

    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        made.lift.hold(REAR, allowed)
        _ = made.lift.press(GO2, allowed)
        await elapse(3.0)
        stuck = lambda request: request.is_write and request.table is Table.COIL and request.address < 2  # noqa: E731
        made.device.fail_next(DOES_NOTHING, times=100_000, on=stuck)
        made.lift.let_go(HOLD_FRONT)
        made.lift.let_go(REAR)
        await elapse(1.0)
        readings, heard = len(made.readings), len(made.device.received)
        made.lift.let_go(GO2)
        await elapse(5.0)
        assert made.cells(Table.COIL, 6) == [0]
        await elapse(25.0)
        beats = [one for one in made.device.received[heard:] if one.request.is_write and one.request.address == 3]
        assert len(made.readings) - readings > 30
        assert len(beats) > 20

    on_rig(check, text, {"": device})


def test_a_device_that_answers_slowly_and_badly_keeps_no_button_of_another_pressed() -> None:
    text = (
        f'{SIGNALS}commands:\n  hold_door.front: {{at: "box/coil:0", {HOLD}}}\n'
        f'  hold_door.rear: {{at: "box/coil:1", {HOLD}}}\n'
        f'  go_to: {{one_of: ["coil:4", "coil:5", "coil:6"], {LEVEL_CALL}}}\n'
    )
    devices = {"": MemoryDevice(), "box": MemoryDevice()}

    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        made.lift.hold(REAR, allowed)
        _ = made.lift.press(GO2, allowed)
        await elapse(1.0)
        devices["box"].delay_s = 0.3
        devices["box"].fail_next(exception(0x0B), times=100_000)
        made.lift.let_go(HOLD_FRONT)
        made.lift.let_go(REAR)
        await elapse(1.0)
        made.lift.let_go(GO2)
        await elapse(0.2)
        assert made.cells(Table.COIL, 6) == [0]

    on_rig(check, text, devices, BOX)


def test_a_call_over_two_devices_is_let_go_on_one_although_the_other_refuses() -> None:
    text = (
        f'{SIGNALS}commands: {{go_to: {{one_of: ["box/coil:0", "box/coil:1", "coil:6"], action: pulse, width_s: 0.5, '
        f"{EFFECT}}}}}\n"
    )
    devices = {"": MemoryDevice(), "box": MemoryDevice()}

    async def check(made: Rig) -> None:
        _ = made.lift.press(GO2, allowed)
        await elapse(0.2)
        assert made.cells(Table.COIL, 6) == [1]
        devices["box"].fail_next(exception(4), times=100_000)
        await elapse(2.0)
        assert made.cells(Table.COIL, 6) == [0]

    on_rig(check, text, devices, BOX)


def test_function_22_touches_no_bit_of_another_device() -> None:
    text = (
        f'{SIGNALS}commands: {{go_to: {{one_of: ["holding:5.0", "holding:5.1", "box/holding:5.2"], action: pulse, '
        f"width_s: 0.5, shared_word: mask_write, {EFFECT}}}}}\n"
    )
    devices = {"": MemoryDevice(), "box": MemoryDevice()}

    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][5] = 0
        _ = made.lift.press(GO2, allowed)
        await elapse(0.2)
        assert devices["box"].values[Table.HOLDING][5] == 0b100
        assert made.cells(Table.HOLDING, 5) == [0]

    on_rig(check, text, devices, BOX)


def test_a_device_timed_pulse_is_not_pressed_again_by_letting_go_of_it_on_its_way() -> None:
    device = MemoryDevice(timed_coils=True, delay_s=0.05)
    device.values[Table.DISCRETE][1] = 1

    async def check(made: Rig) -> None:
        _ = made.lift.press(CLOSE_FRONT, allowed)
        async with asyncio.timeout(5):
            while not made.device.writes:
                await elapse(0.01)
        made.lift.let_go(CLOSE_FRONT)
        await elapse(3.0)
        assert made.writes() == ["write coil 513 := on for 5 counts, unit 1"]

    on_rig(
        check,
        f'{SIGNALS}commands: {{close_door.front: {{at: "coil:513", action: pulse, width_s: 0.5, timed_by: device, '
        f"payload: {{time: width_s, unit_s: 0.1}}, {EFFECT}}}}}\n",
        {"": device},
    )


def test_a_hold_whose_read_back_was_lost_is_looked_at_again() -> None:
    async def check(made: Rig) -> None:
        made.device.fail_next(silence(), on=lambda request: not request.is_write and request.table is Table.COIL)
        for _ in range(20):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.2)
        assert made.cells(Table.COIL, 0) == [1]
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:0", {HOLD}}}}}\n')


def test_a_hold_that_the_controller_dropped_is_noticed_and_pressed_again() -> None:
    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(1.0)
        made.device.values[Table.COIL][0] = 0
        made.device.fail_next(DOES_NOTHING, times=2, on=lambda request: request.is_write)
        await elapse(1.5)
        assert not made.lift.held(HOLD_FRONT)
        await elapse(5.0)
        assert made.cells(Table.COIL, 0) == [1]
        await elapse(2.0)
        assert made.lift.held(HOLD_FRONT), "it stayed on until the next look"

    on_rig(check, f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:0", {HOLD}}}}}\n')


@pytest.mark.parametrize("reset", ["", "reset_first_s: 0.5, "], ids=["at once", "after a reset"])
@pytest.mark.parametrize("code", [2, 4])
def test_every_press_has_an_outcome_although_the_controller_refuses_all_writes(reset: str, code: int) -> None:
    async def check(made: Rig) -> None:
        made.device.fail_next(exception(code), times=100_000, on=lambda request: request.is_write)
        for _ in range(3):
            press = made.lift.press(GO2, allowed)
            await elapse(15.0)
            assert press.result().result in (Result.REJECTED, Result.UNCONFIRMED)
        assert len([one for one in made.device.received if one.request.is_write]) < 60

    on_rig(
        check,
        f'{SIGNALS}commands: {{go_to: {{at: "holding:30", as: floor, action: pulse, width_s: 0.5, {reset}{EFFECT}}}}}\n',
    )


EXCLUDES = (
    f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:0", excludes: [close_door.front], {HOLD}}}\n'
    f'  close_door.front: {{at: "coil:20", action: pulse, width_s: 0.5, gap_s: 2, excludes: [hold_door.front], {EFFECT}}}\n'
)


def test_a_press_that_is_dropped_before_it_was_written_is_rejected() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.DISCRETE][1] = 1
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.5)
        excluded = made.lift.press(CLOSE_FRONT, allowed)
        await elapse(0.1)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.1)
        shut = made.lift.press(CLOSE_FRONT, allowed)
        made.device.values[Table.DISCRETE][1] = 0
        await elapse(0.3)
        assert [press.result().result for press in (excluded, shut)] == [Result.REJECTED] * 2

    on_rig(check, EXCLUDES)


def test_exclusion_that_is_said_on_one_side_holds_on_both() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.DISCRETE][1] = 1
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.5)
        _ = made.lift.press(CLOSE_FRONT, allowed)
        await elapse(0.3)
        assert made.cells(Table.COIL, 0, 20) == [0, 1]

    on_rig(check, EXCLUDES.replace(" gap_s: 2, excludes: [hold_door.front],", ""))


def test_a_bug_in_a_permit_lets_go_of_everything_before_it_ends_the_lift() -> None:
    def bug() -> str | None:
        raise ZeroDivisionError

    async def check(made: Rig) -> None:
        made.device.values[Table.DISCRETE][1] = 1
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.5)
        press = made.lift.press(CLOSE_FRONT, bug)
        await elapse(3.0)
        assert made.cells(Table.COIL, 0, 20) == [0, 0]
        assert press.done()
        assert made.lift.press(CLOSE_FRONT, allowed).result().reason == "the driver of this lift has failed"

    on_rig(check, EXCLUDES)


def test_a_floor_that_the_map_cannot_call_is_refused_when_the_lift_is_made() -> None:
    async def main() -> None:
        text = f'{SIGNALS}commands: {{go_to: {{at: "holding:30", as: floor, action: pulse, width_s: 0.5, {EFFECT}}}}}\n'
        with pytest.raises(ValueError, match="go_to rests at 0"):
            async with rig(written_map(text), None, {"L1": 0, "L2": 1}):
                raise AssertionError("it was made")

    run_virtual(main)


def test_a_flag_that_was_there_before_proves_no_press() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.DISCRETE][2] = 1
        await elapse(0.3)
        press = made.lift.press(GO2, allowed)
        await elapse(3.0)
        assert press.result().result is Result.UNCONFIRMED

    on_rig(
        check,
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, may_enter: {at: "discrete:2"}}\n'
        'commands: {go_to: {at: "holding:30", as: floor, action: pulse, width_s: 0.5, '
        "confirm: {any_of: [may_enter], within_s: 2}}}\n",
    )


def test_a_press_puts_out_no_lamp_of_somebody_else() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.COIL].update({16: 1})
        made.device.disconnect()
        await elapse(2.0)
        assert made.device.writes == []
        _ = made.lift.press(GO2, allowed)
        await elapse(1.0)
        assert {request.address for request in made.device.writes} == {18}

    on_rig(
        check,
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, '
        'calls_registered: {each_of: ["coil:16", "coil:17", "coil:18"]}}\n'
        'commands: {go_to: {one_of: ["coil:16", "coil:17", "coil:18"], action: pulse, width_s: 0.5, '
        "confirm: {any_of: [calls_registered], within_s: 2}}}\n",
    )


def test_a_sensor_that_comes_back_cuts_no_pulse_of_the_controller_short() -> None:
    text = (
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, level: {at: "box/holding:0.0"}}\n'
        f'commands: {{go_to: {{at: "holding:30", as: floor, action: pulse, width_s: 5, {EFFECT}}}}}\n'
    )
    devices = {"": MemoryDevice(), "box": MemoryDevice()}

    async def check(made: Rig) -> None:
        _ = made.lift.press(GO2, allowed)
        await elapse(0.5)
        devices["box"].disconnect()
        await elapse(3.0)
        assert made.cells(Table.HOLDING, 30) == [2]

    on_rig(check, text, devices, BOX)


def test_an_output_that_cannot_be_read_back_is_named() -> None:
    device = MemoryDevice(served={Table.INPUT: [(0, 9)], Table.DISCRETE: [(0, 9)]})

    async def check(made: Rig) -> None:
        assert "our outputs cannot be read back: hold_door.front at coil:0" in str(made.errors[-1])

    on_rig(check, f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:0", {HOLD}}}}}\n', {"": device})


def test_a_hold_that_the_controller_refuses_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    async def check(made: Rig) -> None:
        made.device.fail_next(exception(4), times=100_000, on=lambda request: request.is_write)
        for _ in range(50):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.2)

    with caplog.at_level("WARNING", logger="drivers.modbus.lift"):
        on_rig(check, f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:0", {HOLD}}}}}\n')
    assert [record.getMessage().partition(":")[2] for record in caplog.records if "coil:0" in record.getMessage()] == [
        " press of hold_door.front at coil:0 failed: plc: write coil 0 := on, unit 1: exception 04 (server device failure)"
    ]
