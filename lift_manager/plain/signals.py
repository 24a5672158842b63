"""Signals that end a long-running program."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from contextlib import suppress


def stop_on_signals(stop: asyncio.Event) -> None:
    """Set the event on SIGTERM and Ctrl-C, for an orderly end."""
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        # some event loops have no signal handlers; Ctrl-C raises KeyboardInterrupt there
        with suppress(NotImplementedError):
            loop.add_signal_handler(number, stop.set)


def remember_sigterm() -> Callable[[], bool]:
    """Keep SIGTERM from ending a program that has no event loop yet; return a function that tells whether it arrived."""
    received: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: received.append(number))
    return lambda: bool(received)
