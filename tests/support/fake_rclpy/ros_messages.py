"""Messages that check what is put into them, as those of rosidl do."""

from __future__ import annotations

import array
from collections.abc import Callable, Mapping
from typing import Any, ClassVar


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_flag(value: object) -> bool:
    return isinstance(value, bool)


def _whole(low: int, high: int) -> Callable[[object], bool]:
    return lambda value: isinstance(value, int) and not isinstance(value, bool) and low <= value <= high


def _each(check: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: isinstance(value, list) and all(check(one) for one in value)


_uint8 = _whole(0, 2**8 - 1)
_CHECKS: Mapping[str, Callable[[object], bool]] = {
    "bool": _is_flag,
    "string": _is_text,
    "string[]": _each(_is_text),
    "uint8": _uint8,
    "uint8[]": lambda value: isinstance(value, array.array) or _each(_uint8)(value),
    "int32": _whole(-(2**31), 2**31 - 1),
    "uint32": _whole(0, 2**32 - 1),
}
_EMPTY: Mapping[str, Callable[[], object]] = {
    "bool": bool,
    "string": str,
    "string[]": list,
    "uint8": int,
    "uint8[]": list,
    "int32": int,
    "uint32": int,
}


class Message:
    FIELDS: ClassVar[Mapping[str, Any]] = {}
    """Name to the type in the .msg text, or to the class of a message within."""

    def __init__(self, **values: object) -> None:
        unknown = values.keys() - self.FIELDS.keys()
        if unknown:
            raise AssertionError(f"Invalid arguments passed to constructor: {', '.join(sorted(unknown))}")
        for name, kind in self.FIELDS.items():
            empty = _EMPTY[kind] if isinstance(kind, str) else kind
            setattr(self, name, values.get(name, empty()))

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in self.FIELDS:
            raise AttributeError(f"{type(self).__name__} has no field {name}")
        kind = self.FIELDS[name]
        fits = _CHECKS[kind](value) if isinstance(kind, str) else isinstance(value, kind)
        if not fits:
            raise AssertionError(f"The '{name}' field must be {kind}, and is {value!r}")
        object.__setattr__(self, name, array.array("B", value) if kind == "uint8[]" else value)

    def check_whole(self) -> None:
        """What rosidl finds only when it turns a message into C: a text that is no UTF-8, a list that was changed later."""
        for name, kind in self.FIELDS.items():
            value = getattr(self, name)
            setattr(self, name, value)
            for text in value if kind == "string[]" else [value] if kind == "string" else []:
                text.encode("utf-8")

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and vars(other) == vars(self)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}={getattr(self, name)!r}" for name in self.FIELDS)
        return f"{type(self).__name__}({inside})"
