"""The hub: all sites, over one connection to its NATS servers, and what was read of them."""

from __future__ import annotations

import asyncio
import logging
import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import TypeVar

from pydantic import ValidationError

from drivers.thread import Worker
from lift_manager.hub.connection import CLOSE_WITHIN_S, Connection
from lift_manager.hub.errors import FolderUnusable, UpdateRefused
from lift_manager.hub.folder import HubFolder, Registry, SiteEntry, account
from lift_manager.hub.messages import Position, RowMessage
from lift_manager.hub.nats_server import NatsServer
from lift_manager.hub.remote_site import RemoteSite, SiteState
from lift_manager.hub.rows import RowStore, StoredEvent
from lift_manager.hub.system_account import SystemAccount
from lift_manager.hub.update.desk import Desk, SiteUpdate, UpdateFiles

CHECK_EVERY_S = 0.5
"""How often the files of the folder are checked, as those of keys."""

CERTIFICATES_EVERY_S = 60.0
"""How often it is checked until when the certificates are valid."""

REACHED_S = 3.0
"""How long a new site may take until a request reaches it, where there is a cluster of NATS servers. Chosen: news come every few seconds."""

MOST_REACHED_S = 1800.0
"""The longest pause before a new site is tried once more. Chosen: within an hour the file of the accounts has come to every server."""

RETRY_S = 5.0
"""How long to wait after a failure."""

