"""What the manager needs from outside to write down what it does."""

from __future__ import annotations

import asyncio
from asyncio import Future
from collections.abc import Callable
from typing import Protocol

from lift_manager.domain.journal import Row

Hears = Callable[[str], None]
"""Told why nothing can be written, once, and an empty text when it can be again."""


class Journal(Protocol):
    """Append-only, in the order of the calls. Nothing but `run` and `settled` waits; both forms pass the same contract tests."""

    @property
    def trouble(self) -> str:
        """Why no row can be written now, in words with what to do; empty while rows can be written."""
        ...

    def note(self, row: Row) -> None:
        """Write this down soon. Never waits and never fails: releases and states go on whatever the disk does."""
        ...

    def before(self, row: Row) -> Future[str | None]:
        """Write this down, and tell when it is on the disk: None, or why it is not there (then nothing may be pressed).

        All that Memory was given to keep before it is on the disk with it. Answers within a bounded time whatever the disk does.
        A row that is refused may still be written later.
        """
        ...

    async def run(self, hears: Hears) -> None:
        """Write until cancelled; what cannot be written is tried again."""
        ...

    async def settled(self) -> None:
        """Return once everything noted and kept so far is on the disk; bound it with a timeout."""
        ...


class ShortJournal:
    """Keeps rows for as long as the process lives: for the demo and for virtual time."""

    def __init__(self, keep: int = 10_000) -> None:
        """Remember the newest `keep` rows."""
        self.rows: list[Row] = []
        self.trouble = ""
        """May be set: then rows are refused with it."""
        self._keep = keep

    def note(self, row: Row) -> None:
        """Keep this."""
        self.rows.append(row)
        if len(self.rows) > 2 * self._keep:
            del self.rows[: -self._keep]

    def before(self, row: Row) -> Future[str | None]:
        """Keep this, and answer at once."""
        if not self.trouble:
            self.note(row)
        done: Future[str | None] = asyncio.get_running_loop().create_future()
        done.set_result(self.trouble or None)
        return done

    async def run(self, hears: Hears) -> None:
        """Have nothing to write."""
        await asyncio.Event().wait()

    async def settled(self) -> None:
        """Have nothing to wait for."""
