"""What a register-map file may say: the pydantic form of `maps/*.yaml`.

This module checks each field by itself. What only makes sense across fields (overlaps, ranges a device does
not serve, a confirmation that names no signal) is checked by `register_maps.check`. The grammar is explained, with the
26 interface features it was designed against, in README.md of this folder.
"""

from __future__ import annotations

import re
from enum import StrEnum, unique
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, model_validator

from register_maps.words import BIT_TABLES, Door, Mode, Motion, Side, Table

SCHEMA_VERSION = 1

_ADDRESS = re.compile(
    r"(?P<table>coil|discrete|holding|input):(?P<number>0[xX][0-9a-fA-F]+|[0-9]+)(?:\.(?P<bit>[0-9]+))?"
)


@unique
class Kind(StrEnum):
    """What sort of value a signal carries."""

    FLOOR = "floor"
    DOOR = "door"
    MOTION = "motion"
    MODE = "mode"
    FLAG = "flag"
    NUMBER = "number"
    COUNTER = "counter"


_FLAGS = [
    "level",
    "door_zone",
    "robot_mode_on",
    "may_enter",
    "may_leave",
    "ready",
    "fire",
    "fireman",
    "emergency_power",
    "inspection",
    "independent",
    "attendant",
    "overload",
    "nudging",
    "out_of_service",
    "robots_allowed",
    "passenger_alarm",
    "fault",
]

SIGNALS: dict[str, Kind] = {
    "car_floor": Kind.FLOOR,
    "destination": Kind.FLOOR,
    "call_accepted": Kind.FLOOR,
    "motion": Kind.MOTION,
    "mode": Kind.MODE,
    "alive": Kind.COUNTER,
    "load": Kind.NUMBER,
    "fault_code": Kind.NUMBER,
    "identity": Kind.NUMBER,
    **{f"door.{side}": Kind.DOOR for side in Side},
    **{f"obstruction.{side}": Kind.FLAG for side in Side},
    **dict.fromkeys(_FLAGS, Kind.FLAG),
}
"""Every signal a map may declare, and its kind. Nothing else is accepted."""

COMMANDS: tuple[str, ...] = (
    "go_to",
    "robot_mode",
    *(f"hold_door.{side}" for side in Side),
    *(f"close_door.{side}" for side in Side),
)
"""Every command a map may declare: only what a passenger can do, and the controller's own robot mode."""

WORDS: dict[Kind, type[StrEnum]] = {Kind.DOOR: Door, Kind.MOTION: Motion, Kind.MODE: Mode}


def parse_address(text: str) -> tuple[Table, int, int | None]:
    """Split `holding:12`, `holding:0x180` or `holding:12.4` into table, printed number and bit.

    Raises ValueError with the form that was expected.
    """
    match = _ADDRESS.fullmatch(text)
    if match is None:
        raise ValueError(
            f"{text!r} is not an address: write table:number or table:number.bit, such as holding:12 or holding:12.4"
        )
    table = Table(match["table"])
    bit = None if match["bit"] is None else int(match["bit"])
    if bit is not None and (table in BIT_TABLES or bit > 15):
        raise ValueError(f"{text!r}: a bit number (0 to 15) belongs to a holding or input register")
    return table, int(match["number"], 0), bit


def _checked_address(text: str) -> str:
    parse_address(text)
    return text


