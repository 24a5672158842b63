"""Reports the writes of one lift: every press and release, and changes of what is written repeatedly."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence

from drivers.modbus.output import Cells
from drivers.modbus.steps import Step, StepKind
from drivers.model import Written
from register_maps.codec import Block, Cell
from register_maps.frames import Request

_REPEATED_KINDS = frozenset({StepKind.REFRESH, StepKind.CYCLE, StepKind.BEAT})
"""Writes that the driver repeats by itself."""
_NO_CELLS: frozenset[Cell] = frozenset()
"""One for all lifts without a heartbeat."""
CUT_SHORT = "its answer was not awaited"


class WriteReports:
    """Reports the writes that reached the wire, or may have."""

    def __init__(self, report: Callable[[Written], None], counts: Collection[Cell] = ()) -> None:
        """`counts` are the cells of heartbeats: their changes are not reported."""
        self._report = report
        self._counts = frozenset(counts) if counts else _NO_CELLS
        self._reported: dict[str | Block, tuple[tuple[object, ...], str]] = {}
        """The last report of each command, and of each block that is written in a cycle."""

    def report_write(
        self, step: Step, blocks: Iterable[Block], cells: Cells, sent: Sequence[Request], failure: str
    ) -> None:
        """Report the write of a step to these blocks; `sent` is what reached the wire, or may have."""
        if not sent:
            return
        key, news = step.block or step.name, (self._substance(blocks, cells, sent), failure)
        if step.kind in _REPEATED_KINDS and self._reported.get(key) == news:
            return
        self._reported[key] = news
        self._report(Written(step.name, step.kind, hex_frames(sent), failure))

    def _substance(self, blocks: Iterable[Block], cells: Cells, sent: Sequence[Request]) -> tuple[object, ...]:
        """Return the content by which a write differs from the one before."""
        covered = [cell for block in blocks for cell in block.cells] if self._counts else []
        if self._counts.isdisjoint(covered):
            return tuple(hex_part(request) for request in sent)
        return tuple((cell, cells[cell]) for cell in covered if cell not in self._counts)


def hex_part(request: Request) -> bytes:
    """Return unit, function and data of a request, as a person compares them with a manual."""
    return request.body[4:]


def hex_frames(requests: Sequence[Request]) -> tuple[str, ...]:
    """Return requests as hex for outcomes and logs."""
    return tuple(hex_part(request).hex() for request in requests)
