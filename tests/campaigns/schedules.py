"""What happens to one lift in one minute: drawn from a seed, replayed exactly, and made smaller one event at a time. Pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from random import Random
from typing import Any

from lift_manager.lab.world.disk import DiskFault, Pace
from lift_manager.lab.world.fault_names import every_device_fault
from register_maps.words import Mode, Side, Table
from simulator import faults as device
from simulator import wire_faults as wire
from simulator.faults import Fault
from simulator.people import Traffic
from simulator.wire_faults import Access, Target, WireFault
from tests.support.trip_sites import NO_TRIP

LASTS_S = 60.0
POLL_S = 0.2
FIRES = (device.InMode(Mode.FIRE),) * 4
"""Drawn beside one of every fault: what a fire does is worth more minutes than what an indicator does."""
IN_PIECES = 0.15
"""Share of minutes in which what is read of a lift may not belong together: they are what a second reading is for."""
TEARS = (("generic-registers", 2), ("seer-generic", 1))
"""Maps, and how much at once, where door and floor come in different reads and little else delays them."""
ON_DISK = 0.3
"""Share of minutes in which state and journal are on a simulated disk; in the others commits take no time."""
PACES = (Pace(0.002, 0.02), Pace(0.005, 0.3), Pace(0.02, 1.5), Pace(0.2, 4.0))
"""A good disk, a busy one, a worn card, and one that is hardly of use."""
TURNED, HANDED, DOUBLE, RESTARTED = 0.12, 0.1, 0.1, 0.08
"""Shares of minutes in which a key is turned, a robot gives the lift to another, each floor has two doors, and the manager is killed while the
first car is on its way."""
TELLS_KEYS = {
    "no_robots": ("generic-coils",),
    "inspection": ("generic-coils", "generic-registers"),
    "independent": ("generic-coils", "generic-registers"),
}
"""Maps that tell how a key stands."""
TWO_DOORS = ("generic-coils", "generic-registers")
"""Maps that a site gives a second door."""
HOLDERS = ("workshop", "fleet:r1", "fleet:r2")


@dataclass(frozen=True)
class RobotRides:
    """A robot that calls the lift, rides and leaves, asking again every second as clients do."""

    at: float
    holder: str
    pickup: int
    """Index of the floor."""
    destination: int
    in_words: bool
    gives_up_after_s: float
    """It stops asking, wherever it is."""
    holds: bool
    """Whether it wants the door held where it gets out; otherwise it lets the lift go by arriving there."""
    releases: bool
    """Whether it lets the lift go at the end, or just falls silent."""


@dataclass(frozen=True)
class Asks:
    """One request that has nothing to do with anything."""

    at: float
    holder: str
    floor: int
    hold: bool


@dataclass(frozen=True)
class DeviceFails:
    """A fault of the lift or its controller."""

    at: float
    fault: Fault
    for_s: float


@dataclass(frozen=True)
class WireFails:
    """A fault on the wire."""

    at: float
    fault: WireFault
    for_s: float


@dataclass(frozen=True)
class PeopleCome:
    """Passengers from here on."""

    at: float
    seed: int
    per_minute: float = Traffic().per_minute


@dataclass(frozen=True)
class PersonActs:
    """A person with the right to: checks the lift, keeps robots off it, lets them on it again."""

    at: float
    what: str
    """acknowledge, lock_out or end_lockout."""


@dataclass(frozen=True)
class Restarts:
    """The manager is killed and started again."""

    at: float


@dataclass(frozen=True)
class DiskFails:
    """A fault of the disk with the manager's state and journal."""

    at: float
    fault: DiskFault
    for_s: float


@dataclass(frozen=True)
class Patience:
    """What a site says of a slow controller; None: what its map says."""

    at_once: int | None = None
    """Registers, or bits, that it answers in one read at the most."""
    max_age_s: float | None = None
    timeout_s: float | None = None

    def __str__(self) -> str:
        at_once = "everything" if self.at_once is None else str(self.at_once)
        return f"{at_once} at once, readings count for {self.max_age_s} s, time-out {self.timeout_s} s"


