"""Leaf nodes of many sites: a NATS server of its own for some of them, behind a cable that can be cut, and servers that many sites share."""

import asyncio
import json
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from secrets import token_urlsafe
from typing import Any

from lift_manager.hub.folder import HubFolder, Registry, SiteEntry, account, leaf_configuration
from lift_manager.hub.nkey import make_nkey
from tests.lift_manager.hub.rig import NATS_SERVER
from tests.support.programs import HANGS_S, eventually, free_port

MOST_BYTES = 10**12
"""Of all streams on a shared server: each may take as much as on a server of its own."""


@dataclass(frozen=True)
class LeafSite:
    """How a site reaches the hub."""

    id: str
    configuration: dict[str, Any]
    """As `lift-manager hub site add` writes it."""
    password: str


def add_sites(place: HubFolder, sites: Sequence[str]) -> list[LeafSite]:
    """Add many sites at once, as `hub site add` does for each: a thousand times the whole registry would take a minute."""
    settings, registry = place.settings().nats, place.registry()
    added, entries = [], dict(registry.sites)
    for site in sites:
        nkey, password = make_nkey(), token_urlsafe(24)
        text = leaf_configuration(settings, site, nkey, password)
        added.append(LeafSite(site, json.loads("{" + text.partition("\n")[2] + "}"), password))
        entries[site] = SiteEntry(nkey=nkey.public)
    place.write(Registry(password=registry.password, sites=entries))
    return added


class LeafServer:
    """One NATS server, the leaf node of one site or of several, each in an account of its own with its own key and connection."""

    def __init__(self, sites: Sequence[LeafSite], folder: Path, hub_port: int) -> None:
        folder.mkdir(parents=True)
        self.port, self.folder = free_port(), folder
        accounts, remotes = {}, []
        for site in sites:
            (settings,) = site.configuration["accounts"].values()
            accounts[account(site.id)] = {**settings, "users": [{"user": site.id, "password": site.password}]}
            (remote,) = site.configuration["leafnodes"]["remotes"]
            remotes.append({**remote, "urls": [f"nats-leaf://127.0.0.1:{hub_port}"], "account": account(site.id)})
        first = sites[0].configuration
        whole = {
            **first,
            "listen": f"127.0.0.1:{self.port}",
            "jetstream": {**first["jetstream"], "max_file_store": MOST_BYTES},
            "accounts": accounts,
            "leafnodes": {**first["leafnodes"], "remotes": remotes},
        }
        (folder / "leaf.conf").write_text(json.dumps(whole, indent=1)[1:-1])
        with (folder / "log").open("ab") as log:
            command = [NATS_SERVER, "-c", "leaf.conf"]
            self.process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log)
        try:
            # else the next server could be given the same port
            eventually(self._is_ready)
        except BaseException:
            self.end()
            raise

    def _is_ready(self) -> bool:
        assert self.process.poll() is None, self.log
        return "Server is ready" in self.log

    @property
    def url(self) -> str:
        return f"nats://127.0.0.1:{self.port}"

    @property
    def log(self) -> str:
        return (self.folder / "log").read_text("utf-8", "replace")

    def end(self) -> None:
        self.process.terminate()
        self.process.wait(HANGS_S)


@contextmanager
def leaf_servers(groups: Sequence[tuple[Sequence[LeafSite], int]], folder: Path) -> Iterator[list[LeafServer]]:
    """Run a server for each group of sites, which reaches the hub at a port."""
    with ExitStack() as stack:
        servers = []
        for number, (sites, port) in enumerate(groups):
            servers.append(LeafServer(sites, folder / str(number), port))
            stack.callback(servers[-1].end)
        yield servers


class Cable:
    """Between the leaf node of one site and the hub. While it is silent, what was sent waits, as in a network that is broken."""

    def __init__(self, hub_port: int) -> None:
        self._hub_port = hub_port
        self.port = 0
        self._passes = asyncio.Event()
        self._passes.set()
        self._server: asyncio.Server | None = None
        self._ends: set[asyncio.StreamWriter] = set()

    async def lay(self) -> None:
        self._server = await asyncio.start_server(self._connected, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    def cut(self) -> None:
        """Let nothing through, and let neither side know."""
        self._passes.clear()

    def mend(self) -> None:
        self._passes.set()

    def unplug(self) -> None:
        """Close all connections, and refuse others until the cable is laid again."""
        assert self._server is not None
        self._server.close()
        for end in self._ends:
            end.transport.abort()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._ends.add(writer)
        far, pumps = None, list[asyncio.Task[None]]()
        try:
            await self._passes.wait()
            far_reader, far = await asyncio.open_connection("127.0.0.1", self._hub_port)
            self._ends.add(far)
            pumps += [asyncio.create_task(self._pump(*way)) for way in ((reader, far), (far_reader, writer))]
            await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
        except OSError:
            pass  # no hub listens now
        finally:
            for pump in pumps:
                pump.cancel()
            for end in (writer, far):
                if end is not None:
                    self._ends.discard(end)
                    end.transport.abort()

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await reader.read(65_536):
                await self._passes.wait()
                writer.write(data)
                await writer.drain()
