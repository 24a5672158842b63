"""Finds the photos that a record names, so that a report can hold them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from lift_manager.commissioning.checkout.record import Record

LARGEST_MB = 10
"""A larger photo is named and not put in. Chosen: a phone's photo has 2 to 6 MB, and a report with forty of them has to open."""

_TYPES = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG\r\n\x1a\n": "image/png", b"GIF8": "image/gif"}


@dataclass(frozen=True, slots=True)
class Photo:
    """One photo as a report has it."""

    path: str
    """As in the record."""
    media_type: str = ""
    data: bytes = b""
    problem: str = ""
    """Why the photo itself is not in the report; empty if it is."""

    @property
    def sha256(self) -> str:
        """Hash of the file; empty without one."""
        return hashlib.sha256(self.data).hexdigest() if self.data else ""


def read_photos(record: Record, folder: Path) -> dict[str, Photo]:
    """Read every photo of the results that count, by the path in the record; `folder` is that of the record."""
    paths = dict.fromkeys(path for result in record.newest.values() for path in result.photos)
    return {path: _read(path, folder) for path in paths}


def _read(path: str, folder: Path) -> Photo:
    try:
        file = folder / path
        if file.stat().st_size > LARGEST_MB * 1_000_000:
            return Photo(path, problem=f"larger than {LARGEST_MB} MB")
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        return Photo(path, problem=f"cannot be read ({reason})")
    for start, media_type in _TYPES.items():
        if data.startswith(start):
            return Photo(path, media_type, data)
    return Photo(path, problem="is no JPEG, PNG or GIF")
