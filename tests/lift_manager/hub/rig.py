"""A hub with its NATS server, the leaf nodes of sites, and managers of sites: NATS is real, the lifts are as a test says."""

import asyncio
import json
import shutil
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, closing, contextmanager
from pathlib import Path
from typing import Any, TypeVar

import httpx
import yaml
from nats.aio.client import Client

from lift_manager.api.keys import KeyRing
from lift_manager.hub.folder import PID_FILE, HubFolder
from lift_manager.hub.remote_site import SiteState
from lift_manager.hub.rows import StoredEvent
from lift_manager.hub.service import Hub
from lift_manager.hub.site_face import HubSettings, SiteFace
from lift_manager.hub.update.follower import Follower
from lift_manager.hub.web import make_hub_app
from tests.lift_manager.web.fake import FakeSite
from tests.support.journal import Journal
from tests.support.programs import HANGS_S, free_port
from tests.support.virtual_time import cancel_all

NATS_SERVER = str(Path(sys.executable).with_name("nats-server"))

Found = TypeVar("Found")


async def until(look: Callable[[], Awaitable[Found]]) -> Found:
    """Look until what is found is true; return it."""
    async with asyncio.timeout(HANGS_S):
        while not (found := await look()):  # noqa: ASYNC110  it looks at other processes
            await asyncio.sleep(0.02)
    return found


