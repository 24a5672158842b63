"""The judge finds each thing that must never happen, lets pass what nobody can see, and nothing else."""

from dataclasses import replace

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.lab.world.lift_under_test import Excuse, LiftUnderTest, MapEvidence, SuspectValues
from lift_manager.lab.world.oracle import Oracle
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import RESTART, FaultChange, FloorRequest, ForgottenRecords
from lift_manager.lift.events import CommandEnded, HandedOver
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from register_maps import frames
from register_maps.words import Mode, Motion, Side, Table
from simulator.faults import FrozenHeartbeat, FrozenRegisters, InMode, LostPress, ReopeningDoor
from simulator.wire_faults import Exchange
from tests.support.rows import each_row

STANDS_OPEN = Truth(
    at="L2",
    open_at="L2",
    standing=True,
    doors_shut=False,
    mode=Mode.NORMAL,
    robot_mode=True,
    calls=frozenset(),
    given=(),
)
SHUT = replace(STANDS_OPEN, open_at=None, doors_shut=True)
DRIVES = replace(STANDS_OPEN, at=None, open_at=None, standing=False, doors_shut=True)
ROBOT = Holder("fleet", "r1")


def judge(**about: object) -> Oracle:
    known = {
        "controllers": ("plc",),
        "floors": ("L1", "L2"),
        "max_session_hold_s": 20.0,
        "arrive_within_s": 30.0,
        "blocks": frozenset({("plc", 1, Table.HOLDING, 0, 4)}),
    }
    return Oracle({"lift": LiftUnderTest(**(known | about))})  # type: ignore[arg-type]  # keywords of Judged


def state(*, age_s: float = 0.1, **said: object) -> LiftState:
    words = {
        "lift": "lift",
        "floors": ("L1", "L2"),
        "quality": Quality.LIVE,
        "reason": "",
        "age_s": age_s,
        "floor": "L2",
        "standing": True,
        "destination": "L2",
        "robot_door": RobotDoor.OPEN,
        "doors": {},
        "motion": Motion.STOPPED,
        "mode": Mode.NORMAL,
        "holder": ROBOT,
        "held_since_s": 5.0,
        "not_visible": {},
    }
    return LiftState(**(words | said))  # type: ignore[arg-type]  # keywords of LiftState


def answered(at: float, *, right: bytes = b"right", came: bytes = b"right") -> Exchange:
    request = frames.frame(frames.read(Table.HOLDING, 0, 4), 1)
    answers = ((at, came),) if came else ()
    return Exchange(sent_at=at, request=request, executed=True, right=right, answers=answers, honest=True, faults=())


def polled(oracle: Oracle, until: float, truth: Truth = STANDS_OPEN, since: float = 0.0) -> None:
    """Let the lift be polled five times a second, rightly."""
    at = since
    while at <= until + 1e-9:
        oracle.on_truth(at, "lift", truth)
        oracle.on_exchange(at, "plc", answered(at))
        at += 0.2


def rules(oracle: Oracle) -> list[str]:
    """What was found, also of what is judged a moment later."""
    return [finding.rule for finding in oracle.findings]


def test_a_lift_that_is_what_it_is_said_to_be_breaks_no_rule() -> None:
    oracle = judge()
    polled(oracle, 4.0)
    oracle.on_state(4.1, "lift", state())
    assert rules(oracle) == []
    assert (oracle.judged, oracle.invitations) == (1, 1)


def test_an_open_door_that_is_not_there_is_found() -> None:
    oracle = judge()
    polled(oracle, 4.0, SHUT)
    oracle.on_state(4.1, "lift", state())
    assert rules(oracle) == ["said open and was not"]


def test_an_open_door_at_another_floor_is_found() -> None:
    oracle = judge()
    polled(oracle, 4.0)
    oracle.on_state(4.1, "lift", state(floor="L1"))
    assert rules(oracle) == ["said open and was not"]


def test_a_door_that_shut_after_the_reading_was_taken_is_no_lie_yet() -> None:
    oracle = judge()
    polled(oracle, 4.0)
    oracle.on_truth(4.15, "lift", SHUT)
    oracle.on_state(4.2, "lift", state(age_s=0.2))
    assert rules(oracle) == []


