"""The hash chain of a journal: the hash of each row covers the row and the hash of the row before it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, assert_never

from lift_manager.lift.journal import Json

_encode = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode


class StoredRow(NamedTuple):
    """A row of the table `rows`, in the order of its columns."""

    seq: int
    """1, 2, 3 and so on."""
    at: int
    """Microseconds since 1970, UTC."""
    kind: str
    lift: str
    caller: str
    text: str
    data: str
    """Canonical JSON; this text is hashed as it is, so verifying a row need not parse it."""
    hash: bytes
    """32 bytes."""


def canonical(value: Json) -> str:
    """Return canonical JSON: sorted keys, no spaces, no needless escapes.

    Numbers that JSON does not have, `nan` and `inf`, become text. Half a surrogate pair becomes `?`, as in `clean`.
    """
    return _encode(_plain(value))


def clean(text: str) -> str:
    """Return the text with `?` for what UTF-8 cannot encode."""
    return text.encode("utf-8", "replace").decode("utf-8")


def seed(site: str) -> bytes:
    """Return the hash that stands before row 1."""
    return hashlib.sha256(f"lift-manager journal\n{site}".encode("utf-8", "replace")).digest()


def row_hash(before: bytes, row: StoredRow) -> bytes:
    """Return the hash of a row that follows a row with the hash `before`; the `hash` of the row itself is ignored."""
    return hashlib.sha256(before + _encode(row[:7]).encode()).digest()


def follows(before: object, row: StoredRow) -> bool:
    """Whether a row that was found in a file is the one that was written after a row with the hash `before`."""
    as_written = all(type(cell) is kind for cell, kind in zip(row, _TYPES, strict=True))
    return isinstance(before, bytes) and as_written and row_hash(before, row) == row.hash


_TYPES = (int, int, str, str, str, str, str, bytes)


def _plain(value: Json) -> Json:
    match value:
        case str():
            return clean(value)
        case float() if not math.isfinite(value):
            return str(value)
        case None | bool() | int() | float():
            return value
        case Mapping():
            return {clean(key): _plain(entry) for key, entry in value.items()}
        case Sequence():
            return [_plain(entry) for entry in value]
        case _:
            assert_never(value)
