"""Files that are written for people: never over one that is there, unless that was asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path


class OutputRefused(Exception):
    """A file cannot or must not be written; the sentence says why, and what to do."""


def check_ending(path: Path, endings: Iterable[str]) -> str:
    """Return the ending of a file in lower case. Raises OutputRefused for one that is not listed."""
    listed = list(endings)
    ending = path.suffix.lower()
    if ending not in listed:
        raise OutputRefused(f"{path}: the ending says what to write; give the file the ending {' or '.join(listed)}")
    return ending


def check_free(paths: Iterable[Path], *, force: bool) -> None:
    """Raise OutputRefused for files that are there already, unless they may be replaced."""
    there = [str(path) for path in paths if path.exists()]
    if there and not force:
        raise OutputRefused(f"{' and '.join(there)}: there already; give another name, or --force to replace it")


def save(files: Mapping[Path, bytes], *, force: bool) -> None:
    """Write files, all or none of them where one is there already. Raises OutputRefused."""
    check_free(files, force=force)
    for path, content in files.items():
        try:
            path.write_bytes(content)
        except OSError as error:
            raise OutputRefused(f"{path}: cannot be written: {error.strerror or error}") from error