def test_a_door_that_was_shut_before_the_reading_was_taken_is_a_lie() -> None:
    oracle = judge()
    polled(oracle, 4.0)
    polled(oracle, 4.6, SHUT, since=4.2)
    oracle.on_state(4.7, "lift", state(age_s=0.2))
    assert rules(oracle) == ["said open and was not"]


def test_a_state_that_no_fresh_answer_bears_out_is_stale_whatever_age_it_claims() -> None:
    oracle = judge()
    polled(oracle, 4.0)
    oracle.on_state(5.2, "lift", state(age_s=0.1))
    assert "stale" in rules(oracle)


def test_an_answer_that_is_still_on_its_way_does_not_make_a_state_fresh() -> None:
    oracle = judge()
    polled(oracle, 4.0)
    late = answered(4.9)
    oracle.on_exchange(4.9, "plc", replace(late, answers=((5.9, b"right"),)))
    oracle.on_state(5.2, "lift", state(robot_door=RobotDoor.MOVING))
    assert rules(oracle) == ["stale"]


@pytest.mark.parametrize("came", [b"", b"wrong", b"right"[:-1]])
def test_an_answer_that_was_spoilt_does_not_make_a_state_fresh(came: bytes) -> None:
    oracle = judge()
    polled(oracle, 4.0)
    oracle.on_exchange(4.9, "plc", answered(4.9, came=came))
    oracle.on_state(5.2, "lift", state(robot_door=RobotDoor.MOVING))
    assert rules(oracle) == ["stale"]


def test_a_lift_that_is_said_to_be_offline_may_be_anything() -> None:
    oracle = judge()
    polled(oracle, 4.0, SHUT)
    oracle.on_state(9.0, "lift", state(quality=Quality.OFFLINE, robot_door=RobotDoor.MOVING))
    assert rules(oracle) == []


def test_an_invitation_into_a_lift_on_fire_is_found() -> None:
    oracle = judge()
    polled(oracle, 4.0, replace(STANDS_OPEN, mode=Mode.FIRE))
    oracle.on_state(4.1, "lift", state(age_s=0.1, mode=Mode.FIRE))
    assert rules(oracle) == ["said open in a forbidden mode"]


def test_a_press_long_after_the_mode_forbade_it_is_found_and_one_before_anybody_could_know_is_not() -> None:
    oracle = judge()
    polled(oracle, 4.0)
    polled(oracle, 8.0, replace(STANDS_OPEN, mode=Mode.INSPECTION), since=4.2)
    oracle.on_press(4.3, "lift", frozenset({"go_to"}))
    assert rules(oracle) == []
    oracle.on_press(8.1, "lift", frozenset({"go_to"}))
    assert rules(oracle) == ["pressed in a forbidden mode"]


def test_a_confirmed_call_that_the_lift_never_had_is_found() -> None:
    oracle = judge()
    polled(oracle, 4.0, DRIVES)
    outcome = Outcome(Command(CommandKind.GO_TO, "L1"), Result.CONFIRMED, "", Proof.LAMP, (), grant_missing=False)
    oracle.on_event(4.1, CommandEnded("lift", outcome))
    polled(oracle, 9.0, DRIVES, since=8.0)
    assert rules(oracle) == ["confirmed without effect"]


def test_a_confirmed_call_that_was_registered_is_right() -> None:
    oracle = judge()
    polled(oracle, 4.0, replace(DRIVES, calls=frozenset({"L1"})))
    outcome = Outcome(Command(CommandKind.GO_TO, "L1"), Result.CONFIRMED, "", Proof.LAMP, (), grant_missing=False)
    oracle.on_event(4.1, CommandEnded("lift", outcome))
    assert rules(oracle) == []


def test_a_confirmed_hold_that_the_controller_never_had_is_found() -> None:
    oracle = judge()
    polled(oracle, 4.0)
    hold = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
    oracle.on_event(
        4.1, CommandEnded("lift", Outcome(hold, Result.CONFIRMED, "", Proof.READBACK, (), grant_missing=False))
    )
    polled(oracle, 9.0, DRIVES, since=8.0)
    assert rules(oracle) == ["confirmed without effect"]


