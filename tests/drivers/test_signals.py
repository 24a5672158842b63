"""What a lift says signal by signal: value, raw number, places, age."""

import asyncio

import pytest

from drivers.errors import DriverError
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.memory import Fault, MemoryDevice, exception, late, silence
from drivers.model import SignalValue
from register_maps.codec import compile_map
from register_maps.frames import Request
from register_maps.words import Table
from tests.drivers.linked import linked, now, outcome, virtual
from tests.drivers.rig import Rig, on_rig
from tests.support.virtual_time import elapse
from tests.support.written_maps import HEAD, written_map

FROM_ONE = HEAD.replace("base: 0", "base: 1").replace("[[0, ", "[[1, ")
EVERY_KIND = """
signals:
  car_floor: {at: "holding:12", as: floor, unknown: [0]}
  destination: {at: "holding:13", as: floor, none: [0]}
  door.front: {at: "holding:14", bits: [4, 5], values: {0: closed, 1: opening, 2: open}}
  door.rear: {open_limit: "discrete:1", closed_limit: "discrete:2"}
  robots_allowed: {at: "discrete:4", active: low}
  motion: {up: "discrete:5", down: "discrete:6"}
  calls_registered: {each_of: ["coil:1", "coil:2", "coil:3"]}
  load: {at: "holding:15", type: int16, unit: kg}
  identity: {at: "holding:16", type: uint32, word_order: high_first}
  watchdog_time: {at: "holding:18", unit_s: 0.1}
"""
FLOORS = {"P": 1, "L1": 2}


def lift_of(link: Link, text: str, head: str = HEAD) -> ModbusLift:
    return ModbusLift(written_map(text, head), link, LiftSettings(name="lift", floors=FLOORS))


def by_name(lift: ModbusLift) -> dict[str, SignalValue]:
    return {signal.name: signal for signal in lift.signals(now())}


def in_holding(request: Request) -> bool:
    return request.table is Table.HOLDING


@virtual
async def test_every_signal_is_told_with_its_value_its_raw_number_and_its_places() -> None:
    device = MemoryDevice()
    device.values[Table.HOLDING] = {11: 2, 12: 9, 13: 0xFF6F, 14: 0xFFFE, 15: 0x0001, 16: 0x0002, 17: 25}
    device.values[Table.DISCRETE] = {0: 1, 5: 1}
    device.values[Table.COIL] = {0: 0, 1: 1, 2: 1}
    async with linked(device) as link:
        lift = lift_of(link, EVERY_KIND, FROM_ONE)
        await lift.read()
        found = {
            name: (signal.value, signal.raw, signal.addresses, signal.wire) for name, signal in by_name(lift).items()
        }
    two_limits = (("discrete:1", "discrete:2"), ("discrete 0", "discrete 1"))
    lamps = (("coil:1", "coil:2", "coil:3"), ("coil 0", "coil 1", "coil 2"))
    assert found == {
        "car_floor": ("L1", 2, ("holding:12",), ("holding 11",)),
        "destination": (None, 9, ("holding:13",), ("holding 12",)),
        "door.front": ("open", 2, ("holding:14",), ("holding 13 bits 4 to 5",)),
        "door.rear": ("open", 0b01, *two_limits),
        "robots_allowed": (True, 0, ("discrete:4",), ("discrete 3",)),
        "motion": ("down", 0b10, ("discrete:5", "discrete:6"), ("discrete 4", "discrete 5")),
        "calls_registered": ("P, L1", 0b110, *lamps),
        "load": (-2, 0xFFFE, ("holding:15",), ("holding 14",)),
        "identity": (0x10002, 0x10002, ("holding:16",), ("holding 15", "holding 16")),
        "watchdog_time": (2.5, 25, ("holding:18",), ("holding 17",)),
    }


@virtual
async def test_a_raw_number_that_no_table_lists_is_kept_without_a_value() -> None:
    device = MemoryDevice()
    device.values[Table.HOLDING][13] = 3 << 4
    async with linked(device) as link:
        lift = lift_of(link, EVERY_KIND, FROM_ONE)
        await lift.read()
        door = by_name(lift)["door.front"]
    assert (door.value, door.raw) == (None, 3)


@virtual
async def test_nothing_is_told_before_the_first_poll_but_names_and_places() -> None:
    async with linked(MemoryDevice()) as link:
        lift = lift_of(link, EVERY_KIND)
        found = lift.signals(now())
    assert {signal.name for signal in found} == lift.capabilities.signals
    assert {(signal.value, signal.raw, signal.age_s) for signal in found} == {(None, None, None)}
    assert all(signal.addresses and signal.wire for signal in found)


