"""A fire, told to RMF (open-rmf 1.7)."""

from __future__ import annotations

import logging

import pytest

from lift_manager.plain.rmf import Alarms, LiftView
from lift_manager.rmf.alarms import FORGET_S, REPEAT_S
from lift_manager.rmf.messages import MODE_FIRE
from tests.lift_manager.rmf.bench import Bench, bench, lift

WANTED = Alarms(fire_alarm=True)
CLEARED = Alarms(fire_alarm=True, clear_on_acknowledge=True)


def test_a_fire_is_told_only_where_the_site_says_so() -> None:
    quiet = bench()
    quiet.change(mode="fire", fire_latched=True)
    quiet.elapse(5)
    assert (quiet.alarm.said, quiet.alarm.offered) == ([], [])
    assert quiet.state.current_mode == MODE_FIRE


@pytest.mark.parametrize("alarms", [WANTED, Alarms(emergency_signal=True)])
def test_whoever_listens_finds_us_before_there_is_a_fire(alarms: Alarms) -> None:
    ride = bench(alarms=alarms)
    ride.elapse(5)
    assert (ride.alarm.offered, ride.alarm.said) == ([alarms], [])
    ride.change(fire_latched=True)
    assert ride.alarm.said == [True]


@pytest.mark.parametrize(("alarms", "last"), [(WANTED, []), (CLEARED, [False])])
def test_a_fire_is_told_while_it_lasts_and_cleared_once_by_a_person_and_only_where_the_site_says_so(
    alarms: Alarms, last: list[bool]
) -> None:
    """KABAM says false every second, which clears the alarms of other systems."""
    ride = bench(alarms=alarms)
    ride.elapse(5)
    assert ride.alarm.said == []
    begun = ride.now
    ride.change(mode="fire", fire_latched=True)
    ride.elapse(5)
    ride.change(mode="normal")
    ride.elapse(5)
    assert set(ride.alarm.said) == {True}, "it is over when a person says so"
    assert len(ride.alarm.said) == pytest.approx((ride.now - begun) / REPEAT_S, abs=1)
    told = len(ride.alarm.said)
    ride.change(fire_latched=False)
    ride.elapse(60)
    assert ride.alarm.said[told:] == last


def test_what_was_said_last_is_forgotten_once_it_has_arrived() -> None:
    ride = bench(alarms=CLEARED)
    ride.change(fire_latched=True)
    ride.change(fire_latched=False)
    assert (ride.alarm.said, ride.alarm.forgotten_after) == ([True, False], [])
    ride.elapse(FORGET_S + 0.1)
    assert ride.alarm.forgotten_after == [2]
    ride.elapse(60)
    assert ride.alarm.forgotten_after == [2]


def test_a_fire_that_comes_back_at_once_is_not_forgotten() -> None:
    ride = bench(alarms=CLEARED)
    ride.change(fire_latched=True)
    ride.change(fire_latched=False)
    ride.change(fire_latched=True)
    ride.elapse(60)
    assert ride.alarm.forgotten_after == []
    assert ride.alarm.said[:3] == [True, False, True]


def test_a_fire_that_is_latched_is_told_again_after_a_restart_of_the_adapter() -> None:
    ride = bench(alarms=WANTED)
    ride.change(fire_latched=True)
    ride.restart_adapter()
    ride.report_site()
    assert ride.alarm.said == [True, True]


def test_a_manager_that_is_lost_clears_no_alarm() -> None:
    ride = bench(alarms=CLEARED)
    ride.change(fire_latched=True)
    ride.adapter.on_manager_lost("connection refused", ride.now)
    for _ in range(100):
        ride.now += 0.1
        ride.adapter.tick(ride.now)
    assert set(ride.alarm.said) == {True}


@pytest.mark.parametrize("other", [{}, {"west": lift("west")}])
def test_a_burning_lift_that_is_told_of_no_more_was_acknowledged_by_nobody(other: dict[str, LiftView]) -> None:
    ride = Bench(views={"east": lift("east"), **other}, alarms=CLEARED)
    ride.change("east", fire_latched=True)
    del ride.views["east"]
    ride.elapse(10)
    assert False not in ride.alarm.said


def test_a_fire_that_the_site_tells_no_more_is_forgotten_and_not_cleared(caplog: pytest.LogCaptureFixture) -> None:
    """The last word is kept for whoever joins: an adapter beside goes on while its manager starts with another file."""
    ride = bench(alarms=CLEARED)
    ride.change(fire_latched=True)
    told = len(ride.alarm.said)
    ride.boot, ride.alarms = "second", Alarms()
    ride.report_site()
    assert ride.alarm.forgotten_after == [told]
    assert caplog.messages[-1].startswith("the site file now announces fires to RMF on other topics")
    ride.elapse(10)
    ride.change(fire_latched=False)
    ride.elapse(60)
    assert (ride.alarm.forgotten_after, len(ride.alarm.said)) == ([told], told)


def test_a_fire_that_the_site_tells_in_one_way_less_is_forgotten_there_and_goes_on_in_the_other() -> None:
    ride = bench(alarms=Alarms(fire_alarm=True, emergency_signal=True))
    ride.change(fire_latched=True)
    told = len(ride.alarm.said)
    ride.alarms = WANTED
    ride.report_site()
    assert (ride.alarm.offered[-1], ride.alarm.forgotten_after) == (WANTED, [told])
    assert ride.alarm.said[told:] == [True], "forgetting takes both back"
    ride.elapse(10)
    assert len(ride.alarm.said) > told + 3


def test_a_site_that_begins_to_tell_of_fires_while_there_is_one_tells_of_it() -> None:
    ride = bench(alarms=WANTED)
    ride.change(fire_latched=True)
    ride.alarms = Alarms()
    ride.elapse(5)
    told = len(ride.alarm.said)
    ride.alarms = WANTED
    ride.report_site()
    assert ride.alarm.said[told:] == [True]


def test_who_reads_the_log_finds_why_robots_left(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    ride = bench(alarms=CLEARED)
    ride.change(fire_latched=True)
    ride.elapse(10)
    ride.change(fire_latched=False)
    ride.elapse(10)
    assert [text for text in caplog.messages if "fire" in text] == [
        "fire in lift_rmf: announced to RMF",
        "the fire was acknowledged: the alarm in RMF is cleared",
    ]


def test_the_adapter_wakes_to_tell_again() -> None:
    ride = Bench(views={}, alarms=WANTED)
    ride.views["lift"] = lift(fire_latched=True)
    ride.report_site()
    now = ride.now
    for _ in range(20):
        now = ride.adapter.tick(now)
    assert len(ride.alarm.said) >= 3


def test_a_second_lift_in_fire_is_no_second_alarm_and_the_first_to_be_well_ends_none() -> None:
    ride = Bench(views={"east": lift("east"), "west": lift("west")}, alarms=CLEARED)
    ride.change("east", fire_latched=True)
    ride.change("west", fire_latched=True)
    ride.change("east", fire_latched=False)
    assert ride.alarm.said == [True]
    ride.change("west", fire_latched=False)
    assert ride.alarm.said == [True, False]
