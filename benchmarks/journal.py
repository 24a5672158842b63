"""What a press pays for its row in the journal and the record of its lift, against a bare commit of SQLite in a thread.

    python benchmarks/journal.py [--presses 400] [--rounds 5] [--folder /var/lib/lift-manager]

Both write the same text to files in one folder with WAL and `synchronous=FULL`, one press after the other, and take turns round by
round, so that a busy disk slows both of them. Run it on the disk that the site has: the file system decides. It ends by itself.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sqlite3
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.chain import canonical
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_store

LIMIT_S = 300.0
ROW = Row(
    RowKind.PRESS,
    "about to press the call to L3",
    "east",
    "rmf:fleet/robot1",
    {
        "command": "call",
        "floor": "L3",
        "frames": ["00010000000601050004ff00", "000200000006010500040000"],
        "session": 17,
    },
)
Press = Callable[[], Awaitable[None]]
Contestant = Callable[[Path], contextlib.AbstractAsyncContextManager[Press]]


@contextlib.asynccontextmanager
async def bare(folder: Path) -> AsyncIterator[Press]:
    """One INSERT and its commit by the sqlite3 module, in a thread of an executor."""
    with ThreadPoolExecutor(1) as thread:
        loop = asyncio.get_running_loop()
        connection = await loop.run_in_executor(
            thread, partial(sqlite3.connect, folder / "bare.db", isolation_level=None)
        )

        def prepare() -> None:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
            connection.execute(
                "CREATE TABLE IF NOT EXISTS rows (seq INTEGER PRIMARY KEY, at, kind, lift, caller, text, data)"
            )

        def commit() -> None:
            values = (time.time_ns(), ROW.kind.value, ROW.lift, ROW.caller, ROW.text, canonical(ROW.data))
            connection.execute(
                "INSERT INTO rows (at, kind, lift, caller, text, data) VALUES (?, ?, ?, ?, ?, ?)", values
            )

        async def press() -> None:
            await loop.run_in_executor(thread, commit)

        await loop.run_in_executor(thread, prepare)
        yield press
        await loop.run_in_executor(thread, connection.close)


@contextlib.asynccontextmanager
async def store(folder: Path) -> AsyncIterator[Press]:
    """The same row by `before` of the store, with its number, its hash and a record."""
    kept = open_store(folder / "site.db", "benchmark", ["east"], Limits(400, 500))
    running = asyncio.ensure_future(kept.run(print))

    async def press() -> None:
        kept.keep("east", SavedLift())
        if (why := await kept.commit_now(ROW)) is not None:
            raise SystemExit(why)

    yield press
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def play(contestant: Contestant, folder: Path, presses: int) -> list[float]:
    """Return what each press took, in milliseconds, after some to warm up."""
    took = []
    async with contestant(folder) as press:
        for number in range(20 + presses):
            begun = time.perf_counter()
            await press()
            if number >= 20:
                took.append((time.perf_counter() - begun) * 1e3)
    return sorted(took)


async def main(chosen: argparse.Namespace, folder: Path) -> None:
    """Let both take turns, and print the median round of each."""
    contestants: dict[str, Contestant] = {"bare sqlite3": bare, "store": store}
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in contestants}
    for _ in range(chosen.rounds):
        for name, contestant in contestants.items():
            took = await play(contestant, folder, chosen.presses)
            found[name].append((took[len(took) // 2], took[len(took) * 99 // 100]))
    print(f"{chosen.rounds} rounds of {chosen.presses} presses in {folder}")
    print(f"{'':14}{'p50 ms':>9}{'p99 ms':>9}")
    medians = {
        name: [statistics.median(column) for column in zip(*pairs, strict=True)] for name, pairs in found.items()
    }
    for name, (p50, p99) in medians.items():
        print(f"{name:14}{p50:9.2f}{p99:9.2f}")
    ratios = [ours / theirs for ours, theirs in zip(medians["store"], medians["bare sqlite3"], strict=True)]
    print(f"{'store/bare':14}{ratios[0]:9.2f}{ratios[1]:9.2f}")
    figures = common.Figures()
    for place, name in enumerate(("p50", "p99")):
        bare_ms, store_ms = (medians[contestant][place] for contestant in contestants)
        figures.add(
            f"one press on the disk, {name}", f"{store_ms:.2f} ms", f"bare sqlite3 {bare_ms:.2f} ms", ratios[place]
        )
    figures.write(chosen.figures)


if __name__ == "__main__":
    parser = common.parser(__doc__)
    parser.add_argument("--presses", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--folder", type=Path, default=None, help="a folder on the disk to be measured")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as place:
        asyncio.run(asyncio.wait_for(main(arguments, Path(place)), LIMIT_S))
