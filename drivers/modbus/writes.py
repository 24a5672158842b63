"""Builds the requests that carry out a step. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

from drivers.modbus.steps import Step
from register_maps import frames
from register_maps.codec import Block, Cell, CommandCodec, Point
from register_maps.command_codec import Written, payload_counts
from register_maps.frames import MASK_WRITE, Request


def step_requests(
    command: CommandCodec, step: Step, cells: Mapping[Cell, int], unit_of: Callable[[str], int]
) -> list[tuple[Block, Request]]:
    """Return every request of a step with its block, in order, without reading: the bits of other writers in the same words are 0."""
    return [
        (block, block_request(command, step, block, function, cells, unit_of(block.endpoint)))
        for block, function in blocks_in_order(command, step, cells)
    ]


def blocks_in_order(command: CommandCodec, step: Step, cells: Mapping[Cell, int]) -> list[tuple[Block, int]]:
    """Return the blocks of a command with their functions: first those that come to rest.

    Of outputs that the device releases by itself, or that show lamps, only the pressed one is written: the others are at
    rest, and a 0 there may have another meaning, such as the end of a passenger's call.
    """
    pairs = list(zip(command.blocks, command.functions, strict=True))
    if (command.spec.ends_itself or command.shows_lamp) and command.spec.one_of is not None:
        code = step.was if step.code is None else step.code
        pressed = {point.cell for point, value in command.encode(code).items() if value}
        pairs = [pair for pair in pairs if not pressed.isdisjoint(pair[0].cells)]
    if len(pairs) == 1:
        return pairs
    return sorted(pairs, key=lambda pair: any(cells[cell] for cell in pair[0].cells))


def block_request(
    command: CommandCodec, step: Step, block: Block, function: int, cells: Mapping[Cell, int], unit: int
) -> Request:
    """Return the request of a step for one block of its command."""
    if command.is_timed_coil:
        return timed_pulse(command, block, unit)
    if function == MASK_WRITE:
        return masked_write(command.encode(step.code), block, unit)
    return block_write(block, function, cells, unit)


def block_write(block: Block, function: int, cells: Mapping[Cell, int], unit: int) -> Request:
    """Return the write of a block with the values of `cells`. `function` is 5, 6, 15 or 16."""
    return _write(function, block.start, tuple([cells[cell] for cell in block.cells]), unit)


@lru_cache(1024)
def _write(function: int, start: int, values: tuple[int, ...], unit: int) -> Request:
    """Return a write. A press is planned for its row before it is sent, and most writes are like an earlier one."""
    match function:
        case 5:
            return frames.write_coil(start, bool(values[0]), unit)
        case 6:
            return frames.write_register(start, values[0], unit)
        case 15:
            return frames.write_coils(start, [bool(value) for value in values], unit)
        case _:
            return frames.write_registers(start, values, unit)


def masked_write(values: Mapping[Point, int], block: Block, unit: int) -> Request:
    """Return a write that sets those of these bits that lie in one register, and no others, inside the device."""
    keep, put = 0xFFFF, 0
    for point, value in values.items():
        if block.holds(point):
            keep &= ~(point.mask << point.low)
            put = point.into(put, value)
    return frames.mask_write(block.start, keep & 0xFFFF, put, unit)


def timed_pulse(codec: CommandCodec, block: Block, unit: int) -> Request:
    """Return a write that sets a coil for the time that the command names; the device ends it."""
    return frames.pulse_coil(block.start, payload_counts(codec.spec), unit)


def read_back_blocks(codec: CommandCodec, written: Iterable[Written], planned: Iterable[Block]) -> tuple[Block, ...]:
    """Return the blocks to read for a command's points: its write blocks whole, the rest as `planned`."""
    whole = [block for block, _, _ in written]
    covering = [next((block for block in whole if block.holds(point)), None) for point in codec.read_points]
    return tuple(
        dict.fromkeys(
            [
                *(block for block in covering if block is not None),
                *(block for block in planned if not any(_covers(kept, block) for kept in covering if kept is not None)),
            ]
        )
    )


def _covers(outer: Block, inner: Block) -> bool:
    return set(inner.cells) <= set(outer.cells)
