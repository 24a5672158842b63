"""Every error the store raises on purpose.

StoreError
    StateUnusable       what was kept of a site cannot be relied on; the message names the file and what to do
"""

from __future__ import annotations


class StoreError(Exception):
    """Root of everything that the store raises on purpose."""


class StateUnusable(StoreError):
    """What was kept of a site cannot be relied on; the message names the file and what to do."""
