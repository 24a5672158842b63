"""Sessions: who commands a lift, what is asked within them, and what became of it."""

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
        description="The lease in seconds; the site's `lease_s` is the longest, and what is given where this is left out. A shorter one than"
        " three times the lift's `clear_s` is raised to that; `lease_ends_in_s` says what was given.",
        examples=[60.0],
    ),
]
RobotName = Annotated[
    ShortName | None,
    Field(
        default=None,
        description="Tells the robots of one key apart, and callers without a key; shown to people.",
        examples=["amr-7"],
    ),
]
IdempotencyKey = Annotated[
    Token | None,
    Field(
        default=None,
        description="Made up by the caller, one for each wish: the same one again gives the same answer and begins nothing;"
        " with another wish it is refused (`key_reused`). A caller without a key of the site has to name its `robot` with it.",
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
    """The lift for one caller alone. Nothing is called by it."""

    robot: RobotName
    ttl_s: Ttl
    idempotency_key: IdempotencyKey


class RenewRequest(RequestModel):
    """The lease begins anew."""

    ttl_s: float | None = Field(
        default=None,
        ge=1.0,
        le=86400.0,
        description="Another length of the lease in seconds, at most the site's `lease_s` and at least three times `clear_s`; left out, it"
        " stays as long as it was.",
        examples=[60.0],
    )


class CloseRequest(RequestModel):
    """The session is over."""

    robot: RobotWord | None = Field(
        default=None,
        strict=False,
        description="`left`: the robot is outside and clear of the door, which a lift that asks for it is told.",
    )


class HandOverRequest(RequestModel):
    """Another caller goes on with it."""

    to: ShortName = Field(
        description="The name of a key, or of a robot where the site has no keys.", examples=["amr-8"]
    )
    robot: RobotName


class _With(NamedTuple):
    """What a key of a command goes with."""

    do: CommandType
    needed: bool


_WITH = {
    "floor": _With(CommandType.GO_TO, needed=True),
    "clear": _With(CommandType.CLOSE_DOOR, needed=True),
    "door": _With(CommandType.CLOSE_DOOR, needed=False),
}


def _conditions() -> JsonDict:
    """Return the same for the schema of a command."""
    rules: list[JsonValue] = []
    for name, (do, needed) in _WITH.items():
        given: JsonDict = {"required": [name], "properties": {name: {"not": {"type": "null"}}}}
        rule: JsonDict = {
            "if": {"properties": {"do": {"const": do.value}}},
            "else": {"properties": {name: {"type": "null"}}},
        }
        rules.append(rule | {"then": given} if needed else rule)
    return {"allOf": rules}


class CommandRequest(RequestModel):
    """One thing to do within a session."""

    model_config = ConfigDict(json_schema_extra=_conditions())

    do: CommandType = Field(strict=False)
    floor: str | None = Field(default=None, max_length=200, description="With `go_to`.", examples=["L2"])
    hold_door: bool = Field(default=True, description="With `go_to`: hold the door once the car is there.")
    door: Door | None = Field(
        default=None, description="With `close_door`: one door; all of the floor where it is left out."
    )
    clear: _Clear = Field(default=None, description="With `close_door`, which needs it: nothing stands in the doorway.")
    idempotency_key: IdempotencyKey

    @model_validator(mode="after")
    def _fits(self) -> CommandRequest:
        for name, (do, needed) in _WITH.items():
            given = getattr(self, name) is not None
            if self.do is do and needed and not given:
                raise _misfit(name, f"is missing: {self.do} needs it")
            if self.do is not do and given:
                raise _misfit(name, f"does not go with {self.do}")
        return self


def _misfit(field: str, text: str) -> PydanticCustomError:
    return PydanticCustomError("misfit", "{text}", {"field": field, "text": text})


class Over(Answer):
    """Why a session is over."""

    reason: EndReason
    text: str
    advice: Advice | None = Field(description="What its robot does best; null where its holder ended it.")
    at: AwareDatetime


class Session(Answer):
    """A session as its holder sees it."""

    id: str = Field(description="Whoever knows it, and has the holder's key, commands the lift.")
    lift: str
    holder: HolderName = Field(examples=["api:amr-7"])
    floor: str | None
    hold_door: bool
    opened_at: AwareDatetime
    lease_ends_in_s: Seconds | None
    ends_in_s: Seconds | None = Field(description="However often it is renewed.")
    hold_ends_in_s: Seconds | None = Field(
        description="The door is let go then whatever the holder wants; null while it is not held."
    )
    releases_in_s: Seconds | None = Field(
        default=None,
        description="Until the manager releases the door by itself at the earliest, whichever limit that is; `releases_in_s` of a lift has"
        " more. null for one that is over.",
    )
    arrived: bool
    door_held: bool
    robot: Occupancy
    waiting_for: str
    restored: bool = Field(description="From before a restart: nothing is pressed before its holder is heard.")
    over: Over | None = Field(description="null while it goes on.")
    recorded: Recorded = True


class Command(Answer):
    """A request within a session, and what has become of it."""

    id: str
    lift: str
    do: CommandType
    floor: str | None
    status: CommandState
    reason: str = Field(description="Why it is not confirmed; while pending, what it waits for.")
    proof: str = Field(
        description="What confirmed it: `readback`, `lamp` or `effect`; `none` where the lift need not be told.",
        examples=["lamp"],
    )
    asked_at: AwareDatetime
    ended_at: AwareDatetime | None
    recorded: Recorded = True

    @classmethod
    def of(cls, status: CommandStatus) -> Command:
        """Return it as it is now."""
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
