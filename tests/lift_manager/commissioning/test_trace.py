"""A trace: what is recorded of the events of a link, the file that it becomes, and what is shown of it."""

import json
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lift_manager.api.events import Frame, Lost
from lift_manager.client.stream import Connected, Disconnected, StreamEvent
from lift_manager.commissioning.trace.exchanges import Exchange, exchanges
from lift_manager.commissioning.trace.names import Names, lifts_of_map, lifts_of_site
from lift_manager.commissioning.trace.record import Recorder
from lift_manager.commissioning.trace.recording import (
    Gap,
    Header,
    Item,
    Recording,
    RecordingUnusable,
    TracedFrame,
    header_line,
    item_line,
    read_recording,
)
from lift_manager.commissioning.trace.show import Filter, lines, summary
from lift_manager.config.load import load_site
from register_maps import frames
from register_maps.frames import Request
from register_maps.load import load
from register_maps.words import Table
from tests.support.rows import each_row

BEGAN = datetime(2026, 11, 23, 12, tzinfo=UTC)
HEADER = Header("plc", BEGAN, "lift-manager 1")
POLL = frames.read(Table.HOLDING, 0, 8)
AT_L1 = (7, 1, 1, 1, 1, 0b101, 0, 0)
"""generic-registers: car at 1, stopped, door closed, normal, no fire, level."""
OPEN_AT_L1 = (8, 1, 1, 3, 1, 0b101, 0, 0)
CALL = frames.write_register(16, 2)


def payload(request: Request, values: Iterable[int]) -> bytes:
    return b"".join(value.to_bytes(2, "big") for value in values) if not request.is_write else b""


def exchange(at_s: float, tid: int, request: Request, values: Iterable[int] = ()) -> tuple[TracedFrame, TracedFrame]:
    answer = frames.answer(request, tid, payload(request, values))
    return TracedFrame(at_s, True, frames.frame(request, tid)), TracedFrame(at_s + 0.004, False, answer)


def event(item: TracedFrame, manager_s: float = 1000.0) -> Frame:
    text = frames.describe(item.frame) if item.is_request else frames.describe_answer(item.frame)
    return Frame(link="plc", sent=item.is_request, hex=item.frame.hex(" "), text=text, at_s=manager_s + item.at_s)


def recorded(events: Iterable[StreamEvent], *, late_s: float = 0.0) -> tuple[Recorder, list[Item]]:
    """What a recorder makes of events that all arrive `late_s` after its beginning."""
    items: list[Item] = []
    recorder = Recorder(HEADER, items.append, now=lambda: BEGAN + timedelta(seconds=late_s))
    for one in events:
        recorder.take(one)
    recorder.end()
    return recorder, items


def shown(items: Iterable[Item], shown: Filter | None = None, *, named: bool = True) -> list[str]:
    """The lines without their times."""
    lifts = lifts_of_map(load("generic-registers").map, {"L1": 1, "L2": 2}) if named else ()
    found = lines(Recording(HEADER, tuple(items)), Names(lifts), shown or Filter())
    return [line[13:].strip() for line in found]


TWO_POLLS_AND_A_CALL = (*exchange(0, 1, POLL, AT_L1), *exchange(0.2, 2, CALL), *exchange(0.4, 3, POLL, OPEN_AT_L1))


# -- recording


def test_times_are_those_of_the_managers_clock_however_late_an_event_arrives() -> None:
    _, items = recorded([Connected(), *map(event, TWO_POLLS_AND_A_CALL)], late_s=3.0)
    assert [round(item.at_s, 6) for item in items] == [3.0, 3.004, 3.2, 3.204, 3.4, 3.404]


def test_where_the_beginning_is_known_what_was_sent_before_anybody_listened_keeps_its_time() -> None:
    items: list[Item] = []
    recorder = Recorder(HEADER, items.append, began_at_s=1000.0, now=lambda: BEGAN + timedelta(seconds=3.0))
    for one in map(event, TWO_POLLS_AND_A_CALL):
        recorder.take(one)
    assert [round(item.at_s, 6) for item in items] == [0.0, 0.004, 0.2, 0.204, 0.4, 0.404]


def test_an_answer_says_where_its_values_are_from() -> None:
    _, items = recorded(map(event, TWO_POLLS_AND_A_CALL))
    texts = [item.text for item in items if isinstance(item, TracedFrame)]
    assert texts[1] == "holding from 0: 7 1 1 1 1 5 0 0"
    assert texts[2:4] == ["write holding register 16 := 2, unit 1", "written"]


