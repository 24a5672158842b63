"""What of a ride outlives the manager, and how it goes on."""

from dataclasses import replace
from datetime import timedelta

import pytest

from lift_manager.lift.observation import Moment
from lift_manager.rides.record import (
    RESTORED_FOR_S,
    Clearing,
    must_outlive,
    published,
    restore,
    save,
    waits_in_queue,
)
from lift_manager.rides.ride import Guidance, Phase
from tests.lift_manager.rides.by_hand import NOON, REQUEST, at, ride

RIDING = ride(Phase.RIDING, phase_since=40.0, could_exit_at="L1", reason="the car is on its way to L3")


@pytest.mark.parametrize("gone_s", [0.0, 30.0, -500.0], ids=["at once", "a while", "the clock was set back"])
def test_the_limit_of_a_phase_goes_on_over_a_restart(gone_s: float) -> None:
    saved = save(RIDING, at(50.0))
    back = restore(saved, "A", Moment(7.0, NOON + timedelta(seconds=50.0 + gone_s)))
    assert back.ends_at - 7.0 == pytest.approx(190.0 - max(0.0, gone_s))


def test_a_ride_goes_on_after_a_restart_with_what_its_robot_reported() -> None:
    back = restore(save(RIDING, at(50.0)), "A", at(50.0))
    assert back == replace(RIDING, guidance=Guidance.STAY, reason="", silent_since=50.0, requested_at=float("-inf"))


def test_a_ride_that_is_over_is_shown_after_a_restart_as_before() -> None:
    over = ride(Phase.GAVE_UP, guidance=Guidance.GAVE_UP, reason="too late", maybe_aboard=True, ended_at=10.0)
    back = restore(save(over, at(50.0)), "A", at(50.0))
    assert published(back, 50.0) == published(over, 50.0)
    assert (back.silent_since, back.ended_at) == (None, 10.0)


def test_why_a_robot_is_let_out_outlives_the_manager() -> None:
    clearing = ride(Phase.CLEARING, clearing=Clearing(Phase.GAVE_UP, "too late"), clear_at="L2")
    back = restore(save(clearing, at(1.0)), "A", at(1.0))
    assert (back.clearing, back.clear_at, back.maybe_aboard) == (clearing.clearing, "L2", True)


def test_nothing_is_saved_of_a_ride_that_can_be_neither_requested_again_nor_cleared() -> None:
    without_key = replace(REQUEST, key="")
    assert not must_outlive(replace(ride(Phase.DONE), request=without_key))
    assert must_outlive(ride(Phase.DONE))
    assert must_outlive(replace(ride(Phase.GAVE_UP, maybe_aboard=True), request=without_key))
    assert must_outlive(replace(ride(), request=without_key))


def test_a_queued_ride_whose_robot_is_silent_after_a_restart_loses_its_place() -> None:
    silent = ride(silent_since=10.0)
    assert waits_in_queue(silent, 9.9 + RESTORED_FOR_S)
    assert not waits_in_queue(silent, 10.0 + RESTORED_FOR_S)
    assert waits_in_queue(ride(), 1e6)
    assert not waits_in_queue(ride(Phase.CALLED), 0.0)
