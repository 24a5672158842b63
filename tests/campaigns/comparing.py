"""Compares two recordings of the same minute, entry by entry, and says what differs so that a person can judge it.

What may be otherwise without meaning anything is put aside first: texts (unless they are wanted), how often the same was
repeated, the order within an instant, and a part of a second.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from enum import StrEnum, unique
from fnmatch import fnmatchcase
from pathlib import Path

import yaml

from tests.campaigns.recordings import Json, Recording, RecordingError

LATER_S = 0.5
"""An entry that comes so much earlier or later is a difference. Chosen: two polls, and a little more."""
SHORT_S = 0.5
"""A state that lasts no longer may be seen by one manager and missed by another that polls a moment later."""
SWAPPED_S = 0.25
"""Entries that come this close together may change places: that is told as such."""
CONTEXT = 3
"""Entries that are shown before a difference."""

SNAPSHOTS = frozenset({"states", "workshop"})
"""Channels that tell how something is from now on."""
FIRST = ("inputs", "replies", "writes", "journal", "states", "workshop", "events", "reads")
"""Of what differs at the same moment, what is told first."""
TEXTS = frozenset({"text", "message", "msg", "waiting_for", "lockout", "failure", "why", "title", "detail"})
NUMBERS = frozenset({"times", "answers", "rows", "to_us", "age_s", "for_s", "since_s", "held_since_s", "ahead_s"})
"""Counts, ages and durations: they follow from the entries that are compared, and from their times."""
_ENDS = ("_ends_in_s", "ends_in_s", "_at")
"""How the names of other durations and of moments end."""
_TIME = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:\d\d)?")
_SECONDS = re.compile(r"\d+(\.\d+)?(?= (s|times)\b)")


@unique
class Kind(StrEnum):
    """How an entry differs."""

    MISSING = "missing"
    EXTRA = "extra"
    CHANGED = "changed"
    TIME = "time"
    """It is the same, and comes earlier or later."""
    COUNT = "count"
    """It is the same, and is repeated more or less often."""
    SHORT = "short"
    """A state of a moment is another one, or one of them does not have it."""
    ORDER = "order"
    """Two entries of almost the same moment have changed places."""


@dataclass
class Item:
    """One entry as it is compared, with its repetitions."""

    at: float
    entry: Json
    key: str
    until: float
    count: int = 1


@dataclass(frozen=True)
class Difference:
    """One thing that differs."""

    recording: str
    channel: str
    kind: Kind
    at: float
    about: tuple[str, ...]
    """The fields that changed, or what kind of entry is missing or extra."""
    entries: tuple[Json, ...]
    lines: tuple[str, ...]
    """The difference and what came before it, for people."""

    @property
    def sort(self) -> tuple[str, Kind, tuple[str, ...]]:
        """What differences of the same sort have in common."""
        return self.channel.partition(".")[0], self.kind, self.about

    def __str__(self) -> str:
        about = f" {', '.join(self.about)}" if self.about else ""
        when = "" if math.isinf(self.at) else f" at {self.at:.3f} s"
        return f"{self.channel}: {self.kind}{about}{when}"


@dataclass
class Accepted:
    """A difference that was judged, and why it is none to mend."""

    reason: str
    channel: str = "*"
    kind: str = "*"
    recording: str = "*"
    about: tuple[str, ...] | None = None
    """Every field that changed must be among these; None: any."""
    entry: Mapping[str, Json] = field(default_factory=dict)
    """What one of the entries must have."""
    seen: int = 0

    def covers(self, difference: Difference) -> bool:
        """Whether this is the difference that was judged."""
        named = (
            (self.channel, difference.channel),
            (self.kind, str(difference.kind)),
            (self.recording, difference.recording),
        )
        return (
            all(fnmatchcase(name, pattern) for pattern, name in named)
            and (self.about is None or set(difference.about) <= set(self.about))
            and any(_has(entry, self.entry) for entry in difference.entries)
        )


def accepted(path: Path) -> list[Accepted]:
    """Read the list of accepted differences. Raises RecordingError."""
    try:
        said = yaml.safe_load(path.read_text("utf-8")) or []
        found = [Accepted(**one) for one in said]
    except (OSError, yaml.YAMLError, TypeError) as error:
        raise RecordingError(f"{path}: {error}") from error
    if any(not one.reason for one in found):
        raise RecordingError(f"{path}: every accepted difference needs its reason")
    for one in found:
        one.about = None if one.about is None else tuple(one.about)
    return found


def differences(name: str, before: Recording, now: Recording, *, texts: bool = False) -> list[Difference]:
    """Return what differs between two recordings of one minute, in the order of time."""
    ours, theirs = sequences(before, texts=texts), sequences(now, texts=texts)
    found: list[Difference] = []
    for channel in sorted(ours.keys() | theirs.keys()):
        compared = _Channel(name, channel, ours.get(channel, []), theirs.get(channel, []))
        found += compared.differences()
    return sorted(found, key=lambda one: (one.at, _rank(one.channel)))


def sequences(recording: Recording, *, texts: bool = False) -> dict[str, list[Item]]:
    """Return the items of each channel as they are compared; the wire's are its writes and its reads."""
    found: dict[str, list[Item]] = {}
    for channel, entries in recording.items():
        kind, _, controller = channel.partition(".")
        if kind == "wire":
            writes = [entry for entry in entries if "count" not in entry[1]]
            found[f"writes.{controller}"] = _repeated(writes, _cell, texts=texts)
            found[f"reads.{controller}"] = _reads([entry for entry in entries if "count" in entry[1]])
        elif kind in ("inputs", "replies"):
            found[channel] = _repeated(entries, _speaker, texts=texts)
        else:
            found[channel] = _in_order(entries, texts=texts, snapshots=kind in SNAPSHOTS)
    return found


