"""How a server tells answers that have no end of their own that it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from starlette.types import Scope

KEY = "lift_manager.ending"
"""In the state that a server gives to each request."""


class ShutdownSignal:
    """Who wants to know that a server ends."""

    def __init__(self) -> None:
        self._hear: dict[object, Callable[[], None]] = {}

    def tell(self) -> None:
        """Let everybody know."""
        for hear in list(self._hear.values()):
            hear()

    @contextmanager
    def heard(self, hear: Callable[[], None]) -> Iterator[None]:
        """Call `hear` if the server ends within the context."""
        key = object()
        self._hear[key] = hear
        try:
            yield
        finally:
            del self._hear[key]


def shutdown_signal(scope: Scope) -> ShutdownSignal:
    """Return the ending of the server that a request came to; one that never comes where the server has none."""
    found = scope.get("state", {}).get(KEY)
    return found if isinstance(found, ShutdownSignal) else ShutdownSignal()
