"""Answers like a recorded controller: a problem of a site becomes a test at the desk.

It has the answers of a recording, and no lift: what is written is answered, but changes nothing.
"""

from __future__ import annotations

import asyncio
from bisect import bisect_left
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress
from itertools import pairwise
from pathlib import Path

from drivers.errors import ILLEGAL_ADDRESS
from drivers.modbus.memory import Reply
from lift_manager.commissioning.trace.exchanges import Exchange, exchanges
from lift_manager.commissioning.trace.recording import Recording, read_recording
from lift_manager.lab.bench.thread import LoopThread
from register_maps import frames
from register_maps.errors import BadRequest, FrameError
from register_maps.frames import Request
from register_maps.words import BIT_TABLES

Report = Callable[[str], None]
"""Receives one line about a request that the recording does not have."""

OPENING_S = 2.0
"""Every request of a poll is sent within so long. Chosen: the slowest usual poll is of one second."""


class NothingRecorded(Exception):
    """A recording has no answers."""


class _Series:
    """The exchanges of one request, in the order of time."""

    def __init__(self, found: list[Exchange]) -> None:
        self._found = found
        self._times = [one.at_s for one in found]

    @property
    def first_s(self) -> float:
        """When it was sent first."""
        return self._times[0]

    def nearest(self, at_s: float) -> Exchange:
        """Return the exchange that began nearest to a time.

        Not the newest one before it: polls of a replay and of the recording differ by fractions of a poll, and none may be left out.
        """
        place = bisect_left(self._times, at_s)
        near = range(max(0, place - 1), min(len(self._times), place + 1))
        return self._found[min(near, key=lambda index: abs(self._times[index] - at_s))]


class Replay:
    """The recorded controller. Time begins with the first request that is in the recording."""

    def __init__(self, recording: Recording, *, loop: bool = False, report: Report | None = None) -> None:
        """At the end the last answers are repeated; with `loop` everything begins again. Raises NothingRecorded for a recording without answers."""
        found = [one for one in exchanges(recording.items) if isinstance(one, Exchange) and one.request is not None]
        if not any(one.answer for one in found):
            raise NothingRecorded("the recording has no answers")
        self._series = {key: _Series(list(same)) for key, same in _by_request(found).items()}
        self._reads = {
            one.parsed: self._series[_key(one)] for one in found if one.parsed is not None and one.values is not None
        }
        self._loops = loop
        self._report = report or (lambda _: None)
        self._reported: set[tuple[int, int, int]] = set()
        self.first_s, self.last_s = found[0].at_s, found[-1].at_s
        self._step_s = min((later.at_s - one.at_s for one, later in pairwise(found)), default=0.0)
        self._began: float | None = None
        """The time of the clock at which the recording began."""
        self._is_aligned = False
        """Whether that is exact."""

    @property
    def lasts_s(self) -> float:
        """From the first request to the last."""
        return self.last_s - self.first_s

    def answer(self, frame: bytes, now: float) -> list[Reply]:
        """Return what the controller answered to this request at this moment of the recording; nothing where it was silent."""
        series = self._series.get(frame[2:])
        if series is not None:
            self._begin(now, series.first_s)
            return _replayed(frame, series.nearest(self._moment(now)))
        try:
            request = frames.parse_request(frame, timed_coils=True)
        except BadRequest as refusal:
            return [(0.0, frames.exception_answer(frame, refusal.code))]
        if request.is_write:
            self._note(request, "not in the recording; echoed, and nothing changes")
            return [(0.0, frames.answer(request, frames.tid_of(frame)))]
        return self._put_together(request, frame, now)

    def _put_together(self, request: Request, frame: bytes, now: float) -> list[Reply]:
        """Answer a read of addresses that the recording has in other reads."""
        moment = self.first_s if self._began is None else self._moment(now)
        cells: dict[int, tuple[float, int]] = {}
        delay_s = 0.0
        for read, series in self._reads.items():
            if (read.unit, read.table) != (request.unit, request.table) or not _overlap(read, request):
                continue
            exchange = series.nearest(moment)
            delay_s = max(delay_s, exchange.took_s or 0.0)
            for address, value in enumerate(exchange.values or (), read.address):
                if address not in cells or cells[address][0] < exchange.at_s:
                    cells[address] = exchange.at_s, value
        wanted = range(request.address, request.address + request.count)
        missing = [address for address in wanted if address not in cells]
        if missing:
            self._note(request, f"{request.table} {missing[0]} is not in the recording; answered with exception 02")
            return [(0.0, frames.exception_answer(frame, ILLEGAL_ADDRESS))]
        self._begin(now, None)
        values = [cells[address][1] for address in wanted]
        is_bits = request.table in BIT_TABLES
        payload = frames.pack_bits(values) if is_bits else b"".join(value.to_bytes(2, "big") for value in values)
        return [(delay_s, frames.answer(request, frames.tid_of(frame), payload))]

    def _begin(self, now: float, recorded_s: float | None) -> None:
        """Let time begin, if it has not; `recorded_s` is when this request was sent first.

        The polls at the beginning give the exact moment. Other requests, such as those of a manager that has just connected, may be
        from the middle of the recording.
        """
        is_opening = recorded_s is not None and recorded_s <= self.first_s + OPENING_S
        if self._began is None or (is_opening and not self._is_aligned):
            self._began = now - (recorded_s if recorded_s is not None and is_opening else self.first_s)
            self._is_aligned = is_opening

    def _moment(self, now: float) -> float:
        moment = self.first_s if self._began is None else now - self._began
        if self._loops and moment > self.last_s:
            return self.first_s + (moment - self.first_s) % (self.lasts_s + self._step_s)
        return moment

    def _note(self, request: Request, what: str) -> None:
        """Report a request, once for each place: a heartbeat comes every second."""
        place = request.unit, request.function, request.address
        if place not in self._reported:
            self._reported.add(place)
            self._report(f"{request}: {what}")


