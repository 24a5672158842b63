"""The signals, commands and outcomes of one lift, independent of registers and of the manager."""

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
"""Identifies one press. The caller chooses it, unique among the presses of one lift."""


@unique
class CommandKind(StrEnum):
    """The commands the manager knows: what a passenger can do, and the controller's own robot signals."""

    GO_TO = "go_to"
    CALL = "call"
    """Moves the empty car, on a lift that distinguishes it from the occupied one."""
    GO = "go"
    """Moves the occupied car."""
    ROBOT_IN_PLACE = "robot_in_place"
    ROBOT_LEFT = "robot_left"
    HOLD_DOOR = "hold_door"
    CLOSE_DOOR = "close_door"
    ROBOT_MODE = "robot_mode"


@dataclass(frozen=True, slots=True)
class Command:
    """One command to the lift."""

    kind: CommandKind
    floor: FloorName | None = None
    """Only with `go_to`, `call` and `go`."""
    side: Side | None = None
    """With door commands, and with `go_to` where the door is part of the call."""

    name: str = field(init=False, repr=False, compare=False)
    """The name the map uses: `go_to`, `go_to.rear`, `hold_door.front`."""

    def __post_init__(self) -> None:
        """Compute the name once: it is read dozens of times for every press."""
        name = str(self.kind) if self.side is None else f"{self.kind}.{self.side}"
        object.__setattr__(self, "name", name)

    def __str__(self) -> str:
        return self.name if self.floor is None else f"{self.name} {self.floor}"


@unique
class Result(StrEnum):
    """How a command ended. An acknowledged write confirms nothing."""

    CONFIRMED = "confirmed"
    REJECTED = "rejected"
    """It was not carried out: nothing was sent, or the controller refused it."""
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
    """The lift does what was commanded."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one command."""

    command: Command
    result: Result
    reason: str = ""
    proof: Proof = Proof.NONE
    frames: tuple[str, ...] = ()
    """The writes as hex, transaction id left out, in the order they were sent."""
    grant_missing: bool = False
    """Rejected only because the lift did not grant what the command requires, such as robot mode; nothing was sent."""
    press: PressId = 0
    """The press that ended."""


@dataclass(frozen=True, slots=True)
class Hold:
    """An output that should be on."""

    begin: int
    """0 keeps an output that is on and never switches it on. Each higher number permits one beginning: it switches the hold on from
    rest, or again after it was found off. Once it was written, found off or released, only a still higher number does so."""
    until: float
    """Monotonic seconds; the hold is released then unless it is declared for longer, and `max_hold_s` after its last declaration at the latest."""


@unique
class OutputState(StrEnum):
    """Where one output is, as far as the driver knows."""

    AT_REST = "at rest"
    """It is off and not requested, and that is verified."""
    REQUESTED = "requested"
    """It waits to be written, or for the first reading that shows whether it is on."""
    ON = "on"
    """It was written, and is not or no longer verified."""
    HELD = "held"
    """It is on and verified, by read-back or, where the map asks for it, by its effect."""
    LOST = "lost"
    """A hold was found off. It stays off until a higher `begin` is declared, or it is no longer declared."""
    RELEASING = "releasing"
    """It is being released, or the release is not verified yet."""


@dataclass(frozen=True, slots=True)
class OutputChanged:
    """The state of an output has changed."""

    name: str
    """As the map names it, such as `hold_door.front`."""
    state: OutputState


@dataclass(frozen=True, slots=True)
class DriverFailed:
    """The driver met a bug: it releases everything, accepts no more commands, and `run` raises."""

    reason: str


@dataclass(frozen=True, slots=True)
class Written:
    """One write of one command, as it was sent."""

    name: str
    """The command as the map names it; empty for a block that is written in a cycle."""
    what: str
    """`press`, `release`, `refresh`, `reset`, `pause`, `beat` or `cycle`."""
    frames: tuple[str, ...]
    """Unit, function and data as hex, without the transaction id."""
    failure: str = ""
    """Why it failed; empty if it was echoed. A failed write may have arrived."""


@dataclass(frozen=True, slots=True)
class LiftValues:
    """The values of all signals of one lift at one moment. A signal the map does not have is None (or absent)."""

    floor: FloorName | None = None
    """The floor the car reports; None between floors, unlisted or contradictory."""
    destination: FloorName | None = None
    call_accepted: FloorName | None = None
    calls: frozenset[FloorName] = frozenset()
    """Floors whose call is registered: the lamps behind the buttons."""
    motion: Motion | None = None
    mode: Mode = Mode.UNKNOWN
    fire_word: bool = False
    """The mode word reads fire while `mode` is another one because of a flag that ranks higher."""
    doors: Mapping[Side, Door] = field(default_factory=dict)
    flags: Mapping[str, bool] = field(default_factory=dict)
    """Flag signals by name; a flag that cannot be read is absent."""
    watchdog_s: float | None = None
    """How long the controller's I/O module waits for us before it releases its outputs, 0 for never; None if it is not reported."""
    unknown: Mapping[str, int] = field(default_factory=dict)
    """Signals whose raw value is outside their table, with that value."""


