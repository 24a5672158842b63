"""Two lifts must never write the same register; some bits of one they may, where the map says how."""

from pathlib import Path

import pytest

from register_maps.load import MAPS
from tests.lift_manager.config.site_files import (
    GENERIC,
    SECOND_LIFT,
    assert_says_exactly,
    edited,
    findings,
    load,
    my_map,
    said,
)

BITS = """\
schema: 1
name: A building
controllers:
  block: {host: 10.0.0.5, map: ./mine.yaml}
lifts:
  first:
    controller: block
    access: control
    accept_latching: a person stands beside it
    floors: {L0: 0, L1: 1}
    override:
      commands:
        go_to: {one_of: ["holding:384.0", "holding:384.1", "holding:384.2"], shared_word: FIRST}
        robot_mode: {at: "holding:384.3", shared_word: FIRST}
        hold_door.front: {at: "holding:385.0", shared_word: FIRST}
  second:
    controller: block
    access: control
    accept_latching: a person stands beside it
    floors: {L0: 0, L1: 1}
    override:
      commands:
        go_to: {one_of: ["holding:384.4", "holding:384.5", "holding:384.6"], shared_word: SECOND}
        robot_mode: {at: "holding:384.7", shared_word: SECOND}
        hold_door.front: {at: "holding:385.1", shared_word: SECOND}
"""
COILS = """\
schema: 1
name: A building
controllers:
  block: {host: 10.0.0.5, map: generic-coils}
lifts:
  first:
    controller: block
    access: control
    floors: {L0: 0, L1: 1}
  second:
    controller: block
    access: control
    offset: {coil: 11}
    floors: {L0: 0, L1: 1}
"""
ENDPOINT = """\
    endpoints: {doors: {controller: box}}
    override:
      endpoints: {doors: {served: {holding: [[0, 9]]}}}
      commands: {hold_door.front: {at: "doors/holding:3"}}
"""


def bits(folder: Path, first: str, second: str) -> str:
    """Two lifts in the same registers of an I/O block, each with its word about who else writes there."""
    shipped = (MAPS / "robotnik-il-eth.yaml").read_text("utf-8")
    control = shipped[shipped.index("  control_output:") : shipped.index("  not_closed:")]
    my_map(folder, (control, ""), ("{control_output}", "holding:385.3"), shipped="robotnik-il-eth")
    return BITS.replace("FIRST", first).replace("SECOND", second)


def test_two_lifts_that_would_write_the_same_registers_are_refused(tmp_path: Path) -> None:
    found = findings(tmp_path, GENERIC + SECOND_LIFT)
    words = "same registers as main", "go_to writes where go_to of main does", "`offset`", "`unit_id`"
    assert_says_exactly(found, said(10, "lifts.second", *words))


def test_a_lift_that_is_only_watched_writes_nowhere(tmp_path: Path) -> None:
    load(tmp_path, GENERIC + edited(SECOND_LIFT, ("access: control", "access: monitor")))


def test_an_offset_that_leaves_two_lifts_overlapping_is_refused(tmp_path: Path) -> None:
    overlapping = edited(SECOND_LIFT, ("    access: control", "    access: control\n    offset: {holding: 2}"))
    assert_says_exactly(findings(tmp_path, GENERIC + overlapping), said(10, "lifts.second", "same registers as main"))


@pytest.mark.parametrize("word", ["mask_write", "accepted"])
def test_two_lifts_may_use_different_bits_of_one_register_that_is_said_to_be_shared(tmp_path: Path, word: str) -> None:
    assert list(load(tmp_path, bits(tmp_path, word, word)).maps) == ["first", "second"]


@pytest.mark.parametrize("word", ["mask_write", "accepted"])
def test_two_lifts_may_not_use_the_same_bit_of_a_shared_register(tmp_path: Path, word: str) -> None:
    found = findings(tmp_path, bits(tmp_path, word, word), ("holding:385.1", "holding:385.0"))
    words = "same registers as first", "hold_door.front writes where hold_door.front of first does"
    assert_says_exactly(found, said(16, "lifts.second", *words))


def test_different_bits_of_a_register_that_is_owned_are_refused_with_the_word_that_allows_them(tmp_path: Path) -> None:
    found = findings(tmp_path, bits(tmp_path, "owned", "owned"))
    assert_says_exactly(found, said(16, "lifts.second", "same registers", "`shared_word: mask_write` or `accepted`"))


def test_a_register_is_not_shared_by_a_lift_that_owns_it_and_one_that_does_not(tmp_path: Path) -> None:
    for first, second in [("owned", "accepted"), ("mask_write", "owned")]:
        found = findings(tmp_path, bits(tmp_path, first, second))
        assert_says_exactly(found, said(16, "lifts.second", "same registers", "`shared_word: mask_write`"))


def test_a_register_that_one_lift_writes_back_whole_and_another_by_mask_is_refused(tmp_path: Path) -> None:
    found = findings(tmp_path, bits(tmp_path, "accepted", "mask_write"))
    assert_says_exactly(found, said(16, "lifts.second", "same registers", "says the same `shared_word`"))


def test_blocks_that_are_written_whole_may_not_overlap(tmp_path: Path) -> None:
    assert load(tmp_path, COILS).maps
    found = findings(tmp_path, COILS, ("{coil: 11}", "{coil: 7}"))
    assert_says_exactly(found, said(10, "lifts.second", "same registers as first", "go_to writes where go_to of first"))


def test_two_lifts_that_would_write_to_one_device_at_their_endpoints_are_refused(tmp_path: Path) -> None:
    box = "lifts:\n", "  box: {host: 10.0.0.6}\nlifts:\n"
    apart = edited(SECOND_LIFT, ("    access: control\n", "    access: control\n    unit_id: 2\n"))
    both = edited(GENERIC, box, ("    access: control\n", f"    access: control\n{ENDPOINT}")) + apart + ENDPOINT
    words = "same registers as main", "hold_door.front writes where", "place the endpoint doors elsewhere"
    assert_says_exactly(findings(tmp_path, both), said(15, "lifts.second", *words))
    placed = "    unit_id: 2\n    floors: {B1: -1, L1: 1, L2: 2}\n    endpoints: {doors: {controller: box"
    load(tmp_path, both, (placed, f"{placed}, unit_id: 2"))


def test_two_endpoints_of_a_lift_that_are_one_device_may_not_be_written_to_twice(tmp_path: Path) -> None:
    endpoint = edited(ENDPOINT, ("controller: box", "controller: plc"), ("doors/holding:3", "doors/holding:8"))
    own = edited(GENERIC, ("    access: control\n", f"    access: control\n{endpoint}"))
    assert load(tmp_path, own).maps
    found = findings(tmp_path, edited(own, ("[[0, 9]]", "[[0, 19]]"), ("doors/holding:8", "doors/holding:16")))
    assert_says_exactly(found, said(6, "lifts.main", "hold_door.front and go_to write to the same place", "one device"))


def test_lifts_whose_addresses_are_not_set_yet_are_not_said_to_overlap(tmp_path: Path) -> None:
    text = edited(GENERIC, ("generic-registers", "seer-generic"), ("{B1: -1, L1: 1, L2: 2}", "{L1: 1, L2: 2}"))
    text = edited(text, ("access: control\n", "access: control\n    accept_latching: a person\n"))
    found = findings(tmp_path, text + text[text.index("  main:") :].replace("main:", "second:"))
    assert len(found) == 18
    assert all("is not set" in finding.message for finding in found)
