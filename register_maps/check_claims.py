"""Checks that every point belongs to one signal or command, except where sharing is intended."""

from __future__ import annotations

from collections.abc import Iterator

from register_maps.check_places import KeyPath
from register_maps.errors import Problem
from register_maps.schema import CALLS, SIGNALS, Command, Kind, RegisterMap, Signal
from register_maps.vocabulary import LAMPS
from register_maps.words import BIT_TABLES

Bit = tuple[str, int, int]
"""Space, address on the wire, bit."""


_CODING = ("at", "bits", "type", "word_order", "byte_order", "code")
"""What two signals at the same number have in common."""


class Claims:
    """The owners of bits; an owner is a name and the key of one of its addresses."""

    def __init__(self) -> None:
        self._owners: dict[Bit, list[tuple[str, KeyPath]]] = {}

    def owners_of(self, bits: list[Bit]) -> list[tuple[str, KeyPath]]:
        """Return the owners of any of these bits, each once."""
        return list(dict.fromkeys(owner for bit in bits for owner in self._owners.get(bit, ())))

    def add(self, bits: list[Bit], name: str, key: KeyPath) -> None:
        """Add an owner."""
        for bit in bits:
            self._owners.setdefault(bit, []).append((name, key))


def check_claims(source: RegisterMap) -> Iterator[Problem]:
    """Yield points that two signals, or two commands, or a signal and a command claim."""
    yield from _signals(source)
    yield from _levels(source)
    yield from _commands(source)
    yield from _read_backs(source)
    yield from _echoes(source)


def bits_at(source: RegisterMap, text: str, low: int = 0, width: int = 16) -> list[Bit]:
    """Return every bit of a place; the field only matters for a register without a bit."""
    place = source.place(text)
    if place.table in BIT_TABLES or place.bit is not None:
        return [(place.space, place.number, place.bit or 0)]
    return [(place.space, place.number, position) for position in range(low, low + width)]


def signal_bits(source: RegisterMap, signal: Signal, text: str) -> list[Bit]:
    """Return every bit at one address of a signal."""
    low, high = (0, 0) if signal.at is None else signal.bits or (0, 15)
    bits = bits_at(source, text, low, high - low + 1)
    return bits + [(space, number + 1, bit) for space, number, bit in bits] if signal.is_wide else bits


def _signals(source: RegisterMap) -> Iterator[Problem]:
    claims = Claims()
    for name, signal in source.signals.items():
        for key, text in signal.keyed_addresses if name not in source.derived else ():
            bits = signal_bits(source, signal, text)
            for other, other_key in claims.owners_of(bits):
                if (message := _conflict(source, (name, key), (other, other_key), text)) is not None:
                    yield Problem(("signals", name, *key), message)
                    break
            claims.add(bits, name, key)


def _conflict(source: RegisterMap, one: tuple[str, KeyPath], other: tuple[str, KeyPath], text: str) -> str | None:
    """Return why two signals may not share a point; None if a floor's door limit is also the switch of that floor."""
    if one[0] == other[0]:
        return f"{text} is twice in this one; give each signal a place of its own"
    by_name = dict((one, other))
    if by_name.keys() == {"mode", "robot_mode_on"} and source.signals["mode"].names_robot_mode:
        return f"{text} is in mode already, whose word `robot` shows it; remove robot_mode_on"
    if (message := _number_and_threshold(source, one[0], other[0], text)) is not None:
        return message or None
    doors = [name for name, key in by_name.items() if key[0] == "open_limits"]
    if by_name.get("car_floor", ("",))[0] != "one_of" or len(doors) != 1:
        return f"{text} is in {other[0]} already; give each signal a place of its own"
    floor = _code(source.signals["car_floor"], by_name["car_floor"])
    limit = _code(source.signals[doors[0]], by_name[doors[0]])
    if floor != limit:
        return f"{text} is floor {floor} of car_floor and floor {limit} of {doors[0]}; {_alike(source.signals['car_floor'], source.signals[doors[0]])}"
    return None


def _number_and_threshold(source: RegisterMap, one: str, other: str, text: str) -> str | None:
    """Return None where not one of the two is a number and the other shown by it; else why they differ, empty if they do not."""
    numbers = [name for name in (one, other) if SIGNALS.get(name) is Kind.NUMBER]
    if len(numbers) != 1 or not any(source.signals[name].thresholds for name in (one, other)):
        return None
    number, shown = (source.signals[name] for name in (one, other))
    if all(getattr(number, key) == getattr(shown, key) for key in _CODING):
        return ""
    return f"{text} is in {other} already, which reads it otherwise; give both the same type, bits and order"


