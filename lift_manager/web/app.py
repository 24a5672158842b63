"""Builds the web application: routes, documentation, and error replies."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from http import HTTPStatus
from pathlib import Path

from fastapi import FastAPI
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lift_manager.api.keys import KeyRing, Keys, redacted
from lift_manager.api.logins import Logins
from lift_manager.api.roles import ROUTES, Route
from lift_manager.plain.version import running_version
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.links import FrameSource
from lift_manager.runtime.site import Site
from lift_manager.web import health, lifts, login, people, rides, rmf, sessions, workshop_docs
from lift_manager.web.announcements import add_announcements
from lift_manager.web.authenticator import AllowedRequests, Authenticator
from lift_manager.web.body import LingeringResponse
from lift_manager.web.direct_routes import DirectCalls, DirectRoutes
from lift_manager.web.errors import RequestError
from lift_manager.web.errors_page import error_table
from lift_manager.web.events import routes as events
from lift_manager.web.lift_texts import LiftTexts
from lift_manager.web.limits import streams_limit
from lift_manager.web.offline_docs import add_docs
from lift_manager.web.openapi import describe_access
from lift_manager.web.page import add_page
from lift_manager.web.replies import error_reply, is_workshop, not_found, request_error, workshop_failure
from lift_manager.web.workshop import workshop_router

DESCRIPTION = """
Calls lifts for robots, over Modbus/TCP to the lifts' own controllers. **Not a safety component**: it can do what a
passenger can do, and it reports what the controller reports.

Errors of `/api/v1` are problem+json with a stable `code`: [all of them](errors).
"""
INTERNAL_ERROR = "internal error; the manager's log has the details"

logger = logging.getLogger(__name__)


class Application(FastAPI):
    """The application; the server calls its short routes itself."""

    direct_routes: DirectRoutes

    def reply_at_once(self, scope: Scope, content: bytes) -> Response | None:
        """Return the reply to a request with this body; None for one that has to be called as any ASGI application."""
        try:
            return self.direct_routes.reply_at_once(scope, content)
        except Exception as bug:  # noqa: BLE001  it is logged
            return _bug_reply(scope, bug)


def make_app(  # noqa: PLR0913  the parts of the application, by name
    site: Site,
    keys: Keys | None = None,
    routes: Sequence[Route] = ROUTES,
    *,
    frames: FrameSource | None = None,
    metrics: health.Scrape | None = None,
    streams: int | None = None,
    host_names: Collection[str] = (),
    simulated: Collection[str] = (),
    announcements: Mapping[str, Path] | None = None,
    alone: str = "",
) -> Application:
    """Return the application that serves a site.

    `streams` limits the open event streams; the default is a share of the connections that this computer can open. Without `keys`,
    everybody is admitted who addresses the manager by an address, localhost or one of `host_names`. `simulated` are the
    lifts behind simulated controllers; `announcements` are the recordings of the lobby view, by moment. `alone` says in words that one machine of a cluster
    goes on without the other. Only `routes` can be reached, whatever else is added to the application.
    """
    app = Application(
        title="Lift manager",
        version=running_version(),
        description=DESCRIPTION,
        openapi_tags=[
            {"name": section.TAG, "description": section.TAG_DESCRIPTION}
            for section in (workshop_docs, lifts, rides, sessions, rmf, events, people, login, health)
        ],
        docs_url=None,  # FastAPI's own pages load their scripts from the internet
        redoc_url=None,
        root_path_in_servers=False,
        redirect_slashes=False,  # a redirect would contain the host name that the caller sent
        separate_input_output_schemas=False,
        telemetry={"tracing": False, "metrics": False, "logs": False},  # would be looked for in each request
    )
    add_error_replies(app)
    keys = keys or KeyRing()
    app.state.site, app.state.keys, app.state.simulated = site, keys, frozenset(simulated)
    app.state.face_log = site
    logins = app.state.logins = Logins(keys)
    app.state.streams = events.Streams(site, frames, streams or streams_limit())
    app.state.lift_texts = LiftTexts(site)
    workshop = workshop_router(site)
    authenticator = Authenticator(routes, logins, keys, site.turned_away, host_names)
    app.direct_routes = DirectRoutes(workshop.routes, authenticator, _refusal)
    app.add_middleware(DirectCalls, routes=app.direct_routes)
    app.add_middleware(AllowedRequests, authenticator=authenticator)
    app.add_middleware(LastResort)
    app.add_api_route("/errors.md", _errors, include_in_schema=False)
    add_docs(app)
    add_page(app)
    add_announcements(app, announcements or {})
    routers = (lifts.router, sessions.router, rmf.router, rides.router, people.router, login.router, events.router)
    for router in (workshop, *routers, health.health_router(site, alone), health.metrics_router(metrics)):
        # `include_router` would analyse every route once more for each application, at its first request
        app.router.routes.extend(router.routes)
    describe_access(app, routes, keys, site.lift_names())
    return app


def add_error_replies(app: FastAPI) -> None:
    """Reply to every refusal in the format of the requested face."""
    app.add_exception_handler(HTTPException, _explain)
    app.add_exception_handler(RequestError, _refuse)
    app.add_exception_handler(RequestRefused, _refuse)


async def _errors() -> Response:
    return Response(error_table(), media_type="text/markdown")


async def _explain(request: Request, error: Exception) -> Response:
    """Reply to 404 and similar errors in the format of the requested face."""
    assert isinstance(error, HTTPException)  # noqa: S101  the type of a handler is wider than what it is given
    path = request.url.path
    if error.status_code == HTTPStatus.NOT_FOUND:
        return error_reply(path, not_found(path))
    return error_reply(
        path, RequestError("http_error", str(error.detail), headers=error.headers, status=error.status_code)
    )


async def _refuse(request: Request, error: Exception) -> Response:
    return _refusal(request.url.path, error)


def _refusal(path: str, error: Exception) -> Response:
    """Return the reply to a refused request. The workshop API has HTTP 200, because its clients look at `success`."""
    if isinstance(error, RequestRefused):
        error = request_error(error)
    assert isinstance(error, RequestError)  # noqa: S101  as above
    reply = workshop_failure(error.message) if is_workshop(path) else error_reply(path, error)
    return LingeringResponse(reply) if error.code == "too_long" else reply


class LastResort:
    """Logs a bug once, with its traceback, and tells the caller only that there was one.

    Starlette's own handler for unexpected errors raises them again after the answer, and the server logs them a second
    time.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started = False

        async def watched_send(message: Message) -> None:
            nonlocal started
            started = True
            await send(message)

        try:
            await self._app(scope, receive, watched_send)
        except Exception as bug:  # noqa: BLE001  it is logged
            reply = _bug_reply(scope, bug)
            # an answer that has begun cannot be taken back: the server sees it unfinished and closes the connection
            if not started:
                await reply(scope, receive, send)


def _bug_reply(scope: Scope, bug: Exception) -> Response:
    """Log a bug, and return the reply."""
    logger.error("%s %s failed", scope["method"], redacted(scope["path"]), exc_info=bug)
    return error_reply(scope["path"], RequestError("internal_error", INTERNAL_ERROR))
