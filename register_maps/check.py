"""What only makes sense across the fields of a map: every problem at once, each with the way to mend it."""

from __future__ import annotations

from collections.abc import Iterator

from register_maps.check_commands import address_keys, check_commands
from register_maps.check_signals import check_signals, word_table
from register_maps.errors import Problem
from register_maps.schema import SIGNALS, Kind, RegisterMap, Signal, parse_address
from register_maps.words import BIT_TABLES, Table

__all__ = ["Problem", "check"]

KeyPath = tuple[str | int, ...]
Bit = tuple[Table, int, int]
"""Table, printed number, bit."""

_LONGEST_WRITE = {Table.COIL: 1968, Table.HOLDING: 123}
"""Modbus Application Protocol V1.1b3, 6.11 and 6.12."""

_FORBIDDING = frozenset(
    {
        *("fire", "fireman", "emergency_power", "passenger_alarm", "inspection"),
        *("out_of_service", "fault", "independent", "attendant"),
    }
)
"""Flags that put the lift in a mode without robots."""


def check(source: RegisterMap) -> list[Problem]:
    """Return every problem of a map."""
    return [
        *_served(source),
        *check_signals(source),
        *check_commands(source),
        *_places(source),
        *_claims(source),
        *_write_blocks(source),
        *_evidence(source),
        *_fire(source),
        *_cautions(source),
    ]


def _served(source: RegisterMap) -> Iterator[Problem]:
    for table, ranges in source.served.items():
        highest = -1
        for index, (first, last) in enumerate(ranges):
            path = ("served", table.value, index)
            yield from (Problem(path, message) for message in _out_of_bounds(source, first, last))
            if first > last:
                yield Problem(path, f"[{first}, {last}] is the wrong way round; write the first address first")
            elif first <= highest:
                yield Problem(
                    path, f"{first} is served already, up to {highest}; write ranges in order, without overlap"
                )
            highest = max(highest, last)


def _out_of_bounds(source: RegisterMap, *numbers: int) -> Iterator[str]:
    base = source.addressing.base
    for number in dict.fromkeys(numbers):
        if number < base:
            yield f"{number} is below the first address; with `base: {base}` numbers start at {base}"
        if number - base > 0xFFFF:
            yield f"{number} is {number - base} on the wire, and the highest address there is 65535"


def _places(source: RegisterMap) -> Iterator[Problem]:
    """Yield addresses that cannot exist or that the device does not serve."""
    for path, address in _addresses(source):
        table, number, _ = parse_address(address)
        wrong = list(_out_of_bounds(source, number))
        yield from (Problem(path, message) for message in wrong)
        if not wrong and not _is_served(source, table, number):
            ranges = ", ".join(f"{first} to {last}" for first, last in source.served.get(table, ())) or "nothing"
            cure = f"correct the address, or add it to `served: {table}`"
            yield Problem(path, f"{address} is not served: of {table} the map serves {ranges}; {cure}")


def _is_served(source: RegisterMap, table: Table, number: int) -> bool:
    return any(first <= number <= last for first, last in source.served.get(table, ()))


def _addresses(source: RegisterMap) -> Iterator[tuple[KeyPath, str]]:
    for name, signal in source.signals.items():
        for key, address in _signal_keys(signal):
            yield ("signals", name, *key), address
    for name, command in source.commands.items():
        for key, address in address_keys(command):
            yield ("commands", name, *key), address


def _signal_keys(signal: Signal) -> Iterator[tuple[KeyPath, str]]:
    for field in ("at", "open_limit", "closed_limit"):
        if (address := getattr(signal, field)) is not None:
            yield (field,), address
    for index, address in enumerate(signal.one_of or ()):
        yield ("one_of", index), address


def _claims(source: RegisterMap) -> Iterator[Problem]:
    """Yield points that two signals, or two commands, claim."""
    owners: dict[Bit, str] = {}
    for name, signal in source.signals.items():
        for key, address in _signal_keys(signal):
            path = ("signals", name, *key)
            low, high = (0, 0) if signal.at is None else signal.bits or (0, 15)
            bits = _bits(address, low=low, width=high - low + 1)
            yield from _claim(owners, name, path, address, bits, "signal")
    owners = {}
    for name, command in source.commands.items():
        for key, address in address_keys(command):
            path = ("commands", name, *key)
            yield from _claim(owners, name, path, address, _bits(address), "command")


def _claim(
    owners: dict[Bit, str], name: str, path: KeyPath, address: str, bits: list[Bit], sort: str
) -> Iterator[Problem]:
    taken = next((owners[bit] for bit in bits if bit in owners), None)
    if taken is not None:
        same = "twice in this one" if taken == name else f"in {taken} already"
        yield Problem(path, f"{address} is {same}; give each {sort} a place of its own")
    for bit in bits:
        owners.setdefault(bit, name)


def _bits(address: str, *, width: int = 16, low: int = 0) -> list[Bit]:
    """Every bit of a place; the field only matters where a register is named without a bit."""
    table, number, bit = parse_address(address)
    if table in BIT_TABLES or bit is not None:
        return [(table, number, bit or 0)]
    return [(table, number, position) for position in range(low, low + width)]


