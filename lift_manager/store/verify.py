"""Walk the chain of a journal: every row must be the one that was written, and none may be gone from between them."""

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
    """A row that somebody noted earlier."""

    seq: int
    hash: str
    """Its first 16 hexadecimal digits or more."""
    first: int | None = None
    """The oldest row at that time; None where nobody noted it."""


@dataclass(frozen=True, slots=True)
class Cut:
    """What the newest anchor row says."""

    anchor: int
    """The number of that row."""
    through: int
    """The newest row that was taken out."""
    hash: bytes
    """Of that row."""
    at: int
    """When, in microseconds since 1970: the time of the anchor row."""


@dataclass(frozen=True, slots=True)
class Chain:
    """A chain that holds."""

    rows: int
    newest: StoredRow | None
    """None where there is no row."""
    first: int
    """The oldest row; 0 where there is none."""
    cut: Cut | None
    """By which the rows before `first` are gone."""
    oldest: StoredRow | None = None
    """Row `first`; None where there is none."""


def read_seal(text: str) -> Seal:
    """Read `NUMBER:HASH` or `NUMBER:HASH from FIRST`. Raises ValueError."""
    found = _SEAL.fullmatch(text.strip())
    if found is None:
        text = "write NUMBER:HASH, or 'NUMBER:HASH from FIRST', as --verify has printed it, with 16 digits of the hash or more"
        raise ValueError(text)
    return Seal(int(found[1]), found[2].lower(), None if found[3] is None else int(found[3]))


def verify(reader: Reader, site: str, seal: Seal | None = None) -> Chain:
    """Walk the whole chain, and look at a row that was noted. Raises ChainBroken and JournalUnreadable.

    A manager may be writing meanwhile; rows that it cuts while they are walked are no fault of the chain.
    """
    if reader.site != site:
        raise JournalUnreadable(
            f"{reader.path} says that it is the journal of the site {reader.site!r}, not of {site!r}"
        )
    while True:
        first = reader.first()
        try:
            chain = _Walk(reader, site).chain(first)
            if seal is not None:
                _compare(reader, chain, seal)
        except ChainBroken:
            if reader.first() == first:
                raise
        else:
            return chain


