"""Lists what holds of a lift because neither its map nor its site says otherwise. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from register_maps.check_commands import is_bit
from register_maps.schema import CALLS, SIGNALS, Command, Kind, LinkDefaults, RegisterMap, Signal

_DEFAULT = LinkDefaults()
_LINK: dict[str, str] = {
    "unit_id": f"the controller answers as unit {_DEFAULT.unit_id}",
    "max_connections": "it has a connection free for us",
    "min_gap_s": "requests may follow one another without a pause",
    "min_poll_s": "it may be polled at any pace",
    "timeout_s": f"its answers come within {_DEFAULT.timeout_s:g} s",
    "max_registers_per_read": f"one request may read {_DEFAULT.max_registers_per_read} registers",
    "idle_timeout_s": "a connection stays open however long it is silent",
    "tid_echo": "its answers repeat the transaction id of the request",
}
"""Keys of `link`, with what is assumed without them."""


def assumptions(source: RegisterMap, given: Collection[str] = ()) -> tuple[str, ...]:
    """Return what a checked map leaves to its defaults, a line each with the key that would say otherwise.

    `given` are the keys of `link` that the site gives.
    """
    return (*_of_link(source, given), *_of_signals(source), *_of_commands(source))


def _of_link(source: RegisterMap, given: Collection[str]) -> Iterator[str]:
    for key, text in _LINK.items():
        if key not in source.link.model_fields_set and key not in given:
            yield f"{text} (`{key}`)"


def _of_signals(source: RegisterMap) -> Iterator[str]:
    own = {name: signal for name, signal in source.signals.items() if name not in source.derived}
    parts: list[tuple[str, Signal | Command]] = [*own.items(), *source.commands.items()]
    words = {name: part for name, part in parts if _is_word(source, part)}
    if any("byte_order" not in part.model_fields_set for part in words.values()):
        yield "the high byte of a register comes first (`byte_order`)"
    numbers = [
        name
        for name, signal in own.items()
        if name in words
        and (SIGNALS[name] in (Kind.FLOOR, Kind.NUMBER) or signal.thresholds)
        and "type" not in signal.model_fields_set
    ]
    if numbers:
        yield f"never negative: {', '.join(numbers)} (`type`)"
    contacts = [
        name
        for name, signal in own.items()
        if name not in words and SIGNALS[name] in (Kind.FLAG, Kind.DOOR) and _is_plain_contact(source, signal)
    ]
    if contacts:
        yield f"1 means yes, or open: {', '.join(contacts)} (`active: low` inverts)"
    if listed := [name for name, part in parts if part.floor_codes and part.codes is None]:
        yield f"the first entry is floor code 0, the next one 1 and so on: {', '.join(listed)} (`codes`)"


def _of_commands(source: RegisterMap) -> Iterator[str]:
    commands = source.commands
    if not commands:
        return
    plain = [name for name, command in commands.items() if _is_pressed_with_one(command)]
    if plain:
        yield f"1 presses and 0 releases: {', '.join(plain)} (`press`, `rest`)"
    if "heartbeat" not in commands:
        yield "it needs no sign of life from us (`heartbeat`)"
    watched = [name for name, command in commands.items() if command.on_link_loss == "device_watchdog"]
    if watched and "watchdog_time" not in source.signals:
        yield f"its watchdog is switched on and releases {', '.join(watched)} without us (`watchdog_time`)"
    kept = [
        name for name, command in commands.items() if name.startswith("hold_door.") and not command.released_after_s
    ]
    if kept:
        yield f"a door stays open for as long as it is held by {', '.join(kept)} (`released_after_s`)"
    for name in CALLS:
        if name in commands and "arrive_within_s" not in commands[name].model_fields_set:
            yield f"the car arrives within {commands[name].arrive_within_s:g} s of {name} (`arrive_within_s`)"
    if "at_same_floor" not in source.model_fields_set and kept:
        yield "where the car already stands, the hold opens the door, not a call (`at_same_floor`)"


def _is_word(source: RegisterMap, part: Signal | Command) -> bool:
    """Whether it is a value in a whole register."""
    has_field = isinstance(part, Signal) and part.bits is not None
    return part.at is not None and not has_field and not is_bit(source.place(part.at))


def _is_plain_contact(source: RegisterMap, signal: Signal) -> bool:
    """Whether it is made of single bits, of which the map says no level."""
    is_bits = signal.at is None or is_bit(source.place(signal.at))
    return is_bits and not signal.model_fields_set & {"active", "values"}


def _is_pressed_with_one(command: Command) -> bool:
    carries = command.as_ is not None or command.one_of is not None or command.payload is not None
    return not (carries or command.is_heartbeat or command.model_fields_set & {"on", "rest"})
