"""How fast simulated lifts run: 20 of them, always on the way to some floor, read and commanded as often as a manager does.

    python benchmarks/simulator.py [--lifts 20] [--seconds 60] [--rounds 5] [--poll 0.1]

The registers alone, in one process on one core, without a network: time is an argument of the simulator, so it runs as fast as the
processor allows. The table shows the median round. It ends by itself.
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from lift_manager.lab.plant import simulated_lift
from register_maps.codec import compile_map
from register_maps.load import load
from register_maps.words import Table

FLOORS = {f"L{number}": number for number in range(1, 9)}
ANOTHER_FLOOR_S = 8.0
"""A car has arrived and stands with its door open for some of it."""
REFRESH_S = 1.0
"""As the map says of robot mode."""
LIMIT = 100.0
"""Times real time, on one core."""


def play(lifts: int, seconds: float, poll_s: float) -> tuple[float, int]:
    """Let so many seconds pass for every lift; return the CPU seconds that this took, and how many floors the cars reached."""
    codec, dice = compile_map(load(common.MAP).map), random.Random(1)
    faces = [simulated_lift(codec, FLOORS) for _ in range(lifts)]
    due_s = [dice.uniform(0, ANOTHER_FLOOR_S) for _ in faces]
    refresh_s = [dice.uniform(0, REFRESH_S) for _ in faces]
    at, reached = [1] * lifts, 0
    began = time.process_time()
    for poll in range(int(seconds / poll_s)):
        now = poll * poll_s
        for number, face in enumerate(faces):
            words = face.read(Table.HOLDING, 0, common.REGISTERS, now)
            if words[common.FLOOR] != at[number]:
                at[number] = words[common.FLOOR]
                reached += 1
            if now >= due_s[number]:
                # the call is a pulse, which the next refresh ends; robot mode lasts for 3 s after each
                face.write(Table.HOLDING, common.GO_TO, [dice.choice(list(FLOORS.values())), 0, 1], now)
                due_s[number] += ANOTHER_FLOOR_S
            elif now >= refresh_s[number]:
                face.write(Table.HOLDING, common.GO_TO, [0, 0, 1], now)
                refresh_s[number] += REFRESH_S
    return time.process_time() - began, reached


def main(chosen: argparse.Namespace) -> None:
    """Play, print, end."""
    core, _ = common.two_cores()
    common.pin(core)
    rounds = [play(chosen.lifts, chosen.seconds, chosen.poll) for _ in range(chosen.rounds)]
    times = [chosen.seconds / cpu_s for cpu_s, _ in rounds]
    if not rounds[0][1]:
        raise SystemExit("no car has moved")
    median = statistics.median(times)
    print(
        f"{chosen.lifts} lifts, {chosen.seconds:g} s, a poll every {chosen.poll:g} s, {rounds[0][1]} floors reached:"
        f" {median:.0f} times real time ({min(times):.0f} to {max(times):.0f})"
    )
    figures = common.Figures()
    measure = f"{chosen.lifts} lifts on one core, a poll every {chosen.poll:g} s"
    figures.add(measure, f"{median:.0f} times as fast as real", limit=f"{LIMIT:g}")
    figures.write(chosen.figures)


if __name__ == "__main__":
    parser = common.parser(__doc__)
    parser.add_argument("--lifts", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0, help="of simulated time in each round")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--poll", type=float, default=common.POLL_S, help="simulated seconds between two polls of a lift"
    )
    main(parser.parse_args())
