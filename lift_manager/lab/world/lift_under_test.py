"""The facts about a lift that the judge needs, and its findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum, unique

from drivers.model import FloorName, Proof
from register_maps.words import Mode, Table

PolledBlock = tuple[str, int, Table, int, int]
"""One block of a poll: controller, unit id, table, first address on the wire, and how many."""

MODES_WITHOUT_ROBOTS = frozenset(
    {Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.ATTENDANT, Mode.OUT_OF_SERVICE, Mode.UNKNOWN}
)
"""Modes in which nothing is pressed and no robot is invited. A list of the judge, independent of the product's."""


@unique
class SuspectValues(StrEnum):
    """What a fault may make wrong."""

    OPEN = "open"
    """A door is published as open for a robot, and is not."""
    MODE = "mode"
    """A mode is not published, or a robot is invited or a command pressed in a mode without robots."""
    EFFECT = "effect"
    """A command counts as confirmed, and had no effect."""
    OUTPUT = "output"
    """An output counts as released, and is on."""
    FLOOR = "floor"
    """The published floor is wrong, or the car does not stand there."""
    SHOWN = "shown"
    """The published motion or door is wrong."""


@unique
class FloorEvidence(StrEnum):
    """What indicates the floor."""

    CODE = "code"
    """A number that stays at the last floor passed."""
    SWITCH = "switch"
    """A contact per floor, closed only in its door zone."""
    DOOR = "door"
    """The limit of an open door."""


@unique
class DoorEvidence(StrEnum):
    """What indicates the state of a door."""

    BOTH_ENDS = "both ends"
    """Two limits, or a value for each end."""
    OPEN_CONTACT = "open contact"
    """One contact: a door that is not open may be in any other state."""
    OPEN_LIMITS = "open limits"
    """One contact per floor, closed where the car stands level with its door open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapEvidence:
    """What a map can show of its lift, in the terms of the judge."""

    max_age_s: float = 1.0
    """Age after which a reading is invalid."""
    modes: frozenset[Mode] = MODES_WITHOUT_ROBOTS - {Mode.ATTENDANT, Mode.UNKNOWN}
    """Modes without robots that a signal shows."""
    beats_within_s: float | None = None
    """Time within which a heartbeat must change; None without one: frozen registers then look like a standing lift."""
    motion: bool = True
    """Whether a signal shows at once that the car moves or has left the level of its floor."""
    direction: bool = True
    """Whether a signal shows the direction."""
    floor_by: FloorEvidence = FloorEvidence.CODE
    door_by: DoorEvidence = DoorEvidence.BOTH_ENDS
    robot_mode: bool = False
    """Whether a signal shows that robot mode is granted."""
    permits: bool = False
    """Whether a signal of a handshake shows that a robot may enter or leave."""
    bars: frozenset[str] = frozenset()
    """Flags with which the lift keeps robots off: `robots_allowed`, `watchdog_tripped`."""
    proofs: Mapping[str, frozenset[Proof]] = field(default_factory=dict)
    """Valid evidence of each command, by name without its side; any evidence is valid for other commands."""


@dataclass(frozen=True, slots=True)
class Excuse:
    """Which findings one fault excuses on lifts of one map."""

    kinds: frozenset[SuspectValues]
    within_s: float | None
    """For how long after the fault began, or after frozen registers were first read; None for as long as it lasts."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A violation: something that must never happen."""

    at: float
    lift: str
    rule: str
    text: str
    wrong: SuspectValues | None = None
    """What is wrong, if a fault may excuse it."""

    def __str__(self) -> str:
        return f"{self.at:8.3f} s  {self.lift}: {self.rule}: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftUnderTest:
    """The facts about one lift that the judge needs."""

    controllers: tuple[str, ...]
    floors: tuple[FloorName, ...]
    """Lowest first."""
    max_session_hold_s: float
    arrive_within_s: float
    shows: MapEvidence = field(default_factory=MapEvidence)
    max_age_s: float = 1.0
    """The value of the site, or else of the map."""
    timeout_s: Mapping[str, float] = field(default_factory=dict)
    """Time after which a reply counts as missing, by controller."""
    excuses: Mapping[str, Excuse] = field(default_factory=dict)
    """By the name of the fault; a fault without an entry excuses nothing."""
    blocks: frozenset[PolledBlock] = frozenset()
    """The blocks of a poll; a state is as old as the oldest of them."""
    poll_s: float = 0.2
    between_sessions_s: float = 0.0
    holds: frozenset[str] = frozenset()
    """Door holds that the map has, for every door of every floor."""
    pulses_s: Mapping[str, float] = field(default_factory=dict)
    """How long each output stays on that our second write ends."""
    handshake: bool = False
    """Whether the car departs only after a report that the robot is inside."""
    repeated: frozenset[str] = frozenset()
    """Commands that the map itself repeats."""
    fleeting: frozenset[str] = frozenset()
    """Commands that the device ends by itself."""
    refreshes: Mapping[PolledBlock, int | None] = field(default_factory=dict)
    """What a refresh of robot mode, of a door hold or of the heartbeat writes, by its cell as a block of one; None for any value.

    It ends no hold."""
    clear_s: float = 0.0
    """How long before our release an invitation must be withdrawn; 0 for no minimum."""
