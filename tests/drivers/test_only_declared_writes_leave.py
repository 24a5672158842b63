"""The guard behind every write: what no command of a loaded map consists of does not leave, whatever bug asks for it."""

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DriverError
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.declared_writes import DeclaredWrites, UndeclaredWrite
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice
from drivers.modbus.units import Unit
from drivers.model import Command, CommandKind
from lift_manager.commissioning.maps_plan import example_floors
from register_maps import frames
from register_maps.codec import Cell, Codec
from register_maps.frames import MASK_WRITE, WRITES, Request
from register_maps.load import shipped
from register_maps.words import Side, Table
from tests.drivers.caller import Caller
from tests.drivers.linked import linked, virtual
from tests.drivers.rig import HOLD, HOLD_FRONT, SIGNALS, allowed
from tests.support.examples import examples
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse, run_virtual
from tests.support.written_maps import written_map

EVERY_WAY = (
    f'{SIGNALS.rstrip().removesuffix("}")}, door.rear: {{at: "discrete:2"}}}}\ncommands:\n'
    '  go_to: {at: "holding:40", as: floor, rest: 0, action: pulse, width_s: 0.5, confirm: {any_of: [readback], within_s: 2}}\n'
    f'  hold_door.front: {{at: "coil:8", {HOLD}}}\n'
    f'  hold_door.rear: {{at: "holding:9.2", shared_word: mask_write, {HOLD}}}\n'
    '  close_door.front: {at: "coil:513", action: pulse, width_s: 0.5, timed_by: device, '
    "payload: {time: width_s, unit_s: 0.1}, confirm: {any_of: [effect], within_s: 5}}\n"
    f'  robot_mode: {{at: "coil:21", {HOLD}}}\n'
    '  heartbeat: {at: "coil:22", action: toggle, every_s: 0.5}\n'
    'write_blocks: [{at: "coil:21", count: 2, function: 15}]\n'
)
PASS = [
    frames.write_register(40, 7),
    frames.write_coil(8, value=True),
    frames.write_coil(8, value=False),
    frames.mask_write(9, 0xFFFB, 0x0004),
    frames.mask_write(9, 0xFFFB, 0x0000),
    frames.pulse_coil(513, 5),
    frames.write_coils(21, [True, False]),
]
REFUSED = {
    "the address beside": frames.write_register(41, 7),
    "the same number in another table": frames.write_coil(40, value=True),
    "another unit": frames.write_register(40, 7, unit=2),
    "another function": frames.write_registers(40, [7]),
    "more than the command": frames.write_registers(40, [7, 0]),
    "a block over what is declared apart": frames.write_coils(8, [True]),
    "a coil of a block by itself": frames.write_coil(21, value=True),
    "a part of a block": frames.write_coils(21, [True]),
    "a block that is too long": frames.write_coils(21, [True, False, False]),
    "the whole word instead of a bit": frames.write_register(9, 4),
    "another bit of the word": frames.mask_write(9, 0xFFFF, 0x0008),
    "a mask that clears a bit of others": frames.mask_write(9, 0xFFF9, 0x0004),
    "a timed coil that is not timed": frames.write_coil(513, value=True),
    "another time": frames.pulse_coil(513, 0x7FFF),
    "a time for a coil that is not timed": frames.pulse_coil(8, 5),
}


def declared(codec: Codec, unit: int = 1) -> DeclaredWrites:
    made = DeclaredWrites()
    made.add(codec.commands.values(), {"": unit})
    return made


@each_row("request_", PASS)
def test_what_a_command_consists_of_passes(request_: Request) -> None:
    assert declared(written_map(EVERY_WAY)).allows(request_)


@each_row("what", REFUSED)
@virtual
async def test_anything_else_is_refused_and_does_not_leave(what: str) -> None:
    device = MemoryDevice(timed_coils=True)
    async with linked(device) as link:
        link.declared = declared(written_map(EVERY_WAY))
        with pytest.raises(UndeclaredWrite, match="no command of the loaded map is written like that") as refused:
            await link.write(REFUSED[what])
        assert refused.value.request == REFUSED[what]
        assert not isinstance(refused.value, DriverError)
        await link.write(PASS[0])
        assert device.writes == [PASS[0]]