@pytest.mark.parametrize(
    ("modes", "findings"),
    [(frozenset(), []), (frozenset({Mode.INSPECTION}), ["confirmed without effect"])],
    ids=["not told", "told"],
)
def test_a_call_that_reads_on_in_a_mode_without_robots_is_let_pass_where_nothing_tells_the_mode(
    modes: frozenset[Mode], findings: list[str]
) -> None:
    oracle = judge(shows=MapEvidence(modes=modes))
    inspected = replace(DRIVES, mode=Mode.INSPECTION)
    polled(oracle, 4.0, inspected)
    outcome = Outcome(Command(CommandKind.CALL, "L1"), Result.CONFIRMED, "", Proof.READBACK, (), grant_missing=False)
    oracle.on_event(4.1, CommandEnded("lift", outcome))
    polled(oracle, 9.0, inspected, since=8.0)
    assert rules(oracle) == findings
    assert bool(oracle.excused) is not bool(findings)


HELD = replace(STANDS_OPEN, given=(("hold_door.front", 1),))


def test_a_door_that_is_held_for_nobody_is_found() -> None:
    oracle = judge()
    polled(oracle, 0.0, HELD)
    oracle.on_state(0.0, "lift", state(holder=None))
    polled(oracle, 2.9, HELD, since=0.2)
    assert rules(oracle) == []
    polled(oracle, 5.0, HELD, since=3.0)
    assert rules(oracle) == ["output on too long"]


@pytest.mark.parametrize("newest", ["a release", "a call that releases", "a release, then handed over"])
def test_what_did_not_reach_the_disk_before_a_kill_is_forgotten_and_nothing_else(newest: str) -> None:
    def held_after(*forgotten: str) -> list[str]:
        oracle, holder = judge(), ROBOT
        oracle.on_request(0.0, FloorRequest("lift", ROBOT, "L2", hold_door=True), None)
        oracle.on_state(0.0, "lift", state(robot_door=RobotDoor.MOVING, quality=Quality.OFFLINE))
        polled(oracle, 4.0, HELD)
        floor = "L1" if newest == "a call that releases" else "L2"
        oracle.on_request(4.0, FloorRequest("lift", ROBOT, floor, hold_door=False), None)
        oracle.on_fault(4.2, FaultChange("disk", ForgottenRecords(forgotten), began=True))
        if newest == "a release, then handed over":
            holder = Holder("fleet", "r2")
            oracle.on_event(4.2, HandedOver("lift", ROBOT, holder))
        oracle.on_state(4.2, "lift", state(robot_door=RobotDoor.MOVING, holder=holder))
        polled(oracle, 10.0, HELD, since=4.2)
        return rules(oracle)

    assert held_after("lift") == []
    assert "output on too long" in held_after("another")


def test_a_door_that_is_held_for_longer_than_the_site_allows_is_found_although_somebody_wants_it() -> None:
    oracle = judge()
    oracle.on_state(0.0, "lift", state(quality=Quality.OFFLINE))
    polled(oracle, 22.0, HELD)
    assert rules(oracle) == []
    polled(oracle, 25.0, HELD, since=22.2)
    assert rules(oracle) == ["output on too long"]


def test_an_output_that_nobody_could_let_go_of_because_of_the_wire_is_not_held_against_the_manager() -> None:
    oracle = judge()
    polled(oracle, 2.0, HELD)
    oracle.on_state(2.0, "lift", state(holder=None))
    at = 2.2
    while at < 12.0:
        oracle.on_truth(at, "lift", HELD)
        oracle.on_exchange(at, "plc", answered(at, came=b""))
        at += 0.2
    assert rules(oracle) == []


def frozen(within_s: float | None) -> dict[str, Excuse]:
    return {"frozen_registers": Excuse(frozenset({SuspectValues.EFFECT, SuspectValues.OUTPUT}), within_s)}


@pytest.mark.parametrize(("within_s", "found"), [(None, []), (10.0, []), (2.0, ["said open and was not"])])
def test_what_is_undetectable_is_let_pass_and_what_must_be_detected_only_for_so_long(
    within_s: float | None, found: list[str]
) -> None:
    oracle = judge(excuses=frozen(within_s))
    polled(oracle, 2.0)
    oracle.on_fault(2.0, FaultChange("lift", FrozenRegisters(), began=True))
    polled(oracle, 6.0, SHUT, since=2.2)
    oracle.on_state(6.1, "lift", state())
    assert rules(oracle) == found
    assert oracle.excused == ({} if found else {("lift", "said open and was not", "frozen_registers"): 1})


