"""What a watcher has seen of one lift: the newest reading, when each signal changed, and where the car was in the last minute."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum, unique

from lift_manager.api.lifts import Lift, Signal, Signals
from lift_manager.lift.state import Quality
from register_maps.words import Door, Motion

WINDOW_S = 60.0
"""How long a change counts as recent, and how far the trace of the car goes back."""

SignalValue = str | bool | float | None


@unique
class SignalQuality(StrEnum):
    """Whether the value of a signal may be believed."""

    OK = "ok"
    OLD = "OLD"
    """Older than `max_age_s` of the lift."""
    UNREAD = "UNREAD"
    """Never read."""


@dataclass(frozen=True, slots=True)
class Change:
    """One signal that has another value, or is seen for the first time."""

    at: datetime
    signal: Signal
    before: Signal | None
    """None at the first time."""


@dataclass(frozen=True, slots=True)
class Sample:
    """The car at one moment."""

    at_s: float
    is_live: bool
    floor: str | None
    doors: tuple[Door, ...]
    """By the sides of `History.sides`."""
    motion: Motion


@dataclass(frozen=True, slots=True)
class Row:
    """One signal as it is shown."""

    signal: Signal
    quality: SignalQuality
    age_s: float | None
    changed: datetime | None
    """None while it has the value that it had at the beginning."""
    is_recent: bool
    """Whether it changed within the window."""


class History:
    """Takes one reading after the other; times are seconds of a monotonic clock."""

    def __init__(self, names: Sequence[str] = ()) -> None:
        """`names` are the signals to follow; all of them if there is none."""
        self.lift: Lift | None = None
        """None before the first reading."""
        self.trouble = ""
        """Why the manager gave no newer reading; empty if the last one was answered."""
        self.samples: deque[Sample] = deque()
        self.sides: tuple[str, ...] = ()
        self._names = frozenset(names)
        self._read_s = 0.0
        self._signals: dict[str, Signal] = {}
        self._max_age_s = 0.0
        self._changed: dict[str, tuple[datetime, float]] = {}

    def take(self, signals: Signals, lift: Lift, now_s: float, now: datetime) -> tuple[Change, ...]:
        """Take a reading; return what has changed."""
        self.lift, self._read_s, self._max_age_s, self.trouble = lift, now_s, signals.max_age_s, ""
        changes = []
        for signal in signals.signals:
            if self._names and signal.name not in self._names:
                continue
            before = self._signals.get(signal.name)
            self._signals[signal.name] = signal
            if before is None or (before.value, before.raw) != (signal.value, signal.raw):
                changes.append(Change(now, signal, before))
                if before is not None:
                    self._changed[signal.name] = now, now_s
        self._sample(lift, now_s)
        return tuple(changes)

    def fail(self, trouble: str) -> None:
        """Note that the manager gave no reading."""
        self.trouble = trouble

    def since_read_s(self, now_s: float) -> float:
        """Return the time since the manager last answered."""
        return now_s - self._read_s

    def age_s(self, now_s: float) -> float | None:
        """Return the age of the reading of the lift now."""
        if self.lift is None or self.lift.age_s is None:
            return None
        return self.lift.age_s + self.since_read_s(now_s)

    def is_live(self, now_s: float) -> bool:
        """Whether the state may be believed now, however long ago the manager answered."""
        age_s = self.age_s(now_s)
        return (
            self.lift is not None
            and self.lift.quality is Quality.LIVE
            and age_s is not None
            and age_s <= self._max_age_s
        )

    def rows(self, now_s: float, *, recent: bool = False) -> Iterator[Row]:
        """Yield the signals in the order of the map; with `recent` only those that changed within the window."""
        for signal in self._signals.values():
            changed, changed_s = self._changed.get(signal.name, (None, None))
            is_recent = changed_s is not None and now_s - changed_s <= WINDOW_S
            if recent and not is_recent:
                continue
            age_s = None if signal.age_s is None else signal.age_s + self.since_read_s(now_s)
            yield Row(signal, self._quality(signal, age_s), age_s, changed, is_recent)

    def trace(self, now_s: float, columns: int) -> tuple[Sample | None, ...]:
        """Return the window in equal parts, oldest first: the last sample of each; None from before the beginning.

        A part in which the manager did not answer has no sample that is live.
        """
        part_s = WINDOW_S / columns
        found: list[Sample | None] = []
        samples = iter((*self.samples, None))
        newest, following = None, next(samples)
        for column in range(columns):
            ends_s = now_s - WINDOW_S + (column + 1) * part_s
            while following is not None and following.at_s <= ends_s:
                newest, following = following, next(samples)
            found.append(newest if newest is None or self._is_fresh(newest, ends_s, part_s) else _silent(newest))
        return tuple(found)

    def _is_fresh(self, sample: Sample, at_s: float, part_s: float) -> bool:
        return at_s - sample.at_s <= max(self._max_age_s, part_s)

    def _quality(self, signal: Signal, age_s: float | None) -> SignalQuality:
        if signal.raw is None or age_s is None:
            return SignalQuality.UNREAD
        return SignalQuality.OLD if age_s > self._max_age_s else SignalQuality.OK

    def _sample(self, lift: Lift, now_s: float) -> None:
        if lift.doors:
            self.sides = tuple(str(side) for side in lift.doors)
        doors = tuple(lift.doors.values())
        self.samples.append(Sample(now_s, lift.quality is Quality.LIVE, lift.floor, doors, lift.motion))
        while len(self.samples) > 1 and self.samples[1].at_s < now_s - WINDOW_S:
            self.samples.popleft()


def _silent(sample: Sample) -> Sample:
    return Sample(sample.at_s, False, None, (), Motion.UNKNOWN)
