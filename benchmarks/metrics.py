"""What it costs to be measured: 100 lifts at 10 Hz, with a scrape every 5 s and without.

    python benchmarks/metrics.py [--lifts 100] [--seconds 10] [--rounds 3] [--every 5]

One manager polls throughout; seconds with scrapes and without take turns, so that a busy machine slows both. Afterwards the same
numbers are scraped once more with the links stopped: what a scrape alone takes, and how long it keeps the loop at the most.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import statistics
import sys
import time
from collections.abc import AsyncIterator
from pathlib import Path

import uvloop

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from benchmarks.common import POLL_S
from lift_manager.app import ManagerParts

SETTLE_S = 2.0
ALONE = 20
ACCEPT = {"text": "text/plain", "OpenMetrics": "application/openmetrics-text;version=1.0.0"}


async def measure(ports: list[int], chosen: argparse.Namespace) -> None:
    """Poll, take turns, print."""
    building = common.building(ports, POLL_S)
    core: dict[str, list[float]] = {"polls alone": [], "with scrapes": []}
    async with _running(building):
        await asyncio.sleep(SETTLE_S)
        for _ in range(chosen.rounds):
            core["polls alone"].append(await _core(chosen.seconds))
            scraping = [
                asyncio.ensure_future(building.metrics.run()),
                asyncio.ensure_future(_scrape(building, chosen.every)),
            ]
            core["with scrapes"].append(await _core(chosen.seconds))
            for task in scraping:
                task.cancel()
            await asyncio.gather(*scraping, return_exceptions=True)
    for name, found in core.items():
        print(f"{name:<14}{statistics.median(found):>8.1%} of a core  ({', '.join(f'{one:.1%}' for one in found)})")
    alone, scraped = (statistics.median(found) for found in core.values())
    figures = common.Figures()
    of = f"without {alone:.1%} of a core"
    figures.add(
        f"a scrape every {chosen.every:g} s: CPU of the manager", f"{scraped:.1%} of a core", of, scraped / alone
    )
    for name, accept in ACCEPT.items():
        took_s, turn_s = await _alone(building, name, accept)
        figures.add(f"one scrape, {name}", f"{took_s * 1e3:.1f} ms, longest turn {turn_s * 1e3:.1f} ms")
    figures.write(chosen.figures)


async def _core(seconds: float) -> float:
    began, cpu = time.monotonic(), time.process_time()
    await asyncio.sleep(seconds)
    return (time.process_time() - cpu) / (time.monotonic() - began)


async def _scrape(building: ManagerParts, every_s: float) -> None:
    while True:
        await building.metrics.scrape(ACCEPT["OpenMetrics"])
        await asyncio.sleep(every_s)


async def _alone(building: ManagerParts, name: str, accept: str) -> tuple[float, float]:
    took_s, turns_s, body = [], [], b""
    for _ in range(ALONE):
        began = time.process_time()
        scraping = asyncio.ensure_future(building.metrics.scrape(accept))
        while not scraping.done():
            turn = time.process_time()
            await asyncio.sleep(0)
            turns_s.append(time.process_time() - turn)
        took_s.append(time.process_time() - began)
        body = scraping.result()[0]
    samples = sum(not line.startswith(b"#") for line in body.splitlines())
    took, turn = statistics.median(took_s), statistics.median(sorted(turns_s)[-ALONE:])
    print(
        f"{name:<14}{samples} samples, {len(body) / 1024:.0f} KB: {took * 1e3:.1f} ms, longest turn {turn * 1e3:.1f} ms"
    )
    return took, turn


@contextlib.asynccontextmanager
async def _running(building: ManagerParts) -> AsyncIterator[None]:
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(link.run()) for link in building.links]
        tasks.append(group.create_task(building.life.run()))
        yield
        for task in tasks:
            task.cancel()


def main() -> None:
    """Start the controllers, measure, end."""
    parser = common.parser(__doc__)
    parser.add_argument("--lifts", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--every", type=float, default=5.0, help="seconds between two scrapes")
    parser.add_argument("--beat", type=int, default=5, help="polls to a count of the alive counter")
    chosen = parser.parse_args()
    common.allow_files(2 * chosen.lifts)
    core, other = common.two_cores()
    with common.controllers(chosen.lifts, chosen.beat, other) as ports:
        common.pin(core)
        with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            runner.run(measure(ports, chosen))


if __name__ == "__main__":
    main()
