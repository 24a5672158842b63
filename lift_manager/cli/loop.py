"""The event loop of commands that take a while, and how signals end them."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

try:
    import uvloop
except ImportError:  # there is none for Windows; asyncio's own loop serves as well, with twice the work per poll
    _new_loop: Callable[[], asyncio.AbstractEventLoop] | None = None
else:
    _new_loop = uvloop.new_event_loop

T = TypeVar("T")


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on the fastest available event loop."""
    with asyncio.Runner(loop_factory=_new_loop) as runner:
        return runner.run(main)


def cancel_on_signals() -> None:
    """Cancel the running task on SIGTERM and SIGHUP, as Ctrl-C does, so that it releases what it holds."""
    task = asyncio.current_task()
    if task is None:
        raise RuntimeError("no task is running")
    for number in (signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, task.cancel)
