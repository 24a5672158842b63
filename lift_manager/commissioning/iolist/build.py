"""Builds the I/O list of a checked site."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from lift_manager.commissioning.iolist.model import IoList, LiftList
from lift_manager.commissioning.iolist.points import io_points
from lift_manager.commissioning.maps_list import at_floor, fire
from lift_manager.commissioning.wording import arbitration, one_line
from lift_manager.config.devices import Device, devices
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Lift
from register_maps.codec import Codec
from register_maps.load import LoadedMap, MapChanges


def io_list(loaded: LoadedSite) -> IoList:
    """Return the list of every lift of a site; open questions are on the cover."""
    site = loaded.site
    lifts = tuple(_lift(loaded, name, lift) for name, lift in site.lifts.items())
    facts = (
        ("Site", one_line(site.name)),
        ("Site file", one_line(loaded.path.name)),
        ("Lifts", ", ".join(lift.name for lift in lifts)),
        ("Directions", "lift → manager: a signal of the lift. manager → lift: a command of the lift manager."),
        (
            "Addresses",
            "printed: as in the map or its source. On the wire: in the request itself, where the first one is 0.",
        ),
        ("Normal state", "NO, normally open: closes (1) for what is named. NC, normally closed: opens (0) for it."),
    )
    return IoList(one_line(site.name), facts, lifts, tuple(one_line(line) for line in loaded.cautions()))


def _lift(loaded: LoadedSite, name: str, lift: Lift) -> LiftList:
    found = loaded.maps[name]
    codec = loaded.codecs[name]
    placed = devices(loaded.site, lift, found.map)
    floors = {floor: entry.code for floor, entry in lift.floors.items()}
    return LiftList(
        name=one_line(name),
        facts=tuple((label, one_line(text)) for label, text in _facts(loaded, lift, found, codec, placed)),
        points=tuple(io_points(codec, floors, placed)),
        controller=_where(loaded, placed[""]),
        map=found.map.name,
        sha256=found.sha256,
    )


def _facts(
    loaded: LoadedSite, lift: Lift, found: LoadedMap, codec: Codec, placed: Mapping[str, Device]
) -> Iterator[tuple[str, str]]:
    source = found.map
    for endpoint, device in placed.items():
        yield ("Controller" if not endpoint else f"Second device {endpoint}"), _where(loaded, device)
    yield "Map", f"{source.name} ({source.provenance.trust}): {source.title}"
    yield "Fingerprint of the map (sha256)", found.sha256
    if found.parameters:
        yield "Parameters", ", ".join(f"{name} = {value}" for name, value in found.parameters.items())
    if changed := MapChanges(override=lift.override).keys:
        yield "Changed by the site", ", ".join(changed)
    if moved := {table.value: by for table, by in lift.offset.items() if by}:
        yield "Moved by", ", ".join(f"{table} {by:+d}" for table, by in moved.items()) + " from the printed address"
    yield "Floors, lowest first", ", ".join(_floors(lift))
    yield (
        "Access",
        {"control": "control: the manager commands the lift", "monitor": "monitor: nothing is written"}[lift.access],
    )
    yield "Fire", fire(source)
    if "car_floor" in codec.signals:
        yield "The car is at a floor by", at_floor(source)
    for block, function, every_s in codec.written:
        cycle = "" if every_s is None else f", every {every_s:g} s"
        last = block.start + block.count - 1
        yield "Written as a whole", f"{block.table} {block.start} to {last} on the wire, FC{function:02}{cycle}"
    if carried := arbitration(codec):
        yield "Each write carries", carried
    if source.watchdog_s is not None:
        yield "Its watchdog runs out", f"{source.watchdog_s:g} s after the last write"


def _floors(lift: Lift) -> Iterator[str]:
    for name, floor in lift.floors.items():
        doors = f" (door {' and '.join(floor.doors)})" if floor.doors else ""
        yield f"{name} = {floor.code}{doors}"


def _where(loaded: LoadedSite, device: Device) -> str:
    controller = loaded.site.controllers[device.controller]
    return one_line(f"{device.controller}: {controller.host}, port {controller.port}, unit id {device.unit_id}")