def test_what_is_recorded_is_counted() -> None:
    read = TracedFrame(0.5, True, frames.frame(POLL, 4))
    refused = TracedFrame(0.51, False, frames.exception_answer(read.frame, 2))
    unanswered = TracedFrame(0.6, True, frames.frame(POLL, 5))
    recorder, _ = recorded(map(event, (*TWO_POLLS_AND_A_CALL, read, refused, unanswered)))
    counts = recorder.counts
    assert (counts.frames, counts.writes, counts.exceptions, counts.troubles, counts.gaps) == (9, 1, 1, 1, 0)


def test_a_lost_connection_and_lost_events_are_gaps_and_time_never_goes_back() -> None:
    first, second = exchange(0, 1, POLL, AT_L1)
    events: list[StreamEvent] = [
        Connected(),
        event(first),
        Disconnected("gone", 1.0),
        Disconnected("gone", 2.0),
        Connected(),
    ]
    # another manager, whose clock is elsewhere
    _, items = recorded([*events, event(second, 5.0), Lost(events=3), event(first, 6.0)])
    kinds = [item.reason if isinstance(item, Gap) else "frame" for item in items]
    assert kinds == [
        "frame",
        "the connection to the manager broke: gone",
        "frame",
        "3 frames are lost: this program was too slow",
        "frame",
    ]
    assert [item.at_s for item in items] == sorted(item.at_s for item in items)


# -- the file


def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    _, items = recorded([*map(event, TWO_POLLS_AND_A_CALL), Lost(events=1)])
    file = tmp_path / "a.jsonl"
    file.write_text(header_line(HEADER) + "".join(item_line(HEADER, item) for item in items), "utf-8")
    assert read_recording(file) == Recording(HEADER, tuple(items))
    second = json.loads(file.read_text("utf-8").splitlines()[2])
    assert second["time"] == "2026-11-23T12:00:00.004000Z"
    assert (second["direction"], second["hex"][:5]) == ("answer", "00 01")


def test_a_line_that_was_cut_off_at_the_end_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "a.jsonl"
    whole = header_line(HEADER) + "".join(item_line(HEADER, item) for item in TWO_POLLS_AND_A_CALL)
    file.write_text(whole[:-20], "utf-8")
    assert len(read_recording(file).items) == 5


