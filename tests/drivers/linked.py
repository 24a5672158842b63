"""What the tests of the link share: a link to a device in memory, under virtual time."""

import asyncio
import contextlib
import functools
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import ParamSpec

from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice
from tests.support.virtual_time import run_virtual

P = ParamSpec("P")


def virtual(test: Callable[P, Coroutine[object, object, None]]) -> Callable[P, None]:
    """Run an async test in virtual time."""

    @functools.wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        run_virtual(lambda: test(*args, **kwargs))

    return run


@contextlib.asynccontextmanager
async def linked(device: MemoryDevice, settings: LinkSettings | None = None) -> AsyncIterator[Link]:
    """A running link that is up; closed at the end."""
    link = Link(device.wire, settings, name="lobby")
    async with asyncio.TaskGroup() as group:
        group.create_task(link.run())
        await link.wait_up()
        yield link
        await link.close()


def now() -> float:
    return asyncio.get_running_loop().time()


async def outcome(waiting: Coroutine[object, object, object]) -> object:
    """The result, or the error: what the caller saw."""
    try:
        return await waiting
    except Exception as error:  # noqa: BLE001 - whatever came is what the test looks at
        return error
