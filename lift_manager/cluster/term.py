"""Who is active, as one member of a pair sees it: pure, without a clock, a network or a task.

One key in etcd carries the epoch and its owner. The active renews it, and its term lasts `TERM_S` from before the newest renewal
that was applied was sent. A standby takes the key after it has known it unchanged for `UNCHANGED_S` on its own clock. Why never
two are active: docs/explanation/cluster.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum, unique

RENEW_S = 0.3
"""Between two renewals, and between two looks of a standby. Chosen: six attempts in a term."""

TERM_S = 2.0
"""How long a renewal is valid, from before it was sent. Chosen: with it, and what follows from it, a machine that is killed is replaced within 4 s."""

UNCHANGED_S = 2.5
"""How long a standby knows the key unchanged before it takes it. Chosen: more than `TERM_S` on clocks whose rates differ by 10 %."""

SILENT_S = 2.5
"""After so long without an answer etcd counts as having been silent. Chosen: longer than the election of a leader."""

ANSWERING_S = 5.0
"""How long etcd answers a standby again before that takes the key: a machine that went on alone meanwhile needs the time to write there that
it did (`solo.py`). Chosen: a term, and five requests of that machine that are lost."""

ANSWER_S = 0.5
"""How long an answer of etcd is waited for. Chosen: a commit takes 5 ms, and a term has room for four members that do not answer."""

LEAST_MARGIN_S = 0.2
"""With three times the slowest usual renewal: what must remain of a term, or it is given up. Chosen: a few turns of a busy loop."""

MOST_MARGIN_S = 1.0
"""Chosen: with a slow etcd, at least two more attempts are made before a term is given up."""

TRIPS = 200
"""Renewals whose duration is remembered: those of the last minute."""

HIGHEST_EPOCH = 2**32 - 1
"""Controllers that arbitrate have 32 bits for it."""


@unique
class Role(StrEnum):
    """What a member may do."""

    STANDBY = "standby"
    """Watch the key, and take it when its owner is gone."""
    ACTIVE = "active"
    """Command the lifts until the term ends."""
    LEAVING = "leaving"
    """As active, but OPEN is withdrawn and everything is being released; there is no way back to active in this term."""
    OVER = "over"
    """The term has ended: nothing may be written, not even releases."""


@unique
class Order(StrEnum):
    """What has to be done."""

    LOOK = "look"
    """Read the key."""
    TAKE = "take"
    """Replace the key that was seen by one of the next epoch."""
    RENEW = "renew"
    """Write the key once more, if its revision is the known one."""
    WITHDRAW = "withdraw"
    """Withdraw OPEN from robots."""
    RELEASE = "release"
    """Release everything now."""
    FENCE = "fence"
    """Write nothing any more, and reset every connection."""


@dataclass(frozen=True, slots=True)
class Key:
    """The key as etcd holds it."""

    revision: int
    """The number of its newest change; 0 if there is none yet."""
    epoch: int = 0
    owner: str = ""
    """The member whose epoch it is; empty after a member has left in good order."""
    address: str = ""
    """Where clients find the owner."""


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed."""

    at: float


@dataclass(frozen=True, slots=True)
class Sent:
    """A request is about to be sent; at most one is under way."""

    at: float


@dataclass(frozen=True, slots=True)
class Answered:
    """etcd has answered a request."""

    order: Order
    sent_at: float
    at: float
    key: Key
    """The key after it."""
    is_applied: bool
    """Whether the key is what the request made of it; a look applies nothing."""
    is_barred: bool = False
    """Whether the key must not be taken: a machine goes on alone, or what etcd holds cannot be read by this version."""


@dataclass(frozen=True, slots=True)
class Unanswered:
    """No answer has come; whether the request was or will be applied is unknown."""

    sent_at: float
    at: float


@dataclass(frozen=True, slots=True)
class Leave:
    """This member is to give its term up in good order."""

    at: float


Input = Tick | Sent | Answered | Unanswered | Leave


