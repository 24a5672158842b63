"""The copies of frozen values that a step makes most of."""

from __future__ import annotations

from typing import Any, Self

_set = object.__setattr__


class Value:
    """A frozen dataclass without slots, so that a copy of it is a copy of one table."""

    def having(self, **fields: Any) -> Self:
        """Return this with other values, in a tenth of the time of `dataclasses.replace`. Names are not checked."""
        after = object.__new__(type(self))
        _set(after, "__dict__", {**vars(self), **fields})
        return after