def normal(value: Json, *, texts: bool, key: str = "") -> Json:
    """Return a value without what means nothing: moments, durations, and texts unless they are wanted."""
    if value is not None and (key in NUMBERS or key == "at" or key.endswith(_ENDS)):
        return "#"
    match value:
        case dict():
            return {name: normal(one, texts=texts, key=name) for name, one in value.items()}
        case list():
            return [normal(one, texts=texts, key=key) for one in value]
        case str() if key in TEXTS or (key == "reason" and " " in value):
            if not texts:
                return "..." if value else ""
            return _SECONDS.sub("#", _TIME.sub("@", value))
        case str():
            return _TIME.sub("@", value)
        case float():
            return round(value, 3)
        case _:
            return value


def _repeated(entries: Sequence[list[Json]], stream: Callable[[Json], Json], *, texts: bool) -> list[Item]:
    """Return entries as runs: what one source repeats without anything else between is one item."""
    found: list[Item] = []
    last: dict[str, Item] = {}
    for at, entry in entries:
        source = json.dumps(stream(entry))
        item = _item(at, {name: one for name, one in entry.items() if name != "after_s"}, texts=texts)
        run = last.get(source)
        if run is not None and run.key == item.key:
            run.count, run.until = run.count + 1, at
            continue
        last[source] = item
        found.append(item)
    return found


def _reads(entries: Sequence[list[Json]]) -> list[Item]:
    """Return how often each block was read. When, and what the device said, is not compared: what follows from it is."""
    found: dict[str, Item] = {}
    for _, entry in entries:
        block = {name: entry[name] for name in ("unit", "function", "address", "count")}
        item = _item(math.inf, block, texts=False)
        found.setdefault(item.key, item).count += 1
    return sorted(found.values(), key=lambda item: item.key)


def _in_order(entries: Sequence[list[Json]], *, texts: bool, snapshots: bool) -> list[Item]:
    items = [_item(at, entry, texts=texts) for at, entry in entries]
    items.sort(key=lambda item: (item.at, item.key))
    found: list[Item] = []
    for item in items:
        if found and snapshots and found[-1].key == item.key:
            continue
        if found and snapshots:
            found[-1].until = item.at
        found.append(item)
    return found


def _item(at: float, entry: Json, *, texts: bool) -> Item:
    plain = normal(entry, texts=texts)
    return Item(at, plain, json.dumps(plain, sort_keys=True, ensure_ascii=False), at)


