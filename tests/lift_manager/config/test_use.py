"""What a robot needs of a lift before it may be watched or commanded: floor, door, the right to call, and who is aboard."""

from pathlib import Path

import pytest

from tests.lift_manager.config.site_files import (
    GENERIC,
    TWO_STOP,
    Said,
    assert_says_exactly,
    edited,
    findings,
    load,
    said,
)

BUTTONS = """\
schema: 1
name: A building
controllers:
  buttons: {host: 10.0.0.5, map: adam-pushbutton}
  box: {host: 10.0.0.6}
lifts:
  vip:
    controller: buttons
    access: control
    accept_latching: a person stands beside it
    floors: {G: 0, L1: 1, L2: 2}
    endpoints: {sensor: {controller: box}}
    override:
      endpoints: {sensor: {served: {discrete: [[1, 5]]}}}
      signals:
        car_floor: {one_of: ["sensor/discrete:1", "sensor/discrete:2", "sensor/discrete:3"]}
        door.front: {open_limit: "sensor/discrete:4", closed_limit: "sensor/discrete:5"}
"""
HANDSHAKE = edited(TWO_STOP, ("two-stop-agv", "seer-siemens-chengdu"), ("{L1: 0, L2: 1}", "{L1: 1, L2: 2}"))


def with_lines(text: str, lines: str) -> str:
    return edited(text, ("    floors:", f"{lines}    floors:"))


def test_an_interface_without_floor_and_door_can_be_used_once_a_second_device_tells_them(tmp_path: Path) -> None:
    source = load(tmp_path, BUTTONS).maps["vip"].map
    assert source.signals["car_floor"].addresses[0] == "sensor/discrete:1"
    assert not source.needs


@pytest.mark.parametrize("access", ["control", "monitor"])
def test_an_interface_without_a_floor_is_refused_whatever_its_access_with_the_reason_of_its_map(
    tmp_path: Path, access: str
) -> None:
    start = BUTTONS.index("    endpoints: {sensor: {controller")
    bare = edited(BUTTONS[:start], ("access: control", f"access: {access}"))
    reason = "the module has outputs only"
    assert_says_exactly(
        findings(tmp_path, bare),
        said(7, "lifts.vip.override.signals.car_floor", "does not report where its car is", reason, "second endpoint"),
        said(7, "lifts.vip.override.signals.door.front", "does not report door.front", reason, "`override: signals`"),
    )


def test_a_needed_signal_is_not_added_by_saying_null(tmp_path: Path) -> None:
    found = findings(tmp_path, BUTTONS[: BUTTONS.index("        door.front:")] + "        door.front: null\n")
    key = "lifts.vip.override.signals.door.front"
    assert any(said(17, key, "does not report door.front").fits(finding) for finding in found), found


def test_a_lift_whose_floor_the_site_takes_away_is_refused(tmp_path: Path) -> None:
    gone = with_lines(
        edited(GENERIC, ("    access: control\n", "")),
        "    override: {signals: {car_floor: null}}\n",
    )
    words = (
        "does not report where its car is",
        "add car_floor under `override: signals`, on a second endpoint if need be",
    )
    assert_says_exactly(findings(tmp_path, gone), said(8, "lifts.main.override.signals.car_floor", *words))


def test_a_lift_that_shows_no_door_may_be_watched_and_not_commanded(tmp_path: Path) -> None:
    override = """\
    override:
      signals: {door.front: null}
      commands: {hold_door.front: null, close_door.front: null}
      at_same_floor: call
"""
    doorless = with_lines(GENERIC, override)
    words = "whether a door is open", "add door.front", "`access: monitor`"
    assert_says_exactly(findings(tmp_path, doorless), said(8, "lifts.main.access", *words))
    load(tmp_path, doorless, ("    access: control\n", ""))


def test_a_lift_of_a_group_may_be_watched(tmp_path: Path) -> None:
    watched = edited(BUTTONS, ("    access: control\n", "    group: A\n"))
    assert load(tmp_path, watched).site.lifts["vip"].group == "A"


def test_a_lift_of_a_group_may_be_commanded_where_every_call_asks_for_robot_or_independent_mode(tmp_path: Path) -> None:
    load(tmp_path, with_lines(GENERIC, "    group: A\n"))
    independent = "    group: A\n    override: {commands: {go_to: {requires: [independent]}}, signals: SIGNALS}\n"
    signals = '{independent: {at: "holding:5.5"}}'
    load(tmp_path, with_lines(GENERIC, independent.replace("SIGNALS", signals)))


