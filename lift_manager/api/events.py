"""The event stream. Each event has an id, a name (`event:` of the stream) and one of these objects as its data.

An event shows when to send a GET. A robot acts on the answer of GET, or on an event whose age plus the time since it was received is
within the lift's `max_age_s`: an event may have been delayed in transit or by a broken connection. An event that is older than that when
it is sent invites nobody: a state becomes offline, and `enter` and `leave` become `wait` and `stay`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AwareDatetime, Field

from lift_manager.api.fields import Answer, Seconds
from lift_manager.api.lifts import Lift
from lift_manager.api.rides import Ride
from lift_manager.lift.commands import CommandState, CommandType
from lift_manager.lift.session import Advice, EndReason


class Snapshot(Answer):
    """The current state; changes follow. The first event of a stream that does not continue an earlier one."""

    event: Literal["snapshot"] = "snapshot"
    lifts: tuple[Lift, ...]
    rides: tuple[Ride, ...]
    lost: bool = Field(description="Whether the events after `Last-Event-ID` are lost, or belong to another process.")


class StateEvent(Answer):
    """The published state of a lift has changed in more than its age.

    Its ages are correct within 0.25 s when it is passed to the connection; a client adds the time since it received the event.
    A state that is older than the lift's `max_age_s` by then is `offline`, whatever it was before.
    """

    event: Literal["state"] = "state"
    lift: Lift


class SessionEvent(Answer):
    """A session has begun or ended, or has another holder."""

    event: Literal["session"] = "session"
    lift: str
    what: Literal["opened", "restored", "handed_over", "ended"]
    holder: str
    to: str | None = Field(
        default=None, description="The floor with which it began, or the caller to whom it was handed over."
    )
    reason: EndReason | None = None
    text: str = ""
    advice: Advice | None = None


class AdviceEvent(Answer):
    """Advice to the robot of a session in a fire, before the manager releases its outputs."""

    event: Literal["advice"] = "advice"
    lift: str
    holder: str
    advice: Advice
    text: str


class CommandEvent(Answer):
    """A command to a lift has ended. Covers every press of the manager, for any holder."""

    event: Literal["command"] = "command"
    lift: str
    command: str = Field(examples=["go_to L2"])
    holder: str | None
    result: str = Field(examples=["confirmed"])
    proof: str
    reason: str


class RequestEvent(Answer):
    """A command within a session of /api/v1 was accepted or has ended. Only the holder of the session knows its id."""

    event: Literal["request"] = "request"
    lift: str
    holder: str
    do: CommandType
    floor: str | None
    status: CommandState
    reason: str


class RideEvent(Answer):
    """A ride has changed.

    If it is older than the lift's `max_age_s` when it is passed to the connection, it has `wait` for `enter` and `stay` for `leave`, with
    that as its reason.
    """

    event: Literal["ride"] = "ride"
    ride: Ride
    age_s: Seconds = Field(
        default=0.0,
        description="Seconds since it was published, when it is passed to the connection; correct within 0.25 s.",
    )


class AlarmEvent(Answer):
    """Something that a person should know about."""

    event: Literal["alarm"] = "alarm"
    lift: str
    text: str
    holder: str | None


PersonWord = Literal["acknowledged", "locked_out", "lockout_over", "drain_begun", "drain_over", "released"]


class PersonEvent(Answer):
    """An operator action on a lift."""

    event: Literal["person"] = "person"
    lift: str
    what: PersonWord
    by: str
    text: str
    at: AwareDatetime


class Lost(Answer):
    """This reader was too slow: this many of its oldest events are lost. A snapshot follows."""

    event: Literal["lost"] = "lost"
    events: int


class Frame(Answer):
    """One frame on a link, for tools."""

    event: Literal["frame"] = "frame"
    link: str
    sent: bool = Field(description="Whether it was sent to the controller; otherwise it came from it.")
    hex: str
    text: str = Field(description="The frame in words.")
    at_s: float = Field(description="Seconds of the manager's monotonic clock: only differences are meaningful.")


class Links(Answer):
    """Every controller of the site, by its name in the site file."""

    links: tuple[str, ...] = Field(examples=[["plc"]])


AnyEvent = Annotated[
    Snapshot
    | StateEvent
    | SessionEvent
    | AdviceEvent
    | CommandEvent
    | RequestEvent
    | RideEvent
    | AlarmEvent
    | PersonEvent
    | Lost
    | Frame,
    Field(discriminator="event"),
]
