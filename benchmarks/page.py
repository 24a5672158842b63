"""What the page costs with 60 moving lifts: frames in Chromium, its CPU, and that of the manager.

    python benchmarks/page.py [--lifts 60] [--seconds 20] [--view / /wall /?view=table]

Three programs on loopback: the simulated lifts with their controllers, `lift-manager serve`, and Chromium, headless and without a graphics card.
Robots send each lift to another floor every few seconds. It ends by itself after about 40 s for each view.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import random
import statistics
import sys
import tempfile
from collections.abc import AsyncIterator, Iterator, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

import httpx

from benchmarks import common
from lift_manager.api.sessions import CommandRequest
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import ClientError
from lift_manager.lab.plant import controllers, simulated_lift
from lift_manager.lift.commands import CommandType
from register_maps.codec import compile_map
from register_maps.load import load
from tests.support.devtools import Tab, chromium

FLOORS = {f"L{number}": number for number in range(1, 9)}
POLL_S = 0.5
"""Each lift changes as often as it would with 0.1 s, and the computer has more time for what is measured."""
SETTLE_S = 10.0
"""The page is drawn, and every lift has begun to move."""
ANOTHER_FLOOR_S = (4.0, 8.0)
"""A caller may change its floor once in 3 s."""
LONG_FRAME_MS = 50.0
"""What people notice as a stutter: three frames of 60 a second."""
CPU_TIMES = ("TaskDuration", "ScriptDuration", "RecalcStyleDuration", "LayoutDuration")
WATCH = """
window.frames_ms = [];
let last = performance.now();
requestAnimationFrame(function draw(now) { window.frames_ms.push(now - last); last = now; requestAnimationFrame(draw); });
performance.setResourceTimingBufferSize(100000);
"""


@dataclass(frozen=True, slots=True)
class Measured:
    """One view over some seconds."""

    frames_ms: list[float]
    page_s: Mapping[str, float]
    """Time of the page's thread over wall time, by what it was for; on a busy computer it waits within it."""
    browser: float
    """CPU time of all processes of the browser over wall time: does not depend on what else runs."""
    manager: float
    """CPU time of the manager over wall time, with the page."""
    requests: int
    kilobytes: float
    """Of the answers to them; of the stream nothing."""
    moving: int
    """Lifts that were seen between two floors or on another floor than before."""


def _lifts(count: int, pipe: Connection) -> None:
    """Run the simulated lifts until terminated; send their ports."""

    async def play() -> None:
        codec, servers = compile_map(load(common.MAP).map), []
        for _ in range(count):
            server = controllers(codec.map, simulated_lift(codec, FLOORS))[""]
            await server.start()
            servers.append(server)
        pipe.send([server.port for server in servers])
        await asyncio.get_running_loop().create_future()

    asyncio.run(play())


@contextlib.contextmanager
def simulated(count: int) -> Iterator[list[int]]:
    """Run so many simulated lifts in a process of their own; gives the ports of their controllers."""
    ours, theirs = common.FORK.Pipe(duplex=False)
    process = common.FORK.Process(target=_lifts, args=(count, theirs), daemon=True)
    process.start()
    try:
        yield common.received(ours, process)
    finally:
        process.terminate()
        process.join()


def site_file(folder: Path, ports: list[int]) -> Path:
    """Write the site file of one lift at each port."""
    names = [f"lift-{number:02}" for number in range(1, len(ports) + 1)]
    controller = {"host": "127.0.0.1", "map": common.MAP, "simulated": True}
    lift = {
        "access": "control",
        "floors": FLOORS,
        "poll_s": POLL_S,
        "max_age_s": 10.0,
        "accept_latching": "it is simulated",
    }
    site = {
        "schema": 1,
        "name": "benchmark",
        "state": "state",
        "controllers": {name: {**controller, "port": port} for name, port in zip(names, ports, strict=True)},
        "lifts": {name: {**lift, "controller": name} for name in names},
    }
    file = folder / "site.yaml"
    file.write_text(json.dumps(site), "utf-8")  # JSON is YAML
    return file


@contextlib.asynccontextmanager
async def moving(base: str) -> AsyncIterator[list[str]]:
    """Send every lift from floor to floor, each for a robot of its own; gives their names."""
    dice = random.Random(1)
    async with LiftManagerClient(base) as client, asyncio.TaskGroup() as robots:
        names = [lift.name for lift in await client.lifts()]

        async def move(name: str) -> None:
            session = None
            while True:
                with contextlib.suppress(ClientError):  # a busy computer reads a lift too late: try again
                    session = session or await client.open_session(name, robot=f"robot-{name}")
                    floor = dice.choice(list(FLOORS))
                    request = CommandRequest(do=CommandType.GO_TO, floor=floor, hold_door=True, idempotency_key=None)
                    await client.command(name, session.id, request)
                await asyncio.sleep(dice.uniform(*ANOTHER_FLOOR_S))

        tasks = [robots.create_task(move(name)) for name in names]
        yield names
        for task in tasks:
            task.cancel()


async def cpu_s(client: httpx.AsyncClient) -> float:
    """Return the CPU seconds that the manager has used."""
    text = (await client.get("/metrics")).text
    (line,) = (line for line in text.splitlines() if line.startswith("process_cpu_seconds_total "))
    return float(line.split()[1])


