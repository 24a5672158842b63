"""A mistake in a site file, before anybody knows its line."""

from __future__ import annotations

from dataclasses import dataclass

Key = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake: where it is in the site file, and how to mend it."""

    key: Key
    message: str