def _code(part: Signal | Command, key: KeyPath) -> int:
    """Return the floor code of one entry of a list with one per floor; its index if there are too few codes."""
    place = int(key[1])
    return part.floor_codes[place] if place < len(part.floor_codes) else place


def _alike(one: Signal | Command, other: Signal | Command) -> str:
    given = one.codes is not None or other.codes is not None
    return "give both the same `codes` for it" if given else "list both in the same order"


def _levels(source: RegisterMap) -> Iterator[Problem]:
    """Yield doors whose limits are floor switches but with another `active`."""
    floor = source.signals.get("car_floor")
    if floor is None or floor.one_of is None:
        return
    switches = {bit for text in floor.one_of for bit in signal_bits(source, floor, text)}
    for name, signal in source.signals.items():
        limits = {bit for text in signal.open_limits or () for bit in signal_bits(source, signal, text)}
        if switches & limits and signal.active != floor.active:
            message = "its limits are switches of car_floor as well, which has another `active`; use the same in both"
            yield Problem(("signals", name), message)


def _commands(source: RegisterMap) -> Iterator[Problem]:
    claims = Claims()
    for name, command in source.commands.items():
        for key, text in command.keyed_addresses:
            bits = bits_at(source, text)
            owners = claims.owners_of(bits)
            if owners:
                same = "twice in this one" if owners[0][0] == name else f"in {owners[0][0]} already"
                message = f"{text} is {same}; give each command a place of its own"
                if not _same_shape(source, text, owners[0]):
                    message += "; a register is written either whole or bit by bit"
                yield Problem(("commands", name, *key), message)
            claims.add(bits, name, key)


def _same_shape(source: RegisterMap, text: str, owner: tuple[str, KeyPath]) -> bool:
    other = dict(source.commands[owner[0]].keyed_addresses)[owner[1]]
    return (source.place(text).bit is None) == (source.place(other).bit is None)


def _read_backs(source: RegisterMap) -> Iterator[Problem]:
    """Yield places of two read-backs: each would show the other's output."""
    claims = Claims()
    for name, command in source.commands.items():
        if not command.keyed_read_addresses and not command.ends_itself and not command.is_heartbeat:
            for key, text in command.keyed_addresses:
                claims.add(bits_at(source, text), name, key)
    for name, command in source.commands.items():
        for key, text in command.keyed_read_addresses:
            bits = bits_at(source, text)
            if owners := claims.owners_of(bits):
                same = "twice in this one" if owners[0][0] == name else f"where {owners[0][0]} is read back"
                yield Problem(("commands", name, *key), f"{text} is {same}; give the place where this output is read")
            claims.add(bits, name, key)


def _echoes(source: RegisterMap) -> Iterator[Problem]:
    """Yield signals at points that only show our own writes."""
    claims = Claims()
    for name, command in source.commands.items():
        for key, text in readable_addresses(command):
            claims.add(bits_at(source, text), name, key)
    for name, signal in source.signals.items():
        if name in source.derived:
            continue
        echoes = (
            _echo(source, name, key, text, *owner)
            for key, text in signal.keyed_addresses
            for owner in claims.owners_of(signal_bits(source, signal, text))
        )
        if (problem := next(filter(None, echoes), None)) is not None:
            yield problem


def readable_addresses(command: Command) -> tuple[tuple[KeyPath, str], ...]:
    """Return the addresses where the output of a command can be read, with their keys."""
    return command.keyed_read_addresses or command.keyed_addresses


def _echo(
    source: RegisterMap, name: str, key: KeyPath, text: str, command: str, command_key: KeyPath
) -> Problem | None:
    path = ("signals", name, *key)
    if command not in CALLS or name not in LAMPS:
        lamps = f"; a lamp in a call button is {LAMPS[0]} or {LAMPS[1]}" if command in CALLS else ""
        cure = f"give the place where the controller reports it{lamps}"
        # a register that keeps the floor requested last is poor evidence, and on some lifts the only one
        only_one = command in CALLS and SIGNALS.get(name) is Kind.FLOOR
        return Problem(
            path, f"{text} shows what {command} writes, and not what the lift does; {cure}", warning=only_one
        )
    if len(key) == len(command_key) == 2:
        lamp, button = source.signals[name], source.commands[command]
        lit, called = _code(lamp, key), _code(button, command_key)
        if lit != called:
            message = f"{text} is floor {lit} here and floor {called} of {command}; {_alike(lamp, button)}"
            return Problem(path, message)
    return None
