"""Modbus/TCP as a beginner would serve it: bytes in, bytes out, one table after the other."""

import struct
from collections.abc import Mapping

from tests.support.second_controllers.lift import Lift

NO_SUCH_FUNCTION, NO_SUCH_ADDRESS, NO_SUCH_VALUE, NO_SUCH_UNIT = 1, 2, 3, 11


class Refused(Exception):
    """The answer is an exception with this code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


class Device:
    """One device at one address. What it serves and what it does with a write is said by each controller."""

    unit = 1

    def __init__(self, lift: Lift) -> None:
        self.lift = lift
        self.now = 0.0

    def coils(self) -> Mapping[int, int] | None:
        """Contents by the address on the wire; None where there is no such table."""
        return None

    def discretes(self) -> Mapping[int, int] | None:
        return None

    def holdings(self) -> Mapping[int, int] | None:
        return None

    def inputs(self) -> Mapping[int, int] | None:
        return None

    def set_coil(self, address: int, *, on: bool) -> None:
        raise Refused(NO_SUCH_ADDRESS)

    def set_register(self, address: int, value: int) -> None:
        raise Refused(NO_SUCH_ADDRESS)

    def pulse_coil(self, address: int, value: int) -> None:
        """Function 5 with a value that is neither on nor off."""
        raise Refused(NO_SUCH_VALUE)

    def asked(self) -> dict[str, int]:
        """What its outputs ask of the lift: the number of the floor (0 the lowest) for a call, 1 for all else."""
        return {}

    def run_to(self, now: float) -> None:
        """Let time pass."""
        self.now = now
        self.lift.run_to(now, self.asked())

    def answer(self, frame: bytes, now: float) -> bytes | None:
        """Answer one frame; None where there is nothing to answer."""
        transaction, protocol, length, unit = struct.unpack(">HHHB", frame[:7])
        if protocol != 0 or length != len(frame) - 6:
            return None
        self.run_to(now)
        function = frame[7]
        if unit != self.unit:
            said = bytes([function + 128, NO_SUCH_UNIT])
        else:
            try:
                said = bytes([function]) + self._serve(function, frame[8:])
            except Refused as refused:
                said = bytes([function + 128, refused.code])
        self.run_to(now)
        return struct.pack(">HHHB", transaction, 0, len(said) + 1, unit) + said

    def _serve(self, function: int, data: bytes) -> bytes:
        first, number = struct.unpack(">HH", data[:4])
        if function == 1:
            return _bits(self.coils(), first, number)
        if function == 2:
            return _bits(self.discretes(), first, number)
        if function == 3:
            return _words(self.holdings(), first, number)
        if function == 4:
            return _words(self.inputs(), first, number)
        return self._write(function, data, first, number)

    def _write(self, function: int, data: bytes, first: int, number: int) -> bytes:
        if function == 5:
            self._one_coil(first, number)
        elif function == 6:
            _there(self.holdings(), first, 1)
            self.set_register(first, number)
        elif function == 15:
            _there(self.coils(), first, number)
            for place in range(number):
                self.set_coil(first + place, on=bool(data[5 + place // 8] & 1 << place % 8))
        elif function == 16:
            _there(self.holdings(), first, number)
            for place in range(number):
                self.set_register(first + place, data[5 + 2 * place] * 256 + data[6 + 2 * place])
        else:
            raise Refused(NO_SUCH_FUNCTION)
        return data[:4]

    def _one_coil(self, address: int, value: int) -> None:
        _there(self.coils(), address, 1)
        if value == 0xFF00:
            self.set_coil(address, on=True)
        elif value == 0x0000:
            self.set_coil(address, on=False)
        else:
            self.pulse_coil(address, value)


def _there(table: Mapping[int, int] | None, first: int, number: int) -> list[int]:
    if table is None:
        raise Refused(NO_SUCH_FUNCTION)
    if any(address not in table for address in range(first, first + number)):
        raise Refused(NO_SUCH_ADDRESS)
    return [table[address] for address in range(first, first + number)]


def _bits(table: Mapping[int, int] | None, first: int, number: int) -> bytes:
    found = _there(table, first, number)
    packed = [0] * ((number + 7) // 8)
    for place, bit in enumerate(found):
        if bit:
            packed[place // 8] += 2 ** (place % 8)
    return bytes([len(packed), *packed])


def _words(table: Mapping[int, int] | None, first: int, number: int) -> bytes:
    found = _there(table, first, number)
    return bytes([2 * number]) + struct.pack(f">{number}H", *found)
