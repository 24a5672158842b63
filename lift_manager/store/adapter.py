"""The Memory that the core knows today, on a committer that writes records and journal together."""

from __future__ import annotations

from asyncio import Future

from lift_manager.domain.service import Remembered
from lift_manager.store.committer import Committer


class RecordMemory:
    """Implements Memory. The committer, which is the Journal, does all the writing."""

    def __init__(self, committer: Committer) -> None:
        self._committer = committer

    @property
    def trouble(self) -> str:
        """Why nothing can be written now, in words with what to do; empty while it can."""
        return self._committer.trouble

    def written(self, lift: str) -> Future[None] | None:
        """Return what is done once everything kept of a lift so far is on the disk; None where it is already."""
        return self._committer.written(lift)

    def recall(self, lift: str) -> Remembered:
        """Return what was kept last."""
        kept = self._committer.recall(lift)
        return kept if isinstance(kept, Remembered) else Remembered()

    def keep(self, lift: str, remembered: Remembered) -> None:
        """Remember this, and commit it soon."""
        self._committer.keep(lift, remembered)
