"""Who waits for one lift: first come, first served. Nothing here waits, and no person stands in it."""

from __future__ import annotations

from drivers.sparing import CALLERS
from lift_manager.domain.asking import Blocking, Refusal, Refused
from lift_manager.domain.rmf import FACE, rmf_session
from lift_manager.domain.state import Holder

WAITS_AS_ONE = frozenset({FACE, "workshop"})
"""Faces whose callers do nothing but ask again while another holds the lift: each waits as one, for all its callers."""
ASKS_AGAIN = WAITS_AS_ONE | {"api"}
"""Faces whose callers stand in line because they were refused, for as long as they ask again. Rides join and leave by themselves."""
HEARD_WITHIN_S = 5.0
"""Whoever asks again no longer waits when it was not heard for so long. RMF asks once a second (open-rmf 1.6)."""


class WaitingLine:
    """The line before one lift. Entries are holders, and faces whose callers wait as one."""

    def __init__(self, lift: str) -> None:
        self._lift = lift
        self._line: list[Holder | str] = []
        self._heard_at: dict[Holder | str, float] = {}
        """Of those in the line who have to ask again."""
        self._left = 0

    @property
    def left(self) -> int:
        """How many have left the line so far, each of whom let those behind move up."""
        return self._left

    def join(self, holder: Holder, now: float) -> None:
        """Stand in line, at its end; one that stands there keeps its place."""
        self._lapse(now)
        if (place := _place_of(holder)) not in self._line:
            self._line.append(place)
        if holder.face in ASKS_AGAIN:
            self._heard_at[place] = now

    def leave(self, holder: Holder) -> None:
        """Stand in line no longer: its turn has come, or it wants the lift no more."""
        self._remove(_place_of(holder))

    def refused(self, holder: Holder, answer: Refused, now: float) -> None:
        """Hear what a caller was told: one that has to wait stands in line from then on; of more than `CALLERS` nobody keeps a list."""
        if holder.face not in ASKS_AGAIN or answer.code not in (Refusal.HELD, Refusal.QUEUED):
            return
        if _place_of(holder) in self._heard_at or len(self._heard_at) < CALLERS:
            self.join(holder, now)

    def first(self, now: float) -> Holder | str | None:
        """Return who comes first: a holder, or a face that waits as one; None for an empty line."""
        self._lapse(now)
        return self._line[0] if self._line else None

    def ahead(self, holder: Holder, now: float) -> int:
        """Return how many come before this holder, whether or not it stands in line."""
        self._lapse(now)
        place = _place_of(holder)
        return self._line.index(place) if place in self._line else len(self._line)

    def length(self, now: float) -> int:
        """Return how many wait."""
        self._lapse(now)
        return len(self._line)

    def why_not_yet(self, holder: Holder, now: float) -> Refused | None:
        """Refuse a lift that is free to everybody but the first in line."""
        if (ahead := self.ahead(holder, now)) == 0:
            return None
        text = (
            f"{self._lift} is free, and {ahead} that waited for it {'comes' if ahead == 1 else 'come'} first; ask again"
        )
        return Refused(Refusal.QUEUED, text, Blocking(ahead=ahead))

    def _remove(self, place: Holder | str) -> None:
        self._heard_at.pop(place, None)
        if place in self._line:
            self._line.remove(place)
            self._left += 1

    def _lapse(self, now: float) -> None:
        for place in [place for place, at in self._heard_at.items() if now - at > HEARD_WITHIN_S]:
            self._remove(place)


def _place_of(holder: Holder) -> Holder | str:
    if holder.face == FACE:
        _, adapter = rmf_session(holder)
        return f"{FACE}@{adapter}" if adapter else FACE  # each RMF for itself
    return holder.face if holder.face in WAITS_AS_ONE else holder
