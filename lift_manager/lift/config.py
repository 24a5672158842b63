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
"""The form of a lift's name: it appears unchanged in addresses, file names and commands."""
CLEARS_IN_A_LIMIT = 3
"""A lease is at least this many times `clear_s`. Chosen: two thirds of it are left for crossing."""
APART = 0.75
"""Share of `poll_s` between two readings that count as two. Chosen: polls at this pace always do, though one may start a little late."""


@dataclass(frozen=True, slots=True)
class Checkout:
    """The acceptance test that lets robots use a lift."""

    sha256: str
    """The hash of its record, as printed on each page of its report."""
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
    """The doors that serve each floor."""
    control: bool
    """The site lets robots command this lift; otherwise the manager only watches it."""
    capabilities: Capabilities
    """What the map lets this lift report and do."""
    display_name: str = ""
    """The name for people; empty where its own name will do."""
    lease_s: float = 300.0
    """For callers that can renew it. Chosen: it outlives RMF's 300 s localise step."""
    max_session_s: float = 3600.0
    """How long a session lasts at most, renewed or not. Chosen: above the longest ride that the other limits allow, two stops of
    `max_session_hold_s` and the trips between them."""
    takeover_after_s: float | None = None
    """After this silence of its holder, an empty car goes to the next caller; never unless the site sets it."""
    max_session_hold_s: float = 900.0
    """How long the site lets a door be held at one stop, renewed or not; `hold_limit` is what counts."""
    clear_s: float = 10.0
    """From the withdrawal of OPEN to the release of a held door. Chosen: a robot at 0.5 m/s that has just begun to drive through
    is out of the doorway twice over."""
    rmf_clear_s: float = 30.0
    """The same for sessions of RMF, which sends its robot on one OPEN and does not look again. Chosen: its publish period, its
    decision and the crossing (open-rmf 1.6)."""
    infer_occupancy: bool = False
    """The manager infers from the requests of a caller that cannot report its robot when that robot boards and leaves."""
    board_min_s: float = 5.0
    """A floor requested sooner than this after the door stood open is no sign of boarding. Chosen: a robot at 0.5 m/s takes that
    long for the 2.5 m from where it waits into the car."""
    robot_hours: RobotHours | None = None
    """When robots may begin; always unless the site sets it."""
    between_sessions_s: float = 5.0
    """How long people have the lift for themselves between two robots: from the end of a session to the next press."""
    fire_release_delay_s: float = 0.0
    """From informing robots of a fire to releasing everything."""
    poll_s: float = 0.2
    """From one poll to the next."""
    poll_ridden_s: float = math.inf
    """The same while a session has the lift and the controller answers quickly, and from a press to the next poll; `poll_s` where that
    is less."""
    checkout: Checkout | None = None
    """None if nobody looked for one, or none was found."""
    rmf_name: str = ""
    """Its name in RMF's building map; empty where it is the same there."""
    rmf_floors: Mapping[FloorName, str] = field(default_factory=dict)
    """The floors that RMF's building map names otherwise."""

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
        """Return until when an output may stay on whose last renewal was at this time."""
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
