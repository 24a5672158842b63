"""What people say about a lift: acknowledge, lock out, end a lockout, take a lift from its holder."""

from __future__ import annotations

from typing import Annotated

from pydantic import AwareDatetime, Field

from lift_manager.api.parts import Part, ShortName, Words
from lift_manager.domain.service import Acknowledged, Cause, ForceReleased, Lockout, LockoutEnded

Name = Annotated[ShortName, Field(description="The person who says so.", examples=["M. Weber"])]
Reason = Annotated[Words, Field(description="Why robots stay off.", examples=["door operator is being replaced"])]
ReleaseReason = Annotated[
    Words, Field(description="Why the lift is taken from its holder.", examples=["the robot was carried away"])
]


class AcknowledgeRequest(Part):
    """The lift was checked after a fire, or its car was looked into."""

    by: Name


class LockoutRequest(Part):
    """No robot may command the lift."""

    by: Name
    reason: Reason


class EndLockoutRequest(Part):
    """Robots may command the lift again."""

    by: Name


class ForceReleaseRequest(Part):
    """The session ends, whoever holds the lift."""

    by: Name
    reason: ReleaseReason


class AcknowledgedAnswer(Part):
    """What was acknowledged."""

    lift: str
    by: str
    at: AwareDatetime
    acknowledged: tuple[Cause, ...] = Field(
        description="`fire`: after a fire the lift was checked. `occupied`: no robot is in the car."
        " `contradiction`: the wiring and the map were checked."
    )

    @classmethod
    def of(cls, lift: str, said: Acknowledged) -> AcknowledgedAnswer:
        """Return the answer about a lift."""
        return cls(lift=lift, by=said.by, at=said.at, acknowledged=said.what)


class LockoutAnswer(Part):
    """A lockout that is in force."""

    lift: str
    by: str
    reason: str
    since: AwareDatetime

    @classmethod
    def of(cls, lift: str, lockout: Lockout) -> LockoutAnswer:
        """Return the answer about a lift."""
        return cls(lift=lift, by=lockout.by, reason=lockout.reason, since=lockout.since)


class LockoutEndedAnswer(Part):
    """A lockout that is over."""

    lift: str
    by: str = Field(description="Who ended it.")
    at: AwareDatetime
    lockout: LockoutAnswer

    @classmethod
    def of(cls, lift: str, ended: LockoutEnded) -> LockoutEndedAnswer:
        """Return the answer about a lift."""
        return cls(lift=lift, by=ended.by, at=ended.at, lockout=LockoutAnswer.of(lift, ended.lockout))


class ForceReleasedAnswer(Part):
    """A session that a person ended."""

    lift: str
    by: str
    reason: str
    at: AwareDatetime
    holder: str = Field(description="Who held the lift, as `<face>:<name>`.")
    maybe_aboard: bool = Field(
        description="A robot may be in the car: all others are refused until a person has looked and acknowledges."
    )
    text: str = Field(description="What became of it, in a sentence for the person who said so.")

    @classmethod
    def of(cls, lift: str, released: ForceReleased) -> ForceReleasedAnswer:
        """Return the answer about a lift."""
        return cls(
            lift=lift,
            by=released.by,
            reason=released.reason,
            at=released.at,
            holder=str(released.holder),
            maybe_aboard=released.maybe_aboard,
            text=released.text(lift),
        )
