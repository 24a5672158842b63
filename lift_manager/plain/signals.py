"""How a program that runs for long is asked to end."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from contextlib import suppress


def stop_on_signals(stop: asyncio.Event) -> None:
    """Let SIGTERM and Ctrl-C ask for an orderly end."""
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        # not every event loop has signal handlers; there Ctrl-C still raises KeyboardInterrupt
        with suppress(NotImplementedError):
            loop.add_signal_handler(number, stop.set)


def remember_sigterm() -> Callable[[], bool]:
    """Keep SIGTERM from ending a program that has no event loop yet; returns what says whether it came."""
    came: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: came.append(number))
    return lambda: bool(came)
