"""Every error the store raises on purpose.

StoreError
    StateUnusable           what was kept of a site cannot be relied on; the message names the file and what to do
    JournalUnusable         rows cannot be added to a journal as it is; the message names the file and what to do
        JournalOfAnother    it is of another site, or of a newer version of this program
    JournalUnreadable       a journal cannot be read; the message names the file, what is wrong and what to do
        JournalBusy         another program keeps it locked
        RowUnreadable       a row holds what no manager writes
    ChainBroken             a journal is not as it was written; the first bad row is named, and what is wrong with it
    KeysUnusable            the keys of a site cannot be read or changed; the message says why and what to do
"""

from __future__ import annotations

from pathlib import Path


class StoreError(Exception):
    """Root of everything that the store raises on purpose."""


class StateUnusable(StoreError):
    """What was kept of a site cannot be relied on; the message names the file and what to do."""


class JournalUnusable(StoreError):
    """Rows cannot be added to a journal as it is; the message names the file and what to do."""


class JournalOfAnother(JournalUnusable):
    """A journal is of another site, or of a newer version of this program: it is whole, and not this manager's to write to."""


class JournalUnreadable(StoreError):
    """A journal cannot be read; the message names the file, what is wrong and what to do."""


class JournalBusy(JournalUnreadable):
    """Another program keeps the file locked."""


class RowUnreadable(JournalUnreadable):
    """A row holds what no manager writes."""

    def __init__(self, path: Path, seq: int, what: str) -> None:
        """Say of a row what is wrong, in words that follow its number."""
        super().__init__(f"{path}: row {seq} {what}; `lift-manager audit --verify` looks through the whole journal")
        self.seq, self.what = seq, what


class ChainBroken(StoreError):
    """The journal is not as it was written. The first bad row is named, and what is wrong with it."""

    def __init__(self, seq: int, what: str) -> None:
        """Say what is wrong in words that follow the number of a row."""
        super().__init__(f"row {seq} {what}")
        self.seq, self.what = seq, what


class KeysUnusable(StoreError):
    """The keys of a site cannot be read or changed; the message says why and what to do."""
