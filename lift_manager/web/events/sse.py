"""Server-sent events as bytes (WHATWG HTML, section 9.2.5). Pure."""

from __future__ import annotations

from pydantic import BaseModel

MEDIA_TYPE = "text/event-stream"
HEARTBEAT = b":\n\n"
"""A comment: it shows that the manager lives, and says nothing else."""


def event(name: str, said: BaseModel, event_id: str = "") -> bytes:
    """Return one event; without an id the reader's last one stays as it is. JSON has no line breaks of its own: one line of data."""
    data = said.model_dump_json(by_alias=True)
    head = f"id: {event_id}\n" if event_id else ""
    return f"{head}event: {name}\ndata: {data}\n\n".encode()


def retry(after_ms: int) -> bytes:
    """Return the wish that a reader whose connection breaks comes back after so long."""
    return b"retry: %d\n\n" % after_ms
