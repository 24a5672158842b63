"""Sessions: who commands a lift, the requests within a session, and their outcomes."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from pydantic import AwareDatetime, BeforeValidator, ConfigDict, Field, JsonValue, model_validator
from pydantic.config import JsonDict
from pydantic_core import PydanticCustomError

from lift_manager.api.fields import Answer, Door, HolderName, Recorded, RequestModel, Seconds, ShortName, Token
from lift_manager.lift.commands import CommandState, CommandStatus, CommandType
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.session import Advice, EndReason

Ttl = Annotated[
    float | None,
    Field(
        default=None,
        ge=1.0,
        le=86400.0,
        description="The lease in seconds. The site's `lease_s` is the maximum and the default. A lease shorter than three times the lift's"
        " `clear_s` is raised to that; `lease_ends_in_s` has the actual lease.",
        examples=[60.0],
    ),
]
RobotName = Annotated[
    ShortName | None,
    Field(
        default=None,
        description="Distinguishes the robots of one key, and callers without a key; shown to people.",
        examples=["amr-7"],
    ),
]
IdempotencyKey = Annotated[
    Token | None,
    Field(
        default=None,
        description="Chosen by the caller, one for each request. The same key with the same request gives the same answer and begins nothing;"
        " with another request it is refused (`key_reused`). A caller without a key of the site must give its `robot` with it.",
        examples=["3f1c9a"],
    ),
]


def _require_true(value: object) -> object:
    # to Literal, 1 is True as well
    if value is not None and value is not True:
        raise PydanticCustomError("not_true", "must be true")
    return value


_Clear = Annotated[Literal[True] | None, BeforeValidator(_require_true)]


class OpenSessionRequest(RequestModel):
    """Open a session: the lift is reserved for one caller. This calls no car."""

    robot: RobotName
    ttl_s: Ttl
    idempotency_key: IdempotencyKey


class RenewRequest(RequestModel):
    """Renew the lease."""

    ttl_s: float | None = Field(
        default=None,
        ge=1.0,
        le=86400.0,
        description="A new length of the lease in seconds, at most the site's `lease_s` and at least three times `clear_s`. By default the"
        " lease keeps its length.",
        examples=[60.0],
    )


class CloseRequest(RequestModel):
    """End the session."""

    robot: RobotWord | None = Field(
        default=None,
        strict=False,
        description="`left`: the robot is outside and clear of the door. A lift with a handshake receives this report.",
    )


class HandOverRequest(RequestModel):
    """Hand the session over to another caller."""

    to: ShortName = Field(description="The name of a key, or of a robot if the site has no keys.", examples=["amr-8"])
    robot: RobotName


class _BelongsTo(NamedTuple):
    """The type of command to which a field belongs."""

    do: CommandType
    needed: bool


_FIELDS = {
    "floor": _BelongsTo(CommandType.GO_TO, needed=True),
    "clear": _BelongsTo(CommandType.CLOSE_DOOR, needed=True),
    "door": _BelongsTo(CommandType.CLOSE_DOOR, needed=False),
}


def _conditions() -> JsonDict:
    """Return the conditions of `_FIELDS` for the JSON schema of a command."""
    rules: list[JsonValue] = []
    for name, (do, needed) in _FIELDS.items():
        given: JsonDict = {"required": [name], "properties": {name: {"not": {"type": "null"}}}}
        rule: JsonDict = {
            "if": {"properties": {"do": {"const": do.value}}},
            "else": {"properties": {name: {"type": "null"}}},
        }
        rules.append(rule | {"then": given} if needed else rule)
    return {"allOf": rules}


class CommandRequest(RequestModel):
    """A command within a session."""

    model_config = ConfigDict(json_schema_extra=_conditions())

    do: CommandType = Field(strict=False)
    floor: str | None = Field(default=None, max_length=200, description="With `go_to`.", examples=["L2"])
    hold_door: bool = Field(default=True, description="With `go_to`: hold the door open once the car has arrived.")
    door: Door | None = Field(
        default=None, description="With `close_door`: one door; by default all doors of the floor."
    )
    clear: _Clear = Field(default=None, description="Required with `close_door`: confirms that the doorway is clear.")
    idempotency_key: IdempotencyKey

    @model_validator(mode="after")
    def _fits(self) -> CommandRequest:
        for name, (do, needed) in _FIELDS.items():
            given = getattr(self, name) is not None
            if self.do is do and needed and not given:
                raise _misfit(name, f"is missing: {self.do} needs it")
            if self.do is not do and given:
                raise _misfit(name, f"does not go with {self.do}")
        return self


def _misfit(field: str, text: str) -> PydanticCustomError:
    return PydanticCustomError("misfit", "{text}", {"field": field, "text": text})


class Over(Answer):
    """Why a session has ended."""

    reason: EndReason
    text: str
    advice: Advice | None = Field(description="What the robot should do; null if the holder ended the session.")
    at: AwareDatetime


class Session(Answer):
    """A session, for its holder."""

    id: str = Field(description="Commands the lift together with the holder's key; keep it secret.")
    lift: str
    holder: HolderName = Field(examples=["api:amr-7"])
    floor: str | None
    hold_door: bool
    opened_at: AwareDatetime
    lease_ends_in_s: Seconds | None
    ends_in_s: Seconds | None = Field(description="Time until the session ends, however often it is renewed.")
    hold_ends_in_s: Seconds | None = Field(
        description="Time until the door hold ends, whatever the holder requests; null while the door is not held."
    )
    releases_in_s: Seconds | None = Field(
        default=None,
        description="Time until the manager releases the door by itself at the earliest, by any limit; see `releases_in_s` of a lift. null"
        " for a session that has ended.",
    )
    arrived: bool
    door_held: bool
    robot: Occupancy
    waiting_for: str
    restored: bool = Field(
        description="Whether it was restored after a restart: nothing is pressed until its holder sends a request."
    )
    over: Over | None = Field(description="null while the session is open.")
    recorded: Recorded = True


class Command(Answer):
    """A command within a session, and its status."""

    id: str
    lift: str
    do: CommandType
    floor: str | None
    status: CommandState
    reason: str = Field(description="Why it is not confirmed; while pending, what it is waiting for.")
    proof: str = Field(
        description="What confirmed it: `readback`, `lamp` or `effect`; `none` if the lift needed no command.",
        examples=["lamp"],
    )
    asked_at: AwareDatetime
    ended_at: AwareDatetime | None
    recorded: Recorded = True

    @classmethod
    def of(cls, status: CommandStatus) -> Command:
        """Return the current state of a command."""
        return cls(
            id=status.id,
            lift=status.lift,
            do=status.kind,
            floor=status.floor,
            status=status.state,
            reason=status.reason,
            proof=status.proof,
            asked_at=status.requested_at,
            ended_at=status.ended_at,
        )
