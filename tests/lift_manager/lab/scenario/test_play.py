"""Scenarios as they are played: every step does what it says, the trace tells it, and a seed gives one result."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lift_manager.cli.main import app
from lift_manager.lab.scenario.play import play
from lift_manager.lab.scenario.trace import Entry
from lift_manager.lab.scenario.verdict import lines, verdict_of
from lift_manager.lab.scenario.vocabulary import KINDS
from lift_manager.lab.world.lift_under_test import Finding
from register_maps.errors import MapFileError
from register_maps.words import Table
from simulator.faults import ForeignCell
from tests.lift_manager.lab.scenario.scenario_files import HEAD, ROOT, first, loaded, played, text_of, verdict

SHORT = HEAD.replace("60", "25") + "options: {poll_s: 0.4}\n"
"""Minutes are played by the poll; none of these looks at what lasts less than half a second."""


def of(trace: list[Entry], kind: str) -> list[Entry]:
    return [entry for entry in trace if entry.kind == kind]


def test_a_robot_calls_enters_rides_and_leaves(tmp_path: Path) -> None:
    do = "  - {at: 2, robot: {from: L2, to: L1, holder: 'fleet:r1'}}\n"
    trace = played(tmp_path, text_of(do=do, head=SHORT.replace("25", "45"))).trace
    assert [entry.fields["does"] for entry in of(trace, "robot")] == ["calls", "enters", "rides", "leaves", "done"]
    assert first(trace, "robot") == 2.0
    assert {entry.fields["holder"] for entry in of(trace, "request")} == {"fleet:r1"}
    assert of(trace, "session")[-1].fields["reason"] == "released"
    assert [entry.fields["floor"] for entry in of(trace, "press") if entry.fields["command"] == "go_to"] == ["L2", "L1"]


def test_a_robot_that_is_not_served_gives_up_and_may_fall_silent(tmp_path: Path) -> None:
    robot = "robot: {from: L2, to: L1, gives_up_after_s: 5, releases: false}"
    trace = played(tmp_path, text_of(do=f"  - {{at: 0, fault: homing}}\n  - {{at: 1, {robot}}}\n", head=SHORT)).trace
    assert first(trace, "robot", does="gives_up") == 6.0
    assert all(entry.fields["door"] == "open" for entry in of(trace, "request"))
    assert all(entry.at_s < 6.0 for entry in of(trace, "request"))


def test_a_request_is_repeated_until_it_has_what_it_wants(tmp_path: Path) -> None:
    step = "{at: 1, request: {floor: L2}, every_s: 2, until: {kind: state, floor: L2, robot_door: open}}"
    trace = played(tmp_path, text_of(do=f"  - {step}\n", head=SHORT)).trace
    opened = first(trace, "state", floor="L2", robot_door="open")
    asked = [entry.at_s for entry in of(trace, "request")]
    assert asked == [1.0 + 2.0 * number for number in range(len(asked))]
    assert opened - 2.0 <= asked[-1] <= opened


def test_a_request_is_repeated_for_as_long_as_it_says(tmp_path: Path) -> None:
    step = "{at: 1, request: {floor: L2, door: closed, robot: left}, every_s: 1, for_s: 2.5}"
    requests = of(played(tmp_path, text_of(do=f"  - {step}\n", head=SHORT)).trace, "request")
    assert [entry.at_s for entry in requests] == [1.0, 2.0, 3.0]
    assert {(entry.fields["door"], entry.fields["robot"]) for entry in requests} == {("closed", "left")}


def test_a_fault_of_the_lift_begins_and_ends(tmp_path: Path) -> None:
    do = "  - {at: 3, fault: {in_mode: fire}, for_s: 4}\n  - {at: 4, fault: overload}\n"
    trace = played(tmp_path, text_of(do=do, head=SHORT)).trace
    told = [(entry.at_s, entry.fields["fault"], entry.fields["began"]) for entry in of(trace, "fault")]
    assert told == [(3.0, "in_mode.fire", True), (4.0, "overload", True), (7.0, "in_mode.fire", False)]
    assert 3.0 <= first(trace, "truth", mode="fire") <= 3.3
    assert first(trace, "state", mode="fire", fire_latched=True) < 4.0


def test_a_fault_on_the_wire_takes_the_lift_away_and_gives_it_back(tmp_path: Path) -> None:
    trace = played(tmp_path, text_of(do="  - {at: 5, wire: drop_request, for_s: 4}\n", head=SHORT)).trace
    told = [(entry.at_s, entry.fields["controller"], entry.fields["began"]) for entry in of(trace, "wire")]
    assert told == [(5.0, "controller", True), (9.0, "controller", False)]
    qualities = [(entry.at_s, entry.fields["quality"]) for entry in of(trace, "state")]
    assert any(5.5 < at < 6.5 and quality == "offline" for at, quality in qualities)
    assert qualities[-1][1] == "live"


@pytest.mark.parametrize(("times", "offline"), [(1, False), (50, True)])
def test_a_fault_on_the_wire_strikes_as_often_as_it_says(tmp_path: Path, times: int, offline: bool) -> None:
    do = f"  - {{at: 5, wire: {{drop_answer: {{}}, times: {times}, only: {{access: reads}}}}}}\n"
    states = of(played(tmp_path, text_of(do=do, head=SHORT)).trace, "state")
    assert any(entry.fields["quality"] == "offline" for entry in states if entry.at_s > 5.0) is offline


def test_people_come_with_the_seed_of_the_scenario_or_with_their_own(tmp_path: Path) -> None:
    def truths(seed: int, people: str) -> list[Entry]:
        text = text_of(do=f"  - {{at: 0, people: {{per_minute: 20{people}}}}}\n", head=f"{SHORT}seed: {seed}\n")
        return of(played(tmp_path, text).trace, "truth")

    one = truths(1, "")
    assert len(one) > 5
    assert one != truths(2, "")
    assert truths(1, ", seed: 9") == truths(2, ", seed: 9")


def test_a_landing_button_brings_the_car(tmp_path: Path) -> None:
    do = "  - {at: 1, inputs: {landing_buttons: [L2]}, for_s: 0.5}\n"
    trace = played(tmp_path, text_of(do=do, head=SHORT)).trace
    assert first(trace, "truth", open_at="L2") < 20.0


def test_a_drain_lets_the_session_go_on_and_refuses_the_next_until_its_end(tmp_path: Path) -> None:
    do = """\
  - {at: 1, request: {floor: L2, holder: "fleet:r1"}}
  - {at: 2, drain: {by: Dana, reason: update}}
  - {at: 15, request: {floor: L2, door: closed, holder: "fleet:r1"}}
  - {at: 18, request: {floor: L1, holder: "fleet:r2"}}
  - {at: 20, end_drain: {by: Dana}}
  - {at: 21, request: {floor: L1, holder: "fleet:r2"}}
