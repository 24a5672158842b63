"""Checks write blocks, and registers of which others write some bits."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Set as AbstractSet

from register_maps.address import HIGHEST, Place
from register_maps.check_claims import signal_bits
from register_maps.errors import Problem
from register_maps.schema import COMMANDS, EPOCH_BITS, Command, RegisterMap, WriteBlock
from register_maps.words import Table

Cell = tuple[str, int]
"""Space and address on the wire."""

_FUNCTIONS = {Table.COIL: 15, Table.HOLDING: 16}


def check_blocks(source: RegisterMap) -> Iterator[Problem]:
    """Yield the problems of every write block."""
    taken: dict[Cell, int] = {}
    for index, block in enumerate(source.write_blocks):
        path = ("write_blocks", index)
        place = source.place(block.at)
        function = _FUNCTIONS.get(place.table)
        if place.bit is not None or function is None:
            yield Problem((*path, "at"), f"{block.at} cannot start a block; give a coil, or a whole holding register")
            continue
        if block.function != function:
            message = f"function {block.function} does not write a {place.table}; use {function}"
            yield Problem((*path, "function"), message)
        if (too_long := _too_long(source, place, block.count)) is not None:
            yield Problem((*path, "count"), too_long)
            continue
        cells = [(place.space, place.number + offset) for offset in range(block.count)]
        gaps = block.gaps is not None
        for message in (*_coverage(source, cells, place, gaps=gaps), *_cycle(source, block, cells)):
            yield Problem(path, message)
        if (other := next((taken[cell] for cell in cells if cell in taken), None)) is not None:
            yield Problem(path, f"overlaps write block {other + 1}; an address belongs to one block")
        taken.update(dict.fromkeys(cells, index))


def blocked_cells(source: RegisterMap, *, cyclic: bool = False) -> set[Cell]:
    """Return every address that a write block covers; with `cyclic`, only of blocks that are written in a cycle."""
    return {
        (place.space, place.number + offset)
        for block in source.write_blocks
        if block.every_s is not None or not cyclic
        for place in (source.place(block.at),)
        for offset in range(block.count)
    }


def _too_long(source: RegisterMap, place: Place, count: int) -> str | None:
    bits = place.table is Table.COIL
    limit = source.link.max_bits_per_write if bits else source.link.max_registers_per_write
    key = "max_bits_per_write" if bits else "max_registers_per_write"
    if count > limit:
        why = f"`link: {key}`" if key in source.link.model_fields_set else f"the specification for a {place.table}"
        return f"{count} are too many for one write; the limit is {limit}, from {why}; split the block"
    if place.number + count - 1 > HIGHEST:
        return (
            f"the block would end at {place.number + count - 1} on the wire, and the highest address there is {HIGHEST}"
        )
    return None


def _coverage(source: RegisterMap, cells: list[Cell], start: Place, *, gaps: bool) -> Iterator[str]:
    block_cells = set(cells)
    owned: set[Cell] = set(arbitration_cells(source))
    for name, command in source.commands.items():
        points = cells_of(source, command)
        owned |= points
        if points & block_cells and points - block_cells:
            yield f"covers only a part of {name}; widen the block to all its outputs"
    gaps_in_block = [cell for cell in cells if cell not in owned]
    if gaps_in_block and not gaps:
        cure = "shorten or split the block, or use `gaps: 0` if the device requires 0 there"
        yield f"{_list_addresses(source, start, gaps_in_block)} in it belong to no command, and are never written; {cure}"
        return
    yield from _over_signals(source, start, gaps_in_block)
    # commands outside what is served are found by another check
    served = [cell for cell in cells if cell in gaps_in_block or cell in arbitration_cells(source)]
    yield from _unserved(source, cells, start, served)


def _over_signals(source: RegisterMap, start: Place, strangers: list[Cell]) -> Iterator[str]:
    for name, signal in source.signals.items():
        places = {bit[:2] for text in signal.addresses for bit in signal_bits(source, signal, text)}
        if hidden := [cell for cell in strangers if cell in places]:
            yield f"{_list_addresses(source, start, hidden)} in it is read as {name}, and 0 would be written over it; split the block"


def _unserved(source: RegisterMap, cells: list[Cell], start: Place, strangers: list[Cell]) -> Iterator[str]:
    """Yield which of these cells the device does not serve, and a block that it cannot take as a whole."""
    ranges = source.served_wire.get(start.space, ())
    if missing := [cell for cell in strangers if not any(cell[1] in span for span in ranges)]:
        yield f"{_list_addresses(source, start, missing)} in it is not served; shorten the block, or correct `served`"
    elif all(any(number in span for span in ranges) for _, number in cells) and not any(
        cells[0][1] in span and cells[-1][1] in span for span in ranges
    ):
        yield "crosses the edge of a served range, and a device does not take that in one write; split the block"


def _cycle(source: RegisterMap, block: WriteBlock, cells: list[Cell]) -> Iterator[str]:
    """Yield commands that cannot be written with a block, or not repeatedly."""
    block_cells = set(cells)
    for name, command in source.commands.items():
        if not cells_of(source, command) & block_cells or not command.ends_itself:
            continue
        if command.payload is not None and source.place(block.at).table is Table.COIL:
            yield f"{name} writes a time to a coil, which only function 5 can; leave it out of the block"
        elif block.every_s is not None:
            yield f"{name} is a pulse that the device ends, and each cycle would restart it; leave it out of the block"
        elif others := _others(source, name, block_cells):
            yield f"{_restarts(name, others)}; give it a write of its own, outside the block"
    if block.every_s is not None and block.every_s < source.link.min_gap_s:
        gap = f"{source.link.min_gap_s:g} s between requests (min_gap_s)"
        yield f"every_s of {block.every_s:g} s cannot be kept: the link leaves {gap}; give more than that"


def _others(source: RegisterMap, name: str, cells: AbstractSet[Cell]) -> list[str]:
    """Return the other commands that write to any of these addresses."""
    return [other for other, command in source.commands.items() if other != name and cells_of(source, command) & cells]


def _restarts(name: str, others: list[str]) -> str:
    return f"{name} is a pulse that the device ends, and each write of {', '.join(others)} would restart it"


def cells_of(source: RegisterMap, command: Command) -> set[Cell]:
    """Return every address a command writes to."""
    return {(place.space, place.number) for place in map(source.place, command.addresses)}


def arbitration_cells(source: RegisterMap) -> list[Cell]:
    """Return every address that carries epoch and owner; none without `arbitration`, or where one of them cannot be written."""
    if (spec := source.arbitration) is None:
        return []
    epoch, owner = source.place(spec.epoch), source.place(spec.owner)
    bits = {Table.COIL: 1, Table.HOLDING: 16}
    if epoch.table not in bits or owner.table not in bits:
        return []
    sizes = ((owner, spec.owner_bits(owner.table)), (epoch, EPOCH_BITS))
    return [
        (place.space, place.number + offset) for place, width in sizes for offset in range(width // bits[place.table])
    ]


def _list_addresses(source: RegisterMap, start: Place, cells: list[Cell]) -> str:
    """Return the first five of these addresses as the map prints them."""
    printed = [str(number + (source.addressing.base or 0)) for _, number in cells[:5]]
    wire = "" if source.addressing.notation is None else " on the wire"
    table = f"{start.endpoint}/{start.table}" if start.endpoint else start.table
    return f"{table} {', '.join(printed)}{', ...' if len(cells) > 5 else ''}{wire}"


def check_shared_words(source: RegisterMap) -> Iterator[Problem]:
    """Yield commands in bits of registers without, or with different, `shared_word`."""
    first: dict[Cell, str] = {}
    blocked = blocked_cells(source)
    for name, command in source.commands.items():
        if name not in COMMANDS:
            continue
        path = ("commands", name)
        words = _words(source, command)
        if not words:
            if command.shared_word is not None:
                message = "belongs to a command in a bit of a register; remove it"
                yield Problem((*path, "shared_word"), message)
            continue
        if command.shared_word is None:
            yield Problem(path, _no_shared_word(source, command))
            continue
        for cell in words:
            other = first.setdefault(cell, name)
            if source.commands[other].shared_word != command.shared_word:
                message = (
                    f"{other} lies in the same register and has `{source.commands[other].shared_word}`; use the same"
                )
                yield Problem((*path, "shared_word"), message)
            elif command.shared_word == "owned":
                yield from _owned(source, name, cell, whole=other == name)
            if cell in blocked:
                message = "a write block writes whole registers, and this is one bit of one; take the register out of the block"
                yield Problem((*path, "shared_word"), message)


def _words(source: RegisterMap, command: Command) -> list[Cell]:
    """Return the registers of which a command writes some bits."""
    places = [place for place in map(source.place, command.addresses) if place.bit is not None]
    return list(dict.fromkeys((place.space, place.number) for place in places))


def _no_shared_word(source: RegisterMap, command: Command) -> str:
    text = next(text for text in command.addresses if source.place(text).bit is not None)
    return (
        f"{text} is a bit in a register; use `shared_word: owned` if nobody else writes in that register, `mask_write` if the "
        "device knows function 22, or `accepted` if it may be read and written back whole, though a change in between is lost"
    )


def _owned(source: RegisterMap, name: str, cell: Cell, *, whole: bool) -> Iterator[Problem]:
    """Yield what cannot share an `owned` word with a command; with `whole`, also signals in the word."""
    path = ("commands", name, "shared_word")
    if source.commands[name].ends_itself and (others := _others(source, name, {cell})):
        cure = "use `mask_write` in each of them if the device knows function 22, else leave this pulse out"
        yield Problem(path, f"{_restarts(name, others)}; {cure}")
    if whole:
        yield from _read_there(source, cell, path)


def _read_there(source: RegisterMap, cell: Cell, path: tuple[str | int, ...]) -> Iterator[Problem]:
    """Yield signals in a word that is declared as `owned`."""
    there = [command for command in source.commands.values() if cell in _words(source, command)]
    if any(command.keyed_read_addresses for command in there):
        return  # reading and writing this address access different values
    ours = {source.place(text).bit for command in there for text in command.addresses}
    for name, signal in source.signals.items():
        bits = {bit for text in signal.addresses for bit in signal_bits(source, signal, text)}
        if any((space, number) == cell and bit not in ours for space, number, bit in bits):
            message = f"{name} is read from the same register, so it is not ours alone; use `mask_write` or `accepted`"
            yield Problem(path, message)
