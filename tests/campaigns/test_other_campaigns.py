"""The matrix, the rules taken out, and the long day, each on a small scale."""

import pytest

from lift_manager.commissioning.detection import FaultEffect
from lift_manager.lab.world.fault_names import fault_name
from register_maps.words import Mode
from simulator.faults import ForeignWriter, InMode, StuckDoor
from simulator.wire_faults import DropAnswer
from tests.campaigns import matrix, mutants
from tests.campaigns.long_day import Day, live
from tests.campaigns.matrix import Cell, Phase, broken_promises, cell, table
from tests.campaigns.playing import Played
from tests.campaigns.schedules import Schedule
from tests.campaigns.truth import quiet
from tests.support.rows import each_row


@pytest.fixture(autouse=True)
def _quiet() -> object:
    with quiet():
        yield


@pytest.mark.parametrize("phase", Phase)
def test_a_fire_is_told_in_every_phase_of_a_ride(phase: Phase) -> None:
    played = cell("generic-registers", InMode(Mode.FIRE), phase)
    assert "fire after" in played.told
    assert "refused: mode" in played.told or "refused: fire_latched" in played.told
    assert list(broken_promises([played])) == []


@pytest.mark.parametrize("fault", [StuckDoor(), DropAnswer()])
def test_what_a_robot_is_told_stands_in_the_table(fault: object) -> None:
    played = cell("generic-registers", fault, Phase.DOOR_HELD)  # type: ignore[arg-type]  # one of each kind
    assert f"| {played.fault} |" in table([played])
    assert played.told in table([played])


def test_what_could_not_be_tried_stands_in_the_table_with_its_reason() -> None:
    played = cell("adam-io", ForeignWriter("robot_mode"), Phase.IDLE)
    assert played.told == "not tried: the map has no such command"
    assert played.told in table([played])
    assert "thingweb-elevator" in table([played])


def test_a_lie_that_should_have_been_detected_is_a_broken_promise() -> None:
    late = Cell("generic-registers", "frozen_registers", Phase.IDLE, "open", ((FaultEffect.OPEN, 9.0),), ())
    never = Cell("generic-registers", "stuck_door", Phase.IDLE, "open", ((FaultEffect.OPEN, 0.1),), ())
    worse = Cell("generic-registers", "stuck_door", Phase.IDLE, "open", (), ("a crash",))
    assert len(list(broken_promises([late, never, worse]))) == 3
    undetectable = Cell("wago-750", "frozen_registers", Phase.IDLE, "open", ((FaultEffect.OPEN, 19.0),), ())
    assert list(broken_promises([undetectable])) == []


@each_row("mutant", mutants.MUTANTS)
def test_every_rule_that_the_judge_is_tried_with_is_still_in_the_program(mutant: mutants.Mutant) -> None:
    for edit in mutant.edits:
        assert (mutants.ROOT / edit.file).read_text().count(edit.old) == 1, edit


def test_a_few_lifts_live_for_a_while() -> None:
    day = live(lifts=2, hours=0.05, seed=1)
    assert day.played.findings == []
    assert day.played.judged > 100


def test_memory_that_grows_fails_the_day() -> None:
    played = Played(Schedule(1, "all", 1.0, 900.0, 300.0, 5.0, ()), [])
    assert not Day(1, 8.0, played, [(1.0, 90), (4.0, 100), (8.0, 104)]).failed
    assert Day(1, 8.0, played, [(1.0, 90), (4.0, 100), (8.0, 106)]).failed


def test_every_kind_of_fault_has_its_column() -> None:
    assert len({fault_name(fault) for fault in matrix.device_faults()}) > 20
    assert len(matrix.WIRE) >= 25
