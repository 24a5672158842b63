"""The registers and bits of a simulated lift: the values written, and the values they show.

These often differ. Signals of the lift override writes; an output may be read back at another address than it is written to;
a lamp on the point of a call shows what is registered, whatever was pressed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import chain
from math import inf

from register_maps.address import space
from register_maps.arbitration import NO_CLAIM
from register_maps.codec import Codec, CommandCodec, Point
from register_maps.words import Table

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3

TAKEN_REFRESHES = 3
"""A hold whose point the program has cleared goes on for so many of its refresh times. Chosen: as a hold that is not written again."""

_Place = tuple[str, int]
"""Space and address on the wire."""


class ExceptionReply(Exception):
    """The device answers with an exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


class NoReply(Exception):
    """The device is off its network: it does not answer, and connections end."""


class _Cleared:
    """Holds whose points the program clears, at once or after a time; each goes on for a while, to be written again."""

    def __init__(self) -> None:
        self.commands: dict[Point, CommandCodec] = {}
        self.holds: dict[str, float] = {}
        """Commands that go on although their point was cleared, and until when."""
        self._clears: dict[Point, float] = {}
        """When a point is cleared next."""

    @property
    def next_at(self) -> float:
        return min(chain(self._clears.values(), self.holds.values()), default=inf)

    def wrote(self, point: Point, before: int, value: int, now: float) -> None:
        """A client wrote such a point."""
        command = self.commands[point]
        rest = command.spec.rest & point.mask
        if value == rest:
            self._clears.pop(point, None)
        elif before == rest:
            self._clears[point] = now + (command.spec.cleared_after_s or 0.0)
            self.holds.pop(command.name, None)

    def end(self, at: float) -> Iterator[tuple[Point, int]]:
        """Take what is due, and yield the points to be cleared, each with its rest."""
        for name in [name for name, until in self.holds.items() if until <= at]:
            del self.holds[name]
        for point in [point for point, clears_at in self._clears.items() if clears_at <= at]:
            del self._clears[point]
            spec = self.commands[point].spec
            self.holds[self.commands[point].name] = at + TAKEN_REFRESHES * (spec.refresh_s or 1.0)
            yield point, spec.rest & point.mask

    def forget(self) -> None:
        """Forget everything, as after power-on."""
        self.holds.clear()
        self._clears.clear()


