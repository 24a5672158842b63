"""Rides of a fake site: as they were begun."""

from collections.abc import Callable
from dataclasses import replace

from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Guidance, Phase, Ride, RideBegun, RidePlan, RideRequest, RideWord
from lift_manager.runtime.bus import Bus
from lift_manager.runtime.errors import raised
from lift_manager.runtime.recorder import MemoryRecorder, wall_clock
from lift_manager.runtime.refusals import RefusalLog
from lift_manager.runtime.rides import SiteRides
from tests.lift_manager.web.fake_lifts import AT


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


class FakeRides(SiteRides):
    """Remembers what was requested. Reports change nothing, and a cancelled ride is clearing."""

    def __init__(self, lift_names: Callable[[], tuple[str, ...]], refuses: Refused | None) -> None:
        """`refuses` is the reply to everything that begins or changes a ride."""
        recorder = MemoryRecorder()
        super().__init__({}, Bus("rides"), recorder, RefusalLog(recorder), wall_clock())
        self._lift_names, self._refuses = lift_names, refuses
        self.known: dict[str, Ride] = {}
        self.planned: list[RideRequest] = []
        self.requests: list[RideRequest] = []
        self.remote: list[bool] = []
        """Of each, whether its caller is remote."""
        self.reports: list[tuple[str, str, Holder | None]] = []
        """And cancellations, with their reasons."""
        self._begun: dict[tuple[Holder, str], str] = {}

    def going_on(self, *rides: Ride) -> None:
        """Let these rides go on."""
        self.known |= {ride.id: ride for ride in rides}

    def plan(self, request: RideRequest) -> RidePlan:
        self.planned.append(request)
        self._check(request)
        return RidePlan(request.lifts[0], 0, "")

    def begin(self, request: RideRequest, *, is_remote: bool = False) -> RideBegun:
        self.requests.append(request)
        self.remote.append(is_remote)
        self._check(request)
        if request.key and (known := self._begun.get((request.caller, request.key))):
            return RideBegun(self.known[known], is_new=False)
        plain = a_ride(request.caller, f"r{len(self.known) + 1}", request.lifts[0])
        start, destination = request.start, request.destination
        ride = replace(plain, any_lift=request.any_lift, start=start, destination=destination, robot=request.robot)
        self._begun[request.caller, request.key] = ride.id
        self.going_on(ride)
        return RideBegun(ride, is_new=True)

    def ride(self, ride: str) -> Ride:
        if ride not in self.known:
            raise raised(Refused(Refusal.UNKNOWN_RIDE, "the site's own words"))
        return self.known[ride]

    def all(self) -> tuple[Ride, ...]:
        return tuple(self.known.values())

    def report(self, ride: str, word: RideWord, caller: Holder | None) -> Ride:
        self.reports.append((ride, word, caller))
        if self._refuses is not None:
            raise raised(self._refuses)
        return self.ride(ride)

    def cancel(self, ride: str, caller: Holder | None, reason: str) -> Ride:
        self.reports.append((ride, reason, caller))
        if self._refuses is not None:
            raise raised(self._refuses)
        self.known[ride] = replace(self.ride(ride), phase=Phase.CLEARING, reason=reason)
        return self.known[ride]

    def _check(self, request: RideRequest) -> None:
        if unknown := set(request.lifts) - set(self._lift_names()):
            text = f"no lift {sorted(unknown)}; the lifts are {self._lift_names()}"
            raise raised(Refused(Refusal.UNKNOWN_LIFT, text))
        if unknown := {request.start, request.destination} - {"L1", "L2"}:
            raise raised(Refused(Refusal.UNKNOWN_FLOOR, f"no floor {sorted(unknown)}; the floors are L1, L2"))
        if self._refuses is not None:
            raise raised(self._refuses)
