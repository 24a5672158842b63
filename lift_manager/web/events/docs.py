"""What /docs says about event streams."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from starlette.responses import Response

from lift_manager.api.events import Links
from lift_manager.api.problem import MEDIA_TYPE as PROBLEM_TYPE
from lift_manager.web.events.sse import MEDIA_TYPE
from lift_manager.web.operations import LINK
from lift_manager.web.schemas import PROBLEM, schema_of

TAG = "events"

TAG_DESCRIPTION = """
What happens, as server-sent events, for as long as the caller listens.

- **Snapshot first**: how each lift is and which rides go on; then changes. Every event has a name and one line of JSON.
- **Nothing is lost or repeated when a connection breaks**: send the id of the newest event that was heard as `Last-Event-ID`, as every
  browser does by itself (or as `last_event_id` in the query). The stream goes on behind it. Where those events are gone (after five
  minutes, 4096 events, or a restart of the manager) it begins with a snapshot that says `lost: true`; so it does for an id that is none.
- **Something comes every second**, if only a comment line. Whoever hears nothing for a lift's `max_age_s` knows nothing of that lift.
- **An event tells when to ask.** What a robot acts on is the answer of GET, or an event whose age plus the time since it was received
  is within the lift's `max_age_s`. Who has not read the connection for a while cannot know when an event was received, and asks.
- **What is old invites nobody**: an event that waited for longer than the lift's `max_age_s`, as after a broken connection, says `offline`
  for a lift, and of a ride `wait` for `enter` and `stay` for `leave`; the reason says so.
- **Ages**: `age_s` is right within a quarter of a second when the event is handed to the connection. What was received is as old as that and
  the time since. While the stream is heard, a state stands until the next one: the loss of a lift is an event too.
- **A reader that is too slow** loses what waits for it, 256 events at most, gets `lost` with their number and a snapshot, and goes on from
  there. One that takes nothing for a minute is hung up on.
- A stream ends when the manager ends, and within a second when its key is revoked. At most 60 % of all connections are streams, and of these
  half at most are one key's.
- The id of an event is also in the manager's log and in its journal (`lift-manager audit --event ID`). Ids of sessions are in none of them.
"""

_EXAMPLE = """retry: 1500

id: mi9x1k2a-41
event: snapshot
data: {"event":"snapshot","lifts":[],"rides":[],"lost":false}

id: mi9x1k2a-42
event: session
data: {"event":"session","lift":"goods","what":"opened","holder":"api:amr-7","to":"L2","reason":null,"text":"","advice":null}

:

"""
_FRAMES = """retry: 1500

event: frame
data: {"event":"frame","link":"plc","sent":true,"hex":"00 01 00 00 00 06 01 03 00 00 00 08","text":"FC3 read","at_s":12.5}

"""
_OTHER_COMPUTER = "Another computer asked a site without keys (`other_computer`)."
_FULL = "Too many event streams are open, in all or by this key (`too_many_streams`)."


def events() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    lift = "Only what concerns this lift."
    ride = "Only this ride, and the states of the lift that it is on, also when the manager chooses another."
    after = "Go on behind this event; the header `Last-Event-ID` says the same, and counts where both are sent."
    return {
        "summary": "What happens, as it happens",
        "description": "A snapshot, then every event; see the text of this section.",
        "response_class": Response,
        "responses": {
            200: _stream("The stream.", _EXAMPLE),
            404: _no("There is no such lift (`unknown_lift`) or ride (`unknown_ride`)."),
            422: _no("The query names a lift and a ride, or one thing twice (`malformed`)."),
            503: _no(_FULL),
        },
        "openapi_extra": {
            "parameters": [
                _parameter("lift", "query", lift),
                _parameter("ride", "query", ride),
                _parameter("last_event_id", "query", after),
                _parameter("Last-Event-ID", "header", "The newest event that was heard."),
            ]
        },
    }


def links() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return {
        "summary": "The links to controllers",
        "description": "By their names in the site file.",
        "response_class": Response,
        "responses": {200: _json("All of them.", Links), 403: _no(_OTHER_COMPUTER)},
    }


def frames() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return {
        "summary": "What goes over the wire",
        "openapi_extra": {"parameters": [LINK]},
        "description": "Every Modbus frame of one link as an event `frame`, for tools. Without snapshot, ids and replay.",
        "response_class": Response,
        "responses": {
            200: _stream("The stream.", _FRAMES),
            403: _no(_OTHER_COMPUTER),
            404: _no("There is no such link (`unknown_link`)."),
            503: _no(_FULL),
        },
    }


def _stream(description: str, example: str) -> dict[str, Any]:
    content = {MEDIA_TYPE: {"schema": {"type": "string"}, "example": example}}
    return {"description": description, "content": content}


def _json(description: str, model: type[BaseModel]) -> dict[str, Any]:
    return {"description": description, "content": {"application/json": {"schema": schema_of(model)}}}


def _no(description: str) -> dict[str, Any]:
    return {"description": description, "content": {PROBLEM_TYPE: {"schema": PROBLEM}}}


def _parameter(name: str, where: str, description: str) -> dict[str, Any]:
    return {
        "name": name,
        "in": where,
        "required": False,
        "description": description,
        "schema": {"type": "string", "maxLength": 200},
    }
