"""When a machine that goes on alone may command the lifts: pure, without a clock, a network or a task.

A person has decided that the other machine is off while etcd had no majority. That machine may be started all the same, so this one
keeps looking. Once etcd answers again it writes there that it is alone, and no standby takes the key from then on. A standby that
finds an etcd that was silent waits for `ANSWERING_S` before it takes the key, and this machine looks every `RENEW_S`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum, unique

from lift_manager.cluster.term import RENEW_S, TERM_S, UNCHANGED_S, Sent, Tick, Unanswered


@unique
class Mark(StrEnum):
    """What etcd says about a machine that goes on alone."""

    MISSING = "missing"
    OWN = "own"
    OTHER = "other"
    """Another decision than that of this machine."""


@unique
class SoloOrder(StrEnum):
    """What has to be done."""

    LOOK = "look"
    """Read key and mark."""
    MARK = "mark"
    """Write the own mark if there is none and the key has the known revision, and read both."""
    FENCE = "fence"
    """Write nothing to a controller any more, and reset every connection."""


@dataclass(frozen=True, slots=True)
class Found:
    """etcd has answered a request."""

    sent_at: float
    at: float
    revision: int
    """Of the key."""
    mark: Mark


@dataclass(frozen=True, slots=True)
class Watch:
    """What a machine that goes on alone knows of the key. Times are those of its own CLOCK_BOOTTIME."""

    revision: int
    """Of the key, as it is known."""
    known_at: float
    """Since when no other revision was seen, and no mark of the other machine."""
    is_contested: bool = False
    """The key has moved since the decision, so silence of etcd is no permission any more: another manager was or is active."""
    is_active: bool = False
    answered_at: float = -math.inf
    """When the newest answer came."""
    until: float = -math.inf
    """If it is active: nothing may be written from then on. A process that was stopped for longer looks again first."""
    sent_at: float | None = None
    """When the request under way was sent."""
    due_at: float = -math.inf
    """When the next request is due."""

    @property
    def wake_at(self) -> float:
        """When a tick is due."""
        request_at = self.due_at if self.sent_at is None else math.inf
        return min(request_at, self.until) if self.is_active else request_at


def step(watch: Watch, happened: Tick | Sent | Found | Unanswered) -> tuple[Watch, tuple[SoloOrder, ...]]:
    """Return the watch after an input, and what has to be done."""
    watch, orders = _advance(watch, happened.at)
    match happened:
        case Found() | Unanswered() if happened.sent_at != watch.sent_at:
            return watch, orders
        case Sent(at):
            return replace(watch, sent_at=at, due_at=at + RENEW_S), orders
        case Tick(at):
            return watch, orders + _request(watch, at)
        case Unanswered():
            watch = replace(watch, sent_at=None)
            silent_s = happened.at - max(watch.known_at, watch.answered_at)
            may_begin = not watch.is_contested and silent_s >= UNCHANGED_S
            return (_extend(watch, happened) if watch.is_active or may_begin else watch), orders
        case Found():
            watch, more = _take_answer(replace(watch, sent_at=None, answered_at=happened.at), happened)
            return watch, orders + more


def _advance(watch: Watch, at: float) -> tuple[Watch, tuple[SoloOrder, ...]]:
    if not watch.is_active or at < watch.until:
        return watch, ()
    return replace(watch, is_active=False, known_at=at), (SoloOrder.FENCE,)


def _request(watch: Watch, at: float) -> tuple[SoloOrder, ...]:
    if watch.sent_at is not None or at < watch.due_at:
        return ()
    may_mark = watch.is_active or at - watch.known_at >= UNCHANGED_S
    return (SoloOrder.MARK if may_mark else SoloOrder.LOOK,)


def _take_answer(watch: Watch, found: Found) -> tuple[Watch, tuple[SoloOrder, ...]]:
    if found.revision != watch.revision or found.mark is Mark.OTHER:
        orders = (SoloOrder.FENCE,) if watch.is_active else ()
        contested = replace(watch, revision=found.revision, known_at=found.at, is_contested=True, is_active=False)
        return contested, orders
    is_unmoved = found.at - watch.known_at >= UNCHANGED_S
    if found.mark is Mark.OWN and (watch.is_active or is_unmoved or not watch.is_contested):
        return replace(_extend(watch, found), is_contested=False), ()
    return (_extend(watch, found) if watch.is_active else watch), ()


def _extend(watch: Watch, happened: Found | Unanswered) -> Watch:
    """Be active until so long after the request was sent, if that is still to come."""
    until = max(watch.until, happened.sent_at + TERM_S)
    return replace(watch, is_active=happened.at < until, until=until)
