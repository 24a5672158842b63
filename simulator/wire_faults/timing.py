"""Faults in how and when an answer comes, as values. Pure. Durations are seconds."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from register_maps import frames
from simulator.wire_faults.bases import (
    HoldFault,
    Limits,
    Replies,
    RequestFault,
    ShapeFault,
    check_seconds,
    check_within,
)


@dataclass(frozen=True, slots=True)
class DuplicateAnswer(ShapeFault):
    """The answer comes twice."""

    after_s: float = 0.0

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_seconds("after_s", self.after_s)

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return replies + tuple((delay_s + self.after_s, data) for delay_s, data in replies if data is not None)


@dataclass(frozen=True, slots=True)
class SplitAnswer(ShapeFault):
    """The answer comes in several segments. Without a gap TCP may join them again; in memory they stay apart."""

    pieces: int = 2
    """About equally long; as many as there are bytes at most."""
    gap_s: float = 0.01

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_within("pieces", self.pieces, 2, frames.MAX_FRAME)
        check_seconds("gap_s", self.gap_s)

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return tuple(piece for reply in replies for piece in self._split(*reply))

    def _split(self, delay_s: float, data: bytes | None) -> Replies:
        if data is None:
            return ((delay_s, None),)
        size = math.ceil(len(data) / self.pieces)
        starts = range(0, len(data), size)
        return tuple((delay_s + nth * self.gap_s, data[at : at + size]) for nth, at in enumerate(starts))


@dataclass(frozen=True, slots=True)
class Delay(ShapeFault):
    """The answer comes later, and later answers wait behind it, as with a device that does one thing at a time."""

    seconds: float

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_seconds("seconds", self.seconds)

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _later(replies, self.seconds)


@dataclass(frozen=True, slots=True)
class UniformDelay(ShapeFault):
    """As `Delay`; every duration between the two is equally likely."""

    least_s: float
    most_s: float

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_seconds("least_s", self.least_s)
        check_seconds("most_s less least_s", self.most_s - self.least_s)

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _later(replies, chance.uniform(self.least_s, self.most_s))


@dataclass(frozen=True, slots=True)
class LongTailedDelay(ShapeFault):
    """As `Delay`; mostly near the median and seldom far above it (log-normal), as on a wireless bridge."""

    median_s: float
    spread: float = 1.0
    """Of the logarithm. With 1.0 one answer in six takes more than 2.7 medians, and one in a hundred more than 10."""
    most_s: float = 10.0

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        if not 0 < self.median_s <= self.most_s < math.inf or not 0 <= self.spread < math.inf:
            raise ValueError(
                f"median_s {self.median_s}, spread {self.spread}, most_s {self.most_s}: below 0 or too much"
            )

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _later(replies, min(chance.lognormvariate(math.log(self.median_s), self.spread), self.most_s))


@dataclass(frozen=True, slots=True)
class LateAnswer(ShapeFault):
    """The answer comes long after anybody waits for it, and later answers overtake it, as behind a gateway."""

    seconds: float = 5.0

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_seconds("seconds", self.seconds)

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _later(replies, self.seconds)


@dataclass(frozen=True, slots=True)
class Bandwidth(RequestFault):
    """Request and answer take their time on the line, one after the other; a segment comes with its last byte.

    The device sees the request at once: the time that it takes is added to its answer.
    """

    bytes_per_s: float

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        if not 0 < self.bytes_per_s < math.inf:
            raise ValueError(f"bytes_per_s {self.bytes_per_s}, allowed more than 0")


@dataclass(frozen=True, slots=True)
class ReorderAnswers(HoldFault):
    """The answer comes after the next one. If there is none, it never comes."""


@dataclass(frozen=True, slots=True)
class MergeAnswers(HoldFault):
    """The answer comes together with the next one, in one segment and before it. If there is none, it never comes."""


def _later(replies: Replies, seconds: float) -> Replies:
    return tuple((delay_s + seconds, data) for delay_s, data in replies)
