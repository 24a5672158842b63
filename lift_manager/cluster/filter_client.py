"""The manager's side of the packet filter: requests permission with every renewal of the term, and knows whether it is given."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from drivers.errors import ConnectFailed, ConnectProblem
from lift_manager.cluster.filter_messages import (
    ANSWER_S,
    MOST_BYTES,
    PermissionRequest,
    controller_names,
    decode_answer,
    encode,
)
from lift_manager.cluster.member import ActiveTerm
from lift_manager.cluster.term import RENEW_S
from lift_manager.config.load import LoadedSite
from lift_manager.config.tls import path_of

_log = logging.getLogger(__name__)


class FilterClient:
    """Holds the permission of one term. `run` does the work; without permission there is no connection to a controller."""

    def __init__(self, path: Path, term: ActiveTerm, controllers: Sequence[tuple[str, int]]) -> None:
        """`path` is where the filter of this machine listens, `controllers` are those of the site by address and port."""
        self._path = path
        self._term = term
        self._names = controller_names(controllers)
        self._renewed = asyncio.Event()
        self._answered = asyncio.Event()
        """Whether it is known if this machine may reach the controllers."""
        self._is_permitted = False
        self._trouble = ""
        term.follow(lambda _: self._renewed.set())

    async def run(self) -> None:
        """Request permission until the term is over; what was permitted is withdrawn then."""
        try:
            while not self._term.over.is_set():
                try:
                    await self._hold()
                except TimeoutError:
                    self._lose(f"it does not answer within {ANSWER_S:g} s")
                except ValueError as error:
                    self._lose(str(error))
                except OSError as error:
                    self._lose(f"{self._path}: {error.strerror or error}")
                await self._until_due()
        finally:
            self._lose("the term is over")

    async def require(self, controller: str) -> None:
        """Return if this machine may reach the controllers, once that is known. Raises ConnectFailed."""
        await self._answered.wait()
        if not self._is_permitted:
            what = f"the packet filter of this machine lets nothing pass: {self._trouble}"
            raise ConnectFailed(controller, ConnectProblem.OTHER, what)

    async def _hold(self) -> None:
        """Request permission over one connection for as long as it lasts; its end withdraws what was permitted."""
        async with asyncio.timeout(ANSWER_S):
            reader, writer = await asyncio.open_unix_connection(str(self._path), limit=MOST_BYTES)
        try:
            while not self._term.over.is_set():
                writer.write(encode(PermissionRequest(self._term.key.epoch, self._term.until, self._names)))
                async with asyncio.timeout(ANSWER_S):
                    line = await reader.readline()
                if not line:
                    self._lose(self._trouble or "it has ended")
                    return
                if refused := decode_answer(line).refused:
                    self._lose(refused)
                else:
                    self._gain()
                await self._until_due()
        finally:
            self._is_permitted = False
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    async def _until_due(self) -> None:
        """Wait for the next renewal, or as long as it takes at most: a machine that goes on alone has long terms."""
        try:
            async with asyncio.timeout(RENEW_S):
                await self._renewed.wait()
        except TimeoutError:
            return
        self._renewed.clear()

    def _gain(self) -> None:
        if self._trouble:
            _log.warning("cluster: the packet filter lets this machine reach the controllers again")
        self._trouble, self._is_permitted = "", True
        self._answered.set()

    def _lose(self, trouble: str) -> None:
        if trouble != self._trouble and not self._term.over.is_set():
            _log.error("cluster: the packet filter of this machine lets nothing reach the controllers: %s", trouble)
        self._trouble, self._is_permitted = trouble, False
        self._answered.set()


def filter_of(loaded: LoadedSite, term: ActiveTerm) -> FilterClient | None:
    """Return what holds the permission of a term, for a site whose machines have a packet filter."""
    cluster = loaded.site.cluster
    if cluster is None or cluster.packet_filter is None:
        return None
    controllers = [(each.host, each.port) for each in loaded.controllers.values()]
    return FilterClient(path_of(loaded.path.parent, cluster.packet_filter), term, controllers)
