"""Parses server-sent events by the rules of the WHATWG (HTML, section 9.2.6). Pure."""

from __future__ import annotations

import codecs
from dataclasses import dataclass

LIMIT = 16 * 1024 * 1024
"""In characters. Chosen: a snapshot of a thousand lifts is a tenth of it."""


class TooLong(ValueError):
    """A line or an event is longer than anything a manager sends."""


@dataclass(frozen=True)
class Message:
    """One event as it was sent."""

    event: str
    """Its name; `message` where it has none."""
    data: str
    id: str
    """The id of this event, or the newest one before it; empty before the first id."""


class EventParser:
    """Takes bytes in chunks of any size and returns whole events.

    Lines end with CR, LF or CRLF and nothing else: text may contain other separators such as U+2028, at which `str.splitlines` would
    split.
    """

    def __init__(self, limit: int = LIMIT, last_id: str = "") -> None:
        """`limit` bounds the characters kept of an unfinished event."""
        self._limit = limit
        # `replace`, as the specification requires; it also keeps half a character back for the next chunk
        self._decode = codecs.getincrementaldecoder("utf-8")("replace")
        self._parts: list[str] = []
        self._kept = 0
        self._first = True
        self._after_cr = False
        self._event = ""
        self._data: list[str] = []
        self._data_kept = 0
        self._id = last_id

    def feed(self, chunk: bytes) -> list[Message]:
        """Return the events that this chunk completes. Raises TooLong, after which the parser cannot be used."""
        text = self._decode.decode(chunk)
        if self._first and text:
            self._first = False
            text = text.removeprefix("\ufeff")
        # a CR has ended its line already; the LF of the same pair may arrive a chunk later
        if self._after_cr and text:
            text = text.removeprefix("\n")
            self._after_cr = False
        self._after_cr = self._after_cr or text.endswith("\r")
        *whole, rest = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        found: list[Message] = []
        for line in whole:
            self._keep(line)
            message = self._line("".join(self._parts))
            self._parts.clear()
            self._kept = 0
            if message is not None:
                found.append(message)
        self._keep(rest)
        return found

    def _keep(self, piece: str) -> None:
        if piece:
            self._parts.append(piece)
            self._kept += len(piece)
        if self._kept + self._data_kept > self._limit:
            raise TooLong(f"an event of more than {self._limit} characters")

    def _line(self, line: str) -> Message | None:
        if not line:
            return self._dispatch()
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "data":
            self._data.append(value)
            self._data_kept += len(value) + 1
        elif name == "event":
            self._event = value
        elif name == "id" and "\0" not in value:
            self._id = value
        # a line that begins with a colon is a comment and has no name; `retry` is ignored, because our own pauses are bounded already
        return None

    def _dispatch(self) -> Message | None:
        event, data = self._event or "message", self._data
        self._event, self._data, self._data_kept = "", [], 0
        return Message(event, "\n".join(data), self._id) if data else None
