"""What is written down of the writes of one lift: every press and release, and of what is written again and again only changes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from drivers.driver import WriteLog
from drivers.modbus.output import Cells
from drivers.modbus.steps import Step, StepKind
from drivers.model import Written
from register_maps.codec import Block, Cell
from register_maps.frames import Request

_AGAIN = frozenset({StepKind.REFRESH, StepKind.CYCLE, StepKind.BEAT})
"""Writes that are repeated by themselves."""
CUT_SHORT = "its answer was not waited for"


class Notes:
    """Tells a log what reached the wire, or may have; without a log it costs nothing."""

    def __init__(self, log: WriteLog | None, counts: Collection[Cell] = ()) -> None:
        """`counts` are the cells of heartbeats: they change with each count, which is no news."""
        self._log = log
        self._counts = frozenset(counts)
        self._told: dict[str | Block, tuple[tuple[object, ...], str]] = {}
        """What was told last of each command, and of each block that is written in a cycle."""
        self.unpressed: set[str] = set()
        """Holds whose press was written down before it should leave, and did not leave yet."""

    def wrote(self, step: Step, blocks: Iterable[Block], cells: Cells, left: Sequence[Request], failure: str) -> None:
        """The write of a step to these blocks has ended; `left` is what reached the wire, or may have."""
        if self._log is None or not left:
            return
        if step.kind is StepKind.PRESS:
            self.unpressed.discard(step.name)
        key, told = step.block or step.name, (self._substance(blocks, cells, left), failure)
        if step.kind in _AGAIN and self._told.get(key) == told:
            return
        self._told[key] = told
        self._log.wrote(Written(step.name, step.kind, frames(left), failure))

    def _substance(self, blocks: Iterable[Block], cells: Cells, left: Sequence[Request]) -> tuple[object, ...]:
        """Return what makes a write another one than the write before."""
        covered = [cell for block in blocks for cell in block.cells] if self._counts else []
        if self._counts.isdisjoint(covered):
            return tuple(hex_part(request) for request in left)
        return tuple((cell, cells[cell]) for cell in covered if cell not in self._counts)


def hex_part(request: Request) -> bytes:
    """Unit, function and data of a request: what a person compares with a manual."""
    return request.body[4:]


def frames(requests: Sequence[Request]) -> tuple[str, ...]:
    """Put requests into words for outcomes and logs."""
    return tuple(hex_part(request).hex() for request in requests)