class Rig:
    """The folder of a hub, and what runs for it."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(mode=0o700)
        self.place = HubFolder(folder)
        self.settings: dict[str, object] = {
            "leaf_port": free_port(),
            "client_port": free_port(),
            "program": NATS_SERVER,
        }
        """Of the NATS server; they count with the next site that is added."""
        self._site_ports: dict[str, int] = {}

    def add(self, site: str) -> None:
        """Add a site, whose leaf node has a port of its own here."""
        self._site_ports[site] = free_port()
        nats = {**self.settings, "site_port": self._site_ports[site]}
        (self.place.path / "hub.yaml").write_text(yaml.safe_dump({"nats": nats}))
        self.place.add_site(site)

    def files(self, site: str) -> Path:
        return self.place.path / "sites" / site

    def log_of(self, site: str) -> str:
        """What the leaf node of a site has logged."""
        return (self.files(site) / "log").read_text()

    @contextmanager
    def leaf(self, site: str) -> Iterator["subprocess.Popen[bytes]"]:
        """Run the leaf node of a site."""
        with (self.files(site) / "log").open("ab") as log:
            command = [NATS_SERVER, "-c", "leaf.conf"]
            process = subprocess.Popen(command, cwd=self.files(site), stdout=log, stderr=log)
            try:
                yield process
            finally:
                process.send_signal(signal.SIGCONT)
                process.terminate()
                process.wait(HANGS_S)

    async def has_pid(self) -> bool:
        """Whether a NATS server has started with the configuration of the hub."""
        return (self.place.path / PID_FILE).exists()

    def lose_stream(self, site: str) -> None:
        """Lose what the leaf node of a site keeps; it does not run."""
        shutil.rmtree(self.files(site) / "jetstream")

    def use_separate_server(self) -> None:
        """Name a NATS server that runs by itself, for the sites that are added from now on."""
        self.settings["servers"] = [f"nats://127.0.0.1:{self.settings['client_port']}"]

    @contextmanager
    def nats_server(self) -> Iterator[None]:
        """Run that server."""
        with separate_nats_server(self.place, self.settings):
            yield

    def second_place(self) -> HubFolder:
        """Return the folder of a second hub with the same sites, on another computer."""
        path = self.place.path.with_name("second")
        path.mkdir(mode=0o700)
        for file in ("hub.yaml", "sites.json"):
            shutil.copy2(self.place.path / file, path / file)
        return HubFolder(path)

    @asynccontextmanager
    async def hub(self, keys: KeyRing | None = None, place: HubFolder | None = None) -> AsyncIterator["RunningHub"]:
        hub, ready = Hub(place or self.place), asyncio.Event()
        task = asyncio.create_task(hub.run(ready.set))
        try:
            await asyncio.wait({task, asyncio.create_task(ready.wait())}, return_when=asyncio.FIRST_COMPLETED)
            assert ready.is_set(), task
            app = make_hub_app(hub, keys or KeyRing())
            transport = httpx.ASGITransport(app, client=("127.0.0.1", 1))
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
                yield RunningHub(hub, client)
        finally:
            await cancel_all([task])

    @asynccontextmanager
    async def manager(
        self,
        site: str,
        lifts: FakeSite,
        journal: Journal,
        keys: KeyRing | None = None,
        updates: Follower | None = None,
    ) -> AsyncIterator[None]:
        """Run what takes part in the hub, of a manager; with `keys` the site takes commands."""
        settings = HubSettings(site, self._url(site), self._password(site), keys is not None, journal.path, updates)
        task = asyncio.create_task(SiteFace(settings, f"The {site}", lifts, keys).run())
        try:
            yield
            assert not task.done(), task
        finally:
            await cancel_all([task])

    @asynccontextmanager
    async def client(self, site: str) -> AsyncIterator[Client]:
        """Connect to the leaf node of a site with all the rights that the site has."""
        client = Client()
        await client.connect(
            self._url(site),
            user="manager",
            password=self._password(site),
            max_reconnect_attempts=-1,
            reconnect_time_wait=0.1,  # type: ignore[arg-type]
        )
        try:
            yield client
        finally:
            await client.close()

    def access(self, site: str) -> tuple[str, str]:
        """Return address and password of the leaf node of a site, for its manager."""
        return self._url(site), self._password(site)

    def _url(self, site: str) -> str:
        return f"nats://127.0.0.1:{self._site_ports[site]}"

    def _password(self, site: str) -> str:
        return (self.files(site) / "manager.password").read_text().strip()


@contextmanager
def separate_nats_server(place: HubFolder, ports: Mapping[str, object]) -> Iterator[None]:
    """Run a NATS server for a hub, as an operator would; its sites were added before."""
    file = place.path / "server.conf"
    listens = [f'"127.0.0.1:{ports[name]}"' for name in ("client_port", "leaf_port")]
    file.write_text("listen: {}\nleafnodes: {{listen: {}}}\ninclude accounts.conf\n".format(*listens))
    with (place.path / "server.log").open("ab") as log:
        process = subprocess.Popen([NATS_SERVER, "-c", str(file)], stdout=log, stderr=log)
        try:
            yield
        finally:
            process.terminate()
            process.wait(HANGS_S)


class RunningHub:
    """A hub, and a client of its API."""

    def __init__(self, hub: Hub, client: httpx.AsyncClient) -> None:
        self.hub, self.client = hub, client

    async def get(self, path: str, **headers: str) -> httpx.Response:
        return await self.client.get(f"/api/v1{path}", headers=headers)

    async def post(self, path: str, body: object = None, **headers: str) -> httpx.Response:
        return await self.client.post(f"/api/v1{path}", json=body, headers=headers)

    async def until_state(self, site: str, state: SiteState) -> None:
        async def is_so() -> bool:
            return self.hub.state(site) is state

        await until(is_so)

    async def until_reached(self, site: str) -> dict[str, Any]:
        """Wait until the site replies about its lifts; return the reply."""

        async def reply() -> dict[str, Any] | None:
            found = await self.get(f"/sites/{site}/lifts")
            return found.json() if found.status_code == 200 else None

        found = await until(reply)
        assert found is not None
        return found

    def events(self, site: str) -> list[tuple[str, Any]]:
        """What the hub has stored about a site: rows by number and text, gaps by their numbers."""
        found = []
        for event in self.stored(site):
            data = json.loads(event.text)
            if event.name == "row":
                found.append(("row", (data["seq"], data["text"])))
            elif event.name == "gap":
                found.append(("gap", (data["first"], data["last"])))
        return found

    def stored(self, site: str) -> Sequence[StoredEvent]:
        """Everything that the hub has stored about a site."""
        with closing(self.hub.open_rows()) as rows:
            return rows.after(0, site)

    async def until_row(self, site: str, text: str) -> list[tuple[str, Any]]:
        """Wait until a row with this text has arrived; return all events."""

        async def has_it() -> bool:
            return any(entry[0] == "row" and entry[1][1] == text for entry in self.events(site))

        await until(has_it)
        return self.events(site)
