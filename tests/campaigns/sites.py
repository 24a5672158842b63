"""Many sites and a hub, in real processes on one computer: how much the hub takes, and what becomes of every row under faults.

    python -m tests.campaigns.sites --sites 1000 --lifts 10 --seed 1
    python -m tests.campaigns.sites --sites 200 --hubs 2

Real: the hub (`lift-manager hub`), its NATS server, the leaf nodes with their JetStream, the face and the outbox of every site, and
its journal. Simulated: the lifts. Shared: processes. A hundred sites are one process of Python, and the leaf nodes of fifty sites are
one NATS server, with an account, a key and a connection to the hub for each; ten sites have leaf nodes of their own.

Judged by rows: what a reader of the hub's events gets, over restarts with `Last-Event-ID`, is compared with the journals.
"""

import argparse
import asyncio
import json
import multiprocessing
import os
import re
import shutil
import signal
import sqlite3
import statistics
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import yaml
from nats.aio.client import Client

from lift_manager.api.keys import token
from lift_manager.hub.folder import HubFolder
from lift_manager.hub.signing import sign, signed_text
from tests.campaigns.leaf_nodes import Cable, LeafServer, LeafSite, add_sites, leaf_servers
from tests.campaigns.site_hosts import KEY_ID, SECRET, SiteHost, SitePlan, site_hosts
from tests.lift_manager.hub.rig import NATS_SERVER, separate_nats_server
from tests.support.programs import HANGS_S, LIFT_MANAGER, Program, free_port

OWN_LEAFS = 10
"""Sites whose leaf node is a process of its own, behind a cable."""
PER_LEAF = 50
"""Sites that share a NATS server as their leaf node."""
PER_PROCESS = 100
"""Sites in one process."""
CUT_S = 60.0
LATE_S = 6.0
"""How long a command is held up: longer than a ticket is good (2 s) and than the hub waits (4 s), and too short to lose the connection (15 s)."""
FLOOD_S = 20.0
LOST = "Leafnode connection closed"
"""What a leaf node logs of a connection that has ended."""
MESSAGES_OF_FLOOD = 1000


@dataclass
class Tally:
    """What a campaign measured and found."""

    measured: list[tuple[str, str]] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    rows: int = 0

    def note(self, what: str, value: str) -> None:
        self.measured.append((what, value))
        sys.stdout.write(f"{what}: {value}\n")
        sys.stdout.flush()

    def find(self, text: str) -> None:
        self.findings.append(text)
        sys.stdout.write(f"FOUND {text}\n")
        sys.stdout.flush()


_EVENT = re.compile(rb"id: (\S+)\nevent: (\w+)\ndata: (.*)")
_ROW = re.compile(rb'"site":"([^"]+)","journal":"([^"]+)","seq":(\d+),"at":(\d+)')


