"""The virtual-time loop: exact, instant, and loud where a real loop would hang or forget."""

import asyncio
import itertools
import socket
import threading
import time

import pytest

from tests.support.programs import HANGS_S
from tests.support.virtual_time import (
    DeadlockError,
    LeftoverTaskError,
    TimeLimitError,
    UnhandledError,
    VirtualTimeError,
    elapse,
    run_virtual,
)


def now_s() -> float:
    return asyncio.get_running_loop().time()


def test_a_long_wait_costs_no_time_and_takes_exactly_as_long_as_it_says() -> None:
    async def main() -> float:
        await asyncio.sleep(3000)
        return now_s()

    started_s = time.monotonic()
    assert run_virtual(main) == 3000
    assert time.monotonic() - started_s < HANGS_S


def test_tasks_that_wait_side_by_side_wake_in_the_order_of_their_times() -> None:
    woken: list[tuple[float, str]] = []

    async def wake(name: str, *, after_s: float) -> None:
        await asyncio.sleep(after_s)
        woken.append((now_s(), name))

    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(wake("last", after_s=30))
            group.create_task(wake("first", after_s=0.25))
            group.create_task(wake("second", after_s=2))

    run_virtual(main)
    assert woken == [(0.25, "first"), (2, "second"), (30, "last")]


def test_a_timeout_fires_at_its_own_time_and_not_at_the_end_of_the_wait() -> None:
    async def main() -> float:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1.5):
                await asyncio.sleep(600)
        return now_s()

    assert run_virtual(main) == 1.5


def test_waits_of_days_are_exact_too() -> None:
    async def main() -> float:
        await asyncio.sleep(30 * 86_400)
        return now_s()

    assert run_virtual(main, limit_s=31 * 86_400) == 30 * 86_400


def test_many_short_waits_never_stall_on_rounding() -> None:
    async def main() -> float:
        await asyncio.sleep(100_000)
        for _ in range(1000):
            await asyncio.sleep(0.1)
        return now_s()

    assert run_virtual(main, limit_s=200_000) == pytest.approx(100_100)


def test_a_task_that_waits_for_what_nobody_does_is_a_deadlock_that_names_the_task_and_its_line() -> None:
    async def wait_for_nothing() -> None:
        await asyncio.Event().wait()

    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(wait_for_nothing(), name="forgotten")

    with pytest.raises(DeadlockError, match=r"nothing is scheduled.*forgotten at .*locks\.py:\d+ \(Event\.wait\)"):
        run_virtual(main)


def test_a_run_that_passes_its_limit_stops_there() -> None:
    async def main() -> None:
        for _ in itertools.count():
            await asyncio.sleep(1)

    with pytest.raises(TimeLimitError, match=r"limit_s=60"):
        run_virtual(main, limit_s=60)


def test_tasks_stopped_at_the_limit_may_still_wait_while_they_let_go() -> None:
    let_go: list[float] = []

    async def main() -> None:
        try:
            await asyncio.sleep(100)
        finally:
            await asyncio.sleep(5)
            let_go.append(now_s())

    with pytest.raises(TimeLimitError):
        run_virtual(main, limit_s=60)
    assert let_go == [5]


def test_a_task_that_spins_without_waiting_stops_the_run() -> None:
    async def main() -> None:
        for _ in itertools.count():
            await asyncio.sleep(0)

    with pytest.raises(TimeLimitError, match="time stands still"):
        run_virtual(main)


def test_a_task_left_over_fails_the_run_and_is_named() -> None:
    started: list[asyncio.Task[None]] = []

    async def main() -> None:
        started.append(asyncio.create_task(asyncio.sleep(10), name="nobody's"))
        await asyncio.sleep(1)

    with pytest.raises(LeftoverTaskError, match="nobody's at "):
        run_virtual(main)
    assert started[0].cancelled()


def test_the_error_of_the_main_coroutine_comes_before_the_tasks_it_left_over() -> None:
    started: list[asyncio.Task[None]] = []

    async def main() -> None:
        started.append(asyncio.create_task(asyncio.sleep(10), name="nobody's"))
        raise LookupError("the real reason")

    with pytest.raises(LookupError, match="the real reason") as caught:
        run_virtual(main)
    assert "nobody's" in caught.value.__notes__[0]


def test_an_error_in_a_callback_fails_the_run() -> None:
    def fail() -> None:
        raise LookupError("in a callback")

    async def main() -> None:
        asyncio.get_running_loop().call_later(1, fail)
        await asyncio.sleep(2)

    with pytest.raises(UnhandledError, match="in a callback"):
        run_virtual(main)


def test_an_error_in_a_task_that_nobody_waited_for_fails_the_run() -> None:
    async def fail() -> None:
        raise LookupError("in a task")

    async def main() -> None:
        task = asyncio.create_task(fail())
        await asyncio.sleep(1)
        del task

    with pytest.raises(UnhandledError, match="in a task"):
        run_virtual(main)


def test_sockets_are_refused_because_they_live_in_real_time() -> None:
    async def main(here: socket.socket) -> None:
        asyncio.get_running_loop().add_reader(here, here.recv, 1)

    here, there = socket.socketpair()
    with here, there, pytest.raises(RuntimeError, match="a socket or process runs in real time"):
        run_virtual(lambda: main(here))


def test_threads_are_refused_because_they_live_in_real_time() -> None:
    async def main() -> None:
        await asyncio.to_thread(threading.current_thread)

    with pytest.raises(RuntimeError, match="a thread runs in real time"):
        run_virtual(main)


def test_every_run_starts_at_zero() -> None:
    async def main() -> float:
        before_s = now_s()
        await asyncio.sleep(7)
        return before_s

    assert [run_virtual(main), run_virtual(main)] == [0, 0]


def test_the_errors_are_failures_of_a_test_and_share_one_root() -> None:
    for error in (DeadlockError, TimeLimitError, LeftoverTaskError, UnhandledError):
        assert issubclass(error, VirtualTimeError)
    assert issubclass(VirtualTimeError, AssertionError)


def test_virtual_time_does_not_pass_on_a_real_loop() -> None:
    with pytest.raises(VirtualTimeError, match="tests do not sleep"):
        asyncio.run(elapse(0.001))


def test_nobody_wakes_before_the_time_until_which_it_sleeps() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        for step in range(1, 2000):
            until = loop.time() + 0.1 / (step % 7 + 1)
            woken = loop.create_future()
            loop.call_at(until, woken.set_result, None)
            loop.call_at(until - 5e-10, lambda: None)
            await woken
            assert loop.time() >= until

    run_virtual(main)
