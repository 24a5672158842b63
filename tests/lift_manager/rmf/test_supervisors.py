"""The models of Open-RMF's programs say what open-rmf.md 1.4 and 1.5 say of them; each test quotes its row."""

from dataclasses import replace

import pytest

from lift_manager.rmf.messages import (
    AGV_MODE,
    DOOR_CLOSED,
    DOOR_MOVING,
    DOOR_OPEN,
    END_SESSION,
    MODE_AGV,
    MODE_HUMAN,
    MOTION_STOPPED,
    LiftRequest,
    LiftState,
    Time,
)
from tests.support.rmf.fleet import TRAITS, FleetRobot, Phase
from tests.support.rmf.others import RmfWeb, panel_request, request_lift_script
from tests.support.rmf.supervisors import SUPERVISORS, Supervisor
from tests.support.rows import each_row

A, B = "fleet_1/robot_1", "fleet_2/robot_2"
ALL = tuple(SUPERVISORS)
LATER = ("iron", "jazzy", "kilted")


def ask(session: str = A, floor: str = "L2", *, at: float = 1.0) -> LiftRequest:
    return LiftRequest("lift", Time.of(at), session, AGV_MODE, floor, DOOR_OPEN)


def end(session: str = A, floor: str = "", *, at: float = 1.0) -> LiftRequest:
    return LiftRequest("lift", Time.of(at), session, END_SESSION, floor, DOOR_CLOSED)


def state(session: str = "", floor: str = "L1", door: int = DOOR_CLOSED, destination: str | None = None) -> LiftState:
    modes = (MODE_HUMAN, MODE_AGV)
    goes_to = floor if destination is None else destination
    return LiftState(
        Time.of(1.0), "lift", ("L1", "L2", "L3"), floor, goes_to, door, MOTION_STOPPED, modes, MODE_AGV, session
    )


SATISFIED = state(A, "L2", DOOR_OPEN)


def supervisor(distribution: str) -> Supervisor:
    return SUPERVISORS[distribution]()


def stamped(request: LiftRequest, at: float) -> LiftRequest:
    return replace(request, request_time=Time.of(at))


