"""What a site and the hub send each other, as JSON. Times of day are for people; nobody compares those of two computers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, StringConstraints, model_validator
from pydantic_core import PydanticCustomError

from lift_manager.api.fields import Answer, Recorded, RequestModel, Seconds, Token
from lift_manager.api.lifts import Age, Held, Lift, Restricted
from lift_manager.api.rides import CancelRequest, Plan, Ride, RideRequest
from lift_manager.api.sessions import Command, CommandRequest, OpenSessionRequest, RenewRequest, Session
from lift_manager.lift.commands import CommandType
from lift_manager.lift.state import Quality
from lift_manager.rides import ride as rides
from lift_manager.rides.ride import Phase
from register_maps.words import Door, Mode, Motion, Side

NEWS_EVERY_S = 2.0
"""How often a site reports that it runs. Chosen: a site that is lost is known to be so in three of them."""

TICKET_S = 2.0
"""How long a ticket is good, on the clock of the site that issued it."""


class _Message(BaseModel):
    """Comes from another computer, of any version: strict in what it reads, and blind to what it does not know."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class Position(_Message):
    """A row in a stream of a site."""

    stream: str = Field(max_length=64)
    """When the stream was created: the positions of another one mean nothing."""
    at: int = Field(ge=0, lt=2**63)
    """The number of the row in the stream; 0 for none."""


class News(_Message):
    """A manager reports that it runs."""

    name: str = Field(max_length=64)
    """The name of the site in its site file."""
    version: str = Field(max_length=64)
    lifts: int = Field(ge=0, le=1_000_000)
    live: int = Field(ge=0, le=1_000_000)
    commands: bool
    """Whether the site takes commands from the hub."""
    newest: Position | None = None
    """Of the newest row in the stream; None while the stream cannot be used."""


class RowMessage(_Message):
    """One row of a journal, as it is in the stream."""

    journal: str = Field(max_length=32)
    """Of the journal: rows with the same number in another journal are other rows."""
    seq: int = Field(ge=1, lt=2**63)
    at: int = Field(ge=-(2**53), le=2**53)
    """Microseconds since 1970, on the clock of the site."""
    kind: str = Field(max_length=32)
    lift: str = Field(max_length=64)
    caller: str = Field(max_length=300)
    text: str = Field(max_length=16_384)
    data: str = Field(max_length=262_144)
    """Canonical JSON, as it is hashed. The longest is that of a start, with the maps of all lifts."""
    hash: str = Field(pattern=r"^[0-9a-f]{64}$")


class RemoteLift(Answer):
    """One lift of a site as the hub shows it: for people and statistics. A robot is guided by its own site."""

    name: str
    floors: tuple[str, ...] = Field(description="Lowest first.")
    quality: Quality
    reason: str = Field(description="Why it is offline.")
    age_s: Age
    max_age_s: float
    floor: str | None
    standing: bool
    destination: str | None
    doors: Mapping[Side, Door] = Field(description="The state of each door. No robot may act on it.")
    motion: Motion
    mode: Mode
    session: Held | None
    waiting: int
    restrictions: Restricted
    not_visible: Mapping[str, str]

    @classmethod
    def of(cls, lift: Lift) -> RemoteLift:
        """Return a lift without what guides a robot: `robot_door`, permissions, and the announced release."""
        return cls.model_validate(lift)

    def after(self, seconds: float) -> RemoteLift:
        """Return the lift once the reply was this long under way; one that may be older than `max_age_s` by then is offline."""
        if self.quality is not Quality.LIVE or self.age_s is None or self.age_s + seconds <= self.max_age_s:
            return self
        lost: dict[str, object] = {
            "quality": Quality.OFFLINE,
            "reason": f"with the round trip to its site, the reading may be older than {self.max_age_s:g} s",
            "floor": None,
            "standing": False,
            "doors": {},
            "motion": Motion.UNKNOWN,
            "mode": Mode.UNKNOWN,
        }
        return self.model_copy(update=lost)


class RemoteLifts(Answer):
    """The reply of a site to the request for its lifts."""

    lifts: tuple[RemoteLift, ...]


