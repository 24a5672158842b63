"""Numbers of things in words."""

from __future__ import annotations


def counted(number: int, thing: str) -> str:
    """Return `1 lift` or `2 lifts`."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
