"""I/O modules that press the buttons of a two-stop lift (section 2): outputs 0 and 1 call, output 2 opens the door."""

from tests.support.second_controllers.device import NO_SUCH_ADDRESS, NO_SUCH_VALUE, Device, Refused
from tests.support.second_controllers.lift import Lift


class _Module(Device):
    """So many outputs."""

    count = 8

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.outputs = [0] * self.count

    def coils(self) -> dict[int, int]:
        return dict(enumerate(self.outputs))

    def set_coil(self, address: int, *, on: bool) -> None:
        self.outputs[address] = int(on)

    def asked(self) -> dict[str, int]:
        found = {}
        if self.outputs[0] + self.outputs[1] == 1:
            found["go_to"] = self.outputs[1]
        if self.outputs[2]:
            found["hold_door.front"] = 1
        return found

    def wired(self) -> list[int]:
        """Inputs: door open, door closed, car at the lower stop, at the upper stop, a contact that opens in a fire."""
        shows = self.lift.shows
        lower = int(shows.at_floor and shows.floor == 0)
        upper = int(shows.at_floor and shows.floor == 1)
        return [int(shows.door == "open"), int(shows.door == "closed"), lower, upper, 1]


class MoxaE1211(_Module):
    """Outputs at coils 0 to 15, the flag of the watchdog's alarm at coil 4144; no inputs."""

    count = 16

    def coils(self) -> dict[int, int]:
        return {**dict(enumerate(self.outputs)), 4144: 0}

    def set_coil(self, address: int, *, on: bool) -> None:
        if address == 4144:
            raise Refused(NO_SUCH_ADDRESS)
        super().set_coil(address, on=on)


class MoxaE1212(_Module):
    """Eight outputs at coils from 0, eight inputs from 0."""

    def discretes(self) -> dict[int, int]:
        return dict(enumerate([*self.wired(), 0, 0, 0]))


class MoxaE1214(_Module):
    """Six relays at coils from 0, six inputs from 0."""

    count = 6

    def discretes(self) -> dict[int, int]:
        return dict(enumerate([*self.wired(), 0]))


class AdamIo(_Module):
    """0X 00001 up are six inputs and 0X 00017 up six outputs, counted from 1, all of them read by function 1."""

    count = 6

    def coils(self) -> dict[int, int]:
        inputs = dict(enumerate([*self.wired(), 0]))
        return {**inputs, **{16 + number: bit for number, bit in enumerate(self.outputs)}}

    def set_coil(self, address: int, *, on: bool) -> None:
        if address < 16:
            raise Refused(NO_SUCH_ADDRESS)
        self.outputs[address - 16] = int(on)


class Wago750(_Module):
    """Reading bits 0 to 0x1FF shows inputs, writing them sets outputs, which are read back from 0x200 on."""

    count = 512

    def _inputs(self) -> list[int]:
        wired = self.wired()
        return wired + [0] * (512 - len(wired))

    def discretes(self) -> dict[int, int]:
        return dict(enumerate(self._inputs()))

    def coils(self) -> dict[int, int]:
        return dict(enumerate(self._inputs() + self.outputs))

    def holdings(self) -> dict[int, int]:
        return dict.fromkeys(range(0x1000, 0x100C), 0)  # the watchdog is off: time 0, state 0

    def set_coil(self, address: int, *, on: bool) -> None:
        self.outputs[address % 512] = int(on)


class WaveshareRelay(_Module):
    """Relays are coils 0 to 7. Function 5 at 0x200 + relay takes a time in units of 100 ms, and the module ends it."""

    def __init__(self, lift: Lift) -> None:
        super().__init__(lift)
        self.until = [0.0] * 8

    def coils(self) -> dict[int, int]:
        relays = dict(enumerate(self.outputs))
        return {**relays, **{0x200 + relay: int(self.now < until) for relay, until in enumerate(self.until)}}

    def set_coil(self, address: int, *, on: bool) -> None:
        if address >= 0x200:
            raise Refused(NO_SUCH_VALUE)
        self.outputs[address] = int(on)

    def pulse_coil(self, address: int, value: int) -> None:
        if address < 0x200 or value > 0x7FFF:
            raise Refused(NO_SUCH_VALUE)
        self.until[address - 0x200] = self.now + value / 10

    def asked(self) -> dict[str, int]:
        found = super().asked()
        pulsed = [relay for relay in (0, 1) if self.now < self.until[relay]]
        if len(pulsed) == 1:
            found["go_to"] = pulsed[0]
        return found
