"""What a LiftState says (open-rmf 1.5, 1.6), and when it is sent."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest

from lift_manager.plain.rmf import Alarms, HeldBy, PartialSiteView
from lift_manager.rmf.alarms import REPEAT_S
from lift_manager.rmf.lift_state import MIN_GAP_S, PERIOD_S, equal_except_time, stale_at
from lift_manager.rmf.messages import (
    DOOR_CLOSED,
    DOOR_MOVING,
    DOOR_OPEN,
    HUMAN_MODE,
    MOTION_STOPPED,
    MOTION_UP,
    LiftState,
    Time,
)
from tests.lift_manager.rmf.bench import EPOCH, A, B, Bench, bench, ends, lift, riding, wants
from tests.support.rows import each_row

HUMAN, AGV, FIRE, OFFLINE, EMERGENCY = 1, 2, 3, 4, 5


def test_a_lift_is_told_with_the_names_of_the_building_map() -> None:
    ride = bench()
    assert ride.state == LiftState(
        lift_time=ride.state.lift_time,
        lift_name="lift_rmf",
        available_floors=("Level 1", "Level 2", "Level 3"),
        current_floor="Level 1",
        destination_floor="Level 1",
        door_state=DOOR_CLOSED,
        motion_state=0,
        available_modes=(HUMAN, AGV),
        current_mode=HUMAN,
        session_id="",
    )


def test_the_time_of_a_state_is_that_of_its_data() -> None:
    """A3: it was the time of sending, for data of any age."""
    ride = bench()
    ride.change(age_s=0.4, motion="up")
    told = ride.state.lift_time
    at = told.sec + told.nanosec / 1e9
    assert at == pytest.approx(EPOCH + ride.now - 0.4, abs=0.05)


def test_a_lift_that_was_never_read_has_no_time() -> None:
    ride = bench(views={"lift": lift(live=False, age_s=None, floor=None, reason="no answer yet")})
    assert (ride.state.lift_time, ride.state.current_mode) == (Time(0, 0), OFFLINE)


@each_row(
    ("seconds", "told"),
    [(1.0000000025, Time(1, 2)), (-5.0, Time(0, 0)), (1e12, Time(2**31 - 1, 0)), (1.9999999999, Time(2, 0))],
)
def test_a_time_is_told_to_the_nanosecond_and_within_what_the_message_holds(seconds: float, told: Time) -> None:
    assert Time.of(seconds) == told


@each_row(("view", "motion"), [("stopped", 0), ("up", 1), ("down", 2), ("moving", 3), ("unknown", 3)])
def test_motion_has_the_numbers_of_the_message(view: str, motion: int) -> None:
    ride = bench()
    ride.change(motion=view)
    assert ride.state.motion_state == motion


@each_row(
    ("view", "mode"),
    [
        ("normal", HUMAN),
        ("robot", AGV),
        ("independent", HUMAN),
        ("attendant", HUMAN),
        ("inspection", HUMAN),
        ("fire", FIRE),
        ("emergency", EMERGENCY),
        ("out_of_service", OFFLINE),
        ("unknown", 0),
    ],
)
def test_modes_are_those_of_the_lift(view: str, mode: int) -> None:
    """A4: every adapter but two says AGV, whatever the lift does."""
    ride = bench()
    ride.change(mode=view)
    assert ride.state.current_mode == mode


@pytest.mark.parametrize(("robot_mode_on", "mode"), [(None, AGV), (True, AGV), (False, HUMAN)])
def test_a_lift_that_rmf_holds_is_in_agv_mode_unless_it_says_that_it_is_not(
    robot_mode_on: bool | None, mode: int
) -> None:
    ride = riding()
    ride.change(robot_mode_on=robot_mode_on)
    assert ride.state.current_mode == mode
    ride.receive(ends(A))
    ride.over()
    assert ride.state.current_mode == HUMAN


@pytest.mark.parametrize("door", [DOOR_OPEN, DOOR_CLOSED])
def test_a_lift_that_was_asked_for_in_human_mode_is_in_human_mode(door: int) -> None:
    ride = riding()
    assert ride.state.current_mode == AGV
    ride.receive(wants(A, "Level 2", request_type=HUMAN_MODE, door_state=door))
    assert (ride.state.session_id, ride.state.current_mode) == (A, HUMAN)
    ride.receive(wants(A, "Level 2"))
    assert ride.state.current_mode == AGV


def test_the_mode_of_a_session_ends_with_it() -> None:
    ride = bench()
    ride.receive(wants(A, "Level 2", request_type=HUMAN_MODE))
    assert ride.state.current_mode == HUMAN
    ride.receive(ends(A))
    ride.over()
    ride.receive(wants(B, "Level 2"))
    assert (ride.state.session_id, ride.state.current_mode) == (B, AGV)


def test_a_lift_that_says_itself_that_it_is_in_robot_mode_is_told_as_that() -> None:
    ride = bench()
    ride.receive(wants(A, "Level 2", request_type=HUMAN_MODE))
    ride.change(mode="robot")
    assert ride.state.current_mode == AGV


def test_a_lift_that_cannot_be_read_is_offline_and_its_door_is_not_open() -> None:
    """A5 went silent, the template said the old state for ever."""
    ride = riding()
    ride.change(live=False, reason="no answer", floor=None, door="moving")
    told = ride.state
    assert (told.current_mode, told.motion_state, told.door_state) == (OFFLINE, 3, DOOR_MOVING)
    assert (told.current_floor, told.session_id, told.destination_floor) == ("", A, "Level 2")


def test_a_state_becomes_too_old_by_itself() -> None:
    """M4: the last state was kept for ever, and a dead lift looked alive."""
    ride = riding()
    published, heard = len(ride.published), ride.now
    while ride.now < heard + 1.0:
        ride.now += 0.01
        ride.adapter.tick(ride.now)
    assert ride.state.door_state == DOOR_MOVING
    first = next(state for state in ride.published[published:] if state.door_state == DOOR_MOVING)
    assert first.current_mode == OFFLINE
    assert stale_at(ride.views["lift"], heard) == pytest.approx(heard + 0.9)


def test_the_adapter_wakes_when_a_state_becomes_too_old() -> None:
    ride = riding()
    now = ride.now
    for _ in range(4):
        now = ride.adapter.tick(now)
    states = [state for state in ride.published if state.current_mode == OFFLINE]
    assert states
    told = states[0].lift_time
    assert told == ride.published[-1].lift_time, "the time of the last good data"


@each_row("field", [field.name for field in fields(LiftState)])
def test_a_change_of_any_field_but_the_time_is_a_change(field: str) -> None:
    told = bench().state
    other = {
        "lift_time": Time(5, 5), "available_floors": ("Level 1",), "available_modes": (1,), "door_state": 2,
        "motion_state": 2, "current_mode": 5,
    }  # fmt: skip
    changed = replace(told, **{field: other.get(field, "another")})  # type: ignore[arg-type]
    assert equal_except_time(told, changed) is (field == "lift_time")


def test_a_floor_that_nobody_reports_is_an_empty_text() -> None:
    ride = bench()
    ride.change(floor=None)
    assert (ride.state.current_floor, ride.state.destination_floor) == ("", "")


def test_the_destination_stays_what_was_asked_for() -> None:
    """Any other value makes the supervisor repeat for ever (open-rmf 1.6.4)."""
    ride = bench()
    ride.receive(wants(A, "Level 3"))
    for view in ({"floor": "L2", "destination": "L2"}, {"floor": "L3", "destination": None, "door": "open"}):
        ride.change(**view)
        assert ride.state.destination_floor == "Level 3"


@pytest.mark.parametrize("session", [A, B])
def test_a_floor_that_is_only_passed_is_not_told_to_whoever_wants_to_go_there(session: str) -> None:
    """Iron takes its destination in `current_floor` for the arrival, whatever the door says (open-rmf 1.6.3)."""
    ride = bench()
    ride.receive(wants(A, "Level 3"))
    ride.change(floor="L2", motion="up", standing=False, destination="L3")
    assert ride.state.current_floor == "Level 2"
    if session == B:
        ride.receive(ends(A))
    published = len(ride.published)
    ride.receive(wants(session, "Level 2"))
    told = [state for state in ride.published[published:] if state.session_id == session]
    assert {(state.current_floor, state.destination_floor) for state in told[-1:]} == {("", "Level 2")}
    assert not [state for state in told if state.current_floor == state.destination_floor]
    ride.change(motion="stopped", standing=True)
    assert (ride.state.session_id, ride.state.current_floor) == (session, "Level 2")


def test_an_idle_lift_with_an_open_door_is_told_as_it_is() -> None:
    ride = bench()
    ride.change(door="open")
    assert (ride.state.session_id, ride.state.door_state) == ("", DOOR_OPEN)


def test_each_lift_is_told_twice_a_second_and_no_two_at_one_moment() -> None:
    ride = Bench(views={f"lift{number}": lift(f"lift{number}") for number in range(10)})
    ride.report_site()
    ride.published.clear()
    moments: dict[float, int] = {}
    begun = ride.now
    while ride.now < begun + 10:
        before = len(ride.published)
        ride.now += 0.005
        ride.adapter.on_site(ride.site(), ride.now, ride.now)
        ride.adapter.tick(ride.now)
        moments[ride.now] = len(ride.published) - before
    assert max(moments.values()) == 1
    for number in range(10):
        mine = [state for state in ride.published if state.lift_name == f"lift{number}_rmf"]
        assert len(mine) == pytest.approx(10 / PERIOD_S, abs=1)


def test_a_change_is_told_at_once_and_a_request_that_changes_nothing_never_is() -> None:
    """One state for each request would spin at the speed of the wire (open-rmf 1.5)."""
    ride = riding()
    published, begun = len(ride.published), ride.now
    for _ in range(1000):
        ride.adapter.on_request(wants(A, "Level 2"), ride.now)
        ride.now += 0.001
        ride.adapter.tick(ride.now)
    assert len(ride.published) - published <= (ride.now - begun) / PERIOD_S + 2
    published = len(ride.published)
    ride.change(door="closed")
    assert [state.door_state for state in ride.published[published:]] == [DOOR_CLOSED]


def test_a_change_right_behind_a_state_that_was_due_is_told_at_once_and_two_changes_share_a_state() -> None:
    ride = bench()
    published = len(ride.published)
    while len(ride.published) == published:
        ride.now += 0.001
        ride.adapter.tick(ride.now)
    shown = []
    for motion in ("up", "stopped"):
        ride.now += 0.001
        ride.views["lift"] = replace(ride.views["lift"], motion=motion)
        ride.adapter.on_site(ride.site(), ride.now, ride.now)
        ride.adapter.tick(ride.now)
        shown.append(ride.state.motion_state)
    ride.now += MIN_GAP_S
    ride.adapter.tick(ride.now)
    assert [*shown, ride.state.motion_state] == [MOTION_UP, MOTION_UP, MOTION_STOPPED]


def test_a_partial_answer_changes_its_own_lifts_and_forgets_no_other() -> None:
    ride = bench(views={"lift": lift("lift"), "goods": lift("goods")}, alarms=Alarms(fire_alarm=True))
    ride.change("goods", fire_latched=True)
    ride.published.clear()
    announced = len(ride.alarm.said)
    partial = PartialSiteView(ride.boot, ride.event, (lift("lift", motion="up"),), 3.0, ride.alarms)
    ride.adapter.on_site(partial, ride.now, ride.now)
    ride.adapter.tick(ride.now)
    assert [(state.lift_name, state.motion_state) for state in ride.published] == [("lift_rmf", MOTION_UP)]
    ride.now += REPEAT_S
    ride.adapter.tick(ride.now)
    assert {state.lift_name for state in ride.published} == {"lift_rmf", "goods_rmf"}
    assert (ride.alarm.said[announced:], ride.alarm.forgotten_after) == ([True], []), "the fire goes on"


def test_the_last_word_of_an_adapter_is_that_its_lifts_are_offline() -> None:
    ride = riding()
    ride.adapter.stop(ride.now)
    assert (ride.state.door_state, ride.state.current_mode, ride.state.session_id) == (DOOR_MOVING, OFFLINE, A)


def test_a_lift_of_a_manager_that_was_never_heard_is_not_told_at_all() -> None:
    """A1 died of it."""
    ride = Bench()
    ride.adapter.on_request(wants(A, "Level 2"), ride.now)
    ride.adapter.on_manager_lost("connection refused", ride.now)
    ride.adapter.tick(ride.now)
    assert ride.published == []
    assert ride.adapter.counts.requests == {("", "no_manager"): 1}


def test_a_lift_that_left_the_site_file_is_told_no_more() -> None:
    ride = Bench(views={"east": lift("east"), "west": lift("west")})
    ride.report_site()
    del ride.views["west"]
    ride.step()
    published = len(ride.published)
    ride.elapse(2)
    assert {state.lift_name for state in ride.published[published:]} == {"east_rmf"}


def test_the_last_word_about_a_lift_that_left_the_site_file_is_that_it_is_offline() -> None:
    """It would be OPEN for ever to whoever keeps the last state, as rmf-web does."""
    ride = riding(views={"lift": lift(), "other": lift("other")})
    del ride.views["lift"]
    ride.report_site()
    told = [state for state in ride.published if state.lift_name == "lift_rmf"]
    assert (told[-2].door_state, told[-2].session_id) == (DOOR_OPEN, A)
    assert (told[-1].door_state, told[-1].current_mode, told[-1].session_id) == (DOOR_MOVING, OFFLINE, A)


def test_an_end_of_a_lift_that_left_the_site_file_is_let_go_of_with_a_word(caplog: pytest.LogCaptureFixture) -> None:
    ride = riding(views={"lift": lift(), "other": lift("other")})
    ride.adapter.on_manager_lost("connection refused", ride.now)
    ride.adapter.on_request(ends(A), ride.now)
    del ride.views["lift"]
    caplog.clear()
    ride.elapse(10)
    assert ride.ended_sessions() == []
    assert [text for text in caplog.messages if A in text] == [
        f"lift_rmf: the manager has not confirmed the end of the session of '{A}', which is forgotten with the lift"
    ]


def test_another_writer_of_a_lift_is_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    ride = bench()
    for _ in range(10):
        ride.adapter.on_rival("lift_rmf", ride.now)
        ride.adapter.on_rival("some_other_lift", ride.now)
    assert [record.getMessage().split(";")[0] for record in caplog.records if record.levelname == "WARNING"] == [
        "another program publishes the state of lift_rmf too"
    ]


def test_a_lift_of_another_face_shows_where_that_goes() -> None:
    ride = bench()
    ride.change(holder=HeldBy("ride", "amr-7"), destination="L3")
    assert (ride.state.session_id, ride.state.destination_floor) == ("ride:amr-7", "Level 3")


@each_row(("waits_s", "until_s"), [(0.0, 0.0), (1.0, 1.0)])
def test_a_lift_that_was_not_read_yet_is_published_late_by_an_adapter_that_takes_over(
    waits_s: float, until_s: float
) -> None:
    unread = lift("unread", live=False, age_s=None, floor=None)
    ride = Bench(views={"lift": lift(), "unread": unread}, first_reading_s=waits_s)
    began = ride.now
    ride.report_site()
    assert ride.published[0].lift_name == "lift_rmf"
    while not any(state.lift_name == "unread_rmf" for state in ride.published):
        ride.step()
    assert ride.now - began == pytest.approx(until_s, abs=0.15)


def test_a_lift_is_published_with_its_first_reading_by_an_adapter_that_takes_over() -> None:
    ride = Bench(views={"lift": lift(live=False, age_s=None, floor=None)}, first_reading_s=1.0)
    ride.report_site()
    ride.step(0.3)
    assert ride.published == []
    ride.change(live=True, age_s=0.0, floor="L1")
    assert {state.current_mode for state in ride.published} == {HUMAN}
