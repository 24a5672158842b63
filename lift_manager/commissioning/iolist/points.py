"""Makes the lines of an I/O list from a compiled map: one for each contact, coil, register, or field of a register."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from lift_manager.commissioning import wording
from lift_manager.commissioning.iolist.model import FROM_LIFT, TO_LIFT, IoPoint
from lift_manager.commissioning.wording import one_line
from lift_manager.config.devices import Device
from register_maps.codec import Codec, CommandCodec, Point, SignalCodec
from register_maps.meanings import COMMAND_MEANINGS, SIGNAL_MEANINGS
from register_maps.schema import Command, Kind, Signal
from register_maps.words import BIT_TABLES

LIFT_COMPANY, MANAGER, TO_BE_AGREED = "lift company", "lift manager", "to be agreed"

NO_CONTACT = "number, no contact"
NOT_USED = "not used"
_NO_FLOOR = "no floor of this site; stays off"


def io_points(codec: Codec, floors: Mapping[str, int], devices: Mapping[str, Device]) -> Iterator[IoPoint]:
    """Yield the lines of one lift: signals first, then commands.

    `floors` are the floor codes of the site by name; `devices` are the controller (empty name) and every endpoint.
    """
    sheet = _PointBuilder(codec, {code: one_line(name) for name, code in floors.items()}, devices)
    for signal in codec.signals.values():
        yield from sheet.signal(signal)
    for command in codec.commands.values():
        yield from sheet.command(command)


class _PointBuilder:
    def __init__(self, codec: Codec, floors: Mapping[int, str], devices: Mapping[str, Device]) -> None:
        self._codec = codec
        self._floors = floors
        self._devices = devices

    def signal(self, signal: SignalCodec) -> Iterator[IoPoint]:
        spec = self._codec.map.signals[signal.name]
        points = wording.in_word_order(signal, spec)
        parts = self._parts(spec)
        if spec.is_wide:
            points, parts = points[:1], [""]
        for point, printed, part in zip(points, spec.addresses, parts, strict=True):
            yield IoPoint(
                signal=f"{signal.name}: {part}" if part else signal.name,
                meaning=SIGNAL_MEANINGS[signal.name],
                direction=FROM_LIFT,
                printed=printed,
                table=point.table.value,
                wire=_address(point, wide=spec.is_wide),
                unit_id=self._devices[point.endpoint].unit_id,
                function=wording.functions(wording.read_functions([point])),
                values=self._signal_values(signal, spec, part),
                contact=signal_contact(point, spec, signal.kind, part),
                times=""
                if spec.must_change_within_s is None
                else f"must change within {spec.must_change_within_s:g} s",
                supplied_by=TO_BE_AGREED if point.endpoint else LIFT_COMPANY,
                remarks=_joined(self._place(point), "" if _NO_FLOOR in part else one_line(spec.note)),
            )

    def command(self, command: CommandCodec) -> Iterator[IoPoint]:
        spec = command.spec
        texts = [text for _, text in spec.keyed_read_addresses]
        for index, (point, printed) in enumerate(zip(command.points, spec.addresses, strict=True)):
            part = self._floor(spec.floor_codes[index]) if spec.one_of is not None else ""
            spare = _NO_FLOOR in part
            back = f"read back at {texts[index]}" if texts else ""
            yield IoPoint(
                signal=f"{command.name}: {part}" if part else command.name,
                meaning=COMMAND_MEANINGS[command.name],
                direction=TO_LIFT,
                printed=printed,
                table=point.table.value,
                wire=_address(point),
                unit_id=self._devices[point.endpoint].unit_id,
                function=self._functions(command, index),
                values=f"always {spec.rest}" if spare else self._command_values(command),
                contact=NOT_USED if spare else command_contact(point, spec),
                times="" if spare else wording.action(spec),
                supplied_by=TO_BE_AGREED if point.endpoint else MANAGER,
                remarks=_joined(self._place(point), back if spare else _remarks(spec, back)),
            )

    def _parts(self, spec: Signal) -> list[str]:
        """Return a name for each contact of a signal with several contacts; one empty text for a signal with one address."""
        if spec.open_limit is not None:
            return ["fully open", "fully closed"]
        if spec.up is not None:
            return ["up", "down"]
        count = len(spec.addresses)
        if spec.code_of is not None:
            return [f"bit {index} of the code" for index in range(count)]
        if spec.open_limits is not None:
            return [f"fully open, {self._floor(code)}" for code in spec.floor_codes]
        return [self._floor(code) for code in spec.floor_codes] or [""]

    def _floor(self, code: int) -> str:
        return f"floor {self._floors[code]}" if code in self._floors else f"code {code}, {_NO_FLOOR}"

    def _signal_values(self, signal: SignalCodec, spec: Signal, part: str) -> str:
        if part:
            on = 0 if spec.active == "low" else 1
            return f"{on} = {part}" if _NO_FLOOR not in part else f"always {1 - on}"
        coding = wording.signal_coding(signal, spec)
        return f"{coding}. {self._codes()}" if signal.kind is Kind.FLOOR else coding

    def _command_values(self, command: CommandCodec) -> str:
        if command.spec.one_of is not None:
            return wording.one_output(command)
        coding = wording.command_coding(command)
        return f"{coding}. {self._codes()}" if command.is_call else coding

    def _codes(self) -> str:
        return ", ".join(f"{code} = {name}" for code, name in self._floors.items())

    def _functions(self, command: CommandCodec, index: int) -> str:
        block = next(place for place, block in enumerate(command.blocks) if block.holds(command.points[index]))
        write = wording.functions([command.functions[block]])
        read = wording.functions(wording.read_functions(command.read_points))
        return f"write {write}, read {read}" if read else f"write {write}"

    def _place(self, point: Point) -> str:
        """Return the second device that a point is on; empty for the controller itself."""
        if not point.endpoint:
            return ""
        return f"on the second device {point.endpoint} ({one_line(self._devices[point.endpoint].controller)})"


def signal_contact(point: Point, spec: Signal, kind: Kind, part: str = "") -> str:
    """Return whether a contact is normally open or closed; a number is not a contact."""
    if point.width > 1:
        return NO_CONTACT
    closed = part
    if not part:
        closed = "yes" if kind is Kind.FLAG else (spec.values or {}).get(1, "open")
    if _NO_FLOOR in part:
        return NOT_USED
    if spec.active == "low":
        broken = "; a broken wire reads as yes" if kind is Kind.FLAG else ""
        return f"NC: opens (0) for {closed}{broken}"
    return f"NO: closes (1) for {closed}"


def command_contact(point: Point, spec: Command) -> str:
    """Return whether an output is normally open or closed."""
    if spec.is_heartbeat:
        return NO_CONTACT if point.width > 1 else "changes all the time"
    if point.width > 1:
        return NO_CONTACT
    return "NC: opens (0) while commanded" if spec.rest & 1 else "NO: closes (1) while commanded"


def _remarks(spec: Command, back: str) -> str:
    return _joined(
        wording.conditions(spec),
        f"when the link is lost: {wording.link_loss(spec)}",
        back,
        wording.SHARED_WORD.get(spec.shared_word or "", ""),
        one_line(spec.note),
    )


def _joined(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _address(point: Point, *, wide: bool = False) -> str:
    if wide:
        return f"{point.address} and {point.address + 1}"
    if point.table in BIT_TABLES or point.is_whole:
        return str(point.address)
    last = point.low + point.width - 1
    return f"{point.address} bit {point.low}" if last == point.low else f"{point.address} bits {point.low} to {last}"
