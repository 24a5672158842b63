"""Rides of a fake manager: as they were begun, and changed by nothing but words."""

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.ride import Guidance, Phase, Ride, RideBegun, RidePlan, RideRequest, RideWord
from lift_manager.domain.state import Holder
from tests.lift_manager.web.fake_lifts import FakeLifts

AT = datetime(2026, 3, 1, 20, 15, tzinfo=UTC)


def a_ride(caller: Holder, ride: str = "r1", lift: str = "lift") -> Ride:
    return Ride(
        id=ride,
        lift=lift,
        any_lift=False,
        start="L1",
        destination="L2",
        door=None,
        robot="",
        caller=caller,
        phase=Phase.BOARDING,
        guidance=Guidance.ENTER,
        reason="",
        advice=None,
        ahead=None,
        phase_ends_in_s=100.0,
        maybe_aboard=True,
        begun_at=AT,
        changed_at=AT,
    )


@dataclass(kw_only=True)
class FakeRides(FakeLifts):
    """What was asked is in `said_of_rides`; `ride_refused` is what every word and every wish is told."""

    known: dict[str, Ride] = field(default_factory=dict)
    wishes: list[RideRequest] = field(default_factory=list)
    planned: list[RideRequest] = field(default_factory=list)
    said_of_rides: list[tuple[str, str, Holder | None]] = field(default_factory=list)
    ride_refused: Refused | None = None
    _begun: dict[tuple[Holder, str], str] = field(default_factory=dict)

    def going_on(self, *rides: Ride) -> None:
        """Let these rides go on."""
        self.known |= {ride.id: ride for ride in rides}

    def plan_ride(self, wish: RideRequest) -> RidePlan | Refused:
        self.planned.append(wish)
        return self._no(wish) or RidePlan(wish.lifts[0], 0, "")

    def begin_ride(self, wish: RideRequest) -> RideBegun | Refused:
        self.wishes.append(wish)
        if no := self._no(wish):
            return no
        if wish.key and (known := self._begun.get((wish.caller, wish.key))):
            return RideBegun(self.known[known], anew=False)
        plain = a_ride(wish.caller, f"r{len(self.known) + 1}", wish.lifts[0])
        ride = replace(plain, any_lift=wish.any_lift, start=wish.start, destination=wish.destination, robot=wish.robot)
        self._begun[wish.caller, wish.key] = ride.id
        self.going_on(ride)
        return RideBegun(ride, anew=True)

    def ride(self, ride: str) -> Ride | None:
        return self.known.get(ride)

    def rides(self) -> tuple[Ride, ...]:
        return tuple(self.known.values())

    def ride_word(self, ride: str, word: RideWord, caller: Holder | None) -> Ride | Refused:
        self.said_of_rides.append((ride, word, caller))
        return self.ride_refused or self.known[ride]

    def cancel_ride(self, ride: str, caller: Holder | None, reason: str) -> Ride | Refused:
        self.said_of_rides.append((ride, reason, caller))
        if self.ride_refused is None:
            self.known[ride] = replace(self.known[ride], phase=Phase.CLEARING, reason=reason)
        return self.ride_refused or self.known[ride]

    def _no(self, wish: RideRequest) -> Refused | None:
        if unknown := set(wish.lifts) - set(self.lift_names()):
            return Refused(Refusal.UNKNOWN_LIFT, f"no lift {sorted(unknown)}; the lifts are {self.lift_names()}")
        if unknown := {wish.start, wish.destination} - {"L1", "L2"}:
            return Refused(Refusal.UNKNOWN_FLOOR, f"no floor {sorted(unknown)}; the floors are L1, L2")
        return self.ride_refused