@dataclass(frozen=True)
class KeyTurned:
    """A person turns a key switch, and back again."""

    at: float
    key: str
    """no_robots, inspection or independent."""
    for_s: float


@dataclass(frozen=True)
class HandsOver:
    """One robot gives the lift to another, if it holds it then."""

    at: float
    holder: str
    to: str


Event = (
    RobotRides | Asks | DeviceFails | WireFails | PeopleCome | PersonActs | KeyTurned | HandsOver | Restarts | DiskFails
)


@dataclass(frozen=True)
class Schedule:
    """One minute of one lift."""

    seed: int
    map: str
    speed: float
    max_session_hold_s: float
    lease_s: float
    between_sessions_s: float
    events: tuple[Event, ...]
    patience: Patience = Patience()
    disk: Pace | None = None
    """None: commits take no time and do not fail."""
    two_doors: bool = False
    """Each floor has a rear door beside the front one."""

    def __str__(self) -> str:
        head = f"seed {self.seed}, {self.map}, speed {self.speed:g}, hold {self.max_session_hold_s:g} s, lease {self.lease_s:g} s"
        head += f", {self.patience}" if self.patience != Patience() else ""
        head += f", commits take {self.disk.least_s:g} to {self.disk.most_s:g} s" if self.disk is not None else ""
        head += ", two doors" if self.two_doors else ""
        return "\n".join([head, *(f"  {event.at:6.2f} s  {event}" for event in self.events)])


def draw(seed: int, maps: Sequence[str]) -> Schedule:
    """Draw a schedule; the same for the same seed and list of maps."""
    random = Random(seed)
    name = random.choice([one for one in maps if one not in NO_TRIP])
    events: list[Event] = [_robot(random, first=True)]
    events += [_robot(random, first=False) for _ in range(random.choice((0, 0, 1, 2)))]
    events += [_ask(random) for _ in range(random.choice((0, 0, 1, 4)))]
    events += [_device(random) for _ in range(random.choice((0, 1, 1, 2)))]
    events += [_wire(random) for _ in range(random.choice((0, 0, 1, 2)))]
    if random.random() < 0.6:
        events.append(PeopleCome(random.uniform(0, 20), random.getrandbits(32)))
    for what in random.choice(((), (), ("acknowledge",), ("acknowledge", "acknowledge"), ("lock_out", "end_lockout"))):
        events.append(PersonActs(random.uniform(5, 55), what))
    if random.random() < 0.15:
        events.append(Restarts(random.uniform(5, 50)))
    schedule = Schedule(
        seed=seed,
        map=name,
        speed=random.choice((1.0, 1.0, 2.0, 2.0, 4.0, 4.0, 4.0, 20.0)),
        max_session_hold_s=random.choice((6.0, 20.0, 900.0)),
        lease_s=random.choice((8.0, 300.0)),
        between_sessions_s=random.choice((0.0, 5.0)),
        events=tuple(sorted(events, key=lambda event: event.at)),
    )
    schedule = _in_pieces(random, schedule, maps) if random.random() < IN_PIECES else schedule
    return _on_disk(_further(Random(f"{seed} further"), schedule, maps))


