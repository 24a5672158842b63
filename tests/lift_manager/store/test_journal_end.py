"""The orderly end while the controller and the disk are both silent."""

import asyncio
import contextlib
import logging
import time
from itertools import count
from pathlib import Path

import httpx
import pytest

from lift_manager import app
from lift_manager.web.server import listen
from simulator.server import SimulatedController
from tests.lift_manager.store.journal_disk import Disk, Hanging, journal
from tests.lift_manager.test_app import controller, site_of
from tests.support.programs import HANGS_S, OUT_WITHIN_S, eventually, soon

INTERPRETER_S = 1.2
"""What a process needs after this to be out, on a busy computer of two cores."""


class Relay:
    """Passes on what two sides say, until it is muted: both stay connected, and hear nothing."""

    def __init__(self, port: int) -> None:
        self.muted = False
        self._port = port

    async def connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self._port)
        with contextlib.suppress(ConnectionError):
            await asyncio.gather(self._pass_on(reader, back), self._pass_on(there, writer))
        for end in (writer, back):
            end.close()

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(1000):
            if not self.muted:
                writer.write(data)
        writer.close()


def hold_the_door(port: int) -> None:
    base = f"http://127.0.0.1:{port}/open-rmf/demo-lift"
    with httpx.Client(base_url=base, params={"lift_name": "lift"}, trust_env=False, timeout=HANGS_S) as client:
        body = {"floor": "L1", "door_state": 2}
        # a manager that could not read its lift in time on a busy machine refuses, and shows nothing of it
        eventually(lambda: client.post("/lift_request", json=body).json()["success"])
        eventually(lambda: client.get("/lift_state").json()["data"].get("door_state") == 2)


async def ended(plc: SimulatedController, path: Path, hanging: Hanging) -> tuple[bool, float]:
    """Run a manager that holds a door, silence its controller and its disk, and end it; returns what it says and how long it took."""
    relay, stop, ready = Relay(plc.port), asyncio.Event(), asyncio.Event()
    server = await asyncio.start_server(relay.connected, "127.0.0.1", 0)
    with listen("127.0.0.1", 0) as sock:
        site = site_of(server.sockets[0].getsockname()[1])
        kept = journal(path, Disk(hanging))
        running = asyncio.ensure_future(app.run(site, sock, stop=stop, ready=ready.set, recorder=kept))
        await ready.wait()
        await asyncio.to_thread(hold_the_door, sock.getsockname()[1])
        hanging.through.clear()
        relay.muted = True
        began = time.monotonic()
        stop.set()
        released = await running
        took_s = time.monotonic() - began
        server.close()
    return released, took_s


def test_a_silent_controller_and_a_hung_disk_together_leave_time_for_the_process_to_be_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    files = count()

    async def main() -> tuple[bool, float]:
        hanging, plc = Hanging(), controller()
        hanging.through.set()
        await plc.start()
        try:
            return await ended(plc, tmp_path / f"{next(files)}.db", hanging)
        finally:
            hanging.through.set()
            await plc.stop()

    def attempt() -> float:
        released, took_s = asyncio.run(main())
        assert not released
        return took_s

    with caplog.at_level(logging.INFO):
        soon(attempt, OUT_WITHIN_S - INTERPRETER_S)
    assert "not every output could be verified" in caplog.text
    assert "did not reach the store" in caplog.text
