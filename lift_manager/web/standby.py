"""Replies of a manager that is not active: never a state, only where the active one is."""

from __future__ import annotations

from collections.abc import Callable

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from lift_manager.web.app import Application
from lift_manager.web.errors import RequestError
from lift_manager.web.replies import NO_STORE, error_reply, is_workshop, workshop_failure


class Standby:
    """The application of a standby. It needs no keys: it reveals nothing but an address, and takes nothing."""

    def __init__(self, active_address: Callable[[], str], trouble: Callable[[], str]) -> None:
        """`active_address` is empty while it is not known; `trouble` is why this machine could not take over now."""
        self._active_address = active_address
        self._trouble = trouble

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Reply to any request."""
        if scope["type"] == "http":
            await self.reply(scope)(scope, receive, send)

    def reply(self, scope: Scope) -> Response:
        """Return the reply to a request."""
        path = scope["path"]
        if path == "/healthz":
            return JSONResponse({"status": "ok"}, 200, NO_STORE)
        if path == "/readyz":
            return self._readiness(Request(scope).query_params.get("role", ""))
        message = self._message()
        if is_workshop(path):
            return workshop_failure(message)
        return error_reply(path, RequestError("standby", message, headers={"retry-after": "1"}))

    def _readiness(self, role: str) -> Response:
        trouble = self._trouble()
        body = {"ready": not trouble, "role": "standby", "trouble": trouble}
        return JSONResponse(body, 503 if trouble or role == "active" else 200, NO_STORE)

    def _message(self) -> str:
        if trouble := self._trouble():
            return f"this manager is not active, and cannot become so: {trouble}"
        if address := self._active_address():
            return f"this manager is the standby; the active one is at {address}"
        return "this manager is the standby, and no other is active yet; try again in a few seconds"


class WhileActive:
    """An application that is served only while the term of this manager lasts."""

    def __init__(self, app: Application, remaining_s: Callable[[], float], otherwise: Standby) -> None:
        """`remaining_s` returns for how long the term lasts."""
        self._app: ASGIApp = app
        self._reply_at_once = app.reply_at_once
        self._remaining_s = remaining_s
        self._otherwise = otherwise

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        await (self._app if self._remaining_s() > 0 else self._otherwise)(scope, receive, send)

    def reply_at_once(self, scope: Scope, content: bytes) -> Response | None:
        """Return the reply to a short request, as `Application` does."""
        return self._reply_at_once(scope, content) if self._remaining_s() > 0 else self._otherwise.reply(scope)