"""
    trace = played(tmp_path, text_of(do=do, head=SHORT)).trace
    said = [(entry.fields["says"], entry.fields["accepted"]) for entry in of(trace, "person")]
    assert said == [("drain", True), ("end_drain", True)]
    assert [entry.fields["code"] for entry in of(trace, "request")] == [None, None, "draining", None]
    assert first(trace, "state", drain="by Dana: update") == 2.0


@pytest.mark.parametrize("clear_s", [2, 8])
def test_clear_s_of_a_scenario_says_how_long_before_the_end_of_a_hold_open_is_withdrawn(
    tmp_path: Path, clear_s: int
) -> None:
    head = HEAD.replace("60", "45") + f"options: {{max_session_hold_s: 24, clear_s: {clear_s}}}\n"
    do = "  - {at: 1, request: {floor: L2}, every_s: 1}\n"
    trace = played(tmp_path, text_of(do=do, head=head)).trace
    (opened, *_) = [entry.at_s for entry in of(trace, "state") if entry.fields["robot_door"] == "open"]
    withdrawn = next(
        entry.at_s for entry in of(trace, "state") if entry.at_s > opened and entry.fields["robot_door"] == "moving"
    )
    let_go = next(entry.at_s for entry in of(trace, "release") if entry.fields["command"] == "hold_door.front")
    assert let_go - withdrawn == pytest.approx(clear_s, abs=0.3)


def test_a_clear_s_that_leaves_no_time_is_a_mistake_where_it_stands(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match=r"options\.max_session_hold_s: 20 s is less than 3 times `clear_s`"):
        played(tmp_path, text_of(head=HEAD + "options: {max_session_hold_s: 20, clear_s: 8}\n"))


def test_a_blocked_doorway_keeps_the_door_open_until_it_is_free(tmp_path: Path) -> None:
    do = """\
  - {at: 1, inputs: {car_buttons: [L1]}, for_s: 0.5}
  - {at: 2, inputs: {obstruction: [front]}, for_s: 15}
  - {at: 3, inputs: {obstruction: [front], landing_buttons: [L3]}, for_s: 1}
"""
    trace = played(tmp_path, text_of(do=do, head=SHORT.replace("25", "30"))).trace
    shut = [entry.at_s for entry in of(trace, "truth") if entry.fields["doors_shut"] and entry.at_s > 2.0]
    assert 17.0 < shut[0] < 25.0


def test_people_say_their_word_and_hear_the_answer(tmp_path: Path) -> None:
    do = """\
  - {at: 1, acknowledge: {by: Dana}}
  - {at: 2, lock_out: {by: Dana, reason: painting}}
  - {at: 3, request: {floor: L2}}
  - {at: 4, end_lockout: {by: Dana}}
