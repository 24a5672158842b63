"""Part of /api/v1: what happens, as it happens; and for tools, what goes over the wires."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Request
from starlette.responses import Response

from lift_manager.api.events import Links
from lift_manager.core.facade import FrameSource
from lift_manager.domain.asking import Refusal
from lift_manager.domain.keys import Keys
from lift_manager.web.access import caller
from lift_manager.web.answers import yes
from lift_manager.web.body import shown
from lift_manager.web.events import docs
from lift_manager.web.events.feed import About, Feed, Source
from lift_manager.web.events.frames import FrameFeed
from lift_manager.web.events.readers import Places
from lift_manager.web.events.stream import EventStream
from lift_manager.web.guards import no_other_computer
from lift_manager.web.problem import problem
from lift_manager.web.query import TOO_LONG, read_query

LAST_ID = "last_event_id"
"""In the query, for what cannot send the header."""


def events_router(source: Source, frames: FrameSource | None, keys: Keys, most: int) -> APIRouter:
    """Three routes; at most so many streams are open at a time."""
    places = Places(most)
    routes = _Routes(source, Feed(source, places), keys, places)
    links = _Links(source, frames, keys, places)
    router = APIRouter(prefix="/api/v1", tags=[docs.TAG])
    router.add_api_route("/events", routes.events, methods=["GET"], **docs.events())
    router.add_api_route("/links", links.names, methods=["GET"], **docs.links())
    router.add_api_route("/links/{link:path}/frames", links.frames, methods=["GET"], **docs.frames())
    return router


class _Routes:
    def __init__(self, source: Source, feed: Feed, keys: Keys, places: Places) -> None:
        self._source = source
        self._feed = feed
        self._keys = keys
        self._places = places

    async def events(self, request: Request) -> Response:
        said = _query(request)
        if isinstance(said, Response):
            return said
        lift, ride = said.get("lift"), said.get("ride")
        if lift is not None and ride is not None:
            return problem(
                422, "malformed", "give a lift or a ride: a ride comes with the states of its lift", field="ride"
            )
        if lift is not None and lift not in self._source.lift_names():
            names = ", ".join(self._source.lift_names())
            return problem(404, Refusal.UNKNOWN_LIFT, f"no lift {shown(lift)}; the lifts are {names}")
        if ride is not None and self._source.ride(ride) is None:
            text = f"no ride {shown(ride)}; it ended too long ago to be remembered, or there was none"
            return problem(404, Refusal.UNKNOWN_RIDE, text)
        # the header is newer: a client that reconnects sends the same address again
        last_id = request.headers.get("last-event-id") or said.get(LAST_ID) or None
        admits = partial(self._keys.admits, caller(request))
        reading = partial(self._feed.reader, About(lift, ride), last_id, admits)
        return EventStream(self._places, reading, caller(request))


class _Links:
    def __init__(self, source: Source, frames: FrameSource | None, keys: Keys, places: Places) -> None:
        self._source = source
        self._names = () if frames is None else frames.link_names()
        self._feed = None if frames is None else FrameFeed(frames, places)
        self._keys = keys
        self._places = places

    async def names(self, request: Request) -> Response:
        return no_other_computer(self._source, request, "") or yes(Links(links=self._names))

    async def frames(self, request: Request) -> Response:
        if no := no_other_computer(self._source, request, ""):
            return no
        link: str = request.path_params["link"]
        if self._feed is None or link not in self._names:
            return problem(
                404, "unknown_link", f"no link {shown(link)}; the links are {', '.join(self._names) or 'none'}"
            )
        admits = partial(self._keys.admits, caller(request))
        return EventStream(self._places, partial(self._feed.reader, link, admits), caller(request))


def _query(request: Request) -> dict[str, str] | Response:
    """Return what the query says, each thing once; or the answer that it cannot be understood."""
    query = read_query(request.scope["query_string"])
    if query.too_long:
        return problem(422, "malformed", TOO_LONG, field="lift")
    said = {key: values for key in ("lift", "ride", LAST_ID) if (values := query.all(key))}
    for key, values in said.items():
        if len(values) > 1:
            return problem(422, "malformed", f"{key} is in the query more than once", field=key)
    return {key: value for key, (value,) in said.items()}
