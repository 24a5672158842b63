"""The form of the file that keeps what outlives the manager."""

from __future__ import annotations

from datetime import MAXYEAR, MINYEAR, datetime
from typing import Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict

from lift_manager.domain.service import Acknowledged, Cause, Lockout, Occupied, Remembered
from lift_manager.domain.state import Holder

VERSION: Literal[1] = 1


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


class LiftForm(_Part):
    """What is remembered of one lift."""

    fire_since: Moment | None
    lockout: LockoutForm | None
    occupied: OccupiedForm | None
    acknowledged: AcknowledgedForm | None

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
        )

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


class Head(BaseModel):
    """What every version of the file begins with."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    format: Literal["lift-manager state"]
    version: int
    site: str


class StateForm(_Part):
    """The whole file."""

    format: Literal["lift-manager state"] = "lift-manager state"
    version: Literal[1] = VERSION
    site: str
    lifts: dict[str, LiftForm]
