"""Grant, update, ignore, end (open-rmf 1.6), and what other adapters get wrong there (open-rmf 2)."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from lift_manager.plain.rmf import HeldBy
from lift_manager.rmf.lift_sessions import (
    DEMAND_MAX_AGE_S,
    PASS_ON_S,
    REFUSAL_PAUSE_S,
    RENEW_S,
    REPEAT_S,
    UNDELIVERED_S,
)
from lift_manager.rmf.lift_state import PERIOD_S
from lift_manager.rmf.messages import (
    DOOR_MOVING,
    DOOR_OPEN,
    MODE_OFFLINE,
    LiftRequest,
)
from lift_manager.rmf.port import NOT_SENT, UNREACHABLE, Answer, EndOfSession, SessionDemand
from tests.lift_manager.rmf.bench import A, B, bench, ends, riding, wants
from tests.support.rows import each_row

REST = HeldBy("api", "amr-7")


def test_the_first_request_for_a_free_lift_is_granted_once_the_manager_has_said_yes() -> None:
    lift = bench(slow=True)
    lift.receive(wants(A, "Level 2"))
    assert lift.state.session_id == ""
    lift.answer_all()
    lift.step()
    assert lift.sent_requests == [SessionDemand("lift", A, "L2", hold_door=True)]
    assert (lift.state.session_id, lift.state.destination_floor) == (A, "Level 2")


def test_a_session_stays_on_the_wire_after_arrival() -> None:
    """rmf_ros2 #314."""
    lift = riding()
    lift.elapse(400)
    assert (lift.state.session_id, lift.state.door_state, lift.state.current_floor) == (A, DOOR_OPEN, "Level 2")


def test_a_request_said_again_is_no_new_command() -> None:
    """A10: RMF sends one to three copies with every LiftState."""
    lift = riding()
    before = len(lift.sent_requests)
    for _ in range(50):
        lift.receive(*[wants(A, "Level 2")] * 3)
    assert len(lift.sent_requests) == before


def test_a_demand_that_the_lift_does_not_show_is_passed_on_again_but_not_with_every_message() -> None:
    lift = bench()
    begun = lift.now
    for _ in range(200):
        lift.receive(wants(A, "Level 2"))
        lift.step(0.1)
    assert len(lift.demands()) == pytest.approx((lift.now - begun) / REPEAT_S, abs=2)
    assert set(lift.demands()) == {(A, "L2")}


def test_a_holder_that_goes_on_asking_is_not_silent_for_the_manager() -> None:
    lift = riding()
    before, begun = len(lift.sent_requests), lift.now
    for _ in range(round(5 * RENEW_S)):
        lift.receive(wants(A, "Level 2"))
        lift.step(1.0)
    assert len(lift.sent_requests) - before == pytest.approx((lift.now - begun) / RENEW_S, abs=2)


def test_another_floor_of_the_same_session_is_passed_on_at_once() -> None:
    """rmf_ros2 #555: a destination may change while the car is under way."""
    lift = bench()
    lift.receive(wants(A, "Level 3"))
    lift.change(floor="L1", standing=False, motion="up")
    lift.receive(wants(A, "Level 2"))
    assert lift.demands() == [(A, "L3"), (A, "L2")]
    assert lift.state.destination_floor == "Level 2"


def test_another_session_is_ignored_while_one_has_the_lift() -> None:
    """A7: any session stole the lift."""
    lift = riding()
    lift.receive(wants(B, "Level 3"), wants(B, "Level 3"))
    assert lift.demands() == [(A, "L2")]
    assert lift.state.session_id == A
    assert lift.adapter.counts.requests["lift_rmf", "held_by_another"] == 2


@each_row("floor", ["", "Level 2", "Level 1", "nowhere"])
def test_an_end_clears_the_session_whatever_floor_it_names_and_moves_nothing(floor: str) -> None:
    """A8, A9, and the template: END with an empty or unknown floor was refused, or sent the car there."""
    lift = riding()
    lift.receive(ends(A, floor))
    assert lift.state.session_id == ""
    assert lift.sent_requests[1:] == [EndOfSession("lift", A, 3.0)]


def test_an_end_is_told_to_the_manager_once_however_often_it_comes() -> None:
    lift = riding()
    for _ in range(20):
        lift.receive(ends(A))
    assert lift.ended_sessions() == [A]


