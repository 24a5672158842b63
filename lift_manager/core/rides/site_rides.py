"""The rides of a site: `RideFacade`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeVar

from lift_manager.core.rides.engine import RideEngine
from lift_manager.domain.asking import Refused
from lift_manager.domain.ride import Ride, RideBegun, RidePlan, RideRequest, RideWord
from lift_manager.domain.state import Holder

_Told = TypeVar("_Told")


class SiteRides(ABC):
    """The part of the manager that has to do with rides."""

    _rides: RideEngine

    @abstractmethod
    def _told(self, lift: str, answer: _Told | Refused) -> _Told | Refused:
        """Pass an answer on."""

    def plan_ride(self, wish: RideRequest) -> RidePlan | Refused:
        """Say what a ride would come to now."""
        return self._told(_lift_of(wish), self._rides.plan(wish))

    def begin_ride(self, wish: RideRequest) -> RideBegun | Refused:
        """Begin one, or queue it."""
        return self._told(_lift_of(wish), self._rides.begin(wish))

    def ride(self, ride: str) -> Ride | None:
        """Return a ride by its id, or one that ended not long ago."""
        return self._rides.ride(ride)

    def rides(self) -> tuple[Ride, ...]:
        """Return every ride that goes on, and those that ended not long ago; the oldest first."""
        return self._rides.rides()

    def ride_word(self, ride: str, word: RideWord, caller: Holder | None) -> Ride | Refused:
        """Take the robot's word; `caller` None is an operator."""
        return self._told(self._rides.lift_of(ride), self._rides.word(ride, word, caller))

    def cancel_ride(self, ride: str, caller: Holder | None, reason: str) -> Ride | Refused:
        """End it safely."""
        return self._told(self._rides.lift_of(ride), self._rides.cancel(ride, caller, reason))


def _lift_of(wish: RideRequest) -> str:
    return wish.lifts[0] if len(wish.lifts) == 1 else ""
