"""Every signal of one lift as last read, for people who inspect the wiring. Computed on request only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.model import FloorName, SignalValue
from register_maps.codec import Block, Codec, Point, Reader, SignalCodec, Value
from register_maps.schema import Kind
from register_maps.words import BIT_TABLES


class Signals:
    """The signals of a lift, with their addresses and the blocks they are read with."""

    def __init__(
        self,
        codec: Codec,
        blocks: Sequence[Block],
        floors: Mapping[int, FloorName],
        *,
        watchdog_unit_s: float,
    ) -> None:
        """`blocks` are those of a poll, in its order; `floors` are floor names by code, lowest floor first."""
        self._signals = tuple(
            (one, _printed(codec, one), _on_wire(codec, one), _blocks(one, blocks)) for one in codec.signals.values()
        )
        self._floors = floors
        self._watchdog_unit_s = watchdog_unit_s

    def values_at(self, reader: Reader, requested_at: Sequence[float], now: float) -> tuple[SignalValue, ...]:
        """Return all signals; `requested_at` is when each block of the newest poll was requested, empty before the first."""
        raw = reader.raw() if requested_at else {}
        return tuple(
            SignalValue(
                name=signal.name,
                value=self._value(signal, reader.values.get(signal.name)) if raw else None,
                raw=raw.get(signal.name),
                addresses=printed,
                age_s=now - min(requested_at[index] for index in indexes) if raw else None,
                wire=wire,
            )
            for signal, printed, wire, indexes in self._signals
        )

    def _value(self, signal: SignalCodec, value: Value) -> str | bool | float | None:
        """Return a value for people: floors by their site names, separated by commas, and times in seconds.

        A floor code that the site does not list is None, as is every raw value outside its table.
        """
        if isinstance(value, frozenset):
            return ", ".join(name for code, name in self._floors.items() if code in value)
        if value is None or isinstance(value, bool | str):
            return value
        if signal.kind is Kind.FLOOR:
            return self._floors.get(value)
        return value * self._watchdog_unit_s if signal.name == "watchdog_time" else value


def _printed(codec: Codec, signal: SignalCodec) -> tuple[str, ...]:
    return codec.map.signals[signal.name].addresses


def _on_wire(codec: Codec, signal: SignalCodec) -> tuple[str, ...]:
    # of a 32-bit number the lower address comes first, whichever half it holds
    points = sorted(signal.points) if codec.map.signals[signal.name].is_wide else signal.points
    return tuple(map(wire_text, points))


def wire_text(point: Point) -> str:
    """Return a place on the wire, for people."""
    return f"{point.space} {point.address}{_bits(point)}"


def _bits(point: Point) -> str:
    if point.table in BIT_TABLES or point.is_whole:
        return ""
    last = point.low + point.width - 1
    return f" bit {point.low}" if last == point.low else f" bits {point.low} to {last}"


def _blocks(signal: SignalCodec, blocks: Sequence[Block]) -> tuple[int, ...]:
    """Return the indexes of the blocks of a poll that hold its points; each point is in one."""
    return tuple({next(i for i, block in enumerate(blocks) if block.holds(point)) for point in signal.points})
