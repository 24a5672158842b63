"""A journal without a disk that takes as long as one, and reports what is written."""

from __future__ import annotations

import asyncio
from asyncio import Future
from collections.abc import Callable

from lift_manager.core.journal import Hears
from lift_manager.domain.journal import Row


class WrittenJournal:
    """Keeps nothing but the time: a row that a press waits for is on the disk only after a while."""

    def __init__(self, takes_s: float, written: Callable[[Row], None]) -> None:
        """`written` gets each row that a press waits for, `takes_s` after it was given."""
        self.trouble = ""
        """May be set: then rows are refused with it."""
        self._takes_s = takes_s
        self._written = written

    def note(self, row: Row) -> None:
        """Write this down soon. Nothing waits for it."""

    def before(self, row: Row) -> Future[str | None]:
        """Write this down, and answer then."""
        done: Future[str | None] = asyncio.get_running_loop().create_future()
        if self.trouble:
            done.set_result(self.trouble)
        else:
            asyncio.get_running_loop().call_later(self._takes_s, self._on_disk, row, done)
        return done

    async def run(self, hears: Hears) -> None:
        """Have nothing to do by itself."""
        await asyncio.Event().wait()

    async def settled(self) -> None:
        """Return once what was noted is written."""
        await asyncio.sleep(self._takes_s)

    def _on_disk(self, row: Row, done: Future[str | None]) -> None:
        self._written(row)
        if not done.done():
            done.set_result(None)
