"""Work that goes on beside a block of code."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager


@asynccontextmanager
async def beside(*work: Coroutine[None, None, None]) -> AsyncIterator[None]:
    """Run work for as long as the block lasts. What the block raises comes out as it is, and not in a group.

    The work itself raises nothing but bugs; those end the block.
    """
    failure: Exception | None = None
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(each) for each in work]
        try:
            yield
        except Exception as error:  # noqa: BLE001  raised again below, once the group has ended
            failure = error
        finally:
            for task in tasks:
                task.cancel()
    if failure is not None:
        raise failure