def browser_cpu_s(profile: Path) -> float:
    """Return the CPU seconds that the browser with this profile has used, with all processes that it started."""
    parents: dict[str, str] = {}
    ticks: dict[str, int] = {}
    browser = ""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            command, status = (folder / "cmdline").read_text(), (folder / "stat").read_text()
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has ended meanwhile
        fields = status.rpartition(")")[2].split()
        parents[folder.name], ticks[folder.name] = fields[1], int(fields[11]) + int(fields[12])
        if f"--user-data-dir={profile}\0" in command and "--type=" not in command:
            browser = folder.name
    family = {browser}
    while more := {process for process, parent in parents.items() if parent in family} - family:
        family |= more
    return sum(ticks[process] for process in family) / os.sysconf("SC_CLK_TCK")


async def times_of(tab: Tab) -> dict[str, float]:
    """Return the CPU seconds of the page so far."""
    metrics = {one["name"]: one["value"] for one in (await tab.send("Performance.getMetrics"))["metrics"]}
    return {name: metrics[name] for name in CPU_TIMES}


async def measure(tab: Tab, profile: Path, base: str, view: str, lifts: int, seconds: float) -> Measured:
    """Look at one view."""
    async with httpx.AsyncClient(base_url=base, trust_env=False, timeout=60.0) as client:
        await tab.look(width=1920, height=1080)
        await tab.open(f"{base}{view}")
        rows = "document.querySelectorAll('.card, table.lifts tbody tr').length"
        await tab.until(f"{rows} === {lifts}")
        await asyncio.sleep(SETTLE_S)
        places = "[...document.querySelectorAll('.card .facts, table.lifts tbody tr')].map(place => place.innerText)"
        await tab.value(f"{WATCH}; performance.clearResourceTimings(); window.places = {places}; 0")
        await tab.send("Performance.enable")
        before, cpu, browser = await times_of(tab), await cpu_s(client), browser_cpu_s(profile)
        began = asyncio.get_running_loop().time()
        await asyncio.sleep(seconds)
        took = asyncio.get_running_loop().time() - began
        after, browser = await times_of(tab), (browser_cpu_s(profile) - browser) / took
        manager = (await cpu_s(client) - cpu) / took
        sizes = await tab.value("performance.getEntriesByType('resource').map(one => one.transferSize)")
        changed: Any = await tab.value(f"{places}.filter((place, at) => place !== window.places[at]).length")
        frames = await tab.value("window.frames_ms")
    spent = {name: (after[name] - before[name]) / took for name in CPU_TIMES}
    return Measured(frames, spent, browser, manager, len(sizes), sum(sizes) / 1000 / took, changed)


def add_figures(figures: common.Figures, lifts: int, view: str, found: Measured) -> None:
    """Add one view."""
    p50 = statistics.median(found.frames_ms)
    late = sum(ms > LONG_FRAME_MS for ms in found.frames_ms) / len(found.frames_ms)
    figures.add(f"{lifts} moving lifts, `{view}`: one frame", f"{p50:.1f} ms, {late:.1%} above {LONG_FRAME_MS:g} ms")
    figures.add(f"{lifts} moving lifts, `{view}`: CPU of the manager", f"{found.manager:.1%} of a core")


def show(view: str, found: Measured) -> None:
    """Print one row."""
    shares = statistics.quantiles(found.frames_ms, n=100)
    long = sum(ms > LONG_FRAME_MS for ms in found.frames_ms) / len(found.frames_ms)
    page = "".join(f"{found.page_s[name]:>8.1%}" for name in CPU_TIMES)
    print(
        f"{view:<15}{len(found.frames_ms):>7}{shares[49]:>8.1f}{shares[94]:>8.1f}{shares[98]:>8.1f}{max(found.frames_ms):>8.1f}{long:>8.1%}"
        f"{page}{found.browser:>9.1%}{found.manager:>9.1%}{found.requests:>6}{found.kilobytes:>7.1f}{found.moving:>7}{os.getloadavg()[0]:>6.1f}",
        flush=True,
    )


async def play(ports: list[int], chosen: argparse.Namespace, folder: Path) -> common.Figures:
    """Run the manager and the browser, and print a row for each view."""
    figures = common.Figures()
    with common.running("serve", str(site_file(folder, ports)), "--port", "0", pattern=common.SERVES) as ready:
        base = f"http://127.0.0.1:{ready[1]}"
        profile = folder / "profile"
        async with moving(base) as names, chromium(profile) as tab:
            for view in chosen.view:
                found = await measure(tab, profile, base, view, len(names), chosen.seconds)
                show(view, found)
                add_figures(figures, len(names), view, found)
    return figures


def main() -> None:
    """Start the lifts, look at each view, end."""
    parser = common.parser(__doc__)
    parser.add_argument("--lifts", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=20.0, help="measured of each view")
    parser.add_argument("--view", nargs="+", default=["/?view=cards", "/wall", "/?view=table"])
    chosen = parser.parse_args()
    print(
        f"{'':<15}{'frames':>7}{'p50 ms':>8}{'p95':>8}{'p99':>8}{'max':>8}{'> 50 ms':>8}{'thread':>8}{'script':>8}{'style':>8}{'layout':>8}"
        f"{'browser':>9}{'manager':>9}{'GETs':>6}{'KB/s':>7}{'moved':>7}{'load':>6}",
        flush=True,
    )
    with simulated(chosen.lifts) as ports, tempfile.TemporaryDirectory() as folder:
        asyncio.run(play(ports, chosen, Path(folder))).write(chosen.figures)


if __name__ == "__main__":
    main()
