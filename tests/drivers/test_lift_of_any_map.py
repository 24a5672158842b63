"""Whatever map the checks accept: the driver reads only what is served and writes only what is a command."""

import asyncio
from collections.abc import Iterable

from hypothesis import given

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice, MemoryWire, Reply
from drivers.model import Command, CommandKind
from register_maps import frames
from register_maps.codec import compile_map
from register_maps.schema import RegisterMap
from register_maps.words import Side, Table
from tests.drivers.caller import Caller
from tests.support.any_map import any_map
from tests.support.examples import examples
from tests.support.virtual_time import elapse, run_virtual

FLOORS = {"L1": 1, "L2": 2}


def allowed() -> None:
    return None


def floors_of(source: RegisterMap) -> dict[str, int]:
    """Floors that every call of the map can express: those of its outputs, where it has one for each."""
    codes = source.commands["go_to"].floor_codes
    return {f"L{number}": code for number, code in enumerate(codes, start=1)} if codes else FLOORS


async def use_everything(lift: Caller, floors: Iterable[str]) -> None:
    """Read, press, hold and let go of all there is."""
    await lift.read()
    hold = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
    for floor in floors:
        _ = lift.press(Command(CommandKind.GO_TO, floor), allowed)
        await elapse(1.0)
    lift.hold(hold, allowed)
    await elapse(2.5)
    lift.let_go(hold)
    await elapse(0.5)
    _ = lift.press(Command(CommandKind.CLOSE_DOOR, side=Side.FRONT), allowed)
    await elapse(1.0)
    await lift.read()
    async with asyncio.timeout(5):
        await lift.release_all()


def ours(source: RegisterMap) -> set[tuple[Table, int]]:
    """Every address that a command of the map names, by the map's own words and its base alone."""
    base = source.addressing.base or 0
    texts = [text for command in source.commands.values() for text in command.addresses]
    return {(Table(text.split(":")[0]), int(text.split(":")[1].split(".")[0]) - base) for text in texts}


def served(source: RegisterMap) -> dict[Table, list[tuple[int, int]]]:
    base = source.addressing.base or 0
    return {table: [(first - base, last - base) for first, last in spans] for table, spans in source.served.items()}


@given(any_map())
@examples(12)
def test_it_reads_what_is_served_and_writes_what_is_a_command_and_leaves_nothing_on(source: RegisterMap) -> None:
    device = MemoryDevice(unit=source.link.unit_id, served=served(source), timed_coils=True)
    commands = compile_map(source).commands
    mirrors = {  # of outputs that are read elsewhere than they are written: the device copies them there
        (point.table, point.address): (read.table, read.address)
        for command in commands.values()
        for point, read in zip(command.points, command.read_points, strict=False)
        if read != point
    }

    def answer(frame: bytes) -> list[Reply]:
        replies = device.answer(frame)
        for (table, address), (to, at) in mirrors.items():
            device.values[to][at] = device.values[table].get(address, 0)
        return replies

    async def main() -> None:
        link = Link(lambda: MemoryWire(answer), LinkSettings(), name="plc")
        link_settings = source.link
        lift = Caller(
            ModbusLift(
                compile_map(source),
                link,
                LiftSettings(
                    name="lift",
                    floors=floors_of(source),
                    control=True,
                    unit_id=link_settings.unit_id,
                    max_registers_per_read=link_settings.max_registers_per_read,
                    max_bits_per_read=link_settings.max_bits_per_read,
                ),
            )
        )
        running = [asyncio.ensure_future(work) for work in (link.run(), lift.run())]
        await link.wait_up()
        await use_everything(lift, floors_of(source))
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)

    run_virtual(main)
    assert all(heard.executed for heard in device.received), "the device objected to a request"
    for request in device.writes:
        cells = {(request.table, request.address + offset) for offset in range(request.count)}
        assert cells <= ours(source), f"{request} writes what no command names"
    assert any(request.function in frames.WRITES for request in device.executed)
    for name, command in commands.items():
        if name == "heartbeat" or command.spec.ends_itself:
            continue
        for point, value in command.encode(None).items():
            assert point.within(device.values[point.table].get(point.address, 0)) == value, f"{name} is still on"
