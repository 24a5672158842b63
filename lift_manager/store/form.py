"""The form of the file that keeps what outlives the manager."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from datetime import MAXYEAR, MINYEAR, datetime
from typing import Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict

from lift_manager.domain.boarding import KeptBoarding, Who
from lift_manager.domain.service import Acknowledged, Cause, Lockout, Occupied, Remembered
from lift_manager.domain.session import KeptSession
from lift_manager.domain.state import Holder

VERSION: Literal[2] = 2
"""Version 1 knows neither sessions nor what they leave behind."""


def _in_any_zone(at: datetime) -> datetime:
    if not MINYEAR < at.year < MAXYEAR:
        raise ValueError(f"the year {at.year} cannot be")
    return at


Moment = Annotated[AwareDatetime, AfterValidator(_in_any_zone)]
"""A time that can be shown in every zone."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class LockoutForm(_Part):
    """A lockout."""

    by: str
    reason: str
    since: Moment


class OccupiedForm(_Part):
    """A car that may hold a robot."""

    face: str
    name: str
    aboard: bool
    since: Moment


class AcknowledgedForm(_Part):
    """The newest acknowledgement."""

    by: str
    at: Moment
    what: tuple[Cause, ...]


class SessionForm(_Part):
    """A session."""

    face: str
    name: str
    floor: str
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

    @classmethod
    def of(cls, kept: KeptSession) -> SessionForm:
        """Return the form of a session."""
        return cls(
            face=kept.holder.face,
            name=kept.holder.name,
            **{name: getattr(kept, name) for name in _OF_SESSION},
            **{name: getattr(kept.boarding, name) for name in _OF_BOARDING},
        )

    def read(self) -> KeptSession:
        """Return the session."""
        return KeptSession(
            holder=Holder(self.face, self.name),
            boarding=KeptBoarding(**{name: getattr(self, name) for name in _OF_BOARDING}),
            **{name: getattr(self, name) for name in _OF_SESSION},
        )


_OF_BOARDING = tuple(field.name for field in fields(KeptBoarding))
_OF_SESSION = tuple(field.name for field in fields(KeptSession) if field.name not in ("holder", "boarding"))


class LiftFormV1(_Part):
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


class LiftForm(LiftFormV1):
    """What is remembered of one lift."""

    left_untold: Moment | None
    robot_mode_until: Moment | None
    session: SessionForm | None

    @classmethod
    def of(cls, kept: Remembered) -> LiftForm:
        """Return the form of what is remembered."""
        lockout, occupied, said = kept.lockout, kept.occupied, kept.acknowledged
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
        )

    def read(self) -> Remembered:
        """Return what is remembered."""
        return replace(
            super().read(),
            left_untold=self.left_untold,
            robot_mode_until=self.robot_mode_until,
            session=self.session.read() if self.session else None,
        )


class Head(BaseModel):
    """What every version of the file begins with."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    format: Literal["lift-manager state"]
    version: int
    site: str


class StateForm(_Part):
    """The whole file."""

    format: Literal["lift-manager state"] = "lift-manager state"
    version: Literal[2] = VERSION
    site: str
    lifts: dict[str, LiftForm]


class StateFormV1(_Part):
    """The whole file of version 1."""

    format: Literal["lift-manager state"]
    version: Literal[1]
    site: str
    lifts: dict[str, LiftFormV1]


FORMS: Mapping[int, type[StateForm | StateFormV1]] = {1: StateFormV1, VERSION: StateForm}
"""The form of each version that is read."""
