"""What the keeper of a session needs of the task of its lift."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lift_manager.domain.sight import Sight


@dataclass(frozen=True, slots=True)
class Around:
    """The lift around a session."""

    sight: Callable[[float], Sight | None]
    """What is known at a time, unless it is too old by then."""
    last_sight: Callable[[], Sight | None]
    """The same however old it is."""
    changed: Callable[[], None]
    """Hears when there is news to publish."""
    trouble: Callable[[], str]
    """Why nothing may be pressed, because it cannot be written down; empty while it can."""
