"""What a small PC leaves of it: 100 lifts and single presses on one core at a quarter of its speed, next to the whole core.

    python benchmarks/small_pc.py [--lifts 100] [--seconds 5] [--presses 12] [--rounds 3] [--folder /var/lib/lift-manager]

A quarter of the speed is a core that is shared with three processes which do nothing but count: the scheduler of the kernel gives each
a quarter, in slices of some milliseconds. A slow processor would be late evenly; this one stands still for a few slices and then runs
at full speed, so the 99th percentiles are worse than its own. Quarter and whole take turns. It ends by itself.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import statistics
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common, fleet, press

WHOLE, QUARTER = "whole core", "quarter"


def _count(core: int | None) -> None:
    common.pin(core)
    while True:
        pass


@contextlib.contextmanager
def neighbours(count: int, core: int | None) -> Iterator[None]:
    """Keep a core busy with so many processes."""
    processes = [common.FORK.Process(target=_count, args=(core,), daemon=True) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.terminate()
            process.join()


def main(chosen: argparse.Namespace) -> None:
    """Measure in turns, print, end."""
    common.allow_files(2 * chosen.lifts)
    core, other = common.two_cores()
    if core is None or core == other:
        print("not two cores of its own: neighbours slow clients and controllers as well")
    busy = {WHOLE: 0, QUARTER: chosen.neighbours}
    fleets: dict[str, list[fleet.Round]] = {name: [] for name in busy}
    took_ms: dict[str, list[float]] = {name: [] for name in busy}
    common.pin(other)
    with common.controllers(chosen.lifts, 5, other) as ports:
        for _ in range(chosen.rounds):
            for name, count in busy.items():
                with neighbours(count, core), tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
                    fleets[name].append(fleet.run_round(fleet.MANAGER, ports, fleet.Plan(chosen.seconds, core)))
                    serve = partial(common.manager, Path(folder), core=core)
                    took_ms[name] += asyncio.run(press.measured(serve, chosen.presses))
    figures = common.Figures()
    print(f"{'':12}{'polls':>9}{'age p50':>11}{'p99':>10}{'us/poll':>9}{'POST p50':>12}{'p90':>11}")
    shown: dict[str, tuple[float, float, float]] = {}
    for name in busy:
        one, posts = fleet.median(fleets[name]), sorted(took_ms[name])
        rate, p90 = one.polls_per_s * common.POLL_S / chosen.lifts, posts[len(posts) * 9 // 10]
        shown[name] = rate, one.age_p99_s, statistics.median(posts)
        print(
            f"{name:12}{rate:>9.1%}{one.age_p50_s * 1e3:>8.0f} ms{one.age_p99_s * 1e3:>7.0f} ms{one.poll_us:>9.1f}"
            f"{statistics.median(posts):>9.1f} ms{p90:>8.1f} ms"
        )
    (rate, age_s, post_ms), (whole_rate, whole_age_s, whole_ms) = shown[QUARTER], shown[WHOLE]
    lifts, of = f"a quarter of a core, {chosen.lifts} lifts", WHOLE
    figures.add(f"{lifts}: polls that took place", f"{rate:.1%}", f"{of} {whole_rate:.1%}")
    figures.add(f"{lifts}: age, p99", f"{age_s * 1e3:.0f} ms", f"{of} {whole_age_s * 1e3:.0f} ms", age_s / whole_age_s)
    measure = "a quarter of a core, one lift: POST to the first byte of the call"
    figures.add(measure, f"{post_ms:.1f} ms", f"{of} {whole_ms:.1f} ms", post_ms / whole_ms)
    figures.write(chosen.figures)


if __name__ == "__main__":
    parser = common.parser(__doc__)
    parser.add_argument("--lifts", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=5.0, help="of polls in each round")
    parser.add_argument("--presses", type=int, default=12, help="in each round")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--neighbours", type=int, default=3, help="processes that count; only with three is it a quarter of the core"
    )
    parser.add_argument("--folder", type=Path, default=None, help="a folder on the disk to be measured")
    main(parser.parse_args())
