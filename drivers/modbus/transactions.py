"""The transactions of one connection: two lanes, one request in flight, answers matched and checked.

Each connection has its own; `link` makes them.
"""

from __future__ import annotations

import asyncio
from bisect import bisect_left
from collections.abc import Callable
from typing import Protocol

from drivers.errors import (
    BUSY,
    PATH_UNAVAILABLE,
    TARGET_SILENT,
    AnswerMismatch,
    AnswerTimeout,
    ConnectionLost,
    ControllerException,
    DriverError,
    PressRefused,
    UnitOffline,
)
from drivers.modbus.histogram import BOUNDS_S
from drivers.modbus.latency import Latency
from drivers.modbus.settings import LinkSettings, LinkStats
from drivers.modbus.wire import Wire
from register_maps.errors import ExceptionAnswer, Mismatch
from register_maps.frames import Request, check, describe_answer, frame, tid_of

Permit = Callable[[], str | None]
"""Called immediately before the bytes leave; a text refuses the request and gives the reason."""


class Receiver(Protocol):
    """Receives the answer to one request, or why there is none: a future, or an object that continues without a task."""

    def done(self) -> bool:
        """Whether it no longer waits for it."""

    def set_result(self, payload: bytes, /) -> None:
        """Receive the answer, in the middle of the work of its connection."""

    def set_exception(self, error: Exception, /) -> None:
        """Receive why there is none, in the middle of the work of its connection."""


_Job = tuple[Receiver, Request, Permit | None, int, float, bool]
"""(receiver of the answer, request, permit, remaining retries, waiting since, whether it presses)."""
_AT_ONCE = -1.0
"""In place of the time, for a request that need not wait: saves a look at the clock."""

_HIGHEST_TID = 65535
_REMEMBERED = 256
"""An answer to one of this many last requests is late rather than foreign. Chosen: seconds of polling at any pace, and far fewer than
all transaction ids, where every number would look like ours."""
_MEASURED = 5
"""One in so many answers of a unit is measured, and each one while there is any doubt. Chosen: about one per second of polling; a measurement
costs a twentieth of a read. A prime number, so that each read of a poll with several reads is measured in turn: one that takes longer
must not be missed."""
_OVERDUE = 8
"""This many unanswered requests are remembered with their sending time, for the round trip of their late answers. Chosen: two in a row
end the connection, so there are few."""
_PAUSE_AFTER = 8
"""Without transaction ids a duplicated answer shifts all later ones by one request. After so many transactions nothing is sent for two round
trips, so that the surplus answer arrives while no request waits. Two, because in such a stream a round trip seems to take half its time.
Chosen: at most a fifth of the link."""
_STRIKES = 2
"""After so many requests in a row without an answer a new connection is made. Chosen: one lost answer is no lost connection."""
NO_ANSWER = "the controller did not answer the last request"
_COMMANDS_IN_A_ROW = 3
"""After so many commands in a row a waiting read goes first. Chosen: at 250 ms per answer, a state is then still younger than a second;
otherwise a burst of commands would make the readings too old, and commands would be refused because of that."""
_LAST_LOOKS = 2
"""Turns of the loop between a deadline and the time-out. If our own process was delayed, the answer may be unread in the socket: libuv
runs timers before it reads, and callbacks of timers too."""


