"""The power fails while the store is written: at any write, with any part of what was not flushed.

    python -m tests.campaigns.power_loss --losses 5000 --seed 1

A writer runs under strace. For seeded moments the files are rebuilt as a disk may have them after a power loss: what was flushed is
there, of everything else an arbitrary part in whole sectors. The store must open there, verify, and hold every row that was
answered before that moment, and the record that was committed with the newest press. The next round goes on with one of these disks. Prints a verdict and exits 1 on a finding.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sqlite3
import sys
from contextlib import closing
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from lift_manager.store.chain import StoredRow, row_hash, seed
from lift_manager.store.database import open_database, read_head
from lift_manager.store.errors import StoreError
from lift_manager.store.sqlite import read_records
from tests.campaigns.lossy_disk import Event, LossyDisk, Said, traced
from tests.support.programs import ROOT

SITE = "Main hospital"
NAME = "site.db"
WRITER = "tests.campaigns.power_loss_writer"
LOSSES_PER_ROUND = 100
SHOWN = 5
MEMORY = Path("/dev/shm")
"""Where there is such a folder the files are in memory: what was flushed is told by the calls, and waiting for a disk shows nothing."""


@dataclass
class Report:
    losses: int = 0
    rows_answered: int = 0
    """At the moments of the losses, all together."""
    cuts: int = 0
    """Disks on which the oldest rows had gone."""
    unanswered: int = 0
    """Rows that were there though nobody had been told so yet."""
    findings: list[str] = field(default_factory=list)


def campaign(losses: int, seed_: int, *, per_round: int = LOSSES_PER_ROUND, careless: bool = False) -> Report:
    """Lose the power so many times; `careless` lets the writer flush nothing, to see that this is found."""
    report, luck = Report(), Random(seed_)
    with TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as place:
        base, answered = Path(place) / "base", set[int]()
        base.mkdir()
        for number in count():
            if report.losses >= losses or report.findings:
                break
            folder = Path(place) / "folder"
            shutil.copytree(base, folder)
            disk = LossyDisk(folder)
            presses = luck.randrange(50, 80)
            arguments = [str(folder / NAME), str(number), str(presses)]
            events = traced([sys.executable, "-m", WRITER, *arguments, *["careless"] * careless], folder, ROOT)
            some = min(per_round, losses - report.losses)
            _lose(events, disk, _Round(luck, answered, base, some), report)
            shutil.rmtree(folder)
    return report


@dataclass
class _Round:
    luck: Random
    answered: set[int]
    """Before this round; afterwards on the disk with which the next goes on."""
    base: Path
    losses: int


def _lose(events: list[Event], disk: LossyDisk, now: _Round, report: Report) -> None:
    moments = sorted(now.luck.choices(range(len(events) + 1), k=now.losses))
    goes_on = len(moments) - 1 - now.luck.randrange(1 + len(moments) // 4)  # late, so that the journal grows
    answered, taken = set(now.answered), 0
    for index, moment in enumerate(moments):
        for event in events[taken:moment]:
            if isinstance(event, Said):
                answered.update(map(int, event.text.split()))
            disk.take(event)
        taken = moment
        with TemporaryDirectory(dir=now.base.parent) as place:
            found = Path(place)
            disk.fail(now.luck, found)
            report.losses += 1
            report.rows_answered += len(answered)
            if (why := _judged(found / NAME, answered, report)) is not None:
                report.findings.append(f"loss {report.losses}, after call {moment} of {len(events)}: {why}")
            elif index == goes_on:
                now.answered |= answered
                shutil.rmtree(now.base)
                shutil.copytree(found, now.base)


def _judged(path: Path, answered: set[int], report: Report) -> str | None:
    """Say what is wrong with a store after a loss, opened as a manager opens it."""
    try:
        if not (records := read_records(path, SITE)) and not path.exists():
            return f"{len(answered)} rows were answered, and there is no store" if answered else None
        with closing(open_database(path, SITE)) as connection:
            read_head(connection, path)
            if (whole := connection.execute("PRAGMA integrity_check").fetchall()) != [("ok",)]:
                return f"damaged: {whole[:3]}"
            rows = [StoredRow(*row) for row in connection.execute("SELECT * FROM rows ORDER BY seq")]
    except (sqlite3.DatabaseError, OSError, StoreError) as error:
        return f"does not open: {error}"
    if (broken := _broken(rows)) is not None:
        return broken
    presses = [json.loads(row.data)["n"] for row in rows if row.kind == "press"]
    said = records["east"].record.acknowledged if records else None
    if presses and (said is None or said.by != str(presses[-1])):
        return f"press {presses[-1]} is the newest, and the record is {said}"
    there = set(presses)
    cut = bool(rows) and rows[0].seq > 1
    report.cuts += cut
    report.unanswered += len(there - answered)
    expected = {number for number in answered if not cut or number >= min(there)}
    if lost := expected - there:
        return f"{len(lost)} rows were answered and are gone, such as {min(lost)}"
    return None


def _broken(rows: list[StoredRow]) -> str | None:
    """Say which row does not follow from the one before."""
    before = seed(SITE)
    if rows and rows[0].seq > 1:
        anchors = [json.loads(row.data) for row in rows if row.kind == "anchor"]
        if not anchors or anchors[-1]["through"] != rows[0].seq - 1:
            return f"begins with row {rows[0].seq} and says nowhere why"
        before = bytes.fromhex(anchors[-1]["hash"])
    for row in rows:
        if row.hash != row_hash(before, row):
            return f"row {row.seq} does not follow from the one before"
        before = row.hash
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--losses", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--careless", action="store_true", help="flush nothing; this has to be found")
    arguments = parser.parse_args()
    report = campaign(arguments.losses, arguments.seed, careless=arguments.careless)
    sys.stdout.write(
        f"{report.losses} power losses, {report.rows_answered} rows answered before them, {report.cuts} after the oldest rows had"
        f" gone, {report.unanswered} rows there before they were answered; findings: {len(report.findings)}\n"
    )
    for finding in report.findings[:SHOWN]:
        sys.stdout.write(f"{finding}\n")
    return 1 if report.findings else 0


if __name__ == "__main__":
    sys.exit(main())