def _cell(entry: Json) -> Json:
    return [entry.get("unit"), entry.get("function"), entry.get("address"), len(entry.get("values", ()))]


def _speaker(entry: Json) -> Json:
    return [entry.get("holder"), entry.get("where"), entry.get("person"), entry.get("request")]


class _Channel:
    """One channel of two recordings."""

    def __init__(self, recording: str, channel: str, ours: Sequence[Item], theirs: Sequence[Item]) -> None:
        self._recording = recording
        self._channel = channel
        self._kind = channel.partition(".")[0]
        self._ours = ours
        self._theirs = theirs

    def differences(self) -> list[Difference]:
        """Return what differs."""
        found: list[Difference] = []
        matcher = SequenceMatcher(
            None, [item.key for item in self._ours], [item.key for item in self._theirs], autojunk=False
        )
        missing: list[int] = []
        extra: list[int] = []
        for tag, i1, i2, j1, j2 in matcher.get_opcodes():
            if tag == "equal":
                found += self._equal(range(i1, i2), range(j1, j2))
                continue
            paired = 0
            for i, j in zip(range(i1, i2), range(j1, j2), strict=False):
                if self._sort(self._ours[i]) != self._sort(self._theirs[j]):
                    break
                found.append(self._changed(i, j))
                paired += 1
            missing += range(i1 + paired, i2)
            extra += range(j1 + paired, j2)
        return found + list(self._alone(missing, extra))

    def _equal(self, ours: range, theirs: range) -> Iterator[Difference]:
        for i, j in zip(ours, theirs, strict=True):
            before, now = self._ours[i], self._theirs[j]
            if before.at != now.at and abs(before.at - now.at) > LATER_S:
                change = f"at {now.at:.3f} s instead of {before.at:.3f} s"
                yield self._difference(Kind.TIME, i, j, (self._sort(before),), [f"! {change}: {self._words(i)}"])
            elif not self._as_often(before.count, now.count):
                change = f"{now.count} times instead of {before.count}"
                yield self._difference(Kind.COUNT, i, j, (self._sort(before),), [f"! {change}: {self._words(i)}"])

    def _changed(self, i: int, j: int) -> Difference:
        before, now = dict(_flat(self._ours[i].entry)), dict(_flat(self._theirs[j].entry))
        fields = tuple(_uppermost(name for name in before.keys() | now.keys() if before.get(name) != now.get(name)))
        lines = [f"- {self._ours[i].at:8.3f} {name}: {before.get(name, '(none)')}" for name in fields]
        lines += [f"+ {self._theirs[j].at:8.3f} {name}: {now.get(name, '(none)')}" for name in fields]
        passing = self._lasts_briefly(self._ours, i) and self._lasts_briefly(self._theirs, j)
        kind = Kind.SHORT if passing else Kind.CHANGED
        return self._difference(kind, i, j, fields, [*lines, f"  in {self._words(i)}"])

    def _alone(self, missing: Sequence[int], extra: list[int]) -> Iterator[Difference]:
        """Yield what only one of them has; what both have, a moment apart and in another place, is out of order."""
        for i in missing:
            item = self._ours[i]
            twin = next(
                (
                    j
                    for j in extra
                    if self._theirs[j].key == item.key and abs(self._theirs[j].at - item.at) <= SWAPPED_S
                ),
                None,
            )
            if twin is not None:
                extra.remove(twin)
                change = f"! at {self._theirs[twin].at:.3f} s instead of {item.at:.3f} s, and in another place"
                yield self._difference(Kind.ORDER, i, twin, (self._sort(item),), [f"{change}: {self._words(i)}"])
                continue
            kind = Kind.SHORT if self._is_short(self._ours, i) else Kind.MISSING
            lines = [f"- {item.at:8.3f} {_words(self._kind, self._ours, i)}"]
            yield self._difference(kind, i, None, (self._sort(item),), lines)
        for j in extra:
            item = self._theirs[j]
            kind = Kind.SHORT if self._is_short(self._theirs, j) else Kind.EXTRA
            lines = [f"+ {item.at:8.3f} {_words(self._kind, self._theirs, j)}"]
            yield self._difference(kind, None, j, (self._sort(item),), lines)

    def _is_short(self, items: Sequence[Item], place: int) -> bool:
        """Whether a state lasted for a moment, or is that from before such a moment again."""
        if self._lasts_briefly(items, place):
            return True
        again = self._kind in SNAPSHOTS and place >= 2 and items[place - 2].key == items[place].key
        return again and items[place].at - items[place - 1].at <= SHORT_S

    def _lasts_briefly(self, items: Sequence[Item], place: int) -> bool:
        last = place + 1 == len(items)
        return self._kind in SNAPSHOTS and not last and items[place].until - items[place].at <= SHORT_S

    def _as_often(self, before: int, now: int) -> bool:
        if self._kind == "reads":
            return abs(before - now) <= max(3, 0.05 * before)
        if self._kind == "writes" and min(before, now) == 1:
            return before == now  # a press, or a press again
        return abs(before - now) <= max(1, 0.1 * before)

    def _difference(
        self, kind: Kind, i: int | None, j: int | None, about: tuple[str, ...], lines: Sequence[str]
    ) -> Difference:
        sides = [(self._ours, i), (self._theirs, j)]
        items = [side[place] for side, place in sides if place is not None]
        side, place = next((side, place) for side, place in sides if place is not None)
        nearby = range(max(0, place - CONTEXT), place) if self._kind != "reads" else ()
        context = [f"  {side[n].at:8.3f} {_words(self._kind, side, n)}" for n in nearby]
        return Difference(
            self._recording,
            self._channel,
            kind,
            min(item.until if kind is Kind.COUNT else item.at for item in items),
            tuple(one for one in about if one),
            tuple(item.entry for item in items),
            (*context, *lines),
        )

    def _words(self, i: int) -> str:
        return _words(self._kind, self._ours, i)

    def _sort(self, item: Item) -> str:
        """Return what kind of entry it is."""
        entry = item.entry
        match self._kind:
            case "states" | "workshop":
                return ""
            case "writes" | "reads":
                return f"function {entry.get('function')} at {entry.get('address')}"
            case "journal":
                return str(entry.get("kind"))
            case "events":
                return " ".join(str(entry[name]) for name in ("event", "what") if name in entry)
            case _:
                named = [name for name in ("request", "person", "fault", "floor", "map", "crash") if name in entry]
                return f"{named[0]} {entry[named[0]]}" if named else ""


