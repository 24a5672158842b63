"""Collects what a controller answers, one paced read at a time; judges nothing.

A normal run makes one connection and reads only the points of the maps, as a manager would. Everything else is a probe that a person
has chosen, because some controllers take a strange request badly.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.errors import ConnectFailed
from drivers.modbus.wire import PymodbusWire, Wire
from lift_manager.commissioning.doctor.evidence import PAUSE_S, ControllerEvidence, Evidence, Probe, Purpose
from lift_manager.commissioning.doctor.probes import MakeWire, count_slots, identify, open_ports, probe_addresses
from lift_manager.commissioning.doctor.reader import Reader, Report
from lift_manager.commissioning.doctor.subjects import ExaminedController, Subjects, UnitBlock
from lift_manager.commissioning.prober import open_prober
from lift_manager.config.devices import POLL_S
from register_maps.codec import Block
from register_maps.words import Table

SECONDS = 8.0
"""How long doctor reads at least. Chosen: longer than a door moves."""
OUTPUTS_EVERY_S = 0.4
"""How often the outputs are read. Chosen: often enough to see a press of half a second."""
BEATS = 2.0
"""For how many of its longest pauses an alive counter is read at least."""


def plain_wire(controller: ExaminedController) -> Wire:
    """Make a wire without TLS."""
    return PymodbusWire(controller.host, controller.port)


def usual_seconds(subjects: Subjects) -> float:
    """Return how long to read so that every alive counter has to change."""
    return max([SECONDS, *(BEATS * beat_s for name in subjects.controllers for beat_s in subjects.beats_on(name))])


async def collect(
    subjects: Subjects,
    *,
    seconds: float | None = None,
    probes: Collection[Probe] = (),
    make_wire: MakeWire = plain_wire,
    report: Report = lambda _: None,
    temporary: Path | None = None,
) -> Evidence:
    """Read from every controller at the same time, by default for as long as `usual_seconds`.

    `report` receives a line about each step. Raises ControllerTaken while another process of this computer has one of the controllers,
    and LockUnusable.
    """
    began = asyncio.get_running_loop().time()
    manner = _Manner(
        usual_seconds(subjects) if seconds is None else seconds, frozenset(probes), make_wire, report, began, temporary
    )
    running = [
        asyncio.ensure_future(_examine(subjects, controller, manner)) for controller in subjects.controllers.values()
    ]
    try:
        found = await asyncio.gather(*running)
    finally:
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
    return Evidence(dict(zip(subjects.controllers, found, strict=True)), manner.seconds, manner.probes)


@dataclass(frozen=True, slots=True)
class _Manner:
    """How controllers are examined."""

    seconds: float
    probes: frozenset[Probe]
    make_wire: MakeWire
    report: Report
    began: float
    temporary: Path | None


async def _examine(subjects: Subjects, controller: ExaminedController, how: _Manner) -> ControllerEvidence:
    """Poll one controller for the chosen time, and then make the chosen probes."""

    def report(text: str) -> None:
        how.report(f"{controller.name}: {text}")

    found = await _read_from(subjects, controller, how, report)
    if Probe.PORT not in how.probes:
        return found
    return replace(found, open_ports=await open_ports(controller, how.make_wire, report))


async def _read_from(
    subjects: Subjects, controller: ExaminedController, how: _Manner, report: Report
) -> ControllerEvidence:
    """Read everything that one connection shows, and what further ones do to it."""
    unit = subjects.unit_of(controller.name)
    polls = subjects.polls_on(controller.name) or ((unit, Block(Table.HOLDING, 0, 1)),)
    try:
        async with open_prober(
            controller.host,
            controller.port,
            unit=unit,
            make_wire=lambda _host, _port: how.make_wire(controller),
            temporary=how.temporary,
        ) as prober:
            reader = Reader(prober, controller, polls, how.began, report)
            await _poll(reader, subjects, how.seconds)
            connects = prober.connects
            survives_pause = await _pause(reader)
            await probe_addresses(reader, subjects.served_on(controller.name), how.probes)
            identities = await identify(reader) if Probe.IDENTITY in how.probes else None
            counts = Probe.SLOT in how.probes and not reader.is_hopeless
            slots = await count_slots(reader, how.make_wire) if counts else None
    except ConnectFailed as error:
        return ControllerEvidence(error.problem, str(error))
    return ControllerEvidence(
        answers=tuple(reader.answers),
        connects=connects,
        survives_pause=survives_pause,
        slots=slots,
        identities=identities,
    )


async def _poll(reader: Reader, subjects: Subjects, seconds: float) -> None:
    """Read as a manager does; what a refused block holds is read address by address, once."""
    name = reader.controller.name
    poll_s = min((lift.poll_s for lift in subjects.lifts_on(name)), default=POLL_S)
    outputs, outputs_at = subjects.outputs_on(name), 0.0
    polls, turn = list(reader.polls), 0
    is_alone = len({unit for unit, _ in polls}) == 1
    ends_at = reader.now + seconds
    while turn == 0 or reader.now < ends_at:
        began = reader.now
        after: list[UnitBlock] = []
        for unit, block in polls:
            if turn and reader.is_silent(unit) and not is_alone:
                continue
            answer = await reader.read_block(Purpose.POLL, (unit, block), turn)
            if reader.is_hopeless:
                return
            is_new = turn == 0 and answer.is_refusal and block.count > 1
            after += await _served_part(reader, subjects, unit, block) if is_new else [(unit, block)]
        polls = after
        if not polls:
            return
        if outputs and reader.now >= outputs_at:
            outputs_at = reader.now + OUTPUTS_EVERY_S
            outputs = await _read_outputs(reader, outputs, turn)
        turn += 1
        reader.report(f"{reader.prober.requests} reads, {max(0.0, ends_at - reader.now):.0f} s left")
        await asyncio.sleep(max(0.0, began + poll_s - reader.now))


async def _read_outputs(reader: Reader, outputs: Iterable[UnitBlock], turn: int) -> tuple[UnitBlock, ...]:
    """Read the outputs, and return those that were not refused."""
    left = []
    for unit, block in outputs:
        if reader.is_silent(unit) or not (await reader.read_block(Purpose.OUTPUTS, (unit, block), turn)).is_refusal:
            left.append((unit, block))
    return tuple(left)


async def _served_part(reader: Reader, subjects: Subjects, unit: int, block: Block) -> list[UnitBlock]:
    """Read each address of a refused block that holds a point, and return what can be read of it."""
    served: list[int] = []
    for where, table, address in sorted(subjects.cells_on(reader.controller.name)):
        if (where, table) == (unit, block.table) and block.start <= address < block.start + block.count:
            answer = await reader.read(Purpose.POINT, unit, table, address)
            if answer.values is not None:
                served.append(address)
    return [(unit, replace(block, start=start, count=count)) for start, count in _runs(served)]


async def _pause(reader: Reader) -> bool | None:
    """Send nothing for a while, and look whether the connection is still good."""
    if not any(answer.is_answer for answer in reader.answers):
        return None
    before = reader.prober.connects
    await asyncio.sleep(PAUSE_S)
    answer = await reader.read_block(Purpose.PAUSE, reader.polls[0])
    return answer.is_answer and reader.prober.connects == before


def _runs(addresses: Iterable[int]) -> list[tuple[int, int]]:
    """Return (first, how many) of addresses that follow one another."""
    found: list[tuple[int, int]] = []
    for address in addresses:
        if found and found[-1][0] + found[-1][1] == address:
            found[-1] = (found[-1][0], found[-1][1] + 1)
        else:
            found.append((address, 1))
    return found
