"""Connects to a NATS server. nats-py is loaded on first use, so that a manager without the extra `[hub]` starts, and starts fast."""

from __future__ import annotations

import asyncio
import logging
import secrets
import ssl
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from lift_manager.hub.errors import HubSilent, NatsMissing

if TYPE_CHECKING:
    from nats.aio.client import Client

RECONNECT_S = 1.0
"""How long to wait between two attempts. Chosen: a server restarts in less."""
OLDEST_SERVER = (2, 11)
"""The first NATS server that returns several messages to one direct get."""
CLOSE_WITHIN_S = 0.5
"""Of the 5 s in which a manager ends."""
PING_S = 5
"""How often the connection is tested: one that is dead is given up after two of them."""

_log = logging.getLogger(__name__)


def require_nats() -> None:
    """Load nats-py. Raises NatsMissing."""
    try:
        import_module("nats.aio.client")
    except ImportError as error:
        raise NatsMissing(error) from error


def raise_if_cancelled() -> None:
    """Raise CancelledError if this task is to end: nats-py (2.16) turns that into an error of its own once its connection is closed."""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


@contextmanager
def cancellable() -> Iterator[None]:
    """Raise CancelledError at the end if this task was cancelled meanwhile, also where that was lost.

    nats-py waits with `asyncio.wait_for`, which loses a cancellation before Python 3.12 if what it waits for comes in the same moment: a hub
    that changed its sites did not end. What came before does not count: after a TaskGroup that has failed, Python 3.11 still counts it.
    """
    task = asyncio.current_task()
    before = 0 if task is None else task.cancelling()
    try:
        yield
    finally:
        if task is not None and task.cancelling() > before:
            raise asyncio.CancelledError


def client_context(ca: Path | None) -> ssl.SSLContext:
    """Return what TLS connections to NATS servers need: these trust a CA, or those of the system. Raises OSError."""
    context = ssl.create_default_context(cafile=ca)
    context.sslobject_class = _EndsAtOnce
    return context


class _EndsAtOnce(ssl.SSLObject):
    """The TLS of a connection that ends without the consent of its server.

    nats-py (2.16) connects to another server once the connection to the one before is closed, and asyncio gives a server that hangs 30 s
    for that.
    """

    def unwrap(self) -> None:
        with suppress(ssl.SSLWantReadError):
            super().unwrap()


class Connection:
    """One connection to a NATS server, or to one of a cluster, made again for as long as it lasts.

    Nothing is buffered while it is lost: what cannot be sent now fails now, because a command that arrives late is a wrong command.
    """

    def __init__(
        self, owner: str, servers: tuple[str, ...], user: str, password: str, tls: ssl.SSLContext | None = None
    ) -> None:
        """`owner` is what the log names; `servers` are URLs without credentials. Without `tls`, a tls:// URL trusts the CAs of the system."""
        self._owner, self._servers = owner, servers
        self._user, self._password, self._tls = user, password, tls
        self._names = ", ".join(servers)
        self._trouble = ""
        self._client: Client | None = None

    @property
    def client(self) -> Client:
        """The client; only once `open` has returned."""
        assert self._client is not None  # noqa: S101  for mypy
        return self._client

    @property
    def is_up(self) -> bool:
        """Whether messages can be sent now."""
        return self._client is not None and self._client.is_connected

    async def open(self) -> None:
        """Return once the first connection is made, however long that takes."""
        module = import_module("nats.aio.client")
        self._client = module.Client()
        with cancellable():
            await self._client.connect(
                list(self._servers),
                user=self._user,
                password=self._password,
                name=self._owner,
                error_cb=self._on_error,
                disconnected_cb=self._on_lost,
                reconnected_cb=self._on_connected,
                allow_reconnect=True,
                max_reconnect_attempts=-1,
                reconnect_time_wait=RECONNECT_S,  # type: ignore[arg-type]  # the annotation says int; it goes to asyncio.sleep
                ping_interval=PING_S,
                pending_size=0,
                tls=self._tls,
            )
        await self._on_connected()

    async def request(self, subject: str, data: bytes, inbox: str, within_s: float) -> bytes:
        """Send a request, and return its reply, which arrives under `inbox`: a subject that may leave the account of a site.

        Raises HubSilent.
        """
        from nats.errors import Error  # noqa: PLC0415

        if not self.is_up:
            raise HubSilent("there is no connection to the leaf node")
        try:
            async with asyncio.timeout(within_s):
                subscription = await self.client.subscribe(f"{inbox}.{secrets.token_hex(8)}", max_msgs=1)
                try:
                    await self.client.publish(subject, data, reply=subscription.subject)
                    message = await subscription.next_msg(timeout=within_s)
                finally:
                    with suppress(Error):
                        await subscription.unsubscribe()
        except (Error, TimeoutError) as error:
            raise_if_cancelled()
            raise HubSilent(f"the hub did not reply within {within_s:g} s") from error
        if (message.headers or {}).get("Status"):
            raise HubSilent("the hub is not connected")
        return message.data

    def warn_of_old_server(self) -> None:
        """Warn of a server from which the hub cannot read rows."""
        version = self.client.connected_server_version
        if (version.major, version.minor) < OLDEST_SERVER:
            oldest = ".".join(map(str, OLDEST_SERVER))
            text = "%s: the NATS server at %s is version %s.%s, and rows can be read from %s on: install a newer one"
            _log.warning(text, self._owner, self._names, version.major, version.minor, oldest)

    async def close(self) -> None:
        """Close it, without waiting for what is under way, nor for a server that hangs."""
        if self._client is not None:
            # a connection that is half open fails to close, and that is all the same here
            with cancellable(), suppress(Exception):
                async with asyncio.timeout(CLOSE_WITHIN_S):
                    await self._client.close()

    async def _on_connected(self) -> None:
        self._trouble = ""
        url = self.client.connected_url
        _log.info("%s: connected to %s", self._owner, self._names if url is None else f"{url.scheme}://{url.netloc}")

    async def _on_lost(self) -> None:
        if self._client is not None and not self._client.is_closed:
            _log.warning(
                "%s: the connection to %s is lost; it is made again as soon as possible", self._owner, self._names
            )

    async def _on_error(self, error: Exception) -> None:
        trouble = str(error) or type(error).__name__
        if trouble != self._trouble:
            _log.warning("%s: %s: %s", self._owner, self._names, trouble)
        self._trouble = trouble