class Transactions:
    """Sends one request at a time over one open wire; commands before reads, each lane in order.

    A caller that is cancelled before its request was sent leaves the lane. After that the lane stays occupied until the
    answer or the time-out, so that no later request gets a late answer.
    """

    # one for each connection: a table of attributes, and an empty set, would take as much memory as all the rest of it
    __slots__ = (
        "_busy_pause",
        "_busy_retries",
        "_commands",
        "_commands_in_a_row",
        "_deadline",
        "_gap",
        "_gap_s",
        "_job",
        "_latencies",
        "_latency",
        "_loop",
        "_name",
        "_on_broken",
        "_on_proved",
        "_overdue",
        "_reads",
        "_sent_at",
        "_sent_before",
        "_settings",
        "_silent",
        "_stats",
        "_strikes",
        "_tid_echo",
        "_timeouts_in_a_row",
        "_timer",
        "_timer_at",
        "_unanswered",
        "_unit",
        "_unpaused",
        "_wire",
        "_write_wait_s",
        "last_tid",
        "proved",
    )

    def __init__(
        self,
        name: str,
        settings: LinkSettings,
        stats: LinkStats,
        wire: Wire,
        *,
        last_tid: int,
        on_broken: Callable[[str], None],
        on_proved: Callable[[], None],
    ) -> None:
        """`on_broken` receives why the connection must end; `on_proved` is called at the first good answer."""
        self.last_tid = last_tid
        """The newest transaction id; the next connection continues from it."""
        self.proved = False
        """Whether the controller has given a good answer on this connection."""
        self._name = name
        self._settings = settings
        self._stats = stats
        self._wire = wire
        self._on_broken = on_broken
        self._on_proved = on_proved
        self._loop = asyncio.get_running_loop()
        self._latencies = stats.latencies
        self._unit, self._latency = -1, settings.new_latency()
        """The unit of the newest request, and its estimator."""
        self._write_wait_s = settings.timeout_s
        self._gap_s, self._busy_retries = settings.min_gap_s, settings.busy_retries
        self._tid_echo = settings.tid_echo
        self._sent_before = stats.transactions
        self._commands: list[_Job] = []
        self._reads: list[_Job] = []
        self._job: _Job | None = None
        self._sent_at = 0.0
        """When the newest request left."""
        self._deadline = self._timer_at = 0.0
        self._overdue: dict[int, tuple[float, Latency]] = {}
        """Requests not answered in time, by transaction id: when they were sent, and the estimator of their unit."""
        self._timeouts_in_a_row = 0
        """Since the last answer of any unit."""
        self._strikes = 0
        """Those of them that count against the connection: not of units that were silent before."""
        self._unanswered: dict[int, None] = {}
        """Units with time-outs since the last answer of any unit."""
        self._silent = stats.silent_units
        self._commands_in_a_row = 0
        self._unpaused = 0
        """Transactions since the last deliberate pause."""
        self._timer: asyncio.Handle | None = None
        self._gap: asyncio.Handle | None = None
        self._busy_pause: asyncio.Handle | None = None

    @property
    def in_doubt(self) -> bool:
        """Whether the last request was not answered in time: nothing is pressed until an answer comes.

        A unit that is silent while others answer does not count.
        """
        return self._strikes > 0

    @property
    def in_flight(self) -> bool:
        """Whether a request was sent and its answer is awaited."""
        return self._job is not None

    @property
    def waiting(self) -> tuple[int, int]:
        """How many requests wait for their turn: (reads, commands)."""
        return len(self._reads), len(self._commands)

    def read(self, request: Request) -> asyncio.Future[bytes]:
        """Queue a request in the read lane."""
        future: asyncio.Future[bytes] = self._loop.create_future()
        if not self.read_at_once(request, future):
            self._reads.append((future, request, None, self._busy_retries, self._loop.time(), False))
        return future

    def read_at_once(self, request: Request, receiver: Receiver) -> bool:
        """Send a read, unless it would have to wait: then return False."""
        if self._job is not None or self._gap is not None or self._busy_pause is not None:
            return False
        # nothing waits in either lane then
        self._commands_in_a_row = 0
        self._stats.read_waits.counts[0] += 1  # not `add`, as in `on_frame`
        self._send((receiver, request, None, self._busy_retries, _AT_ONCE, False))
        return True

    def command(self, request: Request, permit: Permit | None, *, presses: bool = True) -> asyncio.Future[bytes]:
        """Queue a request in the command lane. One that `presses` is refused while the controller does not answer."""
        future: asyncio.Future[bytes] = self._loop.create_future()
        if self._job is None and self._gap is None:
            self._commands.append((future, request, permit, self._busy_retries, _AT_ONCE, presses))
            self._next()
            return future
        self._commands.append((future, request, permit, self._busy_retries, self._loop.time(), presses))
        return future

    def stop(self, reason: str, down: Callable[[], DriverError]) -> None:
        """Fail all requests because the connection is gone. `down` makes the error of those that were never sent."""
        for handle in (self._timer, self._gap, self._busy_pause):
            if handle is not None:
                handle.cancel()
        job, self._job = self._job, None
        if job is not None:
            _fail(job, ConnectionLost(self._name, str(job[1]), reason))
        for lane in (self._commands, self._reads):
            while lane:
                _fail(lane.pop(0), down())

    def on_frame(self, answer: bytes) -> None:
        """Handle an answer from the wire."""
        job = self._job
        if job is None or (self._tid_echo and (answer[0] << 8 | answer[1]) != self.last_tid):
            self._on_stray(answer)
            return
        refusal = None
        try:
            payload = check(job[1], answer)
        except ExceptionAnswer as error:
            refusal, payload = error, b""
        except Mismatch as error:
            self._on_mismatch(job, error)
            return
        now, stats = self._loop.time(), self._stats
        stats.asked_at = sent_at = self._sent_at
        took_s = now - sent_at
        stats.answered_at = now
        # not `add`: this runs for every answer, and the call costs as much as the rest
        trips = stats.round_trips
        trips.counts[bisect_left(BOUNDS_S, took_s)] += 1
        trips.total_s += took_s
        latency = self._latency
        latency.unmeasured += 1
        if latency.unmeasured >= _MEASURED or self._timeouts_in_a_row or self._silent or not self.proved:
            self._measure(job[1].unit, took_s)
        receiver = job[0]
        if refusal is not None:
            self._on_exception(job, refusal)
        elif not receiver.done():
            receiver.set_result(payload)
        self._finish()

    def _measure(self, unit: int, took_s: float) -> None:
        """Record the round trip of a good answer, and that the controller answers."""
        self._latency.add_answer(took_s)
        if self._timeouts_in_a_row or not self.proved:
            # the connection answers: end the backoff of all units
            for latency in self._latencies.values():
                latency.end_backoff()
            self._silent.update(self._unanswered)
            self._unanswered.clear()
            self._timeouts_in_a_row = self._strikes = 0
        self._silent.pop(unit, None)
        if not self.proved:
            self.proved = True
            self._on_proved()

    def _next(self) -> None:
        """Send the request that has waited longest: commands first, but a read after a few commands."""
        while True:
            reads_wait = bool(self._reads) and self._busy_pause is None
            if self._commands and not (reads_wait and self._commands_in_a_row >= _COMMANDS_IN_A_ROW):
                job, waits = self._commands.pop(0), self._stats.command_waits
                self._commands_in_a_row += 1
            elif reads_wait:
                job, waits = self._reads.pop(0), self._stats.read_waits
                self._commands_in_a_row = 0
            else:
                return
            # one that is done: its caller was cancelled
            if not job[0].done() and (job[2] is None or self._may_leave(job, job[2])):
                break
        waits.add(0.0 if job[4] < 0 else self._loop.time() - job[4])  # less than 0: _AT_ONCE
        self._send(job)

    def _send(self, job: _Job) -> None:
        """Begin a transaction."""
        self._job = job
        self.last_tid = tid = self.last_tid % _HIGHEST_TID + 1
        self._stats.transactions += 1
        request = job[1]
        if request.unit != self._unit:
            latency = self._latencies.get(request.unit)
            if latency is None:
                latency = self._latencies[request.unit] = self._settings.new_latency()
            self._unit, self._latency = request.unit, latency
        wait_s = self._latency.timeout_s
        if wait_s < self._write_wait_s and request.values:
            wait_s = self._write_wait_s
        self._sent_at = sent_at = self._loop.time()
        self._deadline = sent_at + wait_s
        # One timer serves many transactions: where it fires early it is set again.
        if self._timer is None:
            self._set_timer()
        elif self._timer_at > self._deadline:
            self._timer.cancel()
            self._set_timer()
        self._wire.send(frame(request, tid))

    def _set_timer(self) -> None:
        self._timer_at = self._deadline
        self._timer = self._loop.call_at(self._deadline, self._on_timer, _LAST_LOOKS)

    def _may_leave(self, job: _Job, permit: Permit) -> bool:
        try:
            refusal = NO_ANSWER if job[5] and (self._strikes or job[1].unit in self._silent) else permit()
        except Exception as error:  # noqa: BLE001 - a bug of the caller, who gets the error; other requests continue
            _fail(job, error)
            return False
        if refusal is not None:
            _fail(job, PressRefused(self._name, str(job[1]), refusal))
        return refusal is None

    def _finish(self) -> None:
        """End the transaction in flight; the connection continues."""
        self._job = None
        gap_s = self._gap_s
        if not self._tid_echo:
            self._unpaused += 1
            if self._unpaused >= _PAUSE_AFTER:
                self._unpaused = 0
                gap_s = max(gap_s, 2 * (self._latency.round_trip_s or 0.0))
        if gap_s:
            self._gap = self._loop.call_later(gap_s, self._on_gap_over)
        elif self._commands or self._reads:
            # one turn later: this answer must be processed before a press behind it may be sent
            self._gap = self._loop.call_soon(self._on_gap_over)

    def _on_gap_over(self) -> None:
        self._gap = None
        self._next()

    def _on_busy_pause_over(self) -> None:
        self._busy_pause = None
        if self._job is None and self._gap is None:
            self._next()

    def _on_exception(self, job: _Job, answer: ExceptionAnswer) -> None:
        receiver, request, _, retries, *_ = job
        self._stats.exceptions += 1
        if answer.code == BUSY and not request.is_write and retries and not receiver.done():
            self._reads.insert(0, (receiver, request, None, retries - 1, self._loop.time(), False))
            if self._busy_pause is not None:
                self._busy_pause.cancel()
            self._busy_pause = self._loop.call_later(self._settings.busy_pause_s, self._on_busy_pause_over)
            return
        if answer.code in (PATH_UNAVAILABLE, TARGET_SILENT):
            _fail(job, UnitOffline(self._name, str(request), answer.code), answer)
            return
        _fail(job, ControllerException(self._name, str(request), answer.code, tls=self._settings.tls), answer)

    def _on_mismatch(self, job: _Job, mismatch: Mismatch) -> None:
        _fail(job, AnswerMismatch(self._name, str(mismatch)), mismatch)
        self._desync(str(mismatch))

    def _on_stray(self, answer: bytes) -> None:
        """Handle an answer that fits no request in flight."""
        if self._tid_echo:
            tid = tid_of(answer)
            sent_here = min(self._stats.transactions - self._sent_before, _REMEMBERED)
            if tid and (self.last_tid - tid) % _HIGHEST_TID < sent_here:
                self._stats.late += 1
                overdue = self._overdue.pop(tid, None)
                if overdue is not None:
                    # the request in flight keeps the time-out that it was sent with
                    sent_at, latency = overdue
                    took_s = self._loop.time() - sent_at
                    self._stats.round_trips.add(took_s)
                    latency.add_late_answer(took_s)
                return
        text = f"an unrequested answer, transaction id {tid_of(answer)}: {describe_answer(answer)}"
        if self._tid_echo and tid_of(answer) == 0:
            text += " (a device that does not return transaction ids needs tid_echo: false)"
        if self._job is not None:
            _fail(self._job, AnswerMismatch(self._name, f"{self._job[1]}: {text}"))
        self._desync(text)

    def _desync(self, reason: str) -> None:
        self._stats.desyncs += 1
        self._recycle(f"answers are out of step with requests: {reason}")

    def _recycle(self, reason: str) -> None:
        self._stats.recycles += 1
        self._job = None
        self._on_broken(reason)

    def _on_timer(self, looks: int) -> None:
        self._timer = None
        job = self._job
        if job is None:
            return
        # Half a millisecond: libuv's clock counts whole ones, and may call a timer due just before its time.
        if self._deadline - self._loop.time() > 0.0005:
            self._set_timer()
        elif looks:
            self._timer = self._loop.call_soon(self._on_timer, looks - 1)
        else:
            self._on_timeout(job)

    def _on_timeout(self, job: _Job) -> None:
        waited_s, unit = round(self._deadline - self._sent_at, 3), job[1].unit
        self._stats.timeouts += 1
        self._timeouts_in_a_row += 1
        self._unanswered[unit] = None
        # a unit that was silent before does not count against the connection, unless no unit answers
        if unit not in self._silent or self._timeouts_in_a_row >= _STRIKES * len(self._latencies):
            self._strikes += 1
            self._latency.add_timeout()
        self._overdue[self.last_tid] = self._sent_at, self._latency
        if len(self._overdue) > _OVERDUE:
            del self._overdue[next(iter(self._overdue))]
        _fail(job, AnswerTimeout(self._name, str(job[1]), waited_s))
        if not self._tid_echo:
            self._recycle(
                f"no answer within {waited_s:g} s, and late answers cannot be recognised without transaction ids"
            )
        elif self._strikes >= _STRIKES:
            self._recycle(f"no answer within {waited_s:g} s, twice in a row")
        else:
            self._finish()


def _fail(job: _Job, error: Exception, cause: Exception | None = None) -> None:
    error.__cause__ = cause
    if not job[0].done():
        job[0].set_exception(error)
