"""What waits for the disk, what does not, and what becomes of it when the disk fails."""

import pytest
from pydantic import TypeAdapter

from lift_manager.lift.commands import CommandStatus, CommandType
from lift_manager.lift.events import CommandEnded, RestrictionKind
from lift_manager.lift.inputs import (
    AnnounceStop,
    CloseSession,
    CommitFailed,
    Committed,
    OpenSession,
    OutputChanged,
    Press,
    Restrict,
    Tick,
)
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.record import DurableRecord
from lift_manager.lift.refusals import Accepted
from lift_manager.lift.requests import SessionBegun
from register_maps.words import Door, Motion
from tests.lift_manager.lift.paper import HANDSHAKE, OTHER, PaperLift


def waiting() -> PaperLift:
    """A lift whose call is in no journal yet."""
    lift = PaperLift(commits=False)
    lift.read()
    lift.take(Committed(lift.record.sequence))
    lift.accept("L2")
    return lift


def test_a_press_belongs_to_the_sequence_number_of_its_step() -> None:
    lift = waiting()
    press = lift.record.presses[0]
    assert press.sequence == lift.record.sequence > lift.record.committed
    assert [action.id for action in lift.newest.actions if isinstance(action, Press)] == [press.id]


def test_a_reply_does_not_wait_for_the_disk() -> None:
    assert waiting().newest.reply == Accepted()


def test_a_press_that_is_not_recorded_is_rejected_and_never_revives() -> None:
    lift = waiting()
    lift.take(CommitFailed("disk full"))
    outcomes = [event.outcome for event in lift.events if isinstance(event, CommandEnded)]
    assert [(one.result, one.reason) for one in outcomes] == [("rejected", "not recorded: disk full")]
    assert lift.record.presses == ()
    lift.take(Committed(lift.record.sequence))
    assert lift.pressed == []


def test_a_press_that_is_on_the_disk_survives_a_later_failure() -> None:
    lift = waiting()
    lift.take(Committed(lift.record.sequence))
    lift.take(CommitFailed("disk full"))
    assert [str(press.command) for press in lift.record.presses] == ["go_to L2"]


def test_a_release_that_comes_before_the_commit_withdraws_the_press() -> None:
    lift = waiting()
    lift.accept("L1", hold=False)
    assert lift.record.presses == ()
    assert lift.pressed == []


def test_a_session_goes_on_while_nothing_can_be_written_down() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    lift.commits = False
    lift.take(CommitFailed("disk full"))
    lift.wait(1.0)
    lift.accept("L2")
    assert lift.door is RobotDoor.OPEN


def test_a_merely_renewed_lease_is_saved_at_most_every_ten_seconds() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    saved = lift.record.durable.session
    lift.accept("L2")
    lift.wait(5.0)
    lift.accept("L2")
    assert lift.record.durable.session is saved
    lift.wait(5.0)
    lift.accept("L2")
    assert lift.record.durable.session is not saved


def test_a_step_without_news_has_nothing_for_the_disk() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    before = lift.record.sequence
    lift.wait(2.0)
    lift.take(Tick())
    lift.take(OutputChanged(dict(lift.status)))
    assert lift.record.sequence == before


@pytest.mark.parametrize(
    ("name", "does"),
    [
        ("lockout", lambda lift: lift.take(Restrict(RestrictionKind.LOCKOUT, "ann", "moving"))),
        ("fire", lambda lift: lift.read(fire=True)),
        ("request", lambda lift: lift.accept("L2")),
    ],
)
def test_what_a_restart_must_know_has_a_sequence_number(name: str, does: object) -> None:
    lift = PaperLift(commits=False)
    lift.read()
    before = lift.record.sequence, lift.record.durable
    assert callable(does)
    does(lift)
    assert lift.record.sequence > before[0], name
    assert lift.record.durable != before[1], name


# -- restarts


def test_a_restart_presses_nothing_and_keeps_what_is_on() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    after = lift.restarted()
    assert {name: hold.begin for name, hold in after.holds.items()} == {"hold_door.front": False, "robot_mode": False}
    after.read()
    after.wait(2.0)
    assert after.log == []
    assert after.holder == lift.holder
    assert after.state.floor == "L2"


def test_a_call_that_was_not_pressed_waits_for_the_next_request() -> None:
    lift = waiting()
    lift.take(CommitFailed("disk full"))
    after = lift.restarted()
    after.read()
    after.wait(3.0)
    assert after.log == []
    assert "to send another request" in after.state.restrictions.waiting_for
    after.accept("L2")
    after.wait(0.5)
    assert after.log == ["go_to L2"]


def test_a_lease_runs_on_while_the_manager_does_not() -> None:
    lift = PaperLift(site={"lease_s": 20.0})
    lift.called_to("L2")
    assert lift.restarted(10.0).holder is not None
    assert lift.restarted(30.0).holder is None


def test_the_word_that_a_robot_left_is_owed_over_a_restart() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.called_to("L2")
    lift.accept("L3", robot=RobotWord.IN_PLACE)
    lift.answer()
    lift.wait(0.5)
    lift.read(None, Door.CLOSED, motion=Motion.UP)
    lift.read("L3", Door.OPEN, motion=Motion.STOPPED)
    lift.wait(1.0)
    lift.accept("L3", hold=False, robot=RobotWord.LEFT)
    after = lift.restarted()
    after.read()
    after.wait(0.5)
    assert after.log == ["robot_left"]


def test_a_robot_that_was_left_aboard_is_remembered_over_a_restart() -> None:
    lift = PaperLift(HANDSHAKE, site={"lease_s": 5.0})
    lift.called_to("L2")
    lift.wait(8.0)
    after = lift.restarted()
    after.read()
    assert after.refused("L1", holder=OTHER) == "occupancy_unknown"


def test_stopping_holds_a_crossed_door_for_a_moment_and_keeps_the_session_for_the_next_start() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    lift.take(AnnounceStop(3.0))
    assert lift.door is RobotDoor.MOVING
    assert "hold_door.front" in lift.holds
    assert lift.newest.wake_at <= lift.now + 3.0
    lift.wait(3.5)
    assert lift.holds == {}
    assert lift.restarted().holder is not None


def test_what_outlives_the_manager_is_plain_data() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.called_to("L2")
    lift.take(Restrict(RestrictionKind.DRAIN, "ann", "moving"))
    form = TypeAdapter(DurableRecord)
    assert form.validate_json(form.dump_json(lift.record.durable)) == lift.record.durable


def test_keys_give_the_same_session_and_command_after_a_restart() -> None:
    lift = PaperLift()
    lift.read()
    over = lift.open(key="first")
    lift.take(CloseSession(over.id, OTHER))
    info = lift.open(key="second")
    made = lift.command(CommandType.GO_TO, "L2", key="k")
    assert isinstance(made, CommandStatus)
    after = lift.restarted()
    after.read()
    same = after.take(OpenSession(OTHER, "first", new_id="another"))
    assert isinstance(same, SessionBegun)
    assert (same.session.id, same.is_new) == (over.id, False)
    assert after.open(key="second").id == info.id
    again = after.command(CommandType.GO_TO, "L2", key="k")
    assert isinstance(again, CommandStatus)
    assert (again.id, again.state) == (made.id, "unconfirmed")
    assert after.log == []
