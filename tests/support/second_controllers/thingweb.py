"""The elevator demo of Eclipse Thingweb (1.11): 10001 and 40001 go on the wire as they are, and nothing has a door."""

from collections.abc import Mapping
from dataclasses import replace

from tests.support.second_controllers.device import NO_SUCH_VALUE, Device, Refused
from tests.support.second_controllers.lift import Lift, Shows

MOVES_S = 5.0
LOWEST = 1
"""Number of the lowest floor that is used."""


class DemoCar:
    """A number that changes at once, and a flag that says for 5 s that it moves. Calls while it moves change the number only."""

    def __init__(self) -> None:
        self.shows = Shows(floor=1)
        self._until = 0.0
        self._asked: dict[str, int] = {}

    def run_to(self, now: float, asked: Mapping[str, int] | None = None) -> None:
        if asked and asked != self._asked:
            if now >= self._until:
                self._until = now + MOVES_S
            self.shows = replace(self.shows, floor=asked["go_to"])
            self._asked = dict(asked)
        moves = now < self._until
        self.shows = replace(self.shows, motion="up" if moves else "stopped", level=not moves)


class Thingweb(Device):
    """Discrete 10001: it moves. Holding 40001 and 40002: the floor, 0 to 15, as the sum of both."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.written: int | None = None
        self.looked_at: list[float] = []
        """When its flag was read: it has no value for whoever comes sooner than 1 s after the last."""

    def discretes(self) -> dict[int, int]:
        self.looked_at.append(self.now)
        return {10001: int(self.lift.shows.motion != "stopped")}

    def holdings(self) -> dict[int, int]:
        return {40001: 0, 40002: self.lift.shows.floor + LOWEST}

    def set_register(self, address: int, value: int) -> None:
        if address != 40002 or value > 15:
            raise Refused(NO_SUCH_VALUE)
        self.written = value

    def asked(self) -> dict[str, int]:
        return {} if self.written is None else {"go_to": self.written - LOWEST}