def test_ends_of_nobody_and_of_others_change_nothing() -> None:
    """Jazzy and iron answer every state of an idle lift with END, mostly of an empty session (open-rmf 1.4)."""
    lift = riding()
    published = len(lift.published)
    for session in ("", B, "x" * 1_000_000):
        lift.receive(ends(session))
    assert lift.ended_sessions() == []
    assert lift.state.session_id == A
    assert len(lift.published) <= published + 1


def test_an_end_counts_in_any_mode_and_while_the_lift_cannot_be_read() -> None:
    """LCI honoured it in AGV mode only."""
    for change in ({"mode": "fire", "door": "moving"}, {"mode": "inspection"}, {"live": False}):
        lift = riding()
        lift.change(**change)
        lift.receive(ends(A))
        assert (lift.state.session_id, lift.ended_sessions()) == ("", [A])


@pytest.mark.parametrize("apart_s", [0.0, 0.001])
def test_the_end_of_one_session_and_the_request_of_the_next_may_come_within_a_millisecond(apart_s: float) -> None:
    lift = riding()
    lift.adapter.on_request(ends(A), lift.now)
    lift.now += apart_s
    lift.receive(wants(B, "Level 3"))
    assert lift.ended_sessions() == [A]
    assert lift.state.session_id == B
    assert lift.demands() == [(A, "L2")], "the call waits for the grace of the session before"
    lift.over()
    assert lift.demands() == [(A, "L2"), (B, "L3")]


def test_the_door_is_not_open_for_a_session_before_the_manager_holds_it_for_that() -> None:
    lift = riding()
    lift.receive(ends(A), wants(B, "Level 2"))
    assert (lift.state.session_id, lift.state.current_floor, lift.state.door_state) == (B, "Level 2", DOOR_MOVING)
    lift.over()
    lift.step()
    assert (lift.state.session_id, lift.state.door_state) == (B, DOOR_OPEN)


def test_the_door_is_not_open_for_a_floor_that_is_not_told_yet() -> None:
    """jazzy's RequestLift takes the first match: an open door that is let go in a moment must not be one (open-rmf 1.5)."""
    lift = riding()
    lift.slow = True
    lift.receive(wants(A, "Level 3"))
    assert (lift.state.current_floor, lift.state.door_state) == ("Level 2", DOOR_MOVING)


def test_a_session_that_was_told_stays_when_the_lift_goes_offline_before_it_could_be_opened() -> None:
    lift = riding()
    lift.receive(ends(A), wants(B, "Level 3"))
    lift.refusal_code = "offline"
    lift.change(holder=None, live=False)
    lift.receive(wants(B, "Level 3"))
    assert (lift.state.session_id, lift.state.current_mode) == (B, MODE_OFFLINE)
    lift.refusal_code = ""
    lift.change(live=True)
    lift.receive(wants(B, "Level 3"))
    lift.step()
    assert (lift.state.session_id, lift.views["lift"].holder) == (B, HeldBy("rmf", B))


def test_a_session_that_comes_back_within_its_grace_goes_on() -> None:
    """A supervisor that was restarted ends the session of a robot under way, and opens it again (open-rmf 1.6.8)."""
    lift = riding()
    lift.receive(ends(A))
    lift.receive(wants(A, "Level 2"))
    assert lift.state.session_id == A
    assert lift.sent_requests == [
        SessionDemand("lift", A, "L2", hold_door=True),
        EndOfSession("lift", A, 3.0),
        lift.sent_requests[0],
    ]
    assert lift.state.door_state == DOOR_OPEN


def test_only_the_last_floor_of_a_replay_is_told_and_its_ends_count_in_order() -> None:
    lift = riding()
    lift.adapter.on_request_writer(lift.now)
    lift.receive(
        wants(A, "Level 1"), wants(A, "Level 3"), ends(A), wants(B, "Level 1"), wants(B, "Level 3"), ends(B),
        wants(A, "Level 3"), wants(A, "Level 2"),
    )  # fmt: skip
    lift.elapse(3)
    assert lift.demands() == [(A, "L2"), (A, "L2")]
    assert lift.state.session_id == A


