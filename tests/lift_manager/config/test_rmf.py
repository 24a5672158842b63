"""What a site file says about Open-RMF."""

from pathlib import Path

import pytest

from lift_manager.config.site import LiftRmf, Rmf
from lift_manager.lift.rmf_view import RmfRules
from register_maps.load import MAPS
from tests.lift_manager.config.site_files import (
    GENERIC,
    SECOND_LIFT,
    TWO_STOP,
    assert_says_exactly,
    findings,
    load,
    said,
)
from tests.support.rows import each_row

SECOND = SECOND_LIFT.replace("    access: control\n", "    unit_id: 2\n")
TWO = GENERIC + SECOND
EVERYTHING = """\
rmf:
  end_grace_s: 5
  fire_alarm: true
  emergency_signal: true
  emergency_fleets: [tinyRobot]
  clear_on_acknowledge: true
  namespace: /building1
  lift_states: states
  lift_requests: /requests
  domain: 42
  peers: [192.0.2.7]
  use_sim_time: true
"""
NAMES = "    rmf: {name: lift_1, floors: {B1: basement, L2: level 2}}\n"


def of_main(text: str) -> str:
    """The first lift with this."""
    return GENERIC + text


def test_a_site_that_says_nothing_of_rmf_has_a_grace_of_3_s_its_own_names_and_no_alarms(tmp_path: Path) -> None:
    site = load(tmp_path, GENERIC).site
    assert site.rmf == Rmf()
    assert site.rmf.rules == RmfRules()
    assert site.rmf.end_grace_s == 3
    assert not site.rmf.fire_alarm
    assert not site.rmf.emergency_signal
    assert not site.rmf.use_sim_time
    assert (site.rmf.lift_states, site.rmf.lift_requests, site.rmf.domain) == ("lift_states", "lift_requests", None)
    assert site.lifts["main"].rmf == LiftRmf()


def test_everything_that_can_be_said(tmp_path: Path) -> None:
    site = load(tmp_path, of_main(NAMES) + EVERYTHING).site
    assert site.rmf.rules == RmfRules(
        end_grace_s=5,
        fire_alarm=True,
        emergency_signal=True,
        emergency_fleets=("tinyRobot",),
        clear_on_acknowledge=True,
    )
    assert (site.rmf.namespace, site.rmf.lift_states, site.rmf.lift_requests) == ("/building1", "states", "/requests")
    assert (site.rmf.domain, site.rmf.peers, site.rmf.use_sim_time) == (42, ("192.0.2.7",), True)
    assert site.lifts["main"].rmf == LiftRmf(name="lift_1", floors={"B1": "basement", "L2": "level 2"})


