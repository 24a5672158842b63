"""The form of the file that keeps what outlives the manager."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Literal

from pydantic import BaseModel, ConfigDict

from lift_manager.domain.boarding import KeptBoarding, Who
from lift_manager.domain.contradictions import Contradiction, Distrust, Trust
from lift_manager.domain.service import Acknowledged, Cause, Drain, EndReason, Lockout, Occupied, Remembered
from lift_manager.domain.session import KeptSession
from lift_manager.domain.state import Holder
from lift_manager.store.form_part import Moment, Part
from lift_manager.store.ride_form import RideForm

VERSION: Literal[4] = 4
"""Version 1 knows neither sessions nor what they leave behind, version 2 neither sessions with an id nor rides, version 3 not what the
signals of a lift have proved and contradicted."""


class LockoutForm(Part):
    """A lockout, or a drain."""

    by: str
    reason: str
    since: Moment


class OccupiedForm(Part):
    """A car that may hold a robot."""

    face: str
    name: str
    aboard: bool
    since: Moment


class AcknowledgedForm(Part):
    """The newest acknowledgement."""

    by: str
    at: Moment
    what: tuple[Cause, ...]


class SessionFormV2(Part):
    """A session without an id."""

    face: str
    name: str
    floor: str | None
    hold_door: bool
    opened_at: Moment
    lease_from: Moment
    holding_since: Moment | None
    kept_at: Moment
    stood_open: bool
    hold_spent: bool
    pressed: bool
    who: Who
    sent_on: bool
    may_leave_at: str | None
    in_place_told: bool

    def read(self) -> KeptSession:
        """Return the session."""
        return KeptSession(
            holder=Holder(self.face, self.name),
            boarding=KeptBoarding(**{name: getattr(self, name) for name in _OF_BOARDING}),
            **{name: getattr(self, name) for name in _OF_SESSION if name in type(self).model_fields},
        )


class SessionForm(SessionFormV2):
    """A session."""

    id: str
    stays: bool
    lease_s: float | None
    key: str
    key_ttl_s: float | None = None
    closes_at: Moment | None = None
    closing: tuple[EndReason, str] | None = None

    @classmethod
    def of(cls, kept: KeptSession) -> SessionForm:
        """Return the form of a session."""
        return cls(
            face=kept.holder.face,
            name=kept.holder.name,
            **{name: getattr(kept, name) for name in _OF_SESSION},
            **{name: getattr(kept.boarding, name) for name in _OF_BOARDING},
        )


_OF_BOARDING = tuple(field.name for field in fields(KeptBoarding))
_OF_SESSION = tuple(field.name for field in fields(KeptSession) if field.name not in ("holder", "boarding"))


class LiftFormV1(Part):
    """What is remembered of one lift, apart from sessions and what they leave behind."""

    fire_since: Moment | None
    lockout: LockoutForm | None
    occupied: OccupiedForm | None
    acknowledged: AcknowledgedForm | None

    def read(self) -> Remembered:
        """Return what is remembered."""
        lockout, occupied, said = self.lockout, self.occupied, self.acknowledged
        return Remembered(
            fire_since=self.fire_since,
            lockout=Lockout(lockout.by, lockout.reason, lockout.since) if lockout else None,
            occupied=Occupied(Holder(occupied.face, occupied.name), occupied.aboard, occupied.since)
            if occupied
            else None,
            acknowledged=Acknowledged(said.by, said.at, said.what) if said else None,
        )


class LiftFormV2(LiftFormV1):
    """What is remembered of one lift whose session has no id."""

    left_untold: Moment | None
    robot_mode_until: Moment | None
    session: SessionFormV2 | None

    def read(self) -> Remembered:
        """Return what is remembered."""
        return replace(
            super().read(),
            left_untold=self.left_untold,
            robot_mode_until=self.robot_mode_until,
            session=self.session.read() if self.session else None,
        )


class LiftFormV3(LiftFormV2):
    """What is remembered of one lift, apart from what its signals have proved and contradicted."""

    session: SessionForm | None
    rides: tuple[RideForm, ...] = ()
    drain: LockoutForm | None = None

    def read(self) -> Remembered:
        """Return what is remembered."""
        drain = Drain(self.drain.by, self.drain.reason, self.drain.since) if self.drain else None
        return replace(super().read(), rides=tuple(ride.read() for ride in self.rides), drain=drain)


class DistrustForm(Part):
    """A contradiction that raised the alarm."""

    kind: Contradiction
    text: str
    since: Moment
    trips: int


class TrustForm(Part):
    """What the signals of a lift have proved and contradicted."""

    map_hash: str
    door_proven: bool
    distrust: tuple[DistrustForm, ...]

    @classmethod
    def of(cls, kept: Trust) -> TrustForm:
        """Return the form of it."""
        distrust = (DistrustForm(kind=o.kind, text=o.text, since=o.since, trips=o.trips) for o in kept.distrust)
        return cls(map_hash=kept.map_hash, door_proven=kept.door_proven, distrust=tuple(distrust))

    def read(self) -> Trust:
        """Return it."""
        distrust = tuple(Distrust(one.kind, one.text, one.since, one.trips) for one in self.distrust)
        return Trust(self.map_hash, self.door_proven, distrust)


class LiftForm(LiftFormV3):
    """What is remembered of one lift."""

    trust: TrustForm

    @classmethod
    def of(cls, kept: Remembered) -> LiftForm:
        """Return the form of what is remembered."""
        lockout, drain, occupied, said = kept.lockout, kept.drain, kept.occupied, kept.acknowledged
        return cls(
            fire_since=kept.fire_since,
            lockout=LockoutForm(by=lockout.by, reason=lockout.reason, since=lockout.since) if lockout else None,
            occupied=OccupiedForm(
                face=occupied.holder.face, name=occupied.holder.name, aboard=occupied.aboard, since=occupied.since
            )
            if occupied
            else None,
            acknowledged=AcknowledgedForm(by=said.by, at=said.at, what=said.what) if said else None,
            left_untold=kept.left_untold,
            robot_mode_until=kept.robot_mode_until,
            session=SessionForm.of(kept.session) if kept.session else None,
            rides=tuple(RideForm.of(ride) for ride in kept.rides),
            drain=LockoutForm(by=drain.by, reason=drain.reason, since=drain.since) if drain else None,
            trust=TrustForm.of(kept.trust),
        )

    def read(self) -> Remembered:
        """Return what is remembered."""
        return replace(super().read(), trust=self.trust.read())


class Head(BaseModel):
    """What every version of the file begins with."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    format: Literal["lift-manager state"]
    version: int
    site: str


class StateForm(Part):
    """The whole file."""

    format: Literal["lift-manager state"] = "lift-manager state"
    version: Literal[4] = VERSION
    site: str
    lifts: dict[str, LiftForm]


class StateFormV1(Part):
    """The whole file of version 1."""

    format: Literal["lift-manager state"]
    version: Literal[1]
    site: str
    lifts: dict[str, LiftFormV1]


class StateFormV2(Part):
    """The whole file of version 2."""

    format: Literal["lift-manager state"]
    version: Literal[2]
    site: str
    lifts: dict[str, LiftFormV2]


class StateFormV3(Part):
    """The whole file of version 3."""

    format: Literal["lift-manager state"]
    version: Literal[3]
    site: str
    lifts: dict[str, LiftFormV3]


AnyForm = StateForm | StateFormV3 | StateFormV2 | StateFormV1

FORMS: Mapping[int, type[AnyForm]] = {
    1: StateFormV1,
    2: StateFormV2,
    3: StateFormV3,
    VERSION: StateForm,
}
"""The form of each version that is read."""
