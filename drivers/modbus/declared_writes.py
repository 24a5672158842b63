"""Knows which writes a map declares; guards every write that is sent. Pure."""

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
    """A write that no command of a loaded map declares: a bug of ours, not a fault of the controller.

    Not a DriverError, so fault handling cannot swallow it. Nothing of the write was sent.
    """

    def __init__(self, link: str, request: Request) -> None:
        super().__init__(
            f"{link}: {request}: not sent: no command of the loaded map is written like that; this is a bug in the program:"
            " report it with this line, and see with `lift-manager maps plan` what this map writes"
        )
        self.request = request


class DeclaredWrites:
    """The writes that the commands of maps consist of, as whole shapes: neither a longer block nor another function passes."""

    def __init__(self) -> None:
        """Allow nothing."""
        self._bits: dict[Shape, int] = {}
        """The bits of each shape that function 22 may change; not used with other functions."""

    def add(self, commands: Iterable[CommandCodec], units: Mapping[str, int]) -> None:
        """Allow the writes of these commands to the endpoints on this link; `units` has their unit ids."""
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
        """Whether a write has the shape of a declared one. Function 22 must keep all but declared bits."""
        shape = (request.unit, request.function, request.address, request.count, request.duration)
        bits = self._bits.get(shape)
        if bits is None:
            return False
        if request.function != MASK_WRITE:
            return True
        keep, put = request.values
        return not (~keep | put) & 0xFFFF & ~bits
