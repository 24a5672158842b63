"""What the site file and the register map say about one lift."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from typing import NamedTuple

from drivers.model import Capabilities, Command, CommandKind, FloorName
from lift_manager.lift.hours import RobotHours
from register_maps.words import Side

LIFT_NAME = r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}$"
"""What a lift may be named: it stands in addresses, file names and commands as it is."""
CLEARS_IN_A_LIMIT = 3
"""A lease is at least this many times `clear_s`. Chosen: two thirds of it are left for crossing."""
APART = 0.75
"""Share of `poll_s` between two readings that count as two. Chosen: polls at this pace always do, though one may start a little late."""


@dataclass(frozen=True, slots=True)
class Checkout:
    """The acceptance test that lets robots use a lift."""

    sha256: str
    """Of its record, as printed on each page of its report."""
    ended_at: datetime


class HoldLimit(NamedTuple):
    """How long a door is held at one stop at most."""

    seconds: float
    set_by: str
    """For messages: the site, or the controller."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftConfig:
    """One lift of the site. Nothing in it changes while the manager runs."""

    name: str
    """Of the form `LIFT_NAME`."""
    source: str
    """Controller name and address, for messages."""
    floors: tuple[FloorName, ...]
    """Lowest first."""
    doors_at: Mapping[FloorName, tuple[Side, ...]]
    """Which doors serve each floor."""
    control: bool
    """The site lets robots command this lift; otherwise it is only watched."""
    capabilities: Capabilities
    """What the map lets this lift say and be told."""
    display_name: str = ""
    """What people call it; empty where its name will do."""
    lease_s: float = 300.0
    """For callers that can renew it. Chosen: it outlives RMF's 300 s localise step."""
    max_session_s: float = 3600.0
    """How long a session lasts at most, renewed or not. Chosen: above the longest ride that the other limits allow, two stops of
    `max_session_hold_s` and the trips between them."""
    takeover_after_s: float | None = None
    """A holder silent for so long loses an empty car to the next caller; never where the site does not say."""
    max_session_hold_s: float = 900.0
    """How long the site lets a door be held at one stop, renewed or not; `hold_limit` is what counts."""
    clear_s: float = 10.0
    """From the withdrawal of OPEN to the release of a held door. Chosen: a robot at 0.5 m/s that has just begun to drive through
    is out of the doorway twice over."""
    rmf_clear_s: float = 30.0
    """The same for sessions of RMF, which sends its robot on one OPEN and does not look again. Chosen: its publish period, its
    decision and the crossing (open-rmf 1.6)."""
    infer_occupancy: bool = False
    """A caller that has no words for its robot boards and leaves by what it requests."""
    board_min_s: float = 5.0
    """A floor requested sooner than this after the door stood open is no sign of boarding. Chosen: a robot at 0.5 m/s takes that
    long for the 2.5 m from where it waits into the car."""
    robot_hours: RobotHours | None = None
    """When robots may begin; always where the site does not say."""
    between_sessions_s: float = 5.0
    """How long people have the lift for themselves between two robots: from the end of a session to the next press."""
    fire_release_delay_s: float = 0.0
    """From telling robots of a fire to releasing everything."""
    poll_s: float = 0.2
    """From one poll to the next."""
    poll_ridden_s: float = math.inf
    """The same while a session has the lift and the controller answers quickly, and from a press to the next poll; `poll_s` where that
    is less."""
    checkout: Checkout | None = None
    """None where nobody looked for one, or it was not found."""
    rmf_name: str = ""
    """In RMF's building map; empty where it is the same there."""
    rmf_floors: Mapping[FloorName, str] = field(default_factory=dict)
    """Those that RMF's building map names otherwise."""

    @property
    def hold_limit(self) -> HoldLimit:
        """Return how long a door is held at one stop, renewed or not.

        A controller that lets one of its doors go sooner limits the hold of every door.
        """
        released_after_s = min(self.capabilities.released_after_s.values(), default=math.inf)
        if released_after_s < self.max_session_hold_s:
            return HoldLimit(released_after_s, "the controller")
        return HoldLimit(self.max_session_hold_s, "the site")

    @property
    def readings_apart_s(self) -> float:
        """Return how far apart two readings are at the least that count as two."""
        return APART * self.poll_s

    def lease_for(self, ttl_s: float | None) -> float | None:
        """Return the lease of a session that was requested with `ttl_s`; one shorter than three times `clear_s` is raised to that."""
        return None if ttl_s is None else max(ttl_s, CLEARS_IN_A_LIMIT * self.clear_s)

    def held_until(self, command: Command, renewed_at: float) -> float:
        """Return until when an output may stay on that was last renewed at this time."""
        return renewed_at + self.capabilities.max_hold_s.get(command.name, math.inf)

    def has(self, command: Command) -> bool:
        """Whether the map has this command, and the site lets us give it."""
        return command.name in self.capabilities.commands

    def door_holds(self, floor: FloorName) -> tuple[Command, ...]:
        """Return the holds of the doors that serve a floor, whether or not the map has them."""
        return tuple(door_hold(side) for side in self.doors_at.get(floor, ()))


@cache
def door_hold(side: Side) -> Command:
    """Return the command that keeps one door open."""
    return Command(CommandKind.HOLD_DOOR, side=side)


ROBOT_MODE = Command(CommandKind.ROBOT_MODE)
ROBOT_IN_PLACE = Command(CommandKind.ROBOT_IN_PLACE)
ROBOT_LEFT = Command(CommandKind.ROBOT_LEFT)
