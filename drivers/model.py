"""What a lift says and what it can be told, free of registers and of the manager."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum, unique
from types import MappingProxyType
from typing import NamedTuple

from register_maps.words import Door, Mode, Motion, Side

FloorName = str
"""A floor as the site names it, such as `L1`."""

PressId = int
"""Names one press; whoever presses makes it, and no two presses of one lift have the same."""


@unique
class CommandKind(StrEnum):
    """The commands the manager knows; only what a passenger can do, and the controller's own robot signals."""

    GO_TO = "go_to"
    CALL = "call"
    """Moves the empty car, on a lift that tells it from the occupied one."""
    GO = "go"
    """Moves the occupied car."""
    ROBOT_IN_PLACE = "robot_in_place"
    ROBOT_LEFT = "robot_left"
    HOLD_DOOR = "hold_door"
    CLOSE_DOOR = "close_door"
    ROBOT_MODE = "robot_mode"


@dataclass(frozen=True, slots=True)
class Command:
    """One thing to tell the lift."""

    kind: CommandKind
    floor: FloorName | None = None
    """Only with `go_to`, `call` and `go`."""
    side: Side | None = None
    """With door commands, and with `go_to` where the door is part of the call."""

    name: str = field(init=False, repr=False, compare=False)
    """The name the map uses: `go_to`, `go_to.rear`, `hold_door.front`."""

    def __post_init__(self) -> None:
        """Work the name out once: it is looked at dozens of times for every press."""
        name = str(self.kind) if self.side is None else f"{self.kind}.{self.side}"
        object.__setattr__(self, "name", name)

    def __str__(self) -> str:
        return self.name if self.floor is None else f"{self.name} {self.floor}"


@unique
class Result(StrEnum):
    """How a command ended. Acknowledged is not done."""

    CONFIRMED = "confirmed"
    REJECTED = "rejected"
    """It was not carried out: nothing was sent, or the controller said no."""
    UNCONFIRMED = "unconfirmed"
    """It was sent, or may have been, and nothing shows that it took effect."""


@unique
class Proof(StrEnum):
    """What confirmed a command. The echo of a write is no proof."""

    NONE = "none"
    READBACK = "readback"
    """The point still holds what was written."""
    LAMP = "lamp"
    """A signal that the map names for it."""
    EFFECT = "effect"
    """The lift does it."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one command."""

    command: Command
    result: Result
    reason: str = ""
    proof: Proof = Proof.NONE
    frames: tuple[str, ...] = ()
    """The writes as hex, transaction id left out, in the order they were sent."""
    not_granted: bool = False
    """Rejected only because the lift did not grant what the command requires, such as robot mode; nothing was sent."""
    press: PressId = 0
    """Which press of it."""


@dataclass(frozen=True, slots=True)
class Hold:
    """An output that should be on."""

    begin: int
    """0 keeps what is on and never puts it on. Each higher number permits one beginning: the hold is put on by it from rest, or
    once more after it was found off. Once it was written, found off or released, only a still higher number puts it on."""
    until: float
    """Monotonic seconds; it falls then unless it is declared for longer, and `max_hold_s` after its last declaration at the latest."""


@unique
class OutputState(StrEnum):
    """Where one output is, as far as the driver knows."""

    AT_REST = "at rest"
    """Nothing of it is on or wanted, and that is verified."""
    REQUESTED = "requested"
    """It waits to be written, or for the first look whether it is on."""
    ON = "on"
    """It was written, and it is not verified, or no longer."""
    HELD = "held"
    """It is on and verified, by read-back or, where the map asks for it, by its effect."""
    LOST = "lost"
    """A hold was found off. It stays off until a higher `begin` is declared, or it is declared no longer."""
    RELEASING = "releasing"
    """It is being written to rest, or that is not verified yet."""


@dataclass(frozen=True, slots=True)
class OutputChanged:
    """An output is in another state than before."""

    name: str
    """As the map names it, such as `hold_door.front`."""
    state: OutputState


@dataclass(frozen=True, slots=True)
class DriverFailed:
    """A bug was met: the driver releases everything, takes no commands any more, and `run` raises it."""

    reason: str


@dataclass(frozen=True, slots=True)
class Written:
    """One write of one command, as it went out."""

    name: str
    """The command as the map names it; empty for a block that is written in a cycle."""
    what: str
    """`press`, `release`, `refresh`, `reset`, `pause`, `beat` or `cycle`."""
    frames: tuple[str, ...]
    """Unit, function and data as hex, transaction id left out."""
    failure: str = ""
    """Why it failed, empty if it was echoed; it may have arrived nevertheless."""


