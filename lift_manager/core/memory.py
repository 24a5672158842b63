"""What the manager needs from outside to remember sessions and people's words over a restart."""

from __future__ import annotations

from asyncio import Future
from typing import Protocol

from lift_manager.domain.service import Remembered


class Memory(Protocol):
    """What outlives the manager, by lift. Nothing here waits, so releases never wait for a disk; the journal's `run` does the writing."""

    @property
    def trouble(self) -> str:
        """Why nothing can be written now, in words with what to do; empty while it can."""
        ...

    def written(self, lift: str) -> Future[None] | None:
        """Return what is done once everything kept of a lift so far is written; None where it is already.

        It never fails, and stays open for as long as nothing can be written: bound it with a timeout.
        """
        ...

    def recall(self, lift: str) -> Remembered:
        """Return what is remembered of a lift; the empty value for one that nothing was ever kept of."""
        ...

    def keep(self, lift: str, remembered: Remembered) -> None:
        """Remember this from now on. It is recalled at once, and written soon."""
        ...


class ShortMemory:
    """Remembers for as long as the process lives: for the demo and for virtual time."""

    def __init__(self) -> None:
        self._lifts: dict[str, Remembered] = {}
        self.trouble = ""
        """May be set, as if a disk took nothing more."""

    def written(self, lift: str) -> Future[None] | None:
        """Have nothing to wait for."""
        return None

    def recall(self, lift: str) -> Remembered:
        """Return what was kept last."""
        return self._lifts.get(lift, Remembered())

    def keep(self, lift: str, remembered: Remembered) -> None:
        """Remember this."""
        self._lifts[lift] = remembered
