"""Runs three lifts with simulated controllers and a manager in one process, without configuration."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from shutil import which
from socket import socket

from rich.console import Console

from lift_manager import app
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.panel.app import panel_on
from lift_manager.lab.panel.lift import PanelLift
from lift_manager.plain.http import MANAGER
from lift_manager.plain.paths import API
from lift_manager.plain.signals import stop_on_signals
from register_maps.codec import compile_map
from register_maps.load import load

POLL_S = 0.1
ACCEPTED = "the controller is simulated and ends with the manager"


@dataclass(frozen=True, slots=True)
class DemoLift:
    """One lift of the demo."""

    name: str
    map: str
    floors: Mapping[str, int]


LIFTS = (
    DemoLift("lift", "generic-registers", {"L1": 1, "L2": 2}),
    DemoLift("tower", "generic-registers", {"B1": -1, "L1": 1, "L2": 2, "L3": 3, "L4": 4, "L5": 5}),
    DemoLift("goods", "two-stop-agv", {"L1": 0, "L2": 1}),
)


async def run_demo(sock: socket, *, speed: float, console: Console, panel: socket | None = None) -> bool:
    """Run the demo on a listening socket until SIGTERM or Ctrl-C, with a panel on another one if there is one.

    Returns whether the release of every output was verified.
    """
    stop = asyncio.Event()
    stop_on_signals(stop)
    async with AsyncExitStack() as stack:
        lifts = [PanelLift(lift.name, compile_map(load(lift.map).map), lift.floors, speed=speed) for lift in LIFTS]
        ports = {lift.name: (await stack.enter_async_context(lift.running()))[""] for lift in lifts}
        address = None
        if panel is not None:
            address = await stack.enter_async_context(panel_on(panel, lifts, _address(sock)))
        loaded = LoadedSite(_site(ports), {lift.name: load(lift.map) for lift in LIFTS}, Path("demo"))
        return await app.run(loaded, sock, stop=stop, ready=lambda: _guide(console, _address(sock), ports, address))


def _address(sock: socket) -> str:
    host, port = sock.getsockname()[:2]
    return f"http://{host}:{port}"


def _site(ports: Mapping[str, int]) -> Site:
    return Site.model_validate(
        {
            "schema": 1,
            "name": "demo",
            "controllers": {
                lift.name: {"host": "127.0.0.1", "port": ports[lift.name], "map": lift.map, "simulated": True}
                for lift in LIFTS
            },
            "lifts": {
                lift.name: {
                    "controller": lift.name,
                    "access": "control",
                    "floors": dict(lift.floors),
                    "poll_s": POLL_S,
                    "accept_latching": ACCEPTED,
                }
                for lift in LIFTS
            },
        }
    )


def _ride_lines(lift: DemoLift, manager: str) -> list[str]:
    start, *_, destination = lift.floors
    program = "lift-manager" if which("lift-manager") else str(Path(sys.executable).with_name("lift-manager"))
    at = "" if manager == MANAGER else f" --manager {manager}"
    return [
        f"  lifts:  curl '{manager}{API}/lifts'",
        f"  ride:   {program} ride {lift.name} {start} {destination} --robot demo --yes{at}",
        f"  events: curl -N '{manager}{API}/events'",
    ]


def _guide(console: Console, manager: str, ports: Mapping[str, int], panel: str | None) -> None:
    base = f"{manager}/open-rmf/demo-lift"
    post = f"curl -X POST '{base}/lift_request?lift_name=lift' -H 'Content-Type: application/json' -d"
    lines = [
        "",
        f"[bold]Three lifts are running.[/bold] See them: {manager}/ (API: {manager}/docs)",
        *([f"Press their buttons, stand in a door, make faults: {panel}"] if panel is not None else []),
        "",
        "Send the car to L2 and hold its door:",
        f'  {post} \'{{"floor": "L2", "door_state": 2}}\'',
        "Watch it go (door_state 2 is open, motion_state 1 is up):",
        f"  curl '{base}/lift_state?lift_name=lift'",
        "Release it:",
        f'  {post} \'{{"floor": "L2", "door_state": 0}}\'',
        "Do the same with a ride, and follow the events:",
        *_ride_lines(LIFTS[0], manager),
        "",
        *(
            f"{lift.name}: floors {', '.join(lift.floors)}; controller on 127.0.0.1:{ports[lift.name]}, map {lift.map}"
            for lift in LIFTS
        ),
        "",
        "Ctrl-C ends the demo.",
    ]
    console.print("\n".join(lines), soft_wrap=True, highlight=False)
