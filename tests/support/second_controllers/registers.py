"""The generic registers: pulses of a call, holds that fall 3 s after their last write, a counter (this project's own layout)."""

from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift

FALLS_S = 3.0


class GenericRegisters(Device):
    """Registers 0 to 7 say, 16 to 19 take. Floors are coded from 1, and 0 is none."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.call, self.hold, self.robot, self.close = 0, 0, 0, 0
        self.hold_at, self.robot_at = 0.0, 0.0

    def holdings(self) -> dict[int, int]:
        shows = self.lift.shows
        status = 1  # no fire recall
        status += 2 if shows.robot_mode else 0
        status += 4 if shows.level else 0
        return {
            0: shows.beat,
            1: shows.floor + 1,
            2: {"stopped": 1, "up": 2, "down": 3}[shows.motion],
            3: {"closed": 1, "opening": 2, "open": 3, "closing": 4}[shows.door],
            4: 2 if shows.robot_mode else 1,
            5: status,
            6: 0 if shows.destination is None else shows.destination + 1,
            7: 0 if shows.accepted is None else shows.accepted + 1,
            16: self.call,
            17: self.hold,
            18: self.robot,
            19: self.close,
        }

    def set_register(self, address: int, value: int) -> None:
        if address == 16:
            self.call = value
        elif address == 17:
            self.hold, self.hold_at = value, self.now
        elif address == 18:
            self.robot, self.robot_at = value, self.now
        elif address == 19:
            self.close = value

    def asked(self) -> dict[str, int]:
        found = {}
        if self.call > 0:
            found["go_to"] = self.call - 1
        if self.hold == 1 and self.now < self.hold_at + FALLS_S:
            found["hold_door.front"] = 1
        if self.robot == 1 and self.now < self.robot_at + FALLS_S:
            found["robot_mode"] = 1
        if self.close == 1:
            found["close_door.front"] = 1
        return found
