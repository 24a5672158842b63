"""Which points show the car door: one contact, two limits, or a word. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from lift_manager.commissioning.learn.motion import (
    Candidate,
    address,
    grade,
    is_calm,
    place_spec,
    points_of,
    rivals_of,
)
from lift_manager.commissioning.learn.samples import MarkKind
from lift_manager.commissioning.learn.tracks import (
    OPEN,
    Confidence,
    Fit,
    Moment,
    Proposal,
    Track,
    Tracks,
    fit,
    fit_kinds,
    preference,
    share_of,
)

MOST_WORDS = 8
"""A point with more values than these is a number, such as a door position in percent."""

_WORD, _LIMITS, _FIELD, _OPEN_CONTACT, _CLOSED_CONTACT, _CONTACT = range(6)
"""The sorts of a door signal, the one that says most first."""


def door(tracks: Tracks, observed: Sequence[Moment]) -> Proposal | None:
    """Propose the door of the car."""
    found = sorted(_candidates(tracks, observed), key=lambda candidate: candidate.rank)
    if not found:
        return None
    best = found[0]
    count = {kind: sum(moment.kind is kind for moment in observed) for kind in MarkKind}
    marks = f"{count[MarkKind.OPEN]} marks of an open door, {count[MarkKind.MOVING]} of a moving car"
    reasons = [
        f"{best.places}: {best.words}",
        f"in {marks} and {count[MarkKind.CLOSED]} of a standing car with its door closed",
    ]
    if not count[MarkKind.CLOSED]:
        reasons.append(
            "no `-` was marked, so a point that shows the door cannot be told from one that shows that the car stands"
        )
        return Proposal("door.front", Confidence.NOT_SURE, best.spec, tuple(reasons), points_of(best))
    if best.rank[0] == _CONTACT:
        reasons.append(
            "whether it shows the fully open door, or one that is not closed, is not known: mark `/` while the door moves"
        )
        return Proposal("door.front", Confidence.NOT_SURE, best.spec, tuple(reasons), points_of(best))
    if best.rank[0] == _CLOSED_CONTACT:
        reasons.append("it shows nothing of a fully open door: with `moving` no robot ever sees it open")
    enough = count[MarkKind.OPEN] >= 3 and count[MarkKind.MOVING] >= 3 and count[MarkKind.CLOSED] >= 2
    enough = enough and count[MarkKind.DOOR] >= 2
    if count[MarkKind.OPEN] < 2 or count[MarkKind.MOVING] < 2:
        reasons.append("too few marks")
        return Proposal("door.front", Confidence.NOT_SURE, best.spec, tuple(reasons), points_of(best))
    confidence = grade(
        best.fit, rivals_of(best, found), reasons, enough=enough, lacks="marks: `/` twice, `-` twice, three stops"
    )
    return Proposal("door.front", confidence, best.spec, tuple(reasons), points_of(best))


def _candidates(tracks: Tracks, observed: Sequence[Moment]) -> Iterator[Candidate]:
    contacts = list(_contacts(tracks.binary, observed))
    yield from _words(tracks.registers, observed, _WORD)
    yield from _limits(contacts)
    yield from _words(tracks.fields, observed, _FIELD)
    for contact in contacts:
        yield _single(contact)


@dataclass(frozen=True, slots=True)
class _Contact:
    """A point with one value at an open door, and another at a closed one."""

    track: Track
    fit: Fit
    at_open: int
    at_closed: int
    at_moving_door: int | None
    """None if that is not known."""


def _contacts(found: Iterable[Track], observed: Sequence[Moment]) -> Iterator[_Contact]:
    whole = [moment for moment in observed if moment.kind is not MarkKind.DOOR]
    moving = [("door", moment) for moment in observed if moment.kind is MarkKind.DOOR]
    for track in found:
        fitting = fit_kinds(track, whole, OPEN)
        if fitting is not None and is_calm(track, observed):
            between = fit(track, moving)
            at_door = None if between is None else between.value_of.get("door")
            yield _Contact(track, fitting, fitting.value_of[True], fitting.value_of[False], at_door)


def _single(contact: _Contact) -> Candidate:
    track, at_open, at_closed = contact.track, contact.at_open, contact.at_closed
    both = f"{at_open} at an open door, {at_closed} while the car moves and at a closed door"
    if contact.at_moving_door is None:
        spec: dict[str, Any] = {"at": address(track), "values": {at_closed: "closed", at_open: "moving"}}
        return Candidate(track, spec, contact.fit, (_CONTACT, share_of(track, at_open), *preference(track)), both)
    if contact.at_moving_door == at_closed:
        spec = {"at": address(track)}
        if not track.is_bit:
            spec["values"] = {at_closed: "closed", at_open: "open"}
        elif not at_open:
            spec["active"] = "low"
        words = f"{both}, {at_closed} while the door moves: it is the contact of the fully open door"
        return Candidate(track, spec, contact.fit, (_OPEN_CONTACT, share_of(track, at_open), *preference(track)), words)
    spec = {"at": address(track), "values": {at_open: "moving", at_closed: "closed"}}
    words = f"{both}, {at_open} while the door moves: it is the contact of the closed door"
    return Candidate(track, spec, contact.fit, (_CLOSED_CONTACT, share_of(track, at_closed), *preference(track)), words)


def _limits(contacts: Sequence[_Contact]) -> Iterator[Candidate]:
    bits = [contact for contact in contacts if contact.track.is_bit]
    # a contact of which no `/` tells what it is may be either; then there has to be a time in which neither is made
    opens = [contact for contact in bits if contact.at_moving_door in (contact.at_closed, None)]
    closeds = [contact for contact in bits if contact.at_moving_door in (contact.at_open, None)]
    for opened in opens:
        for closed in closeds:
            if opened.at_open != closed.at_closed or opened.track.points[0].table is not closed.track.points[0].table:
                continue  # `active` is for both limits
            on = opened.at_open
            if None in (opened.at_moving_door, closed.at_moving_door) and not _has_gap(opened.track, closed.track, on):
                continue
            spec: dict[str, Any] = {"open_limit": address(opened.track), "closed_limit": address(closed.track)}
            if not on:
                spec["active"] = "low"
            both = Fit({}, (*opened.fit.misfits, *closed.fit.misfits))
            length = share_of(opened.track, on) + share_of(closed.track, on)
            rank = (_LIMITS, length, *preference(opened.track), *preference(closed.track))
            words = f"the first is {on} at an open door only, the second at a closed one only; neither while it moves"
            yield Candidate(opened.track, spec, both, rank, words, (opened.track, closed.track))


def _has_gap(opened: Track, closed: Track, on: int) -> bool:
    """Whether two contacts are never made at once, and neither of them at times."""
    neither = both = 0
    for at_s, value in zip(opened.times, opened.values, strict=True):
        other = closed.at(at_s)
        neither += on not in (value, other)
        both += value == on and other == on
    return neither >= 4 and not both


def _words(found: Iterable[Track], observed: Sequence[Moment], rank: int) -> Iterator[Candidate]:
    whole = [moment for moment in observed if moment.kind is not MarkKind.DOOR]
    door_moves = [moment for moment in observed if moment.kind is MarkKind.DOOR]
    for track in found:
        if not 3 <= len(track.distinct) <= MOST_WORDS or not is_calm(track, observed):
            continue
        if (fitting := fit_kinds(track, whole, OPEN)) is None:
            continue
        opened, closed = fitting.value_of[True], fitting.value_of[False]
        if any(track.at(moment.at_s) == opened for moment in door_moves):
            continue  # it says `open` of a door that is not fully open
        words = _between(track, opened, closed)
        values = {closed: "closed", opened: "open"} | words
        spec = {**place_spec(track), "values": dict(sorted(values.items()))}
        text = ", ".join(f"{code} {word}" for code, word in sorted(values.items()))
        places = (rank, track.points[0].width, *preference(track))
        yield Candidate(track, spec, fitting, places, f"a word: {text}")


def _between(track: Track, opened: int, closed: int) -> dict[int, str]:
    """Return the words for the codes between an open and a closed door, by their order."""
    opening: dict[int, int] = {}
    closing: dict[int, int] = {}
    for before, after in pairwise(track.values):
        if before == closed and after not in (opened, closed):
            opening[after] = opening.get(after, 0) + 1
        elif before == opened and after not in (opened, closed):
            closing[after] = closing.get(after, 0) + 1
    words: dict[int, str] = {}
    for code in track.distinct - {opened, closed}:
        first, last = opening.get(code, 0), closing.get(code, 0)
        if first > 2 * last:
            words[code] = "opening"
        elif last > 2 * first:
            words[code] = "closing"
        elif first or last:
            words[code] = "moving"
    return words
