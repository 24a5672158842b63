"""The pydantic schema of a register map, `maps/*.yaml`.

The models check each field by itself. What only makes sense across fields (overlaps, ranges a device does
not serve, a confirmation that names no signal) is checked by `register_maps.check`. The grammar is explained, with the
interface features it was designed against, in GRAMMAR.md and INTERFACES.md of this folder.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from register_maps import address
from register_maps.command_schema import Command, Confirm, Payload
from register_maps.expand import is_usable
from register_maps.fields import Address, Name, ParameterName, Part, Seconds
from register_maps.signal_schema import Signal
from register_maps.vocabulary import CALLS, COMMANDS, SAFETY_FLAGS, SIGNALS, WORDS, Kind
from register_maps.words import BIT_TABLES, Table

__all__ = [
    "CALLS",
    "COMMANDS",
    "SAFETY_FLAGS",
    "SCHEMA_VERSION",
    "SIGNALS",
    "WORDS",
    "Command",
    "Confirm",
    "Kind",
    "Payload",
    "RegisterMap",
    "Signal",
]

SCHEMA_VERSION = 1
EPOCH_BITS = 32
"""Of a term of a cluster: more terms than there are seconds in a century."""


class Provenance(Part):
    """Where the map comes from. A map never claims more than its source."""

    trust: Literal["vendor-manual", "integration-code", "simulation", "template"]
    sources: tuple[str, ...] = Field(min_length=1)
    notes: str = ""


class Addressing(Part):
    """How the source numbers its points: a number minus `base` is the address on the wire, or a `notation` defines it."""

    base: Literal[0, 1] | None = None
    notation: str | None = None
    """`modicon`, or the name of a PLC family whose letters are meant."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.base is None) == (self.notation is None):
            raise ValueError("give either `base` (0 or 1) or `notation`")
        if self.notation is not None and self.notation not in address.notations():
            raise ValueError(f"there is no notation {self.notation!r}; there are {', '.join(address.notations())}")
        return self


class LinkDefaults(Part):
    """What the device needs from a client; a site's controller may tighten it."""

    unit_id: int = Field(default=1, strict=True, ge=0, le=255)
    timeout_s: Seconds = 0.5
    min_gap_s: float = Field(default=0.0, ge=0, le=10)
    min_poll_s: float = Field(default=0.0, ge=0, le=10)
    """Polls come no faster than this."""
    reconnect_min_s: Seconds = 0.2
    max_connections: int | None = Field(default=None, strict=True, ge=1, le=64)
    """How many clients the device serves at once, if its source tells; we use one."""
    max_registers_per_read: int = Field(default=125, strict=True, ge=1, le=125)
    max_bits_per_read: int = Field(default=2000, strict=True, ge=1, le=2000)
    max_registers_per_write: int = Field(default=123, strict=True, ge=1, le=123)
    max_bits_per_write: int = Field(default=1968, strict=True, ge=1, le=1968)
    idle_timeout_s: Seconds | None = None
    """The device closes a connection, or forgets its client, after this long without a request; None: never."""
    tid_echo: bool = True
    max_age_s: Seconds = 1.0

    def silence_s(self, poll_s: float) -> float:
        """Return how long a connection may be silent that is polled at this pace: one answer may be missing."""
        return poll_s + self.timeout_s


class WriteBlock(Part):
    """Adjacent command points that are always written together, in one FC15 or FC16."""

    at: Address
    count: int = Field(strict=True, ge=1, le=1968)
    function: Literal[15, 16]
    every_s: Seconds | None = None
    """Written this often, even unchanged, so that a lost write is repaired."""
    gaps: Literal[0] | None = None
    """The value written to addresses in between that belong to no command; without it there may be none."""


class Arbitration(Part):
    """What each write carries where the controller itself decides which of two managers it obeys."""

    epoch: Address
    """Where a write carries the epoch of its manager: the first of two registers, or of 32 coils, the lowest bit first."""
    owner: Address
    """Where it carries the number of the machine: a register, or the first of 8 coils."""
    word_order: Literal["high_first", "low_first"] = "high_first"
    """Which half of the epoch has the lower register."""

    @staticmethod
    def owner_bits(table: Table) -> int:
        """Return how many bits an owner has in this table."""
        return 8 if table in BIT_TABLES else 16


class Evidence(Part):
    """How this lift shows that the car stands at the floor it reports."""

    kind: Literal["level", "motion_stopped", "position_stable", "door_limit", "door_open"]
    """`door_limit`: the door's open limit at a floor shows the floor; it closes nowhere else.
    `door_open`: only an open door shows that the car stands, because the floor shown is also the one last passed."""
    for_s: Seconds | None = None

    @model_validator(mode="after")
    def _time(self) -> Self:
        if (self.kind == "position_stable") != (self.for_s is not None):
            raise ValueError("`for_s` belongs to `kind: position_stable`, and is needed there")
        return self


Range = tuple[Annotated[int, Field(strict=True, ge=0)], Annotated[int, Field(strict=True, ge=0)]]
Served = dict[Table, tuple[Range, ...]]


class Endpoint(Part):
    """A further device with a part of this lift's signals or commands; the site gives its address."""

    unit_id: int = Field(default=1, strict=True, ge=0, le=255)
    addressing: Addressing | None = None
    """How its source numbers its points; by default as the rest of the map."""
    served: Served
    note: str = ""


