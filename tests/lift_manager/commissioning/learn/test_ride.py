"""Recording a ride: what the person types, what is answered, what is stored, and what ends it."""

import asyncio
from collections.abc import Sequence
from pathlib import Path

import pytest

from drivers.errors import ConnectFailed, ConnectProblem
from drivers.modbus.memory import MemoryDevice, silence
from lift_manager.commissioning.learn import samples
from lift_manager.commissioning.learn.ride import missing_marks, record
from lift_manager.commissioning.learn.samples import (
    MarkKind,
    Recording,
    SamplesUnusable,
    guess_order,
    load_samples,
    to_json,
)
from lift_manager.commissioning.learn.survey import Span, Survey
from lift_manager.commissioning.prober import Prober
from register_maps.words import Table
from tests.lift_manager.commissioning.learn.riding import ridden
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import run_virtual

SURVEY = Survey((Span(Table.HOLDING, 0, 3), Span(Table.HOLDING, 10, 10)), 2, 2000, ())


def recorded(lines: Sequence[str], device: MemoryDevice | None = None) -> tuple[Recording, list[str], MemoryDevice]:
    """Record while these lines come, one a second."""
    device = device or MemoryDevice()
    said: list[str] = []
    waiting = list(lines)

    async def next_line() -> str | None:
        await asyncio.sleep(1)
        assert device is not None
        device.values[Table.HOLDING][1] = len(waiting)
        return waiting.pop(0) if waiting else None

    async def main() -> Recording:
        recording = samples.begin(SURVEY, peer="memory", unit=1, began="2026-11-23T20:00:00")
        prober = Prober(device.wire())
        await record(prober, recording, next_line, said.append)
        prober.close()
        return recording

    return run_virtual(main), said, device


def test_lines_become_marks_with_their_time() -> None:
    recording, said, _ = recorded(["L1", "-", "", "/", "  Ground   floor ", "done", "never read"])
    assert [(mark.kind, mark.floor) for mark in recording.marks] == [
        (MarkKind.OPEN, "L1"),
        (MarkKind.CLOSED, ""),
        (MarkKind.MOVING, ""),
        (MarkKind.DOOR, ""),
        (MarkKind.OPEN, "Ground floor"),
    ]
    assert [mark.at_s for mark in recording.marks] == pytest.approx([1, 2, 3, 4, 5])
    assert recording.named_floors == ("L1", "Ground floor")
    assert said[0] == "floor name at this stop? ENTER while moving"
    assert "00:01 at L1, door open" in said[1]
    assert "still wanted: a second floor" in said[1]


def test_a_mistyped_line_is_taken_back_and_help_is_shown() -> None:
    recording, said, _ = recorded(["L1", "undo", "undo", "?", "x" * 65])
    assert recording.marks == []
    assert "taken back: at L1, door open" in said
    assert "there is nothing to take back" in said
    assert any("FULLY open" in line for line in said)
    assert any("at most 64" in line for line in said)


def test_everything_is_read_in_requests_of_the_size_that_is_answered_and_nothing_is_written() -> None:
    recording, _, device = recorded(["L1", "done"])
    assert {(one.request.address, one.request.count) for one in device.received} == {(0, 2), (2, 2), (10, 1)}
    assert device.writes == []
    assert [(block.start, block.count) for block in recording.blocks] == [(0, 2), (2, 2), (10, 1)]


def test_a_value_is_stored_when_it_changes_and_the_time_of_every_read() -> None:
    recording, _, _ = recorded(["L1", "L2", "done"])
    reads = recording.blocks[0].reads
    assert [values for _, values in reads if values is not None] == [(0, 0), (0, 3), (0, 2), (0, 1)]
    assert len(reads) > 10
    assert [at_s for at_s, _ in reads] == sorted(at_s for at_s, _ in reads)


def test_a_read_without_an_answer_is_counted_and_the_ride_goes_on() -> None:
    device = MemoryDevice()
    device.fail_next(silence(), times=1)
    recording, said, _ = recorded(["L1", "L2", "L3", "done"], device)
    assert len(recording.marks) == 3
    assert any("1 reads failed" in line for line in said)


def test_a_controller_that_is_gone_ends_the_ride() -> None:
    device = MemoryDevice()

    async def next_line() -> str | None:
        await asyncio.sleep(2)
        device.connect_problem = ConnectProblem.REFUSED
        device.disconnect()
        await asyncio.sleep(600)
        return None

    async def main() -> None:
        recording = samples.begin(SURVEY, peer="memory", unit=1, began="")
        with pytest.raises(ConnectFailed):
            await record(Prober(device.wire()), recording, next_line, lambda _: None)
        assert len(recording.blocks[0].reads) > 5

    run_virtual(main)


def test_what_a_ride_lacks_is_asked_for_until_nothing_is() -> None:
    whole = ridden(compiled("generic-registers")).recording
    assert missing_marks(whole) == []
    whole.marks = [mark for mark in whole.marks if mark.kind is not MarkKind.DOOR]
    assert missing_marks(whole) == ["`/` while the door moves, twice"]


def test_a_recording_is_the_same_after_it_was_saved_and_loaded(tmp_path: Path) -> None:
    recording = ridden(compiled("two-stop-agv")).recording
    path = tmp_path / "ride.json"
    path.write_bytes(to_json(recording))
    assert load_samples(path) == recording


@each_row(
    ("content", "says"),
    [
        ("", "is no recording"),
        ("{}", "is no recording"),
        ('{"schema": 2}', "schema"),
    ],
)
def test_a_file_that_is_no_recording_is_refused(
    content: str, says: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("bad") / "ride.json"
    path.write_text(content)
    with pytest.raises(SamplesUnusable, match=says):
        load_samples(path)


def test_a_recording_with_too_few_values_is_refused(tmp_path: Path) -> None:
    recording, _, _ = recorded(["L1", "done"])
    recording.blocks[0].reads[0] = (0.1, (1,))
    (tmp_path / "ride.json").write_bytes(to_json(recording))
    with pytest.raises(SamplesUnusable, match="damaged"):
        load_samples(tmp_path / "ride.json")
    with pytest.raises(SamplesUnusable, match="cannot be read"):
        load_samples(tmp_path / "none.json")


@each_row(
    ("named", "order"),
    [
        (["2", "G", "B1", "1", "B2"], ("B2", "B1", "G", "1", "2")),
        (["L10", "L9", "L1"], ("L1", "L9", "L10")),
        (["-1", "0", "1"], ("-1", "0", "1")),
        (["lobby", "2OG", "1"], ("lobby", "2OG", "1")),
        (["UG1", "EG", "OG1"], ("UG1", "EG", "OG1")),
    ],
)
def test_the_order_of_floors_is_guessed_from_usual_names(named: list[str], order: tuple[str, ...]) -> None:
    assert guess_order(named) == order