"""
    trace = played(tmp_path, text_of(do=do, head=SHORT)).trace
    said = [(entry.fields["says"], entry.fields["accepted"], entry.fields["code"]) for entry in of(trace, "person")]
    assert said == [
        ("acknowledge", False, "nothing_to_acknowledge"),
        ("lock_out", True, None),
        ("end_lockout", True, None),
    ]
    assert of(trace, "request")[0].fields["code"] == "locked_out"
    assert first(trace, "state", lockout="by Dana: painting") == 2.0


def test_a_step_waits_for_what_has_happened_and_for_its_time_after_that(tmp_path: Path) -> None:
    do = """\
  - {at: 1, request: {floor: L2}}
  - {when: {kind: press, command: go_to}, wait_s: 2, fault: overload}
  - {at: 10, when: {kind: state, holder: workshop}, fault: homing}
"""
    trace = played(tmp_path, text_of(do=do, head=SHORT)).trace
    assert first(trace, "fault", fault="overload") == pytest.approx(first(trace, "press", command="go_to") + 2.0)
    assert first(trace, "fault", fault="homing") == 10.0


@pytest.mark.parametrize(("within", "said"), [("", "in time"), (", within_s: 3", "within 3 s")])
def test_what_never_comes_about_fails_the_scenario(tmp_path: Path, within: str, said: str) -> None:
    do = f"  - {{when: {{kind: state, mode: fire}}{within}, fault: overload}}\n"
    found = verdict(tmp_path, text_of(do=do, head=SHORT))
    assert not found.ok
    assert found.problems == (f"line 7: fault was not carried out: state mode fire did not occur {said}",)


def test_a_foreign_writer_presses_nothing_of_ours(tmp_path: Path) -> None:
    do = "  - {at: 5, fault: {foreign_writer: {command: hold_door.front}}, for_s: 5}\n"
    trace = played(tmp_path, text_of(do=do, head=SHORT)).trace
    assert any("hold_door.front" in str(entry.fields["commands"]) for entry in of(trace, "truth"))
    assert not of(trace, "press")
    assert of(trace, "alarm")


def test_the_end_of_the_run_is_no_part_of_it(tmp_path: Path) -> None:
    do = "  - {at: 1, request: {floor: L2}, every_s: 1}\n"
    run = played(tmp_path, text_of(do=do, head=SHORT))
    assert max(entry.at_s for entry in run.trace) <= 25.0
    assert all(entry.fields["open"] for entry in of(run.trace, "session"))
    assert run.released
    assert not run.findings


def test_door_never_reported_open_while_the_car_moved_fails_where_a_car_relevels(tmp_path: Path) -> None:
    """Re-levelling with the door open is normal, and it is a movement."""
    do = "  - {at: 0, fault: relevelling}\n  - {at: 1, request: {floor: L2}, every_s: 1}\n"
    head = SHORT.replace("generic-registers", "two-stop-agv")
    expect = (
        "  - never: {kind: state, robot_door: open}\n    while: {kind: truth, standing: false}\n    because: of test\n"
    )
    run = played(tmp_path, text_of(do=do, expect=expect, head=head))
    (judgement,) = verdict_of(run).expectations
    assert not judgement.ok
    assert judgement.at_s in [entry.at_s for entry in of(run.trace, "truth") if not entry.fields["standing"]]
    assert judgement.because == "of test"
    assert sum(line.startswith(">") for line in judgement.around) == 1


def test_no_press_while_fire_was_active_fails_on_a_map_that_shows_no_fire(tmp_path: Path) -> None:
    do = "  - {at: 0, fault: in_mode.fire}\n  - {at: 2, request: {floor: L2}, every_s: 1}\n"
    expect = "  - {never: {kind: press}, while: {kind: truth, mode: fire}, settled_s: 1}\n"
    head = SHORT.replace("generic-registers", "seer-siemens-chengdu")
    found = verdict(tmp_path, text_of(do=do, expect=expect, head=head))
    assert not found.ok
    assert not found.expectations[0].ok
    assert not found.findings, "the judge knows that this map cannot show a fire"
    assert any("after in_mode.fire" in line for line in found.undetectable)


def test_what_the_judge_finds_fails_a_scenario_whatever_it_expects(tmp_path: Path) -> None:
    run = played(tmp_path, text_of(head=SHORT))
    assert verdict_of(run).ok
    run.findings.append(Finding(3.5, "lift", "said open and was not", "the car was elsewhere"))
    found = verdict_of(run)
    assert not found.ok
    assert "  FAILED  judge: 3.500 s  lift: said open and was not: the car was elsewhere" in lines(found)


def test_a_crash_fails_a_scenario(tmp_path: Path) -> None:
    """The loader refuses this fault; here it gets past it."""
    scenario = loaded(tmp_path, text_of(do="  - {at: 1, fault: overload}\n", head=SHORT))
    (step,) = scenario.steps
    impossible = replace(step.parts, fault=ForeignCell(Table.INPUT, 0, 1))
    run = play(replace(scenario, steps=(replace(step, parts=impossible),)))
    (crash,) = run.findings
    assert crash.rule == "crash"
    assert "Traceback" in crash.text
    assert not verdict_of(run).ok


TWO = """\
schema: 1
name: Two
controllers:
  east: {host: 192.0.2.1, map: generic-registers}
  west: {host: 192.0.2.2, map: generic-registers}
