"""What may happen around one lift: plain values, each from a time on."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    """Something that happens."""

    at: float


@dataclass(frozen=True)
class Ride(Event):
    """A robot calls the lift, enters, rides, leaves, and ends its session."""

    session: str
    """`<fleet>/<robot>`."""
    pickup: int
    """Index of the floor."""
    destination: int
    drives_s: float = 3.0
    """Through the door, either way."""
    crowded: int = 0
    """So often it finds the car crowded."""
    replans_after_s: float | None = None
    """So long into the ride it asks for the boarding floor again, and then for its destination (rmf_ros2#555)."""
    replans_outside: bool = False
    """It plans again while it waits outside."""
    trips: int = 1
    """There, and back again, each with a session of the same name."""
    gives_up_after_s: float | None = None
    """So long after it called it leaves its task, if it is still outside."""


@dataclass(frozen=True)
class SupervisorRestarts(Event):
    """The lift supervisor ends and forgets."""

    down_s: float


@dataclass(frozen=True)
class AdapterRestarts(Event):
    """The adapter ends and forgets."""

    down_s: float


@dataclass(frozen=True)
class ManagerRestarts(Event):
    """The manager is killed; it remembers what it wrote down."""

    down_s: float


@dataclass(frozen=True)
class Takeover(Event):
    """Of two machines the active one is killed, with its manager and its adapter, and the other one takes over."""

    down_s: float


@dataclass(frozen=True)
class WayCut(Event):
    """Adapter and manager do not hear each other."""

    for_s: float


@dataclass(frozen=True)
class Outage(Event):
    """Adapter and manager do not reach each other, from when a robot leaves the car; the adapter is restarted meanwhile."""

    for_s: float


@dataclass(frozen=True)
class UnheardEnd(Event):
    """Somebody ends the session of a robot in rmf-web while the lift supervisor is away; its fleet goes on asking."""

    session: str
    down_s: float


@dataclass(frozen=True)
class OtherRmf(Event):
    """The adapter of another RMF at the same manager has a session of a robot of the same name."""

    session: str
    floor: int
    for_s: float


@dataclass(frozen=True)
class Unplugged(Event):
    """The controller is off the network."""

    for_s: float


@dataclass(frozen=True)
class Fire(Event):
    """A fire alarm; a person acknowledges some time after its end."""

    for_s: float
    acknowledged_after_s: float = 2.0


@dataclass(frozen=True)
class LockedOut(Event):
    """A technician keeps robots off."""

    for_s: float


@dataclass(frozen=True)
class OtherFace(Event):
    """A client of the REST API wants the lift, and holds it for a while."""

    floor: int
    for_s: float


@dataclass(frozen=True)
class WebRequest(Event):
    """Somebody asks for the lift in rmf-web, and ends that later."""

    floor: int
    for_s: float


@dataclass(frozen=True)
class WebEnd(Event):
    """Somebody ends the session of a robot in rmf-web."""

    session: str
    floor: int


@dataclass(frozen=True)
class Script(Event):
    """`request_lift.py` of rmf_demos."""

    floor: int


@dataclass(frozen=True)
class Panel(Event):
    """Somebody asks for the lift in rviz, past the supervisor, and ends that later."""

    floor: int
    for_s: float


@dataclass(frozen=True)
class Ends(Event):
    """END_SESSION again and again, straight to the adapter, for a session that may be anybody's."""

    session: str
    floor: str
    count: int
    every_s: float


@dataclass(frozen=True)
class Repeats(Event):
    """The last request of the supervisor comes again and again."""

    count: int
    every_s: float
