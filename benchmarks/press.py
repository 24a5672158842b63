"""How long a request takes to the wire: from POST lift_request to the first byte of the call at the controller, journal included.

    python benchmarks/press.py [--presses 12] [--rounds 5] [--other TREE] [--folder /var/lib/lift-manager]

One manager in a process of its own (`serve`) with one controlled lift, one press after the other; this process plays the client and the
controller, so that both ends of a time are read from one clock. With --other the manager of another source tree takes turns with this one,
round by round, so that a busy machine slows both. Run it on the disk that the site has. It takes 12 s a round and ends by itself.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import statistics
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from benchmarks.common import PRESS_ATTEMPTS, PRESS_PAUSE_S, ROOT, Program, manager, serving


async def measured(serve: Callable[[int], Program], presses: int) -> list[float]:
    """Return what each press at one program took, in milliseconds."""
    dice, took = random.Random(1), list[float]()
    async with serving(serve) as server:
        for _ in range(PRESS_ATTEMPTS * presses):
            if (seconds := await server.press(2 + len(took) % 2)) is not None:
                took.append(seconds * 1e3)
            if len(took) > presses:
                break
            await asyncio.sleep(dice.uniform(*PRESS_PAUSE_S))
        else:
            raise SystemExit("too many requests were refused: this computer is too busy to read a lift in time")
    return took[1:]  # the first one waits until the controller has granted robot mode


async def main(chosen: argparse.Namespace) -> None:
    """Let the trees take turns, and print the median round of each."""
    trees = {"this tree": ROOT} | ({} if chosen.other is None else {str(chosen.other): chosen.other.resolve()})
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in trees}
    every: dict[str, list[float]] = {name: [] for name in trees}
    for _ in range(chosen.rounds):
        for name, tree in trees.items():
            with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
                took = sorted(await measured(partial(manager, Path(folder), tree=tree), chosen.presses))
            every[name] += took
            found[name].append((statistics.median(took), took[len(took) * 9 // 10]))
    print(f"{chosen.rounds} rounds of {chosen.presses} presses: POST -> first byte of the call, ms")
    print(f"{'':30}{'p50':>8}{'p90':>8}   p50 of each round")
    figures = common.Figures()
    for name, rounds in found.items():
        p50, p90 = (statistics.median(column) for column in zip(*rounds, strict=True))
        print(f"{name[-30:]:30}{p50:8.2f}{p90:8.2f}   {' '.join(f'{one:.2f}' for one, _ in rounds)}")
        figures.add(
            f"POST lift_request to the first byte of the call, journal included: {name}",
            f"{p50:.2f} ms, p90 {p90:.2f} ms",
        )
    figures.picture("POST lift_request to the first byte of the call", [one / 1e3 for one in every["this tree"]])
    figures.write(chosen.figures)


if __name__ == "__main__":
    parser = common.parser(__doc__)
    parser.add_argument("--presses", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--other", type=Path, default=None, help="another source tree to compare with")
    parser.add_argument("--folder", type=Path, default=None, help="a folder on the disk to be measured")
    asyncio.run(main(parser.parse_args()))
