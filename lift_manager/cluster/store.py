"""The store of a site that two managers share: a commit succeeds only while the key carries the epoch of its writer."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence

from lift_manager.cluster.content import (
    Head,
    Place,
    decode_head,
    decode_number,
    decode_record,
    decode_rows,
    encode_head,
    encode_key,
    encode_number,
    encode_record,
    encode_rows,
    next_head,
)
from lift_manager.cluster.errors import ClusterError, ClusterUnusable, EtcdUnavailable
from lift_manager.cluster.etcd import Entry, Etcd, has_revision, has_value, put, read, read_all, remove_upto
from lift_manager.cluster.term import Key
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.errors import CommitFailed
from lift_manager.store.store import PendingRow, UpkeepStep

TRIES_S = 1.5
"""How long a commit is tried before it counts as failed: less than the 2 s after which a press is refused, and than a term."""

RETRY_S = 0.05
"""Between two attempts. Chosen: a leader is elected in half a second."""

ROWS_IN_A_COMMIT = 500
"""More go in several transactions: etcd takes 1.5 MB in one, and a row has 2 kB at most."""

UPKEEP_COMMITS = 50
"""Commits after which rows that both machines have are removed. Chosen: often enough for that to take milliseconds."""

MOST_COMMITS = 100_000
"""Commits whose rows are kept for a machine that is away; then its journal gets a gap. Chosen: a day or two of a busy site, 100 MB."""


class EtcdStore:
    """Implements Store for one epoch of the active manager.

    Every transaction compares the key, and the head that the one before it left. So nothing is written in another epoch, and a late
    attempt never overwrites a later one. After a lost answer the attempt is made again; whether it was applied shows in the head.
    """

    def __init__(
        self,
        etcd: Etcd,
        place: Place,
        key: Key,
        machines: Collection[str],
        *,
        tries_s: float = TRIES_S,
        retry_s: float = RETRY_S,
    ) -> None:
        """`key` is that of the epoch; `machines` are those that copy rows to their disks. A commit is tried for `tries_s`."""
        self._tries_s = tries_s
        self._retry_s = retry_s
        self._etcd = etcd
        self._place = place
        self._own_key = has_value(place.active, encode_key(key))
        self._machines = frozenset(machines)
        self._head: Head | None = None
        """The head that the next transaction expects; None before the first one was read."""
        self._head_revision = 0
        self._attempts: dict[bytes, int] = {}
        """Heads of attempts since then whose answers were lost, and how many rows of the next commit each has stored."""
        self._already_stored = 0
        """How many rows of the next commit are stored already."""
        self._commits = 0

    def load(self) -> Mapping[str, SavedLift]:
        """Return the record of every lift that was ever committed, from any member that answers in time. Raises ClusterError."""
        give_up_at = time.monotonic() + self._tries_s
        while True:
            try:
                result = self._etcd.transact([], [read(self._place.head), read_all(self._place.records)])
            except EtcdUnavailable:
                if time.monotonic() >= give_up_at:
                    raise
                time.sleep(self._retry_s)
                continue
            break
        head, records = result.ranges
        self._expect(head)
        return {entry.key.removeprefix(self._place.records): decode_record(entry) for entry in records}

    def commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> bool:
        """Store these records and append these rows, the records with the last of the rows. Raises CommitFailed."""
        give_up_at = time.monotonic() + self._tries_s
        encoded = {lift: encode_record(record) for lift, record in records.items()}
        while True:
            portion = rows[self._already_stored : self._already_stored + ROWS_IN_A_COMMIT]
            is_last = self._already_stored + len(portion) == len(rows)
            if self._store(encoded if is_last else {}, portion, give_up_at) and is_last:
                break
        self._already_stored = 0
        self._commits += 1
        return self._commits % UPKEEP_COMMITS == 0

    def tail(self, count: int) -> Sequence[PendingRow]:
        """Return the newest rows of those that are not on both disks yet, the oldest of them first. Raises CommitFailed."""
        try:
            (entries,) = self._etcd.transact([], [read_all(self._place.rows)]).ranges
            rows = [row for entry in entries for row in decode_rows(entry)]
        except ClusterError as error:
            raise _failed(error) from error
        return rows[max(len(rows) - count, 0) :]

    def do_upkeep(self, now: int, *, check: bool) -> UpkeepStep:
        """Remove the rows that both machines have on the disk. Raises CommitFailed."""
        try:
            (copied,) = self._etcd.transact([], [read_all(self._place.copied)]).ranges
            found = {entry.key.removeprefix(self._place.copied): decode_number(entry) for entry in copied}
            newest = 0 if self._head is None else self._head.commit
            upto = max(min(found.get(machine, 0) for machine in self._machines), newest - MOST_COMMITS)
            if upto > 0:
                writes = [put(self._place.removed, encode_number(upto))]
                writes.append(remove_upto(self._place.rows, self._place.rows_of(upto)))
                self._etcd.transact([self._own_key], writes)
        except ClusterError as error:
            raise _failed(error) from error
        return UpkeepStep(more=False)

    def close(self) -> None:
        """Close the connections; the next call opens them again."""
        self._etcd.close()

    def _store(self, records: Mapping[str, bytes], rows: Sequence[PendingRow], give_up_at: float) -> bool:
        """Store these in one transaction; False if an earlier attempt turns out to have stored some of them."""
        try:
            if self._head is None:
                (head,) = self._etcd.transact([], [read(self._place.head)]).ranges
                self._expect(head)
            assert self._head is not None  # noqa: S101  the line above has set it
            after = next_head(self._head.commit + 1)
        except ClusterError as error:
            raise _failed(error) from error
        value = encode_head(after)
        self._attempts[value] = self._already_stored + len(rows)
        writes = [put(self._place.head, value)]
        writes += [put(self._place.records + lift, record) for lift, record in records.items()]
        writes += [put(self._place.rows_of(after.commit), encode_rows(rows))] if rows else []
        compare = [self._own_key, has_revision(self._place.head, self._head_revision)]
        while True:
            try:
                result = self._etcd.transact(compare, writes, [read(self._place.active), read(self._place.head)])
            except EtcdUnavailable as error:
                if time.monotonic() >= give_up_at:
                    raise _failed(error) from error
                time.sleep(self._retry_s)
                continue
            except ClusterError as error:
                del self._attempts[value]  # it changed nothing
                raise _failed(error) from error
            break
        if result.succeeded:
            self._adopt(after, result.revision, self._attempts[value])
            return True
        _, (head_entry,) = result.ranges
        if (stored := self._attempts.get(head_entry.value)) is None:
            raise CommitFailed(
                "this manager is not active any more: etcd keeps what it decides from the store",
                "look at the other one",
            )
        self._adopt(decode_head(head_entry), head_entry.revision, stored)
        return head_entry.value == value

    def _expect(self, found: Sequence[Entry]) -> None:
        if not found:
            raise ClusterUnusable(
                f"etcd holds nothing under {self._place.head}: `lift-manager cluster init` makes it, once for a site"
            )
        self._head, self._head_revision = decode_head(found[0]), found[0].revision

    def _adopt(self, head: Head, revision: int, stored: int) -> None:
        self._head, self._head_revision, self._already_stored = head, revision, stored
        self._attempts.clear()


def _failed(error: ClusterError) -> CommitFailed:
    return CommitFailed(
        f"the store in etcd cannot be written: {error}", "see that two of its three members run and reach each other"
    )
