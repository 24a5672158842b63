"""One trip, from the request to the robot's exit: what is pressed, held, published and released."""

from dataclasses import replace

import pytest

from drivers.model import OutputState, Result
from lift_manager.lift.events import SessionEnded, SessionOpened
from lift_manager.lift.inputs import EndSession, ForceRelease
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import EndReason
from register_maps.words import Door, Motion
from tests.lift_manager.lift.paper import FRONT, HANDSHAKE, OTHER, PLAIN, RMF, ROBOT, PaperLift


def ended(lift: PaperLift) -> list[EndReason]:
    return [event.reason for event in lift.events if isinstance(event, SessionEnded)]


def test_a_request_opens_a_session_and_presses_its_call_once() -> None:
    lift = PaperLift()
    lift.read()
    lift.accept("L2")
    assert [event.holder for event in lift.events if isinstance(event, SessionOpened)] == [ROBOT]
    assert lift.log == ["go_to L2"]
    for _ in range(5):
        lift.accept("L2")
        lift.wait(0.5)
    assert lift.log == ["go_to L2"]


def test_the_door_is_held_and_invites_once_it_was_read_while_held() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    assert lift.holds["hold_door.front"].begin
    assert lift.door is RobotDoor.OPEN


def test_a_door_that_was_read_before_its_hold_was_seen_invites_nobody() -> None:
    lift = PaperLift()
    lift.read()
    lift.accept("L2")
    lift.answer()
    lift.read("L2", Door.OPEN)
    before = lift.door
    lift.wait(1.0)
    assert (before, lift.door) == (RobotDoor.MOVING, RobotDoor.OPEN)


def test_a_car_on_its_way_is_not_reported_at_its_target() -> None:
    lift = PaperLift()
    lift.read()
    lift.accept("L2")
    lift.answer()
    lift.read("L2", Door.CLOSED, motion=Motion.UP)
    assert lift.state.floor is None
    assert lift.state.destination == "L2"


@pytest.mark.parametrize(
    ("hold", "stays", "reason"),
    [(False, False, EndReason.ARRIVED), (True, False, None), (False, True, None)],
    ids=["no hold: over on arrival", "hold: stays", "a session that stays: stays"],
)
def test_arrival_ends_a_session_that_wanted_no_more(hold: bool, stays: bool, reason: EndReason | None) -> None:
    lift = PaperLift()
    lift.called_to("L2", hold=hold, stays=stays)
    assert ended(lift) == ([] if reason is None else [reason])


def test_a_release_at_the_reported_floor_ends_the_session_and_releases_the_door() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    lift.accept("L2", hold=False)
    assert lift.holder is None
    assert lift.holds.keys() <= {"robot_mode"}
    assert lift.door is RobotDoor.MOVING, "a door that was released open invites nobody until it was seen shut"


def test_robot_mode_is_kept_until_the_car_stands() -> None:
    lift = PaperLift()
    lift.read()
    lift.accept("L2")
    lift.wait(1.0)
    lift.answer()
    lift.read(None, Door.CLOSED, motion=Motion.UP)
    lift.take(EndSession(ROBOT, 0.0))
    lift.wait(0.5)
    assert not lift.holds["robot_mode"].begin
    lift.read("L2", motion=Motion.STOPPED)
    assert "robot_mode" not in lift.holds


def test_another_caller_is_refused_and_waits_in_the_queue() -> None:
    lift = PaperLift(site={"infer_occupancy": True})
    lift.called_to("L2")
    assert lift.refused("L3", holder=RMF, stays=True) == "held"
    assert lift.state.waiting == 1
    lift.accept("L2", hold=False)
    assert lift.refused("L3", holder=OTHER) == "queued"
    lift.accept("L3", holder=RMF, stays=True)
    assert lift.holder == RMF


def test_a_call_that_fails_is_pressed_again_only_after_its_pause() -> None:
    lift = PaperLift()
    lift.read()
    lift.accept("L2")
    lift.answer(Result.UNCONFIRMED, "nothing showed")
    lift.wait(1.0)
    lift.accept("L2")
    assert lift.log == ["go_to L2"]
    lift.wait(1.5)
    lift.accept("L2")
    assert lift.log == ["go_to L2", "go_to L2"]