@dataclass(frozen=True, slots=True)
class LiftValues:
    """Everything one lift says at one moment. A signal the map does not have is None (or absent)."""

    floor: FloorName | None = None
    """The floor the car reports; None between floors, unlisted or contradictory."""
    destination: FloorName | None = None
    call_accepted: FloorName | None = None
    calls: frozenset[FloorName] = frozenset()
    """Floors whose call is registered: the lamps behind the buttons."""
    motion: Motion | None = None
    mode: Mode = Mode.UNKNOWN
    fire_word: bool = False
    """The mode word says fire while `mode`, by a flag that ranks higher, is another."""
    doors: Mapping[Side, Door] = field(default_factory=dict)
    flags: Mapping[str, bool] = field(default_factory=dict)
    """Flag signals by name; a flag that cannot be read is absent."""
    watchdog_s: float | None = None
    """How long the controller's I/O module waits for us before it lets go, 0 for never; None where it is not told."""
    unknown: Mapping[str, int] = field(default_factory=dict)
    """Signals whose raw value is outside their table, with that value."""


class LiftReading(NamedTuple):
    """One whole poll of one lift. A tuple, because every poll makes one and a frozen dataclass costs twice as much."""

    at: float
    """Monotonic seconds when the first request of the poll left: nothing in here is older."""
    epoch: int
    """Which connection it came over; a new epoch means that nothing from before may be assumed."""
    values: LiftValues
    """The same object as in the reading before when no register changed."""
    notices: tuple[str, ...] = ()
    """What a person should know, each once: somebody else writes our outputs."""
    outputs: Mapping[str, OutputState] = MappingProxyType({})
    """The state of every output, by its name; the same object as before while none has changed."""


@dataclass(frozen=True, slots=True)
class SignalValue:
    """One signal as it was read last, for people who look at the wires."""

    name: str
    """As the map names it, such as `door.front`."""
    value: str | bool | float | None
    """As the map decodes it; None where the raw value is not in its table, or nothing was read."""
    raw: int | None
    """Bits and words as read, before scale and table; None where nothing was read."""
    addresses: tuple[str, ...]
    """Where it is, as the map writes it, such as `holding:12`."""
    age_s: float | None
    """Of the block that it came with, the oldest where it came with several; None where nothing was read."""
    wire: tuple[str, ...] = ()
    """The same places on the wire, where the first one is 0, moved by the lift's offset: `holding 11 bits 4 to 5`."""


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What this lift, with this map, can say and be told."""

    commands: frozenset[str]
    """Names as in the map, such as `hold_door.front`; empty where the site grants no control."""
    signals: frozenset[str]
    doors: tuple[Side, ...]
    one_block: bool
    """Floor, doors and motion come from one request, so one reading cannot be torn."""
    evidence: str
    """`level`, `motion_stopped` or `position_stable`."""
    evidence_for_s: float
    max_age_s: float
    requires: Mapping[str, frozenset[str]]
    """Flags that each command waits for, such as `robot_mode_on`; a command that waits for none may be absent."""
    granted_within_s: float
    arrive_within_s: float
    until: Mapping[str, str]
    """What ends each call that is a level: `arrived`, `robot_in_place` or `robot_left`; a pulse is absent."""
    levels: frozenset[str]
    """Commands that stay on until they are let go."""
    max_hold_s: Mapping[str, float]
    """How long each level lasts after it was last wanted; one without a limit is absent."""
    excludes: Mapping[str, frozenset[str]]
    """Commands that may not be on together; one that excludes none is absent."""
    needs_occupancy: bool
    """The car goes on only after `robot_in_place`, and is free only after `robot_left`."""
    door_opens_within_s: float
    """How long a lift that opens its door for a call may take over it."""
    door_closes_within_s: float
    """How long a door that is told by its open contact alone may take to close."""
    open_contacts: frozenset[Side]
    """Doors that are told by their open contact alone: `closed` is no more than "not open"."""
    watched: bool
    """Some hold relies on the watchdog of the I/O module, and the map reads its time."""
    same_floor_call: bool
    """A call, not the door hold, opens the door where the car already stands."""
    not_visible: Mapping[str, str]
    map_name: str
    map_hash: str
    """Changes with everything that the map says, the changes of the site included."""
    printed: Mapping[str, tuple[str, ...]]
    """Where each signal and command is, as the map writes it."""
    trust: str
