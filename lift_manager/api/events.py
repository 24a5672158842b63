"""What the event stream says. Each event has an id, a name (`event:` of the stream) and one of these objects as its data.

An event tells when to ask. What a robot acts on is the answer of GET, or an event whose age plus the time since it was received is
within the lift's `max_age_s`; one that waited, on the way or behind a broken connection, may be of another moment. An event that is
older than that when it is handed out invites nobody: a state is offline, and `enter` and `leave` are `wait` and `stay`.
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
    """How things are; what follows are changes. The first event of a stream that does not go on from an earlier one."""

    event: Literal["snapshot"] = "snapshot"
    lifts: tuple[Lift, ...]
    rides: tuple[Ride, ...]
    lost: bool = Field(description="The events after `Last-Event-ID` are gone, or were those of another process.")


class StateEvent(Answer):
    """What a lift publishes has changed in more than its age.

    Its ages are right within 0.25 s when it is handed to the connection; what was received is as old as that and the time since.
    One that is older than the lift's `max_age_s` by then says `offline`, whatever the lift was.
    """

    event: Literal["state"] = "state"
    lift: Lift


class SessionEvent(Answer):
    """Who holds a lift has changed."""

    event: Literal["session"] = "session"
    lift: str
    what: Literal["opened", "restored", "handed_over", "ended"]
    holder: str
    to: str | None = Field(default=None, description="Floor that it began with, or who it was handed over to.")
    reason: EndReason | None = None
    text: str = ""
    advice: Advice | None = None


class AdviceEvent(Answer):
    """The robot of a session is told what to do before anything is let go: there is a fire."""

    event: Literal["advice"] = "advice"
    lift: str
    holder: str
    advice: Advice
    text: str


class CommandEvent(Answer):
    """A command to a lift has ended: what the manager pressed, for whomever."""

    event: Literal["command"] = "command"
    lift: str
    command: str = Field(examples=["go_to L2"])
    holder: str | None
    result: str = Field(examples=["confirmed"])
    proof: str
    reason: str


class RequestEvent(Answer):
    """A request within a session of /api/v1 was taken or has ended. Its id is told to the session's holder alone."""

    event: Literal["request"] = "request"
    lift: str
    holder: str
    do: CommandType
    floor: str | None
    status: CommandState
    reason: str


class RideEvent(Answer):
    """A ride has changed.

    One that is older than the lift's `max_age_s` when it is handed to the connection says `wait` for `enter` and `stay` for `leave`, and
    its reason says so.
    """

    event: Literal["ride"] = "ride"
    ride: Ride
    age_s: Seconds = Field(
        default=0.0, description="Seconds since it was published, within 0.25 s, when it is handed to the connection."
    )


class AlarmEvent(Answer):
    """Something a person should know of."""

    event: Literal["alarm"] = "alarm"
    lift: str
    text: str
    holder: str | None


PersonWord = Literal["acknowledged", "locked_out", "lockout_over", "drain_begun", "drain_over", "released"]


class PersonEvent(Answer):
    """A person's word about a lift."""

    event: Literal["person"] = "person"
    lift: str
    what: PersonWord
    by: str
    text: str
    at: AwareDatetime


class Lost(Answer):
    """This reader was too slow: its oldest events are gone, and so many. A snapshot follows."""

    event: Literal["lost"] = "lost"
    events: int


class Frame(Answer):
    """One frame on the wire of a link, for tools."""

    event: Literal["frame"] = "frame"
    link: str
    sent: bool = Field(description="To the controller; otherwise from it.")
    hex: str
    text: str = Field(description="In words.")
    at_s: float = Field(description="Monotonic seconds of the manager: only differences mean anything.")


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
