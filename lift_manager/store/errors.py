"""Every error the store raises on purpose.

StoreError
    StateUnusable       what was kept of a site cannot be relied on; the message names the file and what to do
    JournalUnusable     rows cannot be added to a journal as it is; the message names the file and what to do
    KeysUnusable        the keys of a site cannot be read or changed; the message says why and what to do
"""

from __future__ import annotations


class StoreError(Exception):
    """Root of everything that the store raises on purpose."""


class StateUnusable(StoreError):
    """What was kept of a site cannot be relied on; the message names the file and what to do."""


class JournalUnusable(StoreError):
    """Rows cannot be added to a journal as it is; the message names the file and what to do."""


class KeysUnusable(StoreError):
    """The keys of a site cannot be read or changed; the message says why and what to do."""
