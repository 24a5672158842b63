"""The physical state of simulated lifts, and its history: the evidence for every verdict."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from drivers.model import FloorName
from register_maps.words import Door, Mode, Side
from simulator.modes import SERVICE
from simulator.registers import RegisterFace
from simulator.state import ShownState


@dataclass(frozen=True, slots=True)
class Truth:
    """The physical state of one lift at one moment, whatever its registers show."""

    at: FloorName | None
    """The floor in whose door zone the car is."""
    open_at: FloorName | None
    """The floor at which the car is in the door zone with every door that serves it fully open."""
    standing: bool
    doors_shut: bool
    mode: Mode
    robot_mode: bool
    calls: frozenset[FloorName]
    """Car calls that are registered and not served yet."""
    given: tuple[tuple[str, int], ...]
    """The commands that are written in the controller's registers, each with the index of its floor, or 1."""
    passed: FloorName | None = None
    """The floor in whose door zone the car was last. The car may enter and leave a zone between two observations."""
    heading: int = 0
    """1 upwards, -1 downwards, 0 if the car stands."""
    doors: tuple[tuple[Side, Door], ...] = ()
    """The state of every door; empty if the doors were not observed one by one."""
    fallen: frozenset[str] = frozenset()
    """Commands in the registers that the controller does not obey: its watchdog expired, the press was lost, or the mode does not serve
    them."""
    lost: frozenset[str] = frozenset()
    """Those of them whose press was lost."""
    awaits: bool = False
    """Whether the handshake of the lift lets the robot enter or leave now."""
    bars: frozenset[str] = frozenset()
    """Flags that keep robots off now: `robots_allowed`, `watchdog_tripped`."""
    commands: frozenset[str] = field(init=False, repr=False, compare=False)
    """The names of the commands in `given`."""
    obeyed: frozenset[str] = field(init=False, repr=False, compare=False)
    """The commands that the controller obeys. A door hold that is missing here holds no door."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "commands", frozenset(name for name, _ in self.given))
        object.__setattr__(self, "obeyed", self.commands - self.fallen)


def truth_of(face: RegisterFace, floors: Sequence[FloorName], given: Mapping[str, int]) -> Truth:
    """Return the physical state of a lift at its own time; `given` are the commands in its registers."""
    picture = face.picture
    at = picture.floor if picture.in_door_zone else None
    here = face.parameters.doors_at[at] if at is not None else frozenset()
    is_open = at is not None and all(picture.doors[side] is Door.OPEN for side in here)
    return Truth(
        at=None if at is None else floors[at],
        open_at=floors[at] if is_open and at is not None else None,
        standing=picture.speed_m_s == 0.0,
        doors_shut=all(door is Door.CLOSED for door in picture.doors.values()),
        mode=picture.mode,
        robot_mode=picture.robot_mode_on,
        calls=frozenset(floors[index] for index in picture.car_calls),
        given=tuple(sorted(given.items())),
        passed=floors[picture.floor],
        heading=(picture.speed_m_s > 0) - (picture.speed_m_s < 0),
        doors=tuple(sorted(picture.doors.items())),
        fallen=_fallen(face, given, picture.mode),
        lost=frozenset(face.lost),
        awaits=picture.may_enter or picture.may_leave,
        bars=_bars(picture),
    )


def _fallen(face: RegisterFace, given: Mapping[str, int], mode: Mode) -> frozenset[str]:
    """Return the commands that are in the registers and not obeyed. The drive of a door may see a press one scan late."""
    if not given:
        return _NOTHING
    believed, lost = face.believed, face.lost
    serves_doors = SERVICE[mode].door_buttons
    return frozenset(
        name
        for name in given
        if name in lost
        or (name not in believed and name in face.commands)
        or (name.startswith("hold_door") and not serves_doors)
    )


_NOTHING = frozenset[str]()


def _bars(picture: ShownState) -> frozenset[str]:
    if picture.robots_allowed and not picture.watchdog_tripped:
        return _NOTHING
    kept_off = {"robots_allowed"} if not picture.robots_allowed else set()
    return frozenset(kept_off | ({"watchdog_tripped"} if picture.watchdog_tripped else set()))


def truth_text(truth: Truth) -> str:
    """Describe where the car is and what it does."""
    where = f"at {truth.at}" if truth.at is not None else "between floors"
    doors = "doors fully open" if truth.open_at is not None else "doors not fully open"
    return f"{where}, {'standing' if truth.standing else 'moving'}, {'doors shut' if truth.doors_shut else doors}"


def starts_towards(truths: Iterable[Truth], target: FloorName, floors: Sequence[FloorName]) -> bool:
    """Whether a car stood and then started towards a floor. `truths` are oldest first, `floors` lowest first."""
    stood = False
    for truth in truths:
        if truth.standing:
            stood = True
        elif stood and truth.passed is not None:
            ahead = floors.index(target) - floors.index(truth.passed)
            if ahead * truth.heading > 0:
                return True
    return False


class History:
    """The physical state of one lift over time. Each observation counts until the next one."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._truths: list[Truth] = []

    @property
    def last(self) -> Truth | None:
        """The newest state; None before the first observation."""
        return self._truths[-1] if self._truths else None

    def add(self, at: float, truth: Truth) -> None:
        """Record an observation. One that repeats the last one takes no space."""
        if not self._truths or truth != self._truths[-1]:
            self._times.append(at)
            self._truths.append(truth)

    def during(self, since: float, until: float) -> Iterator[Truth]:
        """Yield every state that was true at some moment between these times, newest first."""
        index = bisect_right(self._times, until) - 1
        while index >= 0:
            yield self._truths[index]
            if self._times[index] <= since:
                return
            index -= 1

    def floor_since(self, when: float) -> float:
        """Return since when the car had passed no other floor, as of this moment."""
        index = max(bisect_right(self._times, when) - 1, 0)
        passed = self._truths[index].passed
        while index > 0 and self._truths[index - 1].passed == passed:
            index -= 1
        return self._times[index]

    def forget(self, before: float) -> None:
        """Drop the states that ended before this time."""
        index = bisect_right(self._times, before) - 1
        if index > 0:
            del self._times[:index]
            del self._truths[:index]

    def at(self, when: float) -> Truth:
        """Return the state at one moment. Raises IndexError before the first observation."""
        index = bisect_right(self._times, when) - 1
        if index < 0:
            raise IndexError(f"no observation before {when:g} s")
        return self._truths[index]

    def items(self) -> Iterator[tuple[float, Truth]]:
        """Yield every change with its time, oldest first."""
        return zip(self._times, self._truths, strict=True)
