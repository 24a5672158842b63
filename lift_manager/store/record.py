"""A record as text: written by pydantic from a frozen dataclass, and read back only if it is whole."""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields, is_dataclass
from datetime import MAXYEAR, MINYEAR, datetime
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from lift_manager.domain.ride_record import KeptRide
from lift_manager.domain.service import EndReason, Remembered
from lift_manager.lift.record import DurableRecord

Record = Any
"""What of one lift outlives the manager: a frozen dataclass with `keeps_robots_out`; the `RecordForm` of a store says which."""


class RecordDamaged(ValueError):
    """A record is not as a manager wrote it; the message says what is wrong."""


class RecordForm:
    """How records of one type are written."""

    def __init__(self, kind: type[Any], **names: type) -> None:
        """`names` are types that the module of `kind` imports for type checkers only."""
        # a configuration reaches the dataclasses inside a list, and none can be given to a dataclass itself
        config = ConfigDict(strict=True, extra="forbid", defer_build=True)
        self._adapter: TypeAdapter[list[Any]] = TypeAdapter(list[kind], config=config)  # type: ignore[valid-type]
        self._adapter.rebuild(_types_namespace=names)

    def encode(self, record: Record) -> str:
        """Return a record as JSON."""
        return self._adapter.dump_json([record]).decode()[1:-1]

    def decode(self, text: str) -> Any:
        """Read a record. Raises RecordDamaged for anything that `encode` does not write, a field that is missing included."""
        try:
            (record,) = self._adapter.validate_json(f"[{text}]")
            there, expected = json.loads(text), json.loads(self.encode(record))
        except ValidationError as error:
            raise RecordDamaged(_first(error)) from error
        except ValueError as error:
            raise RecordDamaged(str(error)) from error
        _require_all("", there, expected)
        _require_moments("", record)
        return record


REMEMBERED = RecordForm(Remembered, KeptRide=KeptRide, EndReason=EndReason)
"""Records of the core of today."""
DURABLE = RecordForm(DurableRecord)


def digest(lift: str, text: str) -> bytes:
    """Return the hash that is stored beside the record of a lift."""
    return hashlib.sha256(f"{lift}\n{text}".encode()).digest()


def _require_all(place: str, there: Any, expected: Any) -> None:
    """Raise RecordDamaged for a field that is missing: the value that stands for it in new records may forget a fire."""
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
    """Raise RecordDamaged for a time without a zone, or one that not every zone can show."""
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
