"""The generic controllers that two managers share: each write is one block with owner and epoch (this project's own layout)."""

from tests.support.second_controllers.buttons import GenericCoils
from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift
from tests.support.second_controllers.registers import GenericRegisters

FALLS_S = 8.0
CLUSTER_COILS = 51


class Obeyed:
    """Whose writes are obeyed: those of the highest epoch, and of one machine in it."""

    def __init__(self) -> None:
        self.epoch = 0
        self.owner = 0

    def obeys(self, epoch: int, owner: int) -> bool:
        """Whether a write is obeyed; if it is, whatever is older is not from now on."""
        if epoch < self.epoch or epoch == 0 or (epoch == self.epoch and owner != self.owner):
            return False
        self.epoch, self.owner = epoch, owner
        return True


class GenericRegistersCluster(Device):
    """Registers 0 to 7 say, 8 and 9 are the epoch, 10 the owner; 16 to 22 take, in one function 16."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.obeyed = Obeyed()
        self.shown = GenericRegisters(lift)
        self.given = [0, 0, 0, 0]
        """Call, hold, robot mode, close."""
        self.at = -FALLS_S

    def holdings(self) -> dict[int, int]:
        says = {address: value for address, value in self.shown.holdings().items() if address < 8}
        says |= {8: self.obeyed.epoch // 65536, 9: self.obeyed.epoch % 65536, 10: self.obeyed.owner}
        return says | {16: 0, 17: 0, 18: 0} | dict(zip(range(19, 23), self.given, strict=True))

    def _write(self, function: int, data: bytes, first: int, number: int) -> bytes:
        if (function, first, number) == (16, 16, 7):
            words = [data[place] * 256 + data[place + 1] for place in range(5, 19, 2)]
            if self.obeyed.obeys(words[1] * 65536 + words[2], words[0]):
                self.given, self.at = words[3:], self.now
            return data[:4]
        return super()._write(function, data, first, number)

    def set_register(self, address: int, value: int) -> None:
        """Whose write this is, is not known: it is not obeyed."""

    def asked(self) -> dict[str, int]:
        call, hold, robot, close = self.given
        found = {"go_to": call - 1} if call else {}
        if hold and self.now < self.at + FALLS_S:
            found["hold_door.front"] = 1
        if robot and self.now < self.at + FALLS_S:
            found["robot_mode"] = 1
        if close:
            found["close_door.front"] = 1
        return found


class GenericCoilsCluster(GenericCoils):
    """The coils of the other one, then 8 for the owner and 32 for the epoch, in one function 15; 40 more inputs say whose it is."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.obeyed = Obeyed()
        self.at = -FALLS_S

    def coils(self) -> dict[int, int]:
        return {**dict.fromkeys(range(CLUSTER_COILS), 0), **super().coils()}

    def discretes(self) -> dict[int, int]:
        shown = super().discretes()
        shown |= {30 + bit: self.obeyed.epoch >> bit & 1 for bit in range(32)}
        return shown | {62 + bit: self.obeyed.owner >> bit & 1 for bit in range(8)}

    def _write(self, function: int, data: bytes, first: int, number: int) -> bytes:
        if (function, first, number) == (15, 0, CLUSTER_COILS):
            bits = [data[5 + place // 8] >> place % 8 & 1 for place in range(number)]
            owner = sum(bit << place for place, bit in enumerate(bits[11:19]))
            if self.obeyed.obeys(sum(bit << place for place, bit in enumerate(bits[19:])), owner):
                self.outputs, self.at = bits[:11], self.now
            return data[:4]
        return super()._write(function, data, first, number)

    def set_coil(self, address: int, *, on: bool) -> None:
        """Whose write this is, is not known: it is not obeyed."""

    def asked(self) -> dict[str, int]:
        self.hold_at = self.robot_at = self.now if self.now < self.at + FALLS_S else -FALLS_S
        return super().asked()
