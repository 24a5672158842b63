"""The web application: routes, documentation, and an orderly answer to everything else."""

from __future__ import annotations

import logging
from importlib.metadata import PackageNotFoundError, version

from fastapi import FastAPI
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lift_manager.core.facade import LiftFacade
from lift_manager.web import people_docs, workshop_docs
from lift_manager.web.envelope import failed
from lift_manager.web.offline_docs import add_docs
from lift_manager.web.people import people_router
from lift_manager.web.problem import problem
from lift_manager.web.workshop import workshop_router

DESCRIPTION = """
Calls lifts for robots, over Modbus/TCP to the lifts' own controllers. **Not a safety component**: it can do what a
passenger can do, and it says what the controller says.
"""
_CODES = {404: "no_such_path", 405: "wrong_method"}
INTERNAL_ERROR = "internal error; the manager's log has the details"

logger = logging.getLogger(__name__)


def make_app(facade: LiftFacade) -> FastAPI:
    """Everything a browser or a REST client can reach; one is enough for one facade."""
    app = FastAPI(
        title="Lift manager",
        version=_version(),
        description=DESCRIPTION,
        openapi_tags=[
            {"name": workshop_docs.TAG, "description": workshop_docs.TAG_DESCRIPTION},
            {"name": people_docs.TAG, "description": people_docs.TAG_DESCRIPTION},
        ],
        docs_url=None,  # FastAPI's own pages load their scripts from the internet
        redoc_url=None,
        root_path_in_servers=False,
        redirect_slashes=False,  # a redirect would name the host that the caller claims to have asked
    )
    app.add_exception_handler(HTTPException, _explain)
    app.add_middleware(LastResort)
    app.add_api_route("/", _to_docs, include_in_schema=False)
    add_docs(app)
    app.include_router(workshop_router(facade))
    app.include_router(people_router(facade))
    return app


def _version() -> str:
    try:
        return version("lift-manager")
    except PackageNotFoundError:
        return "0+checkout"


async def _to_docs() -> Response:
    # relative, so that it also works behind a proxy that adds a prefix
    return RedirectResponse("docs")


def _is_workshop(path: str) -> bool:
    return path == "/open-rmf" or path.startswith("/open-rmf/")


def _is_api(path: str) -> bool:
    return path == "/api" or path.startswith("/api/")


async def _explain(request: Request, error: Exception) -> Response:
    """404, 405 and the like, in the words of the face that was asked."""
    assert isinstance(error, HTTPException)  # noqa: S101  the type of a handler is wider than what it is given
    path = request.url.path
    if _is_workshop(path):
        answer = failed(_workshop_hint(error), status=error.status_code)
        answer.headers.update(error.headers or {})
        return answer
    if _is_api(path):
        answer = problem(error.status_code, _CODES.get(error.status_code, "http_error"), str(error.detail))
        answer.headers.update(error.headers or {})
        return answer
    return JSONResponse({"detail": error.detail}, error.status_code, error.headers)


def _workshop_hint(error: HTTPException) -> str:
    routes = "GET lift_names, GET lift_state?lift_name=, POST lift_request?lift_name="
    return f"{error.detail}; under /open-rmf/demo-lift/ there are: {routes}"


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
            logger.exception("%s %s failed", scope["method"], scope["path"])
            # an answer that has begun cannot be taken back: the server sees it unfinished and closes the connection
            if not started:
                await _internal_error(scope["path"])(scope, receive, send)


def _internal_error(path: str) -> Response:
    if _is_workshop(path):
        return failed(INTERNAL_ERROR, status=500)
    if _is_api(path):
        return problem(500, "internal_error", INTERNAL_ERROR)
    return JSONResponse({"detail": INTERNAL_ERROR}, 500)
