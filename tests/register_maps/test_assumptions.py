"""What is assumed of a lift because its map does not say otherwise."""

from pathlib import Path

from register_maps.assumptions import assumptions
from register_maps.load import load, shipped
from tests.support.good_map import GOOD, HANDSHAKE, loaded
from tests.support.rows import each_row

SAID = [
    # what is assumed, the map that does not say it, and how it says otherwise
    ("the controller answers as unit 1 (`unit_id`)", GOOD, "served:", "link: {unit_id: 1}\nserved:"),
    ("it has a connection free for us (`max_connections`)", GOOD, "served:", "link: {max_connections: 2}\nserved:"),
    ("requests may follow one another without a pause (`min_gap_s`)", GOOD, "served:", "link: {min_gap_s: 0}\nserved:"),
    ("the high byte of a register comes first (`byte_order`)", HANDSHAKE, "", ""),
    ("never negative: load (`type`)", GOOD, 'load: {at: "input:1"}', 'load: {at: "input:1", type: uint16}'),
    (
        "1 means yes, or open: door.rear, level, robot_mode_on (`active: low` inverts)",
        GOOD,
        'level: {at: "discrete:4"}',
        'level: {at: "discrete:4", active: high}',
    ),
    (
        "the first entry is floor code 0, the next one 1 and so on: call_accepted (`codes`)",
        GOOD,
        '["coil:11", "coil:12"]',
        '["coil:11", "coil:12"], codes: [0, 1]',
    ),
    ("it needs no sign of life from us (`heartbeat`)", GOOD, "", ""),
    (
        "a door stays open for as long as it is held by hold_door.front (`released_after_s`)",
        GOOD,
        "    refresh_s: 2\n",
        "    refresh_s: 2\n    released_after_s: 60\n",
    ),
    (
        "the car arrives within 120 s of go_to (`arrive_within_s`)",
        GOOD,
        "    requires: [robot_mode_on]\n",
        "    requires: [robot_mode_on]\n    arrive_within_s: 120\n",
    ),
    (
        "where the car already stands, the hold opens the door, not a call (`at_same_floor`)",
        GOOD,
        "at_floor_evidence",
        "at_same_floor: open_button\nat_floor_evidence",
    ),
]


@each_row(("line", "text", "without", "said"), SAID)
def test_what_a_map_does_not_say_is_named_with_its_key_and_what_it_says_is_not(
    line: str, text: str, without: str, said: str, tmp_path: Path
) -> None:
    assert line in assumptions(loaded(tmp_path, text).map)
    if without:
        assert line not in assumptions(loaded(tmp_path, text.replace(without, said, 1)).map)


def test_a_map_that_has_a_heartbeat_or_reads_the_time_of_its_watchdog_assumes_neither(tmp_path: Path) -> None:
    lines = assumptions(loaded(tmp_path, HANDSHAKE).map)
    assert not [line for line in lines if "sign of life" in line or "its watchdog" in line]


def test_a_watchdog_whose_time_nothing_reads_is_assumed_to_be_on() -> None:
    lines = assumptions(load("generic-registers").map)
    assert "its watchdog is switched on and releases hold_door.front, robot_mode without us (`watchdog_time`)" in lines


def test_what_the_site_says_is_not_assumed(tmp_path: Path) -> None:
    lines = assumptions(loaded(tmp_path, GOOD).map, {"unit_id", "timeout_s"})
    assert not [line for line in lines if "`unit_id`" in line or "`timeout_s`" in line]


@each_row("name", shipped())
def test_the_block_of_a_shipped_map_is_short(name: str) -> None:
    assert 0 < len(assumptions(load(name).map)) <= 15
