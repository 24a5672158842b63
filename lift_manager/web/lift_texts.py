"""The JSON of lifts, kept between two readings: only the seconds in it are written anew."""

from __future__ import annotations

import math
from typing import NamedTuple

from lift_manager.api.fields import to_ms
from lift_manager.api.lifts import Lift
from lift_manager.lift.state import LiftState, same_but_for_time
from lift_manager.runtime.site import Site

_SECONDS = (b'"age_s":', b'"for_s":', b'"releases_in_s":')
"""What comes before a value that changes with time alone, in their order. No text within the JSON has it: its quotes are escaped."""


class LiftText(NamedTuple):
    """A lift as JSON, with and without what changes with time alone."""

    bare: bytes
    """Without ages: the age is null and `for_s` 0. The reason stays, because seconds in it may be a limit as well as an age.
    `releases_in_s` is the moment of the release, which a renewal moves."""
    pieces: tuple[bytes, ...]
    """The same around these values."""
    state: LiftState
    age_s: float | None

    @classmethod
    def of(cls, state: LiftState, max_age_s: float) -> LiftText:
        """Return the text of a state that was worked out just now."""
        lift = Lift.of(state, max_age_s=max_age_s)
        session = None if lift.session is None else lift.session.model_copy(update={"for_s": 0.0})
        changes = {"age_s": None, "session": session, "releases_in_s": state.releases_at}
        bare = lift.model_copy(update=changes).model_dump_json().encode()
        return cls(bare, _pieces(bare), state, state.age_s)

    def whole(self) -> bytes:
        """Return the lift as it is published at this age."""
        state = self.state
        # while a lift is live, nothing but time has passed since its state was worked out
        by_s = (self.age_s or 0.0) - (state.age_s or 0.0)
        seconds = [self.age_s]
        if state.holder is not None:
            seconds.append((state.held_since_s or 0.0) + by_s)
        seconds.append(None if state.releases_in_s is None else max(0.0, state.releases_in_s - by_s))
        *before, end = self.pieces
        return b"".join([part for pair in zip(before, map(_json, seconds), strict=True) for part in pair]) + end


class LiftTexts:
    """The newest text of each lift of a site."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._newest: dict[str, LiftText] = {}

    def of(self, lift: str) -> LiftText:
        """Return a lift as it is now."""
        state, newest = self._site.lasting_state(lift), self._newest.get(lift)
        if newest is None or not _same_text(state, newest.state):
            newest = LiftText.of(state, self._site.config(lift).capabilities.max_age_s)
        newest = self._newest[lift] = LiftText(newest.bare, newest.pieces, state, self._site.age_s(lift))
        return newest


def _same_text(one: LiftState, other: LiftState) -> bool:
    return one is other or (
        same_but_for_time(one, other) and (one.reason, one.releases_at) == (other.reason, other.releases_at)
    )


def _pieces(bare: bytes) -> tuple[bytes, ...]:
    pieces = []
    for key in _SECONDS:
        before, found, rest = bare.partition(key)
        if found:  # a free lift is not held for any time
            pieces.append(before + key)
            bare = rest[rest.index(b",") :]
    return (*pieces, bare)


def _json(seconds: float | None) -> bytes:
    return b"null" if seconds is None or math.isinf(seconds) else b"%a" % to_ms(seconds)
