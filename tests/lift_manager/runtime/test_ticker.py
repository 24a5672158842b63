"""One timer for many pauses."""

import asyncio

import pytest

from lift_manager.runtime.ticker import BEAT_S, Pause, Ticker
from tests.support.virtual_time import elapse, run_virtual


async def lasted_until(pause: Pause, when: float, ticker: Ticker) -> float:
    """Wait for a pause; return when it ended."""
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[float] = loop.create_future()
    pause.last_until(when, ticker, lambda: ended.set_result(loop.time()))
    return await ended


@pytest.mark.parametrize("when", [0.0, 0.004, 0.01, 0.5, 0.5001, 7.3])
def test_a_pause_ends_when_it_is_due_and_at_most_a_beat_late(when: float) -> None:
    async def main() -> None:
        assert when - 1e-9 <= await lasted_until(Pause(), when, Ticker()) <= when + BEAT_S + 1e-9

    run_virtual(main)


def test_a_pause_until_a_time_that_has_passed_ends_at_once() -> None:
    async def main() -> None:
        await elapse(5)
        assert await lasted_until(Pause(), 2.0, Ticker()) == 5.0

    run_virtual(main)


def test_pauses_that_are_due_together_end_together_and_one_that_was_shortened_disturbs_nobody() -> None:
    async def main() -> None:
        ticker, shortened = Ticker(), Pause()
        asyncio.get_running_loop().call_later(0.1, shortened.end_by, 0.3)
        waits = [lasted_until(Pause(), when, ticker) for when in (0.991, 0.995, 1.0)]
        assert await asyncio.gather(*waits, lasted_until(shortened, 0.993, ticker)) == [1.0, 1.0, 1.0, 0.3]

    run_virtual(main)


def test_a_pause_may_be_shortened_and_is_never_made_longer() -> None:
    async def main() -> None:
        ticker, pause, loop = Ticker(), Pause(), asyncio.get_running_loop()
        loop.call_later(0.1, pause.end_by, 0.3)
        loop.call_later(0.2, pause.end_by, 0.5)
        for when, ends_at in ((1.0, 0.3), (2.0, 2.0)):
            assert await lasted_until(pause, when, ticker) == pause.until == ends_at

    run_virtual(main)


def test_a_pause_that_was_shortened_does_not_end_the_next_one() -> None:
    async def main() -> None:
        ticker, pause, loop = Ticker(), Pause(), asyncio.get_running_loop()
        loop.call_later(0.1, pause.end_by, 0.3)
        for when, ends_at in ((1.0, 0.3), (1.5, 1.5)):
            assert await lasted_until(pause, when, ticker) == ends_at

    run_virtual(main)


def test_a_pause_that_has_not_begun_is_shortened_once() -> None:
    async def main() -> None:
        ticker, pause = Ticker(), Pause()
        pause.end_by(0.2)
        pause.end_by(0.4)
        for ends_at in (0.2, 1.0):
            assert await lasted_until(pause, 1.0, ticker) == pause.until == ends_at

    run_virtual(main)
