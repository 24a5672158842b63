"""What people and faults do to one simulated lift: the same for the pytest fixtures and for the panel."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum, unique
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.model import FloorName
from lift_manager.lab.bench.errors import BenchError
from lift_manager.lab.bench.naming import mistakes_of
from register_maps.error_texts import closest
from register_maps.words import Side
from simulator.faults import Fault
from simulator.modes import Key
from simulator.registers import RegisterFace
from simulator.state import Inputs

_FINGER_SCANS = 3
"""For how many scans a person presses a button. Chosen: no scan can miss it."""


@unique
class Button(StrEnum):
    """Where a button for a floor is."""

    LANDING = "landing"
    CAR = "car"


class InputChanges(BaseModel):
    """What people press, hold and turn from now on. What is not given stays as it is; floors are names."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    car_buttons: frozenset[FloorName] | None = Field(
        None, description="floors whose button in the car is kept pressed, such as a button that is stuck"
    )
    landing_buttons: frozenset[FloorName] | None = Field(
        None, description="floors whose landing button is kept pressed, such as a button that is stuck"
    )
    hold_door: frozenset[Side] | None = Field(None, description="doors whose open button is kept pressed")
    close_door: frozenset[Side] | None = Field(None, description="doors whose close button is kept pressed")
    obstruction: frozenset[Side] | None = Field(None, description="doors in whose light curtain somebody stands")
    robot_mode_request: bool | None = Field(None, description="whether robot mode is requested by a contact")
    key: Key | None = Field(None, description="position of the key switch")
    fire: bool | None = Field(None, description="the fire alarm of the building")
    emergency: bool | None = Field(None, description="whether the lift runs on emergency power")
    overload: bool | None = Field(None, description="too much load in the car")
    fault: bool | None = Field(None, description="whether the lift has failed, and is out of service")
    robots_allowed: bool | None = Field(None, description="the key switch that permits robots")


def input_changes(given: Mapping[str, object]) -> InputChanges:
    """Read changes that are named in a test. Raises BenchError."""
    for name in given:
        if name not in InputChanges.model_fields:
            known = ", ".join(InputChanges.model_fields)
            raise BenchError(
                f"a lift has no input {name!r}{closest(name, InputChanges.model_fields)}; there is {known}"
            )
    try:
        return InputChanges.model_validate(given)
    except ValidationError as error:
        raise BenchError(f"inputs: {mistakes_of(error)}") from error


class Controls:
    """Changes the inputs and faults of one lift; call its methods on the loop of the lift.

    What cannot be raises BenchError.
    """

    def __init__(
        self, name: str, face: RegisterFace, floors: Sequence[FloorName], look: Callable[[], object] = lambda: None
    ) -> None:
        """`look` is called after each change."""
        self._name = name
        self._face = face
        self._floors = tuple(floors)
        self._sides = frozenset().union(*face.parameters.doors_at)
        self._look = look
        self._at_rest = self._held = face.inputs
        self._fingers: dict[tuple[Button, int], asyncio.TimerHandle] = {}
        """Buttons that are pressed for a moment, and when each is released."""

    @property
    def held(self) -> InputChanges:
        """What people press, hold and turn, but for a button that is pressed for a moment."""
        given: dict[str, Any] = {name: getattr(self._held, name) for name in InputChanges.model_fields}
        for buttons in ("car_buttons", "landing_buttons"):
            given[buttons] = frozenset(self._floors[index] for index in given[buttons])
        return InputChanges(**given)

    def set_inputs(self, changes: InputChanges) -> None:
        """Change what people press, hold and turn."""
        given = {name: value for name, value in changes if value is not None}
        for buttons in ("car_buttons", "landing_buttons"):
            if buttons in given:
                given[buttons] = frozenset(map(self._index, given[buttons]))
        for doors in ("hold_door", "close_door", "obstruction"):
            if missing := given.get(doors, frozenset()) - self._sides:
                raise BenchError(f"{self._name}: no {min(missing)} door; there is {', '.join(sorted(self._sides))}")
        self._held = replace(self._held, **given)
        self._apply()

    def press(self, button: Button, floor: FloorName) -> None:
        """Press a button for some scans."""
        pressed = button, self._index(floor)
        if (earlier := self._fingers.pop(pressed, None)) is not None:
            earlier.cancel()

        def release() -> None:
            del self._fingers[pressed]
            self._apply()

        held_s = _FINGER_SCANS * self._face.parameters.scan_s
        self._fingers[pressed] = asyncio.get_running_loop().call_later(held_s, release)
        self._apply()

    def begin(self, fault: Fault) -> None:
        """Begin a fault. Raises BenchError for one that this map cannot have."""
        try:
            self._face.begin(fault, _now())
        except ValueError as error:
            raise BenchError(f"{self._name}: {error}") from error
        self._look()

    def end(self, fault: Fault) -> None:
        """End a fault. Raises BenchError if it has not begun."""
        if fault not in self._face.faults:
            present = ", ".join(map(repr, self._face.faults)) or "none"
            raise BenchError(f"{self._name}: {fault!r} has not begun, or has ended; present: {present}")
        self._face.end(fault, _now())
        self._look()

    def reset(self) -> None:
        """End every fault and release everything; the key returns to where it was at the start."""
        for fault in self._face.faults:
            self._face.end(fault, _now())
        self.close()
        self._held = self._at_rest
        self._apply()

    def close(self) -> None:
        """Forget the buttons that are still to be released."""
        for timer in self._fingers.values():
            timer.cancel()
        self._fingers.clear()

    def _index(self, floor: FloorName) -> int:
        if floor not in self._floors:
            raise BenchError(f"{self._name}: no floor {floor!r}; there is {', '.join(self._floors)}")
        return self._floors.index(floor)

    def _apply(self) -> None:
        self._face.people(_now(), self._with_fingers())
        self._look()

    def _with_fingers(self) -> Inputs:
        def pressed(button: Button) -> frozenset[int]:
            return frozenset(index for where, index in self._fingers if where is button)

        return replace(
            self._held,
            car_buttons=self._held.car_buttons | pressed(Button.CAR),
            landing_buttons=self._held.landing_buttons | pressed(Button.LANDING),
        )


def _now() -> float:
    return asyncio.get_running_loop().time()
