"""A flag does what an asyncio.Event does."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from drivers.flag import Flag
from tests.drivers.linked import virtual


@pytest.fixture(params=[Flag, asyncio.Event], ids=["flag", "asyncio"])
def flag(request: pytest.FixtureRequest) -> Flag | asyncio.Event:
    make: Callable[[], Flag | asyncio.Event] = request.param
    return make()


async def _turn() -> None:
    await asyncio.sleep(0)


@virtual
async def test_a_flag_that_is_set_keeps_nobody_waiting(flag: Flag) -> None:
    assert not flag.is_set()
    flag.set()
    await flag.wait()
    assert flag.is_set()


@virtual
async def test_everybody_who_waits_continues_once_it_is_set(flag: Flag) -> None:
    waiting = [asyncio.ensure_future(flag.wait()) for _ in range(3)]
    await _turn()
    assert not any(waiter.done() for waiter in waiting)
    flag.set()
    await asyncio.gather(*waiting)


@virtual
async def test_whoever_waited_continues_though_it_is_cleared_at_once(flag: Flag) -> None:
    waiter = asyncio.ensure_future(flag.wait())
    await _turn()
    flag.set()
    flag.clear()
    await waiter
    assert not flag.is_set()


@virtual
async def test_a_waiter_that_is_cancelled_takes_nobody_with_it(flag: Flag) -> None:
    cancelled, other = asyncio.ensure_future(flag.wait()), asyncio.ensure_future(flag.wait())
    await _turn()
    cancelled.cancel()
    await _turn()
    assert cancelled.cancelled()
    flag.set()
    await other


@virtual
async def test_waiters_that_gave_up_leave_nothing_behind() -> None:
    flag = Flag()
    for _ in range(3):
        waiter = asyncio.ensure_future(flag.wait())
        await _turn()
        waiter.cancel()
        await _turn()
    assert flag.waiters == 0


@virtual
async def test_a_waiter_cancelled_in_the_turn_in_which_it_is_set_is_cancelled(flag: Flag) -> None:
    waiter = asyncio.ensure_future(flag.wait())
    await _turn()
    flag.set()
    waiter.cancel()
    await _turn()
    assert waiter.cancelled()