def test_a_floor_that_is_said_again_within_a_replay_is_not_told_again_before_its_last_floor_is_known() -> None:
    """A supervisor that was restarted replays what its robot wanted before: a call to that floor would carry the robot away."""
    lift = bench()
    lift.receive(wants(A, "Level 2"))
    lift.elapse(REPEAT_S)
    lift.adapter.on_request_writer(lift.now)
    for level in ("Level 2", "Level 2", "Level 3"):
        lift.receive(wants(A, level))
    lift.elapse(1)
    assert lift.demands() == [(A, "L2"), (A, "L3")]


def test_a_replay_that_ends_with_another_session_gives_the_lift_to_that() -> None:
    lift = riding()
    lift.adapter.on_request_writer(lift.now)
    lift.receive(wants(A, "Level 1"), ends(A), wants(B, "Level 1"), wants(B, "Level 3"))
    assert lift.state.session_id == B
    lift.over()
    lift.elapse(1)
    assert (lift.ended_sessions(), lift.demands()) == ([A], [(A, "L2"), (B, "L3")])


def test_beyond_the_time_of_replays_every_floor_is_told_at_once() -> None:
    lift = riding()
    lift.adapter.on_request_writer(lift.now)
    lift.elapse(5.1)
    lift.adapter.on_request(wants(A, "Level 1"), lift.now)
    lift.turn()
    assert lift.demands()[-1] == (A, "L1")


def test_a_lift_of_another_face_is_shown_as_its_and_is_never_open() -> None:
    lift = bench()
    lift.change(holder=REST, door="open", destination="L1")
    assert (lift.state.session_id, lift.state.door_state) == ("api:amr-7", DOOR_MOVING)
    lift.receive(ends("api:amr-7", "Level 1"), ends("api:amr-7"))
    assert lift.sent_requests == []
    assert lift.adapter.counts.requests["lift_rmf", "end_of_another_face"] == 2


def test_a_request_for_a_lift_of_another_face_keeps_its_place_in_the_line() -> None:
    lift = bench()
    lift.change(holder=REST)
    begun = lift.now
    for _ in range(50):
        lift.receive(wants(A, "Level 2"))
        lift.step(0.1)
    assert len(lift.sent_requests) == pytest.approx((lift.now - begun) / REFUSAL_PAUSE_S, abs=2), (
        "not with every message"
    )
    assert lift.state.session_id == "api:amr-7"
    lift.over()
    lift.receive(wants(A, "Level 2"))
    assert lift.state.session_id == A


def test_a_refused_session_is_not_shown_and_is_asked_for_again_as_rmf_repeats_it() -> None:
    lift = bench(refusal_code="mode")
    published, begun = len(lift.published), lift.now
    for _ in range(30):
        lift.receive(wants(A, "Level 2"))
        lift.step(0.1)
    assert {state.session_id for state in lift.published} == {""}
    assert len(lift.published) - published == pytest.approx((lift.now - begun) / PERIOD_S, abs=1), "no change"
    assert len(lift.sent_requests) == pytest.approx((lift.now - begun) / REFUSAL_PAUSE_S, abs=2)
    lift.refusal_code = ""
    lift.change(mode="robot")
    lift.receive(wants(A, "Level 2"))
    assert lift.state.session_id == A


def test_a_session_that_the_manager_ended_is_over_for_rmf_and_may_ask_anew() -> None:
    lift = riding()
    lift.over()
    assert lift.state.session_id == ""
    lift.receive(wants(A, "Level 2"))
    assert lift.state.session_id == A


def test_an_answer_that_left_before_the_managers_last_word_ends_no_session() -> None:
    lift = bench()
    overtaken = lift.site()
    lift.adapter.on_request(wants(A, "Level 2"), lift.now)
    lift.turn()
    lift.adapter.on_site(overtaken, lift.now, lift.now)
    lift.turn()
    assert (lift.state.session_id, len(lift.sent_requests)) == (A, 1)


def test_an_adapter_that_was_restarted_takes_up_the_session_and_executes_no_old_floor() -> None:
    lift = riding()
    lift.restart_adapter()
    lift.report_site()
    assert (lift.state.session_id, lift.state.door_state, lift.state.destination_floor) == (A, DOOR_OPEN, "Level 2")
    assert lift.demands() == [(A, "L2")]
    lift.receive(ends(A))
    assert (lift.state.session_id, lift.ended_sessions()) == ("", [A])


