"""One timer for many sleepers."""

import asyncio

from lift_manager.runtime.ticker import BEAT_S, Ticker
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
