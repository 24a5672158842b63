"""The web application of a hub: sites, their lifts, events of all sites, commands, health and metrics."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Depends, FastAPI, Header, Query, Request
from pydantic.json_schema import SkipJsonSchema
from starlette.responses import JSONResponse, Response

from lift_manager.api.keys import Keys
from lift_manager.api.logins import Logins
from lift_manager.hub.api import (
    ROUTES,
    Off,
    RemoteLiftAnswer,
    RemoteLiftsAnswer,
    RemoteRideAnswer,
    RemoteRidesAnswer,
    RemoteSiteInfo,
    SiteEvent,
    SiteEventsAnswer,
    SitesAnswer,
    SiteUpdateAnswer,
    SwitchedAnswer,
    SwitchOffRequest,
    SwitchOnRequest,
)
from lift_manager.hub.commands import read_action
from lift_manager.hub.errors import BadReply, FolderUnusable, SiteRefused, SiteSilent
from lift_manager.hub.face_log import HubFaceLog
from lift_manager.hub.feed import EVENT_ID, HubFeed
from lift_manager.hub.messages import BeginRide, CancelRide, CommandMessage, CommandResult, SignedCommand, Ticket
from lift_manager.hub.metrics import HubMetrics
from lift_manager.hub.page import add_hub_page
from lift_manager.hub.remote_site import RemoteSite, SiteState
from lift_manager.hub.service import Hub
from lift_manager.plain.version import running_version
from lift_manager.web import login
from lift_manager.web.app import LastResort, add_error_replies
from lift_manager.web.authenticator import AllowedRequests, Authenticator, caller_key
from lift_manager.web.body import quoted
from lift_manager.web.callers import admission_check, forbid_foreign_page, refuse_foreign_lifts, refuse_other_computer
from lift_manager.web.error_codes import CODES
from lift_manager.web.errors import RequestError
from lift_manager.web.events.readers import OpenStreams
from lift_manager.web.events.stream import EventStream
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.limits import streams_limit
from lift_manager.web.offline_docs import add_docs
from lift_manager.web.openapi import describe_access, in_path, problems
from lift_manager.web.query import require_once
from lift_manager.web.replies import NO_STORE

DESCRIPTION = """
The lifts of many sites, for people and statistics. **Robots ride through the manager of their site**: nothing here invites one.

