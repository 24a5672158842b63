"""A whole manager whose term ends, at a simulated controller over real sockets: what it still writes, and what it leaves on."""

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path

import httpx
import pytest

from drivers.errors import ConnectFailed, ConnectProblem
from lift_manager import app
from lift_manager.cluster.member import ActiveTerm
from lift_manager.cluster.term import Key, Role, Term
from lift_manager.config.load import load_site
from lift_manager.lab.bench.bench import Bench
from lift_manager.lab.bench.plan import plan_lifts
from lift_manager.lab.bench.simulator import LiftSimulator
from lift_manager.lab.bench.site import site_file
from lift_manager.plain.rmf import Alarms
from lift_manager.rmf.lasting import LastingRmf
from lift_manager.rmf.messages import MODE_OFFLINE
from lift_manager.rmf.ros_settings import RosSettings
from lift_manager.runtime.recorder import MemoryRecorder
from lift_manager.web.server import listen
from tests.lift_manager.rmf.neighbours import FakeRmf
from tests.support.programs import HANGS_S

LIFT = {"name": "lift", "map": "generic-registers", "speed": 20.0, "clear_s": 10.0}
HOLD = "hold_door.front"


class Manager:
    """A running manager with a term, and the lift that it commands."""

    def __init__(
        self,
        lift: LiftSimulator,
        http: httpx.AsyncClient,
        term: ActiveTerm,
        recorder: MemoryRecorder,
        lasting_rmf: LastingRmf,
    ) -> None:
        self.lift, self.term = lift, term
        self.recorder = recorder
        self.lasting_rmf = lasting_rmf
        self.http = http
        self.running: asyncio.Task[bool] | None = None

    async def state(self) -> dict[str, object]:
        reply = await self.http.get("/open-rmf/demo-lift/lift_state", params={"lift_name": "lift"})
        return dict(reply.json())

    async def hold_door(self) -> None:
        """Call the lift, and return once its door is held."""
        body = {"floor": self.lift.floors[-1], "door_state": 2}
        params = {"lift_name": "lift"}
        is_taken = False
        while not is_taken:
            reply = (await self.http.post("/open-rmf/demo-lift/lift_request", params=params, json=body)).json()
            is_taken = reply["success"]
            assert is_taken or "is offline" in reply["msg"]  # a busy machine has not read its lift in time
        await self.lift.when(lambda truth: HOLD in truth.commands, within_s=HANGS_S)

    @property
    def rmf(self) -> FakeRmf:
        assert isinstance(self.lasting_rmf.joined, FakeRmf)
        return self.lasting_rmf.joined

    async def ended(self) -> bool:
        assert self.running is not None
        return await self.running

    def renew(self, remaining_s: float) -> None:
        self.term.renew(Term(role=Role.LEAVING, until=asyncio.get_running_loop().time() + remaining_s))


async def nothing() -> None:
    """There is nothing to be done before a connection."""


def play(
    folder: Path,
    check: Callable[[Manager], Awaitable[None]],
    lift_of: Mapping[str, object] = LIFT,
    prepare: Callable[[], Awaitable[None]] = nothing,
) -> None:
    async def run(lift: LiftSimulator) -> None:
        path = folder / "site.yaml"
        path.write_text(json.dumps(site_file(plan_lifts((lift_of,), folder), {"lift": lift.ports}, folder)), "utf-8")
        stop, ready, recorder = asyncio.Event(), asyncio.Event(), MemoryRecorder()
        rmf = LastingRmf(FakeRmf, Alarms(), asyncio.get_running_loop().time)
        faces = app.Faces(rmf=RosSettings(), lasting_rmf=rmf)
        term = ActiveTerm(Key(1, 7, "north"), asyncio.get_running_loop().time)
        loaded = load_site(path)
        term.prepare = dict.fromkeys(loaded.controllers, prepare)
        with listen("127.0.0.1", 0) as sock:
            address = f"http://127.0.0.1:{sock.getsockname()[1]}"
            async with asyncio.timeout(HANGS_S), httpx.AsyncClient(base_url=address, trust_env=False) as http:
                manager = Manager(lift, http, term, recorder, rmf)
                manager.renew(3600.0)
                running = app.run(loaded, sock, stop=stop, ready=ready.set, recorder=recorder, faces=faces, term=term)
                manager.running = asyncio.create_task(running)
                await ready.wait()
                try:
                    await check(manager)
                finally:
                    stop.set()
                    await asyncio.wait([manager.running])

    with Bench((lift_of,), near=folder, folder=folder) as bench:
        asyncio.run(run(bench.simulator()))


