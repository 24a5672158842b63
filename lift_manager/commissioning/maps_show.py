"""The content of one map as data, point by point."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lift_manager.commissioning import wording
from lift_manager.commissioning.detection import Detection, detections
from lift_manager.commissioning.maps_list import at_floor, fire
from lift_manager.commissioning.wording import one_line
from register_maps.assumptions import assumptions
from register_maps.codec import Codec, CommandCodec, Point, SignalCodec, compile_map
from register_maps.load import LoadedMap
from register_maps.meanings import COMMAND_MEANINGS, SIGNAL_MEANINGS
from register_maps.schema import RegisterMap
from register_maps.words import Table


@dataclass(frozen=True, slots=True)
class PlaceSheet:
    """One point, as it is printed and as it is on the wire."""

    printed: str
    unit_id: int
    endpoint: str
    """Name of the second device; empty for the controller itself."""
    table: str
    address: int
    """On the wire: the first one is 0."""
    bit: int | None
    """Lowest bit inside a register; None where the whole register or bit is meant."""
    bits: int
    """How many bits: 1 in a bit table, up to 16 in a register."""
    words: str


@dataclass(frozen=True, slots=True)
class SignalSheet:
    """One thing the lift says."""

    name: str
    kind: str
    meaning: str
    places: tuple[PlaceSheet, ...]
    read_functions: tuple[int, ...]
    coding: str
    unit: str
    note: str


@dataclass(frozen=True, slots=True)
class CommandSheet:
    """One command of the lift."""

    name: str
    meaning: str
    places: tuple[PlaceSheet, ...]
    read_back: tuple[PlaceSheet, ...]
    """Where it is read back; empty where nothing is."""
    write_functions: tuple[int, ...]
    read_functions: tuple[int, ...]
    coding: str
    action: str
    conditions: str
    confirmed_by: str
    arrive_within_s: float | None
    """Of a call: how long the car may take."""
    on_link_loss: str
    shared_word: str
    note: str


@dataclass(frozen=True, slots=True)
class ParameterSheet:
    """One thing that a site can say."""

    name: str
    value: int | float | str
    """What it is here: the default or, without one, the example."""
    must_be_set: bool
    allowed: str
    help: str


@dataclass(frozen=True, slots=True)
class MapSheet:
    """One map."""

    name: str
    title: str
    trust: str
    sources: tuple[str, ...]
    notes: str
    sha256: str
    addressing: str
    link: Mapping[str, int | float | bool | None]
    endpoints: Mapping[str, str]
    served: Mapping[str, tuple[tuple[int, int], ...]]
    """First and last address on the wire, by table (`coil`, or `endpoint/coil`)."""
    write_blocks: tuple[str, ...]
    signals: tuple[SignalSheet, ...]
    commands: tuple[CommandSheet, ...]
    parameters: tuple[ParameterSheet, ...]
    needs: Mapping[str, str]
    at_floor: str
    at_same_floor: str
    fire: str
    cautions: tuple[str, ...]
    assumed: tuple[str, ...]
    """What holds because the map does not say otherwise."""
    faults: tuple[Detection, ...]
    """What can be seen of each fault of such a lift, and what cannot."""


def map_sheet(loaded: LoadedMap) -> MapSheet:
    """Describe a checked map."""
    source = loaded.map
    codec = compile_map(source)
    return MapSheet(
        name=source.name,
        title=one_line(source.title),
        trust=source.provenance.trust,
        sources=tuple(map(one_line, source.provenance.sources)),
        notes=one_line(source.provenance.notes),
        sha256=loaded.sha256,
        addressing=_addressing(source),
        link=source.link.model_dump(),
        endpoints={name: one_line(f"unit id {part.unit_id}. {part.note}") for name, part in source.endpoints.items()},
        served={name: tuple((r.start, r.stop - 1) for r in ranges) for name, ranges in codec.served.items()},
        write_blocks=tuple(_blocks(codec)),
        signals=tuple(_signal(codec, signal) for signal in codec.signals.values()),
        commands=tuple(_command(codec, command) for command in codec.commands.values()),
        parameters=tuple(_parameters(loaded)),
        needs={name: one_line(why) for name, why in source.needs.items()},
        at_floor=at_floor(source),
        at_same_floor={"call": "the call itself", "open_button": "the door-open command"}[source.at_same_floor],
        fire=fire(source),
        cautions=tuple(one_line(finding.message) for finding in loaded.warnings),
        assumed=assumptions(source),
        faults=detections(codec, max_age_s=source.link.max_age_s),
    )


def places(source: RegisterMap, printed: Sequence[str], points: Sequence[Point]) -> tuple[PlaceSheet, ...]:
    """Pair every point with the address that the map prints for it; a 32-bit number has two points and one address."""
    texts = list(printed) if len(printed) == len(points) else [printed[0]] * len(points)
    return tuple(
        PlaceSheet(
            printed=text,
            unit_id=source.unit_of(point.endpoint),
            endpoint=point.endpoint,
            table=point.table.value,
            address=point.address,
            bit=None if point.is_whole else point.low,
            bits=point.width,
            words=wording.wire(point),
        )
        for text, point in zip(texts, points, strict=True)
    )


def side_by_side(found: Sequence[PlaceSheet]) -> Iterator[tuple[str, str]]:
    """Yield (as printed, on the wire), with points that follow one another in one line."""
    points = [Point(Table(place.table), place.address, place.bit or 0, place.bits, place.endpoint) for place in found]
    for first, count in wording.runs(points):
        printed, last = found[first].printed, found[first + count - 1].printed
        yield (printed if printed == last else f"{printed} to {last}"), wording.wire(points[first], count)


def _signal(codec: Codec, signal: SignalCodec) -> SignalSheet:
    spec = codec.map.signals[signal.name]
    return SignalSheet(
        name=signal.name,
        kind=signal.kind.value,
        meaning=SIGNAL_MEANINGS[signal.name],
        places=places(codec.map, spec.addresses, wording.in_word_order(signal, spec)),
        read_functions=wording.read_functions(signal.points),
        coding=wording.signal_coding(signal, spec),
        unit=one_line(spec.unit),
        note=one_line(spec.note),
    )


def _command(codec: Codec, command: CommandCodec) -> CommandSheet:
    spec = command.spec
    elsewhere = [text for _, text in spec.keyed_read_addresses]
    return CommandSheet(
        name=command.name,
        meaning=COMMAND_MEANINGS[command.name],
        places=places(codec.map, spec.addresses, command.points),
        read_back=places(codec.map, elsewhere or spec.addresses, command.read_points) if command.read_points else (),
        write_functions=tuple(dict.fromkeys(command.functions)),
        read_functions=wording.read_functions(command.read_points),
        coding=wording.command_coding(command),
        action=wording.action(spec),
        conditions=wording.conditions(spec),
        confirmed_by=wording.confirmation(spec),
        arrive_within_s=spec.arrive_within_s if command.is_call else None,
        on_link_loss=wording.link_loss(spec),
        shared_word=wording.SHARED_WORD.get(spec.shared_word or "", ""),
        note=one_line(spec.note),
    )


def _addressing(source: RegisterMap) -> str:
    match source.addressing.base, source.addressing.notation:
        case 0, _:
            return "printed as they are on the wire, where the first one is 0"
        case 1, _:
            return "printed counting from 1: the number minus 1 is the address on the wire"
        case _, "modicon":
            return "Modicon numbers: the first digit names the table, the rest counts from 1"
        case _, notation:
            return f"the names of {notation}"


def _parameters(loaded: LoadedMap) -> Iterator[ParameterSheet]:
    for name, parameter in loaded.map.parameters.items():
        allowed = ""
        if parameter.range is not None:
            allowed = f"{parameter.range[0]:g} to {parameter.range[1]:g}"
        elif parameter.choices is not None:
            allowed = " or ".join(parameter.choices)
        value = loaded.parameters[name]
        yield ParameterSheet(name, value, name in loaded.unset, allowed, one_line(parameter.help))


def _blocks(codec: Codec) -> Iterator[str]:
    for block, function, every_s in codec.written:
        cycle = "" if every_s is None else f", every {every_s:g} s whether or not anything is requested"
        where = wording.wire(Point(block.table, block.start, 0, 16, block.endpoint), block.count)
        yield f"{where}: always written as a whole with FC{function:02}{cycle}"
    if carried := wording.arbitration(codec):
        yield f"each write carries {carried}"
