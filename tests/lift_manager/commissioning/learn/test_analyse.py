"""What makes an analysis less sure: wrong marks, rivals, marks that are missing; and what else it says."""

from dataclasses import replace
from pathlib import Path

from lift_manager.commissioning.learn.analyse import analyse
from lift_manager.commissioning.learn.draft import draft, report
from lift_manager.commissioning.learn.samples import BlockReads, Mark, MarkKind, Recording
from lift_manager.commissioning.learn.survey import Span
from lift_manager.commissioning.learn.tracks import Confidence, moments, tracks
from register_maps.words import Table
from tests.lift_manager.commissioning.learn.compared import confident, loaded_draft
from tests.lift_manager.commissioning.learn.riding import ridden
from tests.support.shipped_maps import compiled

LINES = [(1, "L1"), (5, "-"), (8, ""), (12, "/"), (14, "L2"), (18, "-"), (21, ""), (28, "L3"), (33, ""), (40, "L1")]


def marked(lines: list[tuple[int, str]] = LINES, floors: tuple[str, ...] = ("L1", "L2", "L3")) -> Recording:
    kinds = {"": MarkKind.MOVING, "-": MarkKind.CLOSED, "/": MarkKind.DOOR}
    marks = [Mark(at_s, kinds.get(line, MarkKind.OPEN), "" if line in kinds else line) for at_s, line in lines]
    return Recording(1, "memory", 1, "2026-11-23", (Span(Table.HOLDING, 0, 3),), 125, 2000, [], marks, floors)


def test_a_mark_belongs_to_the_stop_before_it_and_after_a_move_to_the_next() -> None:
    seen = moments(marked())
    assert [(moment.floor, moment.direction) for moment in seen] == [
        ("L1", 0), ("L1", 0), ("", 1), ("L2", 0), ("L2", 0), ("L2", 0), ("", 1), ("L3", 0), ("", -1), ("L1", 0),
    ]  # fmt: skip


def test_without_the_order_of_the_floors_no_direction_is_known() -> None:
    assert {moment.direction for moment in moments(marked(floors=()))} == {0}


def test_a_mark_that_came_too_late_is_named_and_makes_the_result_likely(tmp_path: Path) -> None:
    recording = ridden(compiled("generic-registers")).recording
    wrong = next(index for index, mark in enumerate(recording.marks) if mark.kind is MarkKind.MOVING and index > 8)
    recording.marks[wrong] = replace(recording.marks[wrong], kind=MarkKind.CLOSED)
    found = analyse(recording)
    moved = found.of("motion")
    assert moved is not None
    assert moved.confidence is Confidence.LIKELY
    at_s = int(recording.marks[wrong].at_s)
    assert any(f"{at_s // 60:02}:{at_s % 60:02}" in reason for reason in moved.reasons)
    assert loaded_draft(found, recording, tmp_path).map.signals["motion"].at == "holding:2"


def test_a_second_point_that_fits_and_differs_at_times_is_named_and_makes_the_result_likely() -> None:
    recording = ridden(compiled("seer-siemens-chengdu")).recording
    (block,) = [block for block in recording.blocks if block.table is Table.DISCRETE]
    door = [(at_s, values[2]) for at_s, values in block.each_read()]
    early = BlockReads(Table.DISCRETE, 50, 1)
    for number, (at_s, value) in enumerate(door):
        # goes off a second before the door begins to close: a lamp that says "please enter"
        early.reads.append((at_s, (int(value and all(later for _, later in door[number : number + 6])),)))
    recording.blocks.append(early)
    found = analyse(recording).of("door.front")
    assert found is not None
    assert found.confidence is Confidence.LIKELY
    assert any("fit as well, and behave differently" in reason for reason in found.reasons)