def test_a_lift_of_a_group_is_not_commanded_by_calls_that_its_group_may_take_away(tmp_path: Path) -> None:
    found = findings(tmp_path, BUTTONS, ("    access: control\n", "    access: control\n    group: Tower A\n"))
    words = (
        "Tower A may send this car elsewhere",
        "go_to of adam-pushbutton",
        "`requires: [robot_mode_on]`",
        "`access: monitor`",
    )
    assert_says_exactly(found, said(9, "lifts.vip.access", *words))


def test_of_call_and_go_only_the_call_brings_a_car_out_of_its_group(tmp_path: Path) -> None:
    found = findings(tmp_path, with_lines(HANDSHAKE, "    group: A\n"))
    assert_says_exactly(found, said(8, "lifts.goods.access", "and call of seer-siemens-chengdu"))


@pytest.mark.parametrize(("text", "lift"), [(HANDSHAKE, "goods")])
def test_a_lift_that_is_told_about_a_robot_aboard_may_infer_it(tmp_path: Path, text: str, lift: str) -> None:
    chosen = load(tmp_path, with_lines(text, "    infer_occupancy: true\n    board_min_s: 8\n")).site.lifts[lift]
    assert (chosen.infer_occupancy, chosen.board_min_s) == (True, 8)
    assert not load(tmp_path, text).site.lifts[lift].infer_occupancy


def test_a_lift_that_is_told_nothing_about_a_robot_aboard_has_nothing_to_infer(tmp_path: Path) -> None:
    found = findings(tmp_path, with_lines(GENERIC, "    infer_occupancy: true\n"))
    assert_says_exactly(found, said(9, "lifts.main.infer_occupancy", "takes no report about a robot aboard"))


@pytest.mark.parametrize("unsaid", ["", "    infer_occupancy: false\n"])
def test_a_lift_infers_nothing_unless_its_site_says_so(tmp_path: Path, unsaid: str) -> None:
    assert not load(tmp_path, with_lines(GENERIC, unsaid)).site.lifts["main"].infer_occupancy


def test_every_output_that_latches_is_named_the_calls_too(tmp_path: Path) -> None:
    found = findings(tmp_path, HANDSHAKE, ("    accept_latching: a person stands beside it\n", ""))
    assert_says_exactly(found, said(8, "lifts.goods.access", "call, go of seer-siemens-chengdu", "stay on"))


FLOORS: list[tuple[str, str, list[tuple[str, str]], list[Said]]] = [
    (
        "a code at which call and go rest",
        HANDSHAKE,
        [("{L1: 1, L2: 2}", "{L1: 0, L2: 2}")],
        [said(10, "lifts.goods.floors.L1", "call rests at 0", "a release would call a floor")],
    ),
    (
        "a code for which there is no button",
        BUTTONS,
        [("L2: 2}", "L2: 3}")],
        [said(11, "lifts.vip.floors.L2", "go_to has 3 floors, with codes 0 to 2", "3 is none")],
    ),
    (
        "a code for which there is no lamp",
        with_lines(
            GENERIC,
            "    override:\n"
            "      served: {holding: [[0, 7], [16, 19], [30, 30]]}\n"
            '      signals: {calls_registered: {each_of: ["holding:30.0", "holding:30.1", "holding:30.2"]}}\n',
        ),
        [("{B1: -1, L1: 1,", "{B1: 3, L1: 1,")],
        [said(12, "lifts.main.floors.B1", "calls_registered has 3 floors, with codes 0 to 2", "3 is none")],
    ),
    (
        "a code that four position bits cannot say",
        with_lines(
            edited(GENERIC, ("    access: control\n", "")),
            "    override:\n"
            '      signals: {car_floor: {code_of: ["holding:1.0", "holding:1.1", "holding:1.2", "holding:1.3"], '
            "unknown: [15], type: uint16, as: floor}}\n",
        ),
        [("{B1: -1, L1: 1, L2: 2}", "{B1: 15, L1: 16, L2: 2}")],
        [
            said(10, "lifts.main.floors.B1", "code 15", "in car_floor", "there is no floor"),
            said(10, "lifts.main.floors.L1", "code 16", "in car_floor", "read back as 0"),
        ],
    ),
    (
        "a code that means no destination",
        with_lines(
            edited(GENERIC, ("    access: control\n", "")), "    override: {signals: {destination: {none: [0, 2]}}}\n"
        ),
        [],
        [said(9, "lifts.main.floors.L2", "code 2", "in destination", "there is no floor")],
    ),
]


@pytest.mark.parametrize(("text", "edits", "expected"), [pytest.param(*case[1:], id=case[0]) for case in FLOORS])
def test_a_floor_that_the_map_cannot_call_or_tell_is_named(
    tmp_path: Path, text: str, edits: list[tuple[str, str]], expected: list[Said]
) -> None:
    assert_says_exactly(findings(tmp_path, text, *edits), *expected)
