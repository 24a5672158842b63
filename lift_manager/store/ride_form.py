"""The form of a ride in the file that keeps what outlives the manager."""

from __future__ import annotations

from dataclasses import fields

from lift_manager.domain.ride import Phase, RideLimits, RideRequest
from lift_manager.domain.ride_record import Clearing, KeptRide
from lift_manager.domain.service import Advice
from lift_manager.domain.state import Holder
from lift_manager.store.form_part import Moment, Part
from register_maps.words import Side


class LimitsForm(Part):
    """How long each phase may take, in seconds."""

    queued_s: float
    called_s: float
    boarding_s: float
    riding_s: float
    alighting_s: float


class ClearingForm(Part):
    """Why a robot is being let out."""

    ending: Phase
    cause: str


class RideForm(Part):
    """A ride."""

    id: str
    lifts: tuple[str, ...]
    any_lift: bool
    start: str
    destination: str
    door: Side | None
    robot: str
    face: str
    caller: str
    key: str
    limits: LimitsForm
    phase: Phase
    phase_since: Moment
    begun_at: Moment
    changed_at: Moment
    kept_at: Moment
    reason: str
    advice: Advice | None
    session: str
    entered: bool
    could_leave_at: str | None
    maybe_aboard: bool
    clearing: ClearingForm | None
    clear_at: str | None
    ended_at: Moment | None

    @classmethod
    def of(cls, kept: KeptRide) -> RideForm:
        """Return the form of a ride."""
        wish, clearing = kept.wish, kept.clearing
        return cls(
            face=wish.caller.face,
            caller=wish.caller.name,
            limits=LimitsForm(**{name: getattr(wish.limits, name) for name in LimitsForm.model_fields}),
            clearing=None if clearing is None else ClearingForm(ending=clearing.ending, cause=clearing.cause),
            **{name: getattr(wish, name) for name in _OF_WISH},
            **{name: getattr(kept, name) for name in _OF_RIDE},
        )

    def read(self) -> KeptRide:
        """Return the ride."""
        clearing = self.clearing
        wish = RideRequest(
            caller=Holder(self.face, self.caller),
            limits=RideLimits(**self.limits.model_dump()),
            **{name: getattr(self, name) for name in _OF_WISH},
        )
        return KeptRide(
            wish=wish,
            clearing=None if clearing is None else Clearing(clearing.ending, clearing.cause),
            **{name: getattr(self, name) for name in _OF_RIDE},
        )


_OF_WISH = tuple(field.name for field in fields(RideRequest) if field.name not in ("caller", "limits"))
_OF_RIDE = tuple(field.name for field in fields(KeptRide) if field.name not in ("wish", "clearing"))