Result = TypeVar("Result")
Receive = Callable[[StoredEvent, str], None]
"""Takes an event and its site; must neither wait nor raise."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Unreached:
    """A site that no request has reached yet."""

    until: float
    """When it is tried next."""
    pause_s: float


class Hub:
    """All sites of a folder. It observes them while `run` runs, and replies to its faces from memory, its database, or the site itself."""

    def __init__(self, folder: HubFolder) -> None:
        """Raises FolderUnusable and NatsServerMissing."""
        self.folder = folder
        self.registry: Registry = folder.registry()
        """As shown: a site that was switched here counts as such at once."""
        self._applied = self.registry
        """As the NATS servers have it."""
        settings = folder.settings().nats
        self._server = None if settings.servers else NatsServer(folder)
        """None where the NATS servers run by themselves."""
        password, tls = self.registry.password, folder.client_tls()
        self._connection = Connection("hub", settings.urls, "hub", password, tls)
        system = partial(Connection, "hub", settings.urls, "system", password, tls)
        self._system = SystemAccount(system, len(settings.urls))
        self._is_cluster = len(settings.urls) > 1
        self._unreached: dict[str, _Unreached] = {}
        """Sites that were added or switched on, until a request has reached them."""
        self.sites: dict[str, RemoteSite] = {}
        """The sites that are not switched off."""
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._rows: RowStore | None = None
        self._worker = Worker("lift-manager-hub")
        self._receivers: dict[Receive, None] = {}
        self._desk = Desk(UpdateFiles(folder.path))
        self.certificates: Mapping[str, datetime | None] = folder.certificates()
        """Until when they are valid, by what they are for; None for one that cannot be read."""

    @property
    def is_up(self) -> bool:
        """Whether the hub reaches a NATS server."""
        return self._connection.is_up

    async def run(self, ready: Callable[[], None]) -> None:
        """Observe all sites until cancelled. Raises FolderUnusable where another hub does."""
        lock = self.folder.claim()
        try:
            await self._run(ready)
        finally:
            os.close(lock)

    async def _run(self, ready: Callable[[], None]) -> None:
        self.folder.write(self.registry)
        self._rows = await self._in_thread(lambda: RowStore(self.folder.rows))
        positions = await self._in_thread(self._store.positions)
        try:
            async with asyncio.TaskGroup() as tasks:
                if self._server is not None:
                    tasks.create_task(self._server.run())
                try:
                    if self._server is not None:
                        await self._server.accepts()
                    await self._connection.open()
                    self._connection.warn_of_old_server()
                    self._follow(tasks, self.registry, positions)
                    ready()
                    await self._follow_folder(tasks)
                finally:
                    await self._connection.close()  # before the server ends
        finally:
            closed = self._worker.submit(self._rows.close)
            self._worker.stop()
            await asyncio.wait([closed], timeout=CLOSE_WITHIN_S)  # a disk may hang

    def state(self, site: str) -> SiteState:
        """Return whether a site of the registry can be reached."""
        if self.registry.sites[site].off is not None:
            return SiteState.OFF
        return self.sites[site].state if site in self.sites else SiteState.UNKNOWN

    def switch_off(self, site: str, by: str, reason: str) -> None:
        """Switch a site off; the NATS servers follow. Raises FolderUnusable."""
        self.folder.switch_off(site, by, reason)
        self._forget(self.folder.registry())

    def switch_on(self, site: str, by: str) -> None:
        """Switch a site on; it is observed once the NATS servers have followed. Raises FolderUnusable."""
        self.folder.switch_on(site, by)
        self._forget(self.folder.registry())

    def update_of(self, site: str) -> SiteUpdate:
        """Return how a site stands with configuration updates, from memory."""
        return self._desk.update_of(site)

    def open_rows(self) -> RowStore:
        """Return the rows, for a reader of its own; once `run` runs."""
        return RowStore(self.folder.rows)

    async def newest_events(self, site: str, most: int) -> Sequence[StoredEvent]:
        """Return the newest events of a site, the newest first, without the data of rows; while `run` runs."""
        return await self._in_thread(lambda: self._store.newest_of(site, most))

    @contextmanager
    def listen(self, receive: Receive) -> Iterator[None]:
        """Pass on every event for as long as the context lasts."""
        self._receivers[receive] = None
        try:
            yield
        finally:
            del self._receivers[receive]

    async def announce(self, site: str, word: str, text: str) -> None:
        """Store and pass on an event of the hub itself about a site."""
        await self._record(site, {"event": "site", "state": word, "text": text})

    async def answer_update(self, site: str, kind: str, data: bytes) -> bytes | None:
        """Return the reply to a request of a site about configuration updates; None for one without meaning."""
        now = asyncio.get_running_loop().time()
        try:
            if kind == "part":
                return await self._in_thread(lambda: self._desk.part(site, data))
            if kind != "offer":
                return None
            offer, happened = await self._in_thread(lambda: self._desk.offer(site, data, now))
        except ValidationError:
            self.sites[site].unreadable += 1
            return None
        except UpdateRefused as error:
            _log.warning("%s: its request for an update is not answered: %s", site, error)
            return None
        for one in happened:
            _log.info("%s: update %d: %s %s", site, one.number, one.progress, one.text)
            await self._record(
                site, {"event": "update", "number": one.number, "progress": one.progress, "text": one.text}
            )
        return offer.model_dump_json().encode()

    async def _record(self, site: str, event: dict[str, object]) -> None:
        """Store and pass on an event of the hub itself, with the time of its own clock."""
        timed = {**event, "at": time.time_ns() // 1000}
        try:
            await self._add(site, lambda: [self._store.add_event(site, timed)])
        except sqlite3.Error as error:
            _log.error("%s: %s cannot be stored: %s", site, event["event"], error)

    @property
    def _store(self) -> RowStore:
        assert self._rows is not None  # noqa: S101  for mypy
        return self._rows

    async def _add_rows(self, site: str, rows: Sequence[RowMessage], position: Position) -> None:
        await self._add(site, lambda: self._store.add_rows(site, rows, position))

    async def _add(self, site: str, work: Callable[[], Sequence[StoredEvent]]) -> None:
        """Store events, and pass them on in the order of their numbers, also if the task of their site ends meanwhile."""
        stored = self._worker.submit(work)
        stored.add_done_callback(partial(self._pass_on, site))
        await asyncio.shield(stored)

    def _pass_on(self, site: str, stored: asyncio.Future[Sequence[StoredEvent]]) -> None:
        if stored.cancelled() or stored.exception() is not None:
            return
        for event in stored.result():
            for receive in self._receivers:
                receive(event, site)

    async def _in_thread(self, work: Callable[[], Result]) -> Result:
        return await self._worker.submit(work)

    def _forget(self, registry: Registry) -> None:
        """Observe no site that a registry does not have, or has switched off, and serve requests for none."""
        for site in set(self.sites) - _live(registry):
            self._tasks.pop(site).cancel()
            del self.sites[site]
        self.registry = registry

    def _follow(self, tasks: asyncio.TaskGroup, registry: Registry, positions: Mapping[str, Position]) -> None:
        """Observe the sites of a registry that are not switched off, and no others."""
        self._forget(registry)
        for site in sorted(_live(registry) - set(self.sites)):
            found = RemoteSite(
                site, self._connection, positions.get(site), self._add_rows, self.announce, self.answer_update
            )
            self.sites[site] = found
            self._tasks[site] = tasks.create_task(_observe(found))

    async def _follow_folder(self, tasks: asyncio.TaskGroup) -> None:
        """Apply changes of the registry, which the command line and the API write, and use renewed certificates."""
        trouble = ""
        tls_changed_at = await self._in_thread(self.folder.tls_changed_at)
        certificates_at = 0.0
        while True:
            await asyncio.sleep(CHECK_EVERY_S)
            now = asyncio.get_running_loop().time()
            try:
                registry = await self._in_thread(self.folder.registry)
                newest = await self._in_thread(self.folder.tls_changed_at)
                await self._in_thread(self._desk.refresh)
                if now - certificates_at >= CERTIFICATES_EVERY_S:
                    self.certificates, certificates_at = await self._in_thread(self.folder.certificates), now
            except (FolderUnusable, UpdateRefused) as error:
                if str(error) != trouble:
                    _log.error("%s; the sites stay as they are", error)
                trouble = str(error)
                continue
            trouble = ""
            await self._system.retry()
            await self._reach(now)
            if registry != self._applied:
                await self._apply(tasks, registry)
            if newest != tls_changed_at:
                tls_changed_at = newest
                await self._system.reload(())
                _log.info("the NATS server reads its certificate again")

    async def _reach(self, now: float) -> None:
        """Let new sites connect again that no request reaches, ever more rarely.

        A server of a cluster that learns of a site after that has connected to another one passes nothing on to it (2.15).
        """
        due = [site for site, waits in self._unreached.items() if now >= waits.until]
        found = [site for site in due if site in self.sites]
        answers = await asyncio.gather(*(self.sites[site].answers() for site in found))
        silent = {site for site, is_there in zip(found, answers, strict=True) if not is_there}
        for site in due:
            pause_s = 2 * self._unreached.pop(site).pause_s
            if site in silent and pause_s <= MOST_REACHED_S:
                self._unreached[site] = _Unreached(now + pause_s, pause_s)
        if silent:
            _log.info("no request reaches %s; the NATS servers let it connect again", ", ".join(sorted(silent)))
            await self._system.reload({account(site) for site in silent})

    async def _apply(self, tasks: asyncio.TaskGroup, registry: Registry) -> None:
        before, self._applied = self._applied.sites, registry
        closed = {
            account(site) for site, entry in before.items() if _must_connect_again(entry, registry.sites.get(site))
        }
        self._forget(registry)  # at once: a server may be slow
        await self._system.reload(closed)
        self._follow(tasks, registry, await self._in_thread(self._store.positions))
        if self._is_cluster:
            now = asyncio.get_running_loop().time()
            new = {site for site in _live(registry) if site not in before or before[site].off is not None}
            self._unreached |= {site: _Unreached(now + REACHED_S, REACHED_S) for site in new}
        for site, entry in registry.sites.items():
            if entry.switch is not None and (site not in before or before[site].switch != entry.switch):
                word = SiteState.OFF.value if entry.switch.is_off else "on"
                by = f"switched {'off' if entry.switch.is_off else 'on'} by {entry.switch.by}"
                await self.announce(site, word, f"{by}: {entry.switch.reason}" if entry.switch.reason else by)
        _log.info("the sites have changed; there are %d now", len(registry.sites))


async def _observe(remote: RemoteSite) -> None:
    """Observe a site for ever. What one site sends must not end the hub for the others, whatever it reveals."""
    while True:
        try:
            await remote.run()
        except Exception:  # noqa: BLE001  it is logged
            _log.exception("%s: the hub fails to observe this site, and begins again", remote.id)
        await asyncio.sleep(RETRY_S)


def _live(registry: Registry) -> set[str]:
    """Return the sites that are not switched off."""
    return {site for site, entry in registry.sites.items() if entry.off is None}


def _must_connect_again(before: SiteEntry, entry: SiteEntry | None) -> bool:
    """Whether the connection of a site has to end: it is no longer allowed, or the account that it belongs to may be one from before.

    A server that learns late that a site is off keeps its connection (2.15), in an account that is not the one that it gets with the site on
    again: what the site sends there reaches nobody.
    """
    return entry is None or entry.nkey != before.nkey or (entry.off is None) != (before.off is None)