@each_row(
    ("line", "key", "words"),
    [
        ("end_grace_s: 31", "end_grace_s", "30"),
        ("end_grace_s: -1", "end_grace_s", "0"),
        ("domain: 233", "domain", "232"),
        ("namespace: a building", "namespace", "a building"),
        ("namespace: ''", "namespace", ""),
        ("lift_states: 7up", "lift_states", "7up"),
        ("emergency_fleets: ['']", "emergency_fleets[0]", ""),
        ("emergency_fleets: [a]", "emergency_fleets", "add `emergency_signal: true`"),
        ("clear_on_acknowledge: true", "clear_on_acknowledge", "add `fire_alarm: true`"),
        ("topics: x", "topics", "there is no such key"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, line: str, key: str, words: str) -> None:
    found = findings(tmp_path, f"{GENERIC}rmf:\n  {line}\n")
    (one,) = found
    assert (one.line, one.key) == (11, f"rmf.{key}")
    assert words in one.message


def test_an_alarm_on_either_topic_may_be_cleared(tmp_path: Path) -> None:
    said_so = "rmf: {emergency_signal: true, clear_on_acknowledge: true}\n"
    assert load(tmp_path, GENERIC + said_so).site.rmf.clear_on_acknowledge


@pytest.mark.parametrize(
    ("text", "line", "key"),
    [
        (TWO + "    rmf: {name: main}\n", 14, "lifts.second.rmf.name"),
        (GENERIC + "    rmf: {name: second}\n" + SECOND, 11, "lifts.second"),
        (GENERIC + "    rmf: {name: L}\n" + SECOND + "    rmf: {name: L}\n", 15, "lifts.second.rmf.name"),
    ],
)
def test_two_lifts_have_two_names_in_rmf(tmp_path: Path, text: str, line: int, key: str) -> None:
    assert_says_exactly(findings(tmp_path, text), said(line, key, "already", "give one of them another name"))


def test_two_lifts_may_swap_their_names(tmp_path: Path) -> None:
    text = GENERIC + "    rmf: {name: second}\n" + SECOND + "    rmf: {name: main}\n"
    assert {name: lift.rmf.name for name, lift in load(tmp_path, text).site.lifts.items()} == {
        "main": "second",
        "second": "main",
    }


@pytest.mark.parametrize("floors", ["{B1: L1}", "{L1: B1}", "{B1: x, L2: x}"])
def test_two_floors_of_a_lift_have_two_names_in_rmf(tmp_path: Path, floors: str) -> None:
    (found,) = findings(tmp_path, of_main(f"    rmf: {{floors: {floors}}}\n"))
    assert found.line == 10
    assert found.key is not None
    assert found.key.startswith("lifts.main.rmf.floors.")
    assert "already; each floor needs a name of its own" in found.message


def test_floors_may_swap_their_names(tmp_path: Path) -> None:
    load(tmp_path, of_main("    rmf: {floors: {L1: L2, L2: L1}}\n"))


def test_a_floor_that_the_lift_does_not_have_is_no_floor_for_rmf(tmp_path: Path) -> None:
    found = findings(tmp_path, of_main("    rmf: {floors: {L7: seven}}\n"))
    assert_says_exactly(found, said(10, "lifts.main.rmf.floors.L7", "main has no floor L7", "B1, L1, L2"))


@each_row("text", ["{name: ''}", "{floors: {L1: ''}}", "{floors: {'': x}}", '{name: "a\\nb"}'])
def test_a_name_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (found,) = findings(tmp_path, of_main(f"    rmf: {text}\n"))
    assert found.key is not None
    assert found.key.startswith("lifts.main.rmf.")


def test_a_lift_that_has_to_hear_of_robots_is_none_for_rmf_unless_that_may_be_inferred(tmp_path: Path) -> None:
    named, inferred = "    rmf: {name: goods_1}\n", "    infer_occupancy: true\n"
    told = TWO_STOP.replace("two-stop-agv", "seer-lps3-two-stop")
    (found,) = findings(tmp_path, told + named)
    assert "add `infer_occupancy: true` to this lift" in str(found)
    assert load(tmp_path, told + inferred + named).site.lifts["goods"].rmf.name == "goods_1"
    for fine in (told, TWO_STOP + named, told.replace("access: control", "access: monitor") + named):
        load(tmp_path, fine)


NO_HOLD = ("map: generic-registers", "map: ./mine.yaml")


def without_hold(folder: Path) -> None:
    """A map whose door nothing keeps open."""
    text = (MAPS / "generic-registers.yaml").read_text("utf-8")
    begin, end = text.index("  hold_door.front:"), text.index("  close_door.front:")
    text = (text[:begin] + text[end:]).replace("    excludes: [hold_door.front]\n", "")
    (folder / "mine.yaml").write_text(text.replace("at_same_floor: open_button", "at_same_floor: call"), "utf-8")


def cautions(folder: Path, text: str, *edits: tuple[str, str]) -> list[str]:
    return [caution for caution in load(folder, text, *edits).cautions() if "hold_door" in caution]


def test_a_lift_of_rmf_whose_door_closes_by_its_timer_is_cautioned_about(tmp_path: Path) -> None:
    without_hold(tmp_path)
    (caution,) = cautions(tmp_path, of_main(NAMES), NO_HOLD)
    assert caution.startswith(
        "main: map generic-registers has no hold_door.front: RMF sends robots in when the door is open"
    )
    assert "set the timer longer than the slowest robot needs" in caution


def test_a_lift_that_holds_its_door_that_rmf_does_not_name_or_that_is_only_watched_is_not(tmp_path: Path) -> None:
    without_hold(tmp_path)
    assert cautions(tmp_path, of_main(NAMES)) == []
    assert cautions(tmp_path, GENERIC, NO_HOLD) == []
    assert cautions(tmp_path, of_main(NAMES), NO_HOLD, ("    access: control\n", "")) == []


def test_a_lift_whose_call_keeps_the_door_open_is_not_cautioned_about(tmp_path: Path) -> None:
    latches = "    access: control\n    accept_latching: somebody watches\n    infer_occupancy: true\n"
    edits = (
        ("generic-registers", "seer-siemens-chengdu"),
        ("{B1: -1, L1: 1, L2: 2}", "{B1: 1, L1: 2, L2: 3}"),
        ("    access: control\n", latches),
    )
    assert cautions(tmp_path, of_main(NAMES), *edits) == []
