"""Closes the way of the other machine to a controller, by a command of the site, before this one writes to it."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from drivers.errors import ConnectFailed, ConnectProblem
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Fence

_log = logging.getLogger(__name__)

SHOWN = 200
"""Characters of what a command has written that a message repeats."""


class SiteFence:
    """The fence of one controller for one term: its command has to succeed once before the first connection."""

    def __init__(self, controller: str, fence: Fence, folder: Path, environment: Mapping[str, str]) -> None:
        """The command runs in `folder`; `environment` is added to that of this process."""
        self._controller = controller
        self._fence = fence
        self._folder = folder
        self._environment = environment
        self._is_closed = False

    async def close(self) -> None:
        """Return once the command has succeeded in this term. Raises ConnectFailed, and then tries again at the next call."""
        if self._is_closed:
            return
        if problem := await self._run():
            what = f"its fence is not closed, so nothing is sent to it: {self._fence.command[0]} {problem}"
            raise ConnectFailed(self._controller, ConnectProblem.OTHER, what)
        self._is_closed = True
        _log.warning("cluster: %s: %s has closed the fence", self._controller, self._fence.command[0])

    async def _run(self) -> str:
        """Run the command once; returns why it has not succeeded, or nothing."""
        try:
            process = await asyncio.create_subprocess_exec(
                *self._fence.command,
                cwd=self._folder,
                env={**os.environ, **self._environment},
                stdin=DEVNULL,
                stdout=DEVNULL,
                stderr=PIPE,
                start_new_session=True,
            )
        except OSError as error:
            return f"cannot be run: {error.strerror or error}"
        try:
            async with asyncio.timeout(self._fence.within_s):
                _, written = await process.communicate()
        except TimeoutError:
            return f"has not ended within {self._fence.within_s:g} s"
        finally:
            await _end(process)
        if process.returncode == 0:
            return ""
        text = "".join(char if char.isprintable() else " " for char in written.decode(errors="replace"))
        said = " ".join(text.split())[-SHOWN:]
        return f"has ended with {process.returncode}{': ' if said else ''}{said}"


async def _end(process: Process) -> None:
    """Kill a command that still runs, and what it has started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    await process.wait()


def fences_of(loaded: LoadedSite, machine: str, epoch: int) -> dict[str, SiteFence]:
    """Return the fences of a site, by controller, for a term of this machine."""
    cluster = loaded.site.cluster
    if cluster is None:
        return {}
    (other,) = (name for name in cluster.machines if name != machine)
    return {
        controller: SiteFence(
            controller,
            fence,
            loaded.path.parent,
            {
                "LIFT_MANAGER_CONTROLLER": controller,
                "LIFT_MANAGER_MACHINE": machine,
                "LIFT_MANAGER_OTHER_MACHINE": other,
                "LIFT_MANAGER_EPOCH": str(epoch),
            },
        )
        for controller, fence in cluster.fence.items()
    }