def _further(random: Random, schedule: Schedule, maps: Sequence[str]) -> Schedule:
    """Turn keys, hand the lift over, and build a second door, each in a few minutes; dice of its own leave all else as it was."""
    events: list[Event] = []
    if random.random() < TURNED:
        key = random.choice(("no_robots", "no_robots", "inspection", "independent"))
        events.append(KeyTurned(random.uniform(3, 40), key, random.uniform(4, 20)))
        told_by = [one for one in TELLS_KEYS[key] if one in maps]
        if told_by and random.random() < 0.7:
            schedule = replace(schedule, map=random.choice(told_by), patience=Patience())
    if random.random() < HANDED:
        rides = [event for event in schedule.events if isinstance(event, RobotRides)]
        for ride in rides[:1]:
            at, to = ride.at + random.uniform(4, 25), random.choice(HOLDERS)
            if to == ride.holder:  # that would be a renewal, which no event tells the judge of
                to = HOLDERS[HOLDERS.index(to) - 1]
            events.append(HandsOver(at, ride.holder, to))
    two = [one for one in TWO_DOORS if one in maps]
    if two and random.random() < DOUBLE:
        schedule = replace(schedule, map=random.choice(two), two_doors=True, patience=Patience())
        kinds = (device.StuckDoor, device.ReopeningDoor)
        side = random.choice(tuple(Side))
        events.append(DeviceFails(random.uniform(4, 30), random.choice(kinds)(side), random.choice((4.0, 10.0, 30.0))))
    if random.random() < RESTARTED:
        first = next((event.at for event in schedule.events if isinstance(event, RobotRides)), 0.0)
        events.append(Restarts(first + random.uniform(1.5, 9)))
    if not events:
        return schedule
    return replace(schedule, events=tuple(sorted((*schedule.events, *events), key=lambda event: event.at)))


def _on_disk(schedule: Schedule) -> Schedule:
    """Give some minutes a disk that is slow or fails. Its draws are its own: those of the rest are as without it."""
    random = Random(f"disk {schedule.seed}")
    if random.random() >= ON_DISK:
        return schedule
    pace = random.choice(PACES)
    fails = [_disk_fails(random) for _ in range(random.choice((0, 1, 1, 2)))]
    events = sorted((*schedule.events, *fails), key=lambda event: event.at)
    return replace(schedule, disk=pace, events=tuple(events))


def _disk_fails(random: Random) -> DiskFails:
    return DiskFails(random.uniform(0, 50), random.choice(tuple(DiskFault)), random.choice((0.5, 3.0, 10.0, 60.0)))


def _in_pieces(random: Random, schedule: Schedule, maps: Sequence[str]) -> Schedule:
    """Let the same minute happen to a fast and busy lift that is read in small pieces by a controller that pauses now and then.

    A trip takes less time than a pause. No two readings in a row are torn: nothing that is read could tell, should they agree.
    """
    pieces = random.choice([*(one for one in TEARS if one[0] in maps), (schedule.map, random.choice((None, 1, 2, 4)))])
    pause = wire.Delay(random.choice((0.3, 0.9, 0.9)), times=1)
    pauses = [WireFails(3.0 * n + random.uniform(0, 1), pause, 1.5) for n in range(1, 19)]
    people = PeopleCome(random.uniform(0, 5), random.getrandbits(32), per_minute=60.0)
    replaced: tuple[type, ...] = (WireFails, PeopleCome)
    if random.random() < 0.7:
        replaced += (RobotRides, Asks)  # robots hold doors, and a door that is held open tears nothing
    events = [event for event in schedule.events if not isinstance(event, replaced)] + [*pauses, people]
    return replace(
        schedule,
        map=pieces[0],
        speed=random.choice((4.0, 12.0, 12.0)),
        patience=Patience(pieces[1], max_age_s=1.0, timeout_s=1.0),
        events=tuple(sorted(events, key=lambda event: event.at)),
    )


def shrink(schedule: Schedule, fails: Callable[[Schedule], bool], *, tries: int = 200) -> Schedule:
    """Return a smaller schedule that still fails: fewer events first, then simpler ones."""
    smaller = True
    while smaller:
        smaller = False
        for candidate in _smaller(schedule):
            tries -= 1
            if tries < 0:
                return schedule
            if fails(candidate):
                schedule, smaller = candidate, True
                break
    return schedule


def _smaller(schedule: Schedule) -> list[Schedule]:
    events = schedule.events
    found = [replace(schedule, events=events[:n] + events[n + 1 :]) for n in range(len(events))]
    for n, event in enumerate(events):
        found += [replace(schedule, events=(*events[:n], one, *events[n + 1 :])) for one in _simpler(event)]
    if schedule.disk is not None:
        others = tuple(event for event in events if not isinstance(event, DiskFails))
        found.append(replace(schedule, disk=None, events=others))
    plain = replace(schedule, speed=1.0), replace(schedule, lease_s=300.0), replace(schedule, max_session_hold_s=900.0)
    return found + [one for one in plain if one != schedule]


