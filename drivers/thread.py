"""Runs work that may block in threads that do not delay the end of the program."""

from __future__ import annotations

import asyncio
import errno
import threading
from asyncio import Future
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from typing import TypeVar

Result = TypeVar("Result")


class Worker:
    """Runs jobs one after the other in one thread, in the order of submission; a connection can live there.

    Not `asyncio.to_thread`: a loop waits for those threads when it ends, so a disk that hangs would prevent an orderly shutdown.
    """

    def __init__(self, name: str) -> None:
        """Name the thread; it starts with the first job."""
        self._name = name
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._started = False

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        """Submit a job. Raises OSError if no thread can be started."""
        if not self._started:
            try:
                threading.Thread(target=self._run, name=self._name, daemon=True).start()
            except RuntimeError as error:
                raise OSError(errno.EAGAIN, f"this computer is too busy: {error}") from error
            self._started = True
        loop = asyncio.get_running_loop()
        future: Future[Result] = loop.create_future()

        def job() -> None:
            try:
                finish = partial(_succeed, future, work())
            except BaseException as error:  # noqa: BLE001  raised again where the job is awaited
                finish = partial(_fail, future, error)
            with suppress(RuntimeError):  # the loop may be closed by then
                loop.call_soon_threadsafe(finish)

        self._jobs.put(job)
        return future

    def stop(self) -> None:
        """End the thread after the submitted jobs."""
        self._jobs.put(None)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()


def _succeed(future: Future[Result], result: Result) -> None:
    if not future.done():
        future.set_result(result)


def _fail(future: Future[Result], error: BaseException) -> None:
    if not future.done():
        future.set_exception(error)


async def in_thread(work: Callable[[], Result]) -> Result:
    """Run one job in a thread of its own and return its result. Raises what the job and `Worker.submit` raise."""
    worker = Worker("lift-manager-files")
    future = worker.submit(work)
    worker.stop()
    return await future