def test_an_adapter_that_was_restarted_in_the_grace_does_not_show_the_session_that_is_over() -> None:
    """Its robot may wait outside for that very state, and the door is let go in a moment."""
    lift = riding()
    lift.receive(ends(A))
    lift.views["lift"] = replace(lift.views["lift"], ending=True)
    lift.restart_adapter()
    published = len(lift.published)
    lift.elapse(2)
    assert {state.session_id for state in lift.published[published:]} == {""}
    lift.receive(wants(B, "Level 2"))
    assert (lift.state.session_id, lift.state.door_state) == (B, DOOR_MOVING)
    lift.change(holder=None, ending=False)
    assert lift.demands()[-1] == (B, "L2")


def test_a_session_that_is_over_and_asks_again_in_its_grace_goes_on_after_a_restart_of_the_adapter() -> None:
    lift = riding()
    lift.receive(ends(A))
    lift.views["lift"] = replace(lift.views["lift"], ending=True)
    lift.restart_adapter()
    lift.elapse(1)
    lift.slow = True
    lift.receive(wants(A, "Level 2"))
    assert (lift.state.session_id, lift.state.door_state) == (A, DOOR_MOVING)
    lift.views["lift"] = replace(lift.views["lift"], ending=False)
    lift.answer_all()
    lift.step()
    assert (lift.state.session_id, lift.state.door_state) == (A, DOOR_OPEN)


def test_a_session_that_somebody_else_ended_is_not_invited_and_is_over_with_its_grace() -> None:
    lift = riding()
    lift.elapse(6)
    lift.change(ending=True)
    assert (lift.state.session_id, lift.state.door_state) == (A, DOOR_MOVING)
    lift.elapse(2)
    assert lift.demands() == [(A, "L2")]
    lift.change(holder=None, ending=False)
    assert lift.state.session_id == ""


def test_a_session_that_an_end_which_came_late_would_end_is_wanted_again_with_rmfs_next_word() -> None:
    """An END whose answer did not come may be executed after the same session was opened again."""
    lift = riding()
    lift.elapse(6)
    lift.change(ending=True)
    lift.receive(wants(A, "Level 2"))
    assert lift.demands() == [(A, "L2")] * 2
    lift.change(ending=False)
    assert (lift.state.session_id, lift.state.door_state) == (A, DOOR_OPEN)


def test_a_door_of_before_the_managers_last_word_is_not_open() -> None:
    """Away and back within one moment: the manager let go of the door in between."""
    lift = riding()
    lift.event += 2
    for floor in ("Level 3", "Level 2"):
        lift.adapter.on_request(wants(A, floor), lift.now)
        lift.turn()
    assert (lift.state.current_floor, lift.state.door_state) == ("Level 2", DOOR_MOVING)
    lift.report_site()
    assert lift.state.door_state == DOOR_OPEN


def test_a_view_of_another_start_of_the_manager_invites_nobody() -> None:
    lift = riding()
    lift.boot, lift.event = "earlier", 900
    lift.adapter.on_request(wants(A, "Level 3"), lift.now)
    lift.turn()
    lift.adapter.on_request(wants(A, "Level 2"), lift.now)
    lift.turn()
    assert lift.state.door_state == DOOR_MOVING


def test_a_demand_that_never_left_takes_no_open_door_away() -> None:
    lift = riding()
    lift.elapse(RENEW_S + 1)
    lift.refusal_code = NOT_SENT
    lift.receive(wants(A, "Level 2"))
    assert (lift.state.session_id, lift.state.door_state) == (A, DOOR_OPEN)


def test_a_demand_that_is_executed_long_after_its_end_is_ended_again_and_never_shown() -> None:
    lift = bench(refusal_code=UNREACHABLE)
    lift.receive(wants(A, "Level 2"))
    lift.refusal_code = ""
    lift.receive(ends(A))
    lift.elapse(60)
    said = len(lift.published)
    lift.change(holder=HeldBy("rmf", A), destination="L2", floor="L2", door="open")
    lift.elapse(2)
    assert {state.session_id for state in lift.published[said:]} == {""}
    assert lift.ended_sessions() == [A, A]
    lift.over()
    lift.receive(wants(A, "Level 2"))
    lift.step()
    assert lift.state.session_id == A


