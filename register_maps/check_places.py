"""Checks that every address of a map can be parsed, exists, and is served by its device."""

from __future__ import annotations

from collections.abc import Iterator

from register_maps import address
from register_maps.address import HIGHEST, MODICON, Place
from register_maps.error_texts import closest
from register_maps.errors import Problem
from register_maps.schema import Addressing, RegisterMap, Served
from register_maps.words import Table

KeyPath = tuple[str | int, ...]


def addresses(source: RegisterMap) -> Iterator[tuple[KeyPath, str]]:
    """Yield every address of a map with its key: of signals, commands (written and read back), write blocks and arbitration."""
    for name, signal in source.signals.items():
        for key, text in signal.keyed_addresses if name not in source.derived else ():
            yield ("signals", name, *key), text
    for name, command in source.commands.items():
        for key, text in (*command.keyed_addresses, *command.keyed_read_addresses):
            yield ("commands", name, *key), text
    for index, block in enumerate(source.write_blocks):
        yield ("write_blocks", index, "at"), block.at
    if source.arbitration is not None:
        yield ("arbitration", "epoch"), source.arbitration.epoch
        yield ("arbitration", "owner"), source.arbitration.owner


def find_unreadable(source: RegisterMap) -> list[Problem]:
    """Return addresses that are no places: not in the map's notation, out of range, or at an undeclared device.

    `check` needs a map without the signals, commands and write blocks they belong to.
    """
    problems = []
    for path, text in addresses(source):
        try:
            place = source.place(text)
        except ValueError as error:
            problems.append(Problem(path, str(error)))
            continue
        if place.endpoint and place.endpoint not in source.endpoints:
            problems.append(Problem(path, _undeclared(source, place)))
        elif (beyond := _beyond(_counting(source, place.endpoint), text, place.number, place.table)) is not None:
            problems.append(Problem(path, beyond))
    return problems


def check_served(source: RegisterMap) -> Iterator[Problem]:
    """Yield impossible ranges, addresses outside the ranges, and unused endpoints."""
    yield from _ranges(_counting(source, ""), ("served",), source.served)
    used = {source.place(text).endpoint for _, text in addresses(source)}
    for name, endpoint in source.endpoints.items():
        yield from _ranges(_counting(source, name), ("endpoints", name, "served"), endpoint.served)
        if name not in used:
            message = f"nothing in the map is at {name}; write {name}/ before an address, or remove the endpoint"
            yield Problem(("endpoints",), message, warning=True)
    for path, text in addresses(source):
        if path[0] in ("write_blocks", "arbitration"):
            continue  # the commands of a block are in this list too, and what else it writes is checked with its limits
        if (unserved := _unserved(source, text, count=_registers(source, path))) is not None:
            yield Problem(path, unserved)


def _registers(source: RegisterMap, path: KeyPath) -> int:
    return 2 if path[0] == "signals" and source.signals[str(path[1])].is_wide else 1


def _unserved(source: RegisterMap, text: str, *, count: int) -> str | None:
    place = source.place(text)
    numbers = range(place.number, place.number + count)
    if any(numbers[0] in span and numbers[-1] in span for span in source.served_wire.get(place.space, ())):
        return None
    served = source.endpoints[place.endpoint].served if place.endpoint else source.served
    ranges = ", ".join(f"{first} to {last}" for first, last in served.get(place.table, ())) or "nothing"
    where = f"endpoints: {place.endpoint}: served: {place.table}" if place.endpoint else f"served: {place.table}"
    what = f"{text} and the register after it are" if count == 2 else f"{text} is"
    joined = " in one range" if count == 2 else ""
    of = f"{place.table} at {place.endpoint}" if place.endpoint else place.table
    return f"{what} not served{joined}: of {of} the map serves {ranges}; correct the address, or add it to `{where}`"


def _ranges(counting: Addressing, path: KeyPath, served: Served) -> Iterator[Problem]:
    for table, ranges in served.items():
        highest = -1
        for index, (first, last) in enumerate(ranges):
            here = (*path, table.value, index)
            for number in dict.fromkeys((first, last)):
                wire = address.served_number(table, number, counting)
                if (message := _beyond(counting, str(number), wire, table)) is not None:
                    yield Problem(here, message)
            if first > last:
                yield Problem(here, f"[{first}, {last}] is the wrong way round; write the first address first")
            elif first <= highest:
                message = f"{first} is served already, up to {highest}; write ranges in order, without overlap"
                yield Problem(here, message)
            highest = max(highest, last)


def _counting(source: RegisterMap, endpoint: str) -> Addressing:
    """Return the addressing of a device: its own, or else that of the map."""
    own = source.endpoints[endpoint].addressing if endpoint in source.endpoints else None
    return own or source.addressing


def _beyond(counting: Addressing, printed: str, number: int, table: Table) -> str | None:
    """Return why a number cannot be an address on the wire; None if it can."""
    if number > HIGHEST:
        return f"{printed} is {number} on the wire, and the highest address there is {HIGHEST}"
    if number >= 0:
        return None
    if counting.notation == MODICON:
        first = {Table.COIL: "00001", Table.DISCRETE: "10001", Table.INPUT: "30001", Table.HOLDING: "40001"}[table]
        return f"{printed} is below the first address; Modicon numbers of a {table} start at {first}"
    base = counting.base
    return f"{printed} is below the first address; with `base: {base}` numbers start at {base}"


def _undeclared(source: RegisterMap, place: Place) -> str:
    hint = closest(place.endpoint, source.endpoints)
    cure = hint or f"; declare it: `endpoints: {{{place.endpoint}: {{served: ...}}}}`, or correct the address"
    return f"the map has no endpoint {place.endpoint}{cure}"
