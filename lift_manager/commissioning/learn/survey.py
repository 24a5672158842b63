"""Finds the addresses that a controller answers for, by reading them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass

from drivers.errors import ILLEGAL_FUNCTION, PATH_UNAVAILABLE, TARGET_SILENT, ConnectFailed
from lift_manager.commissioning.prober import ProbeAnswer, Prober
from register_maps.errors import EXCEPTION_NAMES
from register_maps.words import BIT_TABLES, READ_FUNCTION, Table

RISK = (
    "This only reads; it has no way to write. Even so: a controller may log or count reads of addresses that it does not have, a few"
    " old gateways stop answering after many of them, and some registers are cleared by reading them. It takes the controller's"
    " only slot while it lasts. Do it with the lift technician's consent, with the lift out of use for other people."
)
"""Is shown before the first read."""
TABLES = (Table.DISCRETE, Table.COIL, Table.INPUT, Table.HOLDING)
FIRST, LAST = 0, 255
"""Addresses that are tried one by one if nobody names others. Chosen: four tables take about a minute."""
LIKELY_STARTS = tuple(
    sorted(
        {
            *range(256, 1025, 128),  # also 384, an IL ETH block
            *range(300, 1001, 100),
            *range(1000, 10_001, 1000),
            *(2048, 4096, 1280, 0x3000, 0x4000, 0x6000, 0x8000, 0xB000, 0xFA04),  # PLC families: register_maps/presets
            *(10_000, 10_001, 20_000, 30_000, 30_001, 40_000, 40_001, 50_000),  # Modicon numbers sent as they are
        }
    )
)
"""Addresses beyond those at which controllers often begin a range; each is tried once."""
REACH = 1024
"""A range is followed for so many addresses. Chosen: nine requests for registers, and more than any lift interface has."""
SILENCES = 3
"""So many requests in a row without an answer, and the rest of the table is not tried: each costs a time-out and a connection."""
MOST_REGISTERS, MOST_BITS = 125, 2000
"""By the specification, in one request."""
RECONNECT_AFTER_S = (1.0, 3.0, 10.0)
"""Pauses before new attempts to connect. Chosen: a controller with one slot may keep it for some seconds."""


class SurveyFailed(Exception):
    """The controller does not answer in a way that could be learned from; the sentence says what to do."""


@dataclass(frozen=True, slots=True)
class Span:
    """Adjacent addresses of one table, on the wire, that the controller answers for."""

    table: Table
    first: int
    last: int

    @property
    def count(self) -> int:
        """How many addresses it has."""
        return self.last - self.first + 1

    def __str__(self) -> str:
        return f"{self.table} {self.first}" + (f" to {self.last}" if self.last > self.first else "")


@dataclass(frozen=True, slots=True)
class Survey:
    """What a controller answers for."""

    spans: tuple[Span, ...]
    most_registers: int
    """In one request, as far as it was seen."""
    most_bits: int
    notes: tuple[str, ...]
    """What else was found, in words."""

    def most(self, table: Table) -> int:
        """Return how many addresses of a table one request may read."""
        return self.most_bits if table in BIT_TABLES else self.most_registers


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a survey is."""

    table: Table
    address: int
    share: float
    remaining_s: float
    found: int
    """Addresses found so far."""


OnProgress = Callable[[Progress], None]


async def survey(
    prober: Prober, on_progress: OnProgress, *, first: int = FIRST, last: int = LAST, likely: bool = True
) -> Survey:
    """Read the addresses `first` to `last` of all tables, and the likely starts of others if `likely`.

    Raises SurveyFailed, and ConnectFailed if the controller takes no connection any more.
    """
    return await _Surveyor(prober, on_progress, first, last, likely=likely).run()


