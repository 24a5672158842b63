"""How a checkout on this computer reaches its lift: managers, probers, and a second manager in a process of its own."""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import TypeVar

from lift_manager.app import network_wires
from lift_manager.cli.common import open_store_or_exit, print_lines
from lift_manager.cli.own_manager import own_manager, run_to_end
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.states import open_at
from lift_manager.commissioning.checkout.access import HoldFailed
from lift_manager.commissioning.checkout.registers import Registers
from lift_manager.commissioning.prober import Prober, open_prober
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite

NAME = "checkout"
"""The name of the caller in the journal."""
HELD = "held"
"""What the second manager prints once it holds the door."""
Wire = TypeVar("Wire")
HOLD_WITHIN_S = 180.0
"""How long the second manager may take to bring the car and open its door. Chosen: a whole travel and a slow door."""
END_WITHIN_S = 15.0
"""How long a second manager may take to end in order. Chosen: three times what a manager takes."""


class SiteAccess:
    """Access to one lift of a site file."""

    def __init__(self, loaded: LoadedSite, lift: str) -> None:
        self._loaded = loaded
        self._lift = lift
        self._devices = devices(loaded.site, loaded.site.lifts[lift], loaded.maps[lift].map)

    @property
    def links(self) -> tuple[str, ...]:
        """The controllers of the lift, by their names in the site file."""
        return tuple(dict.fromkeys(device.controller for device in self._devices.values()))

    @asynccontextmanager
    async def manager(self) -> AsyncIterator[LiftManagerClient]:
        """Run a manager that may command this lift, and whose presses are in the journal."""
        recorder = open_store_or_exit(self._loaded)
        async with own_manager(self._loaded, name=NAME, may_command={self._lift}, recorder=recorder) as client:
            yield client

    @asynccontextmanager
    async def registers(self) -> AsyncIterator[Registers]:
        """Read the registers of the lift. Raises ConnectFailed and ControllerTaken."""
        wires = network_wires(self._loaded.path.parent)
        async with AsyncExitStack() as stack:
            probers: dict[str, Prober] = {}
            for name in self.links:
                controller = self._loaded.controllers[name]
                wire = wires(controller)
                probers[name] = await stack.enter_async_context(
                    open_prober(controller.host, controller.port, make_wire=partial(_given, wire))
                )
            by_endpoint = {name: (probers[device.controller], device.unit_id) for name, device in self._devices.items()}
            yield Registers(
                self._loaded.codecs[self._lift], by_endpoint, self._loaded.links[self._devices[""].controller]
            )

    @asynccontextmanager
    async def holder(self, floor: str) -> AsyncIterator[KillableHolder]:
        """Start a second manager that holds the door at a floor. Raises HoldFailed."""
        program = (sys.executable, "-I", "-m", "lift_manager", "checkout")
        process = await asyncio.create_subprocess_exec(
            *program, str(self._loaded.path), self._lift, "--hold-door-at", floor, stdin=PIPE, stdout=PIPE, stderr=PIPE
        )
        try:
            await _wait_until_held(process)
            yield KillableHolder(process)
        finally:
            await _end(process)


def _given(wire: Wire, _host: str, _port: int) -> Wire:
    """Return a wire that was made already, as a prober asks for one."""
    return wire


class KillableHolder:
    """The process of a second manager."""

    def __init__(self, process: Process) -> None:
        self._process = process

    async def kill(self) -> None:
        """Kill it."""
        self._process.kill()
        await self._process.wait()


async def _wait_until_held(process: Process) -> None:
    if process.stdout is None or process.stderr is None:
        raise HoldFailed("the second manager has no output")
    try:
        async with asyncio.timeout(HOLD_WITHIN_S):
            line = await process.stdout.readline()
    except TimeoutError:
        raise HoldFailed(f"the second manager did not hold the door within {HOLD_WITHIN_S:g} s") from None
    if line.decode().strip() != HELD:
        why = (await process.stderr.read()).decode("utf-8", "replace").strip()
        raise HoldFailed(f"the second manager could not hold the door: {why}")


async def _end(process: Process) -> None:
    """Let a second manager release what it holds, and end."""
    if process.returncode is None:
        if process.stdin is not None:
            process.stdin.close()
        try:
            async with asyncio.timeout(END_WITHIN_S):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()


def hold_door(loaded: LoadedSite, lift: str, floor: str) -> None:
    """Be the second manager: hold the door at a floor until stdin ends, or this process is killed.

    Without the store of the site, which a killed process would leave with a session that nobody resumes.
    """

    async def work() -> None:
        async with (
            own_manager(loaded, name=NAME, may_command={lift}) as client,
            client.session(lift, robot=NAME) as session,
        ):
            await session.go_to(floor, hold_door=True)
            await session.until(open_at(floor))
            print_lines([HELD])
            sys.stdout.flush()
            ended = asyncio.Event()
            loop = asyncio.get_running_loop()
            loop.add_reader(sys.stdin.fileno(), ended.set)
            try:
                await ended.wait()
            finally:
                loop.remove_reader(sys.stdin.fileno())
            await session.close(left=True)

    run_to_end(work())
