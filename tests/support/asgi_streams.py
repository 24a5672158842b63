"""An application as a transport of httpx, streams included: for a client and a manager in one process, on virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, MutableMapping
from typing import Any

import httpx
from starlette.types import ASGIApp


class AsgiStreams(httpx.AsyncBaseTransport):
    """Runs each request as a task; the body is read while the application sends it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        exchange = _Exchange(await request.aread())
        scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": request.method,
            "headers": [(name.lower(), value) for name, value in request.headers.raw],
            "scheme": request.url.scheme,
            "path": request.url.path,
            "raw_path": request.url.raw_path.split(b"?")[0],
            "query_string": request.url.query,
            "server": (request.url.host, request.url.port or 80),
            "client": ("127.0.0.1", 123),
            "root_path": "",
            "state": {},
        }
        exchange.task = asyncio.create_task(self._app(scope, exchange.receive, exchange.send))  # type: ignore[arg-type]
        exchange.task.add_done_callback(lambda _: exchange.chunks.put_nowait(None))
        start = await exchange.start()
        return httpx.Response(start["status"], headers=start["headers"], stream=exchange)


class _Exchange(httpx.AsyncByteStream):
    """One request and its answer."""

    def __init__(self, body: bytes) -> None:
        self.task: asyncio.Task[None]
        self.chunks: asyncio.Queue[MutableMapping[str, Any] | None] = asyncio.Queue()
        self._body: bytes | None = body
        self._gone = asyncio.Event()

    async def receive(self) -> MutableMapping[str, Any]:
        if self._body is not None:
            body, self._body = self._body, None
            return {"type": "http.request", "body": body, "more_body": False}
        await self._gone.wait()
        return {"type": "http.disconnect"}

    async def send(self, message: MutableMapping[str, Any]) -> None:
        self.chunks.put_nowait(message)

    async def start(self) -> MutableMapping[str, Any]:
        try:
            first = await self.chunks.get()
        except asyncio.CancelledError:
            await self.aclose()
            raise
        if first is None:
            await self.task
            raise AssertionError("the application sent no answer")
        return first

    async def __aiter__(self) -> AsyncIterator[bytes]:
        while True:
            message = await self.chunks.get()
            if message is None:
                return
            yield message.get("body", b"")
            if not message.get("more_body", False):
                return

    async def aclose(self) -> None:
        self._gone.set()
        self.task.cancel()
        await asyncio.wait((self.task,))
