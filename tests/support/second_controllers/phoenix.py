"""A hospital lift on a Phoenix Contact "IL ETH" block (1.6): bits in registers, eight outputs spread over two of them."""

from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift


class PhoenixBlock(Device):
    """Register 0: bits 0 to 2 the floor, bit 4 the closed door. 384: bits 0 to 2 call. 385: bit 0 opens, bit 3 takes control."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.first, self.second = 0, 0

    def holdings(self) -> dict[int, int]:
        shows = self.lift.shows
        word = 0
        if shows.at_floor:
            word += (1, 2, 4)[shows.floor]
        if shows.door == "closed":
            word += 16
        return {0: word, 384: self.first, 385: self.second}

    def set_register(self, address: int, value: int) -> None:
        if address == 384:
            self.first = value
        elif address == 385:
            self.second = value

    def asked(self) -> dict[str, int]:
        found = {}
        if self.first in (1, 2, 4):
            found["go_to"] = (1, 2, 4).index(self.first)
        if self.second & 1:
            found["hold_door.front"] = 1
        if self.second & 8:
            found["robot_mode"] = 1
        return found
