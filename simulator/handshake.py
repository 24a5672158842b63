"""The robot handshake of lifts that distinguish an empty car from an occupied one (elevator-interfaces 1.1 and 1.3). Pure.

`call` moves the empty car, which stands open until the robot reports that it is in place. `go` moves the occupied car, which
stands open until the robot reports that it has left. A command that stays on after that is spent: it counts again once it changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from simulator.network import Given

CALL, GO, IN_PLACE, LEFT = "call", "go", "robot_in_place", "robot_left"
NAMES = (CALL, GO, IN_PLACE, LEFT)


@dataclass(frozen=True, slots=True)
class Rules:
    """How the handshake of a lift works."""

    lasting: frozenset[str] = frozenset()
    """Those of `call` and `go` that are held: releasing one before its acknowledgement cancels it."""
    in_place_sends_on: bool = False
    """There is no `go`: a robot in place is what sends the car to the other of two floors."""
    in_place_is_occupied: bool = False
    """`robot_in_place` is on while the car is occupied; its release reports that the robot has left."""


@dataclass(frozen=True, slots=True)
class State:
    """Whether the car is occupied, and where it is to stand open."""

    occupied: bool = False
    enter_at: int | None = None
    """Floor requested by `call`, until the robot is in place."""
    leave_at: int | None = None
    """Floor requested by `go`, until the robot has left."""
    given: Given = field(default_factory=dict)
    spent: Given = field(default_factory=dict)
    """Values of `call` and `go` that were accepted or have ended."""

    @property
    def awaits_at(self) -> int | None:
        """Floor at which the car stands open until somebody gets in, or out."""
        return self.leave_at if self.occupied else self.enter_at


def step(state: State, given: Given, floor: int, floors: int, rules: Rules) -> tuple[State, frozenset[int]]:
    """Return the state after one scan, and the floors to which it sends the car. The car is at `floor` of `floors`."""
    present = {name: given[name] for name in NAMES if name in given}
    if present == state.given and not (present.keys() & {CALL, GO}):
        return state, frozenset()
    spent = {name: value for name, value in state.spent.items() if present.get(name) == value}
    occupied, enter_at, leave_at = state.occupied, state.enter_at, state.leave_at
    sent: set[int] = set()
    if _taken_back(CALL, state, present, rules):
        enter_at = None
    if _taken_back(GO, state, present, rules):
        leave_at = None
    if LEFT in present and LEFT not in state.given:
        occupied, leave_at = False, None
        spent |= _level(GO, present)
    if rules.in_place_is_occupied and IN_PLACE in state.given and IN_PLACE not in present:
        occupied, leave_at = False, None
    if IN_PLACE in present and IN_PLACE not in state.given:
        occupied, enter_at = True, None
        spent |= _level(CALL, present)
        if rules.in_place_sends_on and floors == 2:  # with more floors the target is unknown
            leave_at = 1 - floor
            sent.add(leave_at)
    if not occupied and CALL in present and CALL not in spent:
        enter_at = spent[CALL] = present[CALL]
        sent.add(enter_at)
    if occupied and GO in present and GO not in spent:
        leave_at = spent[GO] = present[GO]
        sent.add(leave_at)
    return State(occupied, enter_at, leave_at, present, spent), frozenset(sent)


def _taken_back(name: str, state: State, present: Mapping[str, int], rules: Rules) -> bool:
    return name in rules.lasting and name in state.given and name not in present


def _level(name: str, present: Mapping[str, int]) -> dict[str, int]:
    return {name: present[name]} if name in present else {}
