"""Virtual time for tests; see `lift_manager.lab.virtual_time`."""

import asyncio
from collections.abc import Callable, Coroutine, Iterable
from typing import Any

from lift_manager.lab.virtual_time import (
    DeadlockError,
    LeftoverTaskError,
    TimeLimitError,
    UnhandledError,
    VirtualTimeError,
    VirtualTimeLoop,
    elapse,
    run_virtual,
)

__all__ = [
    "DeadlockError",
    "LeftoverTaskError",
    "TimeLimitError",
    "UnhandledError",
    "VirtualTimeError",
    "VirtualTimeLoop",
    "cancel_all",
    "cancel_at_every_turn",
    "elapse",
    "run_virtual",
]


async def cancel_at_every_turn(work: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Begin this again and again, and cancel it one turn of the loop later each time, until it is done by then: a cancellation ends it each time."""
    turns, is_done = 0, False
    while not is_done:
        task = asyncio.create_task(work())
        for _ in range(turns):
            await asyncio.sleep(0)
        is_done, turns = task.done(), turns + 1
        task.cancel()
        await asyncio.wait([task])
        assert task.cancelled() is not is_done, turns
    assert turns > 5, "there was hardly a moment to be ended in"


async def cancel_all(running: Iterable[asyncio.Task[None]]) -> None:
    """Cancel what runs; raise what it has failed with."""
    tasks = tuple(running)
    for task in tasks:
        task.cancel()
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, Exception):
            raise result
