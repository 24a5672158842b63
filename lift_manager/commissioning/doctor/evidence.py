"""Collects what a controller answers, one paced read at a time; judges nothing.

A normal run makes one connection and reads only the points of the maps, as a manager would. Everything else is a probe that a person
has chosen, because some controllers take a strange request badly.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum, unique
from pathlib import Path

from drivers.errors import ACCEPTED, BUSY, PATH_UNAVAILABLE, TARGET_SILENT, ConnectFailed, ConnectProblem
from drivers.modbus.plan import polled_points
from drivers.modbus.wire import PymodbusWire, Wire
from lift_manager.commissioning.doctor.subjects import SIBLING, ExaminedController, Subjects
from lift_manager.commissioning.prober import Identity, ProbeAnswer, Prober, open_prober
from register_maps.codec import Block
from register_maps.frames import MAX_READ_BITS, MAX_READ_REGISTERS
from register_maps.words import BIT_TABLES, Table

SECONDS = 8.0
"""How long doctor reads at least. Chosen: longer than a door moves."""
PAUSE_S = 0.5
OUTPUTS_EVERY_S = 0.4
"""How often the outputs are read. Chosen: often enough to see a press of half a second."""
BEATS = 2.0
"""For how many of its longest pauses an alive counter is read at least."""
HOPELESS = 3
"""Reads in a row without any answer, from the first one on, after which doctor gives up on a controller."""
MOST_OTHER_CONNECTIONS = 3
UNITS = (0, 1, 2, 3, 10, 247, 255)
"""Unit ids that are tried. 247 is the last one of a serial line; 255 and 0 mean the device itself (guide, 4.4.1.2)."""
PORTS = (502, 503, 802, 1502, 5020, 10502)
"""Ports that controllers, gateways and simulators use."""
EDGE_STEPS = (1, 2, 4, 8, 16, 32, 64)
"""How far beyond a served range is looked."""


@unique
class Probe(StrEnum):
    """Reads that a manager would not make."""

    OFFSET = "offset"
    TABLE = "table"
    UNIT = "unit"
    RANGE = "range"
    BLOCK = "block"
    IDENTITY = "identity"
    SLOT = "slot"
    PORT = "port"


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


@unique
class Purpose(StrEnum):
    """What a read was made for."""

    POLL = "poll"
    POINT = "point"
    """One address of a block that was refused."""
    OUTPUTS = "outputs"
    PAUSE = "pause"
    OFFSET = "offset"
    TABLE = "table"
    UNIT = "unit"
    RANGE = "range"
    BLOCK = "block"


NOT_REFUSED = frozenset({ACCEPTED, BUSY, PATH_UNAVAILABLE, TARGET_SILENT})
"""Exceptions that are about the moment or the unit, and not about the addresses."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One read and what became of it."""

    at_s: float
    """When it was sent, from the beginning of the run."""
    purpose: Purpose
    unit: int
    table: Table
    address: int
    count: int
    took_s: float = 0.0
    values: tuple[int, ...] | None = None
    exception: int | None = None
    trouble: str = ""
    echoes_tid: bool = True
    turn: int = 0
    """Which poll it belongs to."""

    @property
    def is_answer(self) -> bool:
        """Whether the controller answered, with values or with an exception."""
        return self.values is not None or self.exception is not None

    @property
    def is_refusal(self) -> bool:
        """Whether the controller refuses these addresses, and not just now."""
        return self.exception is not None and self.exception not in NOT_REFUSED

    @property
    def proves_unit(self) -> bool:
        """Whether a unit of this id exists: an exception proves it, but for those by which a gateway says the opposite."""
        return self.values is not None or self.exception not in (None, PATH_UNAVAILABLE, TARGET_SILENT)


@dataclass(frozen=True, slots=True)
class SlotEvidence:
    """What further connections came to while the first one was in use."""

    further: int
    """How many of them answered."""
    tried: int
    first_survived: bool
    """Whether the first connection still answered afterwards."""


