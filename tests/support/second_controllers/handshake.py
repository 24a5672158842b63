"""The robot handshake of the "Siemens Chengdu" lift (1.1), and the same in one block of registers (its second version)."""

from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift


class _Handshake(Device):
    """Four outputs: call the empty car, take the occupied one, robot in place, robot left. 0 is no command."""

    unit = 0

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.call, self.go, self.in_place, self.left = 0, 0, 0, 0

    def asked(self) -> dict[str, int]:
        found = {}
        if self.call:
            found["call"] = self.call - 1
        if self.go:
            found["go"] = self.go - 1
        if self.in_place == 1:
            found["robot_in_place"] = 1
        if self.left == 1:
            found["robot_left"] = 1
        return found


class Chengdu(_Handshake):
    """4x0001, 4x0002, 0x0001, 0x0002 take; 1x0001 to 1x0003 and 3x0001 say. The numbers go on the wire as they are printed."""

    def holdings(self) -> dict[int, int]:
        return {1: self.call, 2: self.go}

    def coils(self) -> dict[int, int]:
        return {1: self.in_place, 2: self.left}

    def discretes(self) -> dict[int, int]:
        shows = self.lift.shows
        return {1: int(shows.may_enter), 2: int(shows.may_leave), 3: int(shows.door == "open")}

    def inputs(self) -> dict[int, int]:
        return {1: self.lift.shows.floor + 1}

    def set_register(self, address: int, value: int) -> None:
        if address == 1:
            self.call = value
        else:
            self.go = value

    def set_coil(self, address: int, *, on: bool) -> None:
        if address == 1:
            self.in_place = int(on)
        else:
            self.left = int(on)


class ChengduBlock(_Handshake):
    """From register 100: call, go, in place, left, may enter, may leave, door, floor."""

    def holdings(self) -> dict[int, int]:
        shows = self.lift.shows
        said = (int(shows.may_enter), int(shows.may_leave), int(shows.door == "open"), shows.floor + 1)
        return dict(enumerate((self.call, self.go, self.in_place, self.left, *said), start=100))

    def set_register(self, address: int, value: int) -> None:
        if address == 100:
            self.call = value
        elif address == 101:
            self.go = value
        elif address == 102:
            self.in_place = value
        elif address == 103:
            self.left = value
