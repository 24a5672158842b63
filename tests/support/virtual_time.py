"""Virtual time for tests; see `lift_manager.lab.virtual_time`."""

import asyncio
from collections.abc import Iterable

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
    "elapse",
    "run_virtual",
]


async def cancel_all(running: Iterable[asyncio.Task[None]]) -> None:
    """Cancel what runs; raise what it has failed with."""
    tasks = tuple(running)
    for task in tasks:
        task.cancel()
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, Exception):
            raise result
