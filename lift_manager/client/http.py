"""Sends one request over HTTP and reads the reply. No error of httpx leaves this module and `stream`."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from lift_manager.api.keys import Secret
from lift_manager.api.problem import Problem
from lift_manager.client.errors import ClientError, NotAManager, Unreachable, refused_error

Model = TypeVar("Model", bound=BaseModel)

WITHIN_S = 5.0
"""Chosen: a manager answers from memory in milliseconds."""
RETRY_AFTER_S = 0.2
"""Chosen: between two attempts of a request that may be repeated."""
MAX_REPLY_BYTES = 16 * 1024 * 1024
"""Chosen: ten times the reply for a thousand lifts."""

_NOTHING_SENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout, httpx.UnsupportedProtocol)


@dataclass(frozen=True)
class HttpRequest:
    """A request."""

    method: Literal["GET", "POST"]
    path: str
    """Already percent-encoded."""
    query: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    body: Mapping[str, Any] | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    repeat: bool = False
    """Whether it may be sent again if no reply arrives: it only reads or releases, or it has an idempotency key."""
    server_wait_s: float = 0.0
    """How long the manager was requested to wait before it replies."""
    within_s: float | None = None
    """Time limit of each attempt, if it is not that of the client."""
    accepted_statuses: tuple[int, ...] = ()
    """Further HTTP statuses that are not refusals."""


@dataclass(frozen=True)
class Reply:
    """A reply of a manager that is not a refusal."""

    status: int
    headers: Mapping[str, str]
    content: bytes


class HttpClient:
    """The HTTP connection to one manager, with the key of the caller."""

    def __init__(
        self,
        url: str,
        key: str | Secret | None,
        tls: ssl.SSLContext | Path | str | None,
        within_s: float,
        transport: httpx.AsyncBaseTransport | None,
    ) -> None:
        """`transport` replaces the network. Raises Unreachable for an invalid address, OSError for a CA file that cannot be read."""
        self.url = url.rstrip("/")
        self._within_s = within_s
        secret = key.reveal() if isinstance(key, Secret) else key
        headers = {"accept": "application/json, application/problem+json"}
        self.has_key = secret is not None
        if secret is not None:
            headers["authorization"] = f"Bearer {secret}"
        try:
            # no proxy from the environment: the manager does not accept operator actions through one. Event streams stay open, so
            # connections are not limited. Time limits cover whole requests; those of httpx cover only the time between two chunks.
            self._client = httpx.AsyncClient(
                base_url=self.url,
                headers=headers,
                verify=_context(self.url, tls),
                trust_env=False,
                timeout=None,  # noqa: S113  see above
                limits=httpx.Limits(max_connections=None, max_keepalive_connections=20),
                transport=transport,
            )
        except httpx.InvalidURL as error:
            raise Unreachable(str(error), url=url, may_have_arrived=False) from error

    async def aclose(self) -> None:
        """Close every connection."""
        await self._client.aclose()

    async def get(self, path: str, model: type[Model], **query: str) -> Model:
        """Read something."""
        return await self.send(HttpRequest("GET", path, query, repeat=True), model)

    async def send(self, request: HttpRequest, model: type[Model]) -> Model:
        """Send a request and return the parsed reply. Raises ClientError."""
        return self.parse(await self.send_raw(request), model)

    def parse(self, reply: Reply, model: type[Model]) -> Model:
        """Parse a reply. Raises NotAManager if it does not fit the model."""
        try:
            return model.model_validate_json(reply.content)
        except ValidationError as error:
            raise NotAManager(
                f"its reply is not a valid {model.__name__}", url=self.url, status=reply.status
            ) from error

    async def send_raw(self, request: HttpRequest) -> Reply:
        """Send a request, twice if it may be repeated, and return the reply. Raises ClientError."""
        try:
            return await self._send_once(request)
        except Unreachable:
            if not request.repeat:
                raise
        await asyncio.sleep(RETRY_AFTER_S)
        return await self._send_once(request)

    async def _send_once(self, request: HttpRequest) -> Reply:
        limit_s = request.server_wait_s + (self._within_s if request.within_s is None else request.within_s)
        async with self._limited(limit_s), self.stream(request) as response:
            content = await self._read_body(response)
        if response.is_success or response.status_code in request.accepted_statuses:
            return Reply(response.status_code, response.headers, content)
        raise self.error_of(response.status_code, content)

    @asynccontextmanager
    async def _limited(self, limit_s: float) -> AsyncIterator[None]:
        try:
            async with asyncio.timeout(limit_s):
                yield
        except TimeoutError as error:
            # the request was sent if the connection was made
            raise Unreachable(f"no reply within {limit_s:g} s", url=self.url, may_have_arrived=True) from error

    @asynccontextmanager
    async def stream(self, request: HttpRequest) -> AsyncIterator[httpx.Response]:
        """Send a request, and yield the response before its body. Raises Unreachable, also for errors within the block."""
        headers = dict(request.headers)
        try:
            async with self._client.stream(
                request.method, request.path, params=request.query or None, json=request.body, headers=headers
            ) as response:
                yield response
        except (httpx.TransportError, httpx.DecodingError) as error:
            has_arrived = not isinstance(error, _NOTHING_SENT)
            raise Unreachable(_error_text(error), url=self.url, may_have_arrived=has_arrived) from error
        except httpx.InvalidURL as error:
            raise Unreachable(str(error), url=self.url, may_have_arrived=False) from error

    async def _read_body(self, response: httpx.Response) -> bytes:
        pieces: list[bytes] = []
        size = 0
        async for piece in response.aiter_bytes():
            size += len(piece)
            if size > MAX_REPLY_BYTES:
                raise NotAManager("its reply has no end", url=self.url, status=response.status_code)
            pieces.append(piece)
        return b"".join(pieces)

    def error_of(self, status: int, content: bytes) -> ClientError:
        """Return the error for a reply that is not a success."""
        problem = _problem(content) if status >= 400 else None
        if problem is None:
            return NotAManager("its refusal is not problem+json", url=self.url, status=status)
        return refused_error(problem)


def _problem(content: bytes) -> Problem | None:
    try:
        return Problem.model_validate_json(content)
    except ValidationError:
        return None


def _context(url: str, tls: ssl.SSLContext | Path | str | None) -> ssl.SSLContext:
    if isinstance(tls, ssl.SSLContext):
        return tls
    if tls is None and not url.startswith("https:"):
        # trusts no CA, because loading those of the system takes as long as ten requests
        return ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context = ssl.create_default_context(cafile=tls)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context


def _error_text(error: Exception) -> str:
    text = str(error) or type(error).__name__
    return "it does not use TLS; begin its address with http://" if "WRONG_VERSION_NUMBER" in text else text
