"""The two-stop goods lift of an AGV project (1.4): six inputs, and four coils that are written together."""

from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift


class TwoStopAgv(Device):
    """Inputs from 0: door open, door closed, at the lower floor, at the upper, AGV mode, error. Coils 0 to 3."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.outputs = [0, 0, 0, 0]

    def coils(self) -> dict[int, int]:
        return dict(enumerate(self.outputs))

    def discretes(self) -> dict[int, int]:
        shows = self.lift.shows
        return {
            0: int(shows.door == "open"),
            1: int(shows.door == "closed"),
            2: int(shows.at_floor and shows.floor == 0),
            3: int(shows.at_floor and shows.floor == 1),
            4: int(shows.robot_mode),
            5: 0,
        }

    def set_coil(self, address: int, *, on: bool) -> None:
        self.outputs[address] = int(on)

    def asked(self) -> dict[str, int]:
        lower, upper, hold, close = self.outputs
        found = {}
        if lower + upper == 1:
            found["go_to"] = upper
        if hold:
            found["hold_door.front"] = 1
        if close:
            found["close_door.front"] = 1
        return found
