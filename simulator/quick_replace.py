"""A faster `_replace` for tuples of which each scan of a lift makes several."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

Kind = TypeVar("Kind", bound=type[NamedTuple])


def quick_replace(kind: Kind) -> Kind:
    """Give a named tuple a `_replace` that copies the fields and sets the changed ones: the standard one looks each field up, at twice the time."""
    place_of = {name: place for place, name in enumerate(kind._fields)}

    def replaced(self: tuple[Any, ...], /, **changes: Any) -> Any:
        fields = list(self)
        for name, value in changes.items():
            fields[place_of[name]] = value
        return tuple.__new__(kind, fields)

    kind._replace = replaced  # type: ignore[misc, assignment]  # so that calls are checked as those of the standard one
    return kind
