"""A controller on a bench, with virtual time and hands on every input."""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

from register_maps.words import Door, Side
from simulator import controller, shaft
from simulator.controller import Inputs, Parameters, ShownState, State
from simulator.modes import Key

FRONT, REAR = frozenset({Side.FRONT}), frozenset({Side.REAR})
BOTH = FRONT | REAR
SCAN_S = 0.05
BUILDING = shaft.Parameters(heights_m=shaft.even_heights(5), doors_at=(FRONT, BOTH, REAR, FRONT, FRONT))
PLAIN = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(5)))


def floors(*indices: int) -> frozenset[int]:
    return frozenset(indices)


@dataclass
class Lift:
    """One lift on a bench: inputs stay as they are set until they are set again."""

    parameters: Parameters = PLAIN
    at: int = 0
    key: Key = Key.NORMAL
    inputs: Inputs = field(init=False)
    state: State = field(init=False)

    def __post_init__(self) -> None:
        self.state = controller.initial(self.parameters, floor_index=self.at, key=self.key)
        self.inputs = Inputs(key=self.key)

    def run(self, duration_s: float, **inputs: Any) -> ShownState:
        """Set inputs, let time pass, look."""
        self.inputs = replace(self.inputs, **inputs)
        self.state = controller.step(self.state, self.inputs, duration_s, self.parameters)
        return self.see()

    def see(self) -> ShownState:
        return controller.picture(self.state, self.parameters)

    def press(self, *, car: frozenset[int] = frozenset(), landing: frozenset[int] = frozenset()) -> ShownState:
        """Press buttons for two scans and let go."""
        self.run(2 * SCAN_S, car_buttons=car, landing_buttons=landing)
        return self.run(2 * SCAN_S, car_buttons=frozenset(), landing_buttons=frozenset())

    def watch(self, duration_s: float, **inputs: Any) -> list[ShownState]:
        return [self.run(SCAN_S, **inputs) for _ in range(round(duration_s / SCAN_S))]

    def stops(self, duration_s: float) -> list[int]:
        """Floors at which the doors come to be fully open, in order."""
        seen = [self.see().door_open_floor, *(picture.door_open_floor for picture in self.watch(duration_s))]
        return [now for before, now in pairwise(seen) if now is not None and now != before]


def opened(lift: Lift, *sides: Side) -> bool:
    return all(lift.see().doors[side] is Door.OPEN for side in sides)


def all_closed(picture: ShownState) -> bool:
    return all(door is Door.CLOSED for door in picture.doors.values())
