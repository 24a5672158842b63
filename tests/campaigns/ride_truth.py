"""The campaign of rides: seeded robots on every map, with faults at any moment, each told nothing but the truth.

python -m tests.campaigns.ride_truth --rides 300 --seed 1
python -m tests.campaigns.ride_truth --replay 17
python -m tests.campaigns.ride_truth --table
"""

import argparse
import logging
import random
import sys
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from itertools import product

from lift_manager.rides.ride import OVER, Guidance, Phase, Ride
from register_maps.load import shipped
from tests.support.ride_faults import FAULTS, FURTHER, STEPS, Story, judge_end
from tests.support.ride_faults import play as play_fault
from tests.support.trip_sites import NO_TRIP, Site, site_of
from tests.support.virtual_time import run_virtual

CLEAR_S = 9.9
"""How long before a release of ours its robot must not be invited any more: `clear_s` of the site, less the time between two looks."""
EVERY_FAULT = {**FAULTS, **FURTHER}
MAPS = tuple(sorted(set(shipped()) - set(NO_TRIP)))
LIMIT_S = 6000.0
FURTHER_SHARE = 0.5
"""Share of rides with a fault of the wire, of the registers or of the machine."""


@dataclass(frozen=True)
class Plan:
    """One ride: on which lift, and what happens when."""

    seed: int
    map: str
    faults: tuple[tuple[float, str], ...]
    """After so many seconds of the robot's doing, each."""
    step: str
    """Up to which the robot gets undisturbed; empty for nowhere."""
    mute_s: float
    """For how long the robot says nothing after the first fault."""

    def __str__(self) -> str:
        then = ", ".join(f"{wait_s:.1f} s later {fault}" for wait_s, fault in self.faults)
        return f"seed {self.seed}: {self.map}, {self.step or 'at once'}, {then}, mute for {self.mute_s:.0f} s"


def draw(seed: int) -> Plan:
    """Return the ride of a seed."""
    dice = random.Random(seed)  # a seed must replay, and nobody is to be kept from guessing
    count = dice.choice((1, 1, 2, 3))
    faults = tuple((dice.uniform(0.0, 12.0), dice.choice(tuple(FAULTS))) for _ in range(count))
    plan = Plan(seed, dice.choice(MAPS), faults, dice.choice(("", *STEPS)), dice.choice((0.0, 0.0, 5.0, 100.0)))
    further = random.Random(f"{seed} further")  # dice of its own leave the rides of old as they were
    if further.random() < FURTHER_SHARE:
        at = further.randrange(len(plan.faults) + 1)
        one = (further.uniform(0.0, 12.0), further.choice(tuple(FURTHER)))
        plan = replace(plan, faults=(*plan.faults[:at], one, *plan.faults[at:]))
    return plan


@dataclass
class Tally:
    """What a number of rides came to."""

    ended: Counter[str] = field(default_factory=Counter)
    judged: int = 0
    failed: list[str] = field(default_factory=list)


async def play(plan: Plan, *, clear_s: float = CLEAR_S) -> tuple[Story, Ride]:
    """Play one ride to its end, and judge it."""
    async with AsyncExitStack() as stack:
        story = Story(site_of(plan.map), stack, clear_s=clear_s)
        await story.begin()
        if plan.step:
            await STEPS[plan.step](story)
        story.robot.speaks = not plan.mute_s
        for wait_s, fault in plan.faults:
            await story.go_on(wait_s)
            told = story.rig.look(story.robot.ride)
            if told.phase not in OVER:
                await EVERY_FAULT[fault](story)
        await story.go_on(plan.mute_s)
        story.robot.speaks = True
        over = await story.end()
        judge_end(story, over)
        return story, over


MEANT = ("cancel", "operator cancels")
TAKEN_AWAY = ("fire", "out of service", "lockout", "force-release")


def as_meant(step: str, fault: str, over: Ride) -> bool:
    """Whether a ride ended as this fault at this step has it end, on a lift that shows the fault."""
    if fault in MEANT:
        return over.phase is Phase.CANCELLED
    if fault in TAKEN_AWAY and step != "just outside":
        return (over.phase, over.guidance) == (Phase.GAVE_UP, Guidance.GAVE_UP) and over.advice is not None
    if fault == "restart, and its robot is heard":
        return over.phase is (Phase.CANCELLED if step == "clearing" else Phase.DONE)
    return fault != "dies and returns" or over.phase in (Phase.DONE, Phase.CANCELLED)


def table() -> Tally:
    """Play every fault at every step on every map. A map that does not show a fault may end its ride as if there were none."""
    tally = Tally()
    for name, step, fault in product(MAPS, STEPS, FAULTS):
        site = site_of(name)

        async def main(site: Site = site, step: str = step, fault: str = fault) -> tuple[Story, Ride]:
            return await play_fault(site, step, fault)

        try:
            story, over = run_virtual(main, limit_s=LIMIT_S)
        except AssertionError as finding:
            tally.failed.append(f"{name}, {step}, {fault}: {finding}")
            continue
        tally.ended[over.phase] += 1
        tally.judged += story.judged
    return tally


def run(seeds: Iterable[int]) -> Tally:
    """Play the rides of these seeds."""
    tally = Tally()
    for seed in seeds:
        plan = draw(seed)

        async def main(plan: Plan = plan) -> tuple[Story, Ride]:
            return await play(plan)

        try:
            story, over = run_virtual(main, limit_s=LIMIT_S)
        except AssertionError as finding:
            tally.failed.append(f"{plan}: {finding}")
            continue
        tally.ended[over.phase] += 1
        tally.judged += story.judged
    return tally


def main() -> int:
    """Play and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rides", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1, help="of the first ride; the others follow")
    parser.add_argument("--replay", type=int, metavar="SEED")
    parser.add_argument("--table", action="store_true", help="every fault at every step on every map")
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    began = time.monotonic()
    seeds = range(given.seed, given.seed + given.rides) if given.replay is None else (given.replay,)
    tally = table() if given.table else run(seeds)
    counts = ", ".join(f"{count} {phase}" for phase, count in sorted(tally.ended.items()))
    lines = [
        f"{tally.ended.total() + len(tally.failed)} rides in {time.monotonic() - began:.0f} s: {counts}; {tally.judged} words judged",
        *(f"FAILED {text}" for text in tally.failed),
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if tally.failed else 0


if __name__ == "__main__":
    sys.exit(main())
