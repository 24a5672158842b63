"""A ride as callers, robots and people see it: what is requested, where it is, and what the robot is to do now."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum, unique

from drivers.model import FloorName
from lift_manager.lift.session import Advice, Holder
from register_maps.words import Side


@unique
class Phase(StrEnum):
    """Where a ride is."""

    QUEUED = "queued"
    """It waits for its turn: others hold the lift or wait longer, or people have theirs."""
    CALLED = "called"
    """The lift is its own, and the car is on its way to where the robot waits."""
    BOARDING = "boarding"
    """The car has stood open for the robot: it may be outside, inside, or in between."""
    RIDING = "riding"
    """The robot has reported that it is inside."""
    ALIGHTING = "alighting"
    """The car has stood open for the robot to leave."""
    CLEARING = "clearing"
    """Cancelled or out of time while the robot may be inside: it is being let out where the car stands, or at its next stop."""
    DONE = "done"
    CANCELLED = "cancelled"
    """Ended by its caller, with the robot outside."""
    GAVE_UP = "gave_up"


OVER = frozenset({Phase.DONE, Phase.CANCELLED, Phase.GAVE_UP})


@unique
class Guidance(StrEnum):
    """What the robot is to do now. `enter` and `leave` stand only while the door is open for it: drive on nothing older."""

    WAIT = "wait"
    """Stay outside, clear of the door."""
    ENTER = "enter"
    STAY = "stay"
    """Stay inside."""
    LEAVE = "leave"
    GAVE_UP = "gave_up"
    """Nothing more is done for this ride; the reason names the cause, and the advice the robot's best course."""
    DONE = "done"


@unique
class RideWord(StrEnum):
    """What the robot of a ride reports."""

    ENTERED = "entered"
    """It is inside, and the door may close behind it."""
    LEFT = "left"
    """It is outside, clear of the door. Also accepted once the ride is over: it clears the car."""
    HERE = "here"
    """It continues the ride: needed after a restart of the manager, and for a ride that a remote caller began, as nothing is pressed
    before the robot reports; and where the robot may be in a car since an earlier ride gave up, for one begun before that or without
    a name. Harmless otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RideLimits:
    """How long each phase may take; the manager gives up after it. Seconds."""

    queued_s: float = 600.0
    called_s: float = 300.0
    boarding_s: float = 120.0
    riding_s: float = 300.0
    alighting_s: float = 300.0
    """RMF gives a robot 300 s to find itself on the new floor before it leaves (open-rmf 1.5)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RideRequest:
    """A caller wants its robot taken from one floor to another."""

    lifts: tuple[str, ...]
    """The lifts to choose among: one, or all that the caller may command."""
    any_lift: bool
    """The caller lets the manager choose."""
    start: FloorName
    destination: FloorName
    door: Side | None = None
    """By which door the robot boards; only lifts with this door at `start` are chosen."""
    robot: str = ""
    """Distinguishes the robots of one caller; empty if the caller has one robot only: without names none of its rides starts while
    the robot of another may be in a car."""
    caller: Holder
    """Face `ride`; its name distinguishes callers."""
    key: str = ""
    """Idempotency key: the same one of the same caller gives the same ride; empty for none."""
    limits: RideLimits = RideLimits()

    @property
    def holder(self) -> Holder:
        """The holder of the lift. Two robots of one caller are two holders: one may be in the car while the other waits."""
        caller, robot = self.caller.name, self.robot
        is_caller = not robot or robot == caller or caller.endswith(f"/{robot}")
        return Holder("ride", caller if is_caller else f"{caller}/{robot}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ride:
    """A ride at one moment, as every face shows it."""

    id: str
    lift: str
    """The lift that was chosen; of `any` it may change while the ride is queued."""
    any_lift: bool
    start: FloorName
    destination: FloorName
    door: Side | None
    robot: str
    caller: Holder
    phase: Phase
    guidance: Guidance
    reason: str
    """What it waits for, why the guidance is not the expected one, or why it was given up; empty otherwise."""
    advice: Advice | None
    """With `gave_up`: the robot's best course; None if it needs none."""
    ahead: int | None
    """How many wait before it; None once it is no longer queued."""
    phase_ends_in_s: float | None
    """Until the manager gives the phase up; None once the ride is over."""
    maybe_aboard: bool
    """The robot may be in the car."""
    begun_at: datetime
    changed_at: datetime
    """When phase, guidance or reason changed last."""


@dataclass(frozen=True, slots=True)
class RideBegun:
    """The reply to a `RideRequest`."""

    ride: Ride
    is_new: bool
    """False where the idempotency key gave an existing one."""


@dataclass(frozen=True, slots=True)
class RidePlan:
    """The forecast of a ride, without beginning it."""

    lift: str
    ahead: int
    """How many would wait before it."""
    reason: str
    """Why it would have to wait; empty where it would begin at once."""
