"""Judges what two managers did to one controller: by the cable on which it came, and by the key as observers saw it.

All times are those of `time.monotonic` in the process that watched.
"""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lift_manager.cluster.term import Key

TERM_S = 2.0
"""As docs/explanation/cluster.md promises. Not the manager's constant: a manager with a longer term would be judged by it."""
LAG_S = 0.5
"""How much later observers may see a key than its owner acts on it, on a busy computer."""


Row = Mapping[str, Any]
"""Of a journal, as it is exported."""


@dataclass(frozen=True)
class Passage:
    """Something that reached the controller."""

    at: float
    machine: str
    is_write: bool
    """False for a connection that was made."""
    claimed: int | None = None
    """The epoch that a write carries, where the map has a place for it."""

    @property
    def text(self) -> str:
        return f"{self.machine} {'wrote' if self.is_write else 'connected'}"


@dataclass(frozen=True)
class Answer:
    """A state of the lift that a manager gave to a client."""

    asked_at: float
    at: float
    machine: str
    is_open: bool
    """Whether it invites a robot."""


@dataclass(frozen=True)
class Finding:
    """Something that must never happen."""

    at: float
    text: str


@dataclass
class Alone:
    """A time in which one machine goes on alone, because a person has decided so; it ends when its manager has ended."""

    machine: str
    since: float
    epoch: int
    until: float = math.inf


class Keys:
    """What the key was, and when; added in the order of its revisions."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._keys: list[Key] = []
        self.alone: list[Alone] = []
        """In their order; the key counts for nobody meanwhile."""

    def add(self, at: float, key: Key) -> None:
        """Add a key that was seen; one that is not newer than the last is ignored."""
        if not self._keys or key.revision > self._keys[-1].revision:
            self._times.append(at)
            self._keys.append(key)

    @property
    def newest(self) -> Key:
        """The newest key; epoch 0 of nobody before any."""
        return self._keys[-1] if self._keys else Key(0)

    @property
    def epochs(self) -> int:
        """How many there were."""
        return len({key.epoch for key in self._keys if key.owner})

    def since(self, epoch: int) -> float:
        """Return when this epoch was seen first; it must have been."""
        return next(at for at, key in zip(self._times, self._keys, strict=True) if key.epoch == epoch)

    def wrong(self, machine: str, at: float) -> str:
        """Return why a machine must not act at a moment; empty if it may."""
        if (alone := self._alone_at(at)) is not None:
            return "" if machine == alone.machine else f"{at - alone.since:.2f} s after {alone.machine} went on alone"
        known = bisect_right(self._times, at)
        if any(key.owner == machine for key in self._keys[known : bisect_right(self._times, at + LAG_S)]):
            return ""
        if known == 0:
            return "before anybody was active"
        since, key = self._times[known - 1], self._keys[known - 1]
        if key.owner != machine:
            return f"{at - since:.2f} s after the key said epoch {key.epoch} of {key.owner or 'nobody'}"
        if at > since + TERM_S:
            return f"{at - since - TERM_S:.2f} s after its term in epoch {key.epoch}"
        return ""

    def epoch_of(self, machine: str, at: float) -> int:
        """Return the newest epoch in which a machine may have acted at a moment; 0 if it was never active."""
        if (alone := self._alone_at(at)) is not None and alone.machine == machine:
            return alone.epoch
        known = bisect_right(self._times, at + LAG_S)
        return next((key.epoch for key in reversed(self._keys[:known]) if key.owner == machine), 0)

    def _alone_at(self, at: float) -> Alone | None:
        return next((one for one in self.alone if one.since <= at <= one.until), None)


def judge_passages(keys: Keys, passages: Iterable[Passage]) -> Iterator[Finding]:
    """Each connection and each write is made by the machine whose key it is, within its term."""
    for passage in passages:
        if why := keys.wrong(passage.machine, passage.at):
            yield Finding(passage.at, f"{passage.text} {why}")


def judge_order(keys: Keys, passages: Iterable[Passage]) -> Iterator[Finding]:
    """Writes of two machines never interleave: once a write of an epoch has arrived, none of an earlier epoch does.

    A write that carries an epoch carries that of its machine.
    """
    newest, writer = 0, ""
    for passage in passages:
        if not passage.is_write:
            continue
        epoch = keys.epoch_of(passage.machine, passage.at)
        if epoch < newest:
            text = f"{passage.text} in epoch {epoch}, and {writer} had written in epoch {newest} already"
            yield Finding(passage.at, text)
        else:
            newest, writer = epoch, passage.machine
        if passage.claimed not in (None, epoch):
            yield Finding(passage.at, f"{passage.text} for epoch {passage.claimed}, and it was active in epoch {epoch}")


def judge_answers(keys: Keys, answers: Iterable[Answer]) -> Iterator[Finding]:
    """No machine answers with a state, OPEN or another, unless it may have been active at some moment since it was asked."""
    for answer in answers:
        if (why := keys.wrong(answer.machine, answer.at)) and keys.wrong(answer.machine, answer.asked_at):
            what = "said OPEN" if answer.is_open else "answered with a state"
            yield Finding(answer.at, f"{answer.machine} {what} {why}")


def percentile(values: Sequence[float], share: float) -> float:
    """Return the smallest value that `share` of all values do not exceed; there must be one."""
    ordered = sorted(values)
    return ordered[max(0, -int(-share * len(ordered) // 1) - 1)]


def first_difference(one: Iterable[Row], other: Iterable[Row]) -> str:
    """Return where two journals differ; empty if they do not. One of them may end sooner, and may lack rows where it says so."""
    first, second = deque(one), deque(other)
    while first and second:
        if first[0] == second[0]:
            first.popleft()
            second.popleft()
            continue
        lacking, having = (first, second) if first[0]["kind"] == "gap" else (second, first)
        if lacking[0]["kind"] != "gap":
            return f"{first[0]} and {second[0]}"
        lacking.popleft()
        while having and lacking and having[0] != lacking[0]:
            having.popleft()
        if lacking and not having:
            return f"{lacking[0]} is in one of them alone"
    return ""
