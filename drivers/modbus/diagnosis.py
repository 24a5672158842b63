"""What an exception answer to a poll or a command is about: signals by name, addresses as printed."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from drivers.errors import ControllerException
from register_maps.codec import Block, Codec, Point
from register_maps.words import Table

ILLEGAL_ADDRESS = 2

Ask = Callable[[Block], Awaitable[object]]


def named_at(codec: Codec, block: Block) -> list[tuple[str, Point]]:
    """List every signal's points in a block, lowest address first."""
    found = [(name, point) for name, signal in codec.signals.items() for point in signal.points if block.holds(point)]
    return sorted(found, key=lambda item: (item[1].address, item[1].low))


def whose(codec: Codec, block: Block) -> str:
    """Name the signals that a block read is for, with their printed addresses."""
    names = dict.fromkeys(name for name, _ in named_at(codec, block))
    told = [f"{name} at {', '.join(codec.map.signals[name].addresses)}" for name in names]
    return "; ".join(told[:4]) + ("; ..." if len(told) > 4 else "")


async def what_is_refused(codec: Codec, block: Block, ask: Ask) -> str:
    """Ask for each address of a refused block by itself and say which ones the device does not serve.

    `ask` raises what the link raises; a device that refuses nothing by itself refuses the length of the block.
    """
    refused: list[str] = []
    seen: set[int] = set()
    for name, point in named_at(codec, block):
        if point.address in seen:
            continue
        seen.add(point.address)
        try:
            await ask(Block(point.table, point.address, 1, point.endpoint))
        except ControllerException as error:
            if error.code != ILLEGAL_ADDRESS:
                raise
            refused.append(f"{name} ({_printed(codec, name, point)})")
    if refused:
        return f"the controller serves less than map {codec.map.name} says: it refuses {', '.join(refused)}"
    size = f"{block.count} {'bits' if block.table in (Table.COIL, Table.DISCRETE) else 'registers'}"
    return (
        f"the controller serves each signal of this block by itself, but not {size} from {block.start} in one request; "
        f"lower max_registers_per_read or max_bits_per_read, or split `served: {block.table}` of map {codec.map.name}"
    )


def _printed(codec: Codec, name: str, point: Point) -> str:
    """Give the address of a point as its map prints it."""
    for text in codec.map.signals[name].addresses:
        place = codec.map.place(text)
        if (place.table, place.number + codec.offset.get(place.table, 0)) == (point.table, point.address):
            return text
    return f"{point.table} {point.address} on the wire"
