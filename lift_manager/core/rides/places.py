"""Where the rides stand in the lines of their lifts."""

from __future__ import annotations

from lift_manager.core.rides.seeing import Lines
from lift_manager.domain.ride_record import RideRecord, in_line
from lift_manager.domain.state import Holder


class Places:
    """Which ride stands in which line.

    The rides of one holder stand in a line as one. Once one of them has left it the others wait at its end, so that one caller with
    many rides does not keep everybody else waiting.
    """

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self._places: dict[str, tuple[str, Holder]] = {}
        self._at: dict[tuple[str, Holder], dict[str, None]] = {}
        """The rides at each place, the oldest first."""

    def see_to(self, record: RideRecord, now: float) -> None:
        """Let a ride stand in the line of its lift for as long as it waits, and in no other."""
        wanted = (record.lift, record.holder) if in_line(record, now) else None
        place = self._places.get(record.id)
        if place is not None and place != wanted:
            self._leave(record.id, place, now)
        if wanted is not None:
            if place != wanted:
                self._places[record.id] = wanted
                self._at.setdefault(wanted, {})[record.id] = None
            self._lines(record.lift).join(record.holder, now)

    def at(self, lift: str, holder: Holder) -> tuple[str, ...]:
        """Return the rides of a holder that stand in the line of a lift."""
        return tuple(self._at.get((lift, holder), ()))

    def _leave(self, ride: str, place: tuple[str, Holder], now: float) -> None:
        lift, holder = place
        del self._places[ride]
        others = self._at[place]
        del others[ride]
        line = self._lines(lift)
        line.leave(holder)
        if others:
            line.join(holder, now)
        else:
            del self._at[place]
