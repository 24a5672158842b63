"""Which points show where the car is: a number, one bit per floor, a code over several bits, or a length. Pure."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from statistics import median
from typing import Any

from lift_manager.commissioning.learn.motion import Candidate, grade, place_spec, points_of, rivals_of
from lift_manager.commissioning.learn.samples import MarkKind
from lift_manager.commissioning.learn.tracks import (
    MIRROR_S,
    Confidence,
    Fit,
    Moment,
    Proposal,
    Track,
    Tracks,
    fit,
    place,
    preference,
)
from register_maps.points import Cell, Point
from register_maps.words import BIT_TABLES

LEAST_TOLERANCE = 2
"""Counts. Chosen: a length that never varies in one ride does on another day."""
LEAST_GAP = 50
"""Counts from floor to floor. Chosen: more floors than any building has, so that a floor number is no length."""
MOST_UNKNOWN = 8
"""Codes of a floor number that stand for no floor. Chosen: a number with more of them is something else."""
DRIFT_SHARE = 0.2
"""A length whose values at one floor spread over more of the least distance between floors than this is none."""

_CONTACTS, _NUMBER, _BITS, _LENGTH, _FIELD, _CODE = range(6)
"""The sorts of a position, in the order in which they are believed. One bit per floor in a register comes after a number: 1, 2 and 4
may be either, and a number is right for 3 too."""


@dataclass(frozen=True, slots=True)
class Position:
    """Where the car is, as proposed."""

    proposals: tuple[Proposal, ...]
    """`car_floor` or `car_position`; with the door where its limits are the floor switches."""
    codes: Mapping[str, int] = field(default_factory=dict)
    """The code of each floor for the site file, lowest floor first."""
    cautions: tuple[str, ...] = ()
    is_door_limit: bool = False


NOWHERE = Position(())


def position(tracks: Tracks, observed: Sequence[Moment], floors: Sequence[str], *, has_motion: bool) -> Position:
    """Propose where the car is."""
    stands = [moment for moment in observed if moment.stands and moment.floor]
    named = [name for name in floors if any(moment.floor == name for moment in stands)]
    if len(named) < 2:
        return NOWHERE
    families = list(_families(tracks, stands, named))
    lengths = list(_lengths(tracks, observed, named))
    in_lengths = {point.cell for length in lengths for point in length.track.points}
    # the high half of a length in two registers looks like a number for the floor
    numbers = [
        *_numbers(tracks.registers, _NUMBER, observed, stands, in_lengths),
        *_fields(tracks, observed, stands, in_lengths),
    ]
    found = sorted([*families, *numbers, *lengths, *_codes(tracks, stands)], key=lambda one: one.rank)
    if not found:
        return NOWHERE
    best = found[0]
    if best.rank[0] in (_CONTACTS, _BITS):
        return _as_family(best, found, stands, named)
    if best.rank[0] == _LENGTH:
        return _as_length(best, found, stands, named)
    return _as_number(best, found, tracks, observed, stands, named, has_motion=has_motion)


def _enough(stands: Sequence[Moment], named: Sequence[str]) -> bool:
    """Whether every floor was visited twice, or there are so many floors that chance is out of the question."""
    visits = {name: len({moment.stand for moment in stands if moment.floor == name}) for name in named}
    return min(visits.values()) >= 2 and (len(named) > 2 or min(visits.values()) >= 3)


_LACKS = "stops: two at each floor, three if there are only two floors"


# -- one bit per floor


@dataclass(frozen=True, slots=True)
class _FloorBit:
    """A bit that is on at one floor and off at all others, as far as the door is open there."""

    track: Track
    fit: Fit
    floor: str
    stays: bool | None
    """Whether it is on behind a closed door too; None if that was not marked."""


def _families(tracks: Tracks, stands: Sequence[Moment], named: Sequence[str]) -> Iterator[Candidate]:
    """Yield sets of bits of one table, or one register, of which one is on at each floor."""
    for on in (1, 0):
        groups: dict[tuple[Any, ...], list[_FloorBit]] = {}
        for bit in _floor_bits(tracks, stands, named, on):
            groups.setdefault(_group(bit.track), []).append(bit)
        for bits in groups.values():
            sorts: set[bool | None] = {bit.stays for bit in bits if bit.stays is not None}
            for stays in sorts or {None}:
                # a floor where no `-` was marked goes with either sort
                by_floor: dict[str, list[tuple[Track, Fit]]] = {}
                for bit in bits:
                    if bit.stays in (stays, None):
                        by_floor.setdefault(bit.floor, []).append((bit.track, bit.fit))
                if len(by_floor) == len(named):
                    yield from _joined(by_floor, named, on, stays=stays)


def _floor_bits(tracks: Tracks, stands: Sequence[Moment], named: Sequence[str], on: int) -> Iterator[_FloorBit]:
    opens = [moment for moment in stands if moment.kind is MarkKind.OPEN]
    for track in tracks.binary:
        for floor in named if track.is_bit or track.distinct == {0, 1} else ():
            here = [(floor, moment) for moment in opens if moment.floor == floor]
            fitting = fit(track, [*here, *((moment.floor, moment) for moment in stands if moment.floor != floor)])
            wanted = {name: on if name == floor else 1 - on for name in named}
            if fitting is not None and all(value == wanted[str(name)] for name, value in fitting.value_of.items()):
                yield _FloorBit(track, fitting, floor, _stays(track, stands, floor, on))


def _group(track: Track) -> tuple[Any, ...]:
    """Return what the bits of one set have in common: the table, or the register."""
    point = track.points[0]
    if point.table in BIT_TABLES or track.is_register:
        return (point.table, track.is_register)
    return (point.table, point.address)


def _stays(track: Track, stands: Sequence[Moment], floor: str, on: int) -> bool | None:
    """Whether a bit is on at its floor behind a closed door too; None if that was not marked."""
    shut = [track.at(m.at_s) == on for m in stands if m.floor == floor and m.kind is MarkKind.CLOSED]
    return None if not shut else sum(shut) * 2 > len(shut)


def _joined(
    by_floor: Mapping[str, list[tuple[Track, Fit]]], named: Sequence[str], on: int, *, stays: bool | None
) -> Iterator[Candidate]:
    """Yield a set for each way to take one bit per floor at equal distances; if there is none, the one of the lowest addresses."""
    regular = []
    first, second = by_floor[named[0]], by_floor[named[1]]
    for low in first:
        for high in second:
            stride = _index(high[0]) - _index(low[0])
            wanted = [_index(low[0]) + number * stride for number in range(len(named))]
            found = [
                next((one for one in by_floor[name] if _index(one[0]) == at), None)
                for name, at in zip(named, wanted, strict=True)
            ]
            if stride and all(found):
                regular.append([one for one in found if one is not None])
    chosen = regular or [[by_floor[name][0] for name in named]]
    for bits in chosen:
        bit_tracks = tuple(track for track, _ in bits)
        if len({track.points for track in bit_tracks}) < len(bit_tracks):
            continue
        if _is_contradictory(bit_tracks, on):
            continue
        misfits = Fit({}, tuple(moment for _, one in bits for moment in one.misfits))
        on_register = bit_tracks[0].points[0].table not in BIT_TABLES
        spread = abs(_index(bit_tracks[-1]) - _index(bit_tracks[0]))
        spec: dict[str, Any] = {"one_of": [_bit_address(track) for track in bit_tracks]}
        if not on:
            spec["active"] = "low"
        words = f"one {'bit' if on else 'cleared bit'} per floor, {', '.join(named)}"
        rank = (_BITS if on_register else _CONTACTS, stays is False, spread, not on, *preference(bit_tracks[0]))
        yield Candidate(bit_tracks[0], spec, misfits, rank, words, bit_tracks)


def _is_contradictory(bits: Sequence[Track], on: int) -> bool:
    """Whether two of the bits are on at once for longer than it takes to read them: then they are parts of a number."""
    first, *others = bits
    both_since: float | None = None
    for index, at_s in enumerate(first.times):
        values = [first.values[index], *(other.at(at_s) for other in others)]
        both_since = (at_s if both_since is None else both_since) if values.count(on) > 1 else None
        if both_since is not None and at_s - both_since >= (0 if others[0].times is first.times else MIRROR_S):
            return True
    return False


def _index(track: Track) -> int:
    point = track.points[0]
    return point.address if point.table in BIT_TABLES or track.is_register else point.address * 16 + point.low


def _bit_address(track: Track) -> str:
    return f"{track.place}.0" if track.is_register else track.place


def _as_family(best: Candidate, found: Sequence[Candidate], stands: Sequence[Moment], named: Sequence[str]) -> Position:
    codes = {name: index for index, name in enumerate(named)}
    on = 0 if best.spec.get("active") == "low" else 1
    shut = [moment for moment in stands if moment.kind is MarkKind.CLOSED]
    of_floor = dict(zip(named, best.points, strict=True))
    reasons = [f"{best.places}: {best.words}"]
    if not shut:
        reasons.append("no `-` was marked, so it may as well be the contact of the open door at each floor")
        return Position(
            (Proposal("car_floor", Confidence.NOT_SURE, best.spec, tuple(reasons), points_of(best)),), codes
        )
    kept = [of_floor[moment.floor].at(moment.at_s) == on for moment in shut]
    is_limit = not any(kept)
    if 0 < sum(kept) < len(kept):
        reasons.append("it is on behind a closed door at times, and off at others")
        return Position(
            (Proposal("car_floor", Confidence.NOT_SURE, best.spec, tuple(reasons), points_of(best)),), codes
        )
    rivals = [one for one in rivals_of(best, found) if one.rank[:2] == best.rank[:2]]
    confidence = grade(best.fit, rivals, reasons, enough=_enough(stands, named), lacks=_LACKS)
    points = points_of(best)
    if not is_limit:
        reasons.append("on behind a closed door too, so it shows the floor and not the door")
        return Position((Proposal("car_floor", confidence, best.spec, tuple(reasons), points),), codes)
    moving_door = [moment for moment in stands if moment.kind is MarkKind.DOOR]
    reasons.append("each is on only where the door is open at that floor: floor and door in one")
    if not moving_door or any(of_floor[moment.floor].at(moment.at_s) == on for moment in moving_door):
        confidence = Confidence.NOT_SURE
        reasons.append("whether the door is then fully open is not known: mark `/` while it moves")
    keys = {"open_limits": best.spec["one_of"]} | {key: best.spec[key] for key in ("active",) if key in best.spec}
    return Position(
        (
            Proposal("door.front", confidence, keys, tuple(reasons), points),
            Proposal("car_floor", confidence, best.spec, tuple(reasons), points),
        ),
        codes,
        is_door_limit=True,
    )


# -- numbers


def _numbers(
    found: Iterable[Track], sort: int, observed: Sequence[Moment], stands: Sequence[Moment], but: Container[Cell]
) -> Iterator[Candidate]:
    """Yield registers, or parts of them, with a code for each floor, but not those that belong to a length."""
    for track in found:
        if track.points[0].cell in but or (fitting := _fit_floors(track, stands)) is None:
            continue
        late = _lateness(track, observed, fitting)
        rank = (sort, track.points[0].width, -late, *preference(track))
        yield Candidate(track, place_spec(track), fitting, rank, _code_text(fitting.value_of))


def _fields(
    tracks: Tracks, observed: Sequence[Moment], stands: Sequence[Moment], but: Container[Cell]
) -> Iterator[Candidate]:
    """Yield parts of registers all of whose bits depend on the floor, the widest of each first."""
    depends = {track.points[0] for track in tracks.binary if track.is_bit and _depends_on_floor(track, stands)}
    varying = {track.points[0] for track in tracks.binary if track.is_bit}
    for candidate in _numbers(tracks.fields, _FIELD, observed, stands, but):
        (point,) = candidate.track.points
        bits = {Point(point.table, point.address, bit) for bit in range(point.low, point.low + point.width)}
        if bits & varying <= depends:
            yield replace(candidate, rank=(_FIELD, -len(bits & depends), *candidate.rank[1:]))


def _depends_on_floor(track: Track, stands: Sequence[Moment]) -> bool:
    """Whether a bit has one value at each floor, and not the same one at all of them."""
    fitting = fit(track, ((moment.floor, moment) for moment in stands))
    return fitting is not None and len(set(fitting.value_of.values())) > 1 and not _changes_at_a_stop(track, stands)


def _codes(tracks: Tracks, stands: Sequence[Moment]) -> Iterator[Candidate]:
    """Yield the position code that the bits of one table make up together."""
    for table in BIT_TABLES:
        bits = [one for one in tracks.binary if one.points[0].table is table and _depends_on_floor(one, stands)]
        if len(bits) < 2:
            continue
        bits.sort(key=lambda track: track.points[0].address)
        values = (
            [sum(bit.values[index] << place for place, bit in enumerate(bits)) for index in range(len(bits[0].values))]
            if all(bit.times == bits[0].times for bit in bits)
            else []
        )
        joined = Track(tuple(bit.points[0] for bit in bits), bits[0].times, values)
        if values and (fitting := _fit_floors(joined, stands)) is not None:
            spec = {"code_of": [place(point) for point in joined.points]}
            yield Candidate(
                joined, spec, fitting, (_CODE, *preference(joined)), _code_text(fitting.value_of), tuple(bits)
            )


def _fit_floors(track: Track, stands: Sequence[Moment]) -> Fit | None:
    """Return the code of each floor, if every floor has one of its own that stays while the car stands there."""
    fitting = fit(track, ((moment.floor, moment) for moment in stands))
    if fitting is None or len(fitting.value_of) < 2 or len(set(fitting.value_of.values())) < len(fitting.value_of):
        return None
    return None if _changes_at_a_stop(track, stands) else fitting


def _changes_at_a_stop(track: Track, stands: Sequence[Moment]) -> bool:
    by_stand: dict[int, list[float]] = {}
    for moment in stands:
        by_stand.setdefault(moment.stand, []).append(moment.at_s)
    changing = sum(len(set(track.between(min(times), max(times)))) > 1 for times in by_stand.values() if len(times) > 1)
    return changing > 0.1 * len(by_stand)


def _lateness(track: Track, observed: Sequence[Moment], fitting: Fit) -> float:
    """Return when a point shows the next floor, on average: seconds after the last mark at the floor before.

    The destination is shown before the car is there, and the floor of the car only then.
    """
    delays = []
    for before, after in _trips(observed):
        values = track.between(before.at_s, after.at_s)
        code = fitting.value_of.get(after.floor)
        if code is not None and code in values:
            delays.append(list(values).index(code) / len(values))
    return sum(delays) / len(delays) if delays else 0.0


def _trips(observed: Sequence[Moment]) -> Iterator[tuple[Moment, Moment]]:
    """Yield the last mark at one floor and the first one at the next."""
    stands = [moment for moment in observed if moment.stands and moment.floor]
    for before, after in pairwise(stands):
        if before.floor != after.floor:
            yield before, after


def _code_text(value_of: Mapping[Any, int]) -> str:
    return "a number: " + ", ".join(f"{floor} is {code}" for floor, code in value_of.items())


def _as_number(
    best: Candidate,
    found: Sequence[Candidate],
    tracks: Tracks,
    observed: Sequence[Moment],
    stands: Sequence[Moment],
    named: Sequence[str],
    *,
    has_motion: bool,
) -> Position:
    track = _widened(best.track, tracks)
    raw = {name: best.fit.value_of[name] for name in named if name in best.fit.value_of}
    spec = place_spec(track) | {"as": "floor"} if best.rank[0] in (_NUMBER, _FIELD) else dict(best.spec)
    coding, codes = _coding(track, raw) if best.rank[0] == _NUMBER else ({}, raw)
    spec |= coding
    reasons = [f"{best.places}: {_code_text(codes)}"]
    others = _others(best, observed, raw, is_coded=bool(coding))
    spec |= {"unknown": list(others.unknown)} if others.unknown and not coding and not others.doubt else {}
    reasons += others.reasons
    rivals = rivals_of(best, found)
    early = [one for one in rivals if _shows_destination(one, observed)]
    reasons += [f"{one.places} fits as well, but shows the next stop before the car is there" for one in early]
    rivals = [one for one in rivals if one not in early]
    confidence = grade(best.fit, rivals, reasons, enough=_enough(stands, named), lacks=_LACKS)
    if others.doubt:
        reasons.append(others.doubt)
        confidence = Confidence.NOT_SURE
    if _shows_destination(best, observed):
        text = "it shows the next stop as soon as the car sets out, so it counts only while the car stands"
        if has_motion:
            spec["known_while"] = "stopped"
            reasons.append(text)
            confidence = confidence.at_most(Confidence.LIKELY)
        else:
            reasons.append(f"{text}; nothing was found that shows when it does")
            confidence = Confidence.NOT_SURE
    if best.rank[0] == _CODE:
        confidence = confidence.at_most(Confidence.LIKELY)
        reasons.append("bits that were the same at all floors named here may belong to it too")
    proposal = Proposal("car_floor", confidence, spec, tuple(reasons), track.points)
    return Position((proposal,), codes, others.cautions)


@dataclass(frozen=True, slots=True)
class _Others:
    """The values of a floor number that stand for no named floor."""

    unknown: tuple[int, ...]
    reasons: tuple[str, ...]
    cautions: tuple[str, ...]
    doubt: str
    """Why the number may be none at all; empty if there is no doubt."""


def _others(best: Candidate, observed: Sequence[Moment], raw: Mapping[str, int], *, is_coded: bool) -> _Others:
    between = _codes_between(best, observed, raw)
    unvisited = sorted(code for code in between if min(raw.values()) < code < max(raw.values()) and not is_coded)
    unknown = tuple(sorted(between - set(unvisited)))
    passed = f"car_floor: {', '.join(map(str, unvisited))} seen in passing: floors between the named ones where you did not stop"
    doubt = ""
    if len(unknown) > MOST_UNKNOWN:
        doubt = f"it has {len(unknown)} other values between floors, so it may be a length"
    elif unknown and not any(moment.kind is MarkKind.CLOSED for moment in observed):
        doubt = "no `-` was marked, so its other values may be those behind a closed door"
    reason = f"{', '.join(map(str, unknown))} between floors, taken for `not known`"
    has_reason = bool(unknown) and not is_coded and not doubt
    return _Others(unknown, (reason,) if has_reason else (), (passed,) if unvisited else (), doubt)


def _widened(track: Track, tracks: Tracks) -> Track:
    """Return a field with the bits above it that never were anything but 0, up to the end of its byte: further floors need them."""
    (point, *more) = track.points
    if more or point.table in BIT_TABLES or track.is_register:
        return track
    (register,) = (one for one in tracks.registers if one.points[0].cell == point.cell)
    ever = 0
    for value in register.values:
        ever |= value
    width = point.width
    while (point.low + width) % 8 and not ever >> (point.low + width) & 1:
        width += 1
    return replace(track, points=(replace(point, width=width),))


def _shows_destination(candidate: Candidate, observed: Sequence[Moment]) -> bool:
    """Whether it shows the next stop in nearly all marks of a moving car, and never a floor in passing."""
    if not isinstance(next(iter(candidate.fit.value_of), None), str):
        return False
    next_floor = {before.stand: after.floor for before, after in _trips(observed)}
    shown = [
        candidate.track.at(moment.at_s) == candidate.fit.value_of.get(next_floor[moment.stand])
        for moment in observed
        if not moment.stands and moment.stand in next_floor
    ]
    return len(shown) >= 3 and sum(shown) >= 0.9 * len(shown)


def _codes_between(best: Candidate, observed: Sequence[Moment], raw: Mapping[str, int]) -> set[int]:
    """Return the values that stand for no named floor, seen in more than one read of a move."""
    counts: dict[int, int] = {}
    for before, after in _trips(observed):
        for value in best.track.between(before.at_s, after.at_s):
            counts[value] = counts.get(value, 0) + 1
    return {value for value, count in counts.items() if count > 1 and value not in raw.values()}


def _coding(track: Track, raw: Mapping[str, int]) -> tuple[dict[str, Any], dict[str, int]]:
    """Return the keys that say how a number is coded, and the codes that it then has."""
    if not track.is_register:
        return {}, dict(raw)
    if all(value & 0xFF == 0 or value >> 8 == value & 0xFF for value in raw.values()) and any(
        v > 0xFF for v in raw.values()
    ):
        swapped = {name: value >> 8 | (value & 0xFF) << 8 for name, value in raw.items()}
        keys, codes = _coding_of(swapped)
        return {"byte_order": "low_first"} | keys, codes
    return _coding_of(dict(raw))


def _coding_of(raw: dict[str, int]) -> tuple[dict[str, Any], dict[str, int]]:
    if any(value >= 0x8000 for value in raw.values()):
        return {"type": "int16"}, {name: value - 0x10000 if value >= 0x8000 else value for name, value in raw.items()}
    decimal = {name: _from_bcd(value) for name, value in raw.items()}
    numbers = {name: int(digits) for name in raw if (digits := name.lstrip("LF")).isdecimal()}
    if len(numbers) == len(raw) and None not in decimal.values():
        as_it_is = {raw[name] - number for name, number in numbers.items()}
        as_bcd = {(decimal[name] or 0) - number for name, number in numbers.items()}
        if len(as_bcd) == 1 and len(as_it_is) > 1:
            return {"code": "bcd"}, {name: value or 0 for name, value in decimal.items()}
    return {}, raw


def _from_bcd(value: int) -> int | None:
    digits = f"{value:x}"
    return int(digits) if digits.isdecimal() else None


# -- a length


def _lengths(tracks: Tracks, observed: Sequence[Moment], named: Sequence[str]) -> Iterator[Candidate]:
    """Yield registers, and pairs of them, with a value near each floor, in order, and many values in between."""
    for track in tracks.registers:
        signed = track.mapped(lambda value: value - 0x10000 if value >= 0x8000 else value)
        for number, (kind, one) in enumerate((("uint16", track), ("int16", signed))):
            yield from _length(one, kind, number, observed, named)
    for track in tracks.pairs:
        swapped = replace(track, points=track.points[::-1]).mapped(lambda value: value >> 16 | (value & 0xFFFF) << 16)
        for order, one in (("high_first", track), ("low_first", swapped)):
            signed = one.mapped(lambda value: value - (1 << 32) if value >= 1 << 31 else value)
            for number, (kind, two) in enumerate((("uint32", one), ("int32", signed))):
                for candidate in _length(two, kind, 2 + number, observed, named):
                    candidate.spec["word_order"] = order
                    yield candidate


def _length(
    track: Track, kind: str, sort: int, observed: Sequence[Moment], named: Sequence[str]
) -> Iterator[Candidate]:
    if len(track.distinct) < 4 * len(named):
        return
    at: dict[str, list[int]] = {name: [] for name in named}
    for moment in observed:
        if moment.floor and (value := track.at(moment.at_s)) is not None:
            at[moment.floor].append(value)
    if not all(at.values()):
        return
    heights = [round(median(at[name])) for name in named]
    gaps = [high - low for low, high in pairwise(heights)]
    gap = min(map(abs, gaps))
    spread = max(max(values) - min(values) for values in at.values())
    tolerance = max(LEAST_TOLERANCE, 2 * spread, gap // 50)
    is_in_order = min(gaps) > 0 or max(gaps) < 0
    if not is_in_order or gap < LEAST_GAP or spread > DRIFT_SHARE * gap or 2 * tolerance + 1 >= gap:
        return
    if not _passes_between(track, observed, dict(zip(named, heights, strict=True))):
        return
    if 2 * max(abs(b - a) for a, b in pairwise(track.values)) > gap:
        return  # what jumps from one read to the next is a part of a length, or a floor number beside something else
    spec: dict[str, Any] = {"at": place(min(track.points))}
    if kind != "uint16":
        spec["type"] = kind
    spec |= {"positions": dict(enumerate(heights, start=1)), "tolerance": tolerance}
    text = ", ".join(f"{name} at {height}" for name, height in zip(named, heights, strict=True))
    words = f"a length or a count of steps: {text}, give or take {spread}"
    yield Candidate(track, spec, Fit({}), (_LENGTH, sort, *preference(track)), words)


def _passes_between(track: Track, observed: Sequence[Moment], heights: Mapping[str, int]) -> bool:
    """Whether it has values well between two floors on most ways from one to the other: a number of a floor jumps."""
    ways = [(before, after) for before, after in _trips(observed) if {before.floor, after.floor} <= heights.keys()]
    passing = 0
    for before, after in ways:
        low, high = sorted((heights[before.floor], heights[after.floor]))
        quarter = (high - low) / 4
        passing += sum(low + quarter < value < high - quarter for value in track.between(before.at_s, after.at_s)) >= 2
    return bool(ways) and passing >= 0.8 * len(ways)


def _as_length(best: Candidate, found: Sequence[Candidate], stands: Sequence[Moment], named: Sequence[str]) -> Position:
    codes = {name: code for code, name in enumerate(named, start=1)}
    reasons = [f"{' and '.join(place(point) for point in sorted(best.track.points))}: {best.words}"]
    rivals = [one for one in rivals_of(best, found) if one.rank[1] == best.rank[1]]
    confidence = grade(best.fit, rivals, reasons, enough=_enough(stands, named), lacks=_LACKS)
    points = tuple(Point(point.table, point.address, 0, 16) for point in best.track.points)
    return Position((Proposal("car_position", confidence, best.spec, tuple(reasons), points),), codes)
