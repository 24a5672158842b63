"""A thread with an event loop of its own, for use from a test.

Everything simulated runs on this loop and never on the caller's, so it needs no locks.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import AbstractAsyncContextManager, contextmanager
from threading import Event, Thread, current_thread
from typing import Any, Self, TypeVar

from lift_manager.lab.bench.errors import BenchBroken, BenchError

T = TypeVar("T")

PATIENCE_S = 60.0
"""How long a reply of the loop may take beyond its time limit. Chosen: it takes milliseconds unless something hangs, or seconds on a very
busy machine."""

ENDS_WITHIN_S = 10.0
"""How long a cancelled task may take to end. Chosen: it takes one turn of the loop, which may wait on a very busy machine."""


class LoopThread:
    """A running event loop in a thread; close it at the end."""

    def __init__(self, *, patience_s: float = PATIENCE_S) -> None:
        self._patience_s = patience_s
        self._ready: Future[asyncio.AbstractEventLoop] = Future()
        self._end = asyncio.Event()
        self._awaited: set[Future[Any]] = set()
        """What callers wait for."""
        self._broken = Event()
        self._thread = Thread(target=self._run, name="lift bench", daemon=True)
        self._bugs = _Bugs(self._thread)
        logging.getLogger().addHandler(self._bugs)
        self._thread.start()
        self._loop = self._ready.result(patience_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def call(self, work: Callable[[], T]) -> T:
        """Call a function that does not wait on the loop; called on the loop itself, it runs at once."""
        if current_thread() is self._thread:
            return work()

        async def do() -> T:
            return work()

        return self.run(do())

    def run(self, work: Coroutine[Any, Any, T], *, within_s: float = 0.0) -> T:
        """Run a coroutine that takes at most `within_s` on the loop, and wait for it.

        Raises BenchBroken if a bug has ended a context that was open there.
        """
        if current_thread() is self._thread:
            work.close()
            raise BenchError("a condition that is waited for cannot wait itself; use its argument")
        future = self._submit(work)
        try:
            return future.result(within_s + self._patience_s)
        except CancelledError:
            raise self._broken_error() from None
        except TimeoutError:
            if future.done():
                raise
            future.cancel()
            text = (
                f"the loop of the bench gave no answer within {within_s + self._patience_s:g} s; something on it blocks"
            )
            raise BenchError(text) from None
        except BaseException:
            future.cancel()
            raise

    async def run_async(self, work: Coroutine[Any, Any, T]) -> T:
        """Do the same as `run` for a caller with an event loop of its own, without blocking that loop."""
        future = self._submit(work)
        waiting = asyncio.wrap_future(future)
        try:
            return await waiting
        except asyncio.CancelledError:
            if self._broken.is_set():
                raise self._broken_error() from None
            raise

    @contextmanager
    def hosting(self, context: AbstractAsyncContextManager[T]) -> Iterator[T]:
        """Keep a context open on the loop, in a task of its own. Raises the error that ended it early."""
        entered: Future[T] = Future()
        leave = asyncio.Event()
        kept = asyncio.run_coroutine_threadsafe(self._keep(context, entered, leave), self._loop)
        kept.add_done_callback(lambda _: entered.cancel())
        try:
            try:
                value = entered.result(self._patience_s)
            except CancelledError:
                kept.result(self._patience_s)
                raise
            yield value
        finally:
            self._loop.call_soon_threadsafe(leave.set)
            kept.result(self._patience_s)

    def close(self) -> None:
        """End the thread. Raises the errors on it that no caller has seen."""
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(self._patience_s)
        logging.getLogger().removeHandler(self._bugs)
        if self._thread.is_alive():
            raise BenchError(
                f"the thread of the bench has not ended within {self._patience_s:g} s; something on it blocks"
            )
        if self._bugs.found:
            raise ExceptionGroup("the manager or the simulator has a bug", self._bugs.found)

    def _submit(self, work: Coroutine[Any, Any, T]) -> Future[T]:
        if self._broken.is_set():
            work.close()
            raise self._broken_error()
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        self._awaited.add(future)
        future.add_done_callback(self._awaited.discard)
        if self._broken.is_set():  # since the check above
            future.cancel()
        return future

    async def _keep(self, context: AbstractAsyncContextManager[T], entered: Future[T], leave: asyncio.Event) -> None:
        try:
            async with context as value:
                entered.set_result(value)
                await leave.wait()
        except BaseException:
            self._broken.set()
            for future in tuple(self._awaited):
                future.cancel()
            raise

    def _run(self) -> None:
        asyncio.run(self._main())

    async def _main(self) -> None:
        self._ready.set_result(asyncio.get_running_loop())
        await self._end.wait()
        remaining = asyncio.all_tasks() - {asyncio.current_task()}
        if ending := {task for task in remaining if task.cancelling()}:
            # the caller has just given up
            await asyncio.wait(ending, timeout=ENDS_WITHIN_S)
        if remaining := {task for task in remaining if not task.done()}:
            names = ", ".join(sorted(str(task.get_coro()) for task in remaining))
            self._bugs.found.append(BenchError(f"still running on the loop of the bench: {names}"))

    @staticmethod
    def _broken_error() -> BenchBroken:
        return BenchBroken(
            "the manager or the simulator has ended because of a bug; its traceback follows when the fixture ends"
        )


class _Bugs(logging.Handler):
    """Collects the exceptions that one thread logged as errors instead of raising them to a caller."""

    def __init__(self, thread: Thread) -> None:
        super().__init__(logging.ERROR)
        self.found: list[Exception] = []
        self._thread = thread

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        if record.thread == self._thread.ident and isinstance(error, Exception):
            self.found.append(error)