def test_a_session_that_the_manager_took_and_refuses_is_not_shown_again_and_again() -> None:
    lift = riding()
    lift.over()
    lift.refusal_code = "outside_hours"
    published = len(lift.published)
    for _ in range(50):
        lift.adapter.on_request_writer(lift.now)
        lift.receive(wants(A, "Level 2"))
        lift.step(0.2)
    sessions = [state.session_id for state in lift.published[published:]]
    assert sum(one != other for one, other in itertools.pairwise(sessions)) <= 2


def test_an_end_that_a_stopping_manager_refuses_is_the_first_thing_that_the_next_one_hears() -> None:
    lift = riding()
    lift.refusal_code = "stopping"
    lift.receive(ends(A))
    lift.elapse(2)
    lift.boot, lift.event, lift.refusal_code = "second", 0, ""
    said = len(lift.sent_requests)
    lift.elapse(1.5)
    assert lift.sent_requests[said:] == [EndOfSession("lift", A, 0.0)]


def test_a_lift_that_comes_back_under_another_name_of_the_site_is_asked_anew() -> None:
    lift = riding()
    lift.slow = True
    lift.adapter.on_request(wants(A, "Level 3"), lift.now)
    lift.adapter.tick(lift.now)
    lift.views = {"main": replace(lift.views["lift"], lift="main", holder=None)}
    lift.boot = "second"
    lift.slow = False
    lift.report_site()
    lift.receive(wants(A, "Level 3"))
    assert lift.sent_requests[-1] == SessionDemand("main", A, "L3", hold_door=True)


def test_a_session_that_waits_for_a_long_grace_is_not_given_up() -> None:
    lift = riding()
    lift.receive(ends(A), wants(B, "Level 3"))
    lift.elapse(7)
    assert lift.state.session_id == B


def test_one_session_that_nobody_answers_does_not_push_another_out_of_memory() -> None:
    lift = bench(refusal_code=UNREACHABLE)
    lift.receive(wants(A, "Level 2"))
    lift.elapse(DEMAND_MAX_AGE_S + 1)
    for _ in range(30):
        lift.receive(wants(B, "Level 2"))
        lift.elapse(1.1)
    lift.elapse(DEMAND_MAX_AGE_S + 1)
    lift.refusal_code = ""
    lift.receive(ends(A), ends(B))
    assert lift.ended_sessions() == [A, B]


def test_a_session_that_the_manager_ended_is_shown_before_its_leftover_demand_is_told() -> None:
    """Its fleet adapter read the end and said none; it says END as soon as it reads that it has the lift again."""
    lift = riding()
    lift.over()
    lift.adapter.on_request(wants(A, "Level 3"), lift.now)
    lift.turn()
    assert (lift.state.session_id, lift.demands()) == (A, [(A, "L2")])
    lift.receive(ends(A))
    lift.elapse(2)
    assert (lift.state.session_id, lift.demands(), lift.ended_sessions()) == ("", [(A, "L2")], [])
    lift.receive(wants(A, "Level 3"))
    assert lift.demands()[-1] == (A, "L3"), "a new session is told at once"


def test_a_session_that_the_manager_ended_and_that_is_meant_is_told_a_moment_later() -> None:
    lift = riding()
    lift.over()
    lift.receive(wants(A, "Level 3"))
    lift.elapse(0.5)
    assert lift.demands()[-1] == (A, "L3")
    assert lift.state.session_id == A


def test_an_end_that_came_before_the_manager_was_heard_counts() -> None:
    lift = riding()
    lift.restart_adapter()
    lift.adapter.on_request(ends(A), lift.now)
    lift.report_site()
    lift.step()
    assert (lift.state.session_id, lift.ended_sessions()) == ("", [A])


def test_while_the_manager_is_away_the_lift_is_offline_and_its_session_stays() -> None:
    lift = riding()
    lift.adapter.on_manager_lost("connection refused", lift.now)
    lift.turn()
    assert (lift.state.session_id, lift.state.current_mode, lift.state.door_state) == (A, 4, DOOR_MOVING)


def test_an_end_while_the_manager_is_away_is_the_first_thing_that_it_is_told() -> None:
    lift = riding()
    lift.adapter.on_manager_lost("connection refused", lift.now)
    lift.adapter.on_request(ends(A), lift.now)
    lift.now += 0.02
    lift.turn()
    assert lift.sent_requests[1:] == []
    lift.now += 60
    lift.adapter.on_request(wants(B, "Level 3"), lift.now)
    lift.report_site()
    assert lift.sent_requests[1:] == [EndOfSession("lift", A, 0.0)], "its grace is over"
    lift.over()
    assert lift.demands()[1:] == [(B, "L3")]


