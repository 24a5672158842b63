"""A mistake in a site file, before its line is known."""

from __future__ import annotations

from dataclasses import dataclass

Key = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake: its key in the site file, and how to correct it."""

    key: Key
    message: str
