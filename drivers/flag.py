"""What tasks wait for."""

from __future__ import annotations

import asyncio


class Flag:
    """An `asyncio.Event` that takes memory only while somebody waits: an idle lift has six, and a queue of waiters is 0.6 KB."""

    __slots__ = ("_is_set", "_waiters")

    def __init__(self) -> None:
        self._is_set = False
        self._waiters: tuple[asyncio.Future[None], ...] = ()

    @property
    def waiters(self) -> int:
        """How many wait."""
        return len(self._waiters)

    def is_set(self) -> bool:
        """Whether nobody has to wait."""
        return self._is_set

    def set(self) -> None:
        """Let everybody continue who waits, and nobody wait until it is cleared."""
        self._is_set = True
        waiters, self._waiters = self._waiters, ()
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)

    def clear(self) -> None:
        """Have everybody wait from now on."""
        self._is_set = False

    async def wait(self) -> None:
        """Return at once if it is set, and otherwise once it has been."""
        if self._is_set:
            return
        waiter: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiters += (waiter,)
        try:
            await waiter
        except asyncio.CancelledError:
            self._waiters = tuple(other for other in self._waiters if other is not waiter)
            raise
