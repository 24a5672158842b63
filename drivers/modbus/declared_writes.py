"""Which writes a map declares: the guard behind every write that leaves. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import reduce
from operator import or_

from register_maps.codec import CommandCodec
from register_maps.command_codec import payload_counts
from register_maps.frames import MASK_WRITE, Request

Shape = tuple[int, int, int, int, int | None]
"""Unit, function, address on the wire, count, and the duration of a coil pulse that the device times."""


class UndeclaredWrite(RuntimeError):
    """A write to an address that no command of a loaded map has: a bug of ours, not a fault of the controller.

    No DriverError, so nothing that deals with faults can pass over it. Nothing of the write has left.
    """

    def __init__(self, link: str, request: Request) -> None:
        super().__init__(
            f"{link}: {request}: not sent: no command of the loaded map is written like that; this is a bug in the program:"
            " report it with this line, and see with `lift-manager maps plan` what this map writes"
        )
        self.request = request


class DeclaredWrites:
    """The writes that commands of maps consist of: whole shapes, so neither a longer block nor another function passes."""

    def __init__(self) -> None:
        """Nothing may be written."""
        self._bits: dict[Shape, int] = {}
        """Per shape the bits that function 22 may change; with every other function they are of no account."""

    def add(self, commands: Iterable[CommandCodec], units: Mapping[str, int]) -> None:
        """Allow what writes these commands; `units` gives the unit id of each endpoint on this link, and no others count."""
        for command in commands:
            for block, function in zip(command.blocks, command.functions, strict=True):
                unit = units.get(block.endpoint)
                if unit is None:
                    continue
                duration = payload_counts(command.spec) if command.is_timed_coil else None
                shape = (unit, function, block.start, block.count, duration)
                bits = [point.mask << point.low for point in command.points if block.holds(point)]
                self._bits[shape] = reduce(or_, bits, self._bits.get(shape, 0))

    def allows(self, request: Request) -> bool:
        """Whether a write has the shape of a declared one. What function 22 keeps must be everything but declared bits."""
        shape = (request.unit, request.function, request.address, request.count, request.duration)
        bits = self._bits.get(shape)
        if bits is None:
            return False
        if request.function != MASK_WRITE:
            return True
        keep, put = request.values
        return not (~keep | put) & 0xFFFF & ~bits
