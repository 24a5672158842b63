"""What a site file may say: one building's controllers and lifts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, StringConstraints, Tag

from register_maps.words import Side, Table

Text = Annotated[
    str,
    StringConstraints(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f\x7f]+$"),
    Field(description="text on one line, without control characters"),
]
Seconds = Annotated[float, Field(gt=0, le=86400)]
Wait = Annotated[float, Field(gt=0, le=10)]
"""For an answer, a connection or a fresh reading: whoever waits longer than this has no news but history."""
Port = Annotated[int, Field(strict=True, ge=1, le=65535)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


Code = Annotated[int, Field(strict=True, ge=-32768, le=65535)]


class Floor(_Part):
    """One floor of one lift."""

    code: Code
    """What the controller calls it."""
    doors: tuple[Side, ...] | None = None
    """Which doors serve it; all doors of the map when not said."""


def _form(value: object) -> str:
    return "[long]" if isinstance(value, dict | Floor) else "[short]"


def _floor(value: int | Floor) -> Floor:
    """`L1: 1` is short for `L1: {code: 1}`."""
    return Floor(code=value) if isinstance(value, int) else value


if TYPE_CHECKING:
    AnyFloor = Floor
else:
    # a tagged union and not a BeforeValidator: behind one, pydantic no longer knows that lists and words came from JSON
    AnyFloor = Annotated[
        Annotated[Code, Tag("[short]")] | Annotated[Floor, Tag("[long]")], Discriminator(_form), AfterValidator(_floor)
    ]


class Api(_Part):
    """Where the manager listens."""

    host: Text = "127.0.0.1"
    port: Port = 5003
    """5003 is where clients of the Open-RMF workshop look."""


class Controller(_Part):
    """One device at one address. What is left out comes from its map."""

    host: Text
    port: Port = 502
    map: Text
    """A shipped map by name, or a path relative to the site file."""
    unit_id: Annotated[int, Field(strict=True, ge=0, le=255)] | None = None
    timeout_s: Wait | None = None
    connect_timeout_s: Wait = 1.0
    min_gap_s: Annotated[float, Field(ge=0, le=10)] | None = None
    reconnect_min_s: Seconds | None = None
    max_registers_per_read: Annotated[int, Field(strict=True, ge=1, le=125)] | None = None
    max_bits_per_read: Annotated[int, Field(strict=True, ge=1, le=2000)] | None = None
    tid_echo: bool | None = None


class Lift(_Part):
    """One lift on a controller."""

    controller: Text
    floors: dict[Text, AnyFloor] = Field(min_length=2)
    """Lowest first."""
    access: Literal["monitor", "control"] = "monitor"
    """`monitor` writes not one byte."""
    offset: dict[Table, Annotated[int, Field(strict=True, ge=-65535, le=65535)]] = Field(default_factory=dict)
    """Moves every address of a table, for one lift of several on a controller."""
    unit_id: Annotated[int, Field(strict=True, ge=0, le=255)] | None = None
    poll_s: Annotated[float, Field(ge=0.02, le=60)] = 0.2
    max_age_s: Wait | None = None
    lease_s: Seconds = 300.0
    max_session_hold_s: Seconds = 900.0
    accept_latching: Text | None = None
    """Why it is acceptable that an output stays on when this manager is lost and nothing lets it go."""


class Site(_Part):
    """One building."""

    schema_: Literal[1] = Field(alias="schema")
    name: Text
    api: Api = Api()
    controllers: dict[Text, Controller] = Field(min_length=1)
    lifts: dict[Text, Lift] = Field(min_length=1)
