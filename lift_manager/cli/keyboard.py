"""Reads what a person types: ENTER at a prompt, a word, or line after line."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from enum import Enum, auto

from lift_manager.cli.common import print_stderr

if sys.platform != "win32":
    import termios

LOOK_EVERY_S = 0.2
"""How soon a person sees that a prompt was withdrawn. Chosen."""
_LINE_LIMIT = 4096
"""In bytes; a Linux terminal returns no longer line."""


class EnterResult(Enum):
    """The outcome of a prompt."""

    PRESSED = auto()
    WITHDRAWN = auto()
    """The prompt no longer applies."""
    ENDED = auto()
    """Nobody can press ENTER: Ctrl-D, or the terminal was closed."""


async def wait_for_enter(question: str, is_open: Callable[[], bool], terminal: int) -> EnterResult:
    """Print a prompt and wait for ENTER while `is_open`. `terminal` is a file descriptor.

    Input typed before the prompt is discarded, because it was meant for something else.
    """
    try:
        termios.tcflush(terminal, termios.TCIFLUSH)
        print_stderr(question)
    except (termios.error, OSError):
        # a closed terminal
        return EnterResult.ENDED
    loop = asyncio.get_running_loop()
    lines: asyncio.Queue[bytes] = asyncio.Queue()
    # read at once: a moment later there may be nothing left to read, and the read would block the loop
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


def read_typed(question: str) -> str:
    """Print a prompt, and return the line that is typed after it; empty after Ctrl-C, Ctrl-D, or if nobody can type.

    Input typed before the prompt is discarded, because it was meant for something else.
    """
    if sys.platform != "win32":
        with suppress(termios.error):
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
    try:
        return input(question)
    except (OSError, EOFError, KeyboardInterrupt):
        return ""


def _read_line(terminal: int) -> bytes:
    """Return the typed line; empty at the end of the input. Without a line end if Ctrl-D sent an unfinished line."""
    try:
        return os.read(terminal, _LINE_LIMIT)
    except OSError:
        # such as EIO, once the terminal was closed
        return b""


@contextmanager
def typed_lines(stream: int) -> Iterator[Callable[[], Awaitable[str | None]]]:
    """Read lines from a terminal or a pipe without blocking the loop: yields a function that waits for the next one, None at the end."""
    loop = asyncio.get_running_loop()
    chunks: asyncio.Queue[bytes] = asyncio.Queue()
    unread = b""

    async def next_line() -> str | None:
        nonlocal unread
        while b"\n" not in unread:
            chunk = await chunks.get()
            if not chunk:
                chunks.put_nowait(b"")
                line, unread = unread, b""
                return line.decode("utf-8", "replace") if line else None
            unread += chunk
        line, _, unread = unread.partition(b"\n")
        return line.decode("utf-8", "replace")

    def read() -> None:
        chunk = _read_line(stream)
        chunks.put_nowait(chunk)
        if not chunk:
            loop.remove_reader(stream)

    try:
        loop.add_reader(stream, read)
    except PermissionError:  # a regular file, which is always readable
        while chunk := _read_line(stream):
            chunks.put_nowait(chunk)
        chunks.put_nowait(b"")
    try:
        yield next_line
    finally:
        loop.remove_reader(stream)
