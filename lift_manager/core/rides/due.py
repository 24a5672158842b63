"""For which rides something has happened."""

from __future__ import annotations

from collections.abc import Iterable

from lift_manager.core.rides.book import RideBook
from lift_manager.core.rides.choosing import may_move
from lift_manager.core.rides.places import Places
from lift_manager.core.rides.seeing import Seeing


class Due:
    """Remembers of each lift what decides for whom an event matters: whether it was held, and how far its line had moved up."""

    def __init__(self, seeing: Seeing, book: RideBook, places: Places) -> None:
        self._seeing = seeing
        self._book = book
        self._places = places
        self._held: set[str] = set()
        self._left_line: dict[str, int] = {}

    def freed(self, lifts: Iterable[str]) -> frozenset[str]:
        """Return those of these lifts that somebody held when they were looked at last, and nobody holds any more."""
        return frozenset(lift for lift in lifts if self._was_freed(lift))

    def rides(self, lifts: Iterable[str], freed: frozenset[str]) -> list[str]:
        """Return the rides for which events of lifts matter.

        Those are the rides with a session and whoever is next; where the line has moved up, all of that lift; and whoever may
        take a lift that was freed.
        """
        found: dict[str, None] = {}
        for lift in lifts:
            left = self._seeing.left_line(lift)
            if self._left_line.get(lift) != left:
                self._left_line[lift] = left
                found.update((record.id, None) for record in self._book.on(lift) if not record.over)
                continue
            found.update((record.id, None) for record in self._book.under_way(lift))
            if (first := self._seeing.first(lift)) is not None:
                found.update(dict.fromkeys(self._places.at(lift, first)))
        if freed:
            found.update((one.id, None) for one in self._book if may_move(one) and freed.intersection(one.wish.lifts))
        return list(found)

    def _was_freed(self, lift: str) -> bool:
        was_held, is_held = lift in self._held, self._seeing.state(lift).holder is not None
        (self._held.add if is_held else self._held.discard)(lift)
        return was_held and not is_held
