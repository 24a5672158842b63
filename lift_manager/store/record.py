"""Encodes a record as JSON with pydantic, and decodes it only if it is complete."""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields, is_dataclass
from datetime import MAXYEAR, MINYEAR, datetime
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from lift_manager.runtime.recorder import SavedLift


class RecordDamaged(ValueError):
    """A record is not as a manager wrote it; the message names the problem."""


# pydantic takes no configuration for a plain dataclass, but applies it to those inside a list
_ADAPTER = TypeAdapter(list[SavedLift], config=ConfigDict(strict=True, extra="forbid"))


def encode(saved: SavedLift) -> str:
    """Return the saved state of a lift as JSON."""
    return _ADAPTER.dump_json([saved]).decode()[1:-1]


def decode(text: str) -> SavedLift:
    """Decode the saved state of a lift. Raises RecordDamaged for anything that `encode` does not write, including a missing field."""
    try:
        (saved,) = _ADAPTER.validate_json(f"[{text}]")
        there, expected = json.loads(text), json.loads(encode(saved))
    except ValidationError as error:
        raise RecordDamaged(_first(error)) from error
    except ValueError as error:
        raise RecordDamaged(str(error)) from error
    _require_all("", there, expected)
    _require_moments("", saved)
    return saved


def digest(lift: str, text: str) -> bytes:
    """Return the hash that is stored with the record of a lift."""
    return hashlib.sha256(f"{lift}\n{text}".encode()).digest()


def _require_all(place: str, there: Any, expected: Any) -> None:
    """Raise RecordDamaged for a missing field: its default could hide a fire."""
    if isinstance(expected, dict):
        for name, value in expected.items():
            inner = f"{place}.{name}".removeprefix(".")
            if name not in there:
                raise RecordDamaged(f"{inner}: is missing")
            _require_all(inner, there[name], value)
    elif isinstance(expected, list):
        for number, (one, other) in enumerate(zip(there, expected, strict=True)):
            _require_all(f"{place}.{number}", one, other)


def _require_moments(place: str, value: object) -> None:
    """Raise RecordDamaged for a time without a zone, or one that some zones cannot represent."""
    if isinstance(value, datetime):
        if value.tzinfo is None:
            raise RecordDamaged(f"{place}: is a time without a zone")
        if not MINYEAR < value.year < MAXYEAR:
            raise RecordDamaged(f"{place}: the year {value.year} cannot be")
    elif isinstance(value, tuple):
        for number, entry in enumerate(value):
            _require_moments(f"{place}.{number}", entry)
    elif is_dataclass(value):
        for field in fields(value):
            _require_moments(f"{place}.{field.name}".removeprefix("."), getattr(value, field.name))


def _first(error: ValidationError) -> str:
    found = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in found["loc"][1:])
    return f"{place}: {found['msg']}" if place else str(found["msg"])