A site runs as before without the hub. What it reports about its lifts is requested for each reply and never kept; the rows of its
journal are kept, and arrive late after a site was cut off.
"""

router = APIRouter(prefix="/api/v1", route_class=JsonRoute, strict_content_type=False)

SiteName = Annotated[str, in_path("The id of a site.", "berlin")]
LiftName = Annotated[str, in_path("A lift of the site.", "goods")]
RideId = Annotated[str, in_path("The id of a ride.", "81c05f2a9d3e7b64")]
Text = str | SkipJsonSchema[None]

_COMMAND_CODES = (
    *("unknown_site", "unknown_lift", "site_silent", "unconfirmed", "ticket_over", "bad_key", "not_allowed"),
    *("monitor_only", "another_site", "too_long", "malformed", "bad_reply"),
)


def make_hub_app(hub: Hub, keys: Keys, *, streams: int | None = None, host_names: Collection[str] = ()) -> FastAPI:
    """Return the application that serves a hub. Keys and roles are as on a site; only the routes of `api.ROUTES` can be reached."""
    app = FastAPI(
        title="Lift manager hub",
        version=running_version(),
        description=DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        root_path_in_servers=False,
        redirect_slashes=False,
        separate_input_output_schemas=False,
        telemetry={"tracing": False, "metrics": False, "logs": False},
    )
    add_error_replies(app)
    app.state.hub, app.state.keys = hub, keys
    app.state.places = OpenStreams(streams or streams_limit())
    app.state.feed = HubFeed(hub, app.state.places)
    face_log = app.state.face_log = HubFaceLog()
    app.state.metrics = HubMetrics(hub, face_log.refusals)
    logins = app.state.logins = Logins(keys)
    authenticator = Authenticator(ROUTES, logins, keys, face_log.turned_away, host_names)
    app.add_middleware(AllowedRequests, authenticator=authenticator)
    app.add_middleware(LastResort)
    add_docs(app)
    add_hub_page(app)
    app.router.routes.extend((*router.routes, *login.router.routes))
    for path, endpoint in (("/healthz", _healthz), ("/readyz", _readyz), ("/metrics", _metrics)):
        app.add_api_route(path, endpoint, methods=["GET"], tags=["health"], response_class=Response)
    describe_access(app, ROUTES, keys)
    return app


async def _healthz() -> Response:
    """Whether the process and its loop are alive."""
    return JSONResponse({"status": "ok"}, 200, NO_STORE)


async def _readyz(request: Request) -> Response:
    """Whether sites can be reached: the hub is connected to its NATS server."""
    hub = _hub_of(request)
    states = Counter(hub.state(site) for site in hub.registry.sites)
    body = {"ready": hub.is_up, "sites": len(hub.registry.sites), "online": states[SiteState.ONLINE]}
    return JSONResponse(body, 200 if hub.is_up else 503, NO_STORE)


async def _metrics(request: Request) -> Response:
    """The measurements of all sites for Prometheus, from memory."""
    body, content_type = request.app.state.metrics.scrape(request.headers.get("accept", ""))
    return Response(body, headers={"content-type": content_type, **NO_STORE})


def _hub_of(request: Request) -> Hub:
    hub: Hub = request.app.state.hub
    return hub


async def _remote(site: SiteName, request: Request) -> RemoteSite:
    """Return a site that can be reached, as far as is known."""
    hub = _hub_of(request)
    _require_site(hub, site)
    if hub.state(site) is SiteState.OFF:
        raise RequestError("site_silent", f"{site} is switched off; `GET /api/v1/sites/{site}` has by whom and why")
    if site not in hub.sites:
        raise RequestError("site_silent", "the hub has not reached its NATS server yet")
    return hub.sites[site]


Remote = Annotated[RemoteSite, Depends(_remote)]


async def _person(request: Request) -> None:
    """Refuse an operator action without a key from another computer; a dependency."""
    refuse_other_computer(
        request,
        "this hub has no keys to identify people, so only a program on its own computer may send this; make keys with"
        " `lift-manager hub keys make`",
    )


def _lifts_at(request: Request, site: str) -> tuple[str, ...]:
    """Return the lifts of a site that the key of the caller names."""
    key = caller_key(request)
    return () if key is None else tuple(lift for lift in key.lifts if lift.startswith(f"{site}/"))


def _require_site(hub: Hub, site: str) -> None:
    if site not in hub.registry.sites:
        raise RequestError("unknown_site", f"no site {quoted(site)}")


@router.get("/sites", summary="Every site", tags=["sites"], responses=problems("malformed"))
async def sites(
    request: Request,
    state: Annotated[
        SiteState | SkipJsonSchema[None], Query(description="Only those in this state, such as `offline`.")
    ] = None,
) -> SitesAnswer:
    """From memory: no site is contacted. `?state=offline` lists those that are cut off or stopped."""
    hub = _hub_of(request)
    found = (_info(hub, site) for site in sorted(hub.registry.sites))
    return SitesAnswer(sites=tuple(info for info in found if state in (None, info.state)))


@router.get("/sites/{site}", summary="One site", tags=["sites"], responses=problems("unknown_site"))
async def one_site(site: SiteName, request: Request) -> RemoteSiteInfo:
    """From memory."""
    hub = _hub_of(request)
    _require_site(hub, site)
    return _info(hub, site)


@router.get(
    "/sites/{site}/events",
    summary="The newest events of a site",
    tags=["events"],
    responses=problems("unknown_site", "malformed"),
)
async def site_events(
    site: SiteName,
    request: Request,
    most: Annotated[int, Query(ge=1, le=200, description="How many at most.")] = 100,
) -> SiteEventsAnswer:
    """From the database of the hub, the newest first, also of a site that is cut off or switched off; for people who look into it.

    `GET /api/v1/events` has all of every row, and continues without a gap.
    """
    hub = _hub_of(request)
    _require_site(hub, site)
    require_once(request, "most")
    return SiteEventsAnswer(site=site, events=tuple(map(SiteEvent.of, await hub.newest_events(site, most))))


@router.get(
    "/sites/{site}/update",
    summary="Configuration updates of a site",
    tags=["sites"],
    responses=problems("unknown_site"),
)
async def update(site: SiteName, request: Request) -> SiteUpdateAnswer:
    """By which update it runs, and how far it is with the newest roll-out. From memory: a site reports once a minute."""
    hub = _hub_of(request)
    _require_site(hub, site)
    return SiteUpdateAnswer.of(site, hub.update_of(site), asyncio.get_running_loop().time())


@router.post(
    "/sites/{site}/off",
    summary="Switch a site off",
    tags=["sites"],
    dependencies=[Depends(forbid_foreign_page), Depends(_person)],
    responses=problems("unknown_site", "not_now", "another_site", "too_long", "malformed"),
)
async def off(site: SiteName, request: Request, body: SwitchOffRequest) -> SwitchedAnswer:
    """Its leaf node is disconnected and refused within a second or two, over restarts of the hub. The site itself runs as before."""
    hub = _hub_of(request)
    _require_site(hub, site)
    return _switch(hub, site, lambda: hub.switch_off(site, _signature(request, body.by), body.reason))


@router.post(
    "/sites/{site}/on",
    summary="Switch a site on",
    tags=["sites"],
    dependencies=[Depends(forbid_foreign_page), Depends(_person)],
    responses=problems("unknown_site", "not_now", "another_site", "too_long", "malformed"),
)
async def on(site: SiteName, request: Request, body: SwitchOnRequest) -> SwitchedAnswer:
    """Its leaf node is accepted again; it connects within seconds by itself."""
    hub = _hub_of(request)
    _require_site(hub, site)
    return _switch(hub, site, lambda: hub.switch_on(site, _signature(request, body.by)))


@router.get(
    "/sites/{site}/lifts",
    summary="The lifts of a site",
    tags=["lifts"],
    responses=problems("unknown_site", "site_silent", "bad_reply"),
)
async def lifts(site: Remote) -> RemoteLiftsAnswer:
    """Requested from the site for this reply. A lift whose reading may be older than its `max_age_s` on arrival is `offline`."""
    with _site_errors():
        reply = await site.lifts(None)
    return RemoteLiftsAnswer(site=site.id, round_trip_s=reply.round_trip_s, lifts=reply.lifts.lifts)


@router.get(
    "/sites/{site}/lifts/{lift}",
    summary="One lift of a site",
    tags=["lifts"],
    responses=problems("unknown_site", "unknown_lift", "site_silent", "bad_reply"),
)
async def one_lift(lift: LiftName, site: Remote) -> RemoteLiftAnswer:
    """Requested from the site for this reply."""
    with _site_errors():
        reply = await site.lifts(lift)
    if [found.name for found in reply.lifts.lifts] != [lift]:
        raise RequestError("bad_reply", f"{site.id} replied with another lift than the one that was requested")
    return RemoteLiftAnswer(site=site.id, round_trip_s=reply.round_trip_s, lift=reply.lifts.lifts[0])


@router.get(
    "/sites/{site}/rides",
    summary="The rides of a site",
    tags=["rides"],
    responses=problems("unknown_site", "site_silent", "bad_reply"),
)
async def rides(site: Remote) -> RemoteRidesAnswer:
    """Current rides, and those that ended recently, requested from the site for this reply. A robot rides through its site."""
    with _site_errors():
        reply = await site.rides(None)
    return RemoteRidesAnswer(site=site.id, round_trip_s=reply.round_trip_s, rides=reply.rides.rides)


@router.get(
    "/sites/{site}/rides/{ride}",
    summary="One ride of a site",
    tags=["rides"],
    responses=problems("unknown_site", "unknown_ride", "site_silent", "bad_reply"),
)
async def one_ride(ride: RideId, site: Remote) -> RemoteRideAnswer:
    """Requested from the site for this reply."""
    with _site_errors():
        reply = await site.rides(ride)
    if [found.id for found in reply.rides.rides] != [ride]:
        raise RequestError("bad_reply", f"{site.id} replied with another ride than the one that was requested")
    return RemoteRideAnswer(site=site.id, round_trip_s=reply.round_trip_s, ride=reply.rides.rides[0])


@router.post(
    "/sites/{site}/rides",
    summary="Begin a ride",
    tags=["rides"],
    dependencies=[Depends(forbid_foreign_page)],
    responses=problems(*_COMMAND_CODES, "unknown_floor", "key_reused", "too_many", "not_now"),
)
async def begin_ride(site: Remote, request: Request, body: SignedCommand) -> CommandResult:
    """The signed action is a `ride`. It waits at the site until its robot sends `here` there: nothing is pressed for an absent robot."""
    with _site_errors(is_command=True):
        action = read_action(body.action)
        if not isinstance(action, BeginRide):
            raise RequestError("malformed", "action: what must be `ride`", field="action")
        refuse_foreign_lifts(request, [f"{site.id}/{action.body.lift}"])
        return await site.command(CommandMessage(lift="", command=body))


@router.post(
    "/sites/{site}/rides/{ride}/cancel",
    summary="Cancel a ride",
    tags=["rides"],
    dependencies=[Depends(forbid_foreign_page)],
    responses=problems(*_COMMAND_CODES, "unknown_ride", "not_your_ride", "not_now"),
)
async def cancel_ride(ride: RideId, site: Remote, request: Request, body: SignedCommand) -> CommandResult:
    """The signed action is a `cancel_ride`. A robot that may be inside is let out first, and people are alerted."""
    with _site_errors(is_command=True):
        action = read_action(body.action)
        if not isinstance(action, CancelRide) or action.ride != ride:
            raise RequestError("malformed", f"action: it must be a `cancel_ride` of {quoted(ride)}", field="action")
        refuse_foreign_lifts(request, _lifts_at(request, site.id))
        return await site.command(CommandMessage(lift="", command=body))


@router.post(
    "/sites/{site}/tickets",
    summary="A ticket for one command",
    tags=["commands"],
    dependencies=[Depends(forbid_foreign_page)],
    responses=problems("unknown_site", "site_silent", "monitor_only", "another_site", "bad_reply"),
)
async def tickets(site: Remote, request: Request) -> Ticket:
    """Issued by the site, and good for one command within 2 s on its clock: so a command that was held up on its way does nothing."""
    refuse_foreign_lifts(request, _lifts_at(request, site.id))
    with _site_errors():
        return await site.ticket()


@router.post(
    "/sites/{site}/lifts/{lift}/commands",
    summary="Command a lift",
    tags=["commands"],
    dependencies=[Depends(forbid_foreign_page)],
    responses=problems(*_COMMAND_CODES),
)
async def command(lift: LiftName, site: Remote, body: SignedCommand) -> CommandResult:
    """Passed on to the site, which checks ticket, signature, key and lift, and then does what its own `/api/v1` would.

    Only sites take part that opted in. Acknowledging, ending a lockout and forced releases are for people at the site.
    """
    with _site_errors(is_command=True):
        return await site.command(CommandMessage(lift=lift, command=body))


@router.get(
    "/events",
    summary="The events of all sites",
    tags=["events"],
    response_class=Response,
    responses=problems("unknown_site", "malformed", "too_many_streams"),
)
async def events(
    request: Request,
    site: Annotated[Text, Query(description="Only those of this site.", json_schema_extra={"maxLength": 32})] = None,
    after: Annotated[
        Text,
        Query(alias="last_event_id", description="Continue after this event; 0 for all that are kept."),
    ] = None,
    last_event_id: Annotated[
        Text, Header(alias="Last-Event-ID", description="The newest event that was received.")
    ] = None,
) -> Response:
    """Server-sent events: `row` of a journal, `gap` in one, `site` and `update` for what the hub notices; `lost` where it is unknown what was missed."""
    require_once(request, "site", "last_event_id")
    if site is not None:
        _require_site(_hub_of(request), site)
    given = last_event_id or after
    if given and EVENT_ID.fullmatch(given) is None:
        raise RequestError("malformed", "last_event_id must be the id of an event, or 0", field="last_event_id")
    feed: HubFeed = request.app.state.feed
    open_reader = partial(feed.reader, site, given or None, admission_check(request))
    return EventStream(request.app.state.places, open_reader, caller_key(request))


def _info(hub: Hub, site: str) -> RemoteSiteInfo:
    entry, remote = hub.registry.sites[site], hub.sites.get(site)
    news = None if remote is None else remote.news
    return RemoteSiteInfo(
        id=site,
        name="" if news is None else news.name,
        state=hub.state(site),
        news_age_s=None if remote is None else remote.news_age_s,
        version="" if news is None else news.version,
        lifts=0 if news is None else news.lifts,
        live=0 if news is None else news.live,
        commands=news is not None and news.commands,
        rows_behind=None if remote is None else remote.rows_behind,
        off=None if entry.off is None else Off.model_validate(entry.off),
    )


def _switch(hub: Hub, site: str, switch: Callable[[], None]) -> SwitchedAnswer:
    try:
        switch()
    except FolderUnusable as error:
        raise RequestError("not_now", str(error)) from error
    entry = hub.registry.sites[site]
    return SwitchedAnswer(site=site, off=None if entry.off is None else Off.model_validate(entry.off))


def _signature(request: Request, by: str) -> str:
    """Return the person for the record, with the key that vouches for the name."""
    key = caller_key(request)
    return by if key is None else f"{by} (key {key.name})"


@contextmanager
def _site_errors(*, is_command: bool = False) -> Iterator[None]:
    """Convert what a site does not reply, or refuses."""
    try:
        yield
    except SiteSilent as error:
        if is_command and error.was_sent:
            raise RequestError("unconfirmed", f"{error}; whether the command was carried out is unknown") from error
        raise RequestError("site_silent", str(error)) from error
    except BadReply as error:
        if is_command:
            raise RequestError("unconfirmed", f"{error}; whether the command was carried out is unknown") from error
        raise RequestError("bad_reply", str(error)) from error
    except SiteRefused as error:
        # a site may send anything: only what has a meaning here is passed on
        if (code := error.problem.code) not in CODES:
            raise RequestError("bad_reply", f"the site refused, with an unknown code: {error}") from error
        raise RequestError(code, str(error)) from error