class TestSupervisors:
    @pytest.mark.parametrize("distribution", ["humble", "iron"])
    def test_new_request_reaches_adapter_on_next_lift_state(self, distribution: str) -> None:
        one = supervisor(distribution)
        assert one.asked(ask(), 2.0) == []
        assert one.heard(state(), 3.0) == [stamped(ask(), 3.0)]

    @pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
    def test_new_request_reaches_adapter_at_once_with_request_time_now(self, distribution: str) -> None:
        assert supervisor(distribution).asked(ask(), 2.0) == [stamped(ask(), 2.0)]

    @pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
    def test_same_session_replaces_it_and_every_fleet_request_is_published(self, distribution: str) -> None:
        one = supervisor(distribution)
        one.asked(ask(), 2.0)
        assert one.asked(ask(floor="L3"), 3.0) == [stamped(ask(floor="L3"), 3.0)]
        assert one.asked(ask(floor="L3"), 4.0) == [stamped(ask(floor="L3"), 4.0)]

    @each_row("distribution", ALL)
    def test_anything_from_another_session_while_one_is_active_is_dropped_silently(self, distribution: str) -> None:
        one = supervisor(distribution)
        one.asked(ask(), 2.0)
        assert one.asked(ask(B), 3.0) == []
        assert one.asked(end(B), 3.0) == []
        assert [sent.session_id for sent in one.heard(state(), 4.0)] == [A]

    def test_humble_forwards_only_if_the_destination_or_the_door_differs(self) -> None:
        one = supervisor("humble")
        one.asked(ask(), 2.0)
        assert one.heard(SATISFIED, 3.0) == []
        assert one.heard(state("", "L2", DOOR_OPEN), 3.0) == []  # it does not compare sessions
        assert one.heard(state(A, "L1", DOOR_OPEN), 3.0)
        assert one.heard(state(A, "L2", DOOR_MOVING), 3.0)

    @pytest.mark.parametrize("distribution", ["iron", "jazzy"])
    def test_iron_and_jazzy_forward_on_every_lift_state_even_when_satisfied(self, distribution: str) -> None:
        one = supervisor(distribution)
        one.asked(ask(), 2.0)
        assert one.heard(SATISFIED, 3.0) == [stamped(ask(), 3.0)]

    @each_row(
        ("said", "repeats"),
        [
            (SATISFIED, False),
            (state(A, "L2", DOOR_OPEN, destination=""), False),
            (state(A, "L1", DOOR_OPEN, destination="L2"), False),
            (state(A, "L1", DOOR_OPEN, destination=""), True),
            (state(A, "L2", DOOR_OPEN, destination="L3"), True),
            (state(B, "L2", DOOR_OPEN), True),
            (state("", "L2", DOOR_OPEN), True),
            (state(A, "L2", DOOR_MOVING), True),
        ],
    )
    def test_kilted_forwards_if_session_door_or_floor_is_wrong(self, said: LiftState, *, repeats: bool) -> None:
        one = supervisor("kilted")
        one.asked(ask(), 2.0)
        assert one.heard(said, 3.0) == ([stamped(ask(), 3.0)] if repeats else [])

    def test_humble_publishes_the_owners_end_once_as_received(self) -> None:
        one = supervisor("humble")
        one.asked(ask(), 2.0)
        assert one.asked(end(floor="L2"), 3.0) == [end(floor="L2")]
        assert one.asked(end(floor="L2"), 4.0) == []
        assert one.heard(state(A), 5.0) == []

    @pytest.mark.parametrize("distribution", LATER)
    def test_the_owners_end_is_published_and_the_session_cleared(self, distribution: str) -> None:
        one = supervisor(distribution)
        one.asked(ask(), 2.0)
        assert one.asked(end(), 3.0) == [stamped(end(), 3.0)]
        assert one.asked(ask(B), 4.0) == ([] if distribution == "iron" else [stamped(ask(B), 4.0)])
        assert [sent.session_id for sent in one.heard(state(), 5.0)] == [B]

    @each_row("distribution", ALL)
    def test_end_when_no_session_is_active_is_dropped_but_by_jazzy(self, distribution: str) -> None:
        assert supervisor(distribution).asked(end(), 2.0) == ([stamped(end(), 2.0)] if distribution == "jazzy" else [])

    @each_row("distribution", ALL)
    def test_a_session_that_should_not_be_is_ended_on_every_lift_state_but_by_humble(self, distribution: str) -> None:
        expected = [] if distribution == "humble" else [end(A, "L2", at=2.0)]
        one = supervisor(distribution)
        assert one.heard(state(A, "L2"), 2.0) == expected
        assert one.heard(state(A, "L2"), 2.0) == expected

    @each_row("distribution", ALL)
    def test_iron_and_jazzy_spam_an_idle_lift_with_end_for_no_session(self, distribution: str) -> None:
        expected = [end("", "L1", at=2.0)] if distribution in ("iron", "jazzy") else []
        assert supervisor(distribution).heard(state(), 2.0) == expected

    @each_row("distribution", ALL)
    def test_only_humble_gets_no_replay_of_old_requests(self, distribution: str) -> None:
        assert supervisor(distribution).replays == (distribution != "humble")

    @each_row("distribution", ALL)
    def test_each_lift_has_a_session_of_its_own(self, distribution: str) -> None:
        one = supervisor(distribution)
        one.asked(ask(), 2.0)
        one.asked(replace(ask(B), lift_name="other"), 2.0)
        assert [sent.session_id for sent in one.heard(replace(state(), lift_name="other"), 3.0)] == [B]


def robot(distribution: str) -> FleetRobot:
    return FleetRobot(A, "lift", TRAITS[distribution])


def phase(one: FleetRobot) -> Phase:
    return one.phase