@pytest.mark.parametrize(("at", "found"), [(4.5, []), (5.5, ["said open and was not"])])
def test_registers_that_froze_before_a_slow_answer_must_be_noticed_only_from_the_next_reading_on(
    at: float, found: list[str]
) -> None:
    # the alive counter of that reading has changed since the one before
    oracle = judge(excuses=frozen(2.0))
    polled(oracle, 1.9)
    oracle.on_fault(2.0, FaultChange("lift", FrozenRegisters(), began=True))
    polled(oracle, 6.0, SHUT, since=3.0)
    oracle.on_state(at, "lift", state())
    assert rules(oracle) == found


@pytest.mark.parametrize(("age_s", "found"), [(0.5, []), (0.2, ["said open and was not"])])
def test_an_answer_from_frozen_registers_that_came_after_they_moved_again_shows_what_they_showed(
    age_s: float, found: list[str]
) -> None:
    # whatever shows that registers stand still shows by then that they move
    oracle = judge(excuses=frozen(2.0))
    polled(oracle, 2.0)
    oracle.on_fault(2.0, FaultChange("lift", FrozenRegisters(), began=True))
    polled(oracle, 6.0, SHUT, since=2.2)
    oracle.on_fault(6.0, FaultChange("lift", FrozenRegisters(), began=False))
    polled(oracle, 6.4, SHUT, since=6.2)
    oracle.on_state(6.3, "lift", state(age_s=age_s))
    assert rules(oracle) == found


def test_a_fault_excuses_nothing_but_its_own_lies() -> None:
    oracle = judge(excuses={"lost_press": Excuse(frozenset({SuspectValues.EFFECT}), None)})
    polled(oracle, 2.0, SHUT)
    oracle.on_fault(2.0, FaultChange("lift", LostPress(), began=True))
    oracle.on_state(2.1, "lift", state())
    assert rules(oracle) == ["said open and was not"]


def test_an_excuse_ends_soon_after_its_fault() -> None:
    oracle = judge(excuses=frozen(None))
    polled(oracle, 2.0, SHUT)
    oracle.on_fault(2.0, FaultChange("lift", FrozenRegisters(), began=True))
    oracle.on_fault(3.0, FaultChange("lift", FrozenRegisters(), began=False))
    polled(oracle, 9.0, SHUT, since=3.2)
    oracle.on_state(9.1, "lift", state())
    assert rules(oracle) == ["said open and was not"]


def test_one_block_of_the_poll_that_is_not_answered_makes_the_whole_state_stale() -> None:
    blocks = frozenset({("plc", 1, Table.HOLDING, 0, 4), ("plc", 1, Table.DISCRETE, 0, 8)})
    oracle = judge(blocks=blocks)
    polled(oracle, 4.0)
    oracle.on_state(4.1, "lift", state(robot_door=RobotDoor.MOVING))
    assert rules(oracle) == ["stale"]


def test_a_manager_that_merely_keeps_silent_is_not_excused_by_it() -> None:
    oracle = judge(poll_s=1.2)
    oracle.on_state(0.0, "lift", state(holder=None, robot_door=RobotDoor.MOVING, quality=Quality.OFFLINE))
    for tick in range(12):
        oracle.on_truth(tick * 1.2, "lift", HELD)
        oracle.on_exchange(tick * 1.2, "plc", answered(tick * 1.2))
    assert "output on too long" in rules(oracle)


def test_a_call_that_nobody_wants_any_more_is_found_as_soon_as_a_door_is() -> None:
    oracle = judge()
    called = replace(STANDS_OPEN, given=(("go_to", 1),))
    polled(oracle, 0.0, called)
    oracle.on_state(0.0, "lift", state(holder=None))
    polled(oracle, 5.0, called, since=0.2)
    assert rules(oracle) == ["output on too long"]


def test_robot_mode_may_last_while_the_car_is_under_way() -> None:
    oracle = judge()
    driving = replace(DRIVES, given=(("robot_mode", 1),))
    polled(oracle, 2.0, driving)
    oracle.on_state(2.0, "lift", state(holder=None, quality=Quality.OFFLINE))
    polled(oracle, 20.0, driving, since=2.2)
    assert rules(oracle) == []
    polled(oracle, 30.0, replace(driving, standing=True), since=20.2)
    assert set(rules(oracle)) == {"output on too long"}


