"""Commands within a session, and the session as its holder sees it."""

from dataclasses import replace

import pytest

from drivers.model import Result
from lift_manager.lift.commands import CommandState, CommandStatus, CommandType, SessionInfo
from lift_manager.lift.history import read_command, read_session
from lift_manager.lift.inputs import CloseSession, HandOver, OpenSession, RenewSession
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.refusals import Refused
from lift_manager.lift.requests import TURNS, SessionBegun
from register_maps.words import Door, Motion
from tests.lift_manager.lift.paper import HANDSHAKE, OTHER, PLAIN, ROBOT, PaperLift

LETS_GO = replace(PLAIN, released_after_s={"hold_door.front": 20.0})
"""A controller that lets go of its door after 20 s."""

GO_TO, HOLD, LET_GO, CLOSE = CommandType.GO_TO, CommandType.HOLD_DOOR, CommandType.RELEASE_DOOR, CommandType.CLOSE_DOOR


def opened(lift: PaperLift | None = None) -> PaperLift:
    lift = lift or PaperLift()
    lift.read()
    lift.open()
    return lift


def arrived(lift: PaperLift | None = None) -> PaperLift:
    lift = opened(lift)
    lift.command(GO_TO, "L2")
    lift.answer()
    lift.read(None, Door.CLOSED, motion=Motion.UP)
    lift.read("L2", Door.OPEN, motion=Motion.STOPPED)
    lift.wait(2.0)
    return lift


def status(lift: PaperLift, made: CommandStatus | Refused) -> CommandStatus:
    """Return a command as it is now."""
    assert isinstance(made, CommandStatus), made
    session = lift.record.session
    sessions = [past.info.id for past in lift.record.past_sessions]
    for one in (*([session.id] if session is not None else []), *sessions):
        found = read_command(lift.config, lift.record, one, None, made.id, lift.moment)
        if isinstance(found, CommandStatus):
            return found
    raise AssertionError(made)


def code(reply: object) -> str:
    assert isinstance(reply, Refused), reply
    return reply.code


@pytest.mark.parametrize(
    ("result", "state"),
    [
        (Result.CONFIRMED, CommandState.CONFIRMED),
        (Result.REJECTED, CommandState.REJECTED),
        (Result.UNCONFIRMED, CommandState.UNCONFIRMED),
    ],
)
def test_a_call_ends_as_its_press_does(result: Result, state: CommandState) -> None:
    lift = opened()
    made = lift.command(GO_TO, "L2")
    assert status(lift, made).state is CommandState.PENDING
    lift.answer(result, "as told")
    assert status(lift, made).state is state


def test_a_door_is_confirmed_held_and_let_go_by_its_output() -> None:
    lift = arrived()
    held = lift.command(HOLD)
    assert status(lift, held).state is CommandState.CONFIRMED
    gone = lift.command(LET_GO)
    lift.wait(0.5)
    assert status(lift, gone).state is CommandState.CONFIRMED
    assert "hold_door.front" not in lift.holds


def test_the_close_button_is_pressed_once_the_door_is_let_go() -> None:
    lift = arrived()
    lift.command(CommandType.ROBOT_IN_PLACE)
    made = lift.command(CLOSE)
    lift.wait(0.5)
    assert lift.log[-1] == "close_door.front"
    lift.answer()
    assert status(lift, made).state is CommandState.CONFIRMED


def test_a_newer_command_takes_the_place_of_a_pending_one() -> None:
    lift = opened()
    first = lift.command(GO_TO, "L2")
    lift.command(GO_TO, "L3")
    assert status(lift, first).reason == "another request took its place"


def test_commands_end_with_their_session() -> None:
    lift = opened()
    made = lift.command(GO_TO, "L2")
    assert lift.record.session is not None
    lift.take(CloseSession(lift.record.session.id, OTHER, RobotWord.LEFT))
    assert status(lift, made).state is CommandState.UNCONFIRMED


@pytest.mark.parametrize(
    ("kind", "floor", "refusal"),
    [(HOLD, None, "not_now"), (GO_TO, "L9", "unknown_floor"), (CLOSE, None, "not_now")],
    ids=["a door before any floor", "a floor that is not there", "a door nowhere"],
)
def test_what_makes_no_sense_is_refused(kind: CommandType, floor: str | None, refusal: str) -> None:
    assert code(opened().command(kind, floor)) == refusal


def test_a_key_gives_the_same_command_and_refuses_another() -> None:
    lift = opened()
    first = lift.command(GO_TO, "L2", key="k")
    assert isinstance(first, CommandStatus)
    again = lift.command(GO_TO, "L2", key="k")
    assert isinstance(again, CommandStatus)
    assert again.id == first.id
    assert code(lift.command(GO_TO, "L3", key="k")) == "key_reused"


