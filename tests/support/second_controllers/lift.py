"""A lift of few words behind the second controllers: a car, a door, timers. Time is handed in; the lowest floor is 0."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

BEAT_S = 0.05
FLOOR_S = 3.0
"""From one floor to the next."""
DOOR_S = 2.0
"""From closed to open, and back."""
WAITS_S = 3.0
"""How long an open door waits."""


@dataclass(frozen=True)
class Shows:
    """What a lift does at one moment."""

    floor: int = 0
    """Where the car is, or which floor it passed last."""
    at_floor: bool = True
    """Near enough to that floor for its contact."""
    level: bool = True
    door: str = "closed"
    """`closed`, `opening`, `open` or `closing`."""
    motion: str = "stopped"
    """`stopped`, `up` or `down`."""
    robot_mode: bool = False
    accepted: int | None = None
    """The floor last called, until the car is there."""
    destination: int | None = None
    may_enter: bool = False
    may_leave: bool = False
    beat: int = 0

    @property
    def open_at(self) -> int | None:
        return self.floor if self.door == "open" and self.level else None


class Lift(Protocol):
    """What a controller needs of its lift."""

    @property
    def shows(self) -> Shows: ...

    def run_to(self, now: float, asked: Mapping[str, int] | None = None) -> None:
        """Let time pass, with these commands there; None: with those of before."""
        ...


@dataclass
class Still:
    """A lift that does what it is told it does, and nothing by itself."""

    shows: Shows

    def run_to(self, now: float, asked: Mapping[str, int] | None = None) -> None:
        pass


class NaiveLift:
    """A car that goes where it was called last, and a door that opens where the car arrives."""

    def __init__(self, floors: int, *, robot_mode: bool = False, in_place_sends_on: bool = False) -> None:
        """`robot_mode` is on by a key; `in_place_sends_on` for two floors without a `go`."""
        self.shows = Shows(robot_mode=robot_mode)
        self._floors = floors
        self._key = robot_mode
        self._sends_on = in_place_sends_on
        self.mistaken_s = 0.0
        """For so long after its door has opened it gives the wrong permission."""
        self._open_for_s = 0.0
        self._now = 0.0
        self._height = 0.0
        self._door = 0.0
        self._waits_s = 0.0
        self._asked: dict[str, int] = {}
        self._target: int | None = None
        self._enter_at: int | None = None
        self._leave_at: int | None = None
        self._occupied = False
        self._robot_for_s = 0.0

    def run_to(self, now: float, asked: Mapping[str, int] | None = None) -> None:
        if asked is not None and asked != self._asked:
            self._hear(dict(asked))
        while self._now + BEAT_S <= now:
            self._now += BEAT_S
            self._beat()

    def _hear(self, asked: dict[str, int]) -> None:
        before, self._asked = self._asked, asked
        for name, value in asked.items():
            if before.get(name) != value:
                self._press(name, value)
        for name in before.keys() - asked.keys():
            self._let_go(name)

    def _press(self, name: str, value: int) -> None:
        if name == "go_to":
            self._send(value)
        elif name == "call" and not self._occupied:
            self._enter_at = value
            self._send(value)
        elif name == "go" and self._occupied:
            self._leave_at = value
            self._send(value)
        elif name == "robot_in_place":
            self._occupied, self._enter_at = True, None
            if self._sends_on:
                self._leave_at = 1 - self.shows.floor
                self._send(self._leave_at)
            elif "go" in self._asked:
                self._leave_at = self._asked["go"]
                self._send(self._leave_at)
        elif name == "robot_left":
            self._occupied, self._leave_at = False, None

    def _let_go(self, name: str) -> None:
        if name == "call":
            self._enter_at = None
        elif name == "go" or (name == "robot_in_place" and self._sends_on):
            self._leave_at = None
            self._occupied = self._occupied and not self._sends_on

    def _send(self, floor: int) -> None:
        if floor < self._floors:
            self._target = floor
            self.shows = replace(self.shows, accepted=floor)

    def _beat(self) -> None:
        wants_robot = self._key or "robot_mode" in self._asked
        self._robot_for_s = self._robot_for_s + BEAT_S if wants_robot else 0.0
        here = round(self._height)
        level = abs(self._height - here) < 1e-6
        if level and self._target == here:
            self._target, self._waits_s = None, WAITS_S
        awaited = self._leave_at if self._occupied else self._enter_at
        kept = "hold_door.front" in self._asked or awaited == here
        before = self._door
        if level and (kept or self._waits_s > 0) and "close_door.front" not in self._asked:
            self._door = min(1.0, self._door + BEAT_S / DOOR_S)
            self._waits_s -= BEAT_S if self._door >= 1.0 else 0.0
        elif self._door > 0:
            self._door = max(0.0, self._door - BEAT_S / DOOR_S)
        motion = self._drive() if self._door == 0.0 else "stopped"
        self._show(before, motion, awaited)

    def _drive(self) -> str:
        if self._target is None:
            return "stopped"
        step = BEAT_S / FLOOR_S
        away = self._target - self._height
        if abs(away) <= step:
            self._height = float(self._target)
            return "stopped"
        self._height += step if away > 0 else -step
        return "up" if away > 0 else "down"

    def _show(self, door_before: float, motion: str, awaited: int | None) -> None:
        nearest = round(self._height)
        away = abs(self._height - nearest)
        door = "opening" if self._door > door_before else "closing"
        door = {0.0: "closed", 1.0: "open"}.get(self._door, door)
        waits = door == "open" and away < 1e-6 and awaited == nearest
        self._open_for_s = self._open_for_s + BEAT_S if waits else 0.0
        for_leaving = self._occupied is not (self._open_for_s <= self.mistaken_s and waits)
        self.shows = Shows(
            floor=nearest if away < 0.05 else self.shows.floor,
            at_floor=away < 0.05,
            level=away < 1e-6 and motion == "stopped",
            door=door,
            motion=motion,
            robot_mode=self._robot_for_s > 0.3,
            accepted=self.shows.accepted if self._target is not None else None,
            destination=self._target,
            may_enter=waits and not for_leaving,
            may_leave=waits and for_leaving,
            beat=int(self._now * 2) % 65536,
        )
