"""The campaign: seeded minutes of every map under faults, people and robots, each judged by what the lift really does.

python -m tests.campaigns.truth --schedules 10000 --seed 1
python -m tests.campaigns.truth --replay 1234          (one schedule, made smaller if it fails)
"""

import argparse
import logging
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from lift_manager.lab.world.witness import Witness
from register_maps.load import shipped
from tests.campaigns.playing import Played, play, still_fails
from tests.campaigns.schedules import Schedule, draw, shrink

ROOT = Path(__file__).parents[2]
Watched = Callable[[Schedule], Iterable[Witness]]
AT_A_TIME = 25
"""Schedules that a process is given at once."""
TELLS_EVERY = 500
"""Schedules between two words of a long campaign about how far it is."""


@cache
def maps() -> tuple[str, ...]:
    """Return every shipped map, in a fixed order."""
    return tuple(sorted(shipped()))


@dataclass
class Tally:
    """What a number of schedules came to."""

    schedules: int = 0
    judged: int = 0
    invitations: int = 0
    rides: int = 0
    excused: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    failed: list[tuple[int, str]] = field(default_factory=list)
    """Seed and first finding."""

    def add(self, played: Played) -> None:
        self.schedules += 1
        self.judged += played.judged
        self.invitations += played.invitations
        self.rides += played.rides
        for (_, rule, fault), count in played.excused.items():
            self.excused[played.schedule.map, rule, fault] += count
        if played.failed:
            self.failed.append((played.schedule.seed, str(played.findings[0])))

    def merge(self, other: "Tally") -> None:
        self.schedules += other.schedules
        self.judged += other.judged
        self.invitations += other.invitations
        self.rides += other.rides
        self.excused += other.excused
        self.failed += other.failed


def run(seeds: Iterable[int], watched: Watched = lambda _: ()) -> Tally:
    """Play one schedule per seed; `watched` gives those who watch one beside the judge."""
    tally = Tally()
    with quiet():
        for seed in seeds:
            schedule = draw(seed, maps())
            tally.add(play(schedule, witnesses=watched(schedule)))
    return tally


@contextmanager
def quiet() -> Iterator[None]:
    """Log nothing: what goes wrong here is made to."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


def smallest(seed: int) -> tuple[Schedule, Played]:
    """Return the smallest schedule that breaks the rule that this seed breaks first."""
    schedule = draw(seed, maps())
    played = play(schedule)
    if not played.failed:
        return schedule, played
    small = shrink(schedule, still_fails(played.findings[0]))
    return small, play(small)


def _chunks(first: int, count: int) -> Iterator[range]:
    for start in range(first, first + count, AT_A_TIME):
        yield range(start, min(start + AT_A_TIME, first + count))


def campaign(
    first: int, count: int, *, processes: int, stop_at: int, tell: Callable[[Tally], object] = lambda _: None
) -> Tally:
    """Play many schedules on several processes; ends early after so many failures. `tell` hears now and then how far it is."""
    tally = Tally()
    with ProcessPoolExecutor(processes) as pool:
        for done in pool.map(run, _chunks(first, count)):
            tally.merge(done)
            if tally.schedules % TELLS_EVERY == 0:
                tell(tally)
            if len(tally.failed) >= stop_at:
                pool.shutdown(cancel_futures=True)
                break
    return tally


def report(tally: Tally, took_s: float) -> list[str]:
    lines = [
        f"{tally.schedules} schedules in {took_s:.0f} s, {len(tally.failed)} failed",
        f"{tally.judged} states judged, {tally.invitations} of them invitations; {tally.rides} rides",
    ]
    lines += [
        f"let pass, undetectable: {count:6d}  {m}: {rule}: {fault}"
        for (m, rule, fault), count in sorted(tally.excused.items())
    ]
    lines += [f"FAILED seed {seed}: {text}" for seed, text in sorted(tally.failed)]
    return lines


def _tell(tally: Tally) -> None:
    seeds = ", ".join(str(seed) for seed, _ in sorted(tally.failed))
    sys.stderr.write(f"{tally.schedules} schedules, {len(tally.failed)} failed{f': {seeds}' if seeds else ''}\n")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schedules", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1, help="of the first schedule; the others follow")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--stop-at", type=int, default=20, help="failures after which it ends early")
    parser.add_argument("--replay", type=int, metavar="SEED")
    given = parser.parse_args()
    if os.environ.get("PYTHONHASHSEED") != "0":
        # sets of words have another order in every process otherwise, and a seed must replay exactly
        command = [sys.executable, "-m", "tests.campaigns.truth", *sys.argv[1:]]
        return subprocess.run(command, env=os.environ | {"PYTHONHASHSEED": "0"}, check=False).returncode
    if given.replay is not None:
        with quiet():
            schedule, played = smallest(given.replay)
        sys.stdout.write("\n".join([str(schedule), *map(str, played.findings), ""]))
        return 1 if played.failed else 0
    began = time.monotonic()
    tally = campaign(given.seed, given.schedules, processes=given.processes, stop_at=given.stop_at, tell=_tell)
    sys.stdout.write("\n".join([*report(tally, time.monotonic() - began), ""]))
    return 1 if tally.failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
