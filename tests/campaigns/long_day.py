"""The long day: twenty lifts for eight hours of virtual time, with people, robots and faults; nothing wrong, and flat memory.

python -m tests.campaigns.long_day --hours 8 --lifts 20 --seed 1
"""

import argparse
import asyncio
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random

from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.oracle_setup import oracle_of
from lift_manager.lab.world.rules import Rules
from lift_manager.lab.world.world import World
from lift_manager.runtime.errors import RequestRefused
from tests.campaigns.playing import LIFT, Played, act, loaded_site
from tests.campaigns.schedules import LASTS_S, DiskFails, Event, PeopleCome, RobotRides, Schedule, draw
from tests.campaigns.story import Story
from tests.campaigns.truth import maps, quiet
from tests.support.trip_sites import NO_TRIP

POLL_S = 0.5
PARTS_OF_AN_HOUR = 4
"""After each of them memory is measured, which looks for all garbage first."""
QUIET_S = 240.0
"""Most time from the end of one minute with robots and faults to the beginning of the next, on one lift."""
MAY_GROW = 0.05
"""Share by which memory may grow in the second half of the day. In the first the manager fills what it remembers of each lift, which is
bounded: callers and their requests, refusals, sessions that are over. In a day of twenty lifts that takes 4.75 hours and 6 MB."""
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass
class Day:
    """What the day came to."""

    lifts: int
    hours: float
    played: Played
    memory: list[tuple[float, int]] = field(default_factory=list)
    """Hours since the beginning, and resident bytes."""

    @property
    def growth(self) -> float:
        """Share by which memory grew in the second half of the day."""
        midday = next(used for at, used in self.memory if at >= self.hours / 2)
        return self.memory[-1][1] / midday - 1

    @property
    def failed(self) -> bool:
        return self.played.failed or self.growth > MAY_GROW


def building(count: int) -> LoadedSite:
    """Return a site with so many lifts, of every map in turn."""
    names = [name for name in maps() if name not in NO_TRIP]
    controllers: dict[str, object] = {}
    lifts: dict[str, object] = {}
    loaded = {}
    for number in range(count):
        one = loaded_site(names[number % len(names)], 900.0, 300.0, 5.0)
        lift = f"{LIFT}{number}"
        spec = one.site.lifts[LIFT].model_dump(by_alias=True)
        places = {name: f"{name}{number}" for name in one.site.controllers}
        for port, (name, controller) in enumerate(one.site.controllers.items(), start=1):
            controllers[places[name]] = controller.model_dump(by_alias=True) | {"host": f"memory{number}", "port": port}
        endpoints = {name: {"controller": places[name]} for name in spec["endpoints"]}
        poll_s = max(POLL_S, spec["poll_s"])
        lifts[lift] = spec | {"controller": places["plc"], "endpoints": endpoints, "poll_s": poll_s}
        loaded[lift] = one.maps[LIFT]
    site = Site.model_validate({"schema": 1, "name": "long day", "controllers": controllers, "lifts": lifts})
    return LoadedSite(site, loaded, Path("long-day"))


def live(*, lifts: int, hours: float, seed: int, tell: Callable[[str], object] = lambda _: None) -> Day:
    """Let the day pass; `tell` gets a line for each quarter of an hour, and one for each finding."""
    loaded = building(lifts)
    oracle = oracle_of(loaded)
    day = Day(lifts, hours, Played(Schedule(seed, "all", 1.0, 900.0, 300.0, 5.0, ()), oracle.findings))
    lasts_s, parts = hours * 3600, max(2, round(hours * PARTS_OF_AN_HOUR))

    async def main() -> None:
        story = Story(oracle.findings, {name: judged.controllers for name, judged in oracle.lifts.items()})
        world = World(loaded, (oracle, Rules(oracle), day.played.aboard, story), seed=seed, observe_every_s=POLL_S)
        async with world.running():
            busy = [
                asyncio.ensure_future(_busy(world, name, seed * 1000 + n, day)) for n, name in enumerate(world.lifts)
            ]
            for part in range(1, parts + 1):
                told = len(oracle.findings)
                await elapse(lasts_s / parts)
                for task in busy:
                    if task.done():
                        task.result()  # it never ends by itself
                world.forget()
                gc.collect()
                day.memory.append((hours * part / parts, _resident()))
                tell(f"{hours * part / parts:g} h, {day.memory[-1][1] / 1e6:.0f} MB, {len(oracle.findings)} findings")
                for number, found in enumerate(oracle.findings[told:], start=told):
                    tell(f"  {found}")
                    for line in story.of(number):
                        tell(f"    {line}")
            for task in busy:
                task.cancel()
            for error in await asyncio.gather(*busy, return_exceptions=True):
                if isinstance(error, Exception):
                    raise error

    run_virtual(main, limit_s=lasts_s + 3600)
    day.played.judged, day.played.invitations = oracle.judged, oracle.invitations
    return day


async def _busy(world: World, lift: str, seed: int, day: Day) -> None:
    """One minute with robots and faults after the other, with time for people between them."""
    random = Random(seed)
    await act(world, lift, PeopleCome(random.uniform(0, 60), random.getrandbits(32)), day.played)
    while True:
        await elapse(random.uniform(5, QUIET_S))
        running = [
            asyncio.ensure_future(act(world, lift, event, day.played)) for event in _minute(random.getrandbits(32))
        ]
        try:
            await asyncio.gather(*running)
        finally:
            for task in running:
                task.cancel()
        for person_decides in (world.site.acknowledge, world.site.end_lockout):
            with suppress(RequestRefused):
                person_decides(lift, "the guard")


def _minute(seed: int) -> Iterator[Event]:
    """Yield the events of one minute; people are there all day, and one disk serves all lifts: `truth` lets it fail."""
    for event in draw(seed, maps()).events:
        if isinstance(event, PeopleCome | DiskFails):
            continue
        yield replace(event, gives_up_after_s=LASTS_S) if isinstance(event, RobotRides) else event


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES


def _tell(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--lifts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if os.environ.get("PYTHONHASHSEED") != "0":
        command = [sys.executable, "-m", "tests.campaigns.long_day", *sys.argv[1:]]
        return subprocess.run(command, env=os.environ | {"PYTHONHASHSEED": "0"}, check=False).returncode
    began = time.monotonic()
    with quiet():
        day = live(lifts=given.lifts, hours=given.hours, seed=given.seed, tell=_tell)
    lines = [
        f"{day.lifts} lifts, {day.hours:g} hours, in {time.monotonic() - began:.0f} s: {day.played.judged} states judged,",
        f"{day.played.invitations} invitations, {day.played.rides} rides, {len(day.played.findings)} findings",
        "memory: " + ", ".join(f"{at:g} h {used / 1e6:.0f} MB" for at, used in day.memory[::4]),
        f"grown by {day.growth:.1%} in the second half",
    ]
    sys.stdout.write("\n".join([*lines, ""]))
    return 1 if day.failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
