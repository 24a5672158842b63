"""Text that people read."""

from __future__ import annotations

import re

_JOINERS = dict.fromkeys(map(ord, "\u200c\u200d"))
"""Invisible, but Persian and Indian scripts cannot be written without them."""
_SECONDS = re.compile(r"\d+(?:\.\d+)? s\b")


def is_printable(text: str) -> bool:
    """Whether a text may be shown and written down: it is one line, without control characters."""
    return text.replace("\u00a0", " ").translate(_JOINERS).isprintable()


def counted(number: int, thing: str) -> str:
    """Return `1 lift` or `2 lifts`."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def without_seconds(text: str) -> str:
    """Return a text without its durations in seconds, so that two texts compare equal if nothing else differs."""
    return _SECONDS.sub("", text)