@each_row(
    ("text", "said"),
    [
        ("", "is empty"),
        ("schema: 1\n", "is not the recording of a link"),
        ('{"trace": 9}\n', "its format is 9; this version reads 1"),
        (header_line(HEADER) + "{}\n", "a.jsonl:2: is neither a frame nor a gap"),
        (
            header_line(HEADER) + item_line(HEADER, Gap(2, "a")) + item_line(HEADER, Gap(1, "b")),
            "a.jsonl:3: is earlier",
        ),
    ],
)
def test_a_file_that_is_no_recording_is_refused_in_a_sentence(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "a.jsonl"
    file.write_text(text, "utf-8")
    with pytest.raises(RecordingUnusable, match=said):
        read_recording(file)


# -- exchanges


def test_a_controller_without_transaction_ids_is_understood() -> None:
    request, answer = exchange(0, 9, POLL, AT_L1)
    silent = TracedFrame(answer.at_s, False, b"\0\0" + answer.frame[2:])
    (found,) = exchanges([request, silent])
    assert isinstance(found, Exchange)
    assert found.values == AT_L1


def test_the_answer_to_a_request_from_before_the_recording_is_no_error() -> None:
    _, late = exchange(0, 9, POLL, AT_L1)
    assert [type(one) for one in exchanges([late, *TWO_POLLS_AND_A_CALL])] == [Exchange] * 3


def test_a_request_without_an_answer_a_misfit_and_an_answer_to_nothing_are_errors() -> None:
    request, answer = exchange(0, 1, POLL, AT_L1)
    short = TracedFrame(0.1, False, frames.answer(frames.read(Table.HOLDING, 0, 2), 2, bytes(4)))
    items = [request, answer, TracedFrame(0.05, True, frames.frame(POLL, 2)), short]
    items += [TracedFrame(0.2, False, frames.answer(CALL, 77)), TracedFrame(0.3, True, frames.frame(POLL, 3))]
    found = [one.trouble for one in exchanges(items) if isinstance(one, Exchange)]
    assert found[0] == ""
    assert found[1].startswith("the answer does not fit: ")
    assert found[2:] == ["an answer to no request", "no answer"]


# -- showing


def test_signals_and_commands_are_shown_by_name_with_what_they_were_before() -> None:
    first, call, second = shown(TWO_POLLS_AND_A_CALL)
    assert first.startswith("4 ms  read 8 holding registers from 0, unit 1: alive 7, car_floor L1, motion stopped")
    assert call == "4 ms  WRITE holding register 16 := 2, unit 1 = go_to L2: done"
    assert second.endswith("unit 1: alive 8 (was 7), door.front open (was closed)")


def test_without_names_there_are_words_and_bits() -> None:
    assert shown(TWO_POLLS_AND_A_CALL, named=False)[0].endswith("unit 1: 7 1 1 1 1 5 0 0")


def test_filters_leave_what_they_name() -> None:
    again = exchange(0.6, 4, POLL, OPEN_AT_L1)
    lost = Gap(0.7, "why")
    items: list[Item] = [*TWO_POLLS_AND_A_CALL, *again, lost, TracedFrame(0.8, True, frames.frame(POLL, 5))]
    assert [line[6:11] for line in shown(items, Filter(writes=True))] == ["WRITE"]
    assert shown(items, Filter(errors=True)) == [
        "GAP: why",
        "read 8 holding registers from 0, unit 1: NO ANSWER",
    ]
    assert len(shown(items, Filter(changes=True))) == 4
    doors = shown(items, Filter(frozenset({"door.front"})))
    assert [line.rpartition("unit 1: ")[2] for line in doors] == [
        "door.front closed",
        "door.front open (was closed)",
        "unchanged",
        "NO ANSWER",
    ]
    history = shown(items, Filter(frozenset({"door.front"}), changes=True))
    assert [line.rpartition("unit 1: ")[2] for line in history[:2]] == [
        "door.front closed",
        "door.front open (was closed)",
    ]


def test_a_release_an_unlisted_value_and_an_exception_are_said_so() -> None:
    request, _ = exchange(0.4, 3, POLL, AT_L1)
    refused = TracedFrame(0.41, False, frames.exception_answer(request.frame, 2))
    odd = (7, 1, 1, 9, 1, 0b101, 0, 0)
    release = exchange(0.2, 2, frames.write_register(16, 0))
    first, second, third = shown([*exchange(0, 1, POLL, odd), *release, request, refused])
    assert "door.front unlisted (9)" in first
    assert second.endswith("= go_to released: done")
    assert third.endswith("unit 1: EXCEPTION 02 (illegal data address)")


def test_a_summary_counts() -> None:
    recording = Recording(HEADER, TWO_POLLS_AND_A_CALL)
    assert summary(recording) == "6 frames in 0.4 s, 1 write, 0 exceptions, 0 without a right answer"


TWO_LIFTS = """\
schema: 1
name: A building
controllers:
  plc: {host: 192.0.2.10, map: generic-registers}
lifts:
  east: {controller: plc, floors: {G: 1, First: 2}}
  west: {controller: plc, floors: {G: 1, First: 2}, offset: {holding: 100}}
"""


def test_of_two_lifts_on_a_controller_each_has_its_own_signals(tmp_path: Path) -> None:
    file = tmp_path / "site.yaml"
    file.write_text(TWO_LIFTS, "utf-8")
    loaded = load_site(file)
    names = Names(lifts_of_site(loaded, "plc"))
    items = [*exchange(0, 1, frames.read(Table.HOLDING, 100, 8), AT_L1), *exchange(1, 2, frames.write_register(116, 2))]
    first, second = lines(Recording(HEADER, tuple(items)), names, Filter())
    assert "west:car_floor G" in first
    assert "east:" not in first
    assert second.endswith("= west:go_to First: done")
    assert "car_floor" in Names(lifts_of_site(loaded, "plc", "west")).signals
    assert lifts_of_site(loaded, "another") == ()


def test_calls_with_one_coil_for_each_floor_are_named_by_their_floor() -> None:
    names = Names(lifts_of_map(load("generic-coils").map, None))
    codec = lifts_of_map(load("generic-coils").map, None)[0].codec
    call = codec.commands["go_to"]
    point = call.points[1]
    assert names.commands_in(frames.write_coil(point.address, True, codec.map.unit_of(""))) == (
        f"go_to {call.spec.floor_codes[1]}",
    )
    assert names.commands_in(frames.write_coil(point.address, False, codec.map.unit_of(""))) == ("go_to released",)
