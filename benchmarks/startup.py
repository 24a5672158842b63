"""How long a start takes: the help, the demo, and a site of 1,000 lifts, next to Python alone and to the import of FastAPI.

    python benchmarks/startup.py [--rounds 5] [--lifts 1000] [--settle 15]

All take turns, each in a process of its own, and the table shows medians. A site is ready when its web server listens, after a first
reading of every lift or a second. It takes about 10 s a round. Then the memory of the site is read once, `--settle` seconds after it is
ready, and that of a site with one lift. It ends by itself.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common

PYTHON, FASTAPI = "python -c pass", "python -c 'import fastapi'"
HELP, DEMO = "lift-manager --help", "lift-manager demo, until it is ready"
LIMITS_S = {HELP: 0.25, DEMO: 1.5}
SITE_LIMIT_S = 8.0
"""Of 1,000 lifts."""
SITE_LIMIT_MB = 96
"""Of 1,000 lifts."""


def ended(*arguments: str) -> float:
    """Return the seconds until a Python program has ended."""
    began = time.monotonic()
    command = [sys.executable, *arguments]
    subprocess.run(command, cwd=common.ROOT, stdout=subprocess.DEVNULL, check=True)  # noqa: S603  our own arguments
    return time.monotonic() - began


def ready(*arguments: str) -> float:
    """Return the seconds until `lift-manager` with these arguments is ready."""
    began = time.monotonic()
    with common.running(*arguments, pattern=common.SERVES):
        return time.monotonic() - began


def memory_mb(settle_s: float, *arguments: str) -> float:
    """Return the anonymous memory of `lift-manager` with these arguments, so many seconds after it is ready."""
    ids: list[int] = []
    with common.running(*arguments, pattern=common.SERVES, started=ids.append):
        time.sleep(settle_s)
        return common.memory(ids[0]) / 2**20


def main(chosen: argparse.Namespace) -> None:
    """Start everything in turns, print, end."""
    common.allow_files(2 * chosen.lifts)
    site = f"lift-manager serve, {chosen.lifts:,} lifts, until it is ready"
    with common.controllers(chosen.lifts, 1, None) as ports, tempfile.TemporaryDirectory() as folder:
        file = common.site_file(Path(folder), {f"lift{port}": port for port in ports}, common.POLL_S)
        starts: dict[str, Callable[[], float]] = {
            PYTHON: partial(ended, "-c", "pass"),
            FASTAPI: partial(ended, "-c", "import fastapi"),
            HELP: partial(ended, "-m", "lift_manager", "--help"),
            DEMO: partial(ready, "demo", "--port", "0", "--panel", "0"),
            site: partial(ready, "serve", str(file), "--port", "0"),
        }
        took: dict[str, list[float]] = {name: [] for name in starts}
        for _ in range(chosen.rounds):
            for name, start in starts.items():
                took[name].append(start())
        site_mb = memory_mb(chosen.settle, "serve", str(file), "--port", "0")
        (alone := Path(folder, "alone")).mkdir()
        file = common.site_file(alone, {"lift": ports[0]}, common.POLL_S)
        lift_mb = memory_mb(chosen.settle, "serve", str(file), "--port", "0")
    limits_s = LIMITS_S | ({site: SITE_LIMIT_S} if chosen.lifts == 1000 else {})
    medians, figures = {name: statistics.median(found) for name, found in took.items()}, common.Figures()
    print(f"{'':60}{'s':>7}   times the import of FastAPI")
    for name, median_s in medians.items():
        print(f"{name:60}{median_s:>7.2f}{median_s / medians[FASTAPI]:>10.2f}")
        if name not in (PYTHON, FASTAPI):
            limit = f"{limits_s[name]:g} s" if name in limits_s else ""
            of = f"{FASTAPI} {medians[FASTAPI]:.2f} s"
            figures.add(name, f"{median_s:.2f} s", of, median_s / medians[FASTAPI], limit)
    name, limit = f"lift-manager serve, {chosen.lifts:,} lifts: anonymous memory", f"below {SITE_LIMIT_MB} MB"
    print(f"{name}: {site_mb:.1f} MB; with one lift {lift_mb:.1f} MB")
    limit = limit if chosen.lifts == 1000 else ""
    figures.add(name, f"{site_mb:.1f} MB", f"one lift {lift_mb:.1f} MB", site_mb / lift_mb, limit)
    figures.write(chosen.figures)


if __name__ == "__main__":
    parser = common.parser(__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--lifts", type=int, default=1000)
    parser.add_argument("--settle", type=float, default=15, help="seconds")
    main(parser.parse_args())
