"""A term and the packet filter of its machine, over a Unix socket as between two processes: without permission there is no connection."""

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from drivers.clock import boottime
from drivers.errors import ConnectFailed
from lift_manager.cli.active_machine import packet_filter_problem
from lift_manager.cli.serve_checks import cautions
from lift_manager.cluster.errors import FilterFailed
from lift_manager.cluster.filter_client import FilterClient
from lift_manager.cluster.filter_helper import Filter, is_served, listening, serve
from lift_manager.cluster.member import ActiveTerm
from lift_manager.cluster.term import Key, Role, Term
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.takeover import fenced
from tests.support.programs import HANGS_S

CONTROLLERS = [("10.0.0.5", 502)]


class Site:
    """One machine with a term, whose packet filter has no kernel under it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "socket"
        self.term = ActiveTerm(Key(1, 7, "north"), boottime)
        self.term.renew(Term(role=Role.ACTIVE, until=boottime() + 3600.0))
        self.client = FilterClient(self.path, self.term, CONTROLLERS)
        self.is_permitted = asyncio.Event()
        self.is_withdrawn = asyncio.Event()
        self.problem = ""

    def permit(self, user: int, ms: int, forget: Sequence[str] = ()) -> None:
        if self.problem:
            raise FilterFailed(self.problem)
        self.is_permitted.set()
        self.is_withdrawn.clear()

    def withdraw(self) -> None:
        self.is_permitted.clear()
        self.is_withdrawn.set()

    @asynccontextmanager
    async def filter(
        self, controllers: Sequence[tuple[str, int]] = CONTROLLERS, user: int | None = None
    ) -> AsyncIterator[None]:
        stop = asyncio.Event()
        user = os.getuid() if user is None else user
        with listening(self.path) as sock:
            serving = asyncio.create_task(serve(Filter(controllers, user, self, lambda: None), sock, user, stop))
            try:
                yield
            finally:
                stop.set()
                await serving

    async def refusal(self) -> str:
        await asyncio.sleep(0)  # a test may look again and again, and the others need their turn
        with pytest.raises(ConnectFailed) as caught:
            await self.client.require("plc")
        return str(caught.value)

    async def permission(self) -> None:
        """Return once it is given."""
        while True:
            try:
                return await self.client.require("plc")
            except ConnectFailed:
                await asyncio.sleep(0)


def play(check: Callable[[Site], Awaitable[None]]) -> None:
    async def run() -> None:
        # a short path: that of a socket has 107 characters at most
        with TemporaryDirectory() as folder:
            site = Site(Path(folder))
            holding = asyncio.create_task(site.client.run())
            async with asyncio.timeout(HANGS_S):
                await check(site)
                site.term.end()
                await holding

    asyncio.run(run())


def test_a_term_has_permission_until_it_is_over() -> None:
    async def check(site: Site) -> None:
        async with site.filter():
            await site.permission()
            assert site.is_permitted.is_set()
            site.term.end()
            await site.is_withdrawn.wait()

    play(check)


def test_without_a_filter_there_is_no_connection_and_the_reason_names_it() -> None:
    async def check(site: Site) -> None:
        assert f"the packet filter of this machine lets nothing pass: {site.path}: No such file" in await site.refusal()
        async with site.filter():
            await site.permission()

    play(check)


def test_a_filter_that_ends_takes_the_permission_with_it_and_a_new_one_gives_it_again() -> None:
    async def check(site: Site) -> None:
        async with site.filter():
            await site.permission()
        await site.is_withdrawn.wait()
        while "Connection refused" not in await site.refusal():
            pass
        async with site.filter():
            await site.permission()

    play(check)


def test_a_filter_that_refuses_is_quoted() -> None:
    async def check(site: Site) -> None:
        async with site.filter([("10.0.0.6", 502)]):
            assert "it filters 10.0.0.6:502, and the manager has 10.0.0.5:502" in await site.refusal()
        site.problem = "the kernel refuses"
        async with site.filter():
            while "the kernel refuses" not in await site.refusal():
                pass

    play(check)


def test_another_user_than_that_of_the_manager_is_refused() -> None:
    async def check(site: Site) -> None:
        other = os.getuid() + 1
        async with site.filter(user=other):
            while f"it serves user {other}, and this one is {os.getuid()}" not in await site.refusal():
                pass
        assert not site.is_permitted.is_set()

    play(check)


def test_one_machine_has_one_filter(tmp_path: Path) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "socket"
        with listening(path):
            assert is_served(path)
            with pytest.raises(FilterFailed, match="another packet filter"), listening(path):
                pass
        assert not is_served(path)
        with listening(path):  # the file of one that has ended is no obstacle
            assert path.exists()
        with pytest.raises(FilterFailed, match="No such file"), listening(tmp_path / "absent" / "socket"):
            pass


FENCED = """\
schema: 1
name: A building
controllers: {plc: {host: 10.0.0.5, map: generic-registers}}
lifts: {main: {controller: plc, access: control, floors: {L1: 1, L2: 2}}}
cluster:
  machines: {north: {address: "http://192.0.2.11:5003"}, south: {address: "http://192.0.2.12:5003"}}
  machine: north
  etcd: ["http://127.0.0.1:2379"]
  packet_filter: socket
  fence: {plc: {command: [touch, closed]}}
"""


def load(folder: Path) -> LoadedSite:
    (folder / "site.yaml").write_text(FENCED, "utf-8")
    return load_site(folder / "site.yaml")


def test_a_machine_that_reaches_nothing_does_not_close_the_way_of_the_other_one() -> None:
    async def check(site: Site) -> None:
        folder = site.path.parent
        async with fenced(load(folder), site.term):
            with pytest.raises(ConnectFailed, match="lets nothing pass"):
                await site.term.prepare["plc"]()
            assert not (folder / "closed").exists()
            async with site.filter():
                await site.permission()
                while not (folder / "closed").exists():
                    with suppress(ConnectFailed):
                        await site.term.prepare["plc"]()
                    await asyncio.sleep(0)

    play(check)


def test_people_and_tools_on_a_machine_are_told_of_its_filter() -> None:
    with TemporaryDirectory() as folder:
        loaded = load(Path(folder))
        missing = "cluster: no packet filter listens at socket, so this machine does not command the lifts"
        assert any(missing in line for line in cautions(loaded))
        assert packet_filter_problem(loaded) == ""
        (Path(folder) / "socket").touch()
        assert not any(missing in line for line in cautions(loaded))
        assert "lets only a manager with a term reach the controllers; nothing was sent" in packet_filter_problem(
            loaded
        )
