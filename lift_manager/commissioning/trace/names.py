"""Decodes exchanges with the signals and commands of the lifts on a link."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from lift_manager.commissioning.trace.exchanges import Exchange
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from register_maps import frames
from register_maps.codec import Codec, CommandCodec, Point, SignalCodec, Unlisted, compile_map
from register_maps.frames import Request
from register_maps.schema import Kind, RegisterMap

Cell = tuple[int, str, int]
"""Unit id, table and address."""


@dataclass(frozen=True, slots=True)
class TracedLift:
    """One lift on the link, as far as it is on it."""

    name: str
    """Empty where there is but one."""
    codec: Codec
    floors: Mapping[int, str]
    """Names by code; codes without a name are shown as they are."""
    units: Mapping[str, int]
    """The unit ids of its devices on this link, by endpoint."""


@dataclass(frozen=True, slots=True)
class SignalChange:
    """One signal in the answer to a read."""

    name: str
    """With its lift before it, where there are several."""
    value: str
    before: str | None
    """None where it was not read before."""

    @property
    def has_changed(self) -> bool:
        """Whether it differs from the last reading; the first one counts as a change."""
        return self.value != self.before


def lifts_of_map(source: RegisterMap, floors: Mapping[str, int] | None) -> tuple[TracedLift, ...]:
    """Return the lift of a map, whose devices are all on the link."""
    codec = compile_map(source)
    units = {"": source.unit_of("")} | {name: source.unit_of(name) for name in source.endpoints}
    return (TracedLift("", codec, {code: name for name, code in (floors or {}).items()}, units),)


def lifts_of_site(loaded: LoadedSite, link: str, only: str = "") -> tuple[TracedLift, ...]:
    """Return the lifts of a site that have devices on a link; with `only`, that one."""
    found = []
    for name, spec in loaded.site.lifts.items():
        if only and name != only:
            continue
        source = loaded.maps[name].map
        units = {
            endpoint: device.unit_id
            for endpoint, device in devices(loaded.site, spec, source).items()
            if device.controller == link
        }
        if units:
            floors = {entry.code: floor for floor, entry in spec.floors.items()}
            found.append(TracedLift(name, loaded.codecs[name], floors, units))
    return tuple(found) if len(found) > 1 else tuple(TracedLift("", one.codec, one.floors, one.units) for one in found)


class Names:
    """What was read so far, and what it means. Takes the exchanges of a recording in their order."""

    def __init__(self, lifts: Iterable[TracedLift]) -> None:
        self._cells: dict[Cell, int] = {}
        self._values: dict[str, str] = {}
        self._signals: list[tuple[str, TracedLift, SignalCodec, tuple[Cell, ...]]] = []
        self._commands: list[tuple[str, TracedLift, CommandCodec, dict[Cell, Point]]] = []
        for lift in lifts:
            for name, signal in lift.codec.signals.items():
                if all(point.endpoint in lift.units for point in signal.points):
                    cells = tuple(_cell(lift, point) for point in signal.points)
                    self._signals.append((_full_name(lift, name), lift, signal, cells))
            for name, command in lift.codec.commands.items():
                if all(point.endpoint in lift.units for point in command.points):
                    points = {_cell(lift, point): point for point in command.points}
                    self._commands.append((_full_name(lift, name), lift, command, points))

    @property
    def signals(self) -> tuple[str, ...]:
        """Every signal by its name here."""
        return tuple(name for name, *_ in self._signals)

    def signals_in(self, exchange: Exchange) -> tuple[SignalChange, ...]:
        """Return the signals in the answer to a read, those of which a part was never read left out."""
        request, values = exchange.parsed, exchange.values
        if request is None or values is None:
            return ()
        read = {_requested(request, place): value for place, value in enumerate(values)}
        self._cells |= read
        return tuple(self._changes(read.keys()))

    def reads(self, request: Request, name: str) -> bool:
        """Whether a read covers a part of a signal."""
        cells = {_requested(request, place) for place in range(request.count)}
        return any(not cells.isdisjoint(places) for known, _, _, places in self._signals if known == name)

    def commands_in(self, request: Request) -> tuple[str, ...]:
        """Return what a write commands, such as `go_to L2` or `hold_door.front released`."""
        return tuple(
            f"{name} {words}".rstrip()
            for name, lift, command, points in self._commands
            for words in _commanded(lift, command, points, request)
        )

    def _changes(self, read: Iterable[Cell]) -> Iterator[SignalChange]:
        touched = set(read)
        for name, lift, signal, cells in self._signals:
            if touched.isdisjoint(cells) or not all(cell in self._cells for cell in cells):
                continue
            value = self._value(lift, signal, cells)
            before = self._values.get(name)
            self._values[name] = value
            yield SignalChange(name, value, before)

    def _value(self, lift: TracedLift, signal: SignalCodec, cells: tuple[Cell, ...]) -> str:
        raw = shift = 0
        for point, cell in zip(signal.points, cells, strict=True):
            raw |= point.within(self._cells[cell]) << shift
            shift += point.width
        value = signal.decode(raw)
        if isinstance(value, Unlisted):
            return f"unlisted ({raw})"
        if value is None:
            return f"none ({raw})"
        if isinstance(value, frozenset):
            return "+".join(lift.floors.get(code, str(code)) for code in sorted(value)) or "none"
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, int) and signal.kind is Kind.FLOOR:
            return lift.floors.get(value, str(value))
        return str(value)


def _full_name(lift: TracedLift, name: str) -> str:
    return f"{lift.name}:{name}" if lift.name else name


def _cell(lift: TracedLift, point: Point) -> Cell:
    return lift.units[point.endpoint], point.table, point.address


def _requested(request: Request, place: int) -> Cell:
    return request.unit, request.table, request.address + place


def _commanded(
    lift: TracedLift, command: CommandCodec, points: Mapping[Cell, Point], request: Request
) -> Iterator[str]:
    written = _written(request)
    touched = {point: written[cell] for cell, point in points.items() if cell in written}
    if request.function == frames.MASK_WRITE:
        keep, _ = request.values
        touched = {point: value for point, value in touched.items() if point.within(~keep & 0xFFFF)}
    if not touched:
        return
    if command.spec.one_of is not None:
        for index, (point, cell) in enumerate((point, touched.get(point)) for point in command.points):
            if cell is not None and point.within(cell):
                code = command.spec.floor_codes[index]
                yield lift.floors.get(code, str(code))
        if not any(point.within(cell) for point, cell in touched.items()):
            yield "released"
        return
    if request.duration is not None:
        yield f"for {request.duration} counts"
        return
    (point, cell), *_ = touched.items()
    decoded = command.decode({point.space: [0] * point.address + [cell]})
    if command.spec.is_heartbeat:
        yield str(decoded)
    elif decoded is None:
        yield "released" if point.within(cell) == command.spec.rest else f"invalid ({point.within(cell)})"
    else:
        yield lift.floors.get(decoded, str(decoded)) if command.is_call else ""


def _written(request: Request) -> dict[Cell, int]:
    if not request.is_write:
        return {}
    if request.function == frames.MASK_WRITE:
        return {_requested(request, 0): request.values[1]}
    return {_requested(request, place): value for place, value in enumerate(request.values)}
