"""An asyncio loop whose clock is a number: a wait takes no real time and exactly its virtual time.

For tests of ages, leases, back-off and door timers over the in-memory wire. Sockets, threads and processes run in real time and are
refused here. Code under test reads the clock as `asyncio.get_running_loop().time()`.
"""

import asyncio
import math
import selectors
from collections.abc import Callable, Coroutine, Iterable
from typing import Any, Never, TypeVar

T = TypeVar("T")

_TURNS_WITHOUT_TIME = 100_000
"""Turns of the loop at one time before it counts as spinning. Chosen: about a second, and far more than any burst of work takes."""

_CLEANUP_S = 3600.0
"""How long cancelled tasks may still wait after the limit, to clean up. Chosen: more than any of them needs."""


class VirtualTimeError(AssertionError):
    """A run under virtual time has failed."""


class DeadlockError(VirtualTimeError):
    """Every task is waiting, and nothing is scheduled that could wake one of them."""


class TimeLimitError(VirtualTimeError):
    """The next timer is beyond `limit_s`, or time stands still while tasks keep spinning."""


class LeftoverTaskError(VirtualTimeError):
    """The main coroutine returned while tasks that it had started were still alive."""


class UnhandledError(VirtualTimeError):
    """A callback raised, or a task that nobody waited for."""


def run_virtual(main: Callable[[], Coroutine[Any, Any, T]], *, limit_s: float = 3600.0) -> T:
    """Run `main` in virtual time and return its result.

    Raises a `VirtualTimeError` if it would hang or spin, or leaves a task behind.
    """
    with asyncio.Runner(loop_factory=lambda: VirtualTimeLoop(limit_s=limit_s)) as runner:
        return runner.run(_watched(main))


async def elapse(seconds: float) -> None:
    """Let virtual seconds pass. Refused on a real loop, where it would be a sleep."""
    if not isinstance(asyncio.get_running_loop(), VirtualTimeLoop):
        raise VirtualTimeError("tests do not sleep: wait for a condition, or run on virtual time")
    await asyncio.sleep(seconds)


async def _watched(main: Callable[[], Coroutine[Any, Any, T]]) -> T:
    errors: list[str] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: errors.append(f"{context['message']}: {context.get('exception')!r}"))
    try:
        result = await main()
    except BaseException as error:
        if remaining := _others(loop):
            error.add_note(f"Tasks left over: {_describe(remaining)}")
        raise
    if remaining := _others(loop):
        raise LeftoverTaskError(f"Tasks left over: {_describe(remaining)}")
    if errors:
        raise UnhandledError("; ".join(errors))
    return result


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """A loop that starts at 0.0 and jumps to the next timer whenever nothing is ready."""

    def __init__(self, *, limit_s: float) -> None:
        self._now_s = 0.0
        self._limit_s = limit_s
        self._turns = 0
        super().__init__(_JumpingSelector(self._jump))
        self._move_to(0.0)

    def time(self) -> float:
        return self._now_s

    def run_in_executor(self, *_: object) -> Never:
        raise RuntimeError("a thread runs in real time and cannot be used under virtual time")

    def _jump(self, timeout_s: float | None) -> None:
        if timeout_s is None:
            raise DeadlockError(f"at {self._now_s} s nothing is scheduled any more; waiting: {self._waiting()}")
        if timeout_s <= 0:
            self._turns += 1
            if self._turns > _TURNS_WITHOUT_TIME:
                self._turns = 0
                raise TimeLimitError(f"time stands still at {self._now_s} s; alive: {self._waiting()}")
            return
        if self._now_s + timeout_s > self._limit_s:
            message = f"passed limit_s={self._limit_s}; waiting: {self._waiting()}"
            self._limit_s = self._now_s + _CLEANUP_S
            raise TimeLimitError(message)
        self._turns = 0
        self._move_to(self._now_s + timeout_s)

    def _move_to(self, now_s: float) -> None:
        self._now_s = now_s
        # asyncio calls a timer early by this much. With more, a task that sleeps until a time would wake before it and sleep again, and
        # time would stand still.
        self._clock_resolution = math.ulp(now_s)

    def _waiting(self) -> str:
        return _describe(asyncio.all_tasks(self))


class _JumpingSelector(selectors.DefaultSelector):
    """A selector that never waits: it reports to the clock of the loop how long it would have waited."""

    def __init__(self, jump: Callable[[float | None], None]) -> None:
        super().__init__()
        self._jump = jump

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:  # as typeshed has it
        if self.get_map():  # the first one is the loop's own pipe to itself, for signals
            raise RuntimeError("a socket or process runs in real time and cannot be used under virtual time")
        return super().register(fileobj, events, data)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        # no system call: only the loop's pipe to itself is registered, and a write to it only wakes a loop that waits
        self._jump(timeout)
        return []


def _others(loop: asyncio.AbstractEventLoop) -> set[asyncio.Task[Any]]:
    return {task for task in asyncio.all_tasks(loop) if task is not asyncio.current_task(loop)}


def _describe(tasks: Iterable[asyncio.Task[Any]]) -> str:
    return ", ".join(sorted(f"{task.get_name()} {_place(task)}" for task in tasks)) or "no task"


def _place(task: asyncio.Task[Any]) -> str:
    """Return the innermost line at which a task waits."""
    place = "before its first line"
    step: Any = task.get_coro()
    while step is not None and (frame := getattr(step, "cr_frame", None)) is not None:
        place = f"at {frame.f_code.co_filename}:{frame.f_lineno} ({frame.f_code.co_qualname})"
        step = step.cr_await
    return place
