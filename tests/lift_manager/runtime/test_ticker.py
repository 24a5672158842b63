"""One timer for many sleepers."""

import asyncio

from lift_manager.runtime.ticker import BEAT_S, Pause, Ticker
from tests.support.virtual_time import elapse, run_virtual


def test_a_sleeper_wakes_when_it_is_due_and_at_most_a_beat_late() -> None:
    async def main() -> None:
        ticker, loop = Ticker(), asyncio.get_running_loop()
        for when in (0.0, 0.004, 0.01, 0.5, 0.5001, 7.3):
            await ticker.sleep_until(when)
            assert when - 1e-9 <= loop.time() <= when + BEAT_S + 1e-9

    run_virtual(main)


def test_a_time_that_has_passed_wakes_at_once() -> None:
    async def main() -> None:
        ticker, loop = Ticker(), asyncio.get_running_loop()
        await elapse(5)
        await ticker.sleep_until(2.0)
        assert loop.time() == 5.0

    run_virtual(main)


def test_those_who_are_due_together_wake_together_and_a_cancelled_one_disturbs_nobody() -> None:
    async def main() -> None:
        ticker, loop, woken = Ticker(), asyncio.get_running_loop(), list[float]()

        async def sleeper(when: float) -> None:
            await ticker.sleep_until(when)
            woken.append(loop.time())

        async with asyncio.TaskGroup() as tasks:
            for when in (0.991, 0.995, 1.0):
                tasks.create_task(sleeper(when))
            given_up = tasks.create_task(sleeper(0.993))
            await elapse(0.1)
            given_up.cancel()
        assert woken == [1.0, 1.0, 1.0]

    run_virtual(main)


def test_a_pause_may_be_shortened_and_is_never_made_longer() -> None:
    async def main() -> None:
        ticker, pause, loop = Ticker(), Pause(), asyncio.get_running_loop()
        loop.call_later(0.1, pause.end_by, 0.3)
        loop.call_later(0.2, pause.end_by, 0.5)
        for when, ends_at in ((1.0, 0.3), (2.0, 2.0)):
            await pause.last_until(when, ticker)
            assert (pause.until, loop.time()) == (ends_at, ends_at)

    run_virtual(main)


def test_a_pause_that_has_not_begun_is_shortened_once() -> None:
    async def main() -> None:
        ticker, pause = Ticker(), Pause()
        pause.end_by(0.2)
        pause.end_by(0.4)
        for ends_at in (0.2, 1.0):
            await pause.last_until(1.0, ticker)
            assert pause.until == ends_at

    run_virtual(main)
