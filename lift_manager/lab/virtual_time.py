"""An asyncio loop whose clock is a number: waiting costs nothing and takes exactly as long as it says.

For tests of ages, leases, back-off and door timers over the in-memory wire. Sockets, threads and processes live in real
time and are refused here. Code under test reads the clock as `asyncio.get_running_loop().time()`.
"""

import asyncio
import math
import selectors
from collections.abc import Callable, Coroutine, Iterable
from typing import Any, Never, TypeVar

T = TypeVar("T")

_TURNS_WITHOUT_TIME = 100_000
"""Chosen: about a second of spinning, and far more turns than any burst of work between two timers takes."""

_CLEANUP_S = 3600.0
"""Chosen: after the limit, cancelled tasks may still wait this long while they let go."""


class VirtualTimeError(AssertionError):
    """A run under virtual time that cannot be called a success."""


class DeadlockError(VirtualTimeError):
    """Every task waits, and nothing is scheduled that could wake one of them."""


class TimeLimitError(VirtualTimeError):
    """The next thing to happen lies beyond `limit_s`, or time stands still while tasks keep spinning."""


class LeftoverTaskError(VirtualTimeError):
    """The main coroutine returned while tasks that it started were still alive."""


class UnhandledError(VirtualTimeError):
    """A callback, or a task that nobody waited for, raised."""


def run_virtual(main: Callable[[], Coroutine[Any, Any, T]], *, limit_s: float = 3600.0) -> T:
    """Run `main` to its end in virtual time and return its result.

    Raises a `VirtualTimeError` where a real loop would hang, spin, or forget a task.
    """
    with asyncio.Runner(loop_factory=lambda: VirtualTimeLoop(limit_s=limit_s)) as runner:
        return runner.run(_watched(main))


async def elapse(seconds: float) -> None:
    """Let so many virtual seconds pass; refused on a loop on which it would be a sleep."""
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
        if left := _others(loop):
            error.add_note(f"Tasks left over: {_describe(left)}")
        raise
    if left := _others(loop):
        raise LeftoverTaskError(f"Tasks left over: {_describe(left)}")
    if errors:
        raise UnhandledError("; ".join(errors))
    return result


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """Starts at 0.0 and jumps to the next timer whenever nothing is ready."""

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
        # asyncio calls a timer this much early; any more, and who sleeps until a time wakes before it, sleeps again, and
        # time stands still for all
        self._clock_resolution = math.ulp(now_s)

    def _waiting(self) -> str:
        return _describe(asyncio.all_tasks(self))


class _JumpingSelector(selectors.DefaultSelector):
    """Never waits: tells the loop's clock how long it would have waited."""

    def __init__(self, jump: Callable[[float | None], None]) -> None:
        super().__init__()
        self._jump = jump

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:  # as typeshed has it
        if self.get_map():  # the first one is the loop's own pipe to itself, for signals
            raise RuntimeError("a socket or process lives in real time and cannot be used under virtual time")
        return super().register(fileobj, events, data)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        # nothing is asked of the system: the one thing registered is the loop's pipe to itself, and what is written there only
        # wakes a loop that waits
        self._jump(timeout)
        return []


def _others(loop: asyncio.AbstractEventLoop) -> set[asyncio.Task[Any]]:
    return {task for task in asyncio.all_tasks(loop) if task is not asyncio.current_task(loop)}


def _describe(tasks: Iterable[asyncio.Task[Any]]) -> str:
    return ", ".join(sorted(f"{task.get_name()} {_place(task)}" for task in tasks)) or "no task"


def _place(task: asyncio.Task[Any]) -> str:
    """The innermost line at which the task stands."""
    place = "before its first line"
    step: Any = task.get_coro()
    while step is not None and (frame := getattr(step, "cr_frame", None)) is not None:
        place = f"at {frame.f_code.co_filename}:{frame.f_lineno} ({frame.f_code.co_qualname})"
        step = step.cr_await
    return place
