"""Operator actions: acknowledge, lock out, drain, and take a lift from its holder."""

from __future__ import annotations

from typing import Annotated

from pydantic import AwareDatetime, Field

from lift_manager.api.fields import Answer, Recorded, RequestModel, ShortName, Words
from lift_manager.lift.events import Acknowledged, Cause, ForceReleased, Restriction, RestrictionEnded

Name = Annotated[ShortName, Field(description="The person who acts.", examples=["M. Weber"])]
Reason = Annotated[Words, Field(description="Why robots are kept off.", examples=["door operator is being replaced"])]
ReleaseReason = Annotated[
    Words, Field(description="Why the lift is taken from its holder.", examples=["the robot was carried away"])
]

Now = Annotated[
    bool,
    Field(
        description="Release a held door at once. By default `robot_door` stops being `open` at once and the door is released `clear_s`"
        " later, so that a robot in the doorway can clear it."
    ),
]

StoodAtLift = Annotated[
    bool,
    Field(
        description="The person says: I stood at the lift and looked. The journal has it beside the name. The manager's page takes no"
        " acknowledgement, no lockout and no end of one without it."
    ),
]


class AcknowledgeRequest(RequestModel):
    """Acknowledge that the lift was checked after a fire, or that no robot is in the car."""

    by: Name
    stood_at_lift: StoodAtLift = False


class LockoutRequest(RequestModel):
    """Lock the lift out: no robot may command it."""

    by: Name
    reason: Reason
    now: Now = False
    stood_at_lift: StoodAtLift = False


class EndLockoutRequest(RequestModel):
    """End the lockout: robots may command the lift again."""

    by: Name
    stood_at_lift: StoodAtLift = False


class DrainRequest(RequestModel):
    """Drain the lift: no new session begins, and the current one continues to its end."""

    by: Name
    reason: Reason


class EndDrainRequest(RequestModel):
    """End the drain: sessions may begin again."""

    by: Name


class ForceReleaseRequest(RequestModel):
    """Take the lift from its holder: the session ends."""

    by: Name
    reason: ReleaseReason
    now: Now = False


class AcknowledgedAnswer(Answer):
    """What was acknowledged."""

    lift: str
    by: str
    at: AwareDatetime
    acknowledged: tuple[Cause, ...] = Field(
        description="`fire`: the lift was checked after a fire. `occupied`: no robot is in the car."
        " `contradiction`: wiring and map were checked."
    )
    recorded: Recorded = True

    @classmethod
    def of(cls, event: Acknowledged) -> AcknowledgedAnswer:
        """Return the answer for a lift."""
        return cls(lift=event.lift, by=event.by, at=event.at, acknowledged=event.causes)


class LockoutAnswer(Answer):
    """A lockout that is in force."""

    lift: str
    by: str
    reason: str
    since: AwareDatetime
    recorded: Recorded = True

    @classmethod
    def of(cls, lift: str, lockout: Restriction) -> LockoutAnswer:
        """Return the answer for a lift."""
        return cls(lift=lift, by=lockout.by, reason=lockout.reason, since=lockout.since)


class LockoutEndedAnswer(Answer):
    """A lockout that is over."""

    lift: str
    by: str = Field(description="Who ended it.")
    at: AwareDatetime
    lockout: LockoutAnswer
    recorded: Recorded = True

    @classmethod
    def of(cls, ended: RestrictionEnded) -> LockoutEndedAnswer:
        """Return the answer for a lift."""
        lockout = LockoutAnswer.of(ended.lift, ended.restriction)
        return cls(lift=ended.lift, by=ended.by, at=ended.at, lockout=lockout)


class DrainAnswer(Answer):
    """A drain that is in force."""

    lift: str
    by: str
    reason: str
    since: AwareDatetime
    recorded: Recorded = True

    @classmethod
    def of(cls, lift: str, drain: Restriction) -> DrainAnswer:
        """Return the answer for a lift."""
        return cls(lift=lift, by=drain.by, reason=drain.reason, since=drain.since)


class DrainEndedAnswer(Answer):
    """A drain that is over."""

    lift: str
    by: str = Field(description="Who ended it.")
    at: AwareDatetime
    drain: DrainAnswer
    recorded: Recorded = True

    @classmethod
    def of(cls, ended: RestrictionEnded) -> DrainEndedAnswer:
        """Return the answer for a lift."""
        drain = DrainAnswer.of(ended.lift, ended.restriction)
        return cls(lift=ended.lift, by=ended.by, at=ended.at, drain=drain)


class ForceReleasedAnswer(Answer):
    """A session that a person ended."""

    lift: str
    by: str
    reason: str
    at: AwareDatetime
    holder: str = Field(description="Who held the lift, as `<face>:<name>`.")
    maybe_aboard: bool = Field(
        description="Whether a robot may be in the car: all others are refused until a person has checked the car and acknowledges."
    )
    clear_s: float = Field(
        default=0.0, description="In how many seconds the door is released and the session ends; 0 if that is done."
    )
    text: str = Field(description="The result, in a sentence for the person who acted.")
    recorded: Recorded = True

    @classmethod
    def of(cls, released: ForceReleased) -> ForceReleasedAnswer:
        """Return the answer for a lift."""
        return cls(
            lift=released.lift,
            by=released.by,
            reason=released.reason,
            at=released.at,
            holder=str(released.holder),
            maybe_aboard=released.maybe_aboard,
            clear_s=released.clear_s,
            text=released.text,
        )
