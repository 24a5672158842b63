"""Rides: one robot from one floor to another."""

from __future__ import annotations

from typing import Annotated

from pydantic import AwareDatetime, Field, model_validator
from pydantic_core import PydanticCustomError

from lift_manager.api.fields import Answer, Door, Recorded, RequestModel, Seconds, Words
from lift_manager.api.sessions import IdempotencyKey, RobotName
from lift_manager.lift.session import Advice, Holder
from lift_manager.rides import ride as rides
from lift_manager.rides.ride import Guidance, Phase
from register_maps.words import Side

_Floor = Annotated[str, Field(max_length=200, examples=["L1"])]
_Limit = Annotated[float, Field(ge=1.0, le=3600.0)]

ANY = "any"
"""Any lift that serves both floors. A lift with this name cannot be requested by name."""


class Limits(RequestModel):
    """The time limit of each phase, in seconds."""

    queued_s: _Limit = 600.0
    called_s: _Limit = 300.0
    boarding_s: _Limit = 120.0
    riding_s: _Limit = 300.0
    alighting_s: _Limit = 300.0


class RideRequest(RequestModel):
    """Take a robot from one floor to another."""

    lift: str = Field(
        max_length=200, description="A lift of the site, or `any` for one that serves both floors.", examples=["any"]
    )
    from_: _Floor = Field(alias="from", description="The floor at which the robot waits.")
    to: _Floor = Field(description="The floor to which it goes.", examples=["L3"])
    door: Door | None = Field(
        default=None, description="The door by which it boards; only lifts with this door at that floor are chosen."
    )
    robot: RobotName
    idempotency_key: IdempotencyKey
    limits: Limits = Limits()
    dry_run: bool = Field(default=False, description="Return the plan of the ride, and begin nothing.")

    @model_validator(mode="after")
    def _goes_somewhere(self) -> RideRequest:
        if self.from_ == self.to:
            raise PydanticCustomError("misfit", "must be another floor than from", {"field": "to"})
        return self

    def of(self, caller: Holder, lifts: tuple[str, ...]) -> rides.RideRequest:
        """Return this as the request of a caller; `lifts` are all that it may command, for `any` to choose among."""
        return rides.RideRequest(
            lifts=lifts if self.lift == ANY else (self.lift,),
            any_lift=self.lift == ANY,
            start=self.from_,
            destination=self.to,
            door=self.door,
            robot=self.robot or "",
            caller=caller,
            key=self.idempotency_key or "",
            limits=rides.RideLimits(**self.limits.model_dump()),
        )


class CancelRequest(RequestModel):
    """Cancel the ride."""

    reason: Words = Field(default="no reason given", examples=["the order was withdrawn"])


class Ride(Answer):
    """A ride, and what its robot should do now."""

    id: str
    lift: str
    any_lift: bool = Field(description="The manager chose the lift, and may choose another while the ride is queued.")
    from_: str = Field(alias="from")
    to: str
    door: Side | None
    robot: str
    caller: str = Field(examples=["ride:amr-7"])
    phase: Phase
    guidance: Guidance = Field(description="`enter` and `leave` appear only while the door is open for this robot.")
    reason: str
    advice: Advice | None
    ahead: int | None = Field(description="How many are ahead of it in the queue; null once it is no longer queued.")
    phase_ends_in_s: Seconds | None
    maybe_aboard: bool = Field(description="Whether the robot may be in the car.")
    begun_at: AwareDatetime
    changed_at: AwareDatetime
    recorded: Recorded = True

    @classmethod
    def of(cls, ride: rides.Ride) -> Ride:
        """Return the current state of a ride."""
        return cls.model_validate(
            {
                "id": ride.id,
                "lift": ride.lift,
                "any_lift": ride.any_lift,
                "from": ride.start,
                "to": ride.destination,
                "door": ride.door,
                "robot": ride.robot,
                "caller": str(ride.caller),
                "phase": ride.phase,
                "guidance": ride.guidance,
                "reason": ride.reason,
                "advice": ride.advice,
                "ahead": ride.ahead,
                "phase_ends_in_s": ride.phase_ends_in_s,
                "maybe_aboard": ride.maybe_aboard,
                "begun_at": ride.begun_at,
                "changed_at": ride.changed_at,
            }
        )


class Rides(Answer):
    """Current rides, and those that ended recently."""

    rides: tuple[Ride, ...]


class Plan(Answer):
    """The plan of a ride that was not begun."""

    lift: str
    ahead: int
    reason: str = Field(description="Why the ride would have to wait; empty if it would begin at once.")
