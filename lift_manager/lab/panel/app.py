"""The web application of the panel: a page, and the REST interface that it uses."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from http import HTTPStatus
from pathlib import Path
from socket import socket

from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from lift_manager.lab.bench.errors import BenchError
from lift_manager.lab.panel import routes
from lift_manager.lab.panel.lift import PanelLift
from lift_manager.plain.version import running_version
from lift_manager.web.connections import ConnectionLimits
from lift_manager.web.offline_docs import add_docs
from lift_manager.web.origin import is_from_another_site, names_unknown_host
from lift_manager.web.page import FOLDER as MANAGER_PAGE
from lift_manager.web.page import Document, PageFiles
from lift_manager.web.server import serve

PAGE = Path(__file__).with_name("page")
CONNECTIONS = 64
"""Chosen: some browsers, of which each opens six to one host, and some scripts."""
DESCRIPTION = """
Works a simulated lift as people and trouble do: buttons, light curtain, key switch, alarms, and the faults of controller and wire.

Nothing here goes over Modbus. The names of faults and inputs are those of the pytest fixtures.
"""


def make_panel(lifts: Sequence[PanelLift], manager: str | None = None) -> FastAPI:
    """Return the application for some lifts; `manager` is the address of a manager that runs beside them."""
    app = FastAPI(
        title="Panel of the simulator",
        version=running_version(),
        description=DESCRIPTION,
        docs_url=None,  # FastAPI's own pages load their scripts from the internet
        redoc_url=None,
        redirect_slashes=False,
        telemetry={"tracing": False, "metrics": False, "logs": False},
    )
    app.state.lifts = {lift.name: lift for lift in lifts}
    app.state.manager = manager
    app.add_exception_handler(BenchError, _refuse)
    app.add_middleware(OwnBrowserOnly)
    app.include_router(routes.router)
    app.add_api_route("/", Document((PAGE / "index.html").read_bytes()), include_in_schema=False)
    app.mount("/panel", PageFiles(directory=PAGE))
    app.mount("/page", PageFiles(directory=MANAGER_PAGE))  # the drawing of a shaft, and what it is drawn with
    add_docs(app)
    return app


@asynccontextmanager
async def panel_on(sock: socket, lifts: Sequence[PanelLift], manager: str | None = None) -> AsyncIterator[str]:
    """Serve the panel on a listening socket while the context lasts; yields its address."""
    with sock:
        host, port = sock.getsockname()[:2]
        running = asyncio.create_task(serve(make_panel(lifts, manager), sock, limits=ConnectionLimits.of(CONNECTIONS)))
        try:
            yield f"http://{host}:{port}/"
        finally:
            running.cancel()
            with suppress(asyncio.CancelledError):
                await running


class OwnBrowserOnly:
    """Refuses what a page of another site sends through the browser of somebody at this computer.

    The panel listens on this computer alone and has no keys, so the browser is the only link from elsewhere.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and (text := _refusal(Request(scope))) is not None:
            await JSONResponse({"detail": text}, HTTPStatus.FORBIDDEN)(scope, receive, send)
            return
        await self._app(scope, receive, send)


def _refusal(request: Request) -> str | None:
    if names_unknown_host(request.headers.get("host"), frozenset()):
        return "the panel is addressed by an address or by localhost"
    if request.method not in ("GET", "HEAD") and is_from_another_site(request):
        return "a page of another site sent this"
    return None


async def _refuse(_: Request, error: Exception) -> JSONResponse:
    return JSONResponse({"detail": str(error)}, HTTPStatus.BAD_REQUEST)