class _Surveyor:
    def __init__(self, prober: Prober, on_progress: OnProgress, first: int, last: int, *, likely: bool) -> None:
        self._prober = prober
        self._on_progress = on_progress
        self._first, self._last = first, last
        self._likely = [start for start in LIKELY_STARTS if not first <= start <= last] if likely else []
        self._most = {table: MOST_BITS if table in BIT_TABLES else MOST_REGISTERS for table in TABLES}
        self._spans: list[Span] = []
        self._notes: list[str] = []
        self._is_first_answer = True

    async def run(self) -> Survey:
        per_table = self._last - self._first + 1 + len(self._likely)
        began = asyncio.get_running_loop().time()
        for number, table in enumerate(TABLES):
            async for done, address in self._scan(table):
                share = (number * per_table + done) / (len(TABLES) * per_table)
                took_s = asyncio.get_running_loop().time() - began
                found = sum(span.count for span in self._spans)
                self._on_progress(Progress(table, address, share, took_s / share - took_s, found))
        most = self._most
        registers = min(most[Table.HOLDING], most[Table.INPUT])
        bits = min(most[Table.COIL], most[Table.DISCRETE])
        return Survey(tuple(self._spans), registers, bits, tuple(self._notes))

    async def _scan(self, table: Table) -> AsyncIterator[tuple[int, int]]:
        """Try the addresses of one table; yields how many were tried, and the last one."""
        silences = 0
        for done, address in enumerate(self._starts(table), start=1):
            if not self._is_known(table, address):
                answer = await self._read(table, address, 1)
                if answer.values is not None:
                    await self._follow(table, address)
                elif answer.exception == ILLEGAL_FUNCTION and not self._has(table):
                    self._notes.append(f"no {table} table: it refuses function {READ_FUNCTION[table]:02}")
                    return
                silences = silences + 1 if answer.trouble else 0
                if silences == SILENCES:
                    why = f"no answer to {SILENCES} requests in a row, the last one for {address} ({answer.trouble})"
                    self._notes.append(f"{table}: {why}; the rest of this table was not tried")
                    return
            yield done, address

    def _starts(self, table: Table) -> Iterator[int]:
        yield from range(self._first, self._last + 1)
        goes_on = next((s for s in self._spans if s.table is table and s.last - s.first >= REACH - 1), None)
        if goes_on is not None and self._likely:
            self._notes.append(
                f"{table}: it answers for more than {REACH} addresses in a row; for those from {goes_on.last + 1} use --from and --to"
            )
            return
        yield from self._likely

    async def _follow(self, table: Table, address: int) -> None:
        """Find the range that an address belongs to."""
        lowest = max((s.last + 1 for s in self._spans if s.table is table and s.last < address), default=0)
        is_listed = self._first <= address <= self._last
        first = address if is_listed else await self._edge(table, address, max(lowest, address - REACH), step=-1)
        at_most = min(0xFFFF, address + REACH - 1) if self._likely or not is_listed else self._last
        last = await self._edge(table, address, at_most, step=1)
        before = next((s for s in self._spans if s.table is table and s.last == first - 1), None)
        if before is not None and before.count < REACH:
            self._spans.remove(before)
            first = before.first
        self._spans.append(Span(table, first, last))
        self._spans.sort(key=lambda span: (TABLES.index(span.table), span.first))

    async def _edge(self, table: Table, address: int, limit: int, *, step: int) -> int:
        """Return the last address in one direction that is answered for, up to `limit`."""
        good = address
        while good != limit:
            count = min(self._most[table], abs(limit - good))
            read = await self._longest(table, good, count, step)
            good += step * read
            if read == count:
                continue
            if not read or not (await self._ahead(table, good, 1, step)):
                return good
            self._most[table] = read  # not an edge: the controller answers for no more in one request
            good += step
        return good

    async def _longest(self, table: Table, good: int, count: int, step: int) -> int:
        """Return how many addresses next to `good` can be read in one request, by halving."""
        if await self._ahead(table, good, count, step):
            return count
        low, high = 0, count
        while high - low > 1:
            middle = (low + high) // 2
            if await self._ahead(table, good, middle, step):
                low = middle
            else:
                high = middle
        return low

    async def _ahead(self, table: Table, good: int, count: int, step: int) -> bool:
        start = good + 1 if step > 0 else good - count
        return (await self._read(table, start, count)).values is not None

    async def _read(self, table: Table, address: int, count: int) -> ProbeAnswer:
        answer = await read_again(self._prober, table, address, count)
        if self._is_first_answer and answer.exception in (PATH_UNAVAILABLE, TARGET_SILENT):
            name = EXCEPTION_NAMES.get(answer.exception, "")
            raise SurveyFailed(
                f"unit {self._prober.unit} does not answer: exception {answer.exception:02X} ({name}) comes from a gateway, not from the"
                " lift; give the unit id of the lift with --unit"
            )
        self._is_first_answer = False
        return answer

    def _is_known(self, table: Table, address: int) -> bool:
        return any(span.table is table and span.first <= address <= span.last for span in self._spans)

    def _has(self, table: Table) -> bool:
        return any(span.table is table for span in self._spans)


async def read_again(prober: Prober, table: Table, address: int, count: int) -> ProbeAnswer:
    """Read; wait and connect again where the controller takes no connection at once. Raises ConnectFailed."""
    for pause_s in RECONNECT_AFTER_S:
        try:
            return await prober.read(table, address, count)
        except ConnectFailed:
            await asyncio.sleep(pause_s)
    return await prober.read(table, address, count)
