"""Makes the reads that a manager would not make, and says what each may do to a controller."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial

from drivers.errors import ConnectFailed
from drivers.modbus.wire import Wire
from lift_manager.commissioning.doctor.evidence import PAUSE_S, Probe, Purpose, SlotEvidence
from lift_manager.commissioning.doctor.reader import Reader, Report
from lift_manager.commissioning.doctor.subjects import SIBLING, ExaminedController, UnitBlock, UnitSpan
from lift_manager.commissioning.prober import Identity, Prober
from register_maps.frames import MAX_READ_BITS, MAX_READ_REGISTERS
from register_maps.words import BIT_TABLES, Table

MOST_OTHER_CONNECTIONS = 3
UNITS = (0, 1, 2, 3, 10, 247, 255)
"""Unit ids that are tried. 247 is the last one of a serial line; 255 and 0 mean the device itself (guide, 4.4.1.2)."""
PORTS = (502, 503, 802, 1502, 5020, 10502)
"""Ports that controllers, gateways and simulators use."""
EDGE_STEPS = (1, 2, 4, 8, 16, 32, 64)
"""How far beyond a served range is looked."""

RISKS: Mapping[Probe, str] = {
    Probe.OFFSET: "reads one address before and behind every block of the map; an address outside is answered with an exception",
    Probe.TABLE: "reads the same addresses in the other table; a controller may log each exception as a fault",
    Probe.UNIT: f"reads from the unit ids {', '.join(map(str, UNITS))}; behind a gateway these are other devices, and a silent one "
    "blocks it for 2 s",
    Probe.RANGE: "reads single addresses around what the map says is served; a controller may log each exception as a fault",
    Probe.BLOCK: "reads longer and longer blocks; a weak controller may stop answering until it is switched off and on",
    Probe.IDENTITY: "asks for vendor, product code and revision with function 43, which only reads; a controller that does not know it may"
    " log a fault or end the connection",
    Probe.SLOT: f"opens up to {MOST_OTHER_CONNECTIONS} more connections; a controller may drop another client for them, such as the "
    "building management",
    Probe.PORT: f"connects to the ports {', '.join(map(str, PORTS))} of the host; a firewall may report it",
}
"""What each of them may do to a controller or to others, for a person to read before."""

MakeWire = Callable[[ExaminedController], Wire]


async def probe_addresses(reader: Reader, served: Collection[UnitSpan], chosen: Collection[Probe]) -> None:
    """Make the chosen probes that read addresses; `served` is what the maps say that there is."""
    if Probe.UNIT in chosen:
        await _probe_units(reader)
    if reader.is_hopeless:
        return
    for probe, read in (
        (Probe.OFFSET, partial(_probe_offsets, reader)),
        (Probe.TABLE, partial(_probe_tables, reader)),
        (Probe.RANGE, partial(_probe_ranges, reader, served)),
        (Probe.BLOCK, partial(_probe_blocks, reader, served)),
    ):
        if probe in chosen:
            reader.report(f"probing {probe}")
            await read()


async def _probe_units(reader: Reader) -> None:
    _, block = reader.polls[0]
    for unit in sorted({reader.prober.unit, *UNITS}):
        reader.report(f"probing unit {unit}")
        await reader.read_block(Purpose.UNIT, (unit, block))


async def _probe_offsets(reader: Reader) -> None:
    for unit, block in reader.polls:
        for address in (block.start - 1, block.start + block.count):
            if 0 <= address <= 0xFFFF:
                await reader.read(Purpose.OFFSET, unit, block.table, address)
    await _again(reader, Purpose.OFFSET, reader.polls)


async def _probe_tables(reader: Reader) -> None:
    others = [(unit, replace(block, table=SIBLING[block.table])) for unit, block in reader.polls]
    await _again(reader, Purpose.TABLE, others)


async def _again(reader: Reader, purpose: Purpose, blocks: Iterable[UnitBlock]) -> None:
    """Read blocks several times, so that what changes shows, or once where they are refused."""
    remaining = list(blocks)
    for turn in range(4):
        for what in tuple(remaining):
            answer = await reader.read_block(purpose, what, turn)
            if answer.values is None:
                remaining.remove(what)
        await asyncio.sleep(PAUSE_S if remaining else 0.0)


async def _probe_ranges(reader: Reader, served: Iterable[UnitSpan]) -> None:
    """Look around what the map says is served, and at the first address of every table."""
    for table in Table:
        await reader.read(Purpose.RANGE, reader.prober.unit, table, 0)
    for unit, span, table in served:
        for address in (span.start, span.stop - 1):
            await reader.read(Purpose.RANGE, unit, table, address)
        await _find_edge(reader, unit, table, span.start, -1)
        await _find_edge(reader, unit, table, span.stop - 1, 1)


async def _find_edge(reader: Reader, unit: int, table: Table, edge: int, direction: int) -> None:
    """Look beyond one end of a served range: in growing steps up to a refusal, and then in halves back to the last address."""
    good, bad = 0, None
    for step in EDGE_STEPS:
        if not 0 <= edge + direction * step <= 0xFFFF:
            return
        answer = await reader.read(Purpose.RANGE, unit, table, edge + direction * step)
        if answer.values is None:
            bad = step
            break
        good = step
    while bad is not None and bad - good > 1:
        step = (good + bad) // 2
        answer = await reader.read(Purpose.RANGE, unit, table, edge + direction * step)
        good, bad = (step, bad) if answer.values is not None else (good, step)


async def _probe_blocks(reader: Reader, served: Iterable[UnitSpan]) -> None:
    """Find the longest block that is answered, from the start of each served range: doubling, then halving the step."""
    for unit, span, table in served:
        most = MAX_READ_BITS if table in BIT_TABLES else MAX_READ_REGISTERS
        most = min(most, len(span))
        good, bad = 0, most + 1
        while bad - good > 1:
            count = min(most, max(1, 2 * good)) if bad > most else (good + bad) // 2
            answer = await reader.read(Purpose.BLOCK, unit, table, span.start, count)
            if answer.values is None:
                bad = count
                if answer.trouble:
                    break
            else:
                good = count


async def identify(reader: Reader) -> dict[int, Identity]:
    """Ask every unit that answers what it is."""
    found = {}
    for unit in dict.fromkeys(unit for unit, _ in reader.polls):
        if reader.is_silent(unit):
            continue
        reader.report(f"asking unit {unit} what it is")
        try:
            found[unit] = await reader.prober.identify(unit=unit)
        except ConnectFailed as error:
            found[unit] = Identity(trouble=f"no new connection: {error}")
    return found


async def count_slots(reader: Reader, make_wire: MakeWire) -> SlotEvidence:
    """Open further connections while the first one is open, and look whether it survives them."""
    unit, block = reader.polls[0]
    await reader.read_block(Purpose.PAUSE, (unit, block))
    before, others, tried = reader.prober.connects, [], 0
    try:
        for tried in range(1, MOST_OTHER_CONNECTIONS + 1):
            reader.report(f"opening connection {tried + 1}")
            other = Prober(make_wire(reader.controller), unit=unit)
            others.append(other)
            try:
                answer = await other.read(block.table, block.start, block.count)
            except ConnectFailed:
                others.pop()
                break
            if answer.trouble:
                others.pop().close()
                break
        first = await reader.read_block(Purpose.PAUSE, (unit, block))
        return SlotEvidence(len(others), tried, first.is_answer and reader.prober.connects == before)
    finally:
        for other in others:
            other.close()


async def open_ports(controller: ExaminedController, make_wire: MakeWire, report: Report) -> tuple[int, ...]:
    """Connect to the usual ports and close again at once; nothing is sent."""
    found = []
    for port in PORTS:
        report(f"trying port {port}")
        other = Prober(make_wire(ExaminedController(controller.name, controller.host, port, controller.link)))
        try:
            await other.connect()
        except ConnectFailed:
            continue
        other.close()
        found.append(port)
    return tuple(found)