class RemoteRide(Answer):
    """One ride of a site as the hub shows it. What its robot is to do is known at the site alone."""

    model_config = ConfigDict(populate_by_name=True)

    id: str
    lift: str
    any_lift: bool
    from_: str = Field(alias="from")
    to: str
    robot: str
    caller: str
    phase: Phase
    ahead: int | None
    maybe_aboard: bool
    begun_at: AwareDatetime
    changed_at: AwareDatetime
    recorded: Recorded = True

    @classmethod
    def of(cls, ride: rides.Ride) -> RemoteRide:
        """Return a ride without what guides its robot."""
        return cls.model_validate(Ride.of(ride))


class RemoteRides(Answer):
    """The reply of a site to the request for its rides."""

    rides: tuple[RemoteRide, ...]


class LiftsRequest(_Message):
    """Request for one lift, or for all."""

    lift: str | None = Field(default=None, max_length=64)


class RidesRequest(_Message):
    """Request for one ride, or for all."""

    ride: str | None = Field(default=None, max_length=64)


class Ticket(Answer):
    """Allows one command, if it arrives in time."""

    ticket: str = Field(description="To be sent with one command, within `good_for_s` of when the site issued it.")
    good_for_s: Seconds = TICKET_S


class OpenSession(RequestModel):
    """Open a session."""

    what: Literal["open"]
    body: OpenSessionRequest


class RenewSession(RequestModel):
    """Renew the lease of a session."""

    what: Literal["renew"]
    session: Annotated[str, StringConstraints(min_length=1, max_length=64)]
    body: RenewRequest = RenewRequest()


class CloseSession(RequestModel):
    """End a session; the car stays where it is."""

    what: Literal["close"]
    session: Annotated[str, StringConstraints(min_length=1, max_length=64)]


class SendCommand(RequestModel):
    """Send a command within a session."""

    what: Literal["command"]
    session: Annotated[str, StringConstraints(min_length=1, max_length=64)]
    body: CommandRequest


class BeginRide(RequestModel):
    """Begin a ride, which waits until its robot reports at the site."""

    what: Literal["ride"]
    body: RideRequest


class CancelRide(RequestModel):
    """Cancel a ride; a robot that may be inside is let out first."""

    what: Literal["cancel_ride"]
    ride: Annotated[str, StringConstraints(min_length=1, max_length=64)]
    body: CancelRequest = CancelRequest()


LiftAction = OpenSession | RenewSession | CloseSession | SendCommand
"""What is sent for one lift."""
RideAction = BeginRide | CancelRide
"""What names its lift itself."""
Action = Annotated[LiftAction | RideAction, Field(discriminator="what")]
"""All that the hub may command. Acknowledging, lockouts, drains and forced releases are for people at the site, and what a ride's robot
reports is for the robot."""

REMOTE = frozenset({CommandType.GO_TO, CommandType.HOLD_DOOR, CommandType.RELEASE_DOOR})
"""The commands within a session. The others claim what only somebody at the lift knows: that the doorway is clear, that the robot is in
place, or out; the last of these would be as good as an acknowledgement."""


class SignedCommand(RequestModel):
    """A command, signed by its user with a key of the site."""

    ticket: Token
    key_id: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{8}$")] = Field(
        description="The id of a key of the site: the first eight digits of the key."
    )
    signature: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-]{43}$")] = Field(
        description="HMAC-SHA256 in base64url; see `docs/reference/hub.md`."
    )
    action: Annotated[str, StringConstraints(min_length=2, max_length=4096)] = Field(
        description="The action as JSON text: it is signed as it is."
    )


class CommandMessage(_Message):
    """A command on its way to a site."""

    lift: str = Field(max_length=64)
    """Empty for a ride."""
    command: SignedCommand


class ProblemMessage(_Message):
    """Why a site did not do what was requested."""

    code: str = Field(max_length=64)
    status: int = Field(ge=400, le=599)
    message: str = Field(max_length=4000)


class CommandResult(Answer):
    """What became of a command: the session, the command within it, the ride, or the plan of a ride.

    The id of a session reaches its holder through here alone.
    """

    session: Session | None = None
    command: Command | None = None
    ride: RemoteRide | None = None
    plan: Plan | None = None

    @model_validator(mode="after")
    def _has_one(self) -> CommandResult:
        if sum(part is not None for part in (self.session, self.command, self.ride, self.plan)) != 1:
            raise PydanticCustomError("misfit", "must have one of session, command, ride and plan")
        return self