def _words(kind: str, items: Sequence[Item], place: int) -> str:
    """Return an entry for people; of what tells how something is, what is new."""
    flat = dict(_flat(items[place].entry))
    if kind in SNAPSHOTS and place:
        before = dict(_flat(items[place - 1].entry))
        flat = {name: one for name, one in flat.items() if before.get(name) != one}
    else:
        flat = {name: one for name, one in flat.items() if one not in ("null", '""', "")}
    count = f" ({items[place].count} times)" if items[place].count > 1 else ""
    return ", ".join(f"{name}={one}" for name, one in flat.items()) + count


def _flat(entry: Json, path: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(entry, dict) and (entry or not path):
        for name, one in sorted(entry.items()):
            yield from _flat(one, f"{path}.{name}" if path else name)
    else:
        yield path, entry if isinstance(entry, str) and entry else json.dumps(entry, ensure_ascii=False)


def _uppermost(names: Iterable[str]) -> list[str]:
    """Return fields without those within another one of them."""
    found: list[str] = []
    for name in sorted(names):
        if not any(name.startswith(f"{other}.") for other in found):
            found.append(name)
    return found


def _has(entry: Json, wanted: Json) -> bool:
    if isinstance(wanted, Mapping):
        return isinstance(entry, Mapping) and all(
            name in entry and _has(entry[name], one) for name, one in wanted.items()
        )
    return bool(entry == wanted)


def _rank(channel: str) -> int:
    return FIRST.index(channel.partition(".")[0]) if channel.partition(".")[0] in FIRST else len(FIRST)