class LiftReading(NamedTuple):
    """One complete poll of one lift. A tuple, because every poll makes one and a frozen dataclass costs twice as much."""

    at: float
    """Monotonic seconds when the first request of the poll was sent: no value is older."""
    epoch: int
    """Number of the connection it came over; with a new epoch nothing from before may be assumed."""
    values: LiftValues
    """The same object as in the reading before when no register changed."""
    notices: tuple[str, ...] = ()
    """Messages for a person, each once: another client writes our outputs."""
    outputs: Mapping[str, OutputState] = MappingProxyType({})
    """The state of every output, by its name; the same object as before while none has changed."""


@dataclass(frozen=True, slots=True)
class SignalValue:
    """One signal as last read, for people who inspect the wiring."""

    name: str
    """As the map names it, such as `door.front`."""
    value: str | bool | float | None
    """As the map decodes it; None where the raw value is not in its table, or nothing was read."""
    raw: int | None
    """Bits and words as read, before scale and table; None where nothing was read."""
    addresses: tuple[str, ...]
    """Where it is, as the map writes it, such as `holding:12`."""
    age_s: float | None
    """Age of the block it was read with, the oldest if there are several; None if nothing was read."""
    wire: tuple[str, ...] = ()
    """The same places on the wire, where the first one is 0, moved by the lift's offset: `holding 11 bits 4 to 5`."""


@dataclass(frozen=True, slots=True)
class CommandInfo:
    """One command of the map, for people who try it out."""

    name: str
    """As the map names it, such as `hold_door.front`."""
    meaning: str
    """What it does, in words."""
    takes_floor: bool
    addresses: tuple[str, ...]
    """Where it is written, as the map writes it, such as `holding:12`."""
    wire: tuple[str, ...]
    """The same places on the wire, where the first one is 0, moved by the lift's offset: `holding 11 bits 4 to 5`."""
    action: str
    """`pulse`, `hold`, or `count` and `toggle` of a heartbeat."""
    ends_itself: bool
    """The device ends the pulse, not we."""
    width_s: float | None
    """How long a pulse lasts."""
    max_hold_s: float | None
    """How long a hold lasts at most unless it is renewed."""
    refresh_s: float | None
    """How often a hold is written again."""
    until: str
    """What ends a hold by itself: `arrived`, `closed`, `robot_in_place` or `robot_left`; empty for nothing."""
    on_link_loss: str
    """What becomes of a hold when its manager is lost: `device_watchdog`, `timed_by_device` or `latches`; empty for other commands."""
    requires: tuple[str, ...]
    """Flags that must read yes before it is pressed."""
    confirmed_within_s: float
    """How long the lift may take to show that it has taken it."""
    state: OutputState | None
    """Of its output; None for a heartbeat, and where the site grants no control."""


@dataclass(frozen=True, slots=True)
class CommandStep:
    """One step of a trial: press a command, or release it."""

    command: Command
    is_release: bool = False


@dataclass(frozen=True, slots=True)
class PlannedWrite:
    """One write that a command would send."""

    name: str
    """The command as the map names it."""
    what: str
    """`reset`, `press` or `release`, as in `Written`."""
    addresses: tuple[str, ...]
    """What of the command it writes, as the map writes it."""
    function: int
    text: str
    """The request in words, with its address on the wire."""
    frame: str
    """Unit, function and data as hex, without the transaction id."""
    is_read_first: bool
    """Others write bits of the same register: it is read first, and their bits, 0 here, are written as found."""


@dataclass(frozen=True, slots=True)
class Capabilities:
    """The signals, commands and rules of this lift, from its map and its site."""

    commands: frozenset[str]
    """Names as in the map, such as `hold_door.front`; empty if the site grants no control."""
    signals: frozenset[str]
    doors: tuple[Side, ...]
    one_block: bool
    """Floor, doors and motion come from one request, so a reading is consistent."""
    evidence: str
    """`level`, `motion_stopped` or `position_stable`."""
    evidence_for_s: float
    max_age_s: float
    requires: Mapping[str, frozenset[str]]
    """Flags that each command waits for, such as `robot_mode_on`; a command that waits for none may be absent."""
    granted_within_s: float
    arrive_within_s: float
    until: Mapping[str, str]
    """What ends each call that is held: `arrived`, `robot_in_place` or `robot_left`; a pulse is absent."""
    held_commands: frozenset[str]
    """Commands that stay on until they are released."""
    max_hold_s: Mapping[str, float]
    """How long each held command lasts after its last declaration; one without a limit is absent."""
    released_after_s: Mapping[str, float]
    """How long after its press the controller lets go of each door hold by itself, however often it is written again; one that it
    keeps is absent."""
    excludes: Mapping[str, frozenset[str]]
    """Commands that may not be on together; one that excludes none is absent."""
    needs_occupancy: bool
    """The car departs only after `robot_in_place`, and is free only after `robot_left`."""
    door_opens_within_s: float
    """How long a lift that opens its door for a call may take over it."""
    door_closes_within_s: float
    """How long a door with an open contact only may take to close."""
    open_contacts: frozenset[Side]
    """Doors with an open contact only: `closed` means no more than "not open"."""
    watched: bool
    """At least one hold relies on the watchdog of the I/O module, and the map reads its time."""
    same_floor_call: bool
    """A call, not the door hold, opens the door where the car already stands."""
    not_visible: Mapping[str, str]
    map_name: str
    map_hash: str
    """Changes with the content of the map, including the changes of the site."""
    printed: Mapping[str, tuple[str, ...]]
    """The address of each signal and command, as the map writes it."""
    trust: str
