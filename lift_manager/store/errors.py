"""Every error the store raises on purpose.

StoreError
    StoreUnusable           what is kept of a site cannot be relied on, so nothing starts; the message names the file and what to do
    CommitFailed            nothing can be written now; the message names the file, the reason and what to do
        StoreDamaged        the file is not as a manager left it
            StoreForeign    it is of another site, another program or a newer version of this one
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


class StoreUnusable(StoreError):
    """What is kept of a site cannot be relied on, so nothing starts; the message names the file and what to do."""


class CommitFailed(StoreError):
    """Nothing can be written now."""

    def __init__(self, what: str, advice: str) -> None:
        """Say what is wrong, in words that name the file, and what to do."""
        super().__init__(f"{what}; {advice}")
        self.what, self.advice = what, advice


MOVE_AWAY = (
    "while the manager runs, move it to another folder, with what is beside it under the same name and `-wal`, and keep it: the"
    " manager then begins another with all that it remembers, which a restart before that would forget"
)


class StoreDamaged(CommitFailed):
    """The file is not as a manager left it."""

    def __init__(self, path: Path, what: str, advice: str = MOVE_AWAY) -> None:
        """Say what is wrong in words that follow the name of the file."""
        super().__init__(f"the store {path} {what}", advice)
        self.path = path
        self.of_file = what


class StoreForeign(StoreDamaged):
    """It is of another site, another program or a newer version of this one."""


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