@dataclass(frozen=True, slots=True)
class ControllerEvidence:
    """Everything that one controller answered."""

    problem: ConnectProblem | None = None
    """Why the first connection could not be made."""
    problem_text: str = ""
    answers: tuple[Answer, ...] = ()
    connects: int = 0
    """Connections that were made for the polls; 1 where none was lost."""
    survives_pause: bool | None = None
    """Whether the connection was still there after a pause; None if that was not tried."""
    slots: SlotEvidence | None = None
    open_ports: tuple[int, ...] | None = None
    """Ports that accept a connection; None if that was not tried."""
    identities: Mapping[int, Identity] | None = None
    """What each unit says that it is; None if that was not asked."""

    def of(self, *purposes: Purpose) -> Iterator[Answer]:
        """Yield the answers to reads for these purposes."""
        return (answer for answer in self.answers if answer.purpose in purposes)


@dataclass(frozen=True, slots=True)
class Evidence:
    """Everything that was read in one run."""

    controllers: Mapping[str, ControllerEvidence]
    seconds: float
    probes: frozenset[Probe] = field(default_factory=frozenset)


MakeWire = Callable[[ExaminedController], Wire]
Report = Callable[[str], None]


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
    examiners = {name: _Examiner(subjects, controller, manner) for name, controller in subjects.controllers.items()}
    running = [asyncio.ensure_future(examiner.examine()) for examiner in examiners.values()]
    try:
        found = await asyncio.gather(*running)
    finally:
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
    return Evidence(dict(zip(examiners, found, strict=True)), manner.seconds, manner.probes)


@dataclass(frozen=True, slots=True)
class _Manner:
    """How controllers are examined."""

    seconds: float
    probes: frozenset[Probe]
    make_wire: MakeWire
    report: Report
    began: float
    temporary: Path | None