def test_a_key_gives_the_same_session_while_it_lasts_and_after() -> None:
    lift = opened()
    session = lift.record.session
    assert session is not None
    lift.take(CloseSession(session.id, OTHER))
    info = lift.open(key="k")
    again = lift.take(OpenSession(OTHER, "k", new_id="another"))
    assert isinstance(again, SessionBegun)
    assert (again.session.id, again.is_new) == (info.id, False)
    lift.take(CloseSession(info.id, OTHER))
    over = lift.take(OpenSession(OTHER, "k", new_id="another"))
    assert isinstance(over, SessionBegun)
    assert over.session.over is not None
    assert code(lift.take(OpenSession(OTHER, "k", 30.0, new_id="another"))) == "key_reused"


def test_a_session_is_known_to_its_holder_only() -> None:
    lift = opened()
    assert lift.record.session is not None
    session = lift.record.session.id
    assert isinstance(read_session(lift.config, lift.record, session, OTHER, lift.moment), SessionInfo)
    assert code(read_session(lift.config, lift.record, session, ROBOT, lift.moment)) == "no_such_session"
    assert code(lift.take(RenewSession(session, ROBOT))) == "no_such_session"


def test_handing_over_gives_a_new_id_and_ends_it_for_the_holder() -> None:
    lift = arrived()
    assert lift.record.session is not None
    old = lift.record.session.id
    info = lift.take(HandOver(OTHER, ROBOT, "a new id", old))
    assert isinstance(info, SessionInfo)
    assert (info.id, info.holder, lift.holder) == ("a new id", ROBOT, ROBOT)
    assert code(lift.take(RenewSession(old, OTHER))) == "session_over"
    assert "hold_door.front" in lift.holds


def test_a_session_that_is_closed_without_a_word_leaves_a_doubt_where_its_robot_may_be() -> None:
    lift = arrived(PaperLift(HANDSHAKE))
    assert lift.record.session is not None
    info = lift.take(CloseSession(lift.record.session.id, OTHER))
    assert isinstance(info, SessionInfo)
    assert info.robot is Occupancy.MAY_BOARD
    assert lift.refused("L3", holder=ROBOT) == "occupancy_unknown"


def test_a_spent_hold_is_released_and_the_holder_keeps_the_lift() -> None:
    lift = arrived(PaperLift(site={"max_session_hold_s": 20.0, "clear_s": 5.0}))
    lift.wait(21.0)
    assert "hold_door.front" not in lift.holds
    assert lift.holder == OTHER
    assert any("was held for 20 s" in text for text in lift.alarms)


def test_open_is_withdrawn_clear_s_before_the_door_is_released() -> None:
    lift = arrived(PaperLift(site={"max_session_hold_s": 20.0, "clear_s": 5.0}))
    lift.wait(16.0)
    assert lift.door != "open"
    assert "hold_door.front" in lift.holds


def test_a_hold_is_spent_when_the_controller_lets_go_and_everything_said_of_it_names_the_controller() -> None:
    lift = arrived(PaperLift(LETS_GO, site={"clear_s": 5.0}))
    lift.wait(12.0)
    assert lift.door == "open"
    lift.wait(4.0)
    assert (lift.door, "hold_door.front" in lift.holds) == ("moving", True)
    lift.wait(5.0)
    assert "hold_door.front" not in lift.holds
    assert any("was held for 20 s, as long as the controller allows" in text for text in lift.alarms)
    refused = lift.command(HOLD)
    assert isinstance(refused, Refused)
    assert "for 20 s, as long as the controller allows" in refused.message


def test_the_shorter_of_what_site_and_controller_allow_ends_a_hold() -> None:
    lift = arrived(PaperLift(LETS_GO, site={"max_session_hold_s": 15.0, "clear_s": 5.0}))
    lift.wait(16.0)
    assert any("was held for 15 s, as long as the site allows" in text for text in lift.alarms)
    assert lift.config.hold_limit == (15.0, "the site")


def test_a_hold_that_is_let_go_and_requested_again_before_it_came_to_rest_is_no_fresh_one_for_the_controller() -> None:
    lift = arrived(PaperLift(LETS_GO, site={"clear_s": 5.0}))
    lift.wait(8.0)
    lift.obeys = False
    lift.command(LET_GO)
    lift.command(HOLD)
    lift.obeys = True
    lift.wait(1.0)
    left_s = lift.state.releases_in_s
    assert left_s is not None
    assert left_s < 11.0
    lift.command(LET_GO)
    lift.wait(1.0)
    lift.command(HOLD)
    lift.wait(1.0)
    assert lift.state.releases_in_s == pytest.approx(19.0)


def test_a_caller_that_changes_its_mind_too_often_is_refused() -> None:
    lift = opened()
    codes = [
        code(made)
        for made in (lift.command(GO_TO, f"L{2 + n % 2}") for n in range(TURNS + 3))
        if isinstance(made, Refused)
    ]
    assert set(codes) == {"too_often"}
