"""The program whose disk loses power: presses, and says each number once its row is on the disk, with a record that has the same number.

python -m tests.campaigns.power_loss_writer FILE ROUND PRESSES [careless]

Each round is thirty days after the one before, so the rows of the one before are too old for it.
"""

from __future__ import annotations

import asyncio
import sqlite3
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from lift_manager.lift.events import Acknowledged, Cause
from lift_manager.lift.journal import Row, RowKind
from lift_manager.lift.record import DurableRecord
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.database import connect
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_store

SITE = "Main hospital"
START = datetime(2026, 1, 1, tzinfo=UTC)
PER_ROUND = 1_000
"""Numbers that one round may use."""


class Careless(sqlite3.Connection):
    """Flushes nothing."""

    def execute(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
        return super().execute(sql.replace("synchronous = FULL", "synchronous = OFF"), *parameters)


def connect_carelessly(uri: str) -> sqlite3.Connection:
    return sqlite3.connect(uri, uri=True, isolation_level=None, factory=Careless)


async def main(path: Path, number: int, presses: int, *, careless: bool) -> None:
    at = START + number * timedelta(days=30)
    connecting = connect_carelessly if careless else connect
    kept = open_store(path, SITE, ["east"], Limits(20, 500), clock=lambda: at, connect=connecting)
    running = asyncio.ensure_future(kept.run(lambda _: None))
    for press in range(PER_ROUND * number, PER_ROUND * number + presses):
        for _ in range(press % 4):  # commits of one row and of several
            kept.note(Row(RowKind.WRITE, "x" * 2_000, "east"))
        record = DurableRecord(acknowledged=Acknowledged("east", str(press), at, (Cause.FIRE,)))
        kept.keep("east", SavedLift(record))
        why = await kept.commit_now(Row(RowKind.PRESS, "about to press", "east", "rmf:robot1", {"n": press}))
        if why is not None:
            sys.exit(why)
        sys.stdout.write(f"{press}\n")
        sys.stdout.flush()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), *map(int, sys.argv[2:4]), careless="careless" in sys.argv[4:]))