class _Examiner:
    """Reads from one controller."""

    def __init__(self, subjects: Subjects, controller: ExaminedController, how: _Manner) -> None:
        self._subjects = subjects
        self._controller = controller
        self._seconds = how.seconds
        self._probes = how.probes
        self._make_wire = how.make_wire
        self._report = how.report
        self._began = how.began
        self._temporary = how.temporary
        self._unit = subjects.unit_of(controller.name)
        self._answers: list[Answer] = []
        lifts = subjects.lifts_on(controller.name)
        self._poll_s = min((lift.poll_s for lift in lifts), default=0.2)
        self._polls = list(
            dict.fromkeys(
                (lift.device(block).unit_id, block)
                for lift in lifts
                for block in lift.blocks
                if lift.device(block).controller == controller.name
            )
        ) or [(self._unit, Block(Table.HOLDING, 0, 1))]
        self._outputs = list(
            dict.fromkeys(
                (lift.device(block).unit_id, block)
                for lift in lifts
                for block in lift.output_blocks
                if lift.device(block).controller == controller.name
            )
        )
        self._cells = {
            (lift.device(point).unit_id, point.table, point.address)
            for lift in lifts
            for point in polled_points(lift.codec)
            if lift.device(point).controller == controller.name
        }

    @property
    def _now(self) -> float:
        return asyncio.get_running_loop().time() - self._began

    async def examine(self) -> ControllerEvidence:
        """Poll for the chosen time, and then make the chosen probes."""
        controller = self._controller
        try:
            async with open_prober(
                controller.host,
                controller.port,
                unit=self._unit,
                make_wire=lambda _host, _port: self._make_wire(controller),
                temporary=self._temporary,
            ) as prober:
                await self._poll(prober)
                connects = prober.connects
                survives_pause = await self._pause(prober)
                await self._probe(prober)
                identities = await self._identify(prober) if Probe.IDENTITY in self._probes else None
                slots = (
                    await self._probe_slots(prober) if Probe.SLOT in self._probes and not self._is_hopeless else None
                )
        except ConnectFailed as error:
            ports = await self._open_ports() if Probe.PORT in self._probes else None
            return ControllerEvidence(error.problem, str(error), tuple(self._answers), open_ports=ports)
        ports = await self._open_ports() if Probe.PORT in self._probes else None
        return ControllerEvidence(
            answers=tuple(self._answers),
            connects=connects,
            survives_pause=survives_pause,
            slots=slots,
            open_ports=ports,
            identities=identities,
        )

    async def _read(
        self, prober: Prober, purpose: Purpose, unit: int, table: Table, address: int, count: int, turn: int = 0
    ) -> Answer:
        """Read and record; a connection that cannot be made again is trouble, but for the first one."""
        at_s = self._now
        try:
            got = await prober.read(table, address, count, unit=unit)
        except ConnectFailed as error:
            answer = Answer(
                at_s, purpose, unit, table, address, count, trouble=f"no new connection: {error}", turn=turn
            )
        else:
            answer = _answer(got, at_s, purpose, turn)
        self._answers.append(answer)
        return answer

    @property
    def _is_hopeless(self) -> bool:
        """Whether nothing at all was answered, although every unit was tried."""
        tried = {answer.unit for answer in self._answers}
        is_enough = len(self._answers) >= HOPELESS and tried >= {unit for unit, _ in self._polls}
        return is_enough and not any(answer.is_answer for answer in self._answers)

    def _is_silent(self, unit: int) -> bool:
        """Whether a unit never answered: each further read from it would take as long as many others."""
        return not any(answer.is_answer for answer in self._answers if answer.unit == unit)

    async def _poll(self, prober: Prober) -> None:
        """Read as a manager does; what a refused block holds is read address by address, once."""
        polls, turn, outputs_at = self._polls, 0, 0.0
        ends_at = self._now + self._seconds
        while turn == 0 or self._now < ends_at:
            began = self._now
            after: list[tuple[int, Block]] = []
            for unit, block in polls:
                if turn and self._is_silent(unit) and not self._is_alone(unit):
                    continue
                answer = await self._read(prober, Purpose.POLL, unit, block.table, block.start, block.count, turn)
                if self._is_hopeless:
                    return
                is_new = turn == 0 and answer.is_refusal and block.count > 1
                after += await self._served_part(prober, unit, block) if is_new else [(unit, block)]
            polls = after
            if not polls:
                return
            if self._outputs and self._now >= outputs_at:
                outputs_at = self._now + OUTPUTS_EVERY_S
                await self._read_outputs(prober, turn)
            turn += 1
            left_s = ends_at - self._now
            self._report(f"{self._controller.name}: {prober.requests} reads, {max(0.0, left_s):.0f} s left")
            await asyncio.sleep(max(0.0, began + self._poll_s - self._now))

    def _is_alone(self, unit: int) -> bool:
        return {unit} == {polled for polled, _ in self._polls}

    async def _read_outputs(self, prober: Prober, turn: int) -> None:
        refused = []
        for unit, block in self._outputs:
            if self._is_silent(unit):
                continue
            answer = await self._read(prober, Purpose.OUTPUTS, unit, block.table, block.start, block.count, turn)
            if answer.is_refusal:
                refused.append((unit, block))
        self._outputs = [output for output in self._outputs if output not in refused]

    async def _served_part(self, prober: Prober, unit: int, block: Block) -> list[tuple[int, Block]]:
        """Read each address of a refused block that holds a point, and return what can be read of it."""
        served: list[int] = []
        for address in sorted(
            address
            for where, table, address in self._cells
            if (where, table) == (unit, block.table) and block.start <= address < block.start + block.count
        ):
            answer = await self._read(prober, Purpose.POINT, unit, block.table, address, 1)
            if answer.values is not None:
                served.append(address)
        return [(unit, Block(block.table, start, count, block.endpoint)) for start, count in _runs(served)]

    async def _pause(self, prober: Prober) -> bool | None:
        """Send nothing for a while, and look whether the connection is still good."""
        if not any(answer.is_answer for answer in self._answers):
            return None
        before = prober.connects
        unit, block = self._polls[0]
        await asyncio.sleep(PAUSE_S)
        answer = await self._read(prober, Purpose.PAUSE, unit, block.table, block.start, block.count)
        return answer.is_answer and prober.connects == before

    # -- probes

    async def _probe(self, prober: Prober) -> None:
        """Make the chosen probes that read addresses."""
        if Probe.UNIT in self._probes:
            await self._probe_units(prober)
        if self._is_hopeless:
            return
        for probe, work in (
            (Probe.OFFSET, self._probe_offsets),
            (Probe.TABLE, self._probe_tables),
            (Probe.RANGE, self._probe_ranges),
            (Probe.BLOCK, self._probe_blocks),
        ):
            if probe in self._probes:
                self._report(f"{self._controller.name}: probing {probe}")
                await work(prober)

    async def _identify(self, prober: Prober) -> dict[int, Identity]:
        """Ask every unit that answers what it is."""
        found = {}
        for unit in dict.fromkeys(unit for unit, _ in self._polls):
            if self._is_silent(unit):
                continue
            self._report(f"{self._controller.name}: asking unit {unit} what it is")
            try:
                found[unit] = await prober.identify(unit=unit)
            except ConnectFailed as error:
                found[unit] = Identity(trouble=f"no new connection: {error}")
        return found

    async def _probe_units(self, prober: Prober) -> None:
        _, block = self._polls[0]
        for unit in sorted({self._unit, *UNITS}):
            self._report(f"{self._controller.name}: probing unit {unit}")
            await self._read(prober, Purpose.UNIT, unit, block.table, block.start, block.count)

    async def _probe_offsets(self, prober: Prober) -> None:
        for unit, block in self._polls:
            for address in (block.start - 1, block.start + block.count):
                if 0 <= address <= 0xFFFF:
                    await self._read(prober, Purpose.OFFSET, unit, block.table, address, 1)
        await self._again(prober, Purpose.OFFSET, self._polls)

    async def _probe_tables(self, prober: Prober) -> None:
        others = [
            (unit, Block(SIBLING[block.table], block.start, block.count, block.endpoint)) for unit, block in self._polls
        ]
        await self._again(prober, Purpose.TABLE, others)

    async def _again(self, prober: Prober, purpose: Purpose, blocks: Iterable[tuple[int, Block]]) -> None:
        """Read blocks several times, so that what changes shows, or once where they are refused."""
        remaining = list(blocks)
        for turn in range(4):
            for unit, block in tuple(remaining):
                answer = await self._read(prober, purpose, unit, block.table, block.start, block.count, turn)
                if answer.values is None:
                    remaining.remove((unit, block))
            await asyncio.sleep(PAUSE_S if remaining else 0.0)

    async def _probe_ranges(self, prober: Prober) -> None:
        """Look around what the map says is served, and at the first address of every table."""
        for table in Table:
            await self._read(prober, Purpose.RANGE, self._unit, table, 0, 1)
        for unit, span, table in self._spans():
            for address in (span.start, span.stop - 1):
                await self._read(prober, Purpose.RANGE, unit, table, address, 1)
            await self._find_edge(prober, unit, table, span.start, -1)
            await self._find_edge(prober, unit, table, span.stop - 1, 1)

    async def _find_edge(self, prober: Prober, unit: int, table: Table, edge: int, direction: int) -> None:
        """Look beyond one end of a served range: in growing steps up to a refusal, and then in halves back to the last address."""
        good, bad = 0, None
        for step in EDGE_STEPS:
            if not 0 <= edge + direction * step <= 0xFFFF:
                return
            answer = await self._read(prober, Purpose.RANGE, unit, table, edge + direction * step, 1)
            if answer.values is None:
                bad = step
                break
            good = step
        while bad is not None and bad - good > 1:
            step = (good + bad) // 2
            answer = await self._read(prober, Purpose.RANGE, unit, table, edge + direction * step, 1)
            good, bad = (step, bad) if answer.values is not None else (good, step)

    def _spans(self) -> Iterator[tuple[int, range, Table]]:
        """Yield what the maps say that this controller serves."""
        found: dict[tuple[int, str, range], None] = {}
        for lift in self._subjects.lifts_on(self._controller.name):
            for space, spans in lift.codec.served.items():
                endpoint, _, table = space.rpartition("/")
                device = lift.devices.get(endpoint)
                if device is not None and device.controller == self._controller.name:
                    found |= dict.fromkeys((device.unit_id, table, span) for span in spans)
        for unit, table, span in found:
            yield unit, span, Table(table)

    async def _probe_blocks(self, prober: Prober) -> None:
        """Find the longest block that is answered, from the start of each served range: doubling, then halving the step."""
        for unit, span, table in self._spans():
            most = MAX_READ_BITS if table in BIT_TABLES else MAX_READ_REGISTERS
            most = min(most, len(span))
            good, bad = 0, most + 1
            while bad - good > 1:
                count = min(most, max(1, 2 * good)) if bad > most else (good + bad) // 2
                answer = await self._read(prober, Purpose.BLOCK, unit, table, span.start, count)
                if answer.values is None:
                    bad = count
                    if answer.trouble:
                        break
                else:
                    good = count

    async def _probe_slots(self, prober: Prober) -> SlotEvidence:
        """Open further connections while the first one is open, and look whether it survives them."""
        unit, block = self._polls[0]
        await self._read(prober, Purpose.PAUSE, unit, block.table, block.start, block.count)
        before, others, tried = prober.connects, [], 0
        try:
            for tried in range(1, MOST_OTHER_CONNECTIONS + 1):
                self._report(f"{self._controller.name}: opening connection {tried + 1}")
                other = Prober(self._make_wire(self._controller), unit=unit)
                others.append(other)
                try:
                    answer = await other.read(block.table, block.start, block.count)
                except ConnectFailed:
                    others.pop()
                    break
                if answer.trouble:
                    others.pop().close()
                    break
            first = await self._read(prober, Purpose.PAUSE, unit, block.table, block.start, block.count)
            return SlotEvidence(len(others), tried, first.is_answer and prober.connects == before)
        finally:
            for other in others:
                other.close()

    async def _open_ports(self) -> tuple[int, ...]:
        """Connect to the usual ports and close again at once; nothing is sent."""
        found = []
        for port in PORTS:
            self._report(f"{self._controller.name}: trying port {port}")
            other = Prober(self._make_wire(_at(self._controller, port)))
            try:
                await other.connect()
            except ConnectFailed:
                continue
            other.close()
            found.append(port)
        return tuple(found)


def _at(controller: ExaminedController, port: int) -> ExaminedController:
    return ExaminedController(controller.name, controller.host, port, controller.link)


def _answer(got: ProbeAnswer, at_s: float, purpose: Purpose, turn: int) -> Answer:
    request = got.request
    return Answer(
        at_s,
        purpose,
        request.unit,
        request.table,
        request.address,
        request.count,
        got.took_s,
        got.values,
        got.exception,
        got.trouble,
        got.echoes_tid,
        turn,
    )


def _runs(addresses: Iterable[int]) -> list[tuple[int, int]]:
    """Return (first, how many) of addresses that follow one another."""
    found: list[tuple[int, int]] = []
    for address in addresses:
        if found and found[-1][0] + found[-1][1] == address:
            found[-1] = (found[-1][0], found[-1][1] + 1)
        else:
            found.append((address, 1))
    return found
