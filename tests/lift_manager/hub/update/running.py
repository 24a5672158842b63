"""The desk of a hub and the managers of sites as far as updates concern them, in virtual time: folders and checks are real; NATS is not."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace

from lift_manager.config.load import load_site
from lift_manager.hub.errors import HubSilent
from lift_manager.hub.update.desk import Desk, Happened, UpdateFiles
from lift_manager.hub.update.follower import Follower
from lift_manager.hub.update.installation import Installation
from lift_manager.hub.update.installed import Version, start
from lift_manager.hub.update.stage import Obstacles, stage
from lift_manager.lift.journal import Row
from lift_manager.lift.state import Quality
from tests.lift_manager.hub.update.office import served
from tests.lift_manager.web.fake import FakeSite
from tests.lift_manager.web.fake_lifts import IDLE
from tests.support.virtual_time import cancel_all


async def at_once(work: Callable[[], None]) -> None:
    work()


@dataclass
class Hub:
    """The desk of a hub, which can be cut off."""

    files: UpdateFiles
    desk: Desk = field(init=False)
    is_cut_off: bool = False
    cut_off: set[str] = field(default_factory=set)
    """Sites that do not reach it."""
    happened: list[Happened] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.desk = Desk(self.files)

    def request_of(self, site: str) -> Callable[[str, bytes], Awaitable[bytes]]:
        async def request(kind: str, data: bytes) -> bytes:
            if self.is_cut_off or site in self.cut_off:
                raise HubSilent("cut off")
            if kind == "part":
                return self.desk.part(site, data)
            offer, happened = self.desk.offer(site, data, asyncio.get_running_loop().time())
            self.happened += happened
            return offer.model_dump_json().encode()

        return request


@dataclass
class RunningSite:
    """The manager of a site, started again whenever it ends; `breaks` is what a configuration does to its lifts."""

    name: str
    installation: Installation
    hub: Hub
    obstacles: Obstacles = served
    breaks: Callable[[int, FakeSite], None] = lambda _number, _site: None
    starts: list[int] = field(default_factory=list)
    """The number by which it ran, for each start."""
    rows: list[str] = field(default_factory=list)
    busy: dict[str, str] = field(default_factory=dict)
    """What is under way, by lift."""
    at_the_end: Callable[[], None] = lambda: None
    """Happens once everything is released."""
    on_start: Callable[[], None] = lambda: None
    """Happens once a manager has read its configuration."""
    lifts: FakeSite = field(init=False)
    follower: Follower = field(init=False)
    _stop: asyncio.Event = field(default_factory=asyncio.Event)
    _is_killed: bool = False

    def kill(self) -> None:
        """Let the manager end without a word; it is started again."""
        self._is_killed = True
        self._stop.set()

    async def run(self, after_s: float) -> None:
        await asyncio.sleep(after_s)
        while True:
            begun = start(self.installation.read())
            self.installation.write(begun)
            self.starts.append(begun.current.number)
            load_site(self.installation.site_file)  # what a start cannot load is no configuration
            self.lifts = FakeSite({"goods": replace(IDLE, lift="goods")})
            self.lifts.busy = self.busy
            self.breaks(begun.current.number, self.lifts)
            self.on_start()
            self.follower, self._stop = Follower(self.installation, self._stage, at_once), asyncio.Event()
            tasks = [
                asyncio.create_task(self.follower.run(self.lifts, self._note, self._stop.set)),
                asyncio.create_task(self.follower.request_updates(self.hub.request_of(self.name))),
            ]
            try:
                await self._stop.wait()
            finally:
                await cancel_all(tasks)
            if self._is_killed:
                self._is_killed = False
                continue
            self.at_the_end()
            self.finish()

    def finish(self) -> None:
        """Change the configuration, as the last thing before the process ends."""
        self.follower.finish(self.lifts, released=True)

    async def _stage(self) -> Version:
        return stage(self.installation.incoming.read_bytes(), self.installation, self.obstacles)

    def _note(self, row: Row) -> None:
        self.rows.append(row.text)

    @property
    def number(self) -> int:
        return self.starts[-1]


def lose_the_lift(number: int, site: FakeSite) -> None:
    """Under update 8 the lift cannot be read."""
    if number == 8:
        site.lifts["goods"] = replace(site.lifts["goods"], quality=Quality.OFFLINE, reason="no answer")
