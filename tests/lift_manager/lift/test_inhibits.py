"""What forbids a request, a press, and the bytes of a press."""

from collections.abc import Callable

import pytest

from drivers.model import Result
from lift_manager.lift.events import CommandEnded, RestrictionKind
from lift_manager.lift.inhibits import blocked_by
from lift_manager.lift.inputs import (
    Acknowledge,
    AnnounceStop,
    CommitFailed,
    EndSession,
    Restrict,
    Stop,
    Unrestrict,
)
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refused
from register_maps.words import Door, Mode
from tests.lift_manager.lift.paper import HANDSHAKE, OTHER, ROBOT, PaperLift, command
from tests.support.rows import each_row

Does = Callable[[PaperLift], object]


def blocked(lift: PaperLift, name: str, press: int | None = None) -> str:
    return blocked_by(lift.config, lift.record, command(name), press, lift.moment) or ""


REFUSED: dict[str, tuple[Does, str]] = {
    "in fire": (lambda lift: lift.read(mode=Mode.FIRE), "fire_latched"),
    "in inspection": (lambda lift: lift.read(mode=Mode.INSPECTION), "mode"),
    "in independent service": (lambda lift: lift.read(mode=Mode.INDEPENDENT), "mode"),
    "out of service": (lambda lift: lift.read(mode=Mode.OUT_OF_SERVICE), "mode"),
    "with an unknown mode": (lambda lift: lift.read(mode=Mode.UNKNOWN), "mode"),
    "with the key switch off": (lambda lift: lift.read(robots_allowed=False), "mode"),
    "locked out": (lambda lift: lift.take(Restrict(RestrictionKind.LOCKOUT, "ann", "moving")), "locked_out"),
    "draining": (lambda lift: lift.take(Restrict(RestrictionKind.DRAIN, "ann", "moving")), "draining"),
    "when nothing can be written down": (lambda lift: lift.take(CommitFailed("disk full")), "not_recorded"),
    "when the manager stops": (lambda lift: lift.take(AnnounceStop()), "stopping"),
    "on a stale reading": (lambda lift: setattr(lift, "now", lift.now + 2.0), "offline"),
}


@each_row(("does", "code"), REFUSED.values())
def test_no_new_session_begins(does: Does, code: str) -> None:
    lift = PaperLift()
    lift.read()
    lift.commits = False
    does(lift)
    assert lift.refused("L2") == code
    assert lift.log == []


@pytest.mark.parametrize(
    ("site", "floor", "code"),
    [({"control": False}, "L2", "monitor_only"), ({}, "L9", "unknown_floor")],
    ids=["a lift that is only watched", "a floor that it does not have"],
)
def test_what_the_site_does_not_have_is_refused(site: dict[str, object], floor: str, code: str) -> None:
    lift = PaperLift(site=site)
    lift.read()
    assert lift.refused(floor) == code


BLOCKED: dict[str, tuple[Does, str]] = {
    "a stale reading": (lambda lift: setattr(lift, "now", lift.now + 2.0), "too old"),
    "a fire": (lambda lift: lift.read(fire=True), "nobody requests it"),
    "a lockout": (
        lambda lift: lift.take(Restrict(RestrictionKind.LOCKOUT, "ann", "x", at_once=True)),
        "nobody requests it",
    ),
    "the end of its session": (lambda lift: lift.take(EndSession(ROBOT, 3.0)), "has ended its session"),
    "the stop of the manager": (lambda lift: lift.take(Stop()), "nobody requests it"),
    "another floor": (lambda lift: lift.accept("L3"), "nobody requests it"),
}


@each_row(("does", "why"), BLOCKED.values())
def test_a_press_that_has_not_left_is_asked_about_once_more(does: Does, why: str) -> None:
    lift = PaperLift()
    lift.read()
    lift.accept("L2")
    press = lift.pressed[0].id
    assert not blocked(lift, "go_to", press)
    does(lift)
    assert why in blocked(lift, "go_to", press)


def test_a_press_of_a_session_that_is_over_is_none_of_the_next_one() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.called_to("L2")
    lift.accept("L2", robot=RobotWord.IN_PLACE)
    lift.answer()
    lift.commits = False
    lift.accept("L3", robot=RobotWord.IN_PLACE)
    go = lift.pressed[0]
    assert go.command == command("go", "L3")
    assert not blocked(lift, "go", go.id)
    lift.accept("L3", hold=False, robot=RobotWord.LEFT)
    assert "has ended" in blocked(lift, "go", go.id)
    lift.accept("L1", holder=OTHER)
    assert "has ended" in blocked(lift, "go", go.id)
    lift.answer(Result.REJECTED, "the session that requested it has ended")
    ended = {event.outcome.command: event.holder for event in lift.events if isinstance(event, CommandEnded)}
    assert ended[go.command] is None, "the next holder has requested nothing of the kind"


def test_a_hold_is_refreshed_until_an_announced_end_although_the_lift_is_locked_out() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    lift.take(Restrict(RestrictionKind.LOCKOUT, "ann", "moving"))
    assert lift.state.releases_in_s == 10.0
    assert not lift.state.ending
    assert not blocked(lift, "hold_door.front")
    lift.wait(10.5)
    assert lift.holder is None
    assert "hold_door.front" not in lift.holds


def test_the_word_that_a_robot_left_needs_no_session() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.read()
    assert not blocked(lift, "robot_left")
    assert blocked(lift, "call") == "the session has ended"


def test_the_close_button_is_not_pressed_while_a_robot_may_be_in_the_doorway() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.called_to("L2")
    assert lift.door is RobotDoor.OPEN
    assert "doorway" in blocked(lift, "close_door.front")


def test_a_fire_latches_until_a_person_acknowledges_and_not_while_it_burns() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    lift.read(mode=Mode.FIRE)
    assert lift.holder is None
    assert lift.holds == {}
    assert isinstance(lift.take(Acknowledge("ann")), Refused)
    lift.read(mode=Mode.NORMAL)
    assert lift.refused("L2") == "fire_latched"
    assert not isinstance(lift.take(Acknowledge("ann")), Refused)
    lift.accept("L2")


def test_robots_hear_of_a_fire_before_anything_is_released() -> None:
    lift = PaperLift(site={"fire_release_delay_s": 2.0})
    lift.called_to("L2")
    lift.read(mode=Mode.FIRE)
    assert "hold_door.front" in lift.holds
    assert lift.newest.wake_at == lift.now + 2.0 or lift.newest.wake_at <= lift.now + 2.0
    lift.wait(2.0)
    assert lift.holds == {}


def test_a_lockout_is_ended_by_a_person_and_a_second_one_does_not_replace_it() -> None:
    lift = PaperLift()
    lift.read()
    lift.take(Restrict(RestrictionKind.LOCKOUT, "ann", "moving"))
    second = lift.take(Restrict(RestrictionKind.LOCKOUT, "bob", "painting"))
    assert isinstance(second, Refused)
    assert "ann" in second.message
    lift.take(Unrestrict(RestrictionKind.LOCKOUT, "bob"))
    lift.accept("L2")


def test_people_have_their_turn_between_two_robots() -> None:
    lift = PaperLift(site={"between_sessions_s": 5.0})
    lift.called_to("L2")
    lift.accept("L2", hold=False)
    lift.read("L2", Door.CLOSED)
    lift.accept("L3", holder=OTHER)
    assert "people, whose turn it is" in lift.state.restrictions.waiting_for
    assert lift.log == ["go_to L2"]
    lift.wait(6.0)
    assert lift.log == ["go_to L2", "go_to L3"]
