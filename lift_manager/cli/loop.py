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

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a tool; Windows has no SIGHUP."""


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on the fastest available event loop."""
    with asyncio.Runner(loop_factory=_new_loop) as runner:
        return runner.run(main)


async def cancel_on_signals(work: Coroutine[Any, Any, T], received: list[int]) -> T:
    """Run `work`, and cancel it on the first signal that this process does not ignore (`nohup`); later ones change nothing.

    Their numbers are added to `received`. Somebody who presses Ctrl-C twice would otherwise leave outputs on.
    """
    loop, task = asyncio.get_running_loop(), asyncio.ensure_future(work)

    def on_signal(number: int) -> None:
        if not received:
            task.cancel()
        received.append(number)

    handled = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    for number in handled:
        loop.add_signal_handler(number, on_signal, number)
    try:
        return await task
    finally:
        for number in handled:
            loop.remove_signal_handler(number)