@virtual
async def test_a_permit_does_not_help_and_is_not_asked() -> None:
    asked: list[bool] = []

    def permit() -> None:
        asked.append(True)

    async with linked(MemoryDevice()) as link:
        link.declared = declared(written_map(EVERY_WAY))
        with pytest.raises(UndeclaredWrite):
            await link.write(REFUSED["the address beside"], permit)
        assert asked == []


def test_what_is_refused_is_refused_without_a_connection_too() -> None:
    async def main() -> None:
        link = Link(MemoryDevice().wire, LinkSettings(), name="plc")
        link.declared = DeclaredWrites()
        with pytest.raises(UndeclaredWrite):
            await link.write(PASS[0])

    run_virtual(main)


def test_each_lift_on_a_controller_adds_its_own_and_a_watched_one_adds_nothing() -> None:
    device = MemoryDevice()

    async def main() -> None:
        link = Link(device.wire, LinkSettings(), name="plc")
        floors = {"L1": 1, "L2": 2}
        for coil, control in ((8, True), (9, True), (10, False)):
            codec = written_map(f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:{coil}", {HOLD}}}}}\n')
            Caller(ModbusLift(codec, link, LiftSettings(name=f"lift {coil}", floors=floors, control=control)))
        running = asyncio.ensure_future(link.run())
        await link.wait_up()
        for coil in (8, 9):
            await link.write(frames.write_coil(coil, value=True))
        with pytest.raises(UndeclaredWrite):
            await link.write(frames.write_coil(10, value=True))
        assert [request.address for request in device.writes] == [8, 9]
        await link.close()
        await running

    run_virtual(main)


def test_on_a_controller_whose_lifts_are_only_watched_nothing_may_be_written() -> None:
    async def main() -> None:
        link = Link(MemoryDevice().wire, LinkSettings(), name="plc")
        Caller(ModbusLift(written_map(EVERY_WAY), link, LiftSettings(name="lift", floors={"L1": 1, "L2": 2})))
        with pytest.raises(UndeclaredWrite):
            await link.write(PASS[0])

    run_virtual(main)


def test_a_bug_that_asks_for_another_address_ends_the_lift_and_not_one_byte_of_it_leaves() -> None:
    device = MemoryDevice()

    async def main() -> None:
        codec = written_map(f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:8", {HOLD}}}}}\n')
        link = Link(device.wire, LinkSettings(), name="plc")
        lift = Caller(ModbusLift(codec, link, LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, control=True)))
        # as if the driver had another map in mind than the one that was declared
        link.declared = declared(written_map(f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:9", {HOLD}}}}}\n'))
        linking, running = asyncio.ensure_future(link.run()), asyncio.ensure_future(lift.run())
        await link.wait_up()
        await lift.read()
        lift.hold(HOLD_FRONT, allowed)
        await elapse(10.0)
        assert device.writes == []
        with pytest.raises(ExceptionGroup) as ended:
            await running
        assert ended.group_contains(UndeclaredWrite)
        await link.close()
        await linking

    run_virtual(main)


def cells_of_commands(codec: Codec) -> set[Cell]:
    """Every address that a command of the map names, and the whole blocks in which some are written."""
    own = {point.cell for command in codec.commands.values() for point in command.points}
    blocks = [set(block.cells) for block, _, _ in codec.written]
    return own.union(*(block for block in blocks if block & own))


@st.composite
def writes(draw: st.DrawFn, codec: Codec) -> Request:
    """Any write there is, more often than not near the addresses of commands."""
    near = sorted({cell[2] for cell in cells_of_commands(codec)}) or [0]
    address = (
        draw(st.sampled_from(near)) + draw(st.integers(-2, 2)) if draw(st.booleans()) else draw(st.integers(0, 65000))
    )
    address = max(0, address)
    unit = draw(st.sampled_from([codec.map.unit_of(""), 1, 2, 255]))
    words, bits = st.integers(0, 0xFFFF), st.booleans()
    match draw(st.sampled_from(sorted(WRITES))):
        case 5:
            if draw(bits):
                return frames.pulse_coil(address, draw(st.integers(1, 0x7FFF)), unit)
            return frames.write_coil(address, draw(bits), unit)
        case 6:
            return frames.write_register(address, draw(words), unit)
        case 15:
            return frames.write_coils(address, draw(st.lists(bits, min_size=1, max_size=8)), unit)
        case 16:
            return frames.write_registers(address, draw(st.lists(words, min_size=1, max_size=8)), unit)
        case _:
            return frames.mask_write(address, draw(words), draw(words), unit)


def changed_bits(request: Request) -> int:
    return (~request.values[0] | request.values[1]) & 0xFFFF if request.function == MASK_WRITE else 0


@pytest.mark.parametrize("name", shipped())
@given(st.data())
@examples(30)
def test_of_any_writes_only_those_pass_that_touch_nothing_but_commands(name: str, data: st.DataObject) -> None:
    codec = compiled(name)
    unit = codec.map.unit_of("")
    request = data.draw(writes(codec))
    if not declared(codec, unit).allows(request):
        return
    functions = {function for command in codec.commands.values() for function in command.functions}
    touched = {("", request.table, request.address + place) for place in range(request.count)}
    assert request.unit == unit
    assert request.function in functions
    assert touched <= cells_of_commands(codec)
    own = 0
    for command in codec.commands.values():
        for point in command.points:
            own |= point.mask << point.low if point.cell in touched else 0
    assert not changed_bits(request) & ~own


def commands_of(codec: Codec, floors: Mapping[str, int]) -> Iterator[Command]:
    for name, command in codec.commands.items():
        kind, _, side = name.partition(".")
        if command.spec.is_heartbeat:
            continue
        for floor in floors if command.is_call else (None,):
            yield Command(CommandKind(kind), floor, Side(side) if side else None)


def everything(codec: Codec, value: int) -> dict[str, MemoryDevice]:
    """The devices of a map, with every input at one value, so that what commands require is there."""
    devices = {}
    for endpoint in ("", *codec.map.endpoints):
        devices[endpoint] = MemoryDevice(unit=codec.map.unit_of(endpoint), timed_coils=True)
        for table in (Table.DISCRETE, Table.INPUT):
            for served in codec.served.get(f"{endpoint}/{table}" if endpoint else table.value, ()):
                devices[endpoint].values[table].update(dict.fromkeys(served, value))
    return devices


@pytest.mark.parametrize("name", shipped())
@given(st.data())
@examples(3)
def test_no_lift_of_a_shipped_map_ever_asks_for_a_write_that_is_not_declared(name: str, data: st.DataObject) -> None:
    codec = compiled(name)
    floors = example_floors(codec)
    some = tuple(commands_of(codec, floors))
    doings = data.draw(
        st.lists(
            st.tuples(st.sampled_from(["press", "hold", "let go", "wait"]), st.integers(0, max(0, len(some) - 1))),
            max_size=12,
        )
    )
    adopted = data.draw(st.sets(st.sampled_from(some), max_size=3)) if some else set()
    devices = everything(codec, data.draw(st.sampled_from([0, 1])))

    def first(lift: Caller) -> None:
        for command in adopted:
            lift.adopt(command, allowed)

    async def main() -> None:
        lines = {endpoint: device for endpoint, device in devices.items() if endpoint}
        links = {endpoint: Link(device.wire, LinkSettings(), name=endpoint) for endpoint, device in lines.items()}
        link = Link(devices[""].wire, LinkSettings(), name="plc")
        lift = Caller(
            ModbusLift(
                codec,
                link,
                LiftSettings(name="lift", floors=floors, control=True, unit_id=codec.map.unit_of("")),
                {endpoint: Unit(each, codec.map.unit_of(endpoint)) for endpoint, each in links.items()},
            )
        )
        first(lift)
        work = (link.run(), *(each.run() for each in links.values()), lift.run())
        running = [asyncio.ensure_future(part) for part in work]
        await elapse(0.2)
        for doing, place in doings:
            with suppress(DriverError):
                await lift.read()
            if doing == "press":
                _ = lift.press(some[place], allowed)
            elif doing == "hold" and codec.commands[some[place].name].spec.action == "hold":
                lift.hold(some[place], allowed)
            elif doing == "let go":
                lift.let_go(some[place])
            await elapse(0.6)
        assert not any(task.done() for task in running), "no bug was met"
        async with asyncio.timeout(60):
            await lift.release_all()
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)

    run_virtual(main)
