"""Checks the evidence that robots rely on: the car at its floor, the door, fire, and devices that release by themselves."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Set as AbstractSet

from register_maps.check_blocks import Cell, blocked_cells
from register_maps.check_confirm import is_known
from register_maps.error_texts import closest
from register_maps.errors import Problem
from register_maps.schema import SIGNALS, Command, RegisterMap, Signal
from register_maps.words import Side


def check_evidence(source: RegisterMap) -> Iterator[Problem]:
    """Yield claims of the map that it cannot show."""
    yield from _needs(source)
    yield from _at_floor(source)
    yield from _fire(source)
    yield from _watchdogs(source)


def _needs(source: RegisterMap) -> Iterator[Problem]:
    for name, reason in source.needs.items():
        path = ("needs", name)
        if name not in SIGNALS:
            hint = closest(name, SIGNALS) or f"; signals are {', '.join(SIGNALS)}"
            yield Problem(path, f"there is no signal of this name{hint}")
        elif name in source.signals:
            yield Problem(path, "the map declares this signal itself; remove this line")
        elif not reason.strip():
            yield Problem(path, "give the reason why a site has to add it; it is shown to the author of the site file")


def _at_floor(source: RegisterMap) -> Iterator[Problem]:
    evidence = source.at_floor_evidence
    path = ("at_floor_evidence",)
    needed = {"level": "level", "motion_stopped": "motion"}.get(evidence.kind)
    if needed is not None and not is_known(source, needed):
        cure = f"declare `{needed}`, or use {{kind: position_stable, for_s: 1.0}}"
        yield Problem(path, f"the map has no signal {needed} to show that the car stands; {cure}")
    if evidence.kind == "door_open" and not any(is_known(source, f"door.{side}") for side in Side):
        yield Problem(path, "the map has no door to show that the car stands; declare `door.front`")
    floor = source.signals.get("car_floor")
    by_number = floor is not None and (floor.at or floor.code_of) and floor.positions is None
    shows_the_last = floor is not None and by_number and not (*floor.unknown, *floor.none)
    if evidence.kind == "position_stable" and shows_the_last and "motion" not in source.signals:
        message = (
            "a floor number that shows the floor last passed stays the same between floors, so it proves nothing; use "
            "{kind: door_open}, or declare which code means between floors (`unknown`)"
        )
        yield Problem(path, message, warning=True)
    if evidence.kind == "door_limit" and not _limits_show_floor(source):
        message = (
            "door_limit means that the open limit of each floor is also its floor switch: give a door `open_limits` and "
            "car_floor `one_of` with the same addresses and codes in the same order, or use {kind: position_stable, for_s: 1.0}"
        )
        yield Problem(path, message)


def _limits_show_floor(source: RegisterMap) -> bool:
    if any(name == "car_floor" or name.startswith("door.") for name in source.needs):
        return True  # the site adds it, and the result is checked then
    floor = source.signals.get("car_floor")
    doors = [signal for name, signal in source.signals.items() if name.startswith("door.")]
    return floor is not None and any(_same_bits(source, floor, door) for door in doors)


def _same_bits(source: RegisterMap, floor: Signal, door: Signal) -> bool:
    if floor.one_of is None or door.open_limits is None or len(floor.one_of) != len(door.open_limits):
        return False
    pairs = zip(map(source.place, floor.one_of), map(source.place, door.open_limits), strict=True)
    same_codes = floor.floor_codes == door.floor_codes
    return same_codes and all((a.space, a.number, a.bit) == (b.space, b.number, b.bit) for a, b in pairs)


def _fire(source: RegisterMap) -> Iterator[Problem]:
    mode = source.signals.get("mode")
    visible = is_known(source, "fire") or (mode is not None and "fire" in (mode.values or {}).values())
    if visible and "fire" in source.not_visible:
        yield Problem(("not_visible", "fire"), "the map has a fire signal; remove this line")
    if not visible and not source.not_visible.get("fire", "").strip():
        cure = "declare `fire`, or give the reason: `not_visible: {fire: ...}`; every face shows it"
        yield Problem(("not_visible",), f"the map has no fire signal, and no mode that means fire; {cure}")


def _watchdogs(source: RegisterMap) -> Iterator[Problem]:
    """Yield holds that the device releases by itself because nothing of ours prevents it."""
    cyclic = blocked_cells(source, cyclic=True)
    for name, command in source.commands.items():
        if command.action != "hold" or command.refresh_s is not None or command.repeat_pulse_s is not None:
            continue
        if command.on_link_loss == "device_watchdog" and not _is_fed(source, command, cyclic):
            yield Problem(("commands", name, "on_link_loss"), _unfed_message(source))
        if command.on_link_loss == "timed_by_device":
            message = (
                "the device ends it after its own time, even while we still hold: use `refresh_s`, shorter than "
                f"max_hold_s, {command.max_hold_s:g} s"
            )
            yield Problem(("commands", name, "on_link_loss"), message)


def _is_fed(source: RegisterMap, command: Command, cyclic: AbstractSet[Cell]) -> bool:
    """Whether the heartbeat or a cyclic block feeds the watchdog of every device of a command."""
    beat = source.commands.get("heartbeat")
    endpoints = {source.place(text).endpoint for text in beat.addresses} if beat is not None else set()
    places = map(source.place, command.addresses)
    return all(place.endpoint in endpoints or (place.space, place.number) in cyclic for place in places)


def _unfed_message(source: RegisterMap) -> str:
    elsewhere = "the heartbeat goes to another device; " if "heartbeat" in source.commands else ""
    return (
        f"a device that releases its outputs when nobody writes does so also during our holds: {elsewhere}declare "
        f"{'the' if elsewhere else 'a'} heartbeat at this device if its table names a register that the client has to change; else use "
        "`refresh_s`, shorter than its watchdog, or a write block with `every_s`"
    )
