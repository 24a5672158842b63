"""Copies what the active commits to the disk of this machine: the journal and the records, on both machines all the time."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import NamedTuple

from drivers.thread import Worker
from lift_manager.cluster.content import Place, decode_head, decode_number, decode_record, decode_rows, encode_number
from lift_manager.cluster.errors import ClusterError
from lift_manager.cluster.etcd import Entry, Etcd, put, read, read_all
from lift_manager.lift.journal import Row, RowKind
from lift_manager.plain.text import counted
from lift_manager.store.committer import CHECK_S, Jobs
from lift_manager.store.errors import CommitFailed
from lift_manager.store.read import microseconds
from lift_manager.store.store import PendingRow, Store

_log = logging.getLogger(__name__)

COPY_EVERY_S = 0.5
"""Chosen: `lift-manager audit` shows what happened a moment ago, and etcd holds the rows of a second."""

COMMITS_AT_ONCE = 100
"""Chosen: 100 commits of a busy site are 100 kB, and the disk takes them in one transaction."""


class CopyStep(NamedTuple):
    """What one step has copied."""

    rows: int
    """How many rows."""
    more: bool
    """Whether there are further rows in etcd."""


class Replica:
    """The copy on this machine. Methods block; one thread at a time calls them."""

    def __init__(self, machine: str, etcd: Etcd, place: Place, store: Store, *, local: bool = False) -> None:
        """`local` copies what one member itself has, while there is no majority, and reports nothing to it."""
        self._local = local
        self._key = place.copied + machine
        self._etcd = etcd
        self._place = place
        self._store = store
        self._copied: int | None = None
        """The newest commit on this disk; None before the first step."""
        self._reported: int | None = None
        """The same, as etcd knows it for certain: it removes rows by that, and the next process begins there."""
        self._records: dict[str, int] = {}
        """The revision of each record on this disk."""

    def step(self, now: int) -> CopyStep:
        """Copy the next commits, and the records once their rows are copied. Raises ClusterError and CommitFailed."""
        place, local = self._place, self._local
        if (upto := self._copied) is None:
            (found,) = self._etcd.transact([], [read(self._key, local=local)]).ranges
            # an empty disk is a new one, whatever an earlier one of this machine had
            upto = decode_number(found[0]) if found and self._store.tail(1) else 0
        reads = [
            read(place.head, local=local),
            read(place.removed, local=local),
            read_all(place.rows, after=place.rows_of(upto), limit=COMMITS_AT_ONCE, local=local),
            read_all(place.records, local=local),
        ]
        head, removed, commits, records = self._etcd.transact([], reads).ranges
        rows = [row for entry in commits for row in decode_rows(entry)]
        if self._copied is None:
            rows = self._without_repeated(rows)
        if removed and (gone := decode_number(removed[0])) > upto:
            rows.insert(0, _gap_row(upto + 1, gone, now))
        newest = decode_head(head[0]).commit if head else upto
        if more := len(commits) == COMMITS_AT_ONCE:
            newest = place.commit_of(commits[-1])
        changed = () if more else [entry for entry in records if self._records.get(entry.key) != entry.revision]
        needs_upkeep = self._commit(changed, rows) if rows or changed else False
        # before anything else can fail: what is on the disk must not be copied again
        self._copied = newest
        self._records |= {entry.key: entry.revision for entry in changed}
        while needs_upkeep:
            needs_upkeep = self._store.do_upkeep(now, check=False).more
        if newest != self._reported and not local:
            self._etcd.transact([], [put(self._key, encode_number(newest))])
            self._reported = newest
        return CopyStep(len(rows), more)

    def check_limits(self, now: int) -> None:
        """Remove what is older than the site file allows. Raises CommitFailed."""
        check = True
        while self._store.do_upkeep(now, check=check).more:
            check = False

    def close(self) -> None:
        """Close the file and the connections."""
        self._store.close()
        self._etcd.close()

    def _commit(self, records: Sequence[Entry], rows: Sequence[PendingRow]) -> bool:
        decoded = {entry.key.removeprefix(self._place.records): decode_record(entry) for entry in records}
        return self._store.commit(decoded, rows)

    def _without_repeated(self, rows: list[PendingRow]) -> list[PendingRow]:
        """Leave out what an earlier process had copied when it ended, before it could write that to etcd."""
        there = list(self._store.tail(len(rows)))
        repeated = next((count for count in range(len(there), 0, -1) if there[-count:] == rows[:count]), 0)
        return rows[repeated:]


def _gap_row(first: int, last: int, now: int) -> PendingRow:
    text = f"rows of up to {counted(last - first + 1, 'commit')} are only in the journal of the other machine"
    return PendingRow(now, Row(RowKind.GAP, text, data={"from_commit": first, "to_commit": last}))


async def copy_all(
    replica: Replica,
    ended: asyncio.Event,
    *,
    jobs: Callable[[], Jobs] = lambda: Worker("lift-manager-copy"),
    now_us: Callable[[], int] = lambda: microseconds(datetime.now(UTC)),
) -> None:
    """Copy until `ended` is set, and once more after that. What fails is logged once, and tried again; meanwhile etcd keeps the rows."""
    worker, trouble, check_at = jobs(), "", 0.0
    loop = asyncio.get_running_loop()
    try:
        is_last = more = False
        while more or not is_last:
            is_last, more = ended.is_set(), False
            try:
                more = (await worker.submit(lambda: replica.step(now_us()))).more
                if loop.time() >= check_at:
                    await worker.submit(lambda: replica.check_limits(now_us()))
                    check_at = loop.time() + CHECK_S
                trouble = ""
            except (ClusterError, CommitFailed) as error:
                if not trouble:
                    _log.error("cluster: the journal is not copied to this machine: %s", error)
                trouble = str(error)
            if not more:
                with suppress(TimeoutError):
                    async with asyncio.timeout(COPY_EVERY_S):
                        await ended.wait()
    finally:
        _ = worker.submit(replica.close)  # nobody waits for it
        worker.stop()