Address = Annotated[
    str,
    AfterValidator(_checked_address),
    # for editors, whose expressions know no named groups; `parse_address` decides
    Field(json_schema_extra={"pattern": r"^(coil|discrete|holding|input):(0[xX][0-9a-fA-F]+|[0-9]+)(\.[0-9]+)?$"}),
]
Name = Annotated[
    str,
    StringConstraints(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$"),
    Field(description="lower-case letters and digits in words joined by hyphens, such as acme-lc3"),
]
Seconds = Annotated[float, Field(gt=0, le=3600)]
Word = Annotated[int, Field(strict=True, ge=-32768, le=65535)]
NumberType = Literal["uint16", "int16"]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Provenance(_Part):
    """Where the map comes from. A map never claims more than its source."""

    trust: Literal["vendor-manual", "integration-code", "simulation", "template"]
    sources: tuple[str, ...] = Field(min_length=1)
    notes: str = ""


class Addressing(_Part):
    """How the source numbers its points: number as printed minus `base` is the address on the wire."""

    base: Literal[0, 1]


class LinkDefaults(_Part):
    """What the device needs from a client; a site's controller may tighten it."""

    unit_id: int = Field(default=1, strict=True, ge=0, le=255)
    timeout_s: Seconds = 0.5
    min_gap_s: float = Field(default=0.0, ge=0, le=10)
    reconnect_min_s: Seconds = 0.2
    max_registers_per_read: int = Field(default=125, strict=True, ge=1, le=125)
    max_bits_per_read: int = Field(default=2000, strict=True, ge=1, le=2000)
    tid_echo: bool = True
    max_age_s: Seconds = 1.0


class Signal(_Part):
    """One thing the lift says: at one point, as one bit per floor, or as the two limits of a door."""

    at: Address | None = None
    one_of: tuple[Address, ...] | None = Field(default=None, min_length=2)
    """One bit per floor, lowest code (0) first; none set means no floor known."""
    open_limit: Address | None = None
    closed_limit: Address | None = None
    type: Literal["uint16", "int16", "counter"] = "uint16"
    bits: tuple[Annotated[int, Field(ge=0, le=15)], Annotated[int, Field(ge=0, le=15)]] | None = None
    """First and last bit (0 = least significant) of a field inside a register."""
    active: Literal["high", "low"] = "high"
    """Which level of a bit means yes."""
    values: dict[Annotated[int, Field(ge=-32768, le=65535)], str] | None = None
    as_: Literal["floor"] | None = Field(default=None, alias="as")
    unknown: tuple[Word, ...] = ()
    """Codes that mean "not known"."""
    none: tuple[Word, ...] = ()
    """Codes that mean "no floor", such as no destination."""
    must_change_within_s: Seconds | None = None
    note: str = ""

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        limits = self.open_limit is not None or self.closed_limit is not None
        given = [self.at is not None, self.one_of is not None, limits]
        if sum(given) != 1:
            raise ValueError("say where it is exactly once: `at`, `one_of`, or `open_limit` with `closed_limit`")
        if limits and (self.open_limit is None or self.closed_limit is None):
            raise ValueError("a door with limits needs both `open_limit` and `closed_limit`")
        if self.bits is not None and self.bits[0] > self.bits[1]:
            raise ValueError("`bits` are written lowest first, such as [4, 5]")
        return self

    @property
    def addresses(self) -> tuple[str, ...]:
        """Every address this signal is read from."""
        given = (self.at, *(self.one_of or ()), self.open_limit, self.closed_limit)
        return tuple(address for address in given if address is not None)


class Confirm(_Part):
    """What shows that a command took effect; an echo of the write alone confirms nothing."""

    any_of: tuple[str, ...] = Field(min_length=1)
    """Signal names, or `effect` (the lift does it), or `readback` (the point still holds what was written)."""
    within_s: Seconds


class Command(_Part):
    """One thing the lift can be told."""

    at: Address | None = None
    one_of: tuple[Address, ...] | None = Field(default=None, min_length=2)
    type: NumberType = "uint16"
    as_: Literal["floor"] | None = Field(default=None, alias="as")
    action: Literal["pulse", "hold"]
    on: Word = Field(default=1, alias="press")
    """Raw value of a held or pulsed point that carries no floor."""
    rest: Word = 0
    """Raw value that lets go."""
    width_s: Seconds | None = None
    """How long a pulse stays on."""
    until: Literal["arrived"] | None = None
    """A held call is let go when the car stands at the floor."""
    max_hold_s: Seconds | None = None
    refresh_s: Seconds | None = None
    on_link_loss: Literal["device_watchdog", "timed_by_device", "latches"] | None = None
    bounded_by: Literal["session"] | None = None
    requires: tuple[str, ...] = ()
    """Flags that must read yes immediately before a press."""
    granted_by: Literal["robot_mode_on"] | None = None
    """The flag by which the controller grants what was asked for."""
    granted_within_s: Seconds = 600.0
    """Ten minutes: the longest mode change documented (elevator-interfaces 1.10, Fujitec cargo lift)."""
    excludes: tuple[str, ...] = ()
    gap_s: float = Field(default=0.0, ge=0, le=60)
    arrive_within_s: Seconds = 120.0
    """Two minutes: the travel time-out of the same cargo lift."""
    confirm: Confirm | None = None
    note: str = ""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.at is None) == (self.one_of is None):
            raise ValueError("say where it is exactly once: `at` or `one_of`")
        if self.action == "pulse" and self.width_s is None:
            raise ValueError("a pulse needs `width_s`")
        if self.action == "hold" and (self.max_hold_s is None or self.on_link_loss is None):
            raise ValueError("a hold needs `max_hold_s` and `on_link_loss`")
        if self.on == self.rest and self.as_ is None and self.one_of is None:
            raise ValueError("`press` and `rest` are the same value: the command would do nothing")
        return self

    @property
    def addresses(self) -> tuple[str, ...]:
        """Every address this command writes to."""
        return (self.at,) if self.at is not None else (self.one_of or ())


class WriteBlock(_Part):
    """Adjacent command points that are always written together, in one FC15 or FC16."""

    at: Address
    count: int = Field(strict=True, ge=1, le=1968)
    function: Literal[15, 16]


class Evidence(_Part):
    """How this lift shows that the car stands at the floor it reports."""

    kind: Literal["level", "motion_stopped", "position_stable"]
    for_s: Seconds | None = None

    @model_validator(mode="after")
    def _time(self) -> Self:
        if (self.kind == "position_stable") != (self.for_s is not None):
            raise ValueError("`for_s` belongs to `kind: position_stable`, and is needed there")
        return self


Range = tuple[Annotated[int, Field(strict=True, ge=0)], Annotated[int, Field(strict=True, ge=0)]]


class RegisterMap(_Part):
    """One lift model: what sits where in its registers."""

    schema_: Literal[1] = Field(alias="schema")
    name: Name
    title: str = Field(min_length=1)
    provenance: Provenance
    addressing: Addressing
    link: LinkDefaults = LinkDefaults()
    served: dict[Table, tuple[Range, ...]]
    """First and last printed address the device answers for, per table; a read never crosses an edge."""
    signals: dict[str, Signal] = Field(min_length=1)
    commands: dict[str, Command] = Field(default_factory=dict)
    write_blocks: tuple[WriteBlock, ...] = ()
    at_floor_evidence: Evidence
    at_same_floor: Literal["call", "open_button"] = "open_button"
    """How the door is opened where the car already stands: by the call itself, or by the door hold."""
    not_visible: dict[Literal["fire"], str] = Field(default_factory=dict)
    """Safety signals this interface does not show, with the reason; shown on every face."""

    def wire_address(self, text: str) -> tuple[Table, int, int | None]:
        """Table, address on the wire (0-based) and bit of an address of this map. May be out of range."""
        table, number, bit = parse_address(text)
        return table, number - self.addressing.base, bit