def test_a_session_whose_end_the_manager_does_not_know_is_published_so_that_its_robot_goes_on_ending_it() -> None:
    lift = riding()
    lift.adapter.on_manager_lost("connection refused", lift.now)
    lift.adapter.on_request(ends(A), lift.now)
    lift.now += UNDELIVERED_S - 1
    lift.turn()
    assert (lift.state.session_id, lift.state.door_state, lift.state.current_mode) == (A, DOOR_MOVING, MODE_OFFLINE)
    assert lift.adapter.counts.requests["lift_rmf", "ended"] == 1
    lift.receive(ends(A))
    assert lift.adapter.counts.requests["lift_rmf", "ended"] == 2
    assert (lift.state.session_id, lift.ended_sessions()) == ("", [A])


def test_a_later_end_of_the_same_session_is_shown_at_once() -> None:
    lift = riding()
    lift.adapter.on_manager_lost("connection refused", lift.now)
    lift.adapter.on_request(ends(A), lift.now)
    lift.report_site()
    lift.over()
    lift.receive(wants(A, "Level 2"))
    lift.slow = True
    lift.receive(ends(A))
    assert lift.state.session_id == ""


def test_a_robot_does_not_wait_for_ever_for_a_manager_that_stays_away() -> None:
    lift = riding()
    lift.adapter.on_manager_lost("connection refused", lift.now)
    lift.adapter.on_request(ends(A), lift.now)
    lift.now += UNDELIVERED_S + 1
    lift.turn()
    assert lift.state.session_id == ""
    lift.report_site()
    assert lift.ended_sessions() == [A]


def test_no_door_is_open_while_an_end_is_on_its_way_to_a_manager_that_is_back() -> None:
    lift = riding()
    lift.adapter.on_manager_lost("connection refused", lift.now)
    lift.adapter.on_request(ends(A), lift.now)
    lift.slow = True
    published = len(lift.published)
    lift.report_site()
    assert {(state.session_id, state.door_state) for state in lift.published[published:]} == {(A, DOOR_MOVING)}
    lift.answer_all()
    lift.step()
    assert lift.state.session_id == ""


def test_an_end_of_the_fleet_that_the_supervisor_drops_ends_the_session_after_a_while_and_moves_nothing() -> None:
    """Humble drops an END without a current request; all drop one while they serve another session (open-rmf 1.4)."""
    lift = riding()
    wanted = lift.demands()
    lift.fleet(ends(A, "Level 3"))
    lift.elapse(PASS_ON_S - 0.5)
    assert (lift.state.session_id, lift.ended_sessions()) == (A, [])
    lift.fleet(ends(A, "Level 3"))
    lift.elapse(1)
    assert (lift.state.session_id, lift.ended_sessions(), lift.demands()) == ("", [A], wanted)
    assert lift.adapter.counts.requests["lift_rmf", "ended"] == 1


def test_the_adapter_wakes_for_an_end_that_is_not_passed_on() -> None:
    lift = riding()
    lift.fleet(ends(A))
    ends_at = lift.now + PASS_ON_S
    due = lift.now
    while not lift.ended_sessions():
        lift.now = max(due, lift.now + 0.001)
        due = lift.adapter.tick(lift.now)
    assert lift.now == pytest.approx(ends_at, abs=0.05)


def test_an_end_that_the_supervisor_passes_on_ends_the_session_once() -> None:
    lift = riding()
    lift.fleet(ends(A))
    lift.receive(ends(A))
    assert (lift.state.session_id, lift.ended_sessions()) == ("", [A])
    lift.fleet(ends(A))
    lift.over()
    lift.receive(wants(A, "Level 3"))
    lift.elapse(2 * PASS_ON_S)
    assert (lift.state.session_id, lift.ended_sessions()) == (A, [A])