lifts:
  e: {controller: east, access: control, floors: {G: 1, U: 2}}
  w: {controller: west, access: control, floors: {G: 1, U: 2}}
"""


def test_the_lifts_of_a_site_are_judged_one_by_one(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text(TWO)
    do = "  - {at: 4, lift: e, request: {floor: U}, every_s: 1}\n  - {at: 5, lift: w, wire: half_open}\n"
    expect = "  - {never: {kind: state, floor: U}}\n  - {never: {kind: state, quality: offline}, after_s: 4, lift: e}\n"
    head = HEAD.replace("60", "25").replace("map: generic-registers", "site: site.yaml")
    found = verdict(tmp_path, text_of(do=do, expect=expect, head=head))
    told = [(one.expectation.partition(":")[0], one.ok) for one in found.expectations]
    assert told == [("e", False), ("w", True), ("e", True)]


CHANCE = text_of(
    head=SHORT,
    do="""\
  - {at: 0, people: {per_minute: 30, holders: 0.3}}
  - {at: 0.1, robot: {from: L2, to: L1}}
  - {at: 2, wire: {late_answer: 0.4, probability: 0.3}}
  - {at: 3, wire: {garbage_answer: {}, probability: 0.1}}
  - {at: 5, fault: {foreign_writer: {command: robot_mode}}, for_s: 5}
""",
)


def test_one_seed_gives_one_trace(tmp_path: Path) -> None:
    scenario = loaded(tmp_path, CHANCE)
    trace = play(scenario).trace
    assert play(scenario).trace == trace
    assert play(scenario, seed=5).trace != trace


def test_one_seed_gives_one_trace_in_every_process(tmp_path: Path) -> None:
    """This process has another hash seed than the other one: one of its own, or the one that it was given plus one."""
    file, here, there = tmp_path / "scenario.yaml", tmp_path / "here.jsonl", tmp_path / "there.jsonl"
    file.write_text(CHANCE)
    words = ["scenario", "run", str(file), "--trace"]
    assert CliRunner().invoke(app, [*words, str(here)]).exit_code == 0
    mine = os.environ.get("PYTHONHASHSEED", "random")
    environment = {**os.environ, "PYTHONHASHSEED": str(int(mine) + 1 if mine.isdigit() else 1)}
    command = [sys.executable, "-m", "lift_manager", *words, str(there)]
    subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, timeout=240, check=True)
    assert here.read_text() == there.read_text()


def test_every_kind_of_entry_and_every_field_comes_about(tmp_path: Path) -> None:
    """What a trace is documented to have, some run has: no field is there for nothing."""
    do = """\
  - {at: 1, robot: {from: L2, to: L4, holder: "fleet:r1", gives_up_after_s: 40}}
  - {at: 2, request: {floor: L3, holder: "fleet:r2", robot: in_place}}
  - {when: {kind: robot, does: rides}, wait_s: 6, fault: in_mode.fire, for_s: 5}
  - {at: 30, wire: {answer_with_exception: 4, times: 2}, for_s: 2}
  - {at: 40, acknowledge: {by: Dana}}
  - {at: 40.54, lock_out: {by: Dana, reason: painting}}
  - {at: 42, request: {floor: L3, holder: "fleet:r2"}}
  - {at: 43, end_lockout: {by: Dana}}
  - {at: 44, request: {floor: L2, holder: "fleet:r2"}}
  - {at: 45, end_lockout: {by: Dana}}
  - {at: 45.5, drain: {by: Dana, reason: update}}
  - {at: 46, wire: drop_request, for_s: 3}
  - {at: 46, request: {floor: L4, holder: "fleet:r2"}}
"""
    trace = played(tmp_path, text_of(do=do)).trace
    said = {(entry.kind, name) for entry in trace for name, value in entry.fields.items() if value not in (None, ())}
    missing = {(kind, name) for kind, about in KINDS.items() for name in about.fields} - said
    assert missing == {("state", "door.rear")}
