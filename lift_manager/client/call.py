"""One request over HTTP, and what came back. All errors of httpx end here and in `stream`."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from lift_manager.api.keys import Secret
from lift_manager.api.problem import Problem
from lift_manager.client.errors import ClientError, NotAManager, Unreachable, refusal

Form = TypeVar("Form", bound=BaseModel)

WITHIN_S = 5.0
"""Chosen: a manager answers from memory in milliseconds."""
AGAIN_AFTER_S = 0.2
"""Chosen: between two tries of a request that may be repeated."""
ANSWER_LIMIT = 16 * 1024 * 1024
"""Chosen: in bytes; a thousand lifts are a tenth of it."""

_NOTHING_SENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout, httpx.UnsupportedProtocol)


@dataclass(frozen=True)
class Call:
    """A request."""

    method: Literal["GET", "POST"]
    path: str
    """Quoted already."""
    query: Mapping[str, str] = field(default_factory=dict)
    body: Mapping[str, Any] | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    repeat: bool = False
    """Whether it may be sent again when nothing comes back: it reads, it lets go, or it has an idempotency key."""
    waits_s: float = 0.0
    """How long the manager may take before it answers, because it was asked to wait."""
    within_s: float | None = None
    """For each try, where it is not the client's own."""
    also: tuple[int, ...] = ()
    """What else is an answer and no refusal, by its status."""


@dataclass(frozen=True)
class Reply:
    """An answer that is neither a refusal nor from something else."""

    status: int
    headers: Mapping[str, str]
    content: bytes


class Http:
    """A manager's address, and who speaks to it. Open for as long as its context lasts."""

    def __init__(
        self,
        url: str,
        key: str | Secret | None,
        tls: ssl.SSLContext | Path | str | None,
        within_s: float,
        transport: httpx.AsyncBaseTransport | None,
    ) -> None:
        """`transport` takes the place of the network. Raises Unreachable for what is no address, OSError for a CA file that cannot be read."""
        self.url = url.rstrip("/")
        self._within_s = within_s
        secret = key.reveal() if isinstance(key, Secret) else key
        headers = {"accept": "application/json, application/problem+json"}
        self.has_key = secret is not None
        if secret is not None:
            headers["authorization"] = f"Bearer {secret}"
        try:
            # no proxy of the environment: the manager takes no person's word through one. Event streams stay open, so the number
            # of connections has no limit. Time limits are set around whole requests, for those of httpx count between two pieces.
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

    async def get(self, path: str, form: type[Form], **query: str) -> Form:
        """Read something."""
        return await self.ask(Call("GET", path, query, repeat=True), form)

    async def ask(self, call: Call, form: type[Form]) -> Form:
        """Return the answer in its form. Raises ClientError."""
        return self.read(await self.reply(call), form)

    def read(self, reply: Reply, form: type[Form]) -> Form:
        """Return what a reply says. Raises NotAManager for what does not fit."""
        try:
            return form.model_validate_json(reply.content)
        except ValidationError as error:
            raise NotAManager(f"its answer is no {form.__name__}", url=self.url, status=reply.status) from error

    async def reply(self, call: Call) -> Reply:
        """Send it, again if it may be; return what came back. Raises ClientError."""
        try:
            return await self._once(call)
        except Unreachable:
            if not call.repeat:
                raise
        await asyncio.sleep(AGAIN_AFTER_S)
        return await self._once(call)

    async def _once(self, call: Call) -> Reply:
        limit_s = call.waits_s + (self._within_s if call.within_s is None else call.within_s)
        async with self._limited(limit_s), self.opened(call) as response:
            content = await self._whole(response)
        if response.is_success or response.status_code in call.also:
            return Reply(response.status_code, response.headers, content)
        raise self.refused(response.status_code, content)

    @asynccontextmanager
    async def _limited(self, limit_s: float) -> AsyncIterator[None]:
        try:
            async with asyncio.timeout(limit_s):
                yield
        except TimeoutError as error:
            # the connection may have been made: then the request went out
            raise Unreachable(f"nothing within {limit_s:g} s", url=self.url, may_have_arrived=True) from error

    @asynccontextmanager
    async def opened(self, call: Call) -> AsyncIterator[httpx.Response]:
        """Send it, and give the answer before its body. Raises Unreachable, also for what happens within the block."""
        headers = dict(call.headers)
        try:
            async with self._client.stream(
                call.method, call.path, params=call.query or None, json=call.body, headers=headers
            ) as response:
                yield response
        except (httpx.TransportError, httpx.DecodingError) as error:
            arrived = not isinstance(error, _NOTHING_SENT)
            raise Unreachable(_why(error), url=self.url, may_have_arrived=arrived) from error
        except httpx.InvalidURL as error:
            raise Unreachable(str(error), url=self.url, may_have_arrived=False) from error

    async def _whole(self, response: httpx.Response) -> bytes:
        pieces: list[bytes] = []
        size = 0
        async for piece in response.aiter_bytes():
            size += len(piece)
            if size > ANSWER_LIMIT:
                raise NotAManager("its answer has no end", url=self.url, status=response.status_code)
            pieces.append(piece)
        return b"".join(pieces)

    def refused(self, status: int, content: bytes) -> ClientError:
        """Return the error for an answer that is not yes."""
        said = _problem(content) if status >= 400 else None
        if said is None:
            return NotAManager("its refusal is no problem+json", url=self.url, status=status)
        return refusal(said)


def _problem(content: bytes) -> Problem | None:
    try:
        return Problem.model_validate_json(content)
    except ValidationError:
        return None


def _context(url: str, tls: ssl.SSLContext | Path | str | None) -> ssl.SSLContext:
    if isinstance(tls, ssl.SSLContext):
        return tls
    if tls is None and not url.startswith("https:"):
        # believes nobody; and loading whom the system believes takes as long as ten requests
        return ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context = ssl.create_default_context(cafile=tls)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context


def _why(error: Exception) -> str:
    return str(error) or type(error).__name__
