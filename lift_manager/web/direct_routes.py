"""Answers requests of short routes without FastAPI, which costs more than their answers."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable

from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Receive, Scope, Send

from lift_manager.runtime.errors import RequestRefused
from lift_manager.web.errors import RequestError


class DirectRoutes:
    """Calls the endpoints of some routes itself; FastAPI documents these routes, and serves all others.

    An endpoint takes a request and nothing else, and returns a response.
    """

    def __init__(
        self,
        app: ASGIApp,
        routes: Iterable[BaseRoute],
        refuse: Callable[[Request, Exception], Awaitable[Response]],
    ) -> None:
        """`refuse` replies to a refused request, as for all other routes."""
        self._app = app
        self._refuse = refuse
        self._endpoints = {
            (method, route.path): route.endpoint
            for route in routes
            if isinstance(route, APIRoute)
            for method in route.methods or ()
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        endpoint = self._endpoints.get((scope["method"], scope["path"])) if scope["type"] == "http" else None
        if endpoint is None:
            await self._app(scope, receive, send)
            return
        request = Request(scope, receive)
        try:
            reply = await endpoint(request)
        except (RequestError, RequestRefused) as error:
            reply = await self._refuse(request, error)
        await reply(scope, receive, send)
