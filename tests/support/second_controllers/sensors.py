"""Second devices: inputs for lifts whose own controller only presses buttons."""

from tests.support.second_controllers.device import Device


class _Inputs(Device):
    """A device without outputs: it asks nothing, and takes nothing back."""

    unit = 2

    def run_to(self, now: float) -> None:
        self.now = now
        self.lift.run_to(now)


class DoorContactAndFloors(_Inputs):
    """Unit 2. Input 0 is on while the door is NOT open (inverted, as the door sensor of 1.5), inputs 1 to 3 are the floors."""

    def discretes(self) -> dict[int, int]:
        shows = self.lift.shows
        bits = {0: int(shows.door != "open"), 1: 0, 2: 0, 3: 0}
        if shows.at_floor:
            bits[1 + shows.floor] = 1
        return bits


class LimitsAndTwoFloors(_Inputs):
    """Unit 2. Inputs: door open, door closed, car at the lower stop, car at the upper stop."""

    def discretes(self) -> dict[int, int]:
        shows = self.lift.shows
        lower = int(shows.at_floor and shows.floor == 0)
        upper = int(shows.at_floor and shows.floor == 1)
        return {0: int(shows.door == "open"), 1: int(shows.door == "closed"), 2: lower, 3: upper}


class OpenContact(_Inputs):
    """Unit 2. Input 0 is on while the door is fully open."""

    def discretes(self) -> dict[int, int]:
        return {0: int(self.lift.shows.door == "open")}