def test_a_mirror_of_a_point_does_not_make_it_less_sure_and_is_named() -> None:
    found = analyse(ridden(compiled("wago-750")).recording)
    assert confident(found) == {"car_floor": Confidence.SURE, "door.front": Confidence.SURE}
    assert any(line.startswith("coil:2 ") and "it goes with discrete:2" in line for line in found.unexplained)


def test_floors_passed_without_a_stop_are_named() -> None:
    found = analyse(ridden(compiled("generic-registers"), plan=["L1", "L2", "L4", "L2", "L1", "L4"]).recording)
    assert any("3 seen in passing" in caution for caution in found.cautions)
    assert dict(found.codes) == {"L1": 1, "L2": 2, "L4": 4}


def test_a_closed_door_need_not_be_marked_at_every_floor() -> None:
    recording = ridden(compiled("robotnik-il-eth")).recording
    at_floor = [(mark, moment.floor) for mark, moment in zip(recording.marks, moments(recording), strict=True)]
    recording.marks = [mark for mark, floor in at_floor if not (mark.kind is MarkKind.CLOSED and floor == "L2")]
    found = analyse(recording).of("car_floor")
    assert found is not None
    assert found.confidence is Confidence.SURE
    assert found.spec == {"one_of": ["holding:0.0", "holding:0.1", "holding:0.2"]}


def test_a_floor_that_shows_the_next_stop_under_way_counts_only_while_the_car_stands(tmp_path: Path) -> None:
    recording = ridden(compiled("generic-registers")).recording
    for block in recording.blocks:
        if block.start == 0:
            # what `destination` shows, if anything, and then nothing there
            block.reads = [
                (at_s, (values[0], values[6] or values[1], *values[2:6], 0, 0)) for at_s, values in block.each_read()
            ]
    found = analyse(recording)
    floor = found.of("car_floor")
    assert floor is not None
    assert (floor.confidence, floor.spec["known_while"]) == (Confidence.LIKELY, "stopped")
    assert loaded_draft(found, recording, tmp_path).map.signals["car_floor"].at == "holding:1"


def test_a_recording_without_marks_gives_a_draft_without_signals(tmp_path: Path) -> None:
    recording = ridden(compiled("two-stop-agv"), plan=["L1", "L2"]).recording
    recording.marks = []
    found = analyse(recording)
    assert confident(found) == {}
    assert "no floor was named, so nothing can be told apart" in found.cautions
    assert loaded_draft(found, recording, tmp_path).map.signals == {}


def test_nothing_at_all_is_survived() -> None:
    recording = marked([])
    assert tracks(recording.blocks).registers == ()
    assert analyse(recording).proposals == ()


def test_the_draft_says_that_it_is_one_what_is_not_known_and_how_sure_each_signal_is() -> None:
    recording = ridden(compiled("seer-siemens-chengdu"), marks="-").recording
    found = analyse(recording)
    text = draft(found, recording, name="east")
    lines = text.splitlines()
    assert lines[1].startswith("# DRAFT")
    assert "# - whether the door is open: not sure" in lines
    assert any("commands: nothing was written" in line for line in lines)
    assert "  trust: template" in lines
    assert "  # sure: input:1: a number: L1 is 1, L2 is 2, L3 is 3, L4 is 4" in lines
    assert (
        "  # door.front: {at: 'discrete:3', values: {0: closed, 1: moving}}" in lines
    )  # not sure, so it stands in a comment
    assert "#   floors: {L1: 1, L2: 2, L3: 3, L4: 4}" in lines
    assert max(map(len, lines)) <= 120


def test_the_report_begins_with_what_is_sure_and_ends_with_what_to_do() -> None:
    found = analyse(ridden(compiled("seer-siemens-chengdu"), marks="-").recording)
    lines = list(report(found, for_file="east.yaml"))
    assert lines[0].startswith("sure: car_floor")
    assert any(line.startswith("not sure: door.front") for line in lines)
    assert "missing: whether the door is open: not sure" in lines
    assert any("lift-manager maps check ./east.yaml" in line for line in lines)