@dataclass(frozen=True, slots=True)
class Term:
    """What a member knows of the key, and until when it is active. Times are those of its own CLOCK_BOOTTIME."""

    role: Role = Role.STANDBY
    key: Key | None = None
    """As it was seen last; None before the first answer."""
    known_at: float = -math.inf
    """When the first answer came that showed this revision."""
    answered_at: float = -math.inf
    """When the newest answer came."""
    answering_since: float = -math.inf
    """When the first answer came since etcd was silent last; long ago once a change of the key was seen since then."""
    is_barred: bool = False
    """Whether the newest answer has barred the key."""
    until: float = -math.inf
    """The end of the term; nothing may be written from then on."""
    sent_at: float | None = None
    """When the request under way was sent."""
    due_at: float = -math.inf
    """When the next request is due."""
    pauses_until: float = -math.inf
    """After a request without an answer the key is not taken before this."""
    trips: tuple[float, ...] = ()
    """How long the newest renewals took. One without an answer is none: a leader that dies would make the margin long just then."""
    released: bool = False
    """Whether the release was ordered."""
    left: int | None = None
    """The epoch that this member gave up by itself: the other one is to take the next, if it is there."""

    @property
    def margin_s(self) -> float:
        """What must remain of the term: three times the 99th percentile of a renewal, and a little."""
        slowest = sorted(self.trips)[math.ceil(0.99 * len(self.trips)) - 1] if self.trips else 0.0
        return min(3 * slowest + LEAST_MARGIN_S, MOST_MARGIN_S)

    @property
    def withdraws_at(self) -> float:
        """When OPEN is withdrawn if no renewal is applied until then."""
        return self.until - self.margin_s

    @property
    def releases_at(self) -> float:
        """When everything is released, of a term that is being left."""
        return self.until - self.margin_s / 2

    @property
    def takes_at(self) -> float:
        """When the key may be taken, if it does not change until then."""
        if self.key is None or self.key.revision == 0 or self.is_barred:
            return math.inf
        is_free = not self.key.owner and self.key.epoch != self.left
        return max(self.ready_at, self.known_at + (0.0 if is_free else UNCHANGED_S))

    @property
    def ready_at(self) -> float:
        """When a standby could take the key if its owner gave it up; before that it accepts no handover."""
        return math.inf if self.is_barred else max(self.answering_since + ANSWERING_S, self.pauses_until)

    @property
    def wake_at(self) -> float:
        """When a tick is due."""
        request_at = self.due_at if self.sent_at is None else math.inf
        match self.role:
            case Role.STANDBY:
                return min(request_at, self.takes_at if self.sent_at is None else math.inf)
            case Role.ACTIVE:
                return min(request_at, self.withdraws_at)
            case Role.LEAVING:
                return min(request_at, self.until if self.released else self.releases_at)
            case Role.OVER:
                return math.inf


def step(term: Term, happened: Input) -> tuple[Term, tuple[Order, ...]]:
    """Return the term after an input, and what has to be done. Time comes first: an answer revives no term that has ended."""
    term, orders = _advance(term, happened.at)
    if term.role is Role.OVER:
        return term, orders
    match happened:
        case Answered() | Unanswered() if happened.sent_at != term.sent_at:
            return term, orders  # of a request from before this member was a standby again
        case Sent(at):
            return replace(term, sent_at=at, due_at=at + RENEW_S), orders
        case Answered():
            term, more = _take_answer(term, happened)
            return term, orders + more
        case Unanswered(_, at):
            return replace(term, sent_at=None, pauses_until=at + RENEW_S), orders
        case Leave():
            return (replace(term, role=Role.LEAVING) if term.role is Role.ACTIVE else term), orders
        case Tick(at):
            return term, orders + _request(term, at)


def _advance(term: Term, at: float) -> tuple[Term, tuple[Order, ...]]:
    """Give the term up as far as its time has run out."""
    if term.role not in (Role.ACTIVE, Role.LEAVING):
        return term, ()
    if at >= term.until:
        return replace(term, role=Role.OVER), (Order.FENCE,)
    orders: tuple[Order, ...] = ()
    if term.role is Role.ACTIVE and at >= term.withdraws_at:
        term, orders = replace(term, role=Role.LEAVING), (Order.WITHDRAW,)
    if term.role is Role.LEAVING and not term.released and at >= term.releases_at:
        term, orders = replace(term, released=True), (*orders, Order.RELEASE)
    return term, orders


def _request(term: Term, at: float) -> tuple[Order, ...]:
    """Return the request that is due."""
    if term.sent_at is not None:
        return ()
    if term.role is not Role.STANDBY:
        return (Order.RENEW,) if at >= term.due_at else ()
    if at >= term.takes_at:
        return (Order.TAKE,)
    return (Order.LOOK,) if at >= term.due_at else ()


def _take_answer(term: Term, answer: Answered) -> tuple[Term, tuple[Order, ...]]:
    before = term.key
    known_at = answer.at if before is None or before.revision != answer.key.revision else term.known_at
    since = term.answering_since
    if answer.at - term.answered_at > SILENT_S:
        since = answer.at
    elif before is not None and before.revision != answer.key.revision:
        since = -math.inf  # a manager of the pair has written it, so none goes on alone
    term = replace(term, answered_at=answer.at, answering_since=since, is_barred=answer.is_barred)
    if term.role is Role.STANDBY:
        taken = answer.order is Order.TAKE and answer.is_applied
        term = replace(_end_request(term, answer.at, is_renewal=taken), key=answer.key, known_at=known_at)
        if taken:
            term = replace(term, role=Role.ACTIVE, until=answer.sent_at + TERM_S)
        return _advance(term, answer.at)
    assert before is not None  # noqa: S101  it was taken
    term = replace(_end_request(term, answer.at, is_renewal=True), key=answer.key, known_at=known_at)
    if answer.is_applied:
        return replace(term, until=max(term.until, answer.sent_at + TERM_S)), ()
    if (answer.key.epoch, answer.key.owner) == (before.epoch, before.owner):
        # an earlier renewal was applied, and its answer lost; nobody knows when, so the term is not longer for it
        return replace(term, due_at=answer.at), ()
    return replace(term, role=Role.OVER), (Order.FENCE,)


def _end_request(term: Term, at: float, *, is_renewal: bool) -> Term:
    trips = term.trips
    if is_renewal and term.sent_at is not None:
        trips = (*trips[1 - TRIPS :], at - term.sent_at)
    return replace(term, sent_at=None, trips=trips)
