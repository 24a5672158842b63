"""Recordings of one tree are the same, a change is found where it shows, and what means nothing is no difference."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from register_maps.load import shipped
from tests.campaigns import mutants
from tests.campaigns.comparing import Accepted, Difference, Kind, accepted, differences
from tests.campaigns.record import ACCEPTED, compare, names_of, record_to, recorded, report, schedule_of
from tests.campaigns.recordings import Folder, Json, Recording, RecordingError, hashes_of
from tests.campaigns.schedules import DiskFails, draw
from tests.campaigns.truth import maps
from tests.campaigns.visits import visits

QUICKLY = ("--processes", "1", "--no-more-maps")
SEED = next(
    seed
    for seed in range(2, 99)
    if {"session", "ride"} <= {visit.by for visit in visits(seed) if visit.at < 4}
    and any(isinstance(event, DiskFails) for event in draw(seed, maps()).events)
)
"""A minute with a session, a ride and a disk that fails."""
VISITED = f"visit-{SEED:05d}"


def state(floor: str, door: str = "closed", reason: str = "") -> Json:
    return {"floor": floor, "robot_door": door, "reason": reason}


def write(value: int, address: int = 16) -> Json:
    return {"unit": 1, "function": 6, "address": address, "values": [value], "answer": "ok", "after_s": 0.004}


def read(address: int = 0) -> Json:
    return {"unit": 1, "function": 3, "address": address, "count": 2, "answer": [0, 0], "after_s": 0.004}


RIDE: Recording = {
    "states": [[0.0, state("L1")], [5.0, state("L2")], [6.0, state("L2", "open")], [20.0, state("L2")]],
    "journal": [[4.0, {"kind": "press", "text": "go_to L2 is to be pressed", "data": {"floor": "L2", "times": 3}}]],
    "wire.plc": [[4.0, write(2)], [4.2, read()], [4.4, write(0)], [9.0, write(1, 18)], [9.5, write(1, 18)]],
}


def changed(channel: str, *entries: list[Json]) -> list[Difference]:
    """Compare the ride with one in which a channel has these entries."""
    return differences("ride", RIDE, RIDE | {channel: list(entries)})


def kinds(found: list[Difference]) -> list[tuple[str, Kind, tuple[str, ...]]]:
    return [one.sort for one in found]


def test_recordings_cover_every_map() -> None:
    assert {schedule_of(name).map for name in names_of(1, 200, 0)} == set(shipped())
    assert len(names_of(1, 200, 60)) >= 260


@pytest.fixture(scope="module")
def visited() -> Recording:
    return recorded(VISITED)


def test_a_minute_is_recorded_the_same_twice(visited: Recording) -> None:
    assert hashes_of(recorded(VISITED)) == hashes_of(visited)
    assert all(visited[channel] for channel in ("inputs", "replies", "states", "workshop", "journal", "wire.plc"))


def test_recordings_do_not_have_the_names_of_classes_or_the_ids_of_one_process(visited: Recording) -> None:
    text = str(visited)
    assert "id-1" in text
    for word in ("lift_manager", "runtime", "object at", "Request(", "Holder(", "<"):
        assert word not in text.replace("<=", ""), word


def test_a_change_of_the_program_is_found_in_the_channels_where_it_shows(tmp_path: Path) -> None:
    before, now, copy = Folder(tmp_path / "before"), tmp_path / "now", tmp_path / "copy"
    record_to(before, ["minute-00001"], processes=1)
    word, press = (
        next(one for one in mutants.MUTANTS if one.rule == rule)
        for rule in ("workshop's door word", "rule of one press for a call")
    )
    mutants.changed_copy(replace(word, edits=(*word.edits, *press.edits)), copy)
    subprocess.run(
        [sys.executable, "-m", "tests.campaigns.record", "--out", now, "--seeds", "1", "--visits", "0", *QUICKLY],
        cwd=copy,
        env=os.environ | {"PYTHONPATH": str(copy), "PYTHONHASHSEED": "0"},
        check=True,
        capture_output=True,
    )
    found = compare(before, Folder(now), [])
    channels = {one.channel.partition(".")[0] for one in found.differing["minute-00001"]}
    assert {"workshop", "writes", "journal"} <= channels
    assert "inputs" not in channels
    assert any("1 recordings, 1 differ" in line for line in report(found))


def test_a_recording_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    folder.write("ride", RIDE)
    folder.seal({"ride": hashes_of(RIDE)})
    assert (folder.read("ride"), folder.hashes()) == (RIDE, {"ride": hashes_of(RIDE)})
    with pytest.raises(RecordingError, match="no complete recordings"):
        Folder(tmp_path / "nowhere").hashes()


def test_texts_repetitions_reads_and_parts_of_a_second_are_no_difference() -> None:
    assert changed("states", *([at + 0.3, entry] for at, entry in RIDE["states"])) == []
    row = {"kind": "press", "text": "Press go_to L2", "data": {"floor": "L2", "times": 5}}
    assert changed("journal", [4.0, row]) == []
    assert changed("wire.plc", *RIDE["wire.plc"], [9.7, read()], [10.0, write(1, 18)]) == []


def test_texts_are_compared_where_that_is_wanted_but_for_the_times_in_them() -> None:
    def said(text: str) -> Recording:
        return {"journal": [[1.0, {"kind": "alarm", "text": text}]]}

    before = said("silent for 3.2 s since 2026-01-05 12:00")
    assert differences("x", before, said("silent for 4 s since 2026-01-05T12:01:07+00:00"), texts=True) == []
    assert kinds(differences("x", before, said("mute"), texts=True)) == [("journal", Kind.CHANGED, ("text",))]


def test_a_field_that_changed_is_named_and_shown_with_what_came_before_it() -> None:
    states = [list(entry) for entry in RIDE["states"]]
    states[2] = [6.0, state("L3", "open")]
    (found,) = changed("states", *states)
    assert found.sort == ("states", Kind.CHANGED, ("floor",))
    text = "\n".join(found.lines)
    assert "floor: L2" in text
    assert "+    6.000 floor: L3" in text
    assert "5.000 floor=L2" in text


def test_an_entry_that_is_missing_later_or_new_is_a_difference() -> None:
    states = RIDE["states"]
    assert kinds(changed("states", *states[:3])) == [("states", Kind.MISSING, ())]
    assert kinds(changed("states", *states[:3], [21.0, states[3][1]])) == [("states", Kind.TIME, ())]
    assert kinds(changed("journal", *RIDE["journal"], [9.0, {"kind": "alarm", "text": ""}])) == [
        ("journal", Kind.EXTRA, ("alarm",))
    ]


def test_a_press_that_is_repeated_is_a_difference_though_a_refresh_is_none() -> None:
    pressed, *rest = RIDE["wire.plc"]
    found = changed("wire.plc", pressed, [4.1, write(2)], *rest)
    assert kinds(found) == [("writes", Kind.COUNT, ("function 6 at 16",))]


def test_a_block_that_is_read_twice_as_often_is_a_difference() -> None:
    many = [[number / 5, read()] for number in range(100)]
    before = RIDE | {"wire.plc": many}
    now = RIDE | {"wire.plc": [[number / 10, read()] for number in range(200)]}
    assert kinds(differences("x", before, now)) == [("reads", Kind.COUNT, ("function 3 at 0",))]


def test_a_state_of_a_moment_and_entries_that_change_places_are_told_as_such() -> None:
    states = RIDE["states"]
    blip = [*states[:2], [5.2, state("L3")], [5.4, state("L2")], *states[2:]]
    assert {one.kind for one in changed("states", *blip)} == {Kind.SHORT}
    rows = [[1.0, {"kind": "mode"}], [1.1, {"kind": "link"}]]
    before, now = {"journal": rows}, {"journal": [[1.0, rows[1][1]], [1.1, rows[0][1]]]}
    assert {one.kind for one in differences("x", before, now)} == {Kind.ORDER}


def test_an_accepted_difference_is_put_aside_with_its_reason_and_one_that_is_not_seen_is_told(tmp_path: Path) -> None:
    now: Recording = RIDE | {"journal": [*RIDE["journal"], [9.0, {"kind": "alarm", "text": "", "lift": "lift"}]]}
    folders = Folder(tmp_path / "before"), Folder(tmp_path / "now")
    for folder, recording in zip(folders, (RIDE, now), strict=True):
        folder.write("ride", recording)
        folder.seal({"ride": hashes_of(recording)})
    alarm = Accepted("rows of alarms are new", channel="journal", kind="extra", entry={"kind": "alarm"})
    other = Accepted("never", recording="visit-*")
    assert compare(*folders, []).failed
    found = compare(*folders, [alarm, other])
    assert not found.failed
    assert list(report(found))[-2:] == [
        "accepted 1 times: rows of alarms are new",
        "accepted and NOT SEEN, take it out: never",
    ]
    assert compare(*folders, [replace(alarm, seen=0, entry={"kind": "mode"})]).failed


def test_every_accepted_difference_has_its_reason(tmp_path: Path) -> None:
    assert all(one.reason for one in accepted(ACCEPTED))
    file = tmp_path / "accepted.yaml"
    file.write_text("- {channel: journal, reason: ''}", "utf-8")
    with pytest.raises(RecordingError, match="needs its reason"):
        accepted(file)
    file.write_text("- {chanel: journal, reason: x}", "utf-8")
    with pytest.raises(RecordingError, match="chanel"):
        accepted(file)
