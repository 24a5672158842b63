"""What the judge must know of a lift, and what it says when something must never happen and did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum, unique

from drivers.model import FloorName, Proof
from register_maps.words import Mode, Table

Read = tuple[str, int, Table, int, int]
"""One block of a poll: controller, unit id, table, first address on the wire, and how many."""

FORBIDDEN = frozenset(
    {Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.ATTENDANT, Mode.OUT_OF_SERVICE, Mode.UNKNOWN}
)
"""Modes in which nothing is pressed and no robot is invited. The judge's own list: it does not follow a change of the product's."""


@unique
class SuspectValues(StrEnum):
    """What may be wrong because of a fault."""

    OPEN = "open"
    """A door is said to be open for a robot, and is not."""
    MODE = "mode"
    """A mode is not said, or a robot is let in, or something is pressed, in a mode without robots."""
    EFFECT = "effect"
    """A command is said to be confirmed, and had no effect."""
    OUTPUT = "output"
    """An output is on, and counts as released."""
    FLOOR = "floor"
    """The floor that is said is another one, or the car does not stand there."""
    SHOWN = "shown"
    """Motion or a door is said to be other than it is."""


@unique
class FloorBy(StrEnum):
    """What tells the floor."""

    CODE = "code"
    """A number that stays at the last floor passed."""
    SWITCH = "switch"
    """A contact per floor, made in its door zone only."""
    DOOR = "door"
    """The limit of an open door."""


@unique
class DoorBy(StrEnum):
    """What tells a door."""

    BOTH_ENDS = "both ends"
    """Two limits, or a word for each end."""
    OPEN_CONTACT = "open contact"
    """One contact: not open may be anything else."""
    OPEN_LIMITS = "open limits"
    """One contact per floor, made where the car stands level with its door open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapEvidence:
    """What a map can show of its lift, in the judge's own words."""

    max_age_s: float = 1.0
    """After which a reading counts for nothing."""
    modes: frozenset[Mode] = FORBIDDEN - {Mode.ATTENDANT, Mode.UNKNOWN}
    """Modes without robots that something tells."""
    beats_within_s: float | None = None
    """Within which a heartbeat must change; None: registers that stand still look like a lift that does."""
    motion: bool = True
    """Something tells at once that the car moves, or that it has left the level of its floor."""
    direction: bool = True
    """Motion is told as such."""
    floor_by: FloorBy = FloorBy.CODE
    door_by: DoorBy = DoorBy.BOTH_ENDS
    robot_mode: bool = False
    """It tells that robot mode is granted."""
    permits: bool = False
    """It tells that a robot may enter, or leave, from a handshake."""
    bars: frozenset[str] = frozenset()
    """Flags by which it keeps robots off: `robots_allowed`, `watchdog_tripped`."""
    proofs: Mapping[str, frozenset[Proof]] = field(default_factory=dict)
    """What may confirm each command, by name without its side; a command that is not here may be confirmed by anything."""


@dataclass(frozen=True, slots=True)
class Excuse:
    """What one fault may make wrong on lifts of one map."""

    kinds: frozenset[SuspectValues]
    within_s: float | None
    """From its beginning; None: for as long as it lasts."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that must never happen."""

    at: float
    lift: str
    rule: str
    text: str
    wrong: SuspectValues | None = None
    """What kind of thing is wrong, where a fault may make it so."""

    def __str__(self) -> str:
        return f"{self.at:8.3f} s  {self.lift}: {self.rule}: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What the judge must know of one lift."""

    controllers: tuple[str, ...]
    floors: tuple[FloorName, ...]
    """Lowest first."""
    max_session_hold_s: float
    arrive_within_s: float
    shows: MapEvidence = field(default_factory=MapEvidence)
    max_age_s: float = 1.0
    """As the site has it, where it has another one than the map."""
    timeout_s: Mapping[str, float] = field(default_factory=dict)
    """After which an answer of a controller counts as missing."""
    excuses: Mapping[str, Excuse] = field(default_factory=dict)
    """By the name of a fault; without any, nothing is excused."""
    blocks: frozenset[Read] = frozenset()
    """What a poll reads; a state is no fresher than the oldest of them."""
    poll_s: float = 0.2
    between_sessions_s: float = 0.0
    holds: frozenset[str] = frozenset()
    """Door holds that the map has, for every door of every floor."""
    pulses_s: Mapping[str, float] = field(default_factory=dict)
    """How long each output that ends by our second write is on."""
    handshake: bool = False
    """The car goes on only once it is told that the robot is inside."""
    repeated: frozenset[str] = frozenset()
    """Commands that the map itself has pressed again and again."""
    fleeting: frozenset[str] = frozenset()
    """Commands that the device ends by itself."""
    clear_s: float = 0.0
    """An invitation is withdrawn so long before a release of ours; 0: at any time before it."""
