"""How a command runs for long: its event loop, and its log."""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from lift_manager.domain.keys import redacted

try:
    import uvloop
except ImportError:  # there is none for Windows; asyncio's own loop serves as well, with twice the work per poll
    _new_loop: Callable[[], asyncio.AbstractEventLoop] | None = None
else:
    _new_loop = uvloop.new_event_loop

T = TypeVar("T")


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run to the end on the fastest loop that there is."""
    with asyncio.Runner(loop_factory=_new_loop) as runner:
        return runner.run(main)


def log_to_stderr() -> None:
    """Log for a person who watches."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Redacting("%(asctime)s %(levelname)-7s %(message)s", datefmt="%H:%M:%S"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    logging.getLogger("pymodbus").setLevel(logging.ERROR)


class _Redacting(logging.Formatter):
    """Takes keys out of whole entries, tracebacks included: the last net, for what no caller of a logger thought of."""

    def format(self, record: logging.LogRecord) -> str:
        return redacted(super().format(record))
