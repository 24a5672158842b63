"""Part of /api/v1: the event stream, and for tools the frames on the wire."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Path, Query, Request
from pydantic.json_schema import SkipJsonSchema
from starlette.responses import Response

from lift_manager.api.events import Links
from lift_manager.runtime.errors import NotFound
from lift_manager.runtime.links import FrameSource
from lift_manager.runtime.site import Site
from lift_manager.web.authenticator import caller_key
from lift_manager.web.body import quoted
from lift_manager.web.callers import ServedSite, admission_check, forbid_other_computer
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
Events as server-sent events, for as long as the client stays connected.

- **Snapshot first**: the state of each lift and the current rides; then changes. Every event has a name and one line of JSON.
- **Nothing is lost or repeated when a connection breaks**: send the id of the newest received event as `Last-Event-ID`, as every browser
  does by itself (or as `last_event_id` in the query). The stream continues after it. If those events are no longer kept (after five
  minutes, 4096 events, or a restart of the manager), or the id is invalid, it begins with a snapshot with `lost: true`.
- **Data every second**, if only a comment line. A client without data for a lift's `max_age_s` knows nothing about that lift.
- **Act on fresh data only.** A robot acts on a reply to GET, or on an event whose age plus the time since it was received is within the
  lift's `max_age_s`. A client that has not read the connection for a while cannot know when an event was received, and sends a GET.
- **Old events do not invite**: an event that was queued for longer than the lift's `max_age_s`, as after a broken connection, has `offline`
  for a lift, and for a ride `wait` instead of `enter` and `stay` instead of `leave`; the reason says so.
- **Ages**: `age_s` is correct within a quarter of a second when the event is handed to the connection; add the time since it was received.
  While the stream delivers data, a state is valid until the next one: the loss of a lift is an event too.
- **A slow reader** loses its queued events, at most 256, gets `lost` with their number and a snapshot, and continues from there. A
  connection that is not read for a minute is closed.
- A stream ends when the manager stops, and within a second when its key is revoked. At most 60 % of all connections are streams, and at
  most half of these may use the same key.
- The id of an event is also in the manager's log and in its journal (`lift-manager audit --event ID`). Ids of sessions are in neither.
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


def _stream_responses(example: str, errors: dict[int, str]) -> dict[int | str, dict[str, Any]]:
    content = {MEDIA_TYPE: {"schema": {"type": "string"}, "example": example}}
    return {200: {"description": "The stream.", "content": content}, **errors_of(errors)}


class Streams:
    """The open streams of one application, and their feeds."""

    def __init__(self, site: Site, frames: FrameSource | None, most: int) -> None:
        """Allow at most `most` open streams."""
        self.places = OpenStreams(most)
        self.events = Feed(site, self.places)
        self.links = () if frames is None else frames.link_names()
        self.frames = None if frames is None else FrameFeed(frames, self.places)


router = APIRouter(prefix="/api/v1", tags=[TAG], route_class=JsonRoute, strict_content_type=False)

_LIMIT = {"maxLength": 200}
"""Documented, not checked: no known name is that long."""
Text = str | SkipJsonSchema[None]
_OTHER_COMPUTER = "A request to a site without keys from another computer (`other_computer`)."


@router.get(
    "/events",
    summary="The event stream",
    response_class=Response,
    responses=_stream_responses(
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
            description="Continue after this event; the header `Last-Event-ID` does the same, and wins if both are sent.",
            json_schema_extra=_LIMIT,
        ),
    ] = None,
    last_event_id: Annotated[
        Text,
        Header(alias="Last-Event-ID", description="The newest event that was received.", json_schema_extra=_LIMIT),
    ] = None,
) -> Response:
    """A snapshot, then every event; see the text of this section."""
    require_once(request, "lift", "ride", "last_event_id")
    if lift is not None and ride is not None:
        text = "give a lift or a ride: a ride comes with the states of its lift"
        raise RequestError("malformed", text, field="ride")
    if lift is not None and lift not in site.lift_names():
        raise RequestError("unknown_lift", f"no lift {quoted(lift)}; the lifts are {', '.join(site.lift_names())}")
    if ride is not None:
        try:
            site.rides.ride(ride)
        except NotFound as error:
            text = f"no ride {quoted(ride)}; it ended too long ago to be remembered, or never existed"
            raise RequestError("unknown_ride", text) from error
    streams: Streams = request.app.state.streams
    # the header is newer: a client that reconnects sends the same address again
    open_reader = partial(
        streams.events.reader, StreamScope(lift, ride), last_event_id or after or None, admission_check(request)
    )
    return EventStream(streams.places, open_reader, caller_key(request))


@router.get(
    "/links",
    name="names",
    summary="The links to controllers",
    dependencies=[Depends(forbid_other_computer)],
    response_description="All of them.",
    responses=errors_of({403: _OTHER_COMPUTER}),
)
async def links(request: Request) -> Links:
    """By their names in the site file."""
    return Links(links=request.app.state.streams.links)


@router.get(
    "/links/{link:path}/frames",
    summary="The frames on the wire of a link",
    dependencies=[Depends(forbid_other_computer)],
    response_class=Response,
    responses=_stream_responses(
        _FRAMES, {403: _OTHER_COMPUTER, 404: "There is no such link (`unknown_link`).", 503: _FULL}
    ),
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
        text = f"no link {quoted(link)}; the links are {', '.join(streams.links) or 'none'}"
        raise RequestError("unknown_link", text)
    return EventStream(
        streams.places, partial(streams.frames.reader, link, admission_check(request)), caller_key(request)
    )