def test_robot_mode_may_last_while_a_heartbeat_that_stands_still_hides_the_car() -> None:
    oracle = judge(excuses={"frozen_heartbeat": Excuse(frozenset(), None)})
    stands = replace(STANDS_OPEN, given=(("robot_mode", 1),))
    polled(oracle, 2.0, stands)
    oracle.on_fault(2.0, FaultChange("lift", FrozenHeartbeat(), began=True))
    oracle.on_state(2.0, "lift", state(holder=None, quality=Quality.OFFLINE))
    polled(oracle, 15.0, stands, since=2.2)
    # what strikes meanwhile does not make the judge forget it
    oracle.on_fault(15.0, FaultChange("lift", ReopeningDoor(Side.FRONT), began=True))
    polled(oracle, 25.0, stands, since=15.2)
    assert rules(oracle) == []
    oracle.on_fault(25.0, FaultChange("lift", FrozenHeartbeat(), began=False))
    polled(oracle, 35.0, stands, since=25.2)
    assert set(rules(oracle)) == {"output on too long"}


@pytest.mark.parametrize(("hidden", "found"), [(True, []), (False, ["output on too long"])])
def test_a_hold_may_last_at_another_floor_only_where_nothing_shows_the_car(hidden: bool, found: list[str]) -> None:
    oracle = judge(excuses={"frozen_heartbeat": Excuse(frozenset(), None)})
    oracle.on_request(0.0, FloorRequest("lift", ROBOT, "L1", hold_door=True), None)
    oracle.on_state(0.0, "lift", state(destination="L1", quality=Quality.OFFLINE))
    if hidden:
        oracle.on_fault(0.0, FaultChange("lift", FrozenHeartbeat(), began=True))
    polled(oracle, 4.0, HELD)
    assert rules(oracle) == found


def test_robot_mode_may_last_while_frozen_registers_show_a_car_that_moves_and_not_one_that_stands() -> None:
    def kept_on(frozen_at: Truth, *, restarted: bool = False, beats_within_s: float | None = 3.0) -> set[str]:
        excuses = {"frozen_registers": Excuse(frozenset({SuspectValues.OUTPUT}), 4.0)}
        oracle = judge(excuses=excuses, shows=MapEvidence(beats_within_s=beats_within_s))
        given = (("robot_mode", 1),)
        polled(oracle, 2.0, replace(frozen_at, given=given))
        oracle.on_fault(2.0, FaultChange("lift", FrozenRegisters(), began=True))
        if restarted:
            oracle.on_fault(2.1, FaultChange("manager", RESTART, began=True))
        oracle.on_state(2.2, "lift", state(holder=None, quality=Quality.OFFLINE))
        polled(oracle, 25.0, replace(STANDS_OPEN, given=given), since=2.2)
        return set(rules(oracle))

    assert kept_on(DRIVES) == set()
    assert kept_on(STANDS_OPEN) == {"output on too long"}
    # a manager that has never seen the heartbeat beat believes nothing else either
    assert kept_on(STANDS_OPEN, restarted=True) == set()
    assert kept_on(STANDS_OPEN, restarted=True, beats_within_s=None) == {"output on too long"}


def test_a_call_that_was_served_before_it_was_pressed_confirms_nothing() -> None:
    oracle = judge()
    polled(oracle, 2.0, replace(DRIVES, calls=frozenset({"L1"})))
    polled(oracle, 6.0, DRIVES, since=2.2)
    oracle.on_press(6.0, "lift", frozenset({"go_to"}))
    polled(oracle, 7.0, DRIVES, since=6.2)
    outcome = Outcome(Command(CommandKind.GO_TO, "L1"), Result.CONFIRMED, "", Proof.EFFECT, (), grant_missing=False)
    oracle.on_event(7.1, CommandEnded("lift", outcome))
    polled(oracle, 9.0, DRIVES, since=8.0)
    assert rules(oracle) == ["confirmed without effect"]