def test_a_fleet_that_goes_on_asking_has_not_ended_its_session() -> None:
    """An END of rmf-web for a robot that rides: its fleet asks again with the next state, or within a second (open-rmf 1.5)."""
    lift = riding()
    for _ in range(5):
        lift.fleet(ends(A))
        lift.elapse(1)
        lift.fleet(wants(A, "Level 2"))
        lift.elapse(1)
    assert (lift.state.session_id, lift.ended_sessions()) == (A, [])


@each_row("request_", [ends(B), ends(""), ends(A, lift="another"), wants(B, "Level 3"), wants(A, "Level 3")])
def test_nothing_else_that_fleets_send_to_their_supervisor_does_anything(request_: LiftRequest) -> None:
    lift = riding()
    lift.fleet(*[request_] * 3)
    lift.elapse(2 * PASS_ON_S)
    assert (lift.state.session_id, lift.ended_sessions(), lift.demands()) == (A, [], [(A, "L2")])


def test_a_fleet_is_given_no_lift_past_its_supervisor() -> None:
    lift = bench()
    lift.fleet(wants(A, "Level 2"))
    lift.elapse(10)
    assert (lift.state.session_id, lift.sent_requests) == ("", [])


def test_an_adapter_that_was_restarted_hears_the_fleet_end_the_session_that_it_took_up() -> None:
    lift = riding()
    lift.restart_adapter()
    lift.report_site()
    lift.fleet(ends(A))
    lift.elapse(PASS_ON_S + 0.1)
    assert (lift.state.session_id, lift.ended_sessions()) == ("", [A])


@pytest.mark.parametrize(("goes_on", "ended"), [(False, [A]), (True, [])])
def test_an_end_of_the_fleet_counts_before_the_manager_was_heard(goes_on: bool, ended: list[str]) -> None:
    lift = riding()
    lift.restart_adapter()
    lift.adapter.on_fleet_request(ends(A), lift.now)
    if goes_on:
        lift.adapter.on_fleet_request(wants(A, "Level 2"), lift.now)
    lift.report_site()
    assert lift.ended_sessions() == []
    lift.elapse(PASS_ON_S + 0.1)
    assert lift.ended_sessions() == ended


def test_an_end_of_the_fleet_counts_while_the_manager_is_away() -> None:
    lift = riding()
    lift.adapter.on_manager_lost("connection refused", lift.now)
    lift.fleet(ends(A))
    lift.now += PASS_ON_S
    lift.turn()
    assert lift.ended_sessions() == []
    lift.report_site()
    assert lift.ended_sessions() == [A]


def test_after_a_restart_of_the_manager_nothing_is_told_before_rmf_is_heard() -> None:
    lift = riding()
    lift.boot, lift.event = "second", 0
    lift.report_site()
    lift.elapse(1)
    assert len(lift.sent_requests) == 1
    assert (lift.state.session_id, lift.state.door_state) == (A, DOOR_MOVING)
    lift.receive(wants(A, "Level 2"))
    assert lift.demands() == [(A, "L2")] * 2
    lift.step()
    assert lift.state.door_state == DOOR_OPEN


def test_a_manager_that_lost_the_session_is_asked_anew_as_rmf_repeats() -> None:
    lift = riding()
    lift.boot, lift.event = "second", 0
    lift.over()
    assert lift.state.session_id == ""
    lift.receive(wants(A, "Level 2"))
    assert lift.state.session_id == A


def test_a_demand_that_nobody_answered_is_told_again_only_when_rmf_repeats_it() -> None:
    lift = bench(refusal_code=UNREACHABLE)
    lift.receive(wants(A, "Level 2"))
    lift.elapse(DEMAND_MAX_AGE_S + 5)
    request = len(lift.sent_requests)
    assert request <= DEMAND_MAX_AGE_S + 1
    lift.refusal_code = ""
    lift.elapse(10)
    assert len(lift.sent_requests) == request
    lift.receive(wants(A, "Level 2"))
    assert lift.state.session_id == A


def test_the_end_of_a_session_whose_demand_may_have_been_heard_is_told() -> None:
    lift = bench(refusal_code=UNREACHABLE)
    lift.receive(wants(A, "Level 2"))
    lift.refusal_code = ""
    lift.receive(ends(A))
    assert lift.ended_sessions() == [A]


