"""Ends endless replies when the server shuts down."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from starlette.types import Scope

KEY = "lift_manager.ending"
"""Key in the state that the server passes with each request."""


class ShutdownSignal:
    """Callbacks for the shutdown of a server."""

    def __init__(self) -> None:
        self._callbacks: dict[object, Callable[[], None]] = {}

    def send(self) -> None:
        """Call every callback."""
        for callback in list(self._callbacks.values()):
            callback()

    @contextmanager
    def on_shutdown(self, callback: Callable[[], None]) -> Iterator[None]:
        """Call `callback` if the server shuts down within the context."""
        key = object()
        self._callbacks[key] = callback
        try:
            yield
        finally:
            del self._callbacks[key]


def shutdown_signal(scope: Scope) -> ShutdownSignal:
    """Return the shutdown signal of the server of a request; one that never fires if the server has none."""
    found = scope.get("state", {}).get(KEY)
    return found if isinstance(found, ShutdownSignal) else ShutdownSignal()