class TestFleetAdapter:
    @each_row("distribution", ALL)
    def test_always_asks_agv_mode_and_door_open(self, distribution: str) -> None:
        assert robot(distribution).request_lift("L2", inside=False, now=1.0) == [ask()]

    @each_row(
        ("said", "over"),
        [
            (SATISFIED, True),
            (replace(SATISFIED, current_mode=MODE_HUMAN, motion_state=1, destination_floor="L3"), True),
            (replace(SATISFIED, lift_name="other"), False),
            (state(A, "L1", DOOR_OPEN), False),
            (state(A, "L2", DOOR_MOVING), False),
            (state("", "L2", DOOR_OPEN), False),
            (state(B, "L2", DOOR_OPEN), False),
        ],
    )
    @each_row("distribution", ALL)
    def test_request_lift_finishes_on_one_state_with_floor_open_and_its_session(
        self, distribution: str, said: LiftState, *, over: bool
    ) -> None:
        one = robot(distribution)
        one.request_lift("L2", inside=False, now=1.0)
        one.heard(said, 2.0)
        assert phase(one) is (Phase.NONE if over else Phase.REQUEST)

    @pytest.mark.parametrize("distribution", LATER)
    def test_asks_again_for_every_lift_state_while_it_has_the_destination(self, distribution: str) -> None:
        one = robot(distribution)
        one.request_lift("L2", inside=False, now=1.0)
        assert one.heard(SATISFIED, 2.0) == [ask(at=2.0)]
        assert phase(one) is Phase.NONE
        assert one.heard(SATISFIED, 3.0) == [ask(at=3.0)]

    @each_row("distribution", ALL)
    def test_iron_and_jazzy_ask_for_every_lift_state_of_any_lift(self, distribution: str) -> None:
        one = robot(distribution)
        one.request_lift("L2", inside=False, now=1.0)
        expected = [ask(at=2.0)] if distribution in ("iron", "jazzy") else []
        assert one.heard(replace(state(), lift_name="other"), 2.0) == expected

    def test_humble_asks_by_a_timer_of_one_second_and_is_silent_while_the_robot_drives(self) -> None:
        one = robot("humble")
        one.request_lift("L2", inside=False, now=1.0)
        assert one.heard(state(), 1.5) == []
        assert one.tick(1.9) == []
        assert one.tick(2.0) == [ask(at=2.0)]
        assert one.heard(SATISFIED, 2.5) == []
        assert [one.tick(second) for second in (3.0, 4.0, 5.0)] == [[], [], []]

    @pytest.mark.parametrize("distribution", LATER)
    def test_end_without_a_floor_for_every_state_of_its_session_without_a_destination(self, distribution: str) -> None:
        one = robot(distribution)
        one.request_lift("L2", inside=True, now=1.0)
        one.heard(SATISFIED, 2.0)
        at_once = one.end_lift_session(3.0)
        assert at_once == ([end(A, "L2", at=3.0)] if distribution == "jazzy" else [])
        assert one.heard(SATISFIED, 4.0) == [end(A, "", at=4.0)]
        assert one.heard(SATISFIED, 5.0) == [end(A, "", at=5.0)]
        assert one.heard(state(), 6.0) == []

    def test_humble_ends_once_a_second_with_the_destination(self) -> None:
        one = robot("humble")
        one.request_lift("L2", inside=True, now=1.0)
        one.heard(SATISFIED, 2.0)
        assert one.end_lift_session(3.0) == [end(A, "L2", at=3.0)]
        assert one.heard(SATISFIED, 3.5) == []
        assert one.tick(4.0) == [end(A, "L2", at=4.0)]

    @each_row("distribution", ALL)
    def test_end_lift_session_finishes_on_a_state_with_another_session(self, distribution: str) -> None:
        one = robot(distribution)
        one.request_lift("L2", inside=True, now=1.0)
        one.end_lift_session(3.0)
        one.heard(SATISFIED, 4.0)
        assert phase(one) is Phase.END
        one.heard(state(B), 5.0)
        assert phase(one) is Phase.NONE

    @each_row(
        ("distribution", "saw", "over"),
        [
            ("humble", SATISFIED, False),
            ("kilted", SATISFIED, True),
            ("kilted", state(A, "L2", DOOR_MOVING), False),
            ("iron", state(A, "L2", DOOR_MOVING), True),
            ("iron", state(A, "L1", DOOR_OPEN), False),
            ("jazzy", state(A, "L1", DOOR_CLOSED), True),
        ],
    )
    def test_a_replan_outside_skips_the_look_at_the_door(
        self, distribution: str, saw: LiftState, *, over: bool
    ) -> None:
        one = robot(distribution)
        one.request_lift("L2", inside=False, now=1.0)
        one.heard(saw, 2.0)
        one.request_lift("L2", inside=False, now=3.0)
        assert phase(one) is (Phase.NONE if over else Phase.REQUEST)

    @each_row("distribution", ALL)
    def test_a_replan_to_another_floor_or_inside_waits_for_the_lift(self, distribution: str) -> None:
        one = robot(distribution)
        one.request_lift("L2", inside=False, now=1.0)
        one.heard(SATISFIED, 2.0)
        one.request_lift("L3", inside=False, now=3.0)
        assert phase(one) is Phase.REQUEST
        one.heard(state(A, "L3", DOOR_OPEN), 4.0)
        one.request_lift("L3", inside=True, now=5.0)
        assert phase(one) is Phase.REQUEST

    @each_row(
        ("distribution", "idle", "after_s"),
        [("kilted", False, 30.0), ("kilted", True, 10.0), ("jazzy", False, 0.0), ("jazzy", True, 2.0)],
    )
    def test_auto_release_after_so_many_seconds_outside(self, distribution: str, after_s: float, *, idle: bool) -> None:
        one = robot(distribution)
        one.request_lift("L2", inside=False, now=1.0)
        one.abandon(idle=idle, now=5.0)
        assert (one.due, one.floor) == (5.0 + after_s, "L2")
        one.tick(one.due)
        assert one.heard(SATISFIED, 50.0) == [end(A, "", at=50.0)]

    def test_crowded_ends_the_session_waits_ten_seconds_and_asks_again(self) -> None:
        answers = iter([True, False])
        one = FleetRobot(A, "lift", TRAITS["kilted"], crowded=lambda: next(answers))
        one.request_lift("L2", inside=False, now=1.0)
        one.heard(SATISFIED, 2.0)
        assert phase(one) is Phase.CROWDED
        assert one.heard(SATISFIED, 3.0) == [end(A, "", at=3.0)]
        assert one.tick(11.9) == []
        assert one.tick(12.0) == [ask(at=12.0)]
        one.heard(SATISFIED, 13.0)
        assert phase(one) is Phase.NONE

    def test_clearance_is_asked_only_outside(self) -> None:
        one = FleetRobot(A, "lift", TRAITS["kilted"], crowded=lambda: True)
        one.request_lift("L2", inside=True, now=1.0)
        one.heard(SATISFIED, 2.0)
        assert phase(one) is Phase.NONE


class TestOthers:
    def test_rmf_web_uses_its_node_name_and_ends_the_session_of_any_robot(self) -> None:
        web = RmfWeb()
        assert web.request("lift", "L2", 1.0).session_id == "rmf_api_server"
        sent = web.end("lift", A, "L3", 1.0)
        assert (sent.session_id, sent.request_type, sent.destination_floor) == (A, END_SESSION, "L3")

    def test_the_demo_script_sends_request_type_0_with_a_session_of_its_own(self) -> None:
        first, second = (request_lift_script("lift", "L2", number, 1.0) for number in (1, 2))
        assert first.request_type == END_SESSION == 0
        assert first.session_id.startswith("lift_request#")
        assert first.session_id != second.session_id

    def test_the_panel_asks_past_the_supervisor_which_ends_the_unknown_session(self) -> None:
        sent = panel_request("lift", "L2", "rviz", 1.0)
        assert sent.request_type == AGV_MODE
        assert supervisor("kilted").heard(state(sent.session_id), 2.0) == [end("rviz", "L1", at=2.0)]
