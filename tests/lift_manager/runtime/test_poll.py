"""How often a lift is read: at rest, ridden, after a press, and where its controller is slow."""

import asyncio
from itertools import pairwise

import pytest

from lift_manager.runtime.poll import RESPITE_S
from lift_manager.runtime.ticker import BEAT_S
from register_maps.words import Door
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.support.virtual_time import elapse

POLL_S, RIDDEN_S = 0.2, 0.05
SOME_S = 5.0


async def pace_s(made: Bench) -> float:
    """Return the mean time from one poll to the next."""
    before = made.life.polls()["lift"]
    await elapse(SOME_S)
    return SOME_S / (made.life.polls()["lift"] - before)


def test_a_lift_is_read_more_often_while_a_session_has_it() -> None:
    async def check(made: Bench) -> None:
        assert await pace_s(made) == pytest.approx(POLL_S, rel=0.05)
        session = made.opened()
        await elapse(1)
        assert await pace_s(made) == pytest.approx(RIDDEN_S, rel=0.05)
        made.closed(session)
        await elapse(1)
        assert await pace_s(made) == pytest.approx(POLL_S, rel=0.05)

    on_bench(check, PLAIN, poll_s=POLL_S, poll_ridden_s=RIDDEN_S)


def test_a_lift_whose_controller_is_slow_keeps_its_pace_while_a_session_has_it() -> None:
    async def check(made: Bench) -> None:
        made.driver.takes_s = 0.3 * RIDDEN_S
        made.accept("L3")
        await elapse(2)
        assert await pace_s(made) == pytest.approx(POLL_S, rel=0.05)
        made.driver.takes_s = 0.2 * RIDDEN_S
        await elapse(5)
        assert await pace_s(made) == pytest.approx(RIDDEN_S, rel=0.05)

    on_bench(check, PLAIN, poll_s=POLL_S, poll_ridden_s=RIDDEN_S)


def test_a_poll_that_takes_longer_than_its_pace_is_followed_by_the_next_at_once() -> None:
    async def check(made: Bench) -> None:
        made.driver.takes_s = 1.1 * POLL_S
        await elapse(1)
        assert await pace_s(made) == pytest.approx(made.driver.takes_s, abs=BEAT_S)

    on_bench(check, PLAIN, poll_s=POLL_S)


@pytest.mark.parametrize(
    ("poll_s", "least_s", "respite_s"),
    [(0.1, 0.1, 0.1), (0.2, 0.05, RESPITE_S), (0.5, 0.1, RESPITE_S), (1.0, 1.0, 0.7)],
)
def test_a_controller_that_did_not_answer_has_a_moment_before_it_is_asked_again(
    poll_s: float, least_s: float, respite_s: float
) -> None:
    async def check(made: Bench) -> None:
        made.driver.takes_s, made.driver.silent = 0.3, True
        await elapse(2)
        assert await pace_s(made) == pytest.approx(made.driver.takes_s + respite_s, rel=0.05)

    on_bench(check, PLAIN, poll_s=poll_s, poll_ridden_s=least_s)


@pytest.mark.parametrize("after_poll_s", [0.02, 0.08, 0.11])
def test_a_press_is_followed_by_a_poll_that_can_show_what_it_did(after_poll_s: float) -> None:
    async def check(made: Bench) -> None:
        reads, driver, loop = made.driver.read_at, made.driver, asyncio.get_running_loop()
        await elapse(1)
        await elapse(reads[-1] + POLL_S + after_poll_s - loop.time())
        polled = len(reads)
        made.accept("L3")
        await elapse(driver.delay_s)
        pressed_at = loop.time()
        await elapse(POLL_S)
        assert made.presses == ["go_to L3"]
        assert reads[polled] <= pressed_at + RIDDEN_S + BEAT_S
        assert all(after - before >= RIDDEN_S - BEAT_S for before, after in pairwise(reads[polled:]))

    on_bench(check, PLAIN, poll_s=POLL_S, poll_ridden_s=RIDDEN_S)


def test_a_press_during_a_poll_shortens_the_pause_after_it() -> None:
    async def check(made: Bench) -> None:
        made.driver.takes_s = 0.1
        made.driver.delay_s = 0.0
        await made.car("L2", Door.CLOSED)
        made.accept("L3")
        before = made.life.polls()["lift"]
        await elapse(0.1 + RIDDEN_S + BEAT_S + 0.1 + BEAT_S)
        assert made.life.polls()["lift"] >= before + 2

    on_bench(check, PLAIN, poll_s=1.0, poll_ridden_s=RIDDEN_S)