@each_row(
    ("at_the_press", "afterwards", "found"),
    [
        (STANDS_OPEN, STANDS_OPEN, ["confirmed without effect"]),
        (STANDS_OPEN, replace(DRIVES, passed="L2", heading=-1), []),
        (STANDS_OPEN, replace(DRIVES, passed="L2", heading=1), ["confirmed without effect"]),
        (
            replace(DRIVES, passed="L2", heading=-1),
            replace(DRIVES, passed="L2", heading=-1),
            ["confirmed without effect"],
        ),
    ],
)
def test_a_lost_call_is_no_excuse_for_a_confirmation_unless_the_car_then_sets_out_for_there(
    at_the_press: Truth, afterwards: Truth, found: list[str]
) -> None:
    lost = {"lost_press": Excuse(frozenset({SuspectValues.EFFECT}), None)}
    outcome = Outcome(Command(CommandKind.GO_TO, "L1"), Result.CONFIRMED, "", Proof.EFFECT, (), grant_missing=False)
    oracle = judge(excuses=lost)
    polled(oracle, 6.0, at_the_press)
    oracle.on_fault(6.0, FaultChange("lift", LostPress(), began=True))
    oracle.on_press(6.0, "lift", frozenset({"go_to"}))
    polled(oracle, 7.0, afterwards, since=6.2)
    oracle.on_event(7.1, CommandEnded("lift", outcome))
    polled(oracle, 9.0, STANDS_OPEN, since=8.0)
    assert rules(oracle) == found


@pytest.mark.parametrize("tells_motion", [True, False])
def test_a_car_that_set_out_before_a_press_is_let_pass_only_where_nobody_could_see_that_it_had(
    *, tells_motion: bool
) -> None:
    outcome = Outcome(Command(CommandKind.GO_TO, "L1"), Result.CONFIRMED, "", Proof.EFFECT, (), grant_missing=False)
    oracle = judge(shows=MapEvidence(motion=tells_motion))
    polled(oracle, 5.0, replace(STANDS_OPEN, open_at=None, doors_shut=True, passed="L2"))
    polled(oracle, 7.0, replace(DRIVES, passed="L2", heading=-1), since=5.2)
    oracle.on_press(7.0, "lift", frozenset({"go_to"}))
    oracle.on_event(7.1, CommandEnded("lift", outcome))
    polled(oracle, 9.0, replace(DRIVES, passed="L2", heading=-1), since=7.2)
    assert rules(oracle) == (["confirmed without effect"] if tells_motion else [])


def test_a_session_that_ends_in_a_mode_nobody_can_see_leaves_its_outputs_the_usual_time() -> None:
    called = replace(STANDS_OPEN, given=(("go_to", 1),))
    oracle = judge(shows=MapEvidence(modes=frozenset()))
    oracle.on_exchange(0.0, "plc", answered(0.0))
    oracle.on_state(0.0, "lift", state(robot_door=RobotDoor.MOVING))
    polled(oracle, 2.0, called)
    oracle.on_fault(2.0, FaultChange("lift", InMode(Mode.FIRE), began=True))
    polled(oracle, 7.9, replace(called, mode=Mode.FIRE), since=2.2)
    oracle.on_state(7.9, "lift", state(robot_door=RobotDoor.MOVING, holder=None))
    polled(oracle, 10.5, replace(called, mode=Mode.FIRE), since=8.0)
    assert rules(oracle) == []
    polled(oracle, 13.0, replace(called, mode=Mode.FIRE), since=10.8)
    assert rules(oracle) == ["output on too long"]


def test_what_a_fault_left_on_unseen_is_let_pass_only_until_it_has_been_off_once() -> None:
    oracle = judge(excuses=frozen(None))
    polled(oracle, 2.0, HELD)
    oracle.on_state(2.0, "lift", state(holder=None))
    oracle.on_fault(2.0, FaultChange("lift", FrozenRegisters(), began=True))
    oracle.on_fault(3.0, FaultChange("lift", FrozenRegisters(), began=False))
    polled(oracle, 20.0, HELD, since=2.2)
    assert rules(oracle) == []
    assert oracle.excused
    polled(oracle, 21.0, STANDS_OPEN, since=20.2)
    polled(oracle, 35.0, HELD, since=21.2)
    assert set(rules(oracle)) == {"output on too long"}
