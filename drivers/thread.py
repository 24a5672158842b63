"""Work that may block, in a thread that nobody has to wait for at the end."""

from __future__ import annotations

import asyncio
import errno
import threading
from collections.abc import Callable
from contextlib import suppress


async def in_thread(work: Callable[[], None]) -> None:
    """Do this in a thread and wait for it. Raises what it raises, and OSError if this computer has no thread to spare.

    Not `asyncio.to_thread`: the end of a loop waits for those threads, and a disk that hangs would keep the manager from its
    orderly end.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def finish(error: BaseException | None) -> None:
        if done.done():
            return
        if error is None:
            done.set_result(None)
        else:
            done.set_exception(error)

    def run() -> None:
        failed: BaseException | None = None
        try:
            work()
        except BaseException as error:  # noqa: BLE001  it is raised again where somebody waits for it
            failed = error
        with suppress(RuntimeError):  # the loop may be closed by then
            loop.call_soon_threadsafe(finish, failed)

    try:
        threading.Thread(target=run, name="lift-manager-files", daemon=True).start()
    except RuntimeError as error:
        raise OSError(errno.EAGAIN, f"this computer is too busy: {error}") from error
    await done
