"""Every error the store raises on purpose.

StoreError
    StoreUnusable           the store of a site cannot be trusted, so nothing starts; the message names the file and the remedy
    CommitFailed            nothing can be written now; the message names the file, the reason and the remedy
        StoreDamaged        the file is not as a manager left it
            StoreForeign    the file belongs to another site, another program or a newer version of this one
    JournalUnreadable       a journal cannot be read; the message names the file, the problem and the remedy
        JournalBusy         another program has locked the file
        RowUnreadable       a row has a value that no manager writes
    ChainBroken             a journal was changed; the message names the first bad row and the problem
    KeysUnusable            the keys of a site cannot be read or changed; the message gives the reason and the remedy
"""

from __future__ import annotations

from pathlib import Path


class StoreError(Exception):
    """Root of everything that the store raises on purpose."""


class StoreUnusable(StoreError):
    """The store of a site cannot be trusted, so nothing starts; the message names the file and the remedy."""


class CommitFailed(StoreError):
    """Nothing can be written now."""

    def __init__(self, what: str, advice: str) -> None:
        """`what` names the file and the problem, `advice` is the remedy."""
        super().__init__(f"{what}; {advice}")
        self.what, self.advice = what, advice


MOVE_AWAY = (
    "while the manager runs, move it to another folder, together with the file of the same name and `-wal`, and keep both: the"
    " manager then starts a new one with everything it remembers, which a restart before that would lose"
)


class StoreDamaged(CommitFailed):
    """The file is not as a manager left it."""

    def __init__(self, path: Path, what: str, advice: str = MOVE_AWAY) -> None:
        """`what` follows the name of the file in the message."""
        super().__init__(f"the store {path} {what}", advice)
        self.path = path
        self.problem = what


class StoreForeign(StoreDamaged):
    """The file belongs to another site, another program or a newer version of this one."""


class JournalUnreadable(StoreError):
    """A journal cannot be read; the message names the file, the problem and the remedy."""


class JournalBusy(JournalUnreadable):
    """Another program has locked the file."""


class RowUnreadable(JournalUnreadable):
    """A row has a value that no manager writes."""

    def __init__(self, path: Path, seq: int, what: str) -> None:
        """`what` follows the number of the row in the message."""
        super().__init__(f"{path}: row {seq} {what}; `lift-manager audit --verify` checks the whole journal")
        self.seq, self.what = seq, what


class ChainBroken(StoreError):
    """The journal was changed. The message names the first bad row and the problem."""

    def __init__(self, seq: int, what: str) -> None:
        """`what` follows the number of the row in the message."""
        super().__init__(f"row {seq} {what}")
        self.seq, self.what = seq, what


class KeysUnusable(StoreError):
    """The keys of a site cannot be read or changed; the message gives the reason and the remedy."""
