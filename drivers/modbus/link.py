"""Keeps one connection to one controller over any wire: connects, and connects again after each loss.

A link repeats nothing but a read that was answered with busy; it reports all other failures. After a second time-out in a
row, or at once if answers and requests are out of step, it makes a new connection.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum, unique

from drivers.errors import ConnectFailed, ConnectProblem, LinkDown
from drivers.flag import Flag
from drivers.modbus.declared_writes import DeclaredWrites, UndeclaredWrite
from drivers.modbus.settings import LinkSettings, LinkStats
from drivers.modbus.transactions import NO_ANSWER, Permit, Receiver, Transactions
from drivers.modbus.wire import OnBytes, Wire
from drivers.rate_limits import SUMMARY_EVERY_S, ChangeRateLimiter
from register_maps.frames import Request

__all__ = ["Link", "LinkSettings", "LinkState", "LinkStats"]

_logger = logging.getLogger(__name__)

OUTAGES = 10
"""Outages of one link per minute with log lines of their own. Chosen: as many as changes of a lift have rows in the journal."""


@unique
class LinkState(StrEnum):
    """The state of a link."""

    DOWN = "down"
    """No connection, and none being made."""
    CONNECTING = "connecting"
    UP = "up"


class Link:
    """One connection to one controller: `run` keeps it, the other methods use it.

    One transaction is in flight at a time. A command waits for that one at most, not for queued reads.
    """

    # every poll touches it: see benchmarks/README.md
    __slots__ = (
        "_closing",
        "_down",
        "_ended",
        "_is_logged",
        "_last_tid",
        "_listeners",
        "_make_wire",
        "_outages",
        "_prepare",
        "_quiet_since",
        "_reason",
        "_running",
        "_since",
        "_state",
        "_summary",
        "_transactions",
        "_up",
        "_warned",
        "_wire",
        "_wire_listener",
        "declared",
        "epoch",
        "name",
        "settings",
        "shared_words",
        "stats",
    )

    def __init__(
        self,
        make_wire: Callable[[], Wire],
        settings: LinkSettings | None = None,
        *,
        name: str,
        prepare: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        """`make_wire` is called for every attempt to connect; `name` begins every message.

        `prepare` is awaited before each attempt, which fails with it if it raises ConnectFailed.
        """
        self.name = name
        self.settings = settings or LinkSettings()
        self.stats = LinkStats()
        self.epoch = 0
        """Rises by one with every connection; 0 before the first. Readings of an earlier epoch no longer count."""
        self.shared_words = asyncio.Lock()
        """Held while a word is read and written back changed, so that two lifts on one controller cannot undo each other's writes."""
        self.declared: DeclaredWrites | None = None
        """What the lifts on this link may write; any other write is a bug. None before a lift is added."""
        self._make_wire = make_wire
        self._prepare = prepare
        self._wire: Wire | None = None
        self._transactions: Transactions | None = None
        self._listeners: tuple[OnBytes, ...] = ()
        self._wire_listener: OnBytes | None = None
        """The listener that the wire had when it was made."""
        self._last_tid = 0
        self._state = LinkState.DOWN
        self._reason = "not started"
        self._since: float | None = None
        self._quiet_since = 0.0
        self._warned = False
        self._outages = ChangeRateLimiter(OUTAGES)
        self._is_logged = True
        """Whether the newest outage has a log line of its own."""
        self._summary: asyncio.TimerHandle | None = None
        self._running = False
        self._up = Flag()
        self._down = Flag()
        self._closing = Flag()
        self._ended = Flag()

    @property
    def state(self) -> LinkState:
        """The current state."""
        return self._state

    @property
    def in_doubt(self) -> bool:
        """Whether it is up but the last request was not answered in time: presses are refused until an answer comes."""
        return self._transactions is not None and self._transactions.in_doubt

    @property
    def reason(self) -> str:
        """Why it is down or in doubt; empty while it works."""
        return NO_ANSWER if self.in_doubt else self._reason

    @property
    def since(self) -> float | None:
        """Loop time at which it came up or went down (attempts do not count); None before `run`."""
        return self._since

    @property
    def in_flight(self) -> bool:
        """Whether a request was sent and its answer is awaited."""
        return self._transactions is not None and self._transactions.in_flight

    @property
    def waiting(self) -> tuple[int, int]:
        """How many requests wait for their turn: (reads, commands)."""
        return (0, 0) if self._transactions is None else self._transactions.waiting

    @contextmanager
    def tap(self, listener: OnBytes) -> Iterator[None]:
        """Call `listener` with (sent, frame) of every frame while the context lasts, over all connections.

        This includes late and mismatched answers, but not the frames that `Wire.send` discards. `listener` must neither block nor raise.
        """
        self._listeners = (*self._listeners, listener)
        self._listen()
        try:
            yield
        finally:
            remaining = list(self._listeners)
            remaining.remove(listener)
            self._listeners = tuple(remaining)
            self._listen()

    async def read(self, request: Request) -> bytes:
        """Register or bit bytes, in the read lane. Raises a DriverError: LinkDown, AnswerTimeout and so on."""
        transactions = self._transactions
        if transactions is None:
            raise self._link_down()
        if request.values:
            raise ValueError(f"not a read: {request}")
        return await transactions.read(request)

    def read_at_once(self, request: Request, receiver: Receiver) -> bool:
        """As `read`, without a task: returns False, and sends nothing, if it is down or the request would have to wait."""
        if request.values:
            raise ValueError(f"not a read: {request}")
        transactions = self._transactions
        return transactions is not None and transactions.read_at_once(request, receiver)

    async def read_urgent(self, request: Request) -> bytes:
        """As `read`, in the command lane: to read back the effect of a command."""
        if self._transactions is None:
            raise self._link_down()
        if request.values:
            raise ValueError(f"not a read: {request}")
        return await self._transactions.command(request, None)

    async def write(self, request: Request, permit: Permit | None = None, *, presses: bool = True) -> None:
        """Write, in the command lane; never sent a second time. Raises as `read`, and PressRefused if `permit` objects.

        A write that has a permit and `presses` is also refused while the link is in doubt; a release is sent all the same.
        The error's `sent` tells whether the controller may have carried it out. Raises UndeclaredWrite, which is not a DriverError,
        for a write that no map on this link declares, connected or not.
        """
        if not request.values:
            raise ValueError(f"not a write: {request}")
        if self.declared is not None and not self.declared.allows(request):
            raise UndeclaredWrite(self.name, request)
        if self._transactions is None:
            raise self._link_down()
        await self._transactions.command(request, permit, presses=presses)

    async def wait_up(self) -> int:
        """Wait until it is up; returns the epoch. Raises LinkDown once the link is closed."""
        while self._state is not LinkState.UP:
            if self._closing.is_set():
                raise self._link_down()
            await self._up.wait()
        return self.epoch

    async def run(self) -> None:
        """Connect, and connect again after every loss, until cancelled or closed."""
        if self._running:
            raise RuntimeError(f"{self.name}: the link is already running")
        loop = asyncio.get_running_loop()
        least_s, most_s = self.settings.reconnect_min_s, self.settings.reconnect_max_s
        pause_s = least_s
        self._running = True
        self._since = loop.time()
        try:
            while not self._closing.is_set():
                began = loop.time()
                if await self._serve():
                    pause_s = least_s
                with suppress(TimeoutError):
                    async with asyncio.timeout(max(least_s, began + pause_s - loop.time())):
                        await self._closing.wait()
                pause_s = min(2 * pause_s, most_s)
        finally:
            self._running = False
            self._log_outages()
            self._end("closed" if self._closing.is_set() else "stopped")
            self._ended.set()

    async def close(self) -> None:
        """Close it for good: waiting requests and further use raise LinkDown, and `run` returns."""
        self._closing.set()
        self._end("closed")
        self._up.set()
        if self._running:
            await self._ended.wait()

    async def _serve(self) -> bool:
        """Make one connection and use it to its end. Returns whether the controller ever answered on it."""
        wire = self._wire = self._make_wire()
        self._wire_listener = wire.on_bytes
        self._listen()
        transactions = Transactions(
            self.name,
            self.settings,
            self.stats,
            wire,
            last_tid=self._last_tid,
            on_broken=self._end_connection,
            on_proved=self._on_proved,
        )
        self._down.clear()
        self._state = LinkState.CONNECTING
        try:
            if self._prepare is not None:
                await self._prepare()
                if self._down.is_set():
                    return False  # it was closed meanwhile
            await wire.open(transactions.on_frame, self._on_lost, timeout_s=self.settings.connect_timeout_s)
        except ConnectFailed as error:
            self.stats.failed_connects += 1
            # Without a wire it was ended meanwhile, for a better reason.
            if self._wire is not None:
                self._end_connection(f"{error}{self._slot_hint(error)}")
            return False
        self._transactions = transactions
        self.epoch += 1
        self.stats.connects += 1
        self._state, self._reason, self._since = LinkState.UP, "", asyncio.get_running_loop().time()
        _logger.debug("%s: connected to %s", self.name, wire.peer)
        self._up.set()
        await self._down.wait()
        return transactions.proved

    def _listen(self) -> None:
        """Listen to the wire only while there are listeners: each frame costs a call."""
        if self._wire is not None:
            self._wire.on_bytes = self._on_bytes if self._listeners else self._wire_listener

    def _on_bytes(self, sent: bool, frame: bytes) -> None:  # noqa: FBT001 - as OnBytes has it
        if self._wire_listener is not None:
            self._wire_listener(sent, frame)
        for listener in self._listeners:
            listener(sent, frame)

    def _slot_hint(self, error: ConnectFailed) -> str:
        """Return a hint for a failed connection to a device that serves few clients."""
        most = self.settings.max_connections
        if most is None or error.problem not in (ConnectProblem.TIMED_OUT, ConnectProblem.REFUSED):
            return ""
        return f"; it serves {most} client{'' if most == 1 else 's'} at once, and another one may hold the slot"

    def _on_lost(self, reason: str) -> None:
        self.stats.losses += 1
        self._end_connection(reason)

    def _end_connection(self, reason: str) -> None:
        """End a connection that broke or could not be made, and log the outage."""
        is_new = not self._warned
        if is_new:
            self._quiet_since = now = asyncio.get_running_loop().time()
            self._is_logged = self._outages.admits("lost", now)
            if not self._is_logged and self._summary is None:
                self._summary = asyncio.get_running_loop().call_later(SUMMARY_EVERY_S, self._log_outages)
        level = logging.WARNING if is_new and self._is_logged else logging.DEBUG
        _logger.log(level, "%s: no connection: %s", self.name, reason)
        self._warned = True
        self._end(reason)

    def _log_outages(self) -> None:
        """Log the outages that were only counted, with the current state."""
        if self._summary is not None:
            self._summary.cancel()
        self._summary = None
        if (counted := self._outages.summary(asyncio.get_running_loop().time(), end=True)) is not None:
            times, for_s = counted[0].total(), counted[1]
            now = f"no connection: {self._reason}" if self._warned else "it answers"
            message = "%s: lost %d more times within %.0f s; now %s"
            _logger.warning(message, self.name, times, for_s, now)

    def _end(self, reason: str) -> None:
        wire, self._wire = self._wire, None
        if wire is not None:
            wire.close()
        if self._state is LinkState.UP:
            self._since = asyncio.get_running_loop().time()
        self._state, self._reason = LinkState.DOWN, reason
        self._up.clear()
        self._down.set()
        transactions, self._transactions = self._transactions, None
        if transactions is not None:
            self._last_tid = transactions.last_tid
            transactions.stop(reason, self._link_down)

    def _on_proved(self) -> None:
        """End the outage at the first answer: some controllers accept every connection and serve none."""
        if self._warned:
            self._warned = False
            silent_s = asyncio.get_running_loop().time() - self._quiet_since
            level = logging.INFO if self._is_logged else logging.DEBUG
            _logger.log(level, "%s: answers again after %.1f s", self.name, silent_s)
        elif self.epoch == 1:
            _logger.info("%s: connected", self.name)

    def _link_down(self) -> LinkDown:
        down_for_s = 0.0 if self._since is None else asyncio.get_running_loop().time() - self._since
        return LinkDown(self.name, self._reason, down_for_s)
