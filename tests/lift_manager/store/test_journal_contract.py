"""What any journal of the manager does: in the process, on the disk, or on the disk of a simulated world."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path

import pytest

from lift_manager.lab.world.disk import DiskFault, DiskRecorder, Pace, SimulatedDisk
from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import MemoryRecorder, Recorder
from tests.lift_manager.store.journal_disk import Disk, journal, press, read_only, stored, writing, written
from tests.support.virtual_time import run_virtual

Main = Callable[[], Coroutine[None, None, None]]

HARD_TO_WRITE = [
    Row(RowKind.REQUEST, ""),
    Row(RowKind.PERSON, "Jürgen O'Neill: 'door \"front\"', 王\n\x00;--", "Güter / 2", "person:Jürgen"),
    Row(RowKind.LINK, "half of a pair: \ud800", data={"\udfff": "\ud800", "age_s": float("nan")}),
    Row(RowKind.ALARM, "nested", data={"b": [1, 2.5, None, True], "a": {"c": (), "b": -0.0}}),
]


@dataclass
class Kept:
    """A journal and a way to look into it: kind, text and data of each row."""

    journal: Recorder
    look: Callable[[], list[tuple[str, str, object]]]
    spoil: Callable[[], Recorder]
    run: Callable[[Main], None] = lambda main: asyncio.run(main())
    """On the clock that the journal lives on."""


@pytest.fixture(params=["short", "store", "simulated disk", "instant disk"])
def kept(request: pytest.FixtureRequest, tmp_path: Path) -> Kept:
    path = tmp_path / "site.db"
    if request.param == "store":
        return Kept(
            journal(path),
            lambda: [(row.kind, row.text, json.loads(row.data)) for row in stored(path)],
            lambda: journal(path, Disk(read_only)),
        )
    if request.param != "short":
        return on_simulated_disk(instant=request.param == "instant disk")
    short = MemoryRecorder()

    def spoil() -> MemoryRecorder:
        short.trouble = "full"
        return short

    return Kept(short, lambda: [(row.kind.value, row.text, row.data) for row in short.rows], spoil)


def on_simulated_disk(*, instant: bool) -> Kept:
    disk = SimulatedDisk(None if instant else Pace(0.005, 1.0), seed=1)
    full = SimulatedDisk(Pace(0.005, 1.0), seed=1)

    def spoil() -> DiskRecorder:
        full.begin(DiskFault.FULL)
        return DiskRecorder(full)

    def look() -> list[tuple[str, str, object]]:
        return [(row.kind.value, row.text, row.data) for row in (*disk.rows, *full.rows)]

    return Kept(DiskRecorder(disk), look, spoil, run_virtual)


def test_rows_are_kept_in_the_order_of_the_calls(kept: Kept) -> None:
    async def main() -> None:
        async with writing(kept.journal) as told:
            answers = []
            for number in range(40):
                kept.journal.note(Row(RowKind.WRITE, f"written {number}"))
                answers.append(kept.journal.commit_now(press(number)))
            assert set(await asyncio.gather(*answers)) == {None}
            kept.journal.note(Row(RowKind.OUTCOME, "confirmed"))
            await kept.journal.settled()
            assert kept.journal.trouble == ""
            assert told.empty()

    kept.run(main)
    rows = kept.look()
    assert [kind for kind, *_ in rows] == ["write", "press"] * 40 + ["outcome"]
    assert [data for kind, _, data in rows if kind == "press"] == [{"n": number} for number in range(40)]


def test_a_press_that_may_go_is_there_when_it_is_answered(kept: Kept) -> None:
    async def main() -> None:
        async with writing(kept.journal):
            for number in range(5):
                assert await kept.journal.commit_now(press(number)) is None
                assert kept.look()[-1] == ("press", press(number).text, {"n": number})

    kept.run(main)


def test_nothing_to_write_is_settled_at_once(kept: Kept) -> None:
    kept.run(lambda: written(kept.journal))
    assert kept.look() == []


def test_what_is_noted_before_it_runs_is_written_when_it_runs(kept: Kept) -> None:
    async def main() -> None:
        kept.journal.note(Row(RowKind.MANAGER, "started"))
        await written(kept.journal)
        assert [text for _, text, _ in kept.look()] == ["started"]

    kept.run(main)


@pytest.mark.parametrize("row", HARD_TO_WRITE)
def test_no_text_and_no_number_is_too_strange_to_be_noted(kept: Kept, row: Row) -> None:
    async def main() -> None:
        kept.journal.note(row)
        kept.journal.note(press(1))
        await written(kept.journal)

    kept.run(main)
    assert [kind for kind, *_ in kept.look()] == [row.kind.value, "press"]


def test_where_there_is_trouble_a_press_is_refused_at_once_with_its_words(kept: Kept) -> None:
    async def main() -> None:
        spoilt = kept.spoil()
        async with writing(spoilt) as told:
            if not spoilt.trouble:
                assert await told.get() == spoilt.trouble
            answer = spoilt.commit_now(press(1))
            assert answer.done()
            assert answer.result() == spoilt.trouble != ""

    kept.run(main)
    assert kept.look() == []


def test_an_answer_that_nobody_waits_for_any_more_disturbs_nothing(kept: Kept) -> None:
    async def main() -> None:
        async with writing(kept.journal):
            kept.journal.commit_now(press(1)).cancel()
            assert await kept.journal.commit_now(press(2)) is None

    kept.run(main)
    assert kept.look()[-1] == ("press", press(2).text, {"n": 2})
