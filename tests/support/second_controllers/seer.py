"""The generic lift of the SEER dispatcher (1.2): registers only, and a door command whose value is the time it is held for."""

from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift


class SeerGeneric(Device):
    """10 target floor, 11 open, 12 close (0 releases each); 20 floor, 21 door, 22 motion, 23 emergency. It answers 10 to 23."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.target, self.open, self.close = 0, 0, 0

    def holdings(self) -> dict[int, int]:
        shows = self.lift.shows
        registers = dict.fromkeys(range(10, 24), 0)
        registers[10], registers[11], registers[12] = self.target, self.open, self.close
        registers[20] = shows.floor + 1
        registers[21] = {"closed": 0, "opening": 1, "closing": 2, "open": 4}[shows.door]
        registers[22] = {"stopped": 0, "up": 1, "down": 2}[shows.motion]
        return registers

    def set_register(self, address: int, value: int) -> None:
        if address == 10:
            self.target = value
        elif address == 11:
            self.open = value
        elif address == 12:
            self.close = value

    def asked(self) -> dict[str, int]:
        found = {}
        if self.target:
            found["go_to"] = self.target - 1
        if self.open:
            found["hold_door.front"] = 1
        if self.close:
            found["close_door.front"] = 1
        return found
