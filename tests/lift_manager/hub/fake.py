"""A hub without NATS for the tests of its page: its sites are as a test says, and switched as its files say."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from lift_manager.api.lifts import Lift
from lift_manager.hub.connection import Connection
from lift_manager.hub.errors import SiteSilent
from lift_manager.hub.folder import HubFolder, Registry, SiteEntry
from lift_manager.hub.messages import News, Position, RemoteLift, RemoteLifts, RowMessage
from lift_manager.hub.remote_site import LiftsReply, RemoteSite, SiteState
from lift_manager.hub.rows import RowStore, StoredEvent
from lift_manager.hub.service import Hub
from lift_manager.hub.update.desk import UpdateFiles
from lift_manager.hub.update.messages import Report
from lift_manager.hub.update.rollout import Rollout
from lift_manager.lift.state import LiftState
from tests.lift_manager.web.fake_lifts import IDLE
from tests.support.journal import T0

NKEY = "U" + "A" * 55
LIFTS = (replace(IDLE, lift="goods"), replace(IDLE, lift="lobby"))


class FakeRemoteSite(RemoteSite):
    """A site that replies with the lifts that a test says, or not at all."""

    def __init__(self, site: str, connection: Connection) -> None:
        super().__init__(site, connection, None, _no_rows, _nobody, _no_update)
        self.state = SiteState.ONLINE
        self.age_s = 0.5
        self.shown: Sequence[LiftState] = LIFTS
        self.requests = 0
        """How often its lifts were requested."""
        self.report()

    @property
    def news_age_s(self) -> float | None:
        return None if self.news is None else self.age_s

    def report(self, *, live: int = 2, behind: int = 0) -> None:
        """Set the newest news."""
        newest = Position(stream="s", at=behind)
        self.news = News(
            name=f"The {self.id}", version="1.0", lifts=2, live=live, commands=False, newest=newest if behind else None
        )

    def cut(self) -> None:
        """Cut the site off."""
        self.state, self.age_s = SiteState.OFFLINE, 754.0

    async def lifts(self, lift: str | None) -> LiftsReply:
        self.requests += 1
        if self.state is not SiteState.ONLINE:
            raise SiteSilent(f"{self.id} is not connected", was_sent=False)
        found = tuple(RemoteLift.of(Lift.of(state, max_age_s=1.0)) for state in self.shown)
        return LiftsReply(RemoteLifts(lifts=found), 0.004)


class FakeHub(Hub):
    """Sites of which none is observed."""

    def __init__(self, folder: Path, sites: Iterable[str]) -> None:
        folder.mkdir(mode=0o700)
        place = HubFolder(folder)
        place.write(Registry(password="p" * 24, sites={site: SiteEntry(nkey=NKEY) for site in sites}))
        super().__init__(place)
        self.fakes: Mapping[str, FakeRemoteSite] = {
            site: FakeRemoteSite(site, self._connection) for site in self.registry.sites
        }
        self.sites = dict(self.fakes)
        self._stored = RowStore(place.rows)

    def follow(self) -> None:
        """Read the files again, as a running hub does twice a second."""
        self._forget(self.folder.registry())

    def _forget(self, registry: Registry) -> None:
        self.registry = registry
        self.sites = {site: self.fakes[site] for site, entry in registry.sites.items() if entry.off is None}

    def roll_out(self, rollout: Rollout, reports: Mapping[str, Report]) -> None:
        """Begin a roll-out, as far as sites have reported."""
        files = UpdateFiles(self.folder.path)
        files.write_reports(reports)
        files.write(rollout)
        self._desk.refresh()

    def write(self, site: str, *texts: str, first: int | None = None) -> None:
        """Store rows of a site's journal, from number `first` on."""
        at = len(self._stored.after(0, site)) + 1 if first is None else first
        rows = [
            RowMessage(
                journal="j",
                seq=seq,
                at=T0,
                kind="person",
                lift="goods",
                caller="M. Weber",
                text=text,
                data='{"much": "of it"}',
                hash="0" * 64,
            )
            for seq, text in enumerate(texts, at)
        ]
        self._stored.add_rows(site, rows, Position(stream="s", at=at + len(rows)))

    def note(self, site: str, event: dict[str, object]) -> None:
        """Store an event of the hub itself."""
        self._stored.add_event(site, event)

    async def newest_events(self, site: str, most: int) -> Sequence[StoredEvent]:
        return self._stored.newest_of(site, most)

    def close(self) -> None:
        """Close the database."""
        self._stored.close()


@contextmanager
def fake_hub(folder: Path, *sites: str) -> Iterator[FakeHub]:
    """A hub with these sites, in a folder of its own within this one."""
    hub = FakeHub(folder / "hub", sites)
    try:
        yield hub
    finally:
        hub.close()


async def _no_rows(site: str, rows: Sequence[RowMessage], position: Position) -> None:
    raise AssertionError(site)


async def _nobody(site: str, word: str, text: str) -> None:
    raise AssertionError(site)


async def _no_update(site: str, kind: str, data: bytes) -> bytes | None:
    raise AssertionError(site)