def _by_request(found: list[Exchange]) -> Mapping[bytes, list[Exchange]]:
    same: dict[bytes, list[Exchange]] = {}
    for one in found:
        same.setdefault(_key(one), []).append(one)
    return same


def _key(exchange: Exchange) -> bytes:
    """A request without its transaction id."""
    return b"" if exchange.request is None else exchange.request.frame[2:]


def _replayed(frame: bytes, exchange: Exchange) -> list[Reply]:
    if exchange.request is None or exchange.answer is None:
        return []
    recorded = exchange.answer.frame
    echoes = frames.tid_of(recorded) == frames.tid_of(exchange.request.frame)
    return [(exchange.took_s or 0.0, (frame[:2] if echoes else recorded[:2]) + recorded[2:])]


def _overlap(one: Request, other: Request) -> bool:
    return one.address < other.address + other.count and other.address < one.address + one.count


@asynccontextmanager
async def serve_replay(replay: Replay, *, host: str = "127.0.0.1", port: int = 0) -> AsyncIterator[int]:
    """Serve a replay over Modbus/TCP; yields the port. Raises OSError for a port in use."""
    connections: set[asyncio.Task[None]] = set()

    async def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None  # noqa: S101  a coroutine runs in a task
        connections.add(task)
        try:
            with suppress(ConnectionError, FrameError, asyncio.CancelledError):
                await _converse(replay, reader, writer)
        finally:
            connections.discard(task)
            writer.transport.abort()

    server = await asyncio.start_server(connected, host, port)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for task in tuple(connections):
            task.cancel()
        await asyncio.gather(*connections)


async def _converse(replay: Replay, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Answer one request after the other. Raises FrameError where what comes is not Modbus/TCP."""
    loop, rest = asyncio.get_running_loop(), b""
    while received := await reader.read(4096):
        whole, rest = frames.split(rest + received)
        for frame in whole:
            for delay_s, answer in replay.answer(frame, loop.time()):
                await asyncio.sleep(delay_s)
                writer.write(answer or b"")
                await writer.drain()


@contextmanager
def replayed(recording: Path | str, *, loop: bool = False, report: Report | None = None) -> Iterator[int]:
    """Serve a recording from a thread of its own, for a test: yields the port on 127.0.0.1.

    Raises RecordingUnusable, and NothingRecorded for a recording without answers.
    """
    replay = Replay(read_recording(Path(recording)), loop=loop, report=report)
    with LoopThread() as thread, thread.hosting(serve_replay(replay)) as port:
        yield port
