"""The web application: routes, documentation, and an orderly answer to everything else."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from http import HTTPStatus

from fastapi import FastAPI
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lift_manager.core.facade import Facade, FrameSource
from lift_manager.domain.access import ROUTES, Route
from lift_manager.domain.keys import KeyRing, Keys, redacted
from lift_manager.plain.version import running_version
from lift_manager.web import health, lifts_docs, people_docs, rides_docs, rmf_docs, sessions_docs, workshop_docs
from lift_manager.web.accepting import streams_limit
from lift_manager.web.access import Gate
from lift_manager.web.error_table import error_table
from lift_manager.web.events import docs as events_docs
from lift_manager.web.events.routes import events_router
from lift_manager.web.faces import No, answer, not_found
from lift_manager.web.lifts import lift_router, lifts_router
from lift_manager.web.measured import Scrape, metrics_router
from lift_manager.web.offline_docs import add_docs
from lift_manager.web.openapi import describe_access
from lift_manager.web.people import people_router
from lift_manager.web.rides import rides_router
from lift_manager.web.rmf import rmf_router
from lift_manager.web.sessions import sessions_router
from lift_manager.web.workshop import workshop_router

DESCRIPTION = """
Calls lifts for robots, over Modbus/TCP to the lifts' own controllers. **Not a safety component**: it can do what a
passenger can do, and it says what the controller says.

Errors of `/api/v1` are problem+json with a stable `code`: [all of them](errors.md).
"""
INTERNAL_ERROR = "internal error; the manager's log has the details"

logger = logging.getLogger(__name__)


def make_app(
    facade: Facade,
    keys: Keys | None = None,
    routes: Sequence[Route] = ROUTES,
    *,
    frames: FrameSource | None = None,
    metrics: Scrape | None = None,
    streams: int | None = None,
    host_names: Collection[str] = (),
) -> FastAPI:
    """Everything a browser or a REST client can reach; one is enough for one facade.

    At most so many `streams` are open at a time; where nobody says, a part of the connections that this computer has room for.
    Without `keys` everybody is let in who addresses the manager as localhost, by an address or by one of `host_names`. What is not in `routes` cannot be reached, whatever is added to the application.
    """
    app = FastAPI(
        title="Lift manager",
        version=running_version(),
        description=DESCRIPTION,
        openapi_tags=[
            {"name": workshop_docs.TAG, "description": workshop_docs.TAG_DESCRIPTION},
            {"name": lifts_docs.TAG, "description": lifts_docs.TAG_DESCRIPTION},
            {"name": rides_docs.TAG, "description": rides_docs.TAG_DESCRIPTION},
            {"name": sessions_docs.TAG, "description": sessions_docs.TAG_DESCRIPTION},
            {"name": rmf_docs.TAG, "description": rmf_docs.TAG_DESCRIPTION},
            {"name": events_docs.TAG, "description": events_docs.TAG_DESCRIPTION},
            {"name": people_docs.TAG, "description": people_docs.TAG_DESCRIPTION},
            {"name": health.TAG, "description": health.TAG_DESCRIPTION},
        ],
        docs_url=None,  # FastAPI's own pages load their scripts from the internet
        redoc_url=None,
        root_path_in_servers=False,
        redirect_slashes=False,  # a redirect would name the host that the caller claims to have asked
    )
    app.add_exception_handler(HTTPException, _explain)
    keys = keys or KeyRing()
    app.add_middleware(Gate, routes=routes, keys=keys, note=facade.turned_away, host_names=host_names)
    app.add_middleware(LastResort)
    app.add_api_route("/", _to_docs, include_in_schema=False)
    app.add_api_route("/errors.md", _errors, include_in_schema=False)
    add_docs(app)
    app.include_router(workshop_router(facade))
    app.include_router(lifts_router(facade))
    app.include_router(sessions_router(facade, keys))
    app.include_router(rmf_router(facade))
    app.include_router(lift_router(facade))  # takes every GET below the lifts: what else is there comes before it
    app.include_router(rides_router(facade))
    app.include_router(people_router(facade))
    app.include_router(events_router(facade, frames, keys, streams or streams_limit()))
    app.include_router(health.health_router(facade))
    app.include_router(metrics_router(metrics))
    describe_access(app, routes, keys, facade.lift_names())
    return app


async def _to_docs() -> Response:
    # relative, so that it also works behind a proxy that adds a prefix
    return RedirectResponse("docs")


async def _errors() -> Response:
    return Response(error_table(), media_type="text/markdown")


async def _explain(request: Request, error: Exception) -> Response:
    """404 and the like, in the words of the face that was asked."""
    assert isinstance(error, HTTPException)  # noqa: S101  the type of a handler is wider than what it is given
    path = request.url.path
    if error.status_code == HTTPStatus.NOT_FOUND:
        return answer(path, not_found(path))
    return answer(path, No(error.status_code, "http_error", str(error.detail), error.headers))


class LastResort:
    """Logs a bug once, with its traceback, and tells the caller no more than that there was one.

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
        except Exception:
            logger.exception("%s %s failed", scope["method"], redacted(scope["path"]))
            # an answer that has begun cannot be taken back: the server sees it unfinished and closes the connection
            if not started:
                bug = No(500, "internal_error", INTERNAL_ERROR)
                await answer(scope["path"], bug)(scope, receive, send)
