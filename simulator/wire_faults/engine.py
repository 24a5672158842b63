"""The engine behind faults of the wire: what becomes of every request, answer and connection. Pure.

`now` is in seconds on any clock that never goes back; the same one throughout.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import StrEnum, unique
from typing import NamedTuple

from simulator.wire_faults.bases import HoldFault, InsteadFault, Replies, Reply, ShapeFault
from simulator.wire_faults.faults import ORDER, WireFault
from simulator.wire_faults.ledger import Entry, Exchange, Ledger, StruckFault
from simulator.wire_faults.losses import AcceptAndSayNothing, ConnectionLimit, HalfOpen
from simulator.wire_faults.target import FUNCTION_AT, UNIT_AT
from simulator.wire_faults.timing import Bandwidth, LateAnswer, MergeAnswers

Answer = Callable[[bytes], Iterable[Reply]]
"""What a device makes of one request frame."""

_STEP_S = 1e-6
"""Between segments that are due at the same moment: timers of one moment fire in any order."""
_MOST_PENDING = 256
"""Requests that may wait for the device's answer. Chosen: far more than any client sends ahead, and a device that never
answers must not fill the memory."""
_SHORTEST = 8
"""Bytes of the shortest frame."""
_RANK: dict[type, int] = {kind: rank for rank, kind in enumerate(ORDER)}


@unique
class ConnectOutcome(StrEnum):
    """What an attempt to connect meets."""

    ADMITTED = "admitted"
    REFUSED = "refused"
    SILENT = "silent"
    """The connection is made, and nothing is ever passed on or answered."""


class Verdict(NamedTuple):
    """What becomes of a request, as far as that does not depend on the device."""

    executed: bool
    """Whether to pass it to the device."""
    replies: Replies
    """What the client gets at once or later, if it is not passed on."""


class WireFaults:
    """The faults of one wire, or of all connections to one device."""

    def __init__(self, faults: Iterable[WireFault] = (), *, seed: int = 0, start: float | None = None) -> None:
        """`start` is the moment from which windows count; None: that of `begin`, or of the first connection or request."""
        self._ledger = Ledger(seed, start)
        for fault in faults:
            self.add(fault)

    @property
    def faults(self) -> tuple[WireFault, ...]:
        """Those that are set, in order of addition; also used up ones."""
        return tuple(entry.fault for entry in self._ledger.entries)

    @property
    def strikes(self) -> list[StruckFault]:
        """Every strike, in order. It grows without limit; long runs may clear it."""
        return self._ledger.strikes

    @property
    def steady(self) -> bool:
        """Whether draws depend on the request and the time alone, so that one request more or less changes nothing for the others."""
        return self._ledger.steady

    @steady.setter
    def steady(self, steady: bool) -> None:
        """Decide it for the faults that are set from now on."""
        self._ledger.steady = steady

    @property
    def on_exchange(self) -> Callable[[Exchange], None] | None:
        """Hears of each exchange as soon as its answers are planned, so their times may lie ahead.

        An answer that is held back counts when it is sent, one that is never sent when the connection is closed.
        """
        return self._ledger.on_exchange

    @on_exchange.setter
    def on_exchange(self, hook: Callable[[Exchange], None] | None) -> None:
        self._ledger.on_exchange = hook

    def begin(self, now: float) -> None:
        """Windows count from here, unless they count from an earlier moment already."""
        self._ledger.elapsed_s(now)

    def add(self, fault: WireFault) -> None:
        """Set one more."""
        self._ledger.add(fault)

    def remove(self, fault: WireFault) -> None:
        """Take one away. Raises ValueError if it is not set."""
        self._ledger.remove(fault)

    def clear(self) -> None:
        """Remove all faults. A dead connection stays dead, and bytes under way still arrive."""
        self._ledger.entries.clear()

    def connection(self, now: float) -> Connection:
        """An attempt to connect; close it in the end."""
        return Connection(self._ledger, now)


@dataclass(slots=True, eq=False)
class _Plan:
    """A request, with what is to be done to its answer."""

    frame: bytes
    sent_at: float
    instead: tuple[Entry, InsteadFault] | None = None
    shapes: list[tuple[Entry, ShapeFault]] = field(default_factory=list)
    hold: Entry | None = None
    bandwidth: tuple[Entry, Bandwidth] | None = None
    right: bytes | None = None
    struck: list[WireFault] = field(default_factory=list)

    @property
    def executed(self) -> bool:
        """Whether the device sees it."""
        return self.instead is None or self.instead[1].reaches_device

    @property
    def overtaken(self) -> bool:
        """Whether later answers need not wait for this one."""
        return any(isinstance(fault, LateAnswer) for fault in self.struck)


class Connection:
    """One client's connection, or attempt at one: what has happened on it decides what comes next."""

    def __init__(self, ledger: Ledger, now: float) -> None:
        self.admission = _admission(ledger.on_connect(now))
        """Whether the client is let in."""
        self.dead = self.admission is ConnectOutcome.SILENT
        """Whether nothing passes any more though the connection stays, in neither direction, and not its end either."""
        self._ledger = ledger
        self._counts = self.admission is ConnectOutcome.ADMITTED
        self._ended = self.admission is ConnectOutcome.REFUSED
        self._pending: deque[_Plan] = deque()
        self._held: tuple[_Plan, Replies] | None = None
        self._clear_at = now
        """When the last segment is out that later ones wait for."""
        if self._counts:
            ledger.clients += 1

    def request(self, frame: bytes, now: float, answer: Answer) -> list[Reply]:
        """Handle one request completely, for a device that answers at once."""
        verdict = self.take(frame, now)
        if not verdict.executed:
            return list(verdict.replies)
        plan = self._pending[-1]
        came: list[Reply] = []
        for delay_s, data in answer(frame):
            if data is None:
                came += self._placed(((0.0, None),), now + delay_s, None, now)
            else:
                came += self._answered(data, now + delay_s, now)
        if plan in self._pending:
            self._pending.remove(plan)
            self._report_exchange(plan, ())
        return came

    def take(self, frame: bytes, now: float) -> Verdict:
        """A request from the client."""
        if self.dead or self._ended:
            self._report_exchange(_Plan(frame, now), (), executed=False)
            return Verdict(executed=False, replies=())
        plan = self._plan(frame, now)
        if plan.instead is not None and isinstance(plan.instead[1], HalfOpen):
            self.dead = True
        if not plan.executed:
            return Verdict(executed=False, replies=tuple(self._replies(plan, now, now)))
        self._pending.append(plan)
        if len(self._pending) > _MOST_PENDING:
            self._report_exchange(self._pending.popleft(), ())
        return Verdict(executed=True, replies=())

    def answered(self, frame: bytes, now: float) -> list[Reply]:
        """A frame from the device: what the client gets, in seconds from `now`."""
        return self._answered(frame, now, now)

    def close(self, now: float) -> None:
        """It is gone. May be repeated."""
        if self._counts:
            self._counts = False
            self._ledger.clients -= 1
        self._ended = True
        while self._pending:
            self._report_exchange(self._pending.popleft(), ())
        self._lose_held()

    def _plan(self, frame: bytes, now: float) -> _Plan:
        plan = _Plan(frame, now)
        for entry in self._ledger.on_request(frame, now):
            match entry.fault:
                case InsteadFault() as fault:
                    plan.instead = entry, fault
                case ShapeFault() as fault:
                    plan.shapes.append((entry, fault))
                case HoldFault() if plan.hold is None and self._held is None:
                    plan.hold = entry
                case Bandwidth() as fault if plan.bandwidth is None:
                    plan.bandwidth = entry, fault
                case _:
                    entry.take_back()
        plan.shapes.sort(key=lambda shape: _RANK[type(shape[1])])
        return plan

    def _answered(self, frame: bytes, at: float, now: float) -> list[Reply]:
        plan = self._take_plan(frame)
        if plan is not None:
            plan.right = frame
        if self.dead or self._ended:
            if plan is not None:
                self._report_exchange(plan, ())
            return []
        if plan is None:
            return self._placed(((0.0, frame),), at, None, now)
        return self._replies(plan, at, now)

    def _take_plan(self, answer: bytes) -> _Plan | None:
        """The request: by its transaction id, or the oldest that it fits, for some devices do not return the id."""
        if len(answer) < _SHORTEST:
            return None
        kind = answer[UNIT_AT], answer[FUNCTION_AT] & 0x7F
        same_id = (plan for plan in self._pending if plan.frame[:2] == answer[:2])
        same_kind = (plan for plan in self._pending if (plan.frame[UNIT_AT], plan.frame[FUNCTION_AT]) == kind)
        plan = next(same_id, None) or next(same_kind, None)
        if plan is not None:
            self._pending.remove(plan)
        return plan

    def _replies(self, plan: _Plan, at: float, now: float) -> list[Reply]:
        """Return the replies to a request whose answer is there, or is not needed."""
        replies: Replies = () if plan.right is None else ((0.0, plan.right),)
        if plan.instead is not None:
            entry, instead = plan.instead
            replies = instead.instead(plan.frame, entry.chance)
            self._strike(plan, entry, at)
        for entry, fault in plan.shapes:
            shaped = fault.shape(replies, entry.chance)
            if shaped == replies:
                entry.take_back()
            else:
                self._strike(plan, entry, at)
            replies = shaped
        if plan.hold is not None and replies and self._held is None and all(data is not None for _, data in replies):
            self._strike(plan, plan.hold, at)
            self._held = plan, replies
            return []
        if plan.hold is not None:
            plan.hold.take_back()
        return self._sent(plan, replies, at, now)

    def _sent(self, plan: _Plan, replies: Replies, at: float, now: float) -> list[Reply]:
        """Send the answer, and with it the one that was kept back."""
        if not replies:
            if plan.bandwidth is not None:
                plan.bandwidth[0].take_back()
            self._report_exchange(plan, ())
            return []
        if plan.bandwidth is not None:
            self._strike(plan, plan.bandwidth[0], at)
        own = self._placed(replies, at, plan, now)
        self._report_exchange(plan, own, since=now)
        if self._held is None:
            return own
        held, kept = self._held
        if any(data is None for _, data in own):
            self._lose_held()
            return own
        self._held = None
        return self._release_held(held, kept, own, now)

    def _release_held(self, held: _Plan, kept: Replies, own: list[Reply], now: float) -> list[Reply]:
        if any(isinstance(fault, MergeAnswers) for fault in held.struck):
            front = b"".join(data for _, data in kept if data is not None)
            (first_s, first), *others = own
            self._report_exchange(held, [(first_s, front)], since=now)
            return [(first_s, front + (first or b"")), *others]
        begin_s = kept[0][0]
        behind = self._placed(tuple((delay_s - begin_s, data) for delay_s, data in kept), now + own[-1][0], None, now)
        self._report_exchange(held, behind, since=now)
        return own + behind

    def _placed(self, replies: Replies, at: float, plan: _Plan | None, now: float) -> list[Reply]:
        """Put segments into their place behind the earlier ones; the result counts from `now`."""
        rate = 0.0
        if plan is not None and plan.bandwidth is not None:
            rate = plan.bandwidth[1].bytes_per_s
            at += len(plan.frame) / rate
        overtaken = plan is not None and plan.overtaken
        placed: list[Reply] = []
        for delay_s, data in replies:
            due = at + delay_s
            if not overtaken:
                if rate:
                    due = max(due, self._clear_at) + len(data or b"") / rate
                if due <= self._clear_at and self._clear_at > now:
                    due = self._clear_at + _STEP_S
                self._clear_at = max(due, self._clear_at)
            if data is None:
                self._ended = True
            placed.append((max(0.0, due - now), data))
        return placed

    def _strike(self, plan: _Plan, entry: Entry, at: float) -> None:
        plan.struck.append(entry.fault)
        self._ledger.strikes.append(StruckFault(at, entry.fault, plan.frame))

    def _lose_held(self) -> None:
        if self._held is not None:
            (plan, _), self._held = self._held, None
            self._report_exchange(plan, ())

    def _report_exchange(
        self, plan: _Plan, replies: Iterable[Reply], *, since: float = 0.0, executed: bool | None = None
    ) -> None:
        if self._ledger.on_exchange is None:
            return
        answers = tuple(sorted([(since + delay_s, data) for delay_s, data in replies if data is not None]))
        received = answers[0][1] if len(answers) == 1 else b"".join([data for _, data in answers])
        self._ledger.on_exchange(
            Exchange(
                sent_at=plan.sent_at,
                request=plan.frame,
                executed=plan.executed if executed is None else executed,
                right=plan.right,
                answers=answers,
                honest=plan.right is not None and received == plan.right,
                faults=tuple(plan.struck),
            )
        )


def _admission(fault: WireFault | None) -> ConnectOutcome:
    if fault is None:
        return ConnectOutcome.ADMITTED
    silent = isinstance(fault, AcceptAndSayNothing) or (isinstance(fault, ConnectionLimit) and fault.silent)
    return ConnectOutcome.SILENT if silent else ConnectOutcome.REFUSED
