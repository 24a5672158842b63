"""Finds the recorded announcements of the lobby view in the folder that a site file names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

MOMENTS = ("enters", "leaves", "stopped")
"""What is announced: a robot enters, a robot leaves, robots are stopped. Also the names of the files, without their ending."""
MEDIA_TYPES = {
    ".mp3": "audio/mpeg",
    ".m4a": "audio/mp4",
    ".ogg": "audio/ogg",
    ".opus": "audio/ogg",
    ".wav": "audio/wav",
}
"""By the ending of a file. Not from `mimetypes`, which knows what the computer knows."""


def find_announcements(folder: Path) -> Mapping[str, Path]:
    """Return the recording for each moment that has one. Raises OSError if the folder cannot be read."""
    found = {file.stem: file for file in sorted(folder.iterdir()) if file.suffix in MEDIA_TYPES}
    return {moment: found[moment] for moment in MOMENTS if moment in found}


def announcement_cautions(folder: Path) -> Iterator[str]:
    """Yield what people should know about the folder, a line each; the lifts need none of it."""
    names = ", ".join(MOMENTS)
    try:
        found = find_announcements(folder)
    except OSError as error:
        yield f"announcements: {folder} cannot be read ({error.strerror}), so nothing is announced"
        return
    if not found:
        yield (
            f"announcements: {folder} has no recording, so nothing is announced; it may have {names}, each with one of the endings"
            f" {', '.join(MEDIA_TYPES)}"
        )
