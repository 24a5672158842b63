"""The thread of the bench: what runs there ends with the test, and what breaks there is heard."""

import asyncio
import logging
import threading
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from threading import Event

import pytest

from lift_manager.lab.bench.errors import BenchBroken, BenchError
from lift_manager.lab.bench.thread import LoopThread
from tests.support.programs import HANGS_S


@asynccontextmanager
async def breaks(when: asyncio.Event) -> AsyncIterator[str]:
    """A context with a task that has a bug."""

    async def part() -> None:
        await when.wait()
        raise LookupError("a bug")

    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(part())
        yield "entered"


class CannotBegin(AbstractAsyncContextManager[None]):
    async def __aenter__(self) -> None:
        raise OSError("no port is free")

    async def __aexit__(self, *_: object) -> None:
        """Never reached."""


def test_what_is_asked_is_done_on_the_thread_and_answered() -> None:
    with LoopThread() as thread:
        there = thread.call(threading.current_thread)
        assert there is not threading.current_thread()
        assert thread.call(lambda: thread.call(threading.current_thread)) is there
        with pytest.raises(ZeroDivisionError):
            thread.call(lambda: 1 / 0)
    assert not there.is_alive()


def test_a_bug_ends_every_wait_at_once_and_is_raised_in_the_end() -> None:
    when = asyncio.Event()

    async def trip_and_wait() -> None:
        when.set()
        await asyncio.Event().wait()

    async def main(thread: LoopThread) -> None:
        with pytest.raises(BenchBroken):
            await thread.run_async(asyncio.Event().wait())

    heard = []

    def bug() -> None:
        with LoopThread() as thread, thread.hosting(breaks(when)) as value:
            assert value == "entered"
            with pytest.raises(BenchBroken, match="ended because of a bug"):
                thread.run(trip_and_wait(), within_s=HANGS_S)
            heard.append("while it waited")
            with pytest.raises(BenchBroken):
                thread.call(lambda: None)
            asyncio.run(main(thread))
            heard.append("afterwards")

    with pytest.raises(ExceptionGroup) as raised:
        bug()
    assert heard == ["while it waited", "afterwards"]
    assert raised.group_contains(LookupError, match="a bug")


def test_an_asyncio_caller_hears_of_the_bug_while_it_waits() -> None:
    when = asyncio.Event()

    async def main(thread: LoopThread) -> None:
        waiting = asyncio.create_task(thread.run_async(asyncio.Event().wait()))
        await thread.run_async(asyncio.sleep(0))
        thread.call(when.set)
        with pytest.raises(BenchBroken):
            await waiting
        heard.append("while it waited")

    heard: list[str] = []
    with pytest.raises(ExceptionGroup), LoopThread() as thread, thread.hosting(breaks(when)):
        asyncio.run(main(thread))
    assert heard


def test_an_asyncio_caller_who_is_cancelled_leaves_nothing_behind() -> None:
    async def main(thread: LoopThread) -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await thread.run_async(asyncio.Event().wait())

    with LoopThread() as thread:
        asyncio.run(main(thread))


def test_what_cannot_begin_says_so_where_it_is_begun() -> None:
    with LoopThread() as thread, pytest.raises(OSError, match="no port is free"), thread.hosting(CannotBegin()):
        pytest.fail("it has begun")


def test_a_task_that_is_left_behind_is_named() -> None:
    async def stray() -> None:
        await asyncio.Event().wait()

    def leave() -> None:
        with LoopThread() as thread:
            kept = thread.call(lambda: asyncio.ensure_future(stray()))
            assert not kept.done()

    with pytest.raises(ExceptionGroup) as raised:
        leave()
    assert raised.group_contains(BenchError, match="still running on the loop of the bench: .*stray")


def test_only_what_its_own_thread_logs_with_a_traceback_is_a_bug_of_it() -> None:
    logger, done = logging.getLogger("somebody"), Event()

    def elsewhere() -> None:
        logger.error("of another thread", exc_info=LookupError("not ours"))
        done.set()

    with LoopThread() as thread:
        threading.Thread(target=elsewhere).start()
        assert done.wait(HANGS_S)
        thread.call(lambda: logger.error("without a traceback"))
        thread.call(lambda: logger.warning("weather", exc_info=OSError("gone")))


def test_a_loop_that_blocks_is_said_to() -> None:
    go_on = Event()
    with LoopThread(patience_s=0.3) as thread:
        with pytest.raises(BenchError, match=r"gave no answer within 0\.3 s; something on it blocks"):
            thread.call(lambda: go_on.wait(20))
        go_on.set()