def test_a_press_that_was_not_granted_waits_for_the_grant() -> None:
    lift = PaperLift()
    lift.read()
    lift.accept("L2")
    lift.answer(Result.REJECTED, "robot_mode_on is missing", not_granted=True)
    lift.wait(0.5)
    assert lift.log == ["go_to L2", "go_to L2"]


def test_the_occupied_car_is_called_only_after_the_word_that_the_robot_is_in_place() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.called_to("L2")
    assert lift.log == ["call L2"]
    assert not lift.holds["call"].begin, "a held call is kept, never begun again"
    lift.accept("L3", robot=RobotWord.IN_PLACE)
    assert lift.log == ["call L2", "robot_in_place"]
    lift.answer()
    lift.wait(0.5)
    assert lift.log == ["call L2", "robot_in_place", "go L3"]
    assert "call" not in lift.holds


def test_the_lift_is_told_that_the_robot_left_and_only_then_the_call_is_released() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.called_to("L2")
    lift.accept("L3", robot=RobotWord.IN_PLACE)
    lift.answer()
    lift.wait(0.5)
    lift.answer()
    lift.read(None, Door.CLOSED, motion=Motion.UP)
    lift.read("L3", Door.OPEN, motion=Motion.STOPPED)
    lift.wait(1.0)
    lift.accept("L3", hold=False, robot=RobotWord.LEFT)
    assert lift.holder is None
    assert "go" in lift.holds
    lift.wait(0.5)
    assert lift.log[-1] == "robot_left"
    lift.answer()
    assert "go" not in lift.holds


def test_a_robot_that_may_have_boarded_is_not_sent_on_unheard() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.called_to("L2")
    assert lift.refused("L3") == "occupancy_unknown"


def test_a_session_that_ends_with_its_robot_aboard_alarms_and_keeps_others_off() -> None:
    lift = PaperLift(HANDSHAKE, site={"lease_s": 5.0})
    lift.called_to("L2")
    lift.accept("L3", robot=RobotWord.IN_PLACE)
    lift.answer()
    lift.read("L2", Door.CLOSED)
    lift.wait(6.0)
    assert lift.holder is None
    assert any("aboard_abandoned" in text for text in lift.alarms)
    assert lift.refused("L1", holder=OTHER) == "occupancy_unknown"
    assert lift.state.restrictions.maybe_aboard == ROBOT


def test_a_session_that_ends_on_arrival_invites_nobody_through_the_door_that_its_call_still_kept() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.read()
    lift.accept("L2", hold=False)
    lift.status["call"] = OutputState.ON
    lift.read(None, Door.CLOSED, motion=Motion.UP)
    lift.read("L2", Door.OPEN, motion=Motion.STOPPED)
    assert lift.holder is None, "the car is there before its press has an outcome"
    assert lift.door is RobotDoor.MOVING


def test_a_door_that_was_open_when_its_lift_was_taken_from_its_holder_invites_nobody_until_it_has_shut() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    lift.read("L3", Door.CLOSED)
    lift.status.clear()
    lift = lift.restarted()
    lift.read("L3", Door.OPEN)
    holder = lift.holder
    assert holder == ROBOT
    assert not lift.holds.get("hold_door.front")
    lift.take(ForceRelease("the guard", "it blocks the lift"))
    assert lift.holder is None
    lift.wait(1.0)
    told = [lift.door]
    lift.read("L3", Door.CLOSED)
    lift.read("L3", Door.OPEN)
    lift.wait(1.0)
    told.append(lift.door)
    assert told == [RobotDoor.MOVING, RobotDoor.OPEN]


def test_a_door_that_may_still_be_closing_when_its_lift_is_taken_has_not_shut_if_it_opens_again() -> None:
    lift = PaperLift(replace(PLAIN, open_contacts=frozenset({FRONT})))
    lift.called_to("L2")
    lift.status.clear()
    lift = lift.restarted()
    lift.read("L3", Door.CLOSED)  # its contact only says that it is not open
    lift.take(ForceRelease("the guard", "it blocks the lift"))
    lift.read("L3", Door.OPEN)
    lift.wait(1.0)
    told = [lift.door]
    lift.read("L3", Door.CLOSED)
    lift.wait(PLAIN.door_closes_within_s + 1.0)
    lift.read("L3", Door.OPEN)
    lift.wait(1.0)
    told.append(lift.door)
    assert told == [RobotDoor.MOVING, RobotDoor.OPEN]