class _Walk:
    """One walk from the oldest row to the newest."""

    def __init__(self, reader: Reader, site: str) -> None:
        self._reader = reader
        self._site = site
        self._cut: Cut | None = None
        self._doubt: ChainBroken | None = None
        """What is wrong with the beginning, unless the row that says so turns out to be the bad one."""

    def chain(self, first: int | None) -> Chain:
        committed = self._head()
        if first is None:
            if committed is not None and committed.seq:
                raise ChainBroken(committed.seq, "is missing: it was the newest, and there are no rows")
            return Chain(0, None, 0, None)
        if first < 1:
            raise ChainBroken(first, "was put in: the numbers of a journal begin at 1")
        before = self._beginning(first)
        rows = 0
        oldest: StoredRow | None = None
        newest: StoredRow | None = None
        for row in self._rows(first):
            if before is None or (problem := self._problem(before, row)) is None:
                pass
            elif row.seq == first and self._cut is not None:
                self._doubt = ChainBroken(first, f"does not follow the row at which {self._cut_words()}: {_OTHER_ROW}")
            else:
                self._broken(ChainBroken(row.seq, problem))
            if committed is not None and row.seq == committed.seq and row.hash != committed.hash:
                self._broken(
                    ChainBroken(row.seq, "is not the row that was committed as the newest: it was written anew")
                )
            if first == 1 and row.kind == RowKind.ANCHOR and self._read_cut(row.seq) is not None:
                self._doubt = ChainBroken(first, f"was put in: anchor row {row.seq} says that it was cut")
            before, oldest, newest, rows = row.hash, oldest or row, row, rows + 1
        if self._doubt is not None:
            raise self._doubt
        self._end(newest.seq if newest is not None else 0, 0 if committed is None else committed.seq)
        return Chain(rows, newest, first, self._cut, oldest)

    def _head(self) -> Head | None:
        """Return what the newest commit left; None where that cannot be read, which is told if the rows have nothing worse."""
        try:
            return self._reader.head()
        except JournalBusy:
            raise
        except JournalUnreadable:
            return None

    def _end(self, newest: int, committed: int) -> None:
        """Raise ChainBroken where rows were cut off at the end, or put behind the newest one, and JournalUnreadable."""
        if newest < committed:
            gone = _missing(newest + 1, committed)
            raise ChainBroken(
                newest + 1, f"{gone} missing: row {committed} was the newest, and the journal ends with row {newest}"
            )
        if newest > (committed := self._reader.head().seq):
            raise ChainBroken(committed + 1, f"was put in: row {committed} was the newest")

    def _beginning(self, first: int) -> bytes | None:
        """Return the hash before the oldest row, None where it is not known."""
        if first == 1:
            return seed(self._site)
        anchor = self._reader.newest_of(RowKind.ANCHOR)
        if anchor is None:
            gone = _missing(1, first - 1)
            self._doubt = ChainBroken(1, f"{gone} missing, and no row of the kind `anchor` says that they were cut")
            return None
        cut = self._read_cut(anchor)
        if cut is None:
            self._doubt = ChainBroken(anchor, "is an anchor that does not say what was cut")
            return None
        self._cut = cut
        if cut.through != first - 1:
            words = self._cut_words()
            if cut.through < first:
                gone = _missing(cut.through + 1, first - 1)
                self._doubt = ChainBroken(cut.through + 1, f"{gone} missing, and {words}, no further")
            else:
                self._doubt = ChainBroken(first, f"was put in: {words}")
            return None
        return cut.hash

    def _read_cut(self, anchor: int) -> Cut | None:
        try:
            row = self._reader.row(anchor)
            said = json.loads(row.data) if row is not None else None
        except (RowUnreadable, ValueError, RecursionError):
            return None
        match said:
            case {"through": int(through), "hash": str(digest)} if (
                row is not None and _HASH.fullmatch(digest) and 1 <= through < anchor
            ):
                return Cut(anchor, through, bytes.fromhex(digest), row.at)
        return None

    def _rows(self, first: int) -> Iterator[StoredRow]:
        """Yield rows that follow one another without a gap."""
        expected = first
        try:
            for row in self._reader.rows():
                if row.seq != expected:
                    gone = _missing(expected, row.seq - 1)
                    self._broken(
                        ChainBroken(expected, f"{gone} missing: row {expected - 1} is followed by row {row.seq}")
                    )
                yield row
                expected = row.seq + 1
        except RowUnreadable as error:
            self._broken(ChainBroken(error.seq, f"was changed: it {error.what}"))
        except JournalBusy:
            raise
        except JournalUnreadable as error:
            self._broken(ChainBroken(expected, f"cannot be read, or one of the {BATCH} after it: {error}"))

    def _problem(self, before: bytes, row: StoredRow) -> str | None:
        if row_hash(before, row) == row.hash:
            return None
        if row.seq == 1:
            return f"does not begin the chain: {_OTHER_SITE.format(site=self._site)}"
        return f"does not follow row {row.seq - 1}: {_OTHER_ROW}"

    def _broken(self, found: ChainBroken) -> None:
        """Raise the first of what is wrong."""
        doubt = self._doubt
        if doubt is None:
            raise found
        if self._cut is None or self._cut.through != doubt.seq - 1 or found.seq == self._cut.anchor:
            # the doubt is about rows that are gone, and the bad row may be the one that told of them
            raise ChainBroken(found.seq, f"{found.what}; and {doubt}")
        raise doubt

    def _cut_words(self) -> str:
        cut = self._cut
        return f"anchor row {cut.anchor} says that rows up to {cut.through} were cut" if cut else ""


def _compare(reader: Reader, chain: Chain, seal: Seal) -> None:
    last = chain.newest.seq if chain.newest is not None else 0
    if seal.seq > last:
        what = f"was noted, and is not there: the journal ends with row {last}; rows were cut off at its end, or this is an older copy"
        raise ChainBroken(seal.seq, what)
    if chain.cut is not None and seal.seq == chain.cut.through:
        digest = chain.cut.hash
    elif (row := reader.row(seal.seq)) is not None:
        digest = row.hash
    else:
        what = f"cannot be compared: it was cut with all rows before row {chain.first}; note a row that is still there"
        raise ChainBroken(seal.seq, what)
    if not digest.hex().startswith(seal.hash):
        what = (
            f"has the hash {digest.hex()}, not the one that was noted: it, or a row before it, was written anew since"
        )
        raise ChainBroken(seal.seq, what)
    if seal.first is not None and chain.first < seal.first:
        what = f"is there, and was gone when the seal was noted, which begins with row {seal.first}: rows were put in"
        raise ChainBroken(chain.first, what)


def _missing(low: int, high: int) -> str:
    return "is" if low == high else f"and all up to row {high} are"
