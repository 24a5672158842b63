"""Whether each command of a map is complete, bounded, and can be confirmed."""

from __future__ import annotations

from collections.abc import Iterator

from register_maps.errors import Problem
from register_maps.plain import closest
from register_maps.schema import COMMANDS, SIGNALS, Command, Kind, RegisterMap, parse_address
from register_maps.words import WRITABLE_TABLES, Table

Said = Iterator[tuple[tuple[str | int, ...], str]]

_OF_A_HOLD = ("until", "max_hold_s", "refresh_s", "on_link_loss", "bounded_by")
_SHOWS_EFFECT = {"go_to": ("car_floor", "motion"), "robot_mode": ("robot_mode_on",)}


def check_commands(source: RegisterMap) -> Iterator[Problem]:
    """Yield the problems of every command by itself and of what it names."""
    for name, command in source.commands.items():
        path = ("commands", name)
        if name not in COMMANDS:
            hint = closest(name, COMMANDS) or f"; commands are {', '.join(COMMANDS)}"
            yield Problem(path, f"there is no command of this name{hint}")
            continue
        for check in (_floors, _point, _action, _names, _confirm):
            for key, message in check(source, name, command):
                yield Problem((*path, *key), message)
        if command.action == "pulse" and command.confirm is None:
            message = "nothing confirms this press; say `confirm`, or it counts as unconfirmed unless it reads back"
            yield Problem(path, message, warning=True)


def _floors(_: RegisterMap, name: str, command: Command) -> Said:
    if name != "go_to":
        for key, given in (("as", command.as_), ("one_of", command.one_of), ("until", command.until)):
            if given is not None:
                yield (key,), "belongs to go_to, the only command with a floor; remove it"
        return
    if command.one_of is None and command.as_ is None:
        yield (), "go_to carries a floor: say `as: floor` for a number, or `one_of` for one output per floor"
    if command.one_of is not None and command.as_ is not None:
        yield ("as",), "`one_of` is one output per floor already; remove `as`"
    if command.one_of is not None and command.rest != 0:
        yield ("rest",), "outputs of `one_of` rest at 0; remove `rest`"


def _point(_: RegisterMap, __: str, command: Command) -> Said:
    for key, address in address_keys(command):
        table, number, bit = parse_address(address)
        if table not in WRITABLE_TABLES:
            yield key, f"a {table} cannot be written; commands are coils or holding registers"
        elif bit is not None:
            cure = f"give the whole register, holding:{number}, if the device allows that"
            yield key, f"a bit in a register needs read-modify-write, which is not supported yet; {cure}"
    if command.at is None:
        return
    table = parse_address(command.at)[0]
    if table is Table.COIL and command.as_ is not None:
        yield ("at",), "a coil cannot carry a floor number; give a holding register, or `one_of`"
    low, high = (0, 1) if table is Table.COIL else (0, 0xFFFF) if command.type == "uint16" else (-0x8000, 0x7FFF)
    sort = "a coil" if table is Table.COIL else command.type
    for name, value in (("press", command.on), ("rest", command.rest)):
        if not low <= value <= high:
            yield (name,), f"{value} does not fit: {sort} holds {low} to {high}"
    if command.as_ is not None and "on" in command.model_fields_set:
        yield ("press",), "a call writes its floor, not a fixed value; remove `press`"


def _action(_: RegisterMap, name: str, command: Command) -> Said:
    if command.action == "pulse":
        if name.startswith("hold_door.") or name == "robot_mode":
            yield ("action",), "it has to be kept on, and a pulse is never repeated; use `action: hold`"
        for key in _OF_A_HOLD:
            if getattr(command, key) is not None:
                yield (key,), "belongs to `action: hold`; a pulse ends by itself after `width_s`"
        return
    if command.width_s is not None:
        yield ("width_s",), "belongs to `action: pulse`; a hold is bounded by `max_hold_s`"
    if command.refresh_s is not None and command.max_hold_s is not None and command.refresh_s >= command.max_hold_s:
        message = f"{command.refresh_s:g} s is not before max_hold_s, {command.max_hold_s:g} s; refresh sooner"
        yield ("refresh_s",), message
    if command.confirm is None:
        yield (), "a hold needs `confirm`, such as {any_of: [readback], within_s: 2}"


def _names(source: RegisterMap, name: str, command: Command) -> Said:
    named: list[tuple[tuple[str | int, ...], str]] = []
    named += [(("requires", index), flag) for index, flag in enumerate(command.requires)]
    if command.granted_by is not None:
        named.append((("granted_by",), command.granted_by))
    for place, flag in named:
        if flag not in source.signals:
            yield place, _absent(flag, source)
        elif SIGNALS.get(flag) is not Kind.FLAG:
            yield place, f"{flag} is no flag; name one that reads yes or no"
    for index, other in enumerate(command.excludes):
        if other == name:
            yield ("excludes", index), "a command cannot exclude itself; remove it"
        elif other not in source.commands:
            hint = closest(other, source.commands)
            yield ("excludes", index), f"the map has no command {other}{hint or '; remove it, or declare the command'}"


def _confirm(source: RegisterMap, name: str, command: Command) -> Said:
    for index, word in enumerate(command.confirm.any_of if command.confirm is not None else ()):
        key = ("confirm", "any_of", index)
        kind = SIGNALS.get(word)
        if word == "effect":
            shown_by = _SHOWS_EFFECT.get(name, (f"door.{name.partition('.')[2]}",))
            if not any(signal in source.signals for signal in shown_by):
                yield (
                    key,
                    f"the effect cannot be seen without {' or '.join(shown_by)}; declare it, or name another proof",
                )
        elif word == "readback":
            continue
        elif word not in source.signals:
            yield key, _absent(word, source, "effect", "readback")
        elif kind not in (Kind.FLAG, Kind.FLOOR):
            yield key, f"{word} is a {kind}; only a flag or a floor confirms"
        elif kind is Kind.FLOOR and name != "go_to":
            yield key, f"{word} is a floor, and only go_to has one to compare with; name a flag"


def address_keys(command: Command) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Every address of a command with its key."""
    if command.at is not None:
        yield ("at",), command.at
    for index, address in enumerate(command.one_of or ()):
        yield ("one_of", index), address


def _absent(name: str, source: RegisterMap, *others: str) -> str:
    hint = closest(name, (*source.signals, *others))
    return f"the map has no signal {name}{hint or '; declare it under `signals`, or remove it'}"
