"""One lift with every way of writing that the map language has, on a controller in memory."""

import asyncio
import itertools
import logging

import pytest

from drivers.errors import PointsRefused
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice, exception
from drivers.model import Command, CommandKind, Proof, Result
from register_maps.words import Door, Mode, Side, Table
from tests.drivers.caller import Caller
from tests.drivers.rig import CLOSE_FRONT, HOLD, HOLD_FRONT, SIGNALS, Rig, allowed, ended, on_rig
from tests.support.virtual_time import elapse, run_virtual
from tests.support.written_maps import HEAD, written_map

ACCEPTED = f'{SIGNALS}commands: {{hold_door.front: {{at: "holding:9.2", shared_word: accepted, {HOLD}}}}}\n'
MASKED = ACCEPTED.replace("accepted", "mask_write")
OWNED = ACCEPTED.replace("accepted", "owned")


@pytest.mark.parametrize(("text", "functions"), [(ACCEPTED, [3, 6]), (MASKED, [22])], ids=["fresh read", "mask write"])
def test_a_bit_is_written_without_disturbing_its_neighbours(text: str, functions: list[int]) -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][9] = 0xA001
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.05)
        # somebody else changes a bit of theirs between our press and our release
        made.device.values[Table.HOLDING][9] |= 0x0010
        assert made.lift.held(HOLD_FRONT)
        await made.lift.release_all()
        assert made.cells(Table.HOLDING, 9) == [0xA011]
        written = [request for request in made.device.executed if request.table is Table.HOLDING]
        assert [request.function for request in written][-len(functions) - 1 :] == [*functions, 3]

    on_rig(check, text)


def test_a_word_of_our_own_is_written_whole_and_its_spare_bits_rest() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][9] = 0xA001
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.05)
        assert made.cells(Table.HOLDING, 9) == [0b100]

    on_rig(check, OWNED)


def test_two_lifts_that_share_a_word_do_not_undo_each_other() -> None:
    device = MemoryDevice(delay_s=0.05)

    async def main() -> None:
        link = Link(device.wire, LinkSettings(), name="plc")
        device.values[Table.INPUT][1] = 1
        settings = LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, control=True)
        codecs = [written_map(ACCEPTED.replace("9.2", f"9.{bit}")) for bit in (2, 5)]
        lifts = [Caller(ModbusLift(codec, link, settings)) for codec in codecs]
        running = [asyncio.ensure_future(work) for work in (link.run(), *(lift.run() for lift in lifts))]
        await link.wait_up()
        for lift in lifts:
            await lift.read()
        for lift in lifts:
            lift.hold(HOLD_FRONT, allowed)
        await elapse(1.0)
        assert device.values[Table.HOLDING][9] == 0b100100
        await ended(running)

    run_virtual(main)


def test_an_output_is_verified_where_it_is_read_back() -> None:
    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(1.0)
        assert made.cells(Table.COIL, 0) == [1]
        assert not made.lift.held(HOLD_FRONT)
        made.device.values[Table.COIL][512] = 1
        await elapse(0.5)
        assert made.lift.held(HOLD_FRONT)
        made.lift.let_go(HOLD_FRONT)
        await elapse(0.5)
        assert made.cells(Table.COIL, 0) == [0]
        assert made.lift.given(HOLD_FRONT) is False
        await elapse(0.5)
        before = len(made.device.writes)
        made.device.values[Table.COIL][512] = 0
        await elapse(1.0)
        assert len(made.device.writes) <= before + 1

    on_rig(check, f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:0", read_at: "coil:512", {HOLD}}}}}\n')


def test_a_pulse_of_the_hardware_is_one_write_with_its_duration() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.DISCRETE][1] = 1
        await elapse(0.2)
        before = len(made.device.writes)
        outcome = made.lift.press(CLOSE_FRONT, allowed)
        await elapse(0.3)
        made.device.values[Table.DISCRETE][1] = 0
        await elapse(2.0)
        assert made.writes()[before:] == ["write coil 513 := on for 5 counts, unit 1"]
        assert outcome.result().result is Result.CONFIRMED
        assert outcome.result().frames == ("010502010005",)

    on_rig(
        check,
        f'{SIGNALS}commands: {{close_door.front: {{at: "coil:513", action: pulse, width_s: 0.5, timed_by: device, '
        "payload: {time: width_s, unit_s: 0.1}, confirm: {any_of: [effect], within_s: 5}}}\n",
    )


