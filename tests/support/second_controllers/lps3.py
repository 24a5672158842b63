"""The "LPS3" two-stop goods lift on an I/O module (1.3): a bit that is the floor and its open door in one."""

from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift


class Lps3(Device):
    """Coil 17 calls to floor 1, 19 to floor 2, 18 is on while the car is occupied; inputs 1 and 3 are the open door there."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.out1, self.out2, self.out3 = 0, 0, 0

    def coils(self) -> dict[int, int]:
        return {17: self.out1, 18: self.out2, 19: self.out3}

    def discretes(self) -> dict[int, int]:
        at = self.lift.shows.open_at
        return {1: int(at == 0), 2: 0, 3: int(at == 1)}

    def set_coil(self, address: int, *, on: bool) -> None:
        if address == 17:
            self.out1 = int(on)
        elif address == 18:
            self.out2 = int(on)
        else:
            self.out3 = int(on)

    def asked(self) -> dict[str, int]:
        found = {}
        if self.out1 and not self.out3:
            found["call"] = 0
        if self.out3 and not self.out1:
            found["call"] = 1
        if self.out2:
            found["robot_in_place"] = 1
        return found
