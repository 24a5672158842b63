"""Who waits for one lift: first come, first served. Nothing here waits, and no person stands in it."""

from __future__ import annotations

from lift_manager.domain.asking import Blocking, Refusal, Refused
from lift_manager.domain.state import Holder

ASKS_AGAIN = frozenset({"rmf"})
"""Faces whose callers do nothing but ask again while another holds the lift: each waits as one, for all its callers."""
HEARD_WITHIN_S = 5.0
"""Such a face no longer waits when it was not heard for so long. RMF asks once a second (open-rmf 1.6)."""


class WaitingLine:
    """The line before one lift. Entries are holders, which stay until they leave, and faces that ask again."""

    def __init__(self, lift: str) -> None:
        self._lift = lift
        self._line: list[Holder | str] = []
        self._heard_at: dict[str, float] = {}
        """Of the faces in the line."""

    def join(self, holder: Holder, now: float) -> None:
        """Stand in line, at its end; one that stands there keeps its place."""
        self._lapse(now)
        if (place := _place_of(holder)) not in self._line:
            self._line.append(place)
        if isinstance(place, str):
            self._heard_at[place] = now

    def leave(self, holder: Holder) -> None:
        """Stand in line no longer: its turn has come, or it wants the lift no more."""
        place = _place_of(holder)
        if place in self._line:
            self._line.remove(place)
        if isinstance(place, str):
            self._heard_at.pop(place, None)

    def refused(self, holder: Holder, answer: Refused, now: float) -> None:
        """Hear what a caller was told: one that has to wait and asks again stands in line from then on."""
        if holder.face in ASKS_AGAIN and answer.code in (Refusal.HELD, Refusal.QUEUED):
            self.join(holder, now)

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

    def _lapse(self, now: float) -> None:
        for face in [face for face, at in self._heard_at.items() if now - at > HEARD_WITHIN_S]:
            del self._heard_at[face]
            self._line.remove(face)


def _place_of(holder: Holder) -> Holder | str:
    return holder.face if holder.face in ASKS_AGAIN else holder
