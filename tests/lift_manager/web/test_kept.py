"""What was answered with yes is known after a crash: the answer waits for the disk, and not for long."""

import asyncio
from asyncio import Future

import httpx
import pytest

from lift_manager.core.memory import ShortMemory
from lift_manager.domain.service import Remembered
from lift_manager.domain.state import Holder
from lift_manager.web.app import make_app
from tests.lift_manager.core.ride_building import building
from tests.lift_manager.web.changes import CHANGES
from tests.lift_manager.web.fake import FakeManager
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.fake_sessions import a_session
from tests.support.virtual_time import elapse, run_virtual

SESSION = "/api/v1/lifts/lift/sessions"
WISH = {"lift": "lift", "from": "L1", "to": "L2", "robot": "amr-7"}
NEVER_WAIT = [
    *((path, body) for path, body in CHANGES.items() if "/rmf/" in path),
    ("/open-rmf/demo-lift/lift_request?lift_name=lift", {"floor": "L2", "door_state": 2}),
]
WORDS = [change for change in CHANGES.items() if change not in NEVER_WAIT]
every_word = pytest.mark.parametrize(("path", "body"), WORDS)


def client(app: object) -> httpx.AsyncClient:
    return httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1")  # type: ignore[arg-type]


def holding(disk_s: float) -> FakeManager:
    """A manager whose disk takes so long, with a ride and a session."""

    async def written(lift: str, within_s: float) -> bool:
        assert lift == "lift"
        await asyncio.sleep(min(disk_s, within_s))
        return disk_s <= within_s

    facade = FakeManager(written=written)
    facade.going_on(a_ride(Holder("ride", "amr-7")))
    facade.there(a_session(Holder("api", "amr-7")))
    return facade


@every_word
@pytest.mark.parametrize(("disk_s", "answered_s"), [(0.2, 0.2), (60.0, 0.5)], ids=["soon", "late"])
def test_a_word_is_taken_at_once_and_answered_when_it_is_written_or_after_half_a_second(
    path: str, body: object, disk_s: float, answered_s: float
) -> None:
    facade = holding(disk_s)

    async def main() -> None:
        async with client(make_app(facade)) as ask:
            began = asyncio.get_running_loop().time()
            asking = asyncio.ensure_future(ask.post(path, json=body) if body else ask.post(path))
            await elapse(0.1)
            assert facade.changes, "it was not taken before it was written"
            assert not asking.done()
            answer = await asking
            assert answer.is_success
            # said only where a crash would forget what was taken
            assert answer.json().get("recorded", True) is (disk_s == answered_s)
            assert asyncio.get_running_loop().time() - began == pytest.approx(answered_s, abs=0.01)

    run_virtual(main)


@pytest.mark.parametrize(("path", "body"), NEVER_WAIT)
def test_neither_the_workshop_nor_rmf_waits_for_the_disk(path: str, body: object) -> None:
    async def main() -> None:
        async with client(make_app(holding(60.0))) as ask:
            began = asyncio.get_running_loop().time()
            assert (await ask.post(path, json=body)).is_success
            assert asyncio.get_running_loop().time() == began

    run_virtual(main)


def test_a_lockout_an_acknowledgement_and_a_drain_are_known_after_a_crash_right_behind_their_answer() -> None:
    async def main() -> None:
        memory = SlowMemory()
        async with building("lift", memory=memory) as made, client(make_app(made.manager)) as ask:
            lift = "/api/v1/lifts/lift"
            await ask.post(f"{lift}/lockout", json={"by": "M. Weber", "reason": "new ropes"})
            after_lockout = memory.crashed()
            await ask.post(f"{lift}/drain", json={"by": "M. Weber", "reason": "new ropes"})
            after_drain = memory.crashed()
            await ask.post(f"{lift}/lockout/end", json={"by": "M. Weber"})
            after_end = memory.crashed()
        assert after_lockout.recall("lift").lockout is not None
        assert after_drain.recall("lift").drain is not None
        assert after_end.recall("lift").lockout is None

    run_virtual(main, limit_s=9000)


def test_what_is_answered_with_no_or_changes_nothing_waits_for_no_disk() -> None:
    async def main() -> None:
        async with client(make_app(holding(60.0))) as ask:
            began = asyncio.get_running_loop().time()
            assert (await ask.post("/api/v1/rides", json={**WISH, "lift": "cellar"})).status_code == 404
            assert (await ask.post("/api/v1/rides", json={**WISH, "dry_run": True})).status_code == 200
            assert (await ask.get("/api/v1/rides/r1")).status_code == 200
            assert asyncio.get_running_loop().time() == began

    run_virtual(main)


class SlowMemory(ShortMemory):
    """What is kept is on its disk a fifth of a second later."""

    def __init__(self) -> None:
        super().__init__()
        self.disk: dict[str, Remembered] = {}
        self._writes: dict[str, list[Future[None]]] = {}

    def keep(self, lift: str, remembered: Remembered) -> None:
        super().keep(lift, remembered)
        write = asyncio.get_running_loop().create_future()
        self._writes.setdefault(lift, []).append(write)

        def done() -> None:
            self.disk[lift] = remembered
            self._writes[lift].remove(write)
            write.set_result(None)

        asyncio.get_running_loop().call_later(0.2, done)

    def written(self, lift: str) -> Future[None] | None:
        waiting = self._writes.get(lift)
        return waiting[-1] if waiting else None

    def crashed(self) -> ShortMemory:
        """What is left of it at this moment."""
        left = ShortMemory()
        for lift, remembered in self.disk.items():
            left.keep(lift, remembered)
        return left


def test_a_ride_and_its_words_are_known_after_a_crash_right_behind_their_answer() -> None:
    async def main() -> None:
        memory, left = SlowMemory(), [ShortMemory()]
        async with building("lift", memory=memory) as made, client(make_app(made.manager)) as ask:
            answer = await ask.post("/api/v1/rides", json={**WISH, "to": "L3", "idempotency_key": "k1"})
            left.append(memory.crashed())
            ride = answer.json()["id"]
            assert (await ask.post(f"/api/v1/rides/{ride}/cancel")).json()["phase"] == "cancelled"
            left.append(memory.crashed())
            opened = await ask.post(SESSION, json={"robot": "amr-8"})
            left.append(memory.crashed())
            assert (answer.status_code, opened.status_code) == (201, 201)
        found = []
        for memory_left in left:
            async with building("lift", memory=memory_left) as made:
                known = made.manager.ride(ride)
                session = made.manager.session("lift", opened.json()["id"], Holder("api", "amr-8"))
                found.append(("" if known is None else known.phase.value, type(session).__name__))
        assert found[0] == ("", "Refused")
        assert found[1][0] not in {"", "cancelled"}
        assert found[2] == ("cancelled", "Refused")
        assert found[3] == ("cancelled", "SessionInfo")

    run_virtual(main, limit_s=9000)


def test_a_manager_says_whether_what_it_remembers_was_written_in_time() -> None:
    async def main() -> None:
        memory = SlowMemory()
        async with building("lift", memory=memory) as made:
            await elapse(1)
            assert await made.manager.kept("lift", 0.0)
            memory.keep("lift", Remembered())
            assert not await made.manager.kept("lift", 0.05)
            assert await made.manager.kept("lift", 0.5)
            assert memory.written("lift") is None

    run_virtual(main, limit_s=9000)