def _write_blocks(source: RegisterMap) -> Iterator[Problem]:
    taken: dict[tuple[Table, int], int] = {}
    for index, block in enumerate(source.write_blocks):
        path = ("write_blocks", index)
        table, start, bit = parse_address(block.at)
        wanted = {Table.COIL: 15, Table.HOLDING: 16}.get(table)
        if bit is not None or wanted is None:
            yield Problem((*path, "at"), f"{block.at} cannot start a block; give a coil, or a whole holding register")
            continue
        if block.function != wanted:
            yield Problem((*path, "function"), f"function {block.function} does not write a {table}; use {wanted}")
        if block.count > _LONGEST_WRITE[table]:
            message = f"{block.count} are too many for one write; the limit is {_LONGEST_WRITE[table]} of table {table}"
            yield Problem((*path, "count"), message)
            continue
        cells = [(table, start + offset) for offset in range(block.count)]
        yield from (Problem(path, message) for message in _out_of_bounds(source, start, start + block.count - 1))
        yield from (Problem(path, message) for message in _coverage(source, cells))
        overlap = next((taken[cell] for cell in cells if cell in taken), None)
        if overlap is not None:
            yield Problem(path, f"overlaps write block {overlap + 1}; an address belongs to one block")
        taken.update(dict.fromkeys(cells, index))


def _coverage(source: RegisterMap, cells: list[tuple[Table, int]]) -> Iterator[str]:
    inside = set(cells)
    owned: set[tuple[Table, int]] = set()
    for name, command in source.commands.items():
        points = {parse_address(address)[:2] for address in command.addresses}
        owned |= points
        if points & inside and points - inside:
            yield f"covers only a part of {name}; widen the block to all its outputs"
    if strangers := [number for table, number in cells if (table, number) not in owned]:
        table = cells[0][0]
        listed = ", ".join(map(str, strangers[:5])) + (", ..." if len(strangers) > 5 else "")
        yield f"{table} {listed} in it belong to no command, and are never written; shorten or split the block"


def _evidence(source: RegisterMap) -> Iterator[Problem]:
    evidence = source.at_floor_evidence
    needed = {"level": "level", "motion_stopped": "motion"}.get(evidence.kind)
    if needed is not None and needed not in source.signals:
        cure = f"declare `{needed}`, or use {{kind: position_stable, for_s: 1.0}}"
        yield Problem(("at_floor_evidence",), f"the map has no signal {needed} to show that the car stands; {cure}")
    opens = any(name.startswith("hold_door.") for name in source.commands)
    if "go_to" in source.commands and source.at_same_floor == "open_button" and not opens:
        message = "the map has no hold_door command to open the door where the car stands; say `at_same_floor: call`"
        yield Problem(("at_same_floor",), message)


def _fire(source: RegisterMap) -> Iterator[Problem]:
    mode = source.signals.get("mode")
    visible = "fire" in source.signals or (mode is not None and "fire" in (mode.values or {}).values())
    if visible and "fire" in source.not_visible:
        yield Problem(("not_visible", "fire"), "the map has a fire signal; remove this line")
    if not visible and not source.not_visible.get("fire", "").strip():
        cure = "declare `fire`, or give the reason: `not_visible: {fire: ...}`; every face shows it"
        yield Problem(("not_visible",), f"the map has no fire signal, and no mode that says fire; {cure}")


def _cautions(source: RegisterMap) -> Iterator[Problem]:
    if "car_floor" not in source.signals:
        message = "no car_floor: the lift cannot say where its car is, and no robot can use it by this map alone"
        yield Problem(("signals",), message, warning=True)
    if not any(name.startswith("door.") for name in source.signals):
        message = "no door signal: no door can be shown open, and no robot can use the lift by this map alone"
        yield Problem(("signals",), message, warning=True)
    if not any(_safe_at_zero(source, name) for name in source.signals):
        cure = "let a code of 0 be `unknown`, or fire `active: low`, where the controller can do that"
        message = f"a controller that serves only zeros would pass for a healthy lift; {cure}"
        yield Problem(("signals",), message, warning=True)


def _safe_at_zero(source: RegisterMap, name: str) -> bool:
    """Whether this signal, read as zeros, keeps robots out by itself."""
    signal, kind = source.signals[name], SIGNALS.get(name)
    if kind is Kind.FLOOR and name == "car_floor":
        return signal.one_of is not None or 0 in (*signal.unknown, *signal.none)
    if kind is Kind.COUNTER:
        return True
    if kind is Kind.FLAG:
        if name == "level":
            return source.at_floor_evidence.kind == "level" and signal.active == "high"
        return name in _FORBIDDING and signal.active == "low"
    if kind is Kind.DOOR and signal.open_limit is not None:
        return True
    if kind in (Kind.DOOR, Kind.MODE):
        return word_table(name, signal).get(0) not in ("open", "closed", "normal", "robot")
    return False
