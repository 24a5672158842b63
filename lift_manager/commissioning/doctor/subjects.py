"""What doctor examines: controllers by their address, and the lifts whose points they hold."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from drivers.modbus.read_plan import plan_poll, plan_reads, polled_points
from lift_manager.commissioning.wording import wire
from lift_manager.config.devices import POLL_S, Device
from lift_manager.config.devices import devices as devices_of
from lift_manager.config.load import LoadedSite
from register_maps.codec import Block, Codec, CommandCodec, Point, SignalCodec, compile_map
from register_maps.load import LoadedMap
from register_maps.schema import LinkDefaults
from register_maps.words import Table

UnitBlock = tuple[int, Block]
"""A unit id, and what is read from it at once."""
UnitSpan = tuple[int, range, Table]
"""A unit id, and addresses of one of its tables."""
LONGEST_LIST = 3
"""Addresses of one signal that a line lists one by one; of more it has the first and the last."""


@dataclass(frozen=True, slots=True)
class ExaminedController:
    """One address, and what is assumed about what answers there."""

    name: str
    """As in the site file; without one, its address."""
    host: str
    port: int
    link: LinkDefaults
    is_secure: bool = False
    """Whether it speaks Modbus/TCP Security."""

    @property
    def address(self) -> str:
        """Host and port as people write them."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class ExaminedLift:
    """One lift, and where its points are."""

    name: str
    codec: Codec
    sha256: str
    devices: Mapping[str, Device]
    """Controller and unit id of each device, by endpoint; the controller itself goes by the empty name."""
    floors: Mapping[int, str] = field(default_factory=dict)
    """Names of the floors by code; empty if nobody has named them."""
    poll_s: float = POLL_S
    max_age_s: float = 1.0
    max_registers: int = 125
    max_bits: int = 2000

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The reads of one poll, as a manager makes them."""
        return plan_poll(self.codec, max_registers=self.max_registers, max_bits=self.max_bits)

    @property
    def output_blocks(self) -> tuple[Block, ...]:
        """The reads that show the state of every output that only a client of the controller writes."""
        points = [point for command in self.own_outputs for point in command.read_points]
        return plan_reads(points, self.codec.served, max_registers=self.max_registers, max_bits=self.max_bits)

    @property
    def own_outputs(self) -> tuple[CommandCodec, ...]:
        """The commands whose points hold what a client wrote last: no lamps, nothing that the device ends by itself."""
        shown = {point.cell for point in self.codec.signal_points}
        return tuple(
            command
            for command in self.codec.commands.values()
            if command.read_points and not command.shows_lamp and not any(p.cell in shown for p in command.read_points)
        )

    def device(self, point: Point | Block) -> Device:
        """Return controller and unit id of a point."""
        return self.devices[point.endpoint]

    def printed(self, name: str) -> str:
        """Return the addresses of a signal or a command as its map prints them, and on the wire where that differs."""
        source, part = self.codec.map, self.codec.signals.get(name) or self.codec.commands[name]
        addresses = source.signals[name].addresses if isinstance(part, SignalCodec) else part.spec.addresses
        points = sorted(part.points) if isinstance(part, SignalCodec) and part.width > 16 else part.points
        listed = addresses if len(addresses) <= LONGEST_LIST else (addresses[0], addresses[-1])
        text = (" to " if len(listed) < len(addresses) else ", ").join(listed)
        numbers = [re.fullmatch(r".*:(\d+)(\.\d+)?", address) for address in addresses]
        on_wire = [point.address for point in points]
        if all(number and int(number[1]) in on_wire for number in numbers):
            return text
        return f"{text} ({wire(points[0])}{f' to {points[-1].address}' if len(points) > 1 else ''} on the wire)"

    def printed_cell(self, point: Point) -> str:
        """Return the address of one point as the map prints it, with the names of what is there."""
        names = [name for name, part in self._parts() if any(own.cell == point.cell for own in part.points)]
        return f"{', '.join(dict.fromkeys(names))} at {self._text_of(point)}"

    def _text_of(self, point: Point) -> str:
        source = self.codec.map
        for name, part in self._parts():
            addresses = source.signals[name].addresses if name in source.signals else part.spec.addresses  # type: ignore[union-attr]
            for text in addresses:
                place = source.place(text)
                number = place.number + (0 if place.endpoint else self.codec.offset.get(place.table, 0))
                if (place.endpoint, place.table, number) == point.cell:
                    return text if text.endswith(f":{number}") else f"{text} ({wire(point)} on the wire)"
        return f"{wire(point)} on the wire"

    def _parts(self) -> Iterator[tuple[str, SignalCodec | CommandCodec]]:
        yield from self.codec.signals.items()
        yield from self.codec.commands.items()


@dataclass(frozen=True, slots=True)
class Subjects:
    """Everything that one run examines."""

    controllers: Mapping[str, ExaminedController]
    lifts: Mapping[str, ExaminedLift] = field(default_factory=dict)

    def lifts_on(self, controller: str) -> tuple[ExaminedLift, ...]:
        """Return the lifts with a device on a controller."""
        return tuple(
            lift
            for lift in self.lifts.values()
            if any(device.controller == controller for device in lift.devices.values())
        )

    def polls_on(self, controller: str) -> tuple[UnitBlock, ...]:
        """Return the reads of one poll of all lifts on a controller, each once."""
        return self._once(controller, lambda lift: lift.blocks)

    def outputs_on(self, controller: str) -> tuple[UnitBlock, ...]:
        """Return the reads that show the outputs of all lifts on a controller, each once."""
        return self._once(controller, lambda lift: lift.output_blocks)

    def _once(self, controller: str, blocks_of: Callable[[ExaminedLift], tuple[Block, ...]]) -> tuple[UnitBlock, ...]:
        found = (
            (lift.device(block).unit_id, block)
            for lift in self.lifts_on(controller)
            for block in blocks_of(lift)
            if lift.device(block).controller == controller
        )
        return tuple(dict.fromkeys(found))

    def cells_on(self, controller: str) -> frozenset[tuple[int, Table, int]]:
        """Return unit id, table and address of each point on a controller that a poll reads."""
        return frozenset(
            (lift.device(point).unit_id, point.table, point.address)
            for lift in self.lifts_on(controller)
            for point in polled_points(lift.codec)
            if lift.device(point).controller == controller
        )

    def served_on(self, controller: str) -> tuple[UnitSpan, ...]:
        """Return what the maps say that a controller serves."""
        found: dict[UnitSpan, None] = {}
        for lift in self.lifts_on(controller):
            for space, spans in lift.codec.served.items():
                endpoint, _, table = space.rpartition("/")
                device = lift.devices.get(endpoint)
                if device is not None and device.controller == controller:
                    found |= dict.fromkeys((device.unit_id, span, Table(table)) for span in spans)
        return tuple(found)

    def beats_on(self, controller: str) -> Iterator[float]:
        """Yield how long the alive counters on a controller may stand still."""
        for lift in self.lifts_on(controller):
            alive = lift.codec.map.signals.get("alive")
            if alive is not None and alive.must_change_within_s is not None:
                yield alive.must_change_within_s

    def unit_of(self, controller: str) -> int:
        """Return the unit id at which a controller is expected first."""
        for lift in self.lifts_on(controller):
            for device in lift.devices.values():
                if device.controller == controller:
                    return device.unit_id
        return self.controllers[controller].link.unit_id


def subjects_of_site(loaded: LoadedSite) -> Subjects:
    """Examine every controller and every lift of a site."""
    controllers = {
        name: ExaminedController(name, spec.host, spec.port, loaded.links[name], is_secure=spec.tls is not None)
        for name, spec in loaded.controllers.items()
    }
    lifts = {}
    for name, spec in loaded.site.lifts.items():
        source = loaded.maps[name].map
        placed = devices_of(loaded.site, spec, source)
        needs = [loaded.links[device.controller] for device in placed.values()]
        lifts[name] = ExaminedLift(
            name,
            loaded.codecs[name],
            loaded.maps[name].sha256,
            placed,
            floors={floor.code: floor_name for floor_name, floor in spec.floors.items()},
            poll_s=loaded.poll_s(name),
            max_age_s=spec.max_age_s or source.link.max_age_s,
            max_registers=min(need.max_registers_per_read for need in needs),
            max_bits=min(need.max_bits_per_read for need in needs),
        )
    return Subjects(controllers, lifts)


def subjects_at(
    host: str,
    port: int,
    loaded: LoadedMap | None,
    *,
    unit: int | None = None,
    floors: Mapping[str, int] | None = None,
) -> Subjects:
    """Examine one address, with a map or without; points of further devices of the map are left out."""
    link = LinkDefaults() if loaded is None else loaded.map.link
    if unit is not None:
        link = link.model_copy(update={"unit_id": unit})
    controller = ExaminedController("", host, port, link)
    controller = ExaminedController(controller.address, host, port, link)
    if loaded is None:
        return Subjects({controller.name: controller})
    lift = ExaminedLift(
        "lift",
        _of_controller(compile_map(loaded.map)),
        loaded.sha256,
        {"": Device(controller.name, link.unit_id)},
        floors={code: name for name, code in (floors or {}).items()},
        poll_s=max(POLL_S, link.min_poll_s),
        max_age_s=link.max_age_s,
        max_registers=link.max_registers_per_read,
        max_bits=link.max_bits_per_read,
    )
    return Subjects({controller.name: controller}, {lift.name: lift})


def _of_controller(codec: Codec) -> Codec:
    """Return a compiled map without the points of further devices, whose addresses nobody has given."""
    if not codec.map.endpoints:
        return codec
    return Codec(
        codec.map,
        {name: part for name, part in codec.signals.items() if not any(p.endpoint for p in part.points)},
        {name: part for name, part in codec.commands.items() if not any(p.endpoint for p in part.points)},
        {space: spans for space, spans in codec.served.items() if "/" not in space},
        codec.offset,
    )


SIBLING = {
    Table.HOLDING: Table.INPUT,
    Table.INPUT: Table.HOLDING,
    Table.COIL: Table.DISCRETE,
    Table.DISCRETE: Table.COIL,
}
"""The table that a vendor's list is most easily taken for."""
