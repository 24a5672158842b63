"""What polling asks of a controller: requests and registers a second, for each shipped map.

    python benchmarks/plc.py [--poll 0.2] [--seconds 5] [--maps generic-registers ...]

One manager in this process polls a simulated lift of each map that may be commanded, over TCP; nobody commands any. A map that asks for
longer pauses gets them, as on a site. Requests are counted on the links: polls, looks at the outputs, heartbeats. It ends by itself.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import uvloop

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from lift_manager.app import build
from lift_manager.config.devices import POLL_S
from lift_manager.config.load import load_site
from lift_manager.lab.bench.plan import plan_lifts
from lift_manager.lab.bench.site import site_file
from lift_manager.lab.plant import listening, simulated_lift
from register_maps.load import load, shipped
from tests.support.trip_sites import COMPLETIONS, NO_TRIP, Completion

SETTLE_S = 1.0


async def measure(maps: list[str], poll_s: float, seconds: float, folder: Path) -> dict[str, tuple[float, float, int]]:
    """Return for each map how often it is polled, how many requests a second that takes, and over how many links."""
    polls_s = {name: max(poll_s, load(name).map.link.min_poll_s) for name in maps}
    plans = plan_lifts([{"name": name, "map": name, "poll_s": polls_s[name]} | _added(name) for name in maps], folder)
    async with contextlib.AsyncExitStack() as stack:
        ports = {
            plan.name: await stack.enter_async_context(listening(plan.map.map, simulated_lift(plan.codec, plan.floors)))
            for plan in plans
        }
        site = folder / "site.yaml"
        site.write_text(json.dumps(site_file(plans, ports, folder)), "utf-8")  # JSON is YAML
        loaded = load_site(site)
        parts = build(loaded)
        links = dict(zip(loaded.controllers, parts.links, strict=True))
        of = {
            plan.name: [
                links[name] for name, one in loaded.site.controllers.items() if one.port in ports[plan.name].values()
            ]
            for plan in plans
        }
        async with asyncio.TaskGroup() as group:
            works = [*(link.run() for link in parts.links), *parts.life.drives(), parts.life.run()]
            tasks = [group.create_task(work) for work in works]
            async with asyncio.timeout(common.READY_WITHIN_S):
                await parts.life.first_look()
            await asyncio.sleep(SETTLE_S)
            before = {name: sum(link.stats.transactions for link in found) for name, found in of.items()}
            await asyncio.sleep(seconds)
            after = {name: sum(link.stats.transactions for link in found) for name, found in of.items()}
            for task in tasks:
                task.cancel()
    return {name: (polls_s[name], (after[name] - before[name]) / seconds, len(found)) for name, found in of.items()}


def _added(name: str) -> dict[str, Any]:
    """Return what a site has to add to a map to have a whole lift."""
    added = COMPLETIONS.get(name, Completion())
    access = "monitor" if name in NO_TRIP else "control"
    return {"access": access, "parameters": dict(added.parameters), "override": dict(added.override)}


def main(chosen: argparse.Namespace) -> None:
    """Measure, print, end."""
    with tempfile.TemporaryDirectory() as folder, asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        found = runner.run(measure(chosen.maps, chosen.poll, chosen.seconds, Path(folder)))
    figures = common.Figures()
    print(f"{'map':30}{'poll s':>8}{'links':>7}{'requests/s':>12}{'each poll':>11}")
    for name, (poll_s, rate, links) in found.items():
        print(f"{name:30}{poll_s:>8g}{links:>7}{rate:>12.1f}{rate * poll_s:>11.2f}")
        figures.add(
            f"`{name}`, a poll every {poll_s:g} s",
            f"{rate:.1f} requests a second",
            f"{1 / poll_s:.0f} polls a second",
            rate * poll_s,
        )
    figures.write(chosen.figures)


if __name__ == "__main__":
    parser = common.parser(__doc__)
    parser.add_argument(
        "--poll",
        type=float,
        default=POLL_S,
        help="seconds between two polls; by default those of a site that does not say",
    )
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--maps", nargs="+", default=list(shipped()))
    main(parser.parse_args())
