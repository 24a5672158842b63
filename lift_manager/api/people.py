"""What people say about a lift: acknowledge, lock out, end a lockout, take a lift from its holder."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict, Field, StringConstraints
from pydantic_core import PydanticCustomError

from lift_manager.domain.service import Acknowledged, Cause, ForceReleased, Lockout, LockoutEnded

_JOINERS = "\u200c\u200d"
"""Unseen, but Persian and Indian scripts cannot be written without them."""


def _printable(text: str) -> str:
    text = text.replace("\u00a0", " ")  # what a word processor puts between the parts of a name
    if not text.translate(dict.fromkeys(map(ord, _JOINERS))).isprintable():
        raise PydanticCustomError("printable", "must be text on one line, without control characters")
    return text


Name = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=64),
    AfterValidator(_printable),
    Field(description="The person who says so.", examples=["M. Weber"]),
]
_Words = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200), AfterValidator(_printable)
]
Reason = Annotated[_Words, Field(description="Why robots stay off.", examples=["door operator is being replaced"])]
ReleaseReason = Annotated[
    _Words, Field(description="Why the lift is taken from its holder.", examples=["the robot was carried away"])
]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class AcknowledgeRequest(_Part):
    """The lift was checked after a fire, or its car was looked into."""

    by: Name


class LockoutRequest(_Part):
    """No robot may command the lift."""

    by: Name
    reason: Reason


class EndLockoutRequest(_Part):
    """Robots may command the lift again."""

    by: Name


class ForceReleaseRequest(_Part):
    """The session ends, whoever holds the lift."""

    by: Name
    reason: ReleaseReason


class AcknowledgedAnswer(_Part):
    """What was acknowledged."""

    lift: str
    by: str
    at: AwareDatetime
    acknowledged: tuple[Cause, ...] = Field(
        description="`fire`: after a fire the lift was checked. `occupied`: no robot is in the car."
    )

    @classmethod
    def of(cls, lift: str, said: Acknowledged) -> AcknowledgedAnswer:
        """Return the answer about a lift."""
        return cls(lift=lift, by=said.by, at=said.at, acknowledged=said.what)


class LockoutAnswer(_Part):
    """A lockout that is in force."""

    lift: str
    by: str
    reason: str
    since: AwareDatetime

    @classmethod
    def of(cls, lift: str, lockout: Lockout) -> LockoutAnswer:
        """Return the answer about a lift."""
        return cls(lift=lift, by=lockout.by, reason=lockout.reason, since=lockout.since)


class LockoutEndedAnswer(_Part):
    """A lockout that is over."""

    lift: str
    by: str = Field(description="Who ended it.")
    at: AwareDatetime
    lockout: LockoutAnswer

    @classmethod
    def of(cls, lift: str, ended: LockoutEnded) -> LockoutEndedAnswer:
        """Return the answer about a lift."""
        return cls(lift=lift, by=ended.by, at=ended.at, lockout=LockoutAnswer.of(lift, ended.lockout))


class ForceReleasedAnswer(_Part):
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
