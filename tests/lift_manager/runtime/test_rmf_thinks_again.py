"""A session of RMF that asks again in the grace of its END, and is refused: its END is taken back, unless the reason lasts."""

from dataclasses import replace

import pytest

from lift_manager.lift.refusals import Refusal
from register_maps.words import Mode
from tests.lift_manager.runtime.rmf_words import (
    HOLD,
    RMF,
    WITH_MODE,
    coming,
    ends,
    is_refused,
    open_for_it,
    stands_open,
    wants,
)
from tests.lift_manager.runtime.scripted import PERMITTING, PLAIN, Bench, on_bench
from tests.lift_manager.runtime.test_session_restart import held_by
from tests.support.refusals import reply
from tests.support.virtual_time import elapse


def test_a_session_that_asks_again_too_early_for_its_robot_to_be_aboard_goes_on_where_it_is() -> None:
    async def check(made: Bench) -> None:
        await coming(made)
        await stands_open(made, "L1")
        before = list(made.driver.log)
        ends(made)
        await elapse(1)
        assert is_refused(made, "L3").code is Refusal.OCCUPANCY_UNKNOWN
        await elapse(10)
        assert held_by(made) == RMF
        assert not made.state.ending
        assert made.driver.log == before
        wants(made, "L3")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]

    on_bench(check, PERMITTING, infer=True)


def too_often(made: Bench) -> None:
    """Use up what turns there are, between two floors at which the car does not stand."""
    while reply(wants, made, "L3" if made.state.destination == "L1" else "L1") is None:
        pass
    wants(made, made.state.destination or "")


def test_a_session_that_asks_again_too_often_goes_on_and_keeps_what_is_on() -> None:
    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        too_often(made)
        floor = made.state.destination or ""
        await elapse(0.5)
        await stands_open(made, floor)
        ends(made)
        await elapse(0.1)
        before = list(made.driver.log)
        assert is_refused(made, "L2").code is Refusal.TOO_OFTEN
        await elapse(10)
        assert held_by(made) == RMF
        assert made.driver.on == {HOLD, "robot_mode"}
        assert made.driver.log == before
        ends(made, 1)
        await elapse(1.1)
        assert held_by(made) is None, "END counts again"

    on_bench(check, WITH_MODE, poll_s=0.2)


def test_a_call_that_end_kept_back_is_not_pressed_by_a_request_that_is_refused() -> None:
    able = replace(WITH_MODE, requires={"go_to": frozenset({"robot_mode_on"})})

    async def check(made: Bench) -> None:
        too_often(made)
        floor = made.state.destination or ""
        await elapse(0.5)
        ends(made)
        assert is_refused(made, "L2").code is Refusal.TOO_OFTEN
        made.grants_robot_mode()
        await elapse(10)
        assert held_by(made) == RMF
        assert made.presses == []
        wants(made, floor)
        await elapse(1)
        assert made.presses == [f"go_to {floor}"]

    on_bench(check, able)


@pytest.mark.parametrize("floor", ["L2", "L9"])
def test_a_request_that_comes_too_often_takes_no_end_back_in_a_fire_or_for_a_floor_that_is_none(floor: str) -> None:
    async def check(made: Bench) -> None:
        too_often(made)
        await elapse(0.5)
        await stands_open(made, made.state.destination or "")
        if floor != "L9":
            await made.mode(Mode.FIRE)
        ends(made, 1)
        assert is_refused(made, floor).code is Refusal.TOO_OFTEN
        await elapse(1.1)
        assert held_by(made) is None

    on_bench(check, PLAIN, fire_release_delay_s=5)


def test_a_request_that_is_refused_because_of_a_mode_takes_no_end_back() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await made.mode(Mode.FIRE)
        ends(made, 1)
        assert is_refused(made, "L3").code is not Refusal.TOO_OFTEN
        await elapse(1.1)
        assert held_by(made) is None

    on_bench(check, PLAIN, fire_release_delay_s=5)


def test_a_request_for_a_floor_to_which_nothing_brings_the_robot_takes_no_end_back() -> None:
    able = replace(PERMITTING, commands=frozenset({"call", "robot_left"}))

    async def check(made: Bench) -> None:
        await open_for_it(made)
        await elapse(6)
        ends(made, 1)
        assert is_refused(made, "L3").code is Refusal.NOT_POSSIBLE
        await elapse(1.1)
        assert held_by(made) is None

    on_bench(check, able, infer=True)
