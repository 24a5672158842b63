"""The judge of who stands in the car believes a robot's own word, and no more than that."""

from collections.abc import Callable

import pytest

from lift_manager.lab.world.lift_under_test import Finding
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lift.events import HandedOver, SessionEnded, SessionOpened
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import EndReason, Holder
from lift_manager.runtime.errors import RequestRefused
from register_maps.words import Mode
from tests.campaigns.aboard import Aboard

R1, R2 = Holder("fleet", "r1"), Holder("fleet", "r2")


def found(then: Callable[[Aboard], None]) -> list[Finding]:
    """Let a robot of R1 get in at L2, then something happen, and give the lift to R2."""
    findings: list[Finding] = []
    judge = Aboard(findings)
    judge.on_truth(1.0, "lift", standing_at("L2"))
    judge.entered("lift", R1)
    then(judge)
    judge.on_event(9.0, SessionOpened("lift", R2, "L1"))
    return findings


def standing_at(floor: str) -> Truth:
    none = frozenset[str]()
    return Truth(floor, None, standing=True, doors_shut=True, mode=Mode.NORMAL, robot_mode=False, calls=none, given=())


@pytest.mark.parametrize(("to", "findings"), [(R2, 0), (Holder("fleet", "r3"), 1)])
def test_a_robot_in_the_car_is_of_whom_the_lift_was_handed_over_to(to: Holder, findings: int) -> None:
    assert len(found(lambda judge: judge.on_event(3.0, HandedOver("lift", R1, to)))) == findings


def test_nobody_gives_a_lift_away_in_which_the_robot_of_another_stands() -> None:
    def then(judge: Aboard) -> None:
        judge.on_event(3.0, HandedOver("lift", R2, R1))
        judge.left("lift")

    assert len(found(then)) == 1


def ends(judge: Aboard, reason: EndReason) -> None:
    judge.on_event(3.0, SessionEnded("lift", R1, reason, "over", None))


def test_the_lift_is_not_given_to_another_while_a_robot_stands_in_it() -> None:
    assert len(found(lambda judge: ends(judge, EndReason.LEASE))) == 1


def test_a_release_is_the_word_that_it_is_out() -> None:
    assert not found(lambda judge: ends(judge, EndReason.RELEASED))


def test_who_wanted_no_more_than_to_be_where_the_car_is_now_is_out() -> None:
    def then(judge: Aboard) -> None:
        judge.on_truth(2.0, "lift", standing_at("L1"))
        judge.on_request(2.0, FloorRequest("lift", R1, "L2", hold_door=False), None)
        judge.on_truth(3.0, "lift", standing_at("L2"))
        ends(judge, EndReason.ARRIVED)

    assert not found(then)


@pytest.mark.parametrize(
    ("last", "at"),
    [
        (FloorRequest("lift", R1, "L2", hold_door=False), "L1"),
        (FloorRequest("lift", R1, "L1", hold_door=True), "L1"),
        (FloorRequest("lift", R1, "L1", hold_door=False, robot=RobotWord.IN_PLACE), "L1"),
    ],
    ids=["the car is elsewhere", "the door is to be held", "it says that it is in the car"],
)
def test_an_arrival_is_not_believed_where(last: FloorRequest, at: str) -> None:
    def then(judge: Aboard) -> None:
        judge.on_truth(2.0, "lift", standing_at("L3"))
        judge.on_request(2.0, last, None)
        judge.on_truth(3.0, "lift", standing_at(at))
        ends(judge, EndReason.ARRIVED)

    assert len(found(then)) == 1


def test_a_request_that_was_refused_is_no_word() -> None:
    def then(judge: Aboard) -> None:
        judge.on_truth(2.0, "lift", standing_at("L1"))
        refused = RequestRefused(Refusal.HELD, "held")
        judge.on_request(2.0, FloorRequest("lift", R1, "L1", hold_door=False), refused)
        ends(judge, EndReason.ARRIVED)

    assert len(found(then)) == 1
