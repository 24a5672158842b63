"""Part of /api/v1: what happens, as it happens; and for tools, what goes over the wires."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Path, Query, Request
from pydantic.json_schema import SkipJsonSchema
from starlette.responses import Response

from lift_manager.api.events import Links
from lift_manager.api.keys import Keys
from lift_manager.runtime.errors import NotFound
from lift_manager.runtime.links import FrameSource
from lift_manager.runtime.site import Site
from lift_manager.web.access import caller
from lift_manager.web.body import shown
from lift_manager.web.callers import ServedSite, no_other_computer
from lift_manager.web.errors import RequestError
from lift_manager.web.events.feed import Feed, StreamScope
from lift_manager.web.events.frames import FrameFeed
from lift_manager.web.events.readers import OpenStreams
from lift_manager.web.events.sse import MEDIA_TYPE
from lift_manager.web.events.stream import EventStream
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import errors_of
from lift_manager.web.query import require_once

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
_FULL = "Too many event streams are open, in all or by this key (`too_many_streams`)."


def _stream(example: str, errors: dict[int, str]) -> dict[int | str, dict[str, Any]]:
    content = {MEDIA_TYPE: {"schema": {"type": "string"}, "example": example}}
    return {200: {"description": "The stream.", "content": content}, **errors_of(errors)}


class Streams:
    """The open streams of one application, and what they are fed from."""

    def __init__(self, site: Site, frames: FrameSource | None, most: int) -> None:
        """At most so many streams are open at a time."""
        self.places = OpenStreams(most)
        self.events = Feed(site, self.places)
        self.links = () if frames is None else frames.link_names()
        self.frames = None if frames is None else FrameFeed(frames, self.places)


router = APIRouter(prefix="/api/v1", tags=[TAG], route_class=JsonRoute, strict_content_type=False)

_LIMIT = {"maxLength": 200}
"""Said, not checked: nothing of that length is known here."""
Text = str | SkipJsonSchema[None]
_OTHER_COMPUTER = "Another computer asked a site without keys (`other_computer`)."


@router.get(
    "/events",
    summary="What happens, as it happens",
    response_class=Response,
    responses=_stream(
        _EXAMPLE,
        {
            404: "There is no such lift (`unknown_lift`) or ride (`unknown_ride`).",
            422: "The query names a lift and a ride, or one thing twice (`malformed`).",
            503: _FULL,
        },
    ),
)
async def events(
    request: Request,
    site: ServedSite,
    lift: Annotated[Text, Query(description="Only what concerns this lift.", json_schema_extra=_LIMIT)] = None,
    ride: Annotated[
        Text,
        Query(
            description="Only this ride, and the states of the lift that it is on, also when the manager chooses another.",
            json_schema_extra=_LIMIT,
        ),
    ] = None,
    after: Annotated[
        Text,
        Query(
            alias="last_event_id",
            description="Go on behind this event; the header `Last-Event-ID` says the same, and counts where both are sent.",
            json_schema_extra=_LIMIT,
        ),
    ] = None,
    last_event_id: Annotated[
        Text,
        Header(alias="Last-Event-ID", description="The newest event that was heard.", json_schema_extra=_LIMIT),
    ] = None,
) -> Response:
    """A snapshot, then every event; see the text of this section."""
    require_once(request, "lift", "ride", "last_event_id")
    if lift is not None and ride is not None:
        text = "give a lift or a ride: a ride comes with the states of its lift"
        raise RequestError("malformed", text, field="ride")
    if lift is not None and lift not in site.lift_names():
        raise RequestError("unknown_lift", f"no lift {shown(lift)}; the lifts are {', '.join(site.lift_names())}")
    if ride is not None:
        try:
            site.rides.ride(ride)
        except NotFound as refused:
            text = f"no ride {shown(ride)}; it ended too long ago to be remembered, or there was none"
            raise RequestError("unknown_ride", text) from refused
    streams: Streams = request.app.state.streams
    # the header is newer: a client that reconnects sends the same address again
    reading = partial(streams.events.reader, StreamScope(lift, ride), last_event_id or after or None, _admits(request))
    return EventStream(streams.places, reading, caller(request))


@router.get(
    "/links",
    name="names",
    summary="The links to controllers",
    dependencies=[Depends(no_other_computer)],
    response_description="All of them.",
    responses=errors_of({403: _OTHER_COMPUTER}),
)
async def links(request: Request) -> Links:
    """By their names in the site file."""
    return Links(links=request.app.state.streams.links)


@router.get(
    "/links/{link:path}/frames",
    summary="What goes over the wire",
    dependencies=[Depends(no_other_computer)],
    response_class=Response,
    responses=_stream(_FRAMES, {403: _OTHER_COMPUTER, 404: "There is no such link (`unknown_link`).", 503: _FULL}),
)
async def frames(
    link: Annotated[
        str,
        Path(
            description="A link of the site, as `GET /api/v1/links` names it, percent-encoded.",
            json_schema_extra={"pattern": r"^[^\n]+$"},  # it may hold a slash
            examples=["plc"],
        ),
    ],
    request: Request,
) -> Response:
    """Every Modbus frame of one link as an event `frame`, for tools. Without snapshot, ids and replay."""
    streams: Streams = request.app.state.streams
    if streams.frames is None or link not in streams.links:
        text = f"no link {shown(link)}; the links are {', '.join(streams.links) or 'none'}"
        raise RequestError("unknown_link", text)
    return EventStream(streams.places, partial(streams.frames.reader, link, _admits(request)), caller(request))


def _admits(request: Request) -> Callable[[], bool]:
    """Return whether the caller's key still counts."""
    keys: Keys = request.app.state.keys
    return partial(keys.admits, caller(request))
