"""Which lift a ride takes, when it begins and while it waits."""

from __future__ import annotations

from dataclasses import replace

from drivers.model import FloorName
from lift_manager.core.rides.book import RideBook
from lift_manager.core.rides.seeing import Seeing
from lift_manager.domain import ride_choice as choices
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.ride import Phase, RideRequest
from lift_manager.domain.ride_choice import Choice
from lift_manager.domain.ride_record import RideRecord
from lift_manager.domain.state import Holder
from register_maps.words import Side

_NOBODY = Holder("ride", "")
_Trip = tuple[tuple[str, ...], FloorName, FloorName, Side | None]


class Choosing:
    """Chooses among lifts. What is best for one ride is best for all of the same trip, so that it is found once in a pass."""

    def __init__(self, seeing: Seeing, book: RideBook) -> None:
        self._seeing = seeing
        self._book = book
        self._best: dict[_Trip, Choice | None] = {}

    def begin_pass(self) -> None:
        """Take it that lifts and lines may have changed."""
        self._best.clear()

    def first(self, record: RideRecord) -> RideRecord | Refused:
        """Return a ride that is about to begin with the lift that it takes."""
        choice = choices.choose(record.wish, record.holder, self._seeing.choices(record))
        if isinstance(choice, Refused):
            return choice
        inside = self._inside(record)
        if inside and choice.lift not in inside:
            lift, ride = next(iter(inside.items()))
            text = (
                f"your robot may be in the car of {lift}: say `left` for ride {ride} once it is outside, or begin a ride with"
                f" {lift} from inside"
            )
            return Refused(Refusal.NOT_NOW, text)
        return replace(record, lift=choice.lift)

    def better(self, record: RideRecord) -> str | None:
        """Return the lift with which a ride that waits is better off; None where it stays, or may not move."""
        wish = record.wish
        if not may_move(record):
            return None
        here = self._seeing.choice(record.lift, record.holder)
        inside = self._inside(record)
        if inside or here is None:
            able = (lift for lift in wish.lifts if lift in inside and lift != record.lift)
            return None if record.lift in inside else next((lift for lift in able if self._fits(wish, lift)), None)
        best = self._best_for(wish)
        if best is None or best.lift == record.lift:
            return None
        return best.lift if choices.rank(best, record.holder) < choices.rank(here, record.holder) else None

    def _fits(self, wish: RideRequest, lift: str) -> bool:
        choice = self._seeing.choice(lift, _NOBODY)
        return choice is not None and choices.unfit(wish, choice.described) is None

    def _best_for(self, wish: RideRequest) -> Choice | None:
        trip = (wish.lifts, wish.start, wish.destination, wish.door)
        if trip not in self._best:
            among = [found for lift in wish.lifts if (found := self._seeing.choice(lift, _NOBODY)) is not None]
            best = choices.choose(wish, _NOBODY, among)
            self._best[trip] = None if isinstance(best, Refused) else best
        return self._best[trip]

    def _inside(self, record: RideRecord) -> dict[str, str]:
        """Return the lifts in whose car the robot of a ride may be, each with the ride that left it there.

        Nobody can tell that of a robot without a name.
        """
        if not record.wish.robot:
            return {}
        return {
            one.lift: one.id
            for one in self._book.maybe_aboard(record.holder)
            if one.over and choices.may_hold(self._seeing.state(one.lift), record.holder)
        }


def may_move(record: RideRecord) -> bool:
    """Whether a ride may still take another lift."""
    return record.wish.any_lift and record.phase is Phase.QUEUED and record.unheard_since is None