@virtual
async def test_each_signal_is_as_old_as_the_request_for_its_block() -> None:
    device = MemoryDevice(delay_s=0.2)
    async with linked(device) as link:
        lift = lift_of(link, EVERY_KIND)
        began = now()
        await lift.read()
        order = [heard.request.table for heard in device.received]
        found = by_name(lift)
        age_s = {table: now() - began - 0.2 * place for place, table in enumerate(order)}
        assert len(age_s) == 3
        assert found["car_floor"].age_s == pytest.approx(age_s[Table.HOLDING])
        assert found["door.rear"].age_s == pytest.approx(age_s[Table.DISCRETE])
        assert found["calls_registered"].age_s == pytest.approx(age_s[Table.COIL])
        later_s = 1.0
        await elapse(later_s)
        assert by_name(lift)["car_floor"].age_s == pytest.approx(age_s[Table.HOLDING] + later_s)


@pytest.mark.parametrize("fault", [silence(), late(5.0), exception(4)], ids=["silent", "late", "exception"])
def test_a_poll_that_fails_makes_nothing_younger_and_changes_nothing(fault: Fault) -> None:
    @virtual
    async def check() -> None:
        device = MemoryDevice()
        device.values[Table.HOLDING][12] = 1
        async with linked(device) as link:
            lift = lift_of(link, EVERY_KIND)
            began = now()
            await lift.read()
            device.values[Table.HOLDING][12] = 2
            device.values[Table.DISCRETE][1] = 1
            device.fail_next(fault, on=in_holding)
            assert isinstance(await outcome(lift.read()), DriverError)
            found = by_name(lift)
            assert {signal.raw for signal in found.values()} == {0, 1}
            assert found["car_floor"].raw == 1
            assert all(signal.age_s == pytest.approx(now() - began) for signal in found.values())

    check()


def test_the_points_of_further_devices_are_told_with_their_name() -> None:
    devices = {"": MemoryDevice(), "sensor": MemoryDevice(delay_s=0.05)}
    devices["sensor"].values[Table.DISCRETE][1] = 1
    head = HEAD + "endpoints: {sensor: {unit_id: 1, served: {discrete: [[0, 9]]}}}\n"
    text = 'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, door.front: {at: "sensor/discrete:1"}}\n'

    async def check(made: Rig) -> None:
        door = next(signal for signal in made.lift.signals(now()) if signal.name == "door.front")
        assert (door.value, door.raw, door.addresses) == ("open", 1, ("sensor/discrete:1",))
        assert door.wire == ("sensor/discrete 1",)
        assert door.age_s is not None
        assert 0.0 < door.age_s < 0.4
        devices["sensor"].connect_problem = None
        devices["sensor"].fall_silent(60.0)
        await elapse(10.0)
        age_s = {signal.name: signal.age_s for signal in made.lift.signals(now())}
        assert min(age for age in age_s.values() if age is not None) > 9.0

    on_rig(check, text, devices, head)


@virtual
async def test_what_an_alive_counter_that_stands_still_comes_with_is_told_all_the_same() -> None:
    device = MemoryDevice()
    device.values[Table.INPUT][1] = 1
    text = 'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, alive: {at: "input:2", type: counter, must_change_within_s: 1}}\n'
    async with linked(device) as link:
        lift = lift_of(link, text)
        assert isinstance(await outcome(lift.read()), DriverError)
        found = by_name(lift)
    assert (found["alive"].raw, found["car_floor"].value) == (0, "P")
    assert found["alive"].age_s == pytest.approx(0.0)


@virtual
async def test_an_offset_moves_the_places_on_the_wire_and_not_those_of_the_map() -> None:
    device = MemoryDevice()
    device.values[Table.HOLDING][111] = 2
    source = written_map(EVERY_KIND, FROM_ONE).map
    codec = compile_map(source, offset={Table.HOLDING: 100})
    async with linked(device) as link:
        lift = ModbusLift(codec, link, LiftSettings(name="lift", floors=FLOORS))
        await lift.read()
        floor = by_name(lift)["car_floor"]
    assert (floor.value, floor.addresses, floor.wire) == ("L1", ("holding:12",), ("holding 111",))


@virtual
async def test_asking_reads_nothing_and_decides_nothing() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        lift = lift_of(link, EVERY_KIND)
        reading = await lift.read()
        asked = len(device.received)
        for _ in range(3):
            lift.signals(now())
            await asyncio.sleep(0)
        assert len(device.received) == asked
        assert (await lift.read()).values is reading.values