class Cells:
    """Every cell of one map, behind all of its devices."""

    def __init__(self, codec: Codec) -> None:
        """All outputs at rest, and every other cell 0."""
        self._served = codec.served
        self.written = codec.empty_image()
        """The values that clients wrote, and read back where nothing else is shown."""
        self.program_cells = self.written
        """The values written as the program sees them; commands are read from here."""
        self.stale = True
        """A cell was written that does not simply show what was written."""
        self._arbitration = codec.arbitration
        self.obeyed = NO_CLAIM
        """Whom the controller has obeyed last, where it decides that; it keeps this without power."""
        self.next_end = inf
        """When the device next releases an output by itself; infinity if there is none."""
        self._shown = codec.empty_image()
        self._read = self._shown
        """The values that clients read."""
        self._pretended: dict[_Place, int] = {}
        """Values answered as if written."""
        self._rest: list[tuple[Point, int]] = []
        self._timed: dict[_Place, list[tuple[Point, CommandCodec]]] = {}
        """Points that the device releases by itself."""
        self._ends: dict[Point, tuple[float, int]] = {}
        """When such a point comes to rest, and the value of rest."""
        self._cleared = _Cleared()
        self._timed_coils: dict[_Place, tuple[Point, CommandCodec]] = {}
        self._echoes: list[tuple[Point, Point]] = []
        """Outputs that are read back elsewhere: where they are written and where they are read."""
        outputs: set[_Place] = set()
        for command in codec.commands.values():
            self._rest += command.encode(None).items()
            outputs |= {_place(point) for point in command.points}
            self._note(command)
        signal_points = {point for signal in codec.signals.values() for point in signal.points}
        signal_places = {_place(point) for point in signal_points}
        read_back = {_place(point) for pair in self._echoes for point in pair}
        self._overridden = {place: place in outputs for place in signal_places | read_back}
        """Cells that do not show what was written, with whether some of their bits may."""
        self._inputs = [point for point, _ in self._echoes if point.table is Table.COIL and point not in signal_points]
        """Where such an output is written, reading shows the input of the same number (WAGO 750)."""
        self._echoes = [(point, read_point) for point, read_point in self._echoes if read_point not in signal_points]
        self.rest()

    def _note(self, command: CommandCodec) -> None:
        for point in command.points:
            if command.is_timed_coil:
                self._timed_coils[_place(point)] = point, command
            elif command.spec.self_clearing or command.spec.cleared_after_s is not None:
                self._cleared.commands[point] = command
            elif _is_timed(command):
                self._timed.setdefault(_place(point), []).append((point, command))
        if command.read_points and command.read_points != command.points:
            self._echoes += zip(command.points, command.read_points, strict=True)

    def read(self, endpoint: str, table: Table, address: int, count: int) -> list[int]:
        """Return the values shown. Raises ExceptionReply outside what the map serves."""
        return self._served_cells(self._read, endpoint, table, address, count)[address : address + count]

    def stored(self, endpoint: str, table: Table, address: int) -> int:
        """Return the value written to one cell, or pretended to be. Raises ExceptionReply outside what the map serves."""
        cell = self._served_cells(self.written, endpoint, table, address, 1)[address]
        return self._pretended.get((space(endpoint, table), address), cell) if self._pretended else cell

    def write(self, endpoint: str, table: Table, address: int, values: Sequence[int], now: float) -> bool:
        """Write cells, and return whether the controller obeys the write: of two managers it may obey one.

        Raises ExceptionReply outside what the map serves, and for a coil that takes durations only.
        """
        cells = self.writable(endpoint, table, address, values)
        name = space(endpoint, table)
        taken = self._arbitrated(endpoint, table, address, values)
        if taken is None:
            return False
        values = taken
        before = cells[address : address + len(values)]
        for image in (self.written, self._shown):
            image[name][address : address + len(values)] = values
        for place, old in enumerate(before, start=address):
            self.stale = self.stale or (name, place) in self._overridden
            for point, command in self._timed.get((name, place), ()):
                self._time(point, command, point.within(old), now)
            for point in self._cleared.commands:
                if _place(point) == (name, place):
                    self._cleared.wrote(point, point.within(old), point.within(cells[place]), now)
            if (name, place) in self._timed_coils:
                self._ends.pop(self._timed_coils[name, place][0], None)
        self._note_next_end()
        return True

    def _arbitrated(self, endpoint: str, table: Table, address: int, values: Sequence[int]) -> Sequence[int] | None:
        """Return what the program leaves of these values; None where it does not obey them, and puts back what it has obeyed."""
        if self._arbitration is None:
            return values
        written = dict(
            zip(((endpoint, table, place) for place in range(address, address + len(values))), values, strict=True)
        )
        claim = NO_CLAIM
        if written.keys() >= set(self._arbitration.cells):
            claim = self._arbitration.decode({space(endpoint, table): [0] * address + list(values)})
        if not claim.is_obeyed_after(self.obeyed):
            self._pretended = {(space(*cell[:2]), cell[2]): value for cell, value in written.items()}
            return None
        self._pretended = {}
        self.stale = self.stale or claim != self.obeyed
        self.obeyed = claim
        # epoch and owner are taken out, so that the next write is known as one
        return [0 if cell in self._arbitration.cells else value for cell, value in written.items()]

    def pretend(self, endpoint: str, table: Table, address: int, values: Sequence[int]) -> None:
        """Write nothing, and answer as if it had been written. Raises ExceptionReply as `write` does."""
        self.writable(endpoint, table, address, values)
        name = space(endpoint, table)
        self._pretended |= {(name, place): value for place, value in enumerate(values, start=address)}

    def writable(self, endpoint: str, table: Table, address: int, values: Sequence[int]) -> list[int]:
        """Return the cells of a table in which these values may be written. Raises ExceptionReply where they may not."""
        cells = self._served_cells(self.written, endpoint, table, address, len(values))
        name = space(endpoint, table)
        if any(value and (name, place) in self._timed_coils for place, value in enumerate(values, start=address)):
            raise ExceptionReply(ILLEGAL_VALUE)
        return cells

    def pulse(self, endpoint: str, table: Table, address: int, counts: int, now: float) -> None:
        """Set a coil for so many counts of its device. Raises ExceptionReply where no coil takes a duration."""
        point, command = self.timed_coil(endpoint, table, address)
        unit_s = command.spec.payload.unit_s if command.spec.payload is not None else 0.0
        for image in (self.written, self._shown):
            image[point.space][address] = 1
        self.stale = self.stale or _place(point) in self._overridden
        self._ends[point] = now + counts * unit_s, command.encode(None)[point]
        self._note_next_end()

    def timed_coil(self, endpoint: str, table: Table, address: int) -> tuple[Point, CommandCodec]:
        """Return the coil that takes a duration here. Raises ExceptionReply where there is none."""
        self._served_cells(self.written, endpoint, table, address, 1)
        timed = self._timed_coils.get((space(endpoint, table), address))
        if timed is None or timed[1].spec.payload is None:
            raise ExceptionReply(ILLEGAL_VALUE)
        return timed

    @property
    def cleared_holds(self) -> Collection[str]:
        """Commands that go on although the program has cleared their points."""
        return self._cleared.holds

    def end_next(self) -> None:
        """Carry out the next release of the device itself."""
        if self._cleared.next_at == self.next_end:
            for point, rest in self._cleared.end(self.next_end):
                self._release(point, rest)
            self._note_next_end()
            return
        point, (_, rest) = min(self._ends.items(), key=lambda item: item[1][0])
        del self._ends[point]
        self._note_next_end()
        self._release(point, rest)

    def rest(self) -> None:
        """Put all outputs at rest, as after power-on."""
        self.stale = True
        self._ends.clear()
        self._cleared.forget()
        self._note_next_end()
        self._pretended.clear()
        for image in (self.written, self.program_cells, self._shown):
            for name in image:
                image[name][:] = [0] * len(image[name])
        for point, value in self._rest:
            self._release(point, value)

    def hide_writes(self) -> None:
        """Hide further writes from the program."""
        self.program_cells = _copy(self.written)

    def show_writes(self, *, stored: bool) -> None:
        """Undo `hide_writes` if the writes were `stored`, else `pretend`; the program sees the stored writes."""
        if stored:
            self.program_cells = self.written
        else:
            self._pretended.clear()

    def freeze(self) -> None:
        """Let clients read the present values from now on."""
        self._read = _copy(self._shown)

    def thaw(self) -> None:
        """Let clients read current values again."""
        self._read = self._shown

    def show(self, insert_signals: Callable[[dict[str, list[int]]], None]) -> None:
        """Update the values shown; `insert_signals` puts the lift's signals into them."""
        self.stale = False
        for (name, address), is_output in self._overridden.items():
            self._shown[name][address] = self.written[name][address] if is_output else 0
        insert_signals(self._shown)
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
            raise ExceptionReply(ILLEGAL_FUNCTION)
        if not any(address in span and address + count <= span.stop for span in spans):
            raise ExceptionReply(ILLEGAL_ADDRESS)
        return image[name]

    def _release(self, point: Point, rest: int) -> None:
        self.stale = self.stale or _place(point) in self._overridden
        for image in (self.written, self.program_cells, self._shown):
            self._put(image, point, rest)

    def _note_next_end(self) -> None:
        self.next_end = min((at for at, _ in self._ends.values()), default=inf)
        self.next_end = min(self.next_end, self._cleared.next_at)

    def _time(self, point: Point, command: CommandCodec, before: int, now: float) -> None:
        spec = command.spec
        value, rest = point.within(self.written[point.space][point.address]), command.encode(None)[point]
        if value == rest:
            self._ends.pop(point, None)
        elif value != before or point.is_whole:  # a write of neighbouring bits does not restart it
            lasts_s = spec.width_s if spec.action == "pulse" else spec.max_hold_s
            if spec.payload is not None:
                lasts_s = value * spec.payload.unit_s
            self._ends[point] = now + (lasts_s or 0.0), rest

    @staticmethod
    def _put(image: dict[str, list[int]], point: Point, value: int) -> None:
        cells = image[point.space]
        cells[point.address] = point.into(cells[point.address], value)


def _copy(image: dict[str, list[int]]) -> dict[str, list[int]]:
    return {name: list(cells) for name, cells in image.items()}


def _place(point: Point) -> _Place:
    return point.space, point.address


def _is_timed(command: CommandCodec) -> bool:
    return command.spec.ends_itself or command.spec.on_link_loss == "timed_by_device"
