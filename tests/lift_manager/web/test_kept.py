"""What was answered with yes is known after a crash: the answer waits for the disk, and not for long."""

import asyncio
from asyncio import Future

import httpx
import pytest

from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Ride
from lift_manager.runtime.recorder import MemoryRecorder, SavedLift
from lift_manager.web.app import make_app
from tests.lift_manager.runtime.ride_building import building
from tests.lift_manager.web.changes import CHANGES
from tests.lift_manager.web.fake import FakeSite
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.fake_sessions import a_session
from tests.support.refusals import reply
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual

SESSION = "/api/v1/lifts/lift/sessions"
WISH = {"lift": "lift", "from": "L1", "to": "L2", "robot": "amr-7"}
NEVER_WAIT = [
    *((path, body) for path, body in CHANGES.items() if "/rmf/" in path),
    ("/open-rmf/demo-lift/lift_request?lift_name=lift", {"floor": "L2", "door_state": 2}),
]
WORDS = [change for change in CHANGES.items() if change not in NEVER_WAIT]
every_word = each_row(("path", "body"), WORDS)


class LateRecorder(MemoryRecorder):
    """Everything that is kept is on the disk so many seconds later."""

    def __init__(self, disk_s: float) -> None:
        super().__init__()
        self._disk_s = disk_s

    def written(self, lift: str) -> Future[None] | None:
        assert lift == "lift"
        write = asyncio.get_running_loop().create_future()
        asyncio.get_running_loop().call_later(self._disk_s, write.set_result, None)
        return write


def client(app: object) -> httpx.AsyncClient:
    return httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1")  # type: ignore[arg-type]


def holding(disk_s: float) -> FakeSite:
    """A manager whose disk takes so long, with a ride and a session."""

    site = FakeSite(recorder=LateRecorder(disk_s))
    site.fake_rides.going_on(a_ride(Holder("ride", "amr-7")))
    site.there(a_session(Holder("api", "amr-7")))
    return site


@every_word
@each_row(("disk_s", "answered_s"), [(0.2, 0.2), (60.0, 0.5)])
def test_a_word_is_taken_at_once_and_answered_when_it_is_written_or_after_half_a_second(
    path: str, body: object, disk_s: float, answered_s: float
) -> None:
    site = holding(disk_s)

    async def main() -> None:
        async with client(make_app(site)) as ask:
            began = asyncio.get_running_loop().time()
            asking = asyncio.ensure_future(ask.post(path, json=body) if body else ask.post(path))
            await elapse(0.1)
            assert site.changes, "it was not taken before it was written"
            assert not asking.done()
            answer = await asking
            assert answer.is_success
            # said only where a crash would forget what was taken
            assert answer.json().get("recorded", True) is (disk_s == answered_s)
            assert asyncio.get_running_loop().time() - began == pytest.approx(answered_s, abs=0.01)

    run_virtual(main)


@each_row(("path", "body"), NEVER_WAIT)
def test_neither_the_workshop_nor_rmf_waits_for_the_disk(path: str, body: object) -> None:
    async def main() -> None:
        async with client(make_app(holding(60.0))) as ask:
            began = asyncio.get_running_loop().time()
            assert (await ask.post(path, json=body)).is_success
            assert asyncio.get_running_loop().time() == began

    run_virtual(main)


def test_a_lockout_an_acknowledgement_and_a_drain_are_known_after_a_crash_right_behind_their_answer() -> None:
    async def main() -> None:
        recorder = SlowRecorder()
        async with building("lift", recorder=recorder) as made, client(make_app(made.site)) as ask:
            lift = "/api/v1/lifts/lift"
            await ask.post(f"{lift}/lockout", json={"by": "M. Weber", "reason": "new ropes"})
            after_lockout = recorder.crashed()
            await ask.post(f"{lift}/drain", json={"by": "M. Weber", "reason": "new ropes"})
            after_drain = recorder.crashed()
            await ask.post(f"{lift}/lockout/end", json={"by": "M. Weber"})
            after_end = recorder.crashed()
        assert restrictions(after_lockout) == {RestrictionKind.LOCKOUT}
        assert restrictions(after_drain) == {RestrictionKind.LOCKOUT, RestrictionKind.DRAIN}
        assert restrictions(after_end) == {RestrictionKind.DRAIN}

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


class SlowRecorder(MemoryRecorder):
    """What is kept is on its disk a fifth of a second later."""

    def __init__(self) -> None:
        super().__init__()
        self.disk: dict[str, SavedLift] = {}
        self._writes: dict[str, list[Future[None]]] = {}

    def keep(self, lift: str, saved: SavedLift) -> None:
        super().keep(lift, saved)
        write: Future[None] = asyncio.get_running_loop().create_future()
        self._writes.setdefault(lift, []).append(write)

        def done() -> None:
            self.disk[lift] = saved
            self._writes[lift].remove(write)
            write.set_result(None)

        asyncio.get_running_loop().call_later(0.2, done)

    def written(self, lift: str) -> Future[None] | None:
        waiting = self._writes.get(lift)
        return waiting[-1] if waiting else None

    def crashed(self) -> MemoryRecorder:
        """What is left of it at this moment."""
        return MemoryRecorder(self.disk)


def restrictions(left: MemoryRecorder) -> set[RestrictionKind]:
    saved = left.recall("lift")
    assert saved is not None
    return {restriction.kind for restriction in saved.record.restrictions}


def test_a_ride_and_its_words_are_known_after_a_crash_right_behind_their_answer() -> None:
    async def main() -> None:
        recorder, left = SlowRecorder(), [MemoryRecorder()]
        async with building("lift", recorder=recorder) as made, client(make_app(made.site)) as ask:
            answer = await ask.post("/api/v1/rides", json={**WISH, "to": "L3", "idempotency_key": "k1"})
            left.append(recorder.crashed())
            ride = answer.json()["id"]
            assert (await ask.post(f"/api/v1/rides/{ride}/cancel")).json()["phase"] == "cancelled"
            left.append(recorder.crashed())
            opened = await ask.post(SESSION, json={"robot": "amr-8"})
            left.append(recorder.crashed())
            assert (answer.status_code, opened.status_code) == (201, 201)
        found = []
        for recorder_left in left:
            async with building("lift", recorder=recorder_left) as made:
                known = reply(lambda: made.site.rides.ride(ride))
                session = reply(lambda: made.site.session("lift", opened.json()["id"], Holder("api", "amr-8")))
                phase = known.phase.value if isinstance(known, Ride) else known.code
                found.append((phase, type(session).__name__))
        assert found[0] == ("unknown_ride", "NotFound")
        assert found[1][0] not in {"unknown_ride", "cancelled"}
        assert found[2] == ("cancelled", "NotFound")
        assert found[3] == ("cancelled", "SessionInfo")

    run_virtual(main, limit_s=9000)


def test_a_manager_says_whether_what_it_remembers_was_written_in_time() -> None:
    async def main() -> None:
        recorder = SlowRecorder()
        async with building("lift", recorder=recorder) as made:
            await elapse(1)
            assert await made.site.recorded("lift", 0.0)
            recorder.keep("lift", SavedLift())
            assert not await made.site.recorded("lift", 0.05)
            assert await made.site.recorded("lift", 0.5)
            assert recorder.written("lift") is None

    run_virtual(main, limit_s=9000)