class Parameter(Part):
    """One value that differs from site to site; written `{name}` or `{name+1}` where it is used."""

    default: int | float | str | None = None
    """Without a default the site must set it."""
    example: int | float | str | None = None
    """Used instead of a default when the map is examined without a site."""
    range: tuple[float, float] | None = None
    choices: tuple[str, ...] | None = None
    help: str = Field(min_length=1)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.default is None) == (self.example is None):
            raise ValueError("give a `default`, or an `example` if every site has to set it")
        if self.range is not None and self.choices is not None:
            raise ValueError("`range` is for numbers and `choices` for words; give one of them")
        if (problem := self.find_problem(self.value)) is not None:
            raise ValueError(problem)
        return self

    @property
    def value(self) -> int | float | str:
        """The value when no site sets it."""
        value = self.default if self.default is not None else self.example
        if value is None:
            raise ValueError("a parameter has a default or an example")
        return value

    def find_problem(self, value: float | str) -> str | None:
        """Return why a value is not allowed; None if it is."""
        if self.choices is not None:
            return None if value in self.choices else f"must be one of {', '.join(self.choices)}, not {value!r}"
        if not isinstance(value, str) and not is_usable(value):
            return "is not a number that can be used; give a plain one, neither .nan nor .inf"
        if isinstance(value, str):
            return None if isinstance(self.value, str) else f"must be a number, not {value!r}"
        if isinstance(self.value, str):
            return f"must be text, not {value}"
        if self.range is not None and not self.range[0] <= value <= self.range[1]:
            return f"must be {self.range[0]:g} to {self.range[1]:g}, not {value:g}"
        return None


class RegisterMap(Part):
    """The registers of one lift model."""

    schema_: Literal[1] = Field(alias="schema")
    name: Name
    title: str = Field(min_length=1)
    provenance: Provenance
    parameters: dict[ParameterName, Parameter] = Field(default_factory=dict)
    addressing: Addressing
    link: LinkDefaults = LinkDefaults()
    served: Served
    """First and last printed address the device answers for, per table; a read never crosses an edge."""
    endpoints: dict[Name, Endpoint] = Field(default_factory=dict)
    """Further devices; their addresses are written `name/table:number`."""
    commands: dict[str, Command] = Field(default_factory=dict)
    signals: dict[str, Signal] = Field(default_factory=dict)
    write_blocks: tuple[WriteBlock, ...] = ()
    watchdog_s: Seconds | None = None
    """After how long without a write the controller lets go what has `on_link_loss: device_watchdog`. None: not known."""
    arbitration: Arbitration | None = None
    """The controller obeys the manager of the highest epoch, and no other; by default it obeys whoever writes."""
    needs: dict[str, str] = Field(default_factory=dict)
    """Signals that a site must add because this interface does not have them, each with the reason."""
    needs_occupancy: bool = False
    """The car departs only after `robot_in_place`, and is free only after `robot_left`."""
    at_floor_evidence: Evidence
    at_same_floor: Literal["call", "open_button"] = "open_button"
    """How the door is opened where the car already stands: by the call itself, or by the door hold."""
    door_opens_within_s: Seconds = 10.0
    """How long a lift that opens its door for a call may take over it. Chosen: a slow goods lift door."""
    door_closes_within_s: Seconds = 10.0
    """How long a door with only an open contact counts as moving once it is not open. Chosen: a slow goods lift door."""
    not_visible: dict[Literal["fire"], str] = Field(default_factory=dict)
    """Safety signals this interface does not show, with the reason; shown on every face."""

    @field_validator("signals")
    @classmethod
    def _floor_by_position(cls, signals: dict[str, Signal]) -> dict[str, Signal]:
        """Derive the floor from the position if no other signal shows it."""
        position = signals.get("car_position")
        if position is None or position.positions is None or "car_floor" in signals:
            return signals
        return {**signals, "car_floor": position.as_floor}

    @field_validator("signals")
    @classmethod
    def _robot_mode_by_mode(cls, signals: dict[str, Signal], info: ValidationInfo) -> dict[str, Signal]:
        """Derive robot mode from the mode word if the lift is told to enter it, and no other signal shows it."""
        mode, is_told = signals.get("mode"), "robot_mode" in info.data.get("commands", ())
        if not is_told or mode is None or not mode.names_robot_mode or "robot_mode_on" in signals:
            return signals
        return {**signals, "robot_mode_on": mode}

    @property
    def derived(self) -> Mapping[str, str]:
        """Signals that are derived from others: `car_floor` from `car_position`, `robot_mode_on` from `mode`; by what they come from."""
        found = {}
        position, floor = self.signals.get("car_position"), self.signals.get("car_floor")
        if position is not None and position.positions is not None and floor == position.as_floor:
            found["car_floor"] = "car_position"
        mode = self.signals.get("mode")
        if mode is not None and self.signals.get("robot_mode_on") == mode:
            found["robot_mode_on"] = "mode"
        return found

    def place(self, text: str) -> address.Place:
        """Return the place of an address of this map. Raises ValueError for text that its notation cannot parse."""
        return address.parse(text, self.addressing, self._elsewhere)

    @property
    def _elsewhere(self) -> dict[str, Addressing]:
        return {name: part.addressing for name, part in self.endpoints.items() if part.addressing is not None}

    def unit_of(self, endpoint: str) -> int:
        """Unit id of an endpoint by its name; of the controller itself for the empty name."""
        return self.endpoints[endpoint].unit_id if endpoint else self.link.unit_id

    @property
    def served_wire(self) -> dict[str, tuple[range, ...]]:
        """Addresses on the wire that each device answers for, by space (`coil`, or `endpoint/coil`)."""
        named = [
            ("", self.served, self.addressing),
            *((name, part.served, part.addressing or self.addressing) for name, part in self.endpoints.items()),
        ]
        return {
            address.space(name, table): tuple(_wire_range(table, ends, addressing) for ends in ranges)
            for name, served, addressing in named
            for table, ranges in served.items()
        }


def _wire_range(table: Table, ends: tuple[int, int], addressing: Addressing) -> range:
    low, high = (address.served_number(table, number, addressing) for number in ends)
    return range(low, high + 1)