def test_an_end_that_nobody_answered_is_said_again() -> None:
    lift = riding()
    lift.refusal_code = UNREACHABLE
    lift.receive(ends(A))
    lift.elapse(3)
    lift.refusal_code = ""
    lift.elapse(2)
    assert 3 <= len(lift.ended_sessions()) <= 5
    said = len(lift.ended_sessions())
    lift.over()
    lift.elapse(20)
    assert len(lift.ended_sessions()) == said


@each_row("code", ["bad_key", "internal_error", "not_recorded", "overloaded"])
def test_an_end_that_was_refused_for_no_reason_of_the_lift_is_said_again_soon(code: str) -> None:
    """A key that was replaced, a full disk, or something in between that lets nothing through: the session goes on there."""
    lift = riding()
    lift.slow = True
    lift.receive(ends(A))
    request = lift.waiting.pop()
    lift.adapter.on_answer(Answer(request, accepted=False, code=code, reason="not now"), lift.now)
    lift.elapse(REFUSAL_PAUSE_S + 0.2)
    assert lift.ended_sessions() == [A, A]


def test_an_end_that_the_key_does_not_allow_is_said_no_longer_than_the_session_lasts() -> None:
    """With two adapters at one manager each hears of the other's sessions."""
    lift = bench(slow=True)
    lift.change(holder=HeldBy("rmf", B))
    lift.receive(ends(B))
    said = []
    for holder in (HeldBy("rmf", B), None):
        lift.change(holder=holder)
        for _ in range(100):
            lift.step()
            while lift.waiting:
                lift.adapter.on_answer(Answer(lift.waiting.pop(), accepted=False, code="not_allowed"), lift.now)
        said.append(len(lift.ended_sessions()))
    assert said == [pytest.approx(10 / REFUSAL_PAUSE_S, abs=2), pytest.approx(said[0], abs=1)]


@pytest.mark.parametrize("code", ["held", "unknown_lift"])
def test_an_end_that_has_nothing_to_end_is_answered(code: str) -> None:
    lift = riding()
    lift.slow = True
    lift.receive(ends(A))
    request = lift.waiting.pop()
    lift.adapter.on_answer(Answer(request, accepted=False, code=code, reason="nothing to end"), lift.now)
    lift.slow = False
    lift.over()
    lift.elapse(20)
    assert lift.ended_sessions() == [A]


def test_a_session_that_stays_with_the_manager_after_its_end_is_ended_again() -> None:
    lift = riding()
    lift.receive(ends(A))
    lift.elapse(9)
    assert lift.ended_sessions() == [A, A]
    assert lift.state.session_id == ""


def test_a_session_that_was_refused_and_gave_up_does_not_keep_others_off() -> None:
    lift = bench()
    lift.adapter.on_manager_lost("gone", lift.now)
    lift.adapter.on_request(wants(A, "Level 2"), lift.now)
    lift.now += DEMAND_MAX_AGE_S + 0.1
    lift.adapter.on_request(wants(B, "Level 3"), lift.now)
    lift.report_site()
    assert lift.demands() == [(B, "L3")]


@pytest.mark.parametrize(("own", "other"), [("", "5"), ("5", ""), ("5", "6")])
def test_a_session_of_another_rmf_is_that_of_another_face_whatever_its_name(own: str, other: str) -> None:
    lift = bench(adapter_id=own)
    theirs = HeldBy("rmf", A, other)
    lift.change(floor="L2", door="open", holder=theirs)
    assert (lift.state.session_id, lift.state.door_state) == (str(theirs) if other else f"rmf:{A}", DOOR_MOVING)
    lift.receive(ends(A), ends(lift.state.session_id))
    lift.fleet(ends(A), ends(lift.state.session_id))
    lift.elapse(2 * PASS_ON_S)
    assert (lift.ended_sessions(), lift.sent_requests) == ([], [])
    lift.receive(wants(A, "Level 2"))
    assert lift.sent_requests == [SessionDemand("lift", A, "L2", True, own)]
    assert lift.state.session_id == str(theirs)


def test_an_adapter_with_an_id_says_it_with_every_request_and_takes_up_its_own_sessions() -> None:
    lift = riding(adapter_id="5/building1")
    lift.restart_adapter()
    lift.report_site()
    assert (lift.state.session_id, lift.state.door_state) == (A, DOOR_OPEN)
    lift.receive(ends(A))
    assert [one.adapter for one in lift.sent_requests] == ["5/building1"] * 2
    assert lift.ended_sessions() == [A]
