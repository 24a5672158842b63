"""Answers requests of short routes without FastAPI, which costs more than their answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Receive, Scope, Send

from lift_manager.runtime.errors import RequestRefused
from lift_manager.web.authenticator import Authenticator
from lift_manager.web.body import is_too_long, read_body
from lift_manager.web.errors import RequestError


class WholeRequest(Request):
    """A request whose body has arrived."""

    def __init__(self, scope: Scope, content: bytes) -> None:
        super().__init__(scope)
        self.content = content


Endpoint = Callable[[WholeRequest], Response]
"""Replies to a request, and waits for nothing."""


class DirectRoutes:
    """The endpoints of some routes, for callers other than FastAPI, which documents these routes."""

    def __init__(
        self,
        routes: Iterable[BaseRoute],
        authenticator: Authenticator,
        refuse: Callable[[str, Exception], Response],
    ) -> None:
        """`refuse` replies to a refused request for a path, as for all other routes."""
        self._authenticator = authenticator
        self._refuse = refuse
        self._endpoints: dict[tuple[str, str], Endpoint] = {
            (method, route.path): route.endpoint
            for route in routes
            if isinstance(route, APIRoute)
            for method in route.methods or ()
        }

    def find(self, scope: Scope) -> Endpoint | None:
        """Return the endpoint for a request."""
        return self._endpoints.get((scope["method"], scope["path"]))

    def reply_at_once(self, scope: Scope, content: bytes) -> Response | None:
        """Check and answer a request whose body is here; None if it has another route, or a body that is too long to be read."""
        endpoint, request = self.find(scope), WholeRequest(scope, content)
        if endpoint is None or (content and is_too_long(request, len(content))):
            return None
        return self._authenticator.refusal_of(scope) or self._reply(endpoint, request)

    async def answer(self, endpoint: Endpoint, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that is allowed, and whose body may still be on its way."""
        try:
            content = b"" if scope["method"] == "GET" else await read_body(Request(scope, receive))
        except RequestError as error:
            reply = self._refuse(scope["path"], error)
        else:
            reply = self._reply(endpoint, WholeRequest(scope, content))
        await reply(scope, receive, send)

    def _reply(self, endpoint: Endpoint, request: WholeRequest) -> Response:
        try:
            return endpoint(request)
        except (RequestError, RequestRefused) as error:
            return self._refuse(request.scope["path"], error)


class DirectCalls:
    """Calls the endpoints of direct routes, and passes on all other requests."""

    def __init__(self, app: ASGIApp, routes: DirectRoutes) -> None:
        self._app = app
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        endpoint = self._routes.find(scope) if scope["type"] == "http" else None
        if endpoint is None:
            await self._app(scope, receive, send)
        else:
            await self._routes.answer(endpoint, scope, receive, send)