def _simpler(event: Event) -> list[Event]:
    match event:
        case DeviceFails() | WireFails() if event.for_s > 1:
            return [replace(event, for_s=event.for_s / 2)]
        case RobotRides() if event.in_words or not event.releases:
            return [replace(event, in_words=False, releases=True)]
        case _:
            return []


def _robot(random: Random, *, first: bool) -> RobotRides:
    pickup = random.randrange(8)
    return RobotRides(
        at=random.uniform(0.5, 4) if first else random.uniform(5, 45),
        holder=HOLDERS[0] if first else random.choice(HOLDERS),
        pickup=pickup,
        destination=pickup + random.randrange(1, 4),
        in_words=random.random() < 0.5,
        gives_up_after_s=random.choice((5.0, 30.0, 60.0, 60.0)),
        holds=random.random() < 0.8,
        releases=random.random() < 0.8,
    )


def _ask(random: Random) -> Asks:
    return Asks(random.uniform(1, 58), random.choice(HOLDERS), random.randrange(8), random.random() < 0.6)


def _device(random: Random) -> DeviceFails:
    every = (*every_device_fault(), *FIRES)
    place = random.randrange(len(every) + 1)
    fault = every[place] if place < len(every) else _foreign(random)
    return DeviceFails(random.uniform(2, 50), fault, random.choice((1.0, 4.0, 10.0, 60.0)))


def _foreign(random: Random) -> Fault:
    command = random.choice(("hold_door.front", "go_to", "call", "robot_mode", "close_door.front"))
    return device.ForeignWriter(command, floor=random.randrange(2), pressed=random.random() < 0.6)


def _wire(random: Random) -> WireFails:
    kind = random.choice(wire.WIRE_FAULTS)
    said: dict[str, Any] = _OWN[kind](random) if kind in _OWN else {}
    said |= {"probability": random.choice((1.0, 1.0, 0.5, 0.1)), "times": random.choice((None, None, 1, 3))}
    if any(field.name == "on" for field in fields(kind)):
        said["on"] = random.choice((Target(), Target(), *_TARGETS))
    return WireFails(random.uniform(1, 50), kind(**said), random.choice((0.5, 3.0, 10.0, 60.0)))


_TARGETS = (
    Target(access=Access.READS),
    Target(access=Access.WRITES),
    *(Target(table=table) for table in Table),
)

_OWN: dict[type, Callable[[Random], dict[str, Any]]] = {
    wire.AnswerWithException: lambda random: {"code": random.choice((1, 2, 3, 4, 5, 6, 10, 11, 77))},
    wire.WrongTransactionId: lambda random: {
        "offset": random.choice((-2, -1, 1, 7)),
        "fixed": random.choice((None, 0)),
    },
    wire.WrongCount: lambda random: {"by": random.choice((-1, 1, 2)), "field_only": random.random() < 0.3},
    wire.WrongEcho: lambda random: {"part": random.choice(tuple(wire.EchoPart))},
    wire.Delay: lambda random: {"seconds": random.choice((0.05, 0.2, 0.45, 0.9))},
    wire.UniformDelay: lambda random: {"least_s": 0.01, "most_s": random.choice((0.1, 0.6, 1.5))},
    wire.LongTailedDelay: lambda random: {"median_s": random.choice((0.05, 0.2))},
    wire.LateAnswer: lambda random: {"seconds": random.choice((0.3, 0.6, 0.9, 2.0, 5.0))},
    wire.DuplicateAnswer: lambda random: {"after_s": random.choice((0.0, 0.05, 0.3, 1.0))},
    wire.Bandwidth: lambda random: {"bytes_per_s": random.choice((100, 1000))},
    wire.ConnectionLimit: lambda random: {"clients": random.choice((0, 1)), "silent": random.random() < 0.5},
}
"""What each kind of fault is told beside its limits."""
