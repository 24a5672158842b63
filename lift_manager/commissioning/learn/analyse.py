"""From a recording to proposals: which points show position, door, motion and life, how sure that is, and why. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import mean, pstdev

from lift_manager.commissioning.learn.doors import door
from lift_manager.commissioning.learn.motion import level, motion
from lift_manager.commissioning.learn.position import position
from lift_manager.commissioning.learn.ride import missing_marks
from lift_manager.commissioning.learn.samples import MarkKind, Recording
from lift_manager.commissioning.learn.tracks import (
    FRESH_S,
    Confidence,
    Moment,
    Proposal,
    Track,
    Tracks,
    moments,
    period_s,
    preference,
    same_meaning,
    tracks,
)
from register_maps.points import Point

LEAST_BEATS = 20
"""Changes of a counter within one recording. Chosen: fewer may be the floors that were passed."""
LONGEST_PAUSE_S = 5.0
"""A counter that stands still for longer is too slow to show that a program runs."""
REGULAR = 0.5
"""A bit whose times between changes differ by more than this share of their mean is noise, not a heartbeat."""
MOST_UNEXPLAINED = 30
"""Points of the list of what is not understood. Chosen: a page."""


@dataclass(frozen=True, slots=True)
class Findings:
    """What an analysis came to."""

    proposals: tuple[Proposal, ...]
    """The ones that are not sure too."""
    codes: Mapping[str, int]
    """The code of each floor for the site file, lowest first."""
    evidence: Mapping[str, object]
    """What shows that the car stands, as the map has it."""
    unexplained: tuple[str, ...]
    """Points that changed, and what they showed, in words."""
    cautions: tuple[str, ...]
    missing: tuple[str, ...]
    """What the ride lacks, in words."""

    def of(self, signal: str) -> Proposal | None:
        """Return the proposal for a signal."""
        return next((proposal for proposal in self.proposals if proposal.signal == signal), None)

    def usable(self) -> tuple[Proposal, ...]:
        """Return the proposals that the draft contains as signals."""
        return tuple(proposal for proposal in self.proposals if proposal.confidence is not Confidence.NOT_SURE)


def analyse(recording: Recording) -> Findings:
    """Return what a recording shows."""
    observed = moments(recording)
    everything = tracks(recording.blocks)
    alive = _alive(everything)
    rest = everything.without(point for track in _counters(everything) for point in track.points)
    moving = motion(rest, observed)
    where = position(
        rest,
        observed,
        recording.floors,
        has_motion=moving is not None and moving.confidence is not Confidence.NOT_SURE,
    )
    is_certain = {proposal.signal for proposal in where.proposals if proposal.confidence is not Confidence.NOT_SURE}
    one_door = None if where.is_door_limit else door(rest, observed)
    others = [point for one in (*where.proposals, one_door, moving) if one is not None for point in one.points]
    standing = level(rest.without(others), observed) if moving is not None else None
    proposals = [one for one in (*where.proposals, one_door, moving, standing, alive) if one is not None]
    proposals = list(_without_shared_points(proposals))
    used = [point for proposal in proposals for point in proposal.points]
    return Findings(
        tuple(proposals),
        where.codes,
        _evidence(moving, is_certain, is_door_limit=where.is_door_limit),
        tuple(_unexplained(everything, used, _counters(everything))),
        (*where.cautions, *_cautions(recording, everything, observed)),
        tuple(missing_marks(recording)),
    )


def _without_shared_points(proposals: Sequence[Proposal]) -> Iterator[Proposal]:
    """Yield the proposals; one that takes points of an earlier one is not sure, unless both are the limits of the door."""
    taken: dict[Point, str] = {}
    for proposal in proposals:
        owner = next((taken[point] for point in proposal.points if point in taken), "")
        if owner and {owner, proposal.signal} != {"car_floor", "door.front"}:
            reasons = (*proposal.reasons, f"the same point was taken for {owner}")
            yield Proposal(proposal.signal, Confidence.NOT_SURE, proposal.spec, reasons, proposal.points)
            continue
        taken |= dict.fromkeys(proposal.points, proposal.signal)
        yield proposal


# -- signs of life


def _counters(found: Tracks) -> list[Track]:
    counters = [track for track in found.registers if _counts(track)]
    return counters + [track for track in found.binary if _toggles(track)]


def _counts(track: Track) -> bool:
    """Whether a register counts up all the time, whatever the lift does."""
    steps = [(after - before) & 0xFFFF for before, after in pairwise(track.values)]
    counted = [step for step in steps if step]
    return len(counted) >= LEAST_BEATS and max(counted) < 0x4000 and _longest_pause_s(track) <= LONGEST_PAUSE_S


def _toggles(track: Track) -> bool:
    """Whether a bit changes at regular times, whatever the lift does."""
    times = [
        at_s for at_s, (before, after) in zip(track.times[1:], pairwise(track.values), strict=True) if before != after
    ]
    gaps = [b - a for a, b in pairwise(times)]
    if len(times) < LEAST_BEATS or _longest_pause_s(track) > LONGEST_PAUSE_S:
        return False
    return pstdev(gaps) <= REGULAR * mean(gaps)


def _longest_pause_s(track: Track) -> float:
    times = [at_s for at_s, (a, b) in zip(track.times[1:], pairwise(track.values), strict=True) if a != b]
    return max((b - a for a, b in pairwise([track.times[0], *times, track.times[-1]])), default=0.0)


def _alive(found: Tracks) -> Proposal | None:
    counters = _counters(found)
    if not counters:
        return None
    best = min(counters, key=lambda track: (track.is_bit, _longest_pause_s(track) > 2, *preference(track)))
    pause_s = _longest_pause_s(best)
    steps = {(after - before) & 0xFFFF for before, after in pairwise(best.values)} - {0}
    sort = "a bit that changes to and fro" if len(best.distinct) == 2 else f"it counts up, by {_range(steps)}"
    reasons = [
        f"{best.place}: {sort}, {best.changes} times, never still for more than {pause_s:.1f} s, whatever the lift did"
    ]
    others = [track.place for track in counters if track is not best and not _is_part(track, best)]
    if others:
        reasons.append(
            f"so do {', '.join(others[:5])}; one of them may be a clock that runs on when the lift's program stops"
        )
    is_sure = len(best.distinct) > 2 and not others
    if not is_sure and not others:
        reasons.append("the program of the lift may not be what makes it")
    spec = {"at": best.place, "type": "counter", "must_change_within_s": round(max(3.0, 3 * pause_s))}
    confidence = Confidence.SURE if is_sure else Confidence.LIKELY
    return Proposal("alive", confidence, spec, tuple(reasons), best.points)


def _is_part(track: Track, whole: Track) -> bool:
    return {point.cell for point in track.points} <= {point.cell for point in whole.points}


def _range(steps: set[int]) -> str:
    return str(min(steps)) if len(steps) == 1 else f"{min(steps)} to {max(steps)} from read to read"


# -- what else there is to say


def _evidence(moving: Proposal | None, certain: set[str], *, is_door_limit: bool) -> Mapping[str, object]:
    if is_door_limit and certain >= {"car_floor", "door.front"}:
        return {"kind": "door_limit"}
    if moving is not None and moving.confidence is not Confidence.NOT_SURE:
        return {"kind": "motion_stopped"}
    return {"kind": "position_stable", "for_s": 2.0}


def _cautions(recording: Recording, found: Tracks, observed: Sequence[Moment]) -> Iterator[str]:
    missing = set(recording.named_floors) - set(recording.floors)
    if missing:
        yield f"the height of {', '.join(sorted(missing))} is not known: give every floor with --floors, lowest first"
    every = [*found.binary, *found.registers]
    slow = max((period_s(track) for track in every), default=0.0)
    if slow > FRESH_S / 2:
        yield f"all of it takes {slow:.1f} s to read, so that short states are missed: name the addresses that changed with --from and --to"
    stale = sum(any(track.at(moment.at_s) is None for track in every) for moment in observed)
    if stale:
        yield f"{stale} of {len(observed)} marks have points that were not read near them; those marks count for less"
    if not every:
        yield "nothing that was read ever changed: this may be the wrong unit, or the lift's program writes nothing here"
    if not any(mark.kind is MarkKind.OPEN for mark in recording.marks):
        yield "no floor was named, so nothing can be told apart"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _unexplained(found: Tracks, used: Sequence[Point], counters: Sequence[Track]) -> Iterator[str]:
    every = [*found.binary, *found.registers, *found.fields]
    explained = [track for track in every if set(track.points) <= set(used)]
    counting = [point for track in counters for point in track.points]
    rest = found.without([*used, *counting])
    registers = {track.points[0].cell for track in rest.registers}
    listed = [track for track in rest.binary if track.is_bit and track.points[0].cell not in registers]
    listed += [track for track in rest.registers if track.points[0].cell in registers]
    for number, track in enumerate(sorted(listed, key=preference)):
        if number == MOST_UNEXPLAINED:
            yield f"and {len(listed) - number} more"
            return
        values = sorted(track.distinct)
        shown = (
            ", ".join(map(str, values))
            if len(values) <= 5
            else f"{len(values)} values from {values[0]} to {values[-1]}"
        )
        twin = next((other.place for other in explained if same_meaning(track, other)), "")
        yield f"{track.place} changed {_times(track.changes)}: {shown}" + (f"; it goes with {twin}" if twin else "")
