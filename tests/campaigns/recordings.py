"""Recordings on disk: one compressed file for each recorded minute, and a manifest with a hash of each of its channels."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Json = Any
"""What JSON can hold. Recordings are compared as they are, whatever their shape."""
Recording = dict[str, list[list[Json]]]
"""By channel: entries of time and content, in the order of their times."""
MANIFEST = "manifest.json"


class RecordingError(Exception):
    """A folder that has no recordings, or not those that were wanted."""


@dataclass(frozen=True)
class Folder:
    """A folder with recordings."""

    path: Path

    def write(self, name: str, recording: Recording) -> None:
        """Put one recording here. The same recording gives the same bytes."""
        self.path.mkdir(parents=True, exist_ok=True)
        self._file(name).write_bytes(gzip.compress(_bytes(recording), compresslevel=6, mtime=0))

    def seal(self, hashes: Mapping[str, Mapping[str, str]]) -> None:
        """Write the manifest, once every recording is here."""
        text = json.dumps(dict(sorted(hashes.items())), indent=1, sort_keys=True)
        (self.path / MANIFEST).write_text(text + "\n", "utf-8")

    def hashes(self) -> dict[str, dict[str, str]]:
        """Return the hash of each channel by recording. Raises RecordingError."""
        try:
            return dict(json.loads((self.path / MANIFEST).read_text("utf-8")))
        except (OSError, ValueError) as error:
            raise RecordingError(f"{self.path} has no complete recordings: {error}") from error

    def read(self, name: str) -> Recording:
        """Return one recording. Raises RecordingError."""
        try:
            return dict(json.loads(gzip.decompress(self._file(name).read_bytes())))
        except (OSError, ValueError) as error:
            raise RecordingError(f"the recording {name} in {self.path} cannot be read: {error}") from error

    def names(self) -> Iterator[str]:
        """Yield the name of each recording."""
        yield from self.hashes()

    def _file(self, name: str) -> Path:
        return self.path / f"{name}.json.gz"


def hashes_of(recording: Recording) -> dict[str, str]:
    """Return a short hash of each channel."""
    return {channel: hashlib.sha256(_bytes(entries)).hexdigest()[:16] for channel, entries in recording.items()}


def _bytes(value: Json) -> bytes:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), sort_keys=True).encode()
