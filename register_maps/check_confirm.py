"""Checks the names in the commands of a map: required signals, excluded commands and proofs."""

from __future__ import annotations

from collections.abc import Iterator

from register_maps.check_claims import bits_at, readable_addresses, signal_bits
from register_maps.error_texts import closest
from register_maps.errors import Problem
from register_maps.schema import CALLS, COMMANDS, SAFETY_FLAGS, SIGNALS, Command, Kind, RegisterMap
from register_maps.vocabulary import LAMPS
from register_maps.words import Side

Messages = Iterator[tuple[tuple[str | int, ...], str]]

_SHOWS_EFFECT: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(CALLS, ("car_floor", "motion")),
    "robot_mode": ("robot_mode_on",),
    "robot_in_place": (),
    "robot_left": (),
}
"""Signals that show the effect of a command. The reaction to the robot signals differs from lift to lift."""

_TROUBLE = (SAFETY_FLAGS - {"independent"}) | {
    *("overload", "nudging", "watchdog_tripped"),
    *(f"obstruction.{side}" for side in Side),
}
"""Flags that mean trouble when set, so a press neither waits for them nor is proved by them. Not `independent`: some lifts grant robots this mode."""


def check_confirm(source: RegisterMap) -> Iterator[Problem]:
    """Yield unknown names, and proofs that prove nothing."""
    for name, command in source.commands.items():
        if name not in COMMANDS:
            continue
        path = ("commands", name)
        for rule in (_names, _proofs):
            for key, message in rule(source, name, command):
                yield Problem((*path, *key), message)
        if _only_an_open_door(source, name, command):
            message = "the door may be open by itself, and then `effect` does not show that we hold it; add readback"
            yield Problem((*path, "confirm"), message, warning=True)
        if command.confirm is not None or command.is_heartbeat:
            continue
        if command.action == "hold":
            yield Problem(path, "a hold needs `confirm`, such as {any_of: [readback], within_s: 2}")
        else:
            otherwise = "" if command.ends_itself else " unless it reads back"
            message = f"nothing confirms this press; use `confirm`, such as {{any_of: [effect], within_s: 10}}, or it counts as unconfirmed{otherwise}"
            yield Problem(path, message, warning=True)


def _only_an_open_door(source: RegisterMap, name: str, command: Command) -> bool:
    """Whether an open door alone proves a door hold although its output can be read back."""
    if not name.startswith("hold_door.") or command.confirm is None:
        return False
    return set(command.confirm.any_of) == {"effect"} and _unreadable(source, command) is None


def is_known(source: RegisterMap, name: str) -> bool:
    """Whether a signal is declared, or has to be added by the site."""
    return name in source.signals or name in source.needs


def _names(source: RegisterMap, name: str, command: Command) -> Messages:
    named: list[tuple[tuple[str | int, ...], str]] = []
    named += [(("requires", index), flag) for index, flag in enumerate(command.requires)]
    if command.granted_by is not None:
        named.append((("granted_by",), command.granted_by))
    for place, flag in named:
        if not is_known(source, flag):
            yield place, _absent(flag, source)
        elif SIGNALS.get(flag) is not Kind.FLAG:
            yield place, f"{flag} is no flag; name one that reads yes or no"
        elif flag in _TROUBLE:
            why = f"`requires` waits for a yes and cannot be inverted, and a yes of {flag} is trouble"
            yield place, f"{why}; remove it, since {flag} is respected without being named"
    for index, other in enumerate(command.excludes):
        if other == name:
            yield ("excludes", index), "a command cannot exclude itself; remove it"
        elif other not in source.commands:
            hint = closest(other, source.commands)
            yield ("excludes", index), f"the map has no command {other}{hint or '; remove it, or declare the command'}"
        elif source.commands[other].is_heartbeat:
            yield ("excludes", index), f"{other} is never released, so nothing can exclude it; remove it"


def _proofs(source: RegisterMap, name: str, command: Command) -> Messages:
    if command.confirm is None or command.is_heartbeat:
        return
    for index, word in enumerate(command.confirm.any_of):
        if word == "effect":
            message = _unseen(source, name)
        elif word == "readback":
            message = _unreadable(source, command)
        else:
            message = _unfit(source, name, command, word)
        if word in command.requires:
            message = f"{word} has to read yes before the press, so it proves nothing after it; name another proof"
        if message is not None:
            yield ("confirm", "any_of", index), message


def _unseen(source: RegisterMap, name: str) -> str | None:
    """Return why the effect of a command is not visible; None if it is."""
    shown_by = _SHOWS_EFFECT.get(name, (f"door.{name.partition('.')[2]}",))
    if any(is_known(source, signal) for signal in shown_by):
        return None
    if not shown_by:
        return f"lifts differ in what follows {name}; use `readback`, or the flag with which this lift answers"
    return f"the effect cannot be seen without {' or '.join(shown_by)}; declare it, or name another proof"


def _unreadable(source: RegisterMap, command: Command) -> str | None:
    """Return why reading back proves nothing about a command; None if it does."""
    if command.ends_itself:
        return "the device ends this pulse by itself, and may have done so before it is read; name another proof"
    if command.repeat_pulse_s is not None:
        return "between its pulses it reads as released; name another proof, such as effect"
    bits = {bit for _, text in readable_addresses(command) for bit in bits_at(source, text)}
    for lamp in (name for name in LAMPS if name in source.signals):
        signal = source.signals[lamp]
        if any(not bits.isdisjoint(signal_bits(source, signal, text)) for text in signal.addresses):
            return f"what is read there is the lamp {lamp}, lit or not whatever we wrote; name {lamp} instead"
    return None


def _unfit(source: RegisterMap, name: str, command: Command, word: str) -> str | None:
    """Return why a signal cannot prove a command; None if it can."""
    kind = SIGNALS.get(word)
    if not is_known(source, word):
        return _absent(word, source, "effect", "readback")
    if kind not in (Kind.FLAG, Kind.FLOOR, Kind.FLOORS):
        return f"{word} is a {kind}; only a flag or a floor confirms"
    if word in _TROUBLE:
        return f"a yes of {word} is trouble and proves no press, and a proof cannot be inverted; name another proof"
    if kind is Kind.FLAG:
        return None
    if name not in CALLS:
        return f"{word} is a {kind}, and only a call has a floor to compare with; name a flag"
    signal = source.signals.get(word)
    lamps = (signal.one_of or signal.each_of) if signal is not None else None
    if lamps is not None and command.one_of is not None and len(lamps) < len(command.one_of):
        return f"{word} has {len(lamps)} bits for {len(command.one_of)} outputs, and cannot confirm the last; list them all"
    return None


def _absent(name: str, source: RegisterMap, *others: str) -> str:
    hint = closest(name, (*source.signals, *others))
    return f"the map has no signal {name}{hint or '; declare it under `signals`, or remove it'}"