class EventReader:
    """A client of `/api/v1/events` that reconnects with the id of the last event, and keeps which rows it got and how late."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._last = ""
        self.rows: dict[tuple[str, str], list[int]] = {}
        """Numbers by site and journal, in the order of arrival."""
        self.lags: list[tuple[float, str, float]] = []
        """When a row arrived, of which site, and how long after it was written; seconds."""
        self.states: list[tuple[float, str, str]] = []
        """When a site turned to a state."""
        self.others: Counter[str] = Counter()
        self.connections = 0
        self.ids: set[str] = set()
        self.repeated = 0

    @asynccontextmanager
    async def running(self) -> AsyncIterator["EventReader"]:
        task = asyncio.create_task(self._run())
        try:
            yield self
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    def count(self) -> int:
        return sum(len(numbers) for numbers in self.rows.values())

    async def _run(self) -> None:
        async with httpx.AsyncClient(trust_env=False, timeout=httpx.Timeout(5.0)) as client:
            while True:
                with suppress(httpx.HTTPError):
                    headers = {"Last-Event-ID": self._last} if self._last else {}
                    async with client.stream("GET", f"{self._url}/api/v1/events", headers=headers) as reply:
                        if reply.status_code == httpx.codes.OK:
                            self.connections += 1
                            await self._read(reply)
                await asyncio.sleep(0.1)

    async def _read(self, reply: httpx.Response) -> None:
        rest = b""
        async for chunk in reply.aiter_bytes():
            *events, rest = (rest + chunk).split(b"\n\n")
            for event in events:
                self._receive(event)

    def _receive(self, event: bytes) -> None:
        if (found := _EVENT.search(event)) is None:
            if b"event: lost" in event:
                self.others["lost"] += 1
            return
        now = time.time()
        self._last = found[1].decode()
        self.repeated += self._last in self.ids
        self.ids.add(self._last)
        name = found[2].decode()
        if name == "row" and (row := _ROW.search(found[3])) is not None:
            site = row[1].decode()
            self.rows.setdefault((site, row[2].decode()), []).append(int(row[3]))
            self.lags.append((now, site, now - int(row[4]) / 1e6))
        elif name == "site":
            data = json.loads(found[3])
            self.states.append((now, data["site"], data["state"]))
        else:
            self.others[name] += 1

    def lag(self, since: float, *, without: Sequence[str] = ()) -> str:
        """Median and p99 of the lag of what arrived since then."""
        found = sorted(lag for at, site, lag in self.lags if at >= since and site not in without)
        if not found:
            return "no rows"
        p99 = found[min(len(found) - 1, int(len(found) * 0.99))]
        return f"{statistics.median(found):.2f} s (median), {p99:.2f} s (p99), {found[-1]:.2f} s (longest), {len(found)} rows"

    def turned(self, site: str, state: str, since: float) -> float | None:
        """How long after a moment a site turned to a state; None if it did not."""
        return next((at - since for at, of, now in self.states if of == site and now == state and at >= since), None)


class HubProcess:
    """`lift-manager hub`, which can be killed and started again."""

    def __init__(self, place: HubFolder, *, forked: bool) -> None:
        self.place, self._forked = place, forked
        self.url = f"http://127.0.0.1:{place.settings().http.port}"
        self._lives = 0
        self.program: Program | None = None
        self.http = httpx.AsyncClient(base_url=f"{self.url}/api/v1", trust_env=False, timeout=30.0)

    def start(self) -> None:
        self._lives += 1
        life = self.place.path.parent / f"{self.place.path.name}-life-{self._lives}"
        life.mkdir()
        words = ("hub", "--folder", str(self.place.path))
        command = words if self._forked else (*LIFT_MANAGER, *words)
        self.program = Program(command, life, None, forked=self._forked)

    def kill(self) -> None:
        assert self.program is not None
        self.program.tell(signal.SIGKILL)
        self.program.ended()

    async def end(self) -> str:
        """End it in good order; return what is wrong in its log."""
        await self.http.aclose()
        if self.program is None:
            return ""
        self.program.tell(signal.SIGTERM)
        with suppress(Exception):
            await asyncio.to_thread(self.program.ended, 30.0)
        self.program.end()
        return self.program.err[-3000:] if "Traceback" in self.program.err else ""

    async def get(self, path: str) -> Any:
        reply = await self.http.get(path)
        return reply.json() if reply.status_code == httpx.codes.OK else None

    async def states(self) -> Counter[str]:
        """How many sites are in which state; empty while the hub does not reply."""
        with suppress(httpx.HTTPError):
            found = await self.get("/sites")
            return Counter(site["state"] for site in found["sites"]) if found else Counter()
        return Counter()


async def until(look: Callable[[], Awaitable[Any]], within_s: float = 4 * HANGS_S) -> float:
    """Look until what is found is true; return how long that took."""
    began = time.monotonic()
    while not await look():
        if time.monotonic() - began > within_s:
            raise TimeoutError(f"not within {within_s:g} s")
        await asyncio.sleep(0.1)
    return time.monotonic() - began


@dataclass(frozen=True)
class Usage:
    """What a process has used."""

    cpu_s: float
    memory_mb: float
    at: float

    @classmethod
    def of(cls, pid: int) -> "Usage":
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        ticks = int(fields[11]) + int(fields[12])
        cpu_s, memory = ticks / os.sysconf("SC_CLK_TCK"), pages * os.sysconf("SC_PAGESIZE") / 1e6
        return cls(cpu_s, memory, time.monotonic())

    def since(self, before: "Usage") -> str:
        percent = 100 * (self.cpu_s - before.cpu_s) / max(self.at - before.at, 0.001)
        return f"{percent:.0f} % of a core, {self.memory_mb:.0f} MB"


class Campaign:
    """Sites, hubs, and what becomes of them."""

    def __init__(self, folder: Path, tally: Tally, sites: int, lifts: int, seed: int, rate: float) -> None:
        self.folder, self.tally, self.lifts, self.seed, self.rate = folder, tally, lifts, seed, rate
        width = len(str(sites))
        self.names = [f"site-{number:0{width}d}" for number in range(1, sites + 1)]
        self.own = self.names[: min(OWN_LEAFS, sites)]
        self.hubs: list[HubProcess] = []
        self.readers: list[EventReader] = []
        self.hosts: list[SiteHost] = []
        self.cables: dict[str, Cable] = {}
        self.leafs: list[LeafServer] = []
        self.leaf_of: dict[str, LeafServer] = {}
        self.passwords: dict[str, str] = {}

    @asynccontextmanager
    async def running(self, hubs: int, *, forked: bool) -> AsyncIterator[None]:
        """Run everything, and wait until every site is online."""
        async with AsyncExitStack() as stack:
            place, ports = self._folders(hubs)
            added = add_sites(place, self.names)
            self.passwords = {site.id: site.password for site in added}
            places = [place, *(self._second(place, number) for number in range(2, hubs + 1))]
            if hubs > 1:
                stack.enter_context(separate_nats_server(place, ports))
            for each in places:
                hub = HubProcess(each, forked=forked)
                self.hubs.append(hub)
                stack.push_async_callback(self._end_hub, hub)
                hub.start()
            began = time.monotonic()
            for hub in self.hubs:
                await until(hub.states)
            self.tally.note("from the start of the hub to its first reply", f"{time.monotonic() - began:.1f} s")
            groups = await self._groups(added, ports["leaf_port"])
            for cable in self.cables.values():
                stack.callback(cable.unplug)
            self.leafs = stack.enter_context(leaf_servers(groups, self.folder / "leafs"))
            self.leaf_of = {
                site.id: leaf for (sites, _), leaf in zip(groups, self.leafs, strict=True) for site in sites
            }
            began = time.monotonic()
            processes = max(1, len(self.names) // PER_PROCESS)
            self.hosts = stack.enter_context(site_hosts(self._plans(added), processes, self.seed))
            for hub in self.hubs:
                self.readers.append(await stack.enter_async_context(EventReader(hub.url).running()))
                await until(lambda hub=hub: self._all_online(hub))  # type: ignore[misc]
            self.tally.note("from the start of the sites until all are online", f"{time.monotonic() - began:.1f} s")
            yield

    def _folders(self, hubs: int) -> tuple[HubFolder, dict[str, int]]:
        ports = {name: free_port() for name in ("leaf_port", "client_port")}
        nats: dict[str, object] = {**ports, "program": NATS_SERVER}
        if hubs > 1:
            nats["servers"] = [f"nats://127.0.0.1:{ports['client_port']}"]
        return self._folder("hub-1", nats), ports

    def _folder(self, name: str, nats: dict[str, object]) -> HubFolder:
        path = self.folder / name
        path.mkdir(mode=0o700)
        (path / "hub.yaml").write_text(yaml.safe_dump({"http": {"port": free_port()}, "nats": nats}))
        return HubFolder(path)

    def _second(self, place: HubFolder, number: int) -> HubFolder:
        """The folder of another hub with the same sites."""
        nats = yaml.safe_load((place.path / "hub.yaml").read_text())["nats"]
        second = self._folder(f"hub-{number}", nats)
        shutil.copy2(place.registry_file, second.registry_file)
        return second

    async def _groups(self, added: Sequence[LeafSite], port: int) -> list[tuple[Sequence[LeafSite], int]]:
        groups: list[tuple[Sequence[LeafSite], int]] = []
        for site in added[: len(self.own)]:
            cable = Cable(port)
            await cable.lay()
            self.cables[site.id] = cable
            groups.append(([site], cable.port))
        rest = added[len(self.own) :]
        return groups + [(rest[first : first + PER_LEAF], port) for first in range(0, len(rest), PER_LEAF)]

    def _plans(self, added: Sequence[LeafSite]) -> list[SitePlan]:
        (self.folder / "journals").mkdir()
        return [
            SitePlan(
                site.id,
                self.leaf_of[site.id].url,
                site.id,
                site.password,
                self.folder / "journals" / f"{site.id}.db",
                self.lifts,
            )
            for site in added
        ]

    async def _end_hub(self, hub: HubProcess) -> None:
        if wrong := await hub.end():
            self.tally.find(f"the log of a hub has a traceback: {wrong}")

    async def _all_online(self, hub: HubProcess) -> bool:
        return (await hub.states()).get("online", 0) == len(self.names)

    # -- what is done

    def write_at(self, rate: float) -> None:
        """Let all sites together write so many rows a second."""
        for host in self.hosts:
            host.send("rate", rate * len(host.plans) / len(self.names))
        for host in self.hosts:
            host.receive()

    async def ask(self, site: str, what: str) -> Any:
        host = next(host for host in self.hosts if any(plan.id == site for plan in host.plans))
        return await asyncio.to_thread(host.ask, what, site)

    def written(self) -> dict[str, int]:
        """How many rows each site has written."""
        return {name: count for host in self.hosts for name, count in host.ask("written").items()}

    async def drained(self, within_s: float = 4 * HANGS_S) -> float:
        """Wait until every reader has every row; return how long that took."""
        expected = sum((await asyncio.to_thread(self.written)).values())

        async def is_there() -> bool:
            return all(reader.count() >= expected for reader in self.readers)

        try:
            return await until(is_there, within_s)
        except TimeoutError:
            self.tally.find(f"readers have {[reader.count() for reader in self.readers]} of {expected} rows")
            return within_s

    async def steady(self, seconds: float) -> None:
        """Measure what goes on with nothing wrong."""
        hub, reader, note = self.hubs[0], self.readers[0], self.tally.note
        self.write_at(self.rate)
        await asyncio.sleep(2.0)
        pids = {"hub": _pid_of(hub), "NATS server": _nats_pid(hub)}
        before = {name: Usage.of(pid) for name, pid in pids.items() if pid}
        began, rows = time.time(), reader.count()
        trips: list[float] = []
        while time.time() - began < seconds:
            site = self.names[int(time.time() * 1000) % len(self.names)]
            found = await hub.get(f"/sites/{site}/lifts")
            if found is not None:
                trips.append(found["round_trip_s"])
            await asyncio.sleep(0.2)
        took = time.time() - began
        note(
            "rows", f"{(reader.count() - rows) / took:.0f} a second for {took:.0f} s; written {self.rate:.0f} a second"
        )
        note("lag from row to event", reader.lag(began))
        trips.sort()
        note(
            "round trip of a request for lifts",
            f"{1000 * statistics.median(trips):.0f} ms, longest {1000 * trips[-1]:.0f} ms of {len(trips)}",
        )
        for name, usage in before.items():
            note(name, Usage.of(pids[name]).since(usage))
        note(
            f"{len(self.leafs)} leaf nodes",
            f"{sum(Usage.of(leaf.process.pid).memory_mb for leaf in self.leafs):.0f} MB",
        )
        note(
            f"{len(self.hosts)} processes of sites",
            f"{sum(Usage.of(host.pid).memory_mb for host in self.hosts):.0f} MB",
        )
        note("load of the computer (1 minute)", f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
        note("GET /api/v1/sites", await _timed(hub, f"{hub.url}/api/v1/sites"))
        note("a scrape", await _timed(hub, f"{hub.url}/metrics"))

    async def burst(self, rows: int) -> None:
        """Let every site write so many rows at once, and measure how fast they arrive."""
        self.write_at(0)
        await self.drained()
        before = self.readers[0].count()
        began = time.monotonic()
        for host in self.hosts:
            host.send("burst", rows)
        for host in self.hosts:
            await asyncio.to_thread(host.receive)
        await self.drained()
        count = self.readers[0].count() - before
        took = time.monotonic() - began
        self.tally.note(f"{count} rows at once", f"{took:.1f} s, {count / took:.0f} a second, writing included")
        self.write_at(self.rate)

    async def kill_hub(self, away_s: float) -> None:
        """Kill the hub under load, and start it again after a while."""
        hub, reader = self.hubs[0], self.readers[0]
        hub.kill()
        await asyncio.sleep(away_s)
        began, since = time.monotonic(), time.time()
        hub.start()
        replies = await until(hub.states)
        await until(lambda: self._all_online(hub))
        online = time.monotonic() - began

        async def is_current() -> bool:
            recent = [lag for at, _, lag in reader.lags[-200:] if at > since]
            return len(recent) > 100 and statistics.median(recent) < 1.0

        await until(is_current)
        took = time.monotonic() - began
        self.tally.note(
            f"a hub that was killed and is started again after {away_s:g} s",
            f"replies after {replies:.1f} s, all sites online after {online:.1f} s, caught up after {took:.1f} s",
        )

    async def cut(self, seconds: float, sites: Sequence[str]) -> None:
        """Cut some sites off, without that either side is told, and command one of them."""
        hub, reader, note = self.hubs[0], self.readers[0], self.tally.note
        since = time.time()
        for site in sites:
            self.cables[site].cut()
        await asyncio.sleep(seconds)
        offline = [reader.turned(site, "offline", since) for site in sites]
        if None in offline:
            self.tally.find(
                f"not shown offline: {[site for site, at in zip(sites, offline, strict=True) if at is None]}"
            )
        reply = await hub.http.get(f"/sites/{sites[0]}/lifts")
        note("sites that are cut off: shown offline after", _range(offline))
        note("their lifts are", f"{reply.status_code} {reply.json().get('code')}")
        note("lag of the others meanwhile", reader.lag(since, without=sites))
        mended = time.time()
        for site in sites:
            self.cables[site].mend()

        async def are_online() -> bool:
            return all(reader.turned(site, "online", mended) is not None for site in sites)

        await until(are_online)
        note("online again after", _range([reader.turned(site, "online", mended) for site in sites]))

    async def command_while_cut(self, site: str) -> None:
        """Send a command that is held up on its way, and one to a site that is not there: nothing may be done, then or later."""
        hub = self.hubs[0]
        before = await self.ask(site, "changes")
        ticket = (await hub.http.post(f"/sites/{site}/tickets")).json()["ticket"]
        self.cables[site].cut()
        late = await self._send(site, ticket)
        if late["code"] != "unconfirmed":
            self.tally.find(f"a command that is held up: {late}")
        await asyncio.sleep(LATE_S - 4.0)
        self.cables[site].mend()

        async def is_refused() -> bool:
            return "ticket_over" in await self.ask(site, "refusals")

        await until(is_refused)
        ticket = (await hub.http.post(f"/sites/{site}/tickets")).json()["ticket"]
        self.cables[site].unplug()
        gone = await self._send(site, ticket)
        await self.cables[site].lay()
        if gone["code"] != "site_silent":
            self.tally.find(f"a command to a site without a connection: {gone}")
        await until(lambda: hub.get(f"/sites/{site}/lifts"))
        await asyncio.sleep(1.0)
        if await self.ask(site, "changes") != before:
            self.tally.find(f"{site} has carried out a command that came too late")
        self.tally.note(
            "commands to a site that is cut off",
            f"held up: {late['code']}; no connection: {gone['code']}; nothing was done",
        )

    async def _send(self, site: str, ticket: str) -> Any:
        action = json.dumps({"what": "open", "body": {"ttl_s": 60.0, "idempotency_key": f"late-{ticket}"}})
        key_id, signature = sign(token(KEY_ID, SECRET), signed_text(site, "lift-1", ticket, action))
        body = {"ticket": ticket, "key_id": key_id, "signature": signature, "action": action}
        return (await self.hubs[0].http.post(f"/sites/{site}/lifts/lift-1/commands", json=body)).json()

    async def flood(self, site: str, seconds: float) -> None:
        """Let a hostile site send as much as it can."""
        hub, reader = self.hubs[0], self.readers[0]
        since, usage = time.time(), Usage.of(_pid_of(hub))
        with _flooding(self.leaf_of[site].url, site, self.passwords[site]):
            await asyncio.sleep(seconds)
            took = reader.turned(site, "flooding", since)
            spent = Usage.of(_pid_of(hub)).since(usage)
        if took is None:
            self.tally.find(f"{site} floods and is not shown as flooding")
        else:
            self.tally.note("a hostile site floods: shown after", f"{took:.1f} s; the hub takes {spent}")
        self.tally.note("lag of the others meanwhile", reader.lag(since, without=[site]))

    async def switch_off(self, site: str) -> None:
        """Use the off switch under load."""
        hub, reader = self.hubs[0], self.readers[0]
        since, began = time.time(), time.monotonic()
        leaf = self.leaf_of[site]
        before = leaf.log.count(LOST)
        await hub.http.post(f"/sites/{site}/off", json={"by": "campaign", "reason": "under load"})

        async def is_off() -> bool:
            return (await hub.states()).get("off") == 1

        async def is_disconnected() -> bool:
            return leaf.log.count(LOST) > before

        async def is_refused() -> bool:
            return "Authorization Violation" in leaf.log

        times = []
        for look in (is_off, is_disconnected, is_refused):
            await until(look)
            times.append(f"{time.monotonic() - began:.1f} s")
        self.tally.note("the off switch: shown, disconnected and refused after", ", ".join(times))
        await asyncio.sleep(3.0)
        self.tally.note("lag of the others meanwhile", reader.lag(since, without=[site]))
        # the site that flooded is online again about now
        lost = [state for at, of, state in reader.states if at > since and of != site and state != "online"]
        if lost:
            self.tally.find(f"the off switch of {site} turned others: {Counter(lost)}")
        await hub.http.post(f"/sites/{site}/on", json={"by": "campaign"})
        self.tally.note("on again after", f"{await until(lambda: self._all_online(hub)):.1f} s")

    async def compare_hubs(self) -> None:
        """Two hubs give the same answers."""
        await self.drained()
        for path in ("/sites", *(f"/sites/{site}/lifts" for site in self.names[:20])):
            found = [_without_ages(await hub.get(path)) for hub in self.hubs]
            if any(each != found[0] for each in found):
                self.tally.find(f"{path} differs between hubs")
        if any(reader.rows != self.readers[0].rows for reader in self.readers):
            self.tally.find("the readers of two hubs got other rows, or in another order within a journal")
        self.tally.note(
            "hubs compared", f"{len(self.hubs)}: sites, lifts of 20 sites, {self.readers[0].count()} rows of each"
        )

    async def judge(self) -> None:
        """Compare what readers got with the journals."""
        self.write_at(0)
        took = await self.drained()
        self.tally.note("until the last row has arrived", f"{took:.1f} s")
        for reader in self.readers:
            self.tally.rows = reader.count()
            for name in self.names:
                self._judge_site(name, reader)
            if reader.others or reader.repeated:
                self.tally.find(f"a reader got {dict(reader.others)}, and {reader.repeated} events twice")
        counts = [(reader.count(), reader.connections) for reader in self.readers]
        self.tally.note("rows that arrived, and connections of the reader", f"{counts}")

    def _judge_site(self, name: str, reader: EventReader) -> None:
        with closing(sqlite3.connect(self.folder / "journals" / f"{name}.db")) as journal:
            has_written = journal.execute("SELECT 1 FROM sqlite_master WHERE name = 'rows'").fetchone() is not None
            query = "SELECT seq FROM rows ORDER BY seq"
            expected = [number for (number,) in journal.execute(query)] if has_written else []
        found = [numbers for (site, _), numbers in reader.rows.items() if site == name]
        if len(found) > 1:
            self.tally.find(f"{name}: rows of {len(found)} journals")
        got = found[0] if found else []
        if got != expected:
            missing, twice = set(expected) - set(got), len(got) - len(set(got))
            self.tally.find(
                f"{name}: {len(missing)} of {len(expected)} rows are missing, {twice} came twice, sorted: {got == sorted(got)}"
            )


def _pid_of(hub: HubProcess) -> int:
    """The process that has claimed the folder."""
    assert hub.program is not None
    return hub.program.pid


def _nats_pid(hub: HubProcess) -> int:
    with suppress(FileNotFoundError, ValueError):
        return int((hub.place.path / "nats.pid").read_text())
    return 0


async def _timed(hub: HubProcess, path: str) -> str:
    took, size = [], 0
    for _ in range(5):
        began = time.monotonic()
        size = len((await hub.http.get(path)).content)
        took.append(time.monotonic() - began)
    return f"{1000 * statistics.median(took):.0f} ms, longest {1000 * max(took):.0f} ms, {size / 1000:.0f} kB"


def _range(found: Sequence[float | None]) -> str:
    times = sorted(each for each in found if each is not None)
    return f"{times[0]:.1f} to {times[-1]:.1f} s" if times else "never"


def _without_ages(found: Any) -> Any:
    if isinstance(found, list):
        return [_without_ages(each) for each in found]
    if isinstance(found, dict):
        return {
            name: _without_ages(each)
            for name, each in found.items()
            if name not in ("age_s", "news_age_s", "round_trip_s")
        }
    return found


@contextmanager
def _flooding(url: str, site: str, password: str) -> Iterator[None]:
    """A process that sends as much as it can as this site."""
    process = multiprocessing.get_context("spawn").Process(target=_flood, args=(url, site, password), daemon=True)
    process.start()
    try:
        yield
    finally:
        process.terminate()
        process.join(HANGS_S)


def _flood(url: str, site: str, password: str) -> None:
    async def main() -> None:
        client = Client()
        await client.connect(url, user=site, password=password)
        while True:
            for _ in range(MESSAGES_OF_FLOOD):
                await client.publish(f"site.{site}.news", b"x" * 1000)
            await client.flush()

    asyncio.run(main())


async def _play(tally: Tally, folder: Path, given: argparse.Namespace) -> None:
    one = Campaign(folder, tally, given.sites, given.lifts, given.seed, given.rate)
    async with one.running(given.hubs, forked=given.forked):
        await one.steady(60 * given.minutes)
        if given.hubs > 1:
            await one.compare_hubs()
        for part in given.parts:
            play: dict[str, Callable[[], Awaitable[None]]] = {
                "burst": lambda: one.burst(20),
                "kill": lambda: one.kill_hub(given.away_s),
                "cut": lambda: one.cut(given.cut_s, one.own[1:6]),
                "command": lambda: one.command_while_cut(one.own[0]),
                "flood": lambda: one.flood(one.own[-1], FLOOD_S),
                "off": lambda: one.switch_off(one.own[-2]),
            }
            await play[part]()
        await one.judge()


PARTS = ("burst", "kill", "command", "cut", "flood", "off")


def campaign(given: argparse.Namespace) -> Tally:
    """Play what is given; the files are in memory where the computer has that."""
    tally = Tally()
    memory = Path("/dev/shm")
    with TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        asyncio.run(_play(tally, Path(folder), given))
    return tally


def arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse what a campaign is to do."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sites", type=int, default=1000)
    parser.add_argument("--lifts", type=int, default=10, help="of each site")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=1.0, help="with nothing wrong, before the faults")
    parser.add_argument("--rate", type=float, default=200.0, help="rows that all sites together write in a second")
    parser.add_argument("--hubs", type=int, default=1, help="2: both on one NATS server that runs by itself")
    parser.add_argument("--cut-s", type=float, default=CUT_S, help="how long some sites are cut off")
    parser.add_argument("--away-s", type=float, default=5.0, help="how long a hub that was killed is away")
    parser.add_argument("--parts", nargs="*", choices=PARTS, default=PARTS)
    parser.set_defaults(forked=False)
    return parser.parse_args(words)


def main() -> int:
    began = time.monotonic()
    tally = campaign(arguments())
    sys.stdout.write(f"{time.monotonic() - began:.0f} s; {tally.rows} rows; {len(tally.findings)} findings\n")
    return 1 if tally.findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
