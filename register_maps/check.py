"""What only makes sense across the fields of a map: every problem at once, each with the way to mend it."""

from __future__ import annotations

from dataclasses import dataclass

from register_maps.schema import RegisterMap


@dataclass(frozen=True, slots=True)
class Problem:
    """Something in a map that cannot be right, or (a warning) may not be."""

    path: tuple[str | int, ...]
    message: str
    warning: bool = False


def check(map_: RegisterMap) -> list[Problem]:
    """Return every problem of a map."""
    return []
