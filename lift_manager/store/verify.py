"""Verifies the hash chain of a journal: no row may have been changed, removed or inserted."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass

from lift_manager.lift.journal import RowKind
from lift_manager.store.chain import StoredRow, row_hash, seed
from lift_manager.store.database import Head
from lift_manager.store.errors import ChainBroken, JournalBusy, JournalUnreadable, RowUnreadable
from lift_manager.store.read import BATCH, Reader

_SEAL = re.compile(r"([0-9]{1,18}):([0-9a-fA-F]{16,64})(?:\s+from\s+([0-9]{1,18}))?")
_HASH = re.compile(r"[0-9a-f]{64}")
_OTHER_SITE = "it was changed, or the journal is not of the site {site!r}"
_OTHER_ROW = "it was changed, or stands in the place of another"


@dataclass(frozen=True, slots=True)
class Seal:
    """A row whose number and hash a person noted earlier."""

    seq: int
    hash: str
    """Its first 16 hexadecimal digits or more."""
    first: int | None = None
    """The oldest row at that time; None if it was not noted."""


@dataclass(frozen=True, slots=True)
class Cut:
    """The newest cut by retention, from its anchor row."""

    anchor: int
    """The number of the anchor row."""
    through: int
    """The newest row that was removed."""
    hash: bytes
    """The hash of that row."""
    at: int
    """When, in microseconds since 1970: the time of the anchor row."""


@dataclass(frozen=True, slots=True)
class Chain:
    """A chain without errors."""

    rows: int
    newest: StoredRow | None
    """None if there are no rows."""
    first: int
    """The oldest row; 0 if there is none."""
    cut: Cut | None
    """The cut that removed the rows before `first`."""
    oldest: StoredRow | None = None
    """Row `first`; None if there is none."""


def read_seal(text: str) -> Seal:
    """Read `NUMBER:HASH` or `NUMBER:HASH from FIRST`. Raises ValueError."""
    found = _SEAL.fullmatch(text.strip())
    if found is None:
        text = (
            "write NUMBER:HASH, or 'NUMBER:HASH from FIRST', as --verify prints it, with at least 16 digits of the hash"
        )
        raise ValueError(text)
    return Seal(int(found[1]), found[2].lower(), None if found[3] is None else int(found[3]))


def verify(reader: Reader, site: str, seal: Seal | None = None) -> Chain:
    """Verify the whole chain, and the row of a seal. Raises ChainBroken and JournalUnreadable.

    A manager may be writing meanwhile; rows that it removes during the walk do not count as errors.
    """
    if reader.site != site:
        raise JournalUnreadable(f"{reader.path} is the journal of the site {reader.site!r}, not of {site!r}")
    while True:
        first = reader.first()
        try:
            chain = _ChainWalk(reader, site).chain(first)
            if seal is not None:
                _compare_seal(reader, chain, seal)
        except ChainBroken:
            if reader.first() == first:
                raise
        else:
            return chain


class _ChainWalk:
    """One walk from the oldest row to the newest."""

    def __init__(self, reader: Reader, site: str) -> None:
        self._reader = reader
        self._site = site
        self._cut: Cut | None = None
        self._suspicion: ChainBroken | None = None
        """An error at the beginning, unless the row that indicates it turns out to be the bad one."""

    def chain(self, first: int | None) -> Chain:
        committed = self._read_head()
        if first is None:
            if committed is not None and committed.seq:
                raise ChainBroken(committed.seq, "is missing: it was the newest row, and there are no rows")
            return Chain(0, None, 0, None)
        if first < 1:
            raise ChainBroken(first, "was inserted: the numbers of a journal begin at 1")
        before = self._hash_before(first)
        rows = 0
        oldest: StoredRow | None = None
        newest: StoredRow | None = None
        for row in self._rows(first):
            if before is None or (problem := self._link_problem(before, row)) is None:
                pass
            elif row.seq == first and self._cut is not None:
                self._suspicion = ChainBroken(
                    first, f"does not follow the row at which {self._cut_text()}: {_OTHER_ROW}"
                )
            else:
                self._raise_first(ChainBroken(row.seq, problem))
            if committed is not None and row.seq == committed.seq and row.hash != committed.hash:
                self._raise_first(
                    ChainBroken(row.seq, "is not the row that was committed as the newest: it was rewritten")
                )
            if first == 1 and row.kind == RowKind.ANCHOR and self._read_cut(row.seq) is not None:
                self._suspicion = ChainBroken(first, f"was inserted: according to anchor row {row.seq} it was removed")
            before, oldest, newest, rows = row.hash, oldest or row, row, rows + 1
        if self._suspicion is not None:
            raise self._suspicion
        self._check_end(newest.seq if newest is not None else 0, 0 if committed is None else committed.seq)
        return Chain(rows, newest, first, self._cut, oldest)

    def _read_head(self) -> Head | None:
        """Return the head; None if it cannot be read, which is reported later unless the rows have a worse error."""
        try:
            return self._reader.head()
        except JournalBusy:
            raise
        except JournalUnreadable:
            return None

    def _check_end(self, newest: int, committed: int) -> None:
        """Raise ChainBroken if rows were removed or added at the end, and JournalUnreadable."""
        if newest < committed:
            missing = _missing_text(newest + 1, committed)
            raise ChainBroken(
                newest + 1, f"{missing} missing: row {committed} was the newest, and the journal ends with row {newest}"
            )
        if newest > (committed := self._reader.head().seq):
            raise ChainBroken(committed + 1, f"was inserted: row {committed} was the newest")

    def _hash_before(self, first: int) -> bytes | None:
        """Return the hash before the oldest row; None if it is not known."""
        if first == 1:
            return seed(self._site)
        anchor = self._reader.newest_seq_of(RowKind.ANCHOR)
        if anchor is None:
            missing = _missing_text(1, first - 1)
            self._suspicion = ChainBroken(
                1, f"{missing} missing, and no row of the kind `anchor` records that they were removed"
            )
            return None
        cut = self._read_cut(anchor)
        if cut is None:
            self._suspicion = ChainBroken(anchor, "is an anchor row without the rows that were removed")
            return None
        self._cut = cut
        if cut.through != first - 1:
            words = self._cut_text()
            if cut.through < first:
                missing = _missing_text(cut.through + 1, first - 1)
                self._suspicion = ChainBroken(cut.through + 1, f"{missing} missing, and {words}, no further")
            else:
                self._suspicion = ChainBroken(first, f"was inserted: {words}")
            return None
        return cut.hash

    def _read_cut(self, anchor: int) -> Cut | None:
        try:
            row = self._reader.row(anchor)
            data = json.loads(row.data) if row is not None else None
        except (RowUnreadable, ValueError, RecursionError):
            return None
        match data:
            case {"through": int(through), "hash": str(digest)} if (
                row is not None and _HASH.fullmatch(digest) and 1 <= through < anchor
            ):
                return Cut(anchor, through, bytes.fromhex(digest), row.at)
        return None

    def _rows(self, first: int) -> Iterator[StoredRow]:
        """Yield all rows; raise for a gap between them."""
        expected = first
        try:
            for row in self._reader.rows():
                if row.seq != expected:
                    missing = _missing_text(expected, row.seq - 1)
                    self._raise_first(
                        ChainBroken(expected, f"{missing} missing: row {expected - 1} is followed by row {row.seq}")
                    )
                yield row
                expected = row.seq + 1
        except RowUnreadable as error:
            self._raise_first(ChainBroken(error.seq, f"was changed: it {error.what}"))
        except JournalBusy:
            raise
        except JournalUnreadable as error:
            self._raise_first(ChainBroken(expected, f"cannot be read, or one of the {BATCH} after it: {error}"))

    def _link_problem(self, before: bytes, row: StoredRow) -> str | None:
        if row_hash(before, row) == row.hash:
            return None
        if row.seq == 1:
            return f"does not begin the chain: {_OTHER_SITE.format(site=self._site)}"
        return f"does not follow row {row.seq - 1}: {_OTHER_ROW}"

    def _raise_first(self, found: ChainBroken) -> None:
        """Raise the earlier error of this one and the suspicion."""
        suspicion = self._suspicion
        if suspicion is None:
            raise found
        if self._cut is None or self._cut.through != suspicion.seq - 1 or found.seq == self._cut.anchor:
            # the suspicion is about missing rows, and the bad row may be the one that recorded them
            raise ChainBroken(found.seq, f"{found.what}; and {suspicion}")
        raise suspicion

    def _cut_text(self) -> str:
        cut = self._cut
        return f"according to anchor row {cut.anchor} rows up to {cut.through} were removed" if cut else ""


def _compare_seal(reader: Reader, chain: Chain, seal: Seal) -> None:
    last = chain.newest.seq if chain.newest is not None else 0
    if seal.seq > last:
        what = f"was noted, and does not exist: the journal ends with row {last}; rows were removed at its end, or this is an older copy"
        raise ChainBroken(seal.seq, what)
    if chain.cut is not None and seal.seq == chain.cut.through:
        digest = chain.cut.hash
    elif (row := reader.row(seal.seq)) is not None:
        digest = row.hash
    else:
        what = (
            f"cannot be compared: it was removed with all rows before row {chain.first}; note a row that still exists"
        )
        raise ChainBroken(seal.seq, what)
    if not digest.hex().startswith(seal.hash):
        what = f"has the hash {digest.hex()}, not the one that was noted: it, or a row before it, was rewritten since"
        raise ChainBroken(seal.seq, what)
    if seal.first is not None and chain.first < seal.first:
        what = f"exists, and did not when the seal was noted, which begins with row {seal.first}: rows were inserted"
        raise ChainBroken(chain.first, what)


def _missing_text(low: int, high: int) -> str:
    return "is" if low == high else f"and all up to row {high} are"
