"""A small robot that takes the lift over the workshop API: what it requests, what it trusts, and when it stops driving."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from enum import StrEnum
from threading import Event
from typing import Any, Protocol
from urllib.error import URLError
from urllib.parse import quote
from urllib.request import Request, urlopen

ANSWER_S = 2.0
"""The manager answers from memory, in milliseconds; one that does not is unreachable."""
REQUEST_AGAIN_S = 0.5
LOOK_S = 0.05
STEPS = 10
"""From the landing into the car, or out of it, in steps of ten centimetres."""
OPEN, CLOSED, STOPPED = 2, 0, 0
"""Numbers of door_state and motion_state in rmf_lift_msgs."""


class Ride(StrEnum):
    """How a ride ended."""

    ARRIVED = "arrived"
    GAVE_UP = "gave up"
    """The robot is where it was before, out of the doorway."""
    WAITS_ABOARD = "waits aboard"
    """It is in the car, and a person has to look."""


class Wheels(Protocol):
    """What moves the robot."""

    def forward(self) -> None:
        """Drive one step forward."""

    def back(self) -> None:
        """Drive one step back."""


class Lift:
    """One lift of a manager. A manager that does not answer counts as a refusal."""

    def __init__(self, url: str, name: str) -> None:
        self._url = url
        self._query = f"lift_name={quote(name)}"

    def request(self, floor: str, door: int) -> bool:
        """Request the car with its door held open, or release it; returns whether the request was accepted."""
        body = json.dumps({"floor": floor, "door_state": door}).encode()
        return bool(self._answer("lift_request", body).get("success"))

    def invites_at(self, floor: str) -> bool:
        """Whether a robot may drive: the car stands at this floor, and its door is open."""
        answer = self._answer("lift_state")
        if not answer.get("success"):
            return False
        state = answer["data"]
        shown = (state["current_floor"], state["door_state"], state["motion_state"])
        return bool(shown == (floor, OPEN, STOPPED))

    def _answer(self, route: str, body: bytes | None = None) -> dict[str, Any]:
        request = Request(f"{self._url}/{route}?{self._query}", body)  # noqa: S310 - the address is that of our manager
        try:
            with urlopen(request, timeout=ANSWER_S) as response:  # noqa: S310 - see above
                answer: dict[str, Any] = json.load(response)
                return answer
        except (URLError, OSError, ValueError):
            return {}


class Robot:
    """Rides lifts; `halt` makes it give up."""

    def __init__(self, wheels: Wheels, *, patience_s: float = 60.0, step_s: float = 0.2) -> None:
        self.halt = Event()
        self.patience_s = patience_s
        """How long it waits for a lift."""
        self._wheels = wheels
        self._step_s = step_s

    def ride(self, url: str, lift_name: str, start: str, goal: str) -> Ride:
        """Take the lift from one floor to another."""
        lift = Lift(url, lift_name)
        if not self._comes(lift, start) or not self._cross(lift, start):
            lift.request(start, CLOSED)
            return Ride.GAVE_UP
        if not self._comes(lift, goal) or not self._cross(lift, goal):
            return Ride.WAITS_ABOARD
        lift.request(goal, CLOSED)
        return Ride.ARRIVED

    def _comes(self, lift: Lift, floor: str) -> bool:
        """Request the car until it stands open at a floor, or until patience ends."""
        began_at, request_at = time.monotonic(), 0.0
        while time.monotonic() < began_at + self.patience_s and not self.halt.is_set():
            if time.monotonic() >= request_at:
                lift.request(floor, OPEN)
                request_at = time.monotonic() + REQUEST_AGAIN_S
            if lift.invites_at(floor):
                return True
            self.halt.wait(LOOK_S)
        return False

    def _cross(self, lift: Lift, floor: str) -> bool:
        """Drive through the doorway for as long as the lift invites; returns whether the robot is across.

        When it no longer does, the robot leaves the doorway by the nearer side.
        """
        for steps_taken in range(STEPS):
            if not lift.invites_at(floor):
                is_nearer_across = steps_taken > STEPS / 2
                for _ in range(STEPS - steps_taken if is_nearer_across else steps_taken):
                    self._step(self._wheels.forward if is_nearer_across else self._wheels.back)
                return is_nearer_across
            self._step(self._wheels.forward)
        return True

    def _step(self, drive: Callable[[], None]) -> None:
        drive()
        self.halt.wait(self._step_s)
