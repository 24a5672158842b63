"""Which points show whether the car moves, and where to; and which show that it stands level. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from lift_manager.commissioning.learn.samples import MarkKind
from lift_manager.commissioning.learn.tracks import (
    STANDS,
    Confidence,
    Fit,
    Moment,
    Proposal,
    Track,
    Tracks,
    bits_of,
    fit,
    fit_kinds,
    preference,
    same_meaning,
    share_of,
)

MOST_WORDS = 6
"""A point with more values than these is a number, not a word for the motion."""
NEEDS_CLOSED = "no `-` was marked, so a point that shows the motion cannot be told from one that shows the door"


@dataclass(frozen=True, slots=True)
class Candidate:
    """One way to read a signal from the registers."""

    track: Track
    spec: dict[str, Any]
    fit: Fit
    rank: tuple[float, ...]
    """The lowest is best; candidates that agree in its first number are rivals."""
    words: str
    points: tuple[Track, ...] = field(default=())
    """If it is made of several tracks."""

    @property
    def places(self) -> str:
        """Its addresses as the draft writes them."""
        return " and ".join(track.place for track in self.points or (self.track,))


def motion(tracks: Tracks, observed: Sequence[Moment]) -> Proposal | None:
    """Propose the motion of the car."""
    found = sorted(_motions(tracks, observed), key=lambda candidate: candidate.rank)
    if not found:
        return None
    best = found[0]
    has_direction = best.rank[0] < _NO_DIRECTION
    rivals = rivals_of(best, found)
    moves = [moment for moment in observed if not moment.stands]
    count = {way: sum(moment.direction == way for moment in moves) for way in (1, -1)}
    stands = sum(moment.stands for moment in observed)
    reasons = [f"{best.places}: {best.words}", f"in {len(moves)} marks of a moving car and {stands} of a standing one"]
    if not has_direction:
        reasons.append("it does not show the direction")
    if not has_direction and not any(moment.kind is MarkKind.CLOSED for moment in observed):
        confidence = Confidence.NOT_SURE
        reasons.append(NEEDS_CLOSED)
    elif len(moves) < 2 or (has_direction and min(count.values()) < 1):
        confidence = Confidence.NOT_SURE
        reasons.append("too few marks of a moving car")
    else:
        enough = len(moves) >= 4 and (not has_direction or min(count.values()) >= 2)
        confidence = grade(best.fit, rivals, reasons, enough=enough, lacks="marks of a moving car, up and down")
    return Proposal("motion", confidence, best.spec, tuple(reasons), points_of(best))


def level(tracks: Tracks, observed: Sequence[Moment]) -> Proposal | None:
    """Propose a point that shows that the car stands, besides the motion that was found."""
    found = []
    for track in tracks.binary:
        fitting = fit_kinds(track, observed, STANDS)
        if fitting is None or not is_calm(track, observed):
            continue
        stands = fitting.value_of[True]
        if _blinks(track, observed, stands):
            continue  # it also comes on where the car passes a floor: a door zone
        spec: dict[str, Any] = {"at": address(track)}
        if stands not in (0, 1) or fitting.value_of[False] not in (0, 1):
            continue
        if not stands:
            spec["active"] = "low"
        words = f"{stands} in all marks of a standing car, {1 - stands} while it moves"
        found.append(Candidate(track, spec, fitting, (0, share_of(track, stands), *preference(track)), words))
    found.sort(key=lambda candidate: candidate.rank)
    if not found:
        return None
    best = found[0]
    reasons = [f"{best.places}: {best.words}; it may be `level`, or another word for not moving"]
    if not any(moment.kind is MarkKind.CLOSED for moment in observed):
        return Proposal("level", Confidence.NOT_SURE, best.spec, (*reasons, NEEDS_CLOSED), points_of(best))
    rivals = rivals_of(best, found)
    confidence = grade(
        best.fit, rivals, reasons, enough=False, lacks="proof that it means level, and not merely stopped"
    )
    return Proposal("level", confidence, best.spec, tuple(reasons), points_of(best))


_WORD, _TWO_BITS, _FIELD, _NO_DIRECTION = 0, 1, 2, 3


def _motions(tracks: Tracks, observed: Sequence[Moment]) -> Iterator[Candidate]:
    directed = [(_direction_of(moment), moment) for moment in observed if moment.stands or moment.direction]
    if {way for way, _ in directed} >= {0, 1, -1}:
        yield from _words(tracks.registers, directed, observed, _WORD)
        yield from _two_bits(tracks, directed, observed)
        yield from _words(tracks.fields, directed, observed, _FIELD)
    for track in tracks.binary:
        fitting = fit_kinds(track, observed, STANDS)
        if fitting is not None and is_calm(track, observed) and not _blinks(track, observed, fitting.value_of[True]):
            stopped, moves = fitting.value_of[True], fitting.value_of[False]
            spec = {"at": address(track), "values": {stopped: "stopped", moves: "moving"}}
            words = f"{stopped} in all marks of a standing car, {moves} while it moves"
            # a contact that is made while the car moves comes before one that is made while it stands: that is `level`
            yield Candidate(
                track,
                spec,
                fitting,
                (_NO_DIRECTION, moves < stopped, share_of(track, moves), *preference(track)),
                words,
            )


def _direction_of(moment: Moment) -> int:
    return 0 if moment.stands else moment.direction


def _words(
    found: Iterable[Track], directed: Sequence[tuple[int, Moment]], observed: Sequence[Moment], rank: int
) -> Iterator[Candidate]:
    for track in found:
        fitting = fit(track, directed)
        if fitting is None or len(set(fitting.value_of.values())) < 3 or len(track.distinct) > MOST_WORDS:
            continue
        if not is_calm(track, observed):
            continue
        stopped, up, down = (fitting.value_of[way] for way in (0, 1, -1))
        spec = {**place_spec(track), "values": {stopped: "stopped", up: "up", down: "down"}}
        words = f"{stopped} while the car stands, {up} on the way up, {down} on the way down"
        yield Candidate(track, spec, fitting, (rank, track.points[0].width, *preference(track)), words)


def _two_bits(
    tracks: Tracks, directed: Sequence[tuple[int, Moment]], observed: Sequence[Moment]
) -> Iterator[Candidate]:
    for_up: list[tuple[Track, Fit, int]] = []
    for_down: list[tuple[Track, Fit, int]] = []
    for track in tracks.binary:
        if not track.is_bit or not is_calm(track, observed):
            continue
        fitting = fit(track, directed)
        for way, bits in ((1, for_up), (-1, for_down)):
            if fitting is not None and fitting.value_of[way] != fitting.value_of[0] == fitting.value_of[-way]:
                bits.append((track, fitting, fitting.value_of[way]))
    for up, up_fit, level_of_up in for_up:
        for down, down_fit, level_of_down in for_down:
            if level_of_up == level_of_down and up.points[0].table is down.points[0].table:
                spec: dict[str, Any] = {"up": address(up), "down": address(down)}
                if not level_of_up:
                    spec["active"] = "low"
                both = Fit({}, (*up_fit.misfits, *down_fit.misfits))
                on = share_of(up, level_of_up) + share_of(down, level_of_down)
                words = f"the first is {level_of_up} only on the way up, the second only on the way down"
                rank = (_TWO_BITS, on, *preference(up), *preference(down))
                yield Candidate(up, spec, both, rank, words, (up, down))


def _blinks(track: Track, observed: Sequence[Moment], standing: int) -> bool:
    """Whether a point shows for a while, during a move, what it shows while the car stands."""
    for moment, following in pairwise(observed):
        if moment.stands:
            continue
        values = track.between(moment.at_s, following.at_s)
        if following.stands:
            if sum(a != b for a, b in pairwise(values)) > 1:
                return True
        elif standing in values and moment.stand == following.stand:
            return True
    return False


# -- shared with doors and position


def is_calm(track: Track, observed: Sequence[Moment]) -> bool:
    """Whether a point changes about as often as a car starts and stops and its door moves, and not all the time."""
    stops = 1 + max((moment.stand for moment in observed), default=0)
    return track.changes <= 8 * stops + 8


def place_spec(track: Track) -> dict[str, Any]:
    """Return the keys of a map that name a point, or a field in a register."""
    (point,) = track.points
    if track.is_bit or track.is_register:
        return {"at": address(track)}
    return {"at": f"{point.table}:{point.address}", "bits": [point.low, point.low + point.width - 1]}


def address(track: Track) -> str:
    """Return the address of a bit or of a whole register."""
    return track.place


def points_of(candidate: Candidate) -> tuple[Any, ...]:
    """Return every point of a candidate."""
    return tuple(point for track in candidate.points or (candidate.track,) for point in track.points)


def rivals_of(best: Candidate, found: Sequence[Candidate]) -> list[Candidate]:
    """Return the other candidates of the same sort that do not merely mirror the best one."""
    mine = {bit for point in points_of(best) for bit in bits_of(point)}
    return [
        other
        for other in found
        if other is not best
        and other.rank[0] == best.rank[0]
        and mine.isdisjoint(bit for point in points_of(other) for bit in bits_of(point))
        and not _mirrors(best, other)
    ]


def _mirrors(best: Candidate, other: Candidate) -> bool:
    pairs = zip(best.points or (best.track,), other.points or (other.track,), strict=False)
    return all(same_meaning(one, two) for one, two in pairs)


def grade(fitting: Fit, rivals: Sequence[Candidate], reasons: list[str], *, enough: bool, lacks: str) -> Confidence:
    """Return how sure a proposal is that has some support; adds to the reasons why it is not sure."""
    if fitting.misfits:
        at = ", ".join(f"{int(moment.at_s) // 60:02}:{int(moment.at_s) % 60:02}" for moment in fitting.misfits)
        reasons.append(f"it does not fit what was marked at {at}")
    if rivals:
        reasons.append(
            f"{', '.join(rival.places for rival in rivals[:4])} fit as well, and behave differently at times"
        )
    if not enough:
        reasons.append(f"to be sure it needs more {lacks}" if "proof" not in lacks else f"there is no {lacks}")
    return Confidence.SURE if enough and not fitting.misfits and not rivals else Confidence.LIKELY
