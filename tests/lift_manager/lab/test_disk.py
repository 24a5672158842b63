"""A simulated disk that is slow, full or hangs, and what the recorder on it says and keeps."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

import pytest

from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.disk import DiskFault, DiskJobs, DiskRecorder, Pace, SimulatedDisk
from lift_manager.lab.world.world import START_TIME
from lift_manager.lift.journal import Row, RowKind
from lift_manager.lift.record import DurableRecord
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.committer import ANSWER_S, LINGER_S

ROW = Row(RowKind.PRESS, "go_to L2 is to be pressed", "lift", data={"command": "go_to"})
REQUEST = Row(RowKind.REQUEST, "requests L2", "lift")
FIRE = SavedLift(DurableRecord(fire_since=START_TIME))
QUICK = Pace(0.01, 0.01)


@asynccontextmanager
async def running(recorder: DiskRecorder) -> AsyncIterator[list[str]]:
    """Let it write; gives what it tells about trouble."""
    told: list[str] = []
    task = asyncio.ensure_future(recorder.run(told.append))
    await elapse(0.1)
    try:
        yield told
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def on_disk(check: Callable[[SimulatedDisk], Awaitable[None]], pace: Pace | None = QUICK) -> SimulatedDisk:
    disk = SimulatedDisk(pace, seed=1)

    async def main() -> None:
        await check(disk)

    run_virtual(main)
    return disk


def test_a_commit_takes_the_same_time_however_many_there_were_before_it() -> None:
    took: list[float] = []

    async def one(disk: SimulatedDisk) -> None:
        await elapse(9.0 - asyncio.get_running_loop().time())
        await DiskJobs(disk).submit(lambda: None)
        took.append(asyncio.get_running_loop().time() - 9.0)

    async def many(disk: SimulatedDisk) -> None:
        for _ in range(3):
            await DiskJobs(disk).submit(lambda: None)
        await one(disk)

    slow = Pace(0.002, 2.0)
    on_disk(one, slow)
    on_disk(many, slow)
    assert took[0] == took[1]
    assert 0.002 <= took[0] <= 2.0


def test_a_press_waits_for_its_commit_and_no_longer() -> None:
    async def check(disk: SimulatedDisk) -> None:
        recorder = DiskRecorder(disk)
        async with running(recorder):
            answer = recorder.commit_now(ROW)
            await elapse(0.005)
            assert (answer.done(), disk.rows) == (False, [])
            await elapse(0.006)
            assert (answer.result(), disk.rows) == (None, [ROW])

    on_disk(check)


def test_a_press_shares_the_commit_of_the_request_that_led_to_it() -> None:
    commits: list[list[Row]] = []

    async def check(disk: SimulatedDisk) -> None:
        recorder = DiskRecorder(disk)
        async with running(recorder):
            disk.on_committed.append(lambda rows: commits.append(list(rows)))
            recorder.keep("lift", FIRE)
            recorder.note(REQUEST)
            await elapse(LINGER_S / 2)
            answer = recorder.commit_now(ROW)
            await elapse(0.011)
            assert answer.result() is None
            assert disk.store.records == {"lift": FIRE}

    on_disk(check)
    assert commits == [[REQUEST, ROW]]


def test_what_no_press_waits_for_is_committed_a_moment_later() -> None:
    async def check(disk: SimulatedDisk) -> None:
        recorder = DiskRecorder(disk)
        async with running(recorder):
            recorder.note(REQUEST)
            await elapse(LINGER_S + 0.011)
            assert disk.rows == [REQUEST]

    on_disk(check)


def test_a_full_disk_refuses_presses_with_its_reason_and_takes_the_rows_once_there_is_room() -> None:
    async def check(disk: SimulatedDisk) -> None:
        recorder = DiskRecorder(disk)
        async with running(recorder) as told:
            disk.begin(DiskFault.FULL)
            refused = recorder.commit_now(ROW)
            await elapse(0.1)
            assert "No space left on device" in (refused.result() or "")
            assert recorder.commit_now(ROW).result() == recorder.trouble == told[0]
            disk.end(DiskFault.FULL)
            await elapse(60)
            assert told[1:] == [""]
            assert (recorder.trouble, disk.rows[0]) == ("", ROW)

    on_disk(check)


def test_a_disk_that_hangs_is_trouble_after_a_bounded_time_and_commits_once_it_goes_on() -> None:
    async def check(disk: SimulatedDisk) -> None:
        recorder = DiskRecorder(disk)
        async with running(recorder) as told:
            disk.begin(DiskFault.HANGS)
            recorder.keep("lift", FIRE)
            answer = recorder.commit_now(ROW)
            await elapse(ANSWER_S - 0.01)
            assert (answer.done(), recorder.trouble) == (False, "")
            await elapse(0.1)
            assert "did not reach" in (answer.result() or "")
            assert "has not answered" in recorder.trouble
            assert len(told) == 1
            assert recorder.recall("lift") == FIRE
            assert disk.store.records == {}
            disk.end(DiskFault.HANGS)
            await elapse(60)
            assert (recorder.trouble, recorder.written("lift")) == ("", None)
            assert (disk.store.records, disk.rows[0]) == ({"lift": FIRE}, ROW)

    on_disk(check)


def test_what_a_killed_manager_had_not_committed_is_forgotten() -> None:
    async def check(disk: SimulatedDisk) -> None:
        recorder = DiskRecorder(disk)
        async with running(recorder):
            disk.begin(DiskFault.HANGS)
            recorder.keep("lift", FIRE)
            recorder.note(ROW)
            await elapse(1)
            recorder.drop()
        assert recorder.unwritten == {"lift": FIRE}
        recorder.keep("lift", FIRE)
        recorder.note(ROW)
        disk.end(DiskFault.HANGS)
        assert DiskRecorder(disk).recall("lift") is None

    assert on_disk(check).rows == []


def test_what_a_killed_manager_says_later_changes_nothing_on_an_instant_disk() -> None:
    async def check(disk: SimulatedDisk) -> None:
        recorder = DiskRecorder(disk)
        recorder.keep("lift", FIRE)
        assert recorder.commit_now(ROW).result() is None
        recorder.drop()
        recorder.keep("lift", SavedLift())
        recorder.note(ROW)

    disk = on_disk(check, pace=None)
    assert (disk.store.records, disk.rows) == ({"lift": FIRE}, [ROW])


def test_an_instant_disk_cannot_fail() -> None:
    with pytest.raises(ValueError, match="take no time"):
        SimulatedDisk().begin(DiskFault.FULL)
