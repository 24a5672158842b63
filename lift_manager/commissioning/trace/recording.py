"""The file of a trace: a line of JSON for the link, then one for each frame and each gap, in the order of time."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from register_maps import frames

VERSION = 1


class RecordingUnusable(Exception):
    """A file is not the recording of a link; the sentence says where and why."""


@dataclass(frozen=True, slots=True)
class Header:
    """What is known of a recording at its beginning."""

    link: str
    """The controller, as the site file names it."""
    began: datetime
    program: str = ""
    """What recorded it, and its version."""


@dataclass(frozen=True, slots=True)
class TracedFrame:
    """One frame on the link."""

    at_s: float
    """Since the recording began."""
    is_request: bool
    """To the controller; otherwise from it."""
    frame: bytes
    """Whole, with its MBAP header."""
    text: str = ""
    """The frame in words."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Frames from here on may be missing, and those before and after belong to no common exchange."""

    at_s: float
    reason: str


Item = TracedFrame | Gap


@dataclass(frozen=True, slots=True)
class Recording:
    """A whole file."""

    header: Header
    items: tuple[Item, ...]

    def time_of(self, at_s: float) -> datetime:
        """Return the time of day of an item."""
        return self.header.began + timedelta(seconds=at_s)


def header_line(header: Header) -> str:
    """Return the first line of a file."""
    return _line({"trace": VERSION, "link": header.link, "began": _time(header.began), "program": header.program})


def item_line(header: Header, item: Item) -> str:
    """Return the line of a frame or a gap."""
    when = {"time": _time(header.began + timedelta(seconds=item.at_s)), "at_s": round(item.at_s, 6)}
    if isinstance(item, Gap):
        return _line(when | {"gap": item.reason})
    direction = "request" if item.is_request else "answer"
    return _line(when | {"direction": direction, "hex": item.frame.hex(" "), "text": item.text})


def read_recording(path: Path) -> Recording:
    """Read a file. A last line that is incomplete, as after a power cut, is left out. Raises RecordingUnusable."""
    try:
        lines = path.read_text("utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise RecordingUnusable(f"{path}: cannot be read: {reason}") from error
    if not lines:
        raise RecordingUnusable(f"{path}: is empty; `lift-manager trace record` makes such files")
    header = _header(path, lines[0])
    return Recording(header, tuple(_items(path, lines)))


def _header(path: Path, line: str) -> Header:
    try:
        found = json.loads(line)
        if found["trace"] != VERSION:
            raise RecordingUnusable(f"{path}:1: its format is {found['trace']!r}; this version reads {VERSION}")
        began = datetime.fromisoformat(found["began"])
        return Header(str(found["link"]), began.replace(tzinfo=began.tzinfo or UTC), str(found.get("program", "")))
    except (ValueError, KeyError, TypeError) as error:
        advice = "give the .jsonl file that `lift-manager trace record` wrote"
        raise RecordingUnusable(f"{path}: is not the recording of a link; {advice}") from error


def _items(path: Path, lines: list[str]) -> Iterator[Item]:
    last_s = 0.0
    for number, line in enumerate(lines[1:], 2):
        try:
            item = _item(json.loads(line))
        except (ValueError, KeyError, TypeError) as error:
            if number == len(lines) and not line.endswith("\n"):
                return
            raise RecordingUnusable(f"{path}:{number}: is neither a frame nor a gap: {line.strip()[:60]}") from error
        if item.at_s < last_s:
            raise RecordingUnusable(f"{path}:{number}: is earlier than the line before; the lines were rearranged")
        last_s = item.at_s
        yield item


def _item(found: dict[str, Any]) -> Item:
    at_s = float(found["at_s"])
    if "gap" in found:
        return Gap(at_s, str(found["gap"]))
    frame = bytes.fromhex(found["hex"])
    whole, rest = frames.split(frame)
    if len(whole) != 1 or rest:
        raise ValueError("not one frame")
    is_request = {"request": True, "answer": False}[found["direction"]]
    return TracedFrame(at_s, is_request, frame, str(found.get("text", "")))


def _line(fields: dict[str, object]) -> str:
    return json.dumps(fields, ensure_ascii=False) + "\n"


def _time(when: datetime) -> str:
    return when.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds") + "Z"
