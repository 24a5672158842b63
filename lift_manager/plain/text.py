"""Text that people read."""

from __future__ import annotations

_JOINERS = dict.fromkeys(map(ord, "\u200c\u200d"))
"""Unseen, but Persian and Indian scripts cannot be written without them."""


def is_printable(text: str) -> bool:
    """Whether a text may be shown and written down: it is one line, without control characters."""
    return text.replace("\u00a0", " ").translate(_JOINERS).isprintable()
