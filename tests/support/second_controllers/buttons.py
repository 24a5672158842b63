"""One coil per button: the generic bits, and an Advantech ADAM that presses the buttons of a three-stop lift (1.5)."""

from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift

FALLS_S = 3.0


class GenericCoils(Device):
    """Coils 0 to 7 call, 8 holds the door, 9 closes it, 10 asks for robot mode; 30 inputs say (this project's own layout)."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.outputs = [0] * 11
        self.hold_at, self.robot_at = 0.0, 0.0

    def coils(self) -> dict[int, int]:
        return dict(enumerate(self.outputs))

    def discretes(self) -> dict[int, int]:
        shows = self.lift.shows
        bits = dict.fromkeys(range(30), 0)
        if shows.at_floor:
            bits[shows.floor] = 1
        if shows.accepted is not None:
            bits[8 + shows.accepted] = 1
        bits[16] = int(shows.door == "open")
        bits[17] = int(shows.door == "closed")
        bits[18] = int(shows.level)
        bits[19] = int(shows.motion == "up")
        bits[20] = int(shows.motion == "down")
        bits[23] = int(shows.robot_mode)
        for all_is_well in (24, 25, 26, 27, 28, 29):
            bits[all_is_well] = 1
        return bits

    def set_coil(self, address: int, *, on: bool) -> None:
        self.outputs[address] = int(on)
        if address == 8:
            self.hold_at = self.now
        if address == 10:
            self.robot_at = self.now

    def asked(self) -> dict[str, int]:
        found = {}
        pressed = [floor for floor in range(8) if self.outputs[floor]]
        if len(pressed) == 1:
            found["go_to"] = pressed[0]
        if self.outputs[8] and self.now < self.hold_at + FALLS_S:
            found["hold_door.front"] = 1
        if self.outputs[9]:
            found["close_door.front"] = 1
        if self.outputs[10] and self.now < self.robot_at + FALLS_S:
            found["robot_mode"] = 1
        return found


class AdamPushButtons(Device):
    """PDU 16, 17, 18 are the buttons of the floors, 19 opens the door, 20 closes it; there is nothing to read but these."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.outputs = {16: 0, 17: 0, 18: 0, 19: 0, 20: 0}

    def coils(self) -> dict[int, int]:
        return self.outputs

    def set_coil(self, address: int, *, on: bool) -> None:
        self.outputs[address] = int(on)

    def asked(self) -> dict[str, int]:
        found = {}
        pressed = [floor for floor, address in enumerate((16, 17, 18)) if self.outputs[address]]
        if len(pressed) == 1:
            found["go_to"] = pressed[0]
        if self.outputs[19]:
            found["hold_door.front"] = 1
        if self.outputs[20]:
            found["close_door.front"] = 1
        return found
