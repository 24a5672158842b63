"""Explains exception answers: names the signals they are about, with addresses as printed."""

from __future__ import annotations

import logging

from drivers.errors import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ControllerException, PointsRefused, UnitOffline
from drivers.modbus.units import Units
from drivers.model import LiftValues
from register_maps.codec import Block, Cell, Codec, Point
from register_maps.words import BIT_TABLES

_log = logging.getLogger(__name__)


_CURE = "compare table and address with the manual, and how it counts with `addressing` of the map"


class Diagnosis:
    """Finds the cause of refused polls once, and reports each unlisted value once."""

    def __init__(self, codec: Codec, units: Units, name: str) -> None:
        """`name` of the lift begins every message."""
        self._codec = codec
        self._units = units
        self._name = name
        self._refused: dict[Block, str] = {}
        self._reported: tuple[tuple[str, int], ...] = ()

    async def explain(self, error: ControllerException, block: Block) -> ControllerException:
        """Return the error of a poll with the signals it is about; if addresses are not served, find out which."""
        if isinstance(error, UnitOffline):
            return error
        if error.code == ILLEGAL_FUNCTION:
            text = f"the controller does not answer for this table, which holds {names_of_signals(self._codec, block)}; {_CURE}"
            return PointsRefused(error, text)
        if error.code != ILLEGAL_ADDRESS:
            return PointsRefused(error, f"this block holds {names_of_signals(self._codec, block)}")
        if block not in self._refused:
            self._refused[block] = await self._find_refused(block)
        return PointsRefused(error, self._refused[block])

    def forget(self) -> None:
        """Forget the results: the controller or its program may have been replaced."""
        self._refused.clear()

    def report_unlisted(self, values: LiftValues) -> None:
        """Log each value outside its table once, however often it is read."""
        for signal, raw in values.unknown.items():
            if (signal, raw) not in self._reported:
                self._reported += ((signal, raw),)
                where = ", ".join(_addresses(self._codec, signal))
                message = "%s: %s (%s) reads %d, which the map and the site do not list; it counts as unknown"
                _log.warning(message, self._name, signal, where, raw)

    async def _find_refused(self, block: Block) -> str:
        """Read each address of a refused block by itself and describe those that the device does not serve."""
        codec = self._codec
        refused: list[str] = []
        first: dict[Cell, tuple[str, Point]] = {}
        for name, point in named_points(codec, block):
            first.setdefault(point.cell, (name, point))
        for name, point in first.values():
            one = Block(point.table, point.address, 1, point.endpoint)
            try:
                await self._units.link(one.endpoint).read(self._units.request(one))
            except ControllerException as error:
                if error.code != ILLEGAL_ADDRESS:
                    raise
                refused.append(f"{name} ({_printed(codec, name, point)})")
        if refused:
            return (
                f"the controller serves less than map {codec.map.name} says: it refuses {', '.join(refused)}; {_CURE}"
            )
        size = f"{block.count} {'bits' if block.table in BIT_TABLES else 'registers'}"
        return (
            f"the controller serves each signal of this block by itself, but not {size} from {block.start} in one request; "
            f"lower max_registers_per_read or max_bits_per_read, or split `served: {block.table}` of map {codec.map.name}"
        )


def named_points(codec: Codec, block: Block) -> list[tuple[str, Point]]:
    """Return the points in a block with the signals, or else the commands, they are read for; lowest address first."""
    from_signals = [
        (name, point) for name, signal in codec.signals.items() for point in signal.points if block.holds(point)
    ]
    from_commands = [
        (name, point) for name, part in codec.commands.items() for point in part.read_points if block.holds(point)
    ]
    found = from_signals or from_commands
    return sorted(found, key=lambda item: (item[1].address, item[1].low))


def names_of_signals(codec: Codec, block: Block) -> str:
    """Return the names of the signals in a block, with their printed addresses."""
    names = dict.fromkeys(name for name, _ in named_points(codec, block))
    names_with_addresses = [f"{name} at {', '.join(_addresses(codec, name))}" for name in names]
    return "; ".join(names_with_addresses[:4]) + ("; ..." if len(names_with_addresses) > 4 else "")


def _printed(codec: Codec, name: str, point: Point) -> str:
    """Return the address of a point as its map prints it."""
    for text in _addresses(codec, name):
        place = codec.map.place(text)
        if (place.table, place.number + codec.offset.get(place.table, 0)) == (point.table, point.address):
            return text
    return f"{point.table} {point.address} on the wire"


def _addresses(codec: Codec, name: str) -> tuple[str, ...]:
    source = codec.map
    if name in source.signals:
        return source.signals[name].addresses
    command = source.commands[name]
    return tuple(text for _, text in command.keyed_read_addresses) or command.addresses