def test_a_term_that_nears_its_end_is_used_to_release_everything(tmp_path: Path) -> None:
    async def check(manager: Manager) -> None:
        await manager.hold_door()
        manager.renew(HANGS_S)
        manager.term.ends.set()
        manager.term.releases.set()
        assert await manager.ended()
        assert HOLD not in manager.lift.truth.commands
        assert manager.rmf.states[-1][1].current_mode == MODE_OFFLINE

    play(tmp_path, check)


@pytest.mark.parametrize("by", ["", "Eve"])
def test_after_its_term_a_manager_writes_and_publishes_nothing_and_leaves_everything_on(
    tmp_path: Path, by: str
) -> None:
    async def check(manager: Manager) -> None:
        await manager.hold_door()
        before, published = manager.lift.writes, len(manager.rmf.states)
        manager.term.handed_over_by = by
        manager.term.end()
        assert (await manager.state())["success"] is False
        assert await manager.ended() is bool(by)
        assert manager.lift.writes == before
        assert len(manager.rmf.states) == published > 0
        assert not manager.rmf.closed  # it is the connection of the next term, too
        handed_over = [row for row in manager.recorder.rows if "hands over" in row.text]
        assert [row.caller for row in handed_over] == ([by] if by else [])

    play(tmp_path, check)


def test_a_release_that_the_term_cuts_short_is_not_called_verified(tmp_path: Path) -> None:
    async def check(manager: Manager) -> None:
        await manager.hold_door()
        manager.lift.begin("ignored_writes")
        manager.renew(0.3)
        manager.term.ends.set()
        asyncio.get_running_loop().call_later(0.3, manager.term.end)
        assert not await manager.ended()

    play(tmp_path, check)


def test_the_journal_says_which_machine_commands_the_lifts_and_in_which_epoch(tmp_path: Path) -> None:
    async def check(manager: Manager) -> None:
        texts = [row.text for row in manager.recorder.rows]
        assert "the manager on north is active, in epoch 7" in texts

    play(tmp_path, check)


def test_a_controller_that_arbitrates_is_shown_the_epoch_of_the_term(tmp_path: Path) -> None:
    async def check(manager: Manager) -> None:
        await manager.hold_door()
        reply = await manager.http.get("/api/v1/lifts/lift/signals")
        shown = {signal["name"]: signal["raw"] for signal in reply.json()["signals"]}
        assert shown["epoch"] == 7

    play(tmp_path, check, {**LIFT, "map": "generic-registers-cluster"})


def test_until_its_fence_is_closed_a_lift_is_offline_and_says_why(tmp_path: Path) -> None:
    is_closed = asyncio.Event()

    async def close() -> None:
        if not is_closed.is_set():
            raise ConnectFailed("plc", ConnectProblem.OTHER, "its fence is not closed")

    async def check(manager: Manager) -> None:
        lift = (await manager.http.get("/api/v1/lifts/lift")).text
        assert '"quality":"offline"' in lift
        assert "its fence is not closed" in lift
        assert (await manager.http.get("/readyz")).json()["live"] == 0
        is_closed.set()
        while not (await manager.http.get("/readyz")).json()["live"]:
            pass
        await manager.hold_door()

    play(tmp_path, check, prepare=close)
