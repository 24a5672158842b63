"""The judge of who gets the lift finds each way to put a robot before people, or one robot before another."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from lift_manager.lab.world.lift_under_test import Excuse, FloorEvidence, MapEvidence, SuspectValues
from lift_manager.lab.world.oracle import Oracle
from lift_manager.lab.world.rules import Rules
from lift_manager.lab.world.witness import RESTART, FaultChange, FloorRequest
from lift_manager.lift.events import (
    Acknowledged,
    Cause,
    HandedOver,
    Restriction,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import Advice, EndReason, Holder
from lift_manager.lift.state import LiftState
from register_maps.words import Door, Mode, Side
from simulator.faults import Fault, ForeignWriter, FrozenRegisters, PowerLoss, Stopped
from tests.lift_manager.lab.test_oracle import DRIVES, HELD, ROBOT, SHUT, STANDS_OPEN, judge, polled, state

OTHER = Holder("fleet", "r2")
NOON = datetime(2026, 1, 5, 12, tzinfo=UTC)
ROPES = Restriction(RestrictionKind.LOCKOUT, "the guard", "new ropes", NOON)
LOCKED_OUT = RestrictionBegun("lift", ROPES)
LOCKOUT_OVER = RestrictionEnded("lift", "the guard", NOON, ROPES)
ACKNOWLEDGED = Acknowledged("lift", "the guard", NOON, (Cause.FIRE,))


def book(**about: object) -> tuple[Oracle, Rules]:
    oracle = judge(**about)
    rules = Rules(oracle)
    rules.on_truth(0.0, "lift", STANDS_OPEN)
    return oracle, rules


def found(oracle: Oracle) -> list[str]:
    return [finding.rule for finding in oracle.findings]


def opened(holder: Holder = ROBOT) -> SessionOpened:
    return SessionOpened("lift", holder, "L1")


def ended(reason: EndReason = EndReason.RELEASED) -> SessionEnded:
    return SessionEnded("lift", ROBOT, reason, "", None)


def request(floor: str = "L1", holder: Holder = ROBOT) -> FloorRequest:
    return FloorRequest("lift", holder, floor, hold_door=True)


def on_fire() -> LiftState:
    return state(mode=Mode.FIRE, holder=None)


def test_a_robot_that_is_let_in_after_a_fire_is_found_until_a_person_has_looked() -> None:
    oracle, rules = book()
    rules.on_state(1.0, "lift", on_fire())
    rules.on_request(9.0, request(), None)
    rules.on_truth(9.2, "lift", STANDS_OPEN)
    assert found(oracle) == ["let in after a fire"]
    rules.on_request(10.0, request(), None)
    rules.on_event(10.0, ACKNOWLEDGED)
    rules.on_truth(10.2, "lift", STANDS_OPEN)
    rules.on_request(19.0, request(), None)
    rules.on_truth(19.2, "lift", STANDS_OPEN)
    assert found(oracle) == ["let in after a fire"]


def test_a_press_after_a_fire_is_found_over_a_restart_too() -> None:
    oracle, rules = book()
    rules.on_state(1.0, "lift", on_fire())
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_request(8.0, request(), None)
    rules.on_press(9.0, "lift", frozenset({"go_to"}))
    assert found(oracle) == ["pressed after a fire"]


def test_a_fire_that_is_acknowledged_while_it_is_on_is_found() -> None:
    oracle, rules = book()
    rules.on_truth(0.9, "lift", replace(STANDS_OPEN, mode=Mode.FIRE))
    rules.on_state(1.0, "lift", on_fire())
    rules.on_event(2.0, ACKNOWLEDGED)
    assert found(oracle) == ["acknowledged while on"]


@pytest.mark.parametrize(
    ("advice", "shuts", "findings"),
    [
        (Advice.CLEAR_DOORWAY, False, ["said open after it was taken"]),
        (Advice.CLEAR_DOORWAY, True, []),
        (None, False, []),
    ],
    ids=["still open", "shut and opened again", "ended by its holder"],
)
def test_a_lift_that_says_open_after_it_was_taken_from_its_holder_is_found_until_its_door_has_shut(
    advice: Advice | None, shuts: bool, findings: list[str]
) -> None:
    oracle, rules = book()
    is_open, is_shut = {Side.FRONT: Door.OPEN}, {Side.FRONT: Door.CLOSED}
    rules.on_event(1.0, opened())
    rules.on_state(2.0, "lift", state(robot_door=RobotDoor.MOVING, doors=is_open))
    rules.on_event(3.0, SessionEnded("lift", ROBOT, EndReason.LEASE, "", advice))
    if shuts:
        rules.on_state(4.0, "lift", state(holder=None, robot_door=RobotDoor.CLOSED, doors=is_shut))
    rules.on_state(5.0, "lift", state(holder=None, doors=is_open))
    assert found(oracle) == findings


def test_whoever_is_let_in_or_presses_in_a_lockout_is_found() -> None:
    oracle, rules = book()
    rules.on_event(1.0, LOCKED_OUT)
    rules.on_request(9.0, request(), None)
    rules.on_truth(9.1, "lift", STANDS_OPEN)
    rules.on_press(9.1, "lift", frozenset({"go_to"}))
    assert found(oracle) == ["let in despite a lockout", "pressed in a lockout"]
    rules.on_event(10.0, LOCKOUT_OVER)
    rules.on_request(12.0, request(), None)
    rules.on_truth(12.1, "lift", STANDS_OPEN)
    assert len(found(oracle)) == 2


@pytest.mark.parametrize(
    ("stranger", "at", "findings"),
    [
        ("robot_mode", 4.0, []),
        ("hold_door.front", 4.0, ["pressed in a lockout"]),
        ("robot_mode", 12.0, ["pressed in a lockout"]),
    ],
    ids=["taken by somebody", "who writes another output", "after the announced end"],
)
def test_robot_mode_that_somebody_takes_may_be_written_again_until_the_announced_end_of_a_locked_out_session(
    stranger: str, at: float, findings: list[str]
) -> None:
    oracle, rules = book(clear_s=10.0)
    for witness in (oracle, rules):
        witness.on_fault(0.5, FaultChange("lift", ForeignWriter(stranger, pressed=False), began=True))
    rules.on_event(1.0, LOCKED_OUT)
    rules.on_truth(at - 1.0, "lift", STANDS_OPEN)
    rules.on_request(at - 0.5, request(), None)
    rules.on_press(at, "lift", frozenset({"robot_mode"}))
    assert found(oracle) == findings


def test_an_invitation_behind_a_fire_that_nobody_has_acknowledged_is_found() -> None:
    oracle, rules = book()
    rules.on_state(1.0, "lift", on_fire())
    rules.on_state(1.5, "lift", state(holder=None))  # this was on its way
    assert found(oracle) == []
    rules.on_state(9.0, "lift", state(holder=None))
    assert found(oracle) == ["said open after a fire"]
    rules.on_event(10.0, ACKNOWLEDGED)
    rules.on_state(19.0, "lift", state(holder=None))
    assert found(oracle) == ["said open after a fire"]


def test_an_invitation_behind_a_lockout_is_found_until_it_is_over() -> None:
    oracle, rules = book()
    rules.on_event(1.0, LOCKED_OUT)
    rules.on_state(9.0, "lift", state(holder=None))
    assert found(oracle) == ["said open in a lockout"]
    rules.on_event(10.0, LOCKOUT_OVER)
    rules.on_state(19.0, "lift", state(holder=None))
    assert found(oracle) == ["said open in a lockout"]


def test_two_holders_are_found_whether_or_not_a_session_is_opened_for_the_second() -> None:
    oracle, rules = book()
    rules.on_event(1.0, opened())
    rules.on_request(2.0, request(holder=OTHER), None)
    rules.on_truth(2.2, "lift", STANDS_OPEN)
    assert found(oracle) == ["two holders"]
    rules.on_event(3.0, opened(OTHER))
    assert found(oracle) == ["two holders", "two holders"]


def test_a_lift_that_changes_hands_between_two_turns_of_the_loop_has_one_holder() -> None:
    oracle, rules = book()
    rules.on_event(1.0, opened())
    rules.on_request(2.0, request(holder=OTHER), None)
    rules.on_event(2.0, ended())
    rules.on_event(2.0, opened(OTHER))
    rules.on_truth(2.2, "lift", STANDS_OPEN)
    assert found(oracle) == []


def test_a_press_in_peoples_turn_is_found() -> None:
    oracle, rules = book(between_sessions_s=5.0)
    rules.on_event(1.0, opened())
    rules.on_press(1.1, "lift", frozenset({"go_to"}))
    rules.on_event(8.0, ended())
    rules.on_event(9.0, opened())
    rules.on_press(10.0, "lift", frozenset({"go_to"}))
    assert found(oracle) == ["pressed in people's turn"]


def test_a_session_that_pressed_nothing_costs_nobody_a_turn() -> None:
    oracle, rules = book(between_sessions_s=5.0)
    rules.on_event(1.0, opened())
    rules.on_event(2.0, ended())
    rules.on_event(2.5, opened())
    rules.on_press(3.0, "lift", frozenset({"go_to"}))
    assert found(oracle) == []


def test_the_same_call_that_is_pressed_again_at_once_is_found_unless_another_floor_was_asked_between() -> None:
    oracle, rules = book()
    called = replace(DRIVES, given=(("go_to", 1),))
    rules.on_truth(1.0, "lift", called)
    rules.on_request(1.0, request("L2"), None)
    rules.on_press(1.0, "lift", frozenset({"go_to"}))
    rules.on_request(1.5, request("L1"), None)
    rules.on_request(1.6, request("L2"), None)
    rules.on_press(1.7, "lift", frozenset({"go_to"}))
    assert found(oracle) == []
    rules.on_press(2.0, "lift", frozenset({"go_to"}))
    assert found(oracle) == ["pressed again"]
    rules.on_press(4.5, "lift", frozenset({"go_to"}))
    assert len(found(oracle)) == 1


def test_robot_mode_that_is_dropped_under_way_is_found() -> None:
    oracle, rules = book()
    driving = replace(DRIVES, robot_mode=True, given=(("robot_mode", 1),))
    polled(oracle, 15.0, driving)
    rules.on_truth(1.0, "lift", driving)
    rules.on_state(14.9, "lift", state())
    rules.on_truth(15.0, "lift", DRIVES)
    assert found(oracle) == ["robot mode dropped under way"]


def test_robot_mode_that_is_dropped_because_of_a_fire_or_where_the_car_stands_is_right() -> None:
    oracle, rules = book()
    driving = replace(DRIVES, robot_mode=True, given=(("robot_mode", 1),))
    polled(oracle, 15.0, driving)
    rules.on_truth(1.0, "lift", driving)
    rules.on_state(4.9, "lift", on_fire())
    rules.on_truth(5.0, "lift", DRIVES)
    rules.on_truth(6.0, "lift", driving)
    rules.on_truth(7.0, "lift", STANDS_OPEN)
    assert found(oracle) == []


def test_an_invitation_without_our_hold_or_without_robot_mode_is_found() -> None:
    oracle, rules = book(holds=frozenset({"hold_door.front"}), shows=MapEvidence(robot_mode=True))
    rules.on_truth(1.0, "lift", HELD)
    rules.on_state(1.5, "lift", state())
    assert found(oracle) == []
    rules.on_truth(2.0, "lift", replace(STANDS_OPEN, robot_mode=False))
    rules.on_state(9.0, "lift", state())
    assert found(oracle) == ["said open and not held", "said open without robot mode"]


def test_a_lift_that_nobody_holds_may_stand_open_by_itself() -> None:
    oracle, rules = book(holds=frozenset({"hold_door.front"}), shows=MapEvidence(robot_mode=True))
    rules.on_truth(2.0, "lift", replace(STANDS_OPEN, robot_mode=False))
    rules.on_state(9.0, "lift", state(holder=None))
    assert found(oracle) == []


def test_what_is_pressed_after_a_restart_before_anybody_has_asked_is_found() -> None:
    oracle, rules = book()
    rules.on_request(1.0, request(), None)
    rules.on_event(1.0, opened())
    rules.on_press(1.1, "lift", frozenset({"go_to"}))
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_event(3.1, SessionRestored("lift", ROBOT, "L1", ""))
    assert found(oracle) == []
    rules.on_press(4.0, "lift", frozenset({"robot_mode"}))
    assert found(oracle) == ["pressed by a restart"]
    rules.on_request(5.0, request(), None)
    rules.on_press(6.0, "lift", frozenset({"hold_door.front"}))
    assert found(oracle) == ["pressed by a restart"]


@pytest.mark.parametrize("output", ["hold_door.front", "robot_mode"])
@pytest.mark.parametrize("frozen_at", [1.5, 2.5])
def test_an_output_that_frozen_registers_still_show_is_kept_by_a_restart(output: str, frozen_at: float) -> None:
    frozen_shows = Excuse(frozenset({SuspectValues.OUTPUT}), None)
    oracle, rules = book(excuses={"frozen_registers": frozen_shows})
    for witness in (oracle, rules):
        witness.on_truth(1.0, "lift", replace(STANDS_OPEN, given=((output, 1),)))
    frozen = FaultChange("lift", FrozenRegisters(), began=True)
    for at, happens in sorted([(2.0, None), (frozen_at, frozen)], key=lambda one: one[0]):
        for witness in (oracle, rules):
            if happens is None:
                witness.on_truth(at, "lift", STANDS_OPEN)
            else:
                witness.on_fault(at, happens)
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_press(4.0, "lift", frozenset({output}))
    assert found(oracle) == ([] if frozen_at < 2.0 else ["pressed by a restart"])


def test_a_robot_that_says_it_is_inside_has_asked_for_the_lift() -> None:
    oracle, rules = book()
    rules.on_truth(2.0, "lift", STANDS_OPEN)
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_request(5.0, replace(request("L2"), hold_door=False, robot=RobotWord.IN_PLACE), None)
    rules.on_press(6.0, "lift", frozenset({"robot_mode"}))
    assert found(oracle) == []


def test_a_word_to_let_go_is_no_wish_for_the_lift() -> None:
    oracle, rules = book()
    rules.on_truth(2.0, "lift", STANDS_OPEN)
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_request(5.0, replace(request("L2"), hold_door=False, robot=RobotWord.LEFT), None)
    rules.on_press(6.0, "lift", frozenset({"robot_mode"}))
    assert found(oracle) == ["pressed by a restart"]


@pytest.mark.parametrize(
    ("fault", "findings"),
    [(None, ["pressed again after a restart"]), (Stopped(), []), (PowerLoss(), [])],
    ids=["shown", "registers stand still", "the output lost its power"],
)
def test_a_call_that_stands_is_not_pressed_again_after_a_restart(fault: Fault | None, findings: list[str]) -> None:
    oracle, rules = book(excuses={"stopped": Excuse(frozenset({SuspectValues.EFFECT, SuspectValues.OUTPUT}), None)})
    called = replace(SHUT, calls=frozenset({"L1"}), given=(("go_to", 0),))
    rules.on_request(1.0, request(), None)
    rules.on_truth(1.1, "lift", called)
    rules.on_press(1.1, "lift", frozenset({"go_to"}))
    if fault is not None:
        for witness in (oracle, rules):
            witness.on_fault(2.0, FaultChange("lift", fault, began=True))
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_request(4.0, request(), None)
    rules.on_truth(9.0, "lift", called)
    rules.on_press(9.0, "lift", frozenset({"go_to"}))
    assert found(oracle) == findings
    assert bool(oracle.excused) is isinstance(fault, Stopped)


@pytest.mark.parametrize(
    ("stranger", "findings"),
    [("go_to", []), ("hold_door.front", ["pressed again after a restart"])],
    ids=["cleared by somebody else", "who writes another output"],
)
def test_a_held_call_that_somebody_cleared_before_a_restart_may_be_pressed_again(
    stranger: str, findings: list[str]
) -> None:
    oracle, rules = book()
    called = replace(SHUT, calls=frozenset({"L1"}), given=(("go_to", 0),))
    cleared = replace(called, given=())
    rules.on_request(1.0, request(), None)
    rules.on_truth(1.1, "lift", called)
    rules.on_press(1.1, "lift", frozenset({"go_to"}))
    writer = FaultChange("lift", ForeignWriter(stranger, pressed=False), began=True)
    for witness in (oracle, rules):
        witness.on_fault(2.0, writer)
    rules.on_truth(2.1, "lift", cleared)
    for witness in (oracle, rules):
        witness.on_fault(2.5, replace(writer, began=False))
    rules.on_fault(30.0, FaultChange("manager", RESTART, began=True))
    rules.on_request(31.0, request(), None)
    rules.on_truth(31.1, "lift", called)
    rules.on_press(31.1, "lift", frozenset({"go_to"}))
    assert found(oracle) == findings
    assert bool(oracle.excused) is not bool(findings)


def test_a_request_of_a_session_that_stays_is_a_wish_for_the_lift_also_where_the_car_stands() -> None:
    oracle, rules = book()
    rules.on_truth(2.0, "lift", STANDS_OPEN)
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_request(5.0, replace(request("L2"), hold_door=False, stays=True), None)
    rules.on_press(6.0, "lift", frozenset({"robot_mode"}))
    assert found(oracle) == []


@pytest.mark.parametrize("told_by_doors", [True, False])
def test_a_request_without_a_hold_is_a_call_where_only_an_open_door_tells_that_the_car_is_there(
    told_by_doors: bool,
) -> None:
    oracle, rules = book(shows=MapEvidence(floor_by=FloorEvidence.DOOR if told_by_doors else FloorEvidence.SWITCH))
    rules.on_truth(2.0, "lift", replace(STANDS_OPEN, open_at=None, doors_shut=True))
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_request(5.0, replace(request("L2"), hold_door=False), None)
    rules.on_press(6.0, "lift", frozenset({"call"}))
    assert found(oracle) == ([] if told_by_doors else ["pressed by a restart"])


@pytest.mark.parametrize("said_at", ["L1", None, "L2"])
def test_a_request_without_a_hold_is_a_call_where_the_manager_is_not_shown_its_floor(said_at: str | None) -> None:
    oracle, rules = book()
    rules.on_truth(2.0, "lift", STANDS_OPEN)  # at L2
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_state(4.0, "lift", state(floor=said_at, robot_door=RobotDoor.CLOSED))
    rules.on_request(5.0, replace(request("L2"), hold_door=False), None)
    rules.on_press(6.0, "lift", frozenset({"go_to"}))
    assert found(oracle) == (["pressed by a restart"] if said_at == "L2" else [])


def test_the_same_holder_may_go_on_after_a_restart_and_nobody_else() -> None:
    oracle, rules = book()
    rules.on_event(1.0, opened())
    rules.on_fault(3.0, FaultChange("manager", RESTART, began=True))
    rules.on_event(3.1, SessionRestored("lift", ROBOT, "L1", ""))
    rules.on_event(4.0, HandedOver("lift", ROBOT, OTHER))
    assert found(oracle) == []
    rules.on_event(5.0, opened())
    assert found(oracle) == ["two holders"]


def test_a_lift_that_somebody_gives_away_who_does_not_hold_it_is_found() -> None:
    oracle, rules = book()
    rules.on_event(1.0, opened())
    rules.on_event(2.0, HandedOver("lift", OTHER, ROBOT))
    assert found(oracle) == ["two holders"]
