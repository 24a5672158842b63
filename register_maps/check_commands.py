"""Checks that each command of a map is complete and bounded: its points, values, action and times."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from register_maps.address import Place
from register_maps.check_confirm import is_known
from register_maps.check_signals import check_codes
from register_maps.error_texts import closest
from register_maps.errors import Problem
from register_maps.schema import CALLS, COMMANDS, Command, RegisterMap
from register_maps.words import BIT_TABLES, WRITABLE_TABLES, Table

Messages = Iterator[tuple[tuple[str | int, ...], str]]

_OF_A_HOLD = ("until", "max_hold_s", "refresh_s", "on_link_loss", "bounded_by", "repeat_pulse_s")
_OF_A_HEARTBEAT = frozenset({"at", "action", "every_s", "type", "byte_order", "rest", "shared_word", "note"})
_REFUSED_ANYWAY = frozenset({"one_of", "as_", "until", "read_at", "read_one_of"})
"""Keys of a heartbeat that other rules refuse."""

_ALIASES = {"on": "press", "as_": "as"}
_KEPT_ON = ("robot_mode", "hold_door.")


def check_commands(source: RegisterMap) -> Iterator[Problem]:
    """Yield the problems of every command by itself."""
    for name, command in source.commands.items():
        path = ("commands", name)
        if name not in COMMANDS:
            hint = closest(name, COMMANDS) or f"; commands are {', '.join(COMMANDS)}"
            yield Problem(path, f"there is no command of this name{hint}")
            continue
        for rule in _RULES:
            for key, message in rule(source, name, command):
                yield Problem((*path, *key), message)


def is_bit(place: Place) -> bool:
    """Whether a place is one bit: a coil, a discrete input, or a bit of a register."""
    return place.table in BIT_TABLES or place.bit is not None


def _floors(_: RegisterMap, name: str, command: Command) -> Messages:
    if name not in CALLS:
        yield from _of_no_call(name, command)
        return
    if command.one_of is None and command.as_ is None:
        yield (), f"{name} carries a floor: use `as: floor` for a number, or `one_of` for one output per floor"
    if command.codes is not None and command.one_of is None:
        yield ("codes",), "belongs to `one_of`, with one output per floor; a number is the floor code itself"
    if command.one_of is not None:
        yield from _outputs(command)


def _of_no_call(name: str, command: Command) -> Messages:
    for key in ("as_", "one_of"):
        if getattr(command, key) is not None:
            yield (
                (_ALIASES.get(key, key),),
                f"belongs to a call ({', '.join(CALLS)}), and {name} has no floor; remove it",
            )
    if command.is_heartbeat:
        return
    for key in ("codes", "code"):
        if key in command.model_fields_set:
            yield (key,), f"belongs to a call ({', '.join(CALLS)}), and {name} has no floor; remove it"
    if "arrive_within_s" in command.model_fields_set:
        yield ("arrive_within_s",), f"belongs to a call, and {name} goes nowhere; remove it"


def _outputs(command: Command) -> Messages:
    """Yield what is wrong with one output per floor."""
    yield from check_codes(command.codes, command.one_of, "outputs")
    if command.as_ is not None:
        yield ("as",), "`one_of` is one output per floor already; remove `as`"
    if command.rest != 0:
        yield ("rest",), "outputs of `one_of` rest at 0; remove `rest`"
    if "on" in command.model_fields_set:
        yield ("press",), "outputs of `one_of` are pressed with 1; remove `press`"
    for key in ("code", "byte_order"):
        if key in command.model_fields_set:
            yield (key,), "is for a number in a register, and `one_of` has one bit per floor; remove it"


def _point(source: RegisterMap, __: str, command: Command) -> Messages:
    for key, text in command.keyed_addresses:
        place = source.place(text)
        if place.table not in WRITABLE_TABLES:
            yield key, f"a {place.table} cannot be written; commands are coils or holding registers"
    if command.at is None:
        return
    place = source.place(command.at)
    if is_bit(place):
        yield from _bit(place, command)
    low, high = (0, 1) if is_bit(place) else (0, 0xFFFF) if command.type == "uint16" else (-0x8000, 0x7FFF)
    sort = "a coil" if place.table is Table.COIL else "a bit" if is_bit(place) else command.type
    for name, value in (("press", command.on), ("rest", command.rest)):
        if not low <= value <= high:
            yield (name,), f"{value} does not fit: {sort} holds {low} to {high}"
    if command.as_ is not None and "on" in command.model_fields_set:
        yield ("press",), "a call writes its floor, not a fixed value; remove `press`"
    if command.code == "bcd" and command.type == "int16":
        yield ("code",), "BCD has no sign; use `type: uint16`"


def _bit(place: Place, command: Command) -> Messages:
    if command.as_ is not None:
        what = "a coil" if place.table is Table.COIL else "a bit"
        yield ("at",), f"{what} cannot carry a floor number; give a holding register, or `one_of`"
    if place.bit is not None and command.type == "int16":
        yield ("type",), "int16 needs a whole register, and this is 1 bit; use uint16"
    if command.byte_order == "low_first":
        yield ("byte_order",), "is for a whole register, and this is 1 bit; remove it"


def _read_back(source: RegisterMap, _: str, command: Command) -> Messages:
    reads = command.keyed_read_addresses
    if not reads:
        return
    if command.read_at is not None and command.read_one_of is not None:
        yield ("read_at",), "`read_at` goes with `at`, and `read_one_of` with `one_of`; remove one of the two"
        return
    form, needed = ("at", "read_at") if command.at is not None else ("one_of", "read_one_of")
    given = "read_at" if command.read_at is not None else "read_one_of"
    if given != needed:
        yield (given,), f"the command is written with `{form}`; use `{needed}`"
        return
    if command.ends_itself or command.is_heartbeat:
        why = "a heartbeat changes all the time" if command.is_heartbeat else "the device ends this pulse by itself"
        yield (given,), f"{why}, and it is not read back; remove it"
    if len(reads) != len(command.keyed_addresses):
        yield (given,), f"has {len(reads)} entries for {len(command.keyed_addresses)} outputs; give one for each"
    for (key, text), at in zip(reads, command.addresses, strict=False):
        if is_bit(source.place(text)) != is_bit(source.place(at)):
            sort = "a single bit" if is_bit(source.place(at)) else "a whole register"
            yield key, f"{at} is {sort}, and {text} is not; read it back from {sort}"


def _action(_: RegisterMap, name: str, command: Command) -> Messages:
    if (name == "heartbeat") is not command.is_heartbeat:
        if name == "heartbeat":
            yield ("action",), "the heartbeat has to keep changing; use `action: count` or `action: toggle`"
        else:
            yield ("action",), f"`{command.action}` is for the heartbeat; use `action: pulse` or `action: hold`"
    elif command.action == "pulse" and name.startswith(_KEPT_ON):
        cure = "use `action: hold`; for a controller that needs repeated presses use `repeat_pulse_s` with it"
        yield ("action",), f"it has to be kept on, and a pulse is never repeated; {cure}"
    if command.action != "hold" and not command.is_heartbeat:
        for key in _OF_A_HOLD:
            if getattr(command, key) is not None:
                yield (key,), "belongs to `action: hold`; a pulse ends after `width_s`, or when the manager is back"
    if command.action == "hold" and command.width_s is not None and command.repeat_pulse_s is None:
        yield ("width_s",), "belongs to `action: pulse`; a hold is bounded by `max_hold_s`"
    if command.timed_by == "device" and command.action == "hold":
        yield ("timed_by",), "is for a pulse; for a hold that the device ends use `on_link_loss: timed_by_device`"


def _taken(_: RegisterMap, name: str, command: Command) -> Messages:
    given = [key for key in ("self_clearing", "cleared_after_s") if getattr(command, key) and not command.is_heartbeat]
    fits = command.action == "hold" and command.repeat_pulse_s is None and name not in CALLS
    for key in given:
        if not fits:
            cure = (
                "a call that the controller takes over and clears has `timed_by: device`"
                if name in CALLS
                else "remove it"
            )
            yield (key,), f"belongs to a hold that is one level and no call; {cure}"
        elif command.refresh_s is None:
            yield (key,), "a hold that the controller clears has to be written again: use `refresh_s`"
    if fits and command.self_clearing:
        yield from _self_clearing(command)
    elif fits and (command.cleared_after_s or 0.0) <= (command.refresh_s or 0.0) and given:
        yield ("cleared_after_s",), "is not longer than `refresh_s`: use `self_clearing: true` instead"


def _self_clearing(command: Command) -> Messages:
    if command.cleared_after_s is not None:
        yield ("cleared_after_s",), "`self_clearing` is cleared at once; remove one of the two"
    confirms = command.confirm.any_of if command.confirm is not None else ("readback",)
    if "readback" in confirms:
        cure = "name what shows the hold, such as `confirm: {any_of: [effect], within_s: 10}`"
        yield ("self_clearing",), f"a point that the controller clears confirms nothing; {cure}"


def _heartbeat(source: RegisterMap, name: str, command: Command) -> Messages:
    if name != "heartbeat" or not command.is_heartbeat:
        if name != "heartbeat" and command.every_s is not None:
            yield ("every_s",), "belongs to the heartbeat; a hold is written again every `refresh_s`"
        return
    if command.every_s is None:
        yield (), "a heartbeat needs `every_s`: how often it is written"
    elif command.every_s < source.link.min_gap_s:
        message = f"cannot be kept: the link leaves {source.link.min_gap_s:g} s between requests (min_gap_s); give more than that"
        yield ("every_s",), message
    if command.at is not None and command.action == "count" and is_bit(source.place(command.at)):
        yield ("action",), "a count needs a whole register; in a bit use `action: toggle`"
    for key in sorted(command.model_fields_set - _OF_A_HEARTBEAT - _REFUSED_ANYWAY):
        yield (_ALIASES.get(key, key),), "a heartbeat is written all the time and never pressed; remove it"


def _until(source: RegisterMap, name: str, command: Command) -> Messages:
    match command.until:
        case "arrived" if name not in CALLS:
            yield ("until",), f"belongs to a call ({', '.join(CALLS)}), and {name} goes nowhere; remove it"
        case "arrived" if not is_known(source, "car_floor"):
            yield ("until",), "the arrival of the car is not visible without car_floor; declare it, or remove `until`"
        case "closed" if not name.startswith("close_door."):
            yield ("until",), "`closed` ends close_door; remove it"
        case "closed":
            door = f"door.{name.partition('.')[2]}"
            if not is_known(source, door):
                yield ("until",), f"a closed door is not visible without {door}; declare it, or remove `until`"
        case "robot_in_place" | "robot_left" as end:
            if name not in ("call", "go"):
                yield ("until",), f"`{end}` ends call or go, the calls of a robot outside and aboard; remove it"
            elif end not in source.commands:
                yield ("until",), f"the map has no command {end}; declare it, or remove `until`"
        case _:
            pass


def _times(_: RegisterMap, name: str, command: Command) -> Messages:
    for key in ("refresh_s", "repeat_pulse_s"):
        given = getattr(command, key)
        if given is not None and command.max_hold_s is not None and given >= command.max_hold_s:
            cure = "refresh sooner" if key == "refresh_s" else "repeat sooner"
            yield (key,), f"{given:g} s is not before max_hold_s, {command.max_hold_s:g} s; {cure}"
    if command.repeat_pulse_s is not None:
        if command.width_s is not None and command.repeat_pulse_s <= command.width_s:
            message = f"each pulse lasts {command.width_s:g} s and has to end before the next; give more than that"
            yield ("repeat_pulse_s",), message
        if command.refresh_s is not None:
            message = "a hold is either written again, or pressed again every `repeat_pulse_s`; remove one of the two"
            yield ("refresh_s",), message
    if command.gap_s and not command.excludes:
        yield ("gap_s",), "is the pause after the release of what `excludes` names; use `excludes`, or remove it"
    if command.released_after_s is not None:
        yield from _released(name, command, command.released_after_s)
    if "granted_within_s" in command.model_fields_set and command.granted_by is None:
        yield ("granted_within_s",), "belongs to `granted_by`; declare what grants it, or remove this"


def _released(name: str, command: Command, released_after_s: float) -> Messages:
    """Yield what is wrong with the time after which the controller lets a held door go by itself."""
    if not name.startswith("hold_door."):
        cure = "for a controller that ends robot mode after a time set `max_session_s` of the lift in the site file below it"
        yield ("released_after_s",), f"belongs to a door hold; {cure if name == 'robot_mode' else 'remove it'}"
        return
    for key in ("refresh_s", "repeat_pulse_s"):
        again_s = getattr(command, key)
        if again_s is not None and again_s >= released_after_s:
            message = f"{released_after_s:g} s is over before the hold is written again ({key}: {again_s:g}); correct one of the two"
            yield ("released_after_s",), message


def _payload(source: RegisterMap, _: str, command: Command) -> Messages:
    payload = command.payload
    if payload is None or command.is_heartbeat:
        return
    if command.as_ is not None:
        yield ("payload",), "a call writes its floor, and cannot carry a time; remove `payload`"
        return
    if command.one_of is not None and not command.ends_itself:
        yield ("payload",), "one output per floor carries a time only if the device ends it; use `timed_by: device`"
        return
    needed = "width_s" if command.action == "pulse" else "max_hold_s"
    if payload.time != needed:
        yield ("payload", "time"), f"the time of a {command.action} is `{needed}`; use `time: {needed}`"
        return
    if command.at is not None and "on" in command.model_fields_set:
        yield ("press",), "the value written is the time; remove `press`, or `payload`"
    places = [source.place(text) for text in command.addresses]
    if any(place.bit is not None for place in places):
        yield ("payload",), "a bit cannot carry a time; give a whole register"
        return
    if any(place.table is Table.COIL for place in places) and not command.ends_itself:
        message = (
            "a coil takes a time only for a pulse that the device ends; use `action: pulse` and `timed_by: device`"
        )
        yield ("payload",), message
    seconds = command.width_s if command.action == "pulse" else command.max_hold_s
    most = 0xFFFF if all(_takes_a_word(place, command) for place in places) else 0x7FFF
    for message in _counts(seconds or 0.0, payload.unit_s, most):
        yield (needed,), message


def _takes_a_word(place: Place, command: Command) -> bool:
    return place.table is not Table.COIL and command.type == "uint16"


def _counts(seconds: float, unit_s: float, most: int) -> Iterator[str]:
    counts = seconds / unit_s
    if abs(counts - round(counts)) > 1e-6:
        yield f"{seconds:g} s is {counts:g} counts of {unit_s:g} s; give a whole number of them"
    elif not 1 <= round(counts) <= most:
        yield f"{seconds:g} s is {counts:.0f} counts of {unit_s:g} s, and 1 to {most} can be written; give a time that fits"


_RULES: tuple[Callable[[RegisterMap, str, Command], Messages], ...] = (
    _floors,
    _point,
    _read_back,
    _action,
    _taken,
    _heartbeat,
    _until,
    _times,
    _payload,
)
