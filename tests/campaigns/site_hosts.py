"""Processes that are many sites each: the face towards the hub, the outbox and the journal are those of a manager; the lifts are not."""

import asyncio
import multiprocessing
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from random import Random
from typing import Any

from lift_manager.api.keys import Key, KeyRing, digest_of
from lift_manager.api.roles import Role
from lift_manager.hub.connection import Connection
from lift_manager.hub.site_face import HubSettings, SiteFace
from lift_manager.lift.journal import Row, RowKind
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from lift_manager.store.store import PendingRow
from lift_manager.web.limits import raise_file_limit
from tests.lift_manager.web.fake import FakeSite
from tests.lift_manager.web.fake_lifts import IDLE
from tests.support.programs import HANGS_S
from tests.support.virtual_time import cancel_all

TICK_S = 0.05
"""How often rows are written."""
KEY_ID, SECRET = "00000002", "5" * 64
"""Of the key that every site accepts commands from."""


@dataclass(frozen=True)
class SitePlan:
    """One site."""

    id: str
    server: str
    """The URL of its leaf node."""
    user: str
    """Of the manager there: one server of many sites needs a name for each."""
    password: str
    journal: Path
    lifts: int


class _Face(SiteFace):
    """The face of a manager whose leaf node is shared with other sites."""

    def __init__(self, plan: SitePlan, site: FakeSite, keys: KeyRing) -> None:
        settings = HubSettings(plan.id, plan.server, plan.password, commands=True, journal=plan.journal)
        super().__init__(settings, f"Site {plan.id}", site, keys)
        self._connection = Connection("hub", (plan.server,), plan.user, plan.password)


class _Simulated:
    """One site of this process."""

    def __init__(self, plan: SitePlan, keys: KeyRing) -> None:
        self.plan = plan
        names = [f"lift-{number}" for number in range(1, plan.lifts + 1)]
        self.lifts = FakeSite({name: replace(IDLE, lift=name) for name in names})
        self.face = _Face(plan, self.lifts, keys)
        self._names = names
        self._store = SqliteStore(plan.journal, plan.id, Limits(keep_days=1, max_mb=500))
        self._store.load()
        self.written = 0

    def write(self, dice: Random) -> None:
        """Write a row as a press makes one."""
        self.written += 1
        lift = dice.choice(self._names)
        row = Row(
            RowKind.PRESS,
            f"{lift}: landing call to L{dice.randrange(9)} for workshop:amr-{dice.randrange(20)}",
            lift,
            f"workshop:amr-{dice.randrange(20)}",
            {
                "command": "landing_call",
                "floor": f"L{dice.randrange(9)}",
                "frames": ["00 01 00 00 00 06 01 06 00 64 00 01"],
            },
        )
        self._store.commit({}, [PendingRow(time.time_ns() // 1000, row)])

    def end(self) -> None:
        self._store.close()


class _Process:
    """What runs in one process."""

    def __init__(self, pipe: Pipe, plans: Sequence[SitePlan], seed: int) -> None:
        self._pipe = pipe
        keys = KeyRing([(Key(KEY_ID, "desk", Role.OPERATOR), digest_of(SECRET))])
        self._sites = {plan.id: _Simulated(plan, keys) for plan in plans}
        self._dice = Random(seed)
        self._rate = 0.0
        self._ended = asyncio.Event()

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        loop.add_reader(self._pipe.fileno(), self._receive)
        faces = []
        for site in self._sites.values():
            faces.append(asyncio.create_task(site.face.run()))
            await asyncio.sleep(0.002)  # not all of them at one moment
        writer = asyncio.create_task(self._write())
        self._pipe.send("started")
        await self._ended.wait()
        loop.remove_reader(self._pipe.fileno())
        await cancel_all([writer, *faces])
        for site in self._sites.values():
            site.end()

    async def _write(self) -> None:
        """Write rows at the rate that is wished, at sites that are drawn."""
        names = list(self._sites)
        owed, last = 0.0, time.monotonic()
        while True:
            await asyncio.sleep(TICK_S)
            now = time.monotonic()
            owed, last = min(owed + (now - last) * self._rate, self._rate), now
            while owed >= 1.0:
                owed -= 1.0
                self._sites[self._dice.choice(names)].write(self._dice)

    def _receive(self) -> None:
        if not self._pipe.poll():
            return
        what, value = self._pipe.recv()
        if what == "rate":
            self._rate = value
        elif what == "burst":
            for site in self._sites.values():
                for _ in range(value):
                    site.write(self._dice)
        elif what == "changes":
            self._pipe.send(len(self._sites[value].lifts.changes))
            return
        elif what == "refusals":
            self._pipe.send([refused.code for refused in self._sites[value].lifts.away])
            return
        elif what == "end":
            self._ended.set()
        self._pipe.send({name: site.written for name, site in self._sites.items()})


def _main(pipe: Pipe, plans: Sequence[SitePlan], seed: int) -> None:
    raise_file_limit()
    asyncio.run(_Process(pipe, plans, seed).run())


class SiteHost:
    """A process that is many sites, as the campaign commands it."""

    def __init__(self, plans: Sequence[SitePlan], seed: int) -> None:
        self.plans = plans
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=_main, args=(other, plans, seed), daemon=True)
        self._process.start()
        other.close()

    @property
    def pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    def receive(self) -> Any:
        """The reply to what was sent last."""
        assert self._pipe.poll(HANGS_S), f"the process of {self.plans[0].id} does not reply"
        return self._pipe.recv()

    def send(self, what: str, value: object = None) -> None:
        self._pipe.send((what, value))

    def ask(self, what: str, value: object = None) -> Any:
        self.send(what, value)
        return self.receive()

    def end(self) -> None:
        if self._process.is_alive():
            self._process.terminate()
        self._process.join(HANGS_S)


@contextmanager
def site_hosts(plans: Sequence[SitePlan], processes: int, seed: int) -> Iterator[list[SiteHost]]:
    """Run these sites in so many processes."""
    hosts = [SiteHost(plans[number::processes], seed * 1000 + number) for number in range(processes)]
    try:
        for host in hosts:
            host.receive()
        yield hosts
    finally:
        for host in hosts:
            host.end()
