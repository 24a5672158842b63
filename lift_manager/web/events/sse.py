"""Server-sent events as bytes (WHATWG HTML, section 9.2.5). Pure."""

from __future__ import annotations

from pydantic import BaseModel

MEDIA_TYPE = "text/event-stream"
HEARTBEAT = b":\n\n"
"""A comment, which only shows that the manager is alive."""


def event(name: str, data_model: BaseModel, event_id: str = "") -> bytes:
    """Return one event; without an id, the last event id of the reader does not change. JSON has no line breaks: one line of data."""
    data = data_model.model_dump_json(by_alias=True)
    head = f"id: {event_id}\n" if event_id else ""
    return f"{head}event: {name}\ndata: {data}\n\n".encode()


def retry(after_ms: int) -> bytes:
    """Return the instruction to reconnect after this time."""
    return b"retry: %d\n\n" % after_ms
