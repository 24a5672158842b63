"""The registers and bits of a simulated lift: what was written to them, and what they show when they are read.

Both differ more often than not. Where the lift speaks, writes do not last; an output may be read back at another address
than it is written to; a lamp on the point of a call shows what is registered, whatever was pressed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf

from register_maps.address import space
from register_maps.codec import Codec, CommandCodec, Point
from register_maps.words import Table

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3

_Place = tuple[str, int]
"""Space and address on the wire."""


class Objection(Exception):
    """The device answers with an exception code instead."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


class Cells:
    """Every cell of one map, behind all of its devices."""

    def __init__(self, codec: Codec) -> None:
        """All outputs at rest, and every other cell 0."""
        self._served = codec.served
        self.written = codec.empty_image()
        """What clients wrote; commands are read from here."""
        self._shown = codec.empty_image()
        self._timed: dict[_Place, list[tuple[Point, CommandCodec]]] = {}
        """Points that the device lets go by itself."""
        self._ends: dict[Point, tuple[float, int]] = {}
        """When such a point comes to rest, and the value of rest."""
        self._timed_coils: dict[_Place, tuple[Point, CommandCodec]] = {}
        self._echoes: list[tuple[Point, Point]] = []
        """Outputs that are read back elsewhere: where they are written and where they are read."""
        outputs: set[_Place] = set()
        for command in codec.commands.values():
            for point, value in command.encode(None).items():
                self._put(self.written, point, value)
            outputs |= {_place(point) for point in command.points}
            self._note(command)
        speaks = {point for signal in codec.signals.values() for point in signal.points}
        said = {_place(point) for point in speaks}
        read_back = {_place(point) for pair in self._echoes for point in pair}
        self._spoken = {place: place in outputs for place in said | read_back}
        """Cells that do not show what was written, with whether some of their bits may."""
        self._inputs = [point for point, _ in self._echoes if point.table is Table.COIL and point not in speaks]
        """Where such an output is written, reading shows the input of the same number (WAGO 750)."""
        self._echoes = [(point, read_point) for point, read_point in self._echoes if read_point not in speaks]
        for name, cells in self.written.items():
            self._shown[name][:] = cells

    def _note(self, command: CommandCodec) -> None:
        for point in command.points:
            if command.is_timed_coil:
                self._timed_coils[_place(point)] = point, command
            elif _is_timed(command):
                self._timed.setdefault(_place(point), []).append((point, command))
        if command.read_points and command.read_points != command.points:
            self._echoes += zip(command.points, command.read_points, strict=True)

    def read(self, endpoint: str, table: Table, address: int, count: int) -> list[int]:
        """Return what is shown. Raises Objection outside what the map serves."""
        return self._served_cells(self._shown, endpoint, table, address, count)[address : address + count]

    def stored(self, endpoint: str, table: Table, address: int) -> int:
        """Return what was written to one cell. Raises Objection outside what the map serves."""
        return self._served_cells(self.written, endpoint, table, address, 1)[address]

    def write(self, endpoint: str, table: Table, address: int, values: Sequence[int], now: float) -> None:
        """Write cells. Raises Objection outside what the map serves, and for a coil that takes durations only."""
        cells = self._served_cells(self.written, endpoint, table, address, len(values))
        name = space(endpoint, table)
        if any(value and (name, address + place) in self._timed_coils for place, value in enumerate(values)):
            raise Objection(ILLEGAL_VALUE)
        before = cells[address : address + len(values)]
        cells[address : address + len(values)] = values
        self._shown[name][address : address + len(values)] = values
        for offset, old in enumerate(before):
            for point, command in self._timed.get((name, address + offset), ()):
                self._time(point, command, point.within(old), now)
            if (name, address + offset) in self._timed_coils:
                self._ends.pop(self._timed_coils[name, address + offset][0], None)

    def pulse(self, endpoint: str, table: Table, address: int, counts: int, now: float) -> None:
        """Set a coil for so many counts of its device. Raises Objection where no coil takes a duration."""
        cells = self._served_cells(self.written, endpoint, table, address, 1)
        timed = self._timed_coils.get((space(endpoint, table), address))
        if timed is None or timed[1].spec.payload is None:
            raise Objection(ILLEGAL_VALUE)
        point, command = timed
        cells[address] = self._shown[point.space][address] = 1
        self._ends[point] = now + counts * timed[1].spec.payload.unit_s, command.spec.rest & 1

    @property
    def next_end(self) -> float:
        """When the device next lets something go by itself; infinity when nothing is on that it ends."""
        return min((at for at, _ in self._ends.values()), default=inf)

    def end_next(self) -> None:
        """Let the device end what it ends next."""
        point, (_, rest) = min(self._ends.items(), key=lambda item: item[1][0])
        del self._ends[point]
        self._put(self.written, point, rest)
        self._put(self._shown, point, rest)

    def show(self, say: Callable[[dict[str, list[int]]], None]) -> None:
        """Bring what is shown up to date; `say` puts the lift's signals into it."""
        for (name, address), is_output in self._spoken.items():
            self._shown[name][address] = self.written[name][address] if is_output else 0
        say(self._shown)
        for point in self._inputs:
            inputs = self._shown.get(space(point.endpoint, Table.DISCRETE), [])
            self._put(self._shown, point, inputs[point.address] if point.address < len(inputs) else 0)
        for point, read_point in self._echoes:
            self._put(self._shown, read_point, point.within(self.written[point.space][point.address]))

    def _served_cells(
        self, image: dict[str, list[int]], endpoint: str, table: Table, address: int, count: int
    ) -> list[int]:
        name = space(endpoint, table)
        spans = self._served.get(name)
        if spans is None:
            raise Objection(ILLEGAL_FUNCTION)
        if not any(address in span and address + count <= span.stop for span in spans):
            raise Objection(ILLEGAL_ADDRESS)
        return image[name]

    def _time(self, point: Point, command: CommandCodec, before: int, now: float) -> None:
        spec = command.spec
        value, rest = point.within(self.written[point.space][point.address]), spec.rest & point.mask
        if value == rest:
            self._ends.pop(point, None)
        elif value != before or point.whole:  # a write of neighbouring bits does not begin it anew
            lasts_s = spec.width_s if spec.action == "pulse" else spec.max_hold_s
            if spec.payload is not None:
                lasts_s = value * spec.payload.unit_s
            self._ends[point] = now + (lasts_s or 0.0), rest

    @staticmethod
    def _put(image: dict[str, list[int]], point: Point, value: int) -> None:
        cells = image[point.space]
        cells[point.address] = point.into(cells[point.address], value)


def _place(point: Point) -> _Place:
    return point.space, point.address


def _is_timed(command: CommandCodec) -> bool:
    return command.spec.ends_itself or command.spec.on_link_loss == "timed_by_device"