def test_a_hold_that_is_a_time_is_written_as_that_time() -> None:
    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.5)
        assert made.cells(Table.HOLDING, 50) == [5]
        await made.lift.release_all()
        assert made.cells(Table.HOLDING, 50) == [0]

    on_rig(
        check,
        f'{SIGNALS}commands: {{hold_door.front: {{at: "holding:50", action: hold, max_hold_s: 5, refresh_s: 2, '
        "on_link_loss: timed_by_device, payload: {time: max_hold_s, unit_s: 1}, confirm: {any_of: [readback], within_s: 2}}}\n",
    )


def test_the_heartbeat_goes_on_while_nobody_wants_anything() -> None:
    async def check(made: Rig) -> None:
        await elapse(0.25)
        before = len(made.device.writes)
        await elapse(2.0)
        beats = made.device.writes[before:]
        assert len(beats) == 4
        assert [b.values[0] - a.values[0] for a, b in itertools.pairwise(beats)] == [1, 1, 1]

    on_rig(check, f'{SIGNALS}commands: {{heartbeat: {{at: "holding:41", action: count, every_s: 0.5}}}}\n')


def test_the_lamp_at_the_button_confirms_the_call_and_stands_in_nobodys_way() -> None:
    text = (
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, '
        'calls_registered: {each_of: ["coil:16", "coil:17", "coil:18"]}}\n'
        'commands: {go_to: {one_of: ["coil:16", "coil:17", "coil:18"], action: pulse, width_s: 0.5, '
        "confirm: {any_of: [calls_registered], within_s: 2}}}\n"
    )

    async def check(made: Rig) -> None:
        first = made.lift.press(Command(CommandKind.GO_TO, "L1"), allowed)
        await elapse(0.7)
        made.device.values[Table.COIL].update({17: 1})
        await elapse(0.3)
        assert (first.result().result, first.result().proof) == (Result.CONFIRMED, Proof.LAMP)
        second = made.lift.press(Command(CommandKind.GO_TO, "L2"), allowed)
        await elapse(0.7)
        made.device.values[Table.COIL].update({17: 1, 18: 1})
        await elapse(0.3)
        assert second.result().result is Result.CONFIRMED
        assert made.readings[-1].values.calls == {"L1", "L2"}
        async with asyncio.timeout(1.0):
            await made.lift.release_all()

    on_rig(check, text)


ENDPOINT_HEAD = HEAD + "endpoints: {sensor: {unit_id: 1, served: {discrete: [[0, 9]]}}}\n"
WITH_SENSOR = (
    'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, '
    'door.front: {open_limit: "sensor/discrete:0", closed_limit: "sensor/discrete:1"}}\n'
    f'commands: {{hold_door.front: {{at: "coil:2", {HOLD}}}}}\n'
)


def test_a_door_sensor_on_a_second_device_is_a_part_of_the_same_reading() -> None:
    devices = {"": MemoryDevice(), "sensor": MemoryDevice()}

    async def check(made: Rig) -> None:
        devices["sensor"].values[Table.DISCRETE].update({0: 1, 1: 0})
        await elapse(0.2)
        values = made.readings[-1].values
        assert (values.floor, values.doors) == ("L1", {Side.FRONT: Door.OPEN})
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.3)
        assert made.writes()[-1] == "write coil 2 := on, unit 1"
        assert made.writes("sensor") == []

    on_rig(check, WITH_SENSOR, devices, ENDPOINT_HEAD)


def test_there_is_no_reading_while_either_device_is_away_and_a_new_epoch_afterwards() -> None:
    devices = {"": MemoryDevice(), "sensor": MemoryDevice()}

    async def check(made: Rig) -> None:
        before, epoch = len(made.readings), made.readings[-1].epoch
        made.errors.clear()
        devices["sensor"].disconnect()
        await elapse(0.15)
        assert made.errors
        assert len(made.readings) <= before + 1
        await elapse(2.0)
        assert made.readings[-1].epoch > epoch

    on_rig(check, WITH_SENSOR, devices, ENDPOINT_HEAD)


def test_a_controller_that_serves_less_than_its_map_says_is_reported_as_that() -> None:
    device = MemoryDevice(served={Table.INPUT: [(0, 9)], Table.DISCRETE: [(0, 9)], Table.HOLDING: [(0, 9)]})
    text = (
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, load: {at: "holding:8"}, '
        'fault_code: {at: "holding:12"}}\n'
    )

    async def check(made: Rig) -> None:
        assert made.readings == []
        error = made.errors[-1]
        assert isinstance(error, PointsRefused)
        assert "serves less than map written says: it refuses fault_code (holding:12)" in str(error)
        assert "exception 02 (illegal data address)" in str(error)
        assert "compare table and address with the manual, and how it counts with `addressing` of the map" in str(error)
        asked = sum(1 for heard in device.received if heard.request.count == 1 and heard.request.table is Table.HOLDING)
        assert asked == 2, "each address is asked for once, however often the poll is refused"

    on_rig(check, text, {"": device})


