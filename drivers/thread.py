"""Work that may block, in threads that nobody has to wait for at the end."""

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
    """One thread, in which a connection can live: it does one job after the other, in the order in which they were given.

    Not `asyncio.to_thread`: the end of a loop waits for those threads, and a disk that hangs would keep the manager from its
    orderly end.
    """

    def __init__(self, name: str) -> None:
        """Name the thread; it begins with the first job."""
        self._name = name
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._started = False

    def do(self, work: Callable[[], Result]) -> Future[Result]:
        """Give it a job. Raises OSError if this computer has no thread to spare."""
        if not self._started:
            try:
                threading.Thread(target=self._run, name=self._name, daemon=True).start()
            except RuntimeError as error:
                raise OSError(errno.EAGAIN, f"this computer is too busy: {error}") from error
            self._started = True
        loop = asyncio.get_running_loop()
        done: Future[Result] = loop.create_future()

        def job() -> None:
            try:
                finish = partial(_succeed, done, work())
            except BaseException as error:  # noqa: BLE001  it is raised again where somebody waits for it
                finish = partial(_fail, done, error)
            with suppress(RuntimeError):  # the loop may be closed by then
                loop.call_soon_threadsafe(finish)

        self._jobs.put(job)
        return done

    def stop(self) -> None:
        """End the thread after the jobs that it has."""
        self._jobs.put(None)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()


def _succeed(done: Future[Result], result: Result) -> None:
    if not done.done():
        done.set_result(result)


def _fail(done: Future[Result], error: BaseException) -> None:
    if not done.done():
        done.set_exception(error)


async def in_thread(work: Callable[[], None]) -> None:
    """Do one job in a thread of its own and wait for it. Raises what it raises, and what `Worker.do` raises."""
    worker = Worker("lift-manager-files")
    done = worker.do(work)
    worker.stop()
    await done
