"""A person at the terminal who is asked to press ENTER."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable
from enum import Enum, auto

from lift_manager.cli.common import print_stderr

if sys.platform != "win32":
    import termios

LOOK_EVERY_S = 0.2
"""Chosen: so soon a person reads that a question is withdrawn."""
_LINE_LIMIT = 4096
"""Bytes; a terminal of Linux gives no longer line."""


class EnterResult(Enum):
    """What came of a question."""

    PRESSED = auto()
    WITHDRAWN = auto()
    """It stood no more."""
    ENDED = auto()
    """Nobody can answer: Ctrl-D, or the terminal was closed."""


async def wait_for_enter(question: str, is_open: Callable[[], bool], terminal: int) -> EnterResult:
    """Ask, and wait for ENTER for as long as the question stands. `terminal` is a file descriptor.

    A terminal keeps what was typed before the question; that is thrown away, for it answers something else.
    """
    try:
        termios.tcflush(terminal, termios.TCIFLUSH)
        print_stderr(question)
    except (termios.error, OSError):
        # a closed terminal
        return EnterResult.ENDED
    loop = asyncio.get_running_loop()
    lines: asyncio.Queue[bytes] = asyncio.Queue()
    # read at once: a moment later there may be nothing to read any more, and that would block everything
    loop.add_reader(terminal, lambda: lines.put_nowait(_read_line(terminal)))
    try:
        while is_open():
            try:
                async with asyncio.timeout(LOOK_EVERY_S):
                    line = await lines.get()
            except TimeoutError:
                continue
            if not line:
                return EnterResult.ENDED
            if line.endswith(b"\n"):
                return EnterResult.PRESSED if is_open() else EnterResult.WITHDRAWN
        return EnterResult.WITHDRAWN
    finally:
        loop.remove_reader(terminal)


def _read_line(terminal: int) -> bytes:
    """Return what was typed; empty at the end of it. Without a line end where Ctrl-D sent an unfinished line."""
    try:
        return os.read(terminal, _LINE_LIMIT)
    except OSError:
        # such as EIO, once the terminal was closed
        return b""