def test_a_controller_that_does_not_have_a_table_is_reported_with_what_is_read_there() -> None:
    device = MemoryDevice()
    device.fail_next(exception(1), times=10_000, on=lambda request: request.table is Table.INPUT)
    text = 'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, load: {at: "holding:8"}}\n'

    async def check(made: Rig) -> None:
        assert "the controller does not answer for this table, which holds car_floor at input:1; compare table" in str(
            made.errors[-1]
        )

    on_rig(check, text, {"": device})


def test_a_controller_that_refuses_only_the_length_of_a_read_is_told_apart() -> None:
    device = MemoryDevice()
    text = (
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, load: {at: "holding:8"}, '
        'fault_code: {at: "holding:12"}}\n'
    )
    device.fail_next(exception(2), times=10_000, on=lambda request: request.count > 1)

    async def check(made: Rig) -> None:
        assert "but not 5 registers from 8 in one request; lower max_registers_per_read" in str(made.errors[-1])

    on_rig(check, text, {"": device})


def test_any_other_exception_names_the_signals_it_is_about() -> None:
    device = MemoryDevice()
    device.fail_next(exception(4), times=10_000)

    async def check(made: Rig) -> None:
        assert "this block holds car_floor at input:1" in str(made.errors[-1]) or "door.front at discrete:1" in str(
            made.errors[-1]
        )

    on_rig(check, SIGNALS, {"": device})


def test_a_refused_command_is_named_with_its_printed_address() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.DISCRETE][1] = 1
        await elapse(0.2)
        made.device.fail_next(exception(3), on=lambda request: request.is_write)
        outcome = made.lift.press(CLOSE_FRONT, allowed)
        await elapse(0.3)
        assert outcome.result().result is Result.REJECTED
        assert outcome.result().reason.startswith("close_door.front at coil:20: plc: write coil 20 := on")

    on_rig(
        check,
        f'{SIGNALS}commands: {{close_door.front: {{at: "coil:20", action: pulse, width_s: 0.5, '
        "confirm: {any_of: [effect], within_s: 5}}}\n",
    )


def test_a_value_outside_its_table_is_reported_once_however_often_it_comes(caplog: pytest.LogCaptureFixture) -> None:
    text = 'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, motion: {at: "input:2", values: {0: stopped}}}\n'

    async def check(made: Rig) -> None:
        for value in (7, 0, 7, 8, 0, 8):
            made.device.values[Table.INPUT][2] = value
            await elapse(0.2)
        made.device.values[Table.INPUT][2] = 7
        await elapse(0.2)
        assert made.readings[-1].values.unknown == {"motion": 7}

    with caplog.at_level(logging.WARNING, logger="drivers.modbus.diagnosis"):
        on_rig(check, text)
    assert [record.getMessage() for record in caplog.records] == [
        f"lift: motion (input:2) reads {value}, which the map and the site do not list; it counts as unknown"
        for value in (7, 8)
    ]


def test_a_safety_flag_that_cannot_be_read_keeps_robots_out() -> None:
    text = (
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, emergency_power: {at: "input:5"}, '
        'overload: {at: "input:6"}}\n'
    )

    async def check(made: Rig) -> None:
        for value, mode in ((0, Mode.NORMAL), (1, Mode.EMERGENCY), (2, Mode.UNKNOWN)):
            made.device.values[Table.INPUT].update({5: value, 6: value})
            await elapse(0.2)
            assert made.readings[-1].values.mode is mode
        assert made.readings[-1].values.unknown == {"emergency_power": 2, "overload": 2}
        assert "overload" not in made.readings[-1].values.flags

    on_rig(check, text)


def test_a_close_button_is_let_go_of_as_soon_as_the_door_is_shut() -> None:
    text = (
        'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, '
        'door.front: {open_limit: "discrete:1", closed_limit: "discrete:2"}, obstruction.front: {at: "discrete:3"}}\n'
        'commands: {close_door.front: {at: "coil:3", action: hold, until: closed, max_hold_s: 10, on_link_loss: latches, '
        "confirm: {any_of: [effect], within_s: 10}}}\n"
    )

    async def check(made: Rig) -> None:
        bits = made.device.values[Table.DISCRETE]
        for ends_it in ({1: 0, 2: 1, 3: 0}, {1: 0, 2: 0, 3: 1}):
            bits.update({1: 1, 2: 0, 3: 0})
            await elapse(0.3)
            _ = made.lift.press(CLOSE_FRONT, allowed)
            await elapse(0.3)
            assert made.cells(Table.COIL, 3) == [1]
            bits.update(ends_it)
            await elapse(0.3)
            assert made.cells(Table.COIL, 3) == [0]

    on_rig(check, text)
