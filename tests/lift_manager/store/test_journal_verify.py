"""The chain of a journal: whatever is done to its rows is found, and the row is named. The hash is typed here once more."""

import hashlib
import json
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lift_manager.lift import journal as domain
from lift_manager.lift.journal import RowKind
from lift_manager.store.chain import StoredRow
from lift_manager.store.errors import ChainBroken, JournalUnreadable
from lift_manager.store.read import ALL_ROWS, Reader, RowFilter, open_journal
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from lift_manager.store.store import PendingRow
from lift_manager.store.verify import Chain, Seal, read_seal, verify
from tests.support.examples import examples
from tests.support.rows import each_row

SITE = "Main hospital"
T0 = 1_795_200_000_000_000
Row = tuple[int, int, str, str, str, str, str, bytes]
COLUMNS = ("seq", "at", "kind", "lift", "caller", "text", "data", "hash")
CUT, ANCHOR, LAST = 5, 9, 12
"""Of the journal that was cut: rows up to 5 are gone, and row 9 says so."""


def digest(before: bytes, row: tuple[Any, ...]) -> bytes:
    text = json.dumps(list(row[:7]), ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(before + text.encode()).digest()


def seed(site: str = SITE) -> bytes:
    return hashlib.sha256(b"lift-manager journal\n" + site.encode()).digest()


def rows_of(count: int, site: str = SITE, anchors: dict[int, int] | None = None) -> list[Row]:
    """A chain from row 1; `anchors` says through which row each anchor row cuts."""
    rows: list[Row] = []
    before = seed(site)
    for seq in range(1, count + 1):
        kind, data = "press", f'{{"floor":"Ü{seq}"}}'
        if through := (anchors or {}).get(seq):
            kind = "anchor"
            data = f'{{"from":1,"hash":"{rows[through - 1][7].hex()}","rows":{through},"through":{through}}}'
        fields = (seq, T0 + seq * 1_000_003, kind, "east", "workshop:r1", f'go_to Überfloor "{seq}"', data)
        before = digest(before, fields)
        rows.append((*fields, before))
    return rows


CUT_ROWS = rows_of(LAST, anchors={ANCHOR: CUT})[CUT:]


def save(path: Path, rows: list[Row], site: str = SITE, head: Row | None = None) -> Path:
    """Write a store with these rows; `head` is the row that was committed as the newest, the last of them if it is not said."""
    newest = head or (rows[-1] if rows else (0, seed(site)))
    with closing(sqlite3.connect(path, isolation_level=None)) as file:
        file.execute("PRAGMA journal_mode = MEMORY")
        file.execute("PRAGMA synchronous = OFF")
        file.execute(f"PRAGMA application_id = {0x4C494654}")
        file.execute("PRAGMA user_version = 1")
        file.execute("BEGIN")
        file.execute(
            "CREATE TABLE rows (seq INTEGER PRIMARY KEY, at INTEGER NOT NULL, kind TEXT NOT NULL, lift TEXT NOT NULL,"
            " caller TEXT NOT NULL, text TEXT NOT NULL, data TEXT NOT NULL, hash BLOB NOT NULL)"
        )
        file.execute("CREATE TABLE about (key TEXT PRIMARY KEY, value TEXT NOT NULL)")
        file.execute("INSERT INTO about VALUES ('site', ?)", (site,))
        file.execute("CREATE TABLE head (id INTEGER PRIMARY KEY, seq INTEGER, hash BLOB, records INTEGER)")
        file.execute("INSERT INTO head VALUES (1, ?, ?, 0)", (newest[0], newest[-1]))
        file.executemany("INSERT INTO rows VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)
        file.execute("COMMIT")
    return path


def walked(path: Path, seal: str | None = None, site: str = SITE) -> Chain:
    with open_journal(path, copy=True) as reader:
        return verify(reader, site, None if seal is None else read_seal(seal))


def found(rows: list[Row], seal: str | None = None, head: Row | None = None) -> ChainBroken:
    with TemporaryDirectory() as folder, pytest.raises(ChainBroken) as broken:
        walked(save(Path(folder) / "x.db", rows, head=head), seal)
    return broken.value


def holds(rows: list[Row], seal: str | None = None) -> Chain:
    with TemporaryDirectory() as folder:
        return walked(save(Path(folder) / "x.db", rows), seal)


def changed(rows: list[Row], seq: int, column: str, value: object) -> list[Row]:
    index = COLUMNS.index(column)
    return sorted((*row[:index], value, *row[index + 1 :]) if row[0] == seq else row for row in rows)  # type: ignore[misc]


def test_the_hash_of_a_row_is_what_sha256sum_says_of_it() -> None:
    """Typed in a shell: printf of the seed, then of seed and row, each into sha256sum."""
    fields = (1, T0, "press", "east", "workshop:r1", 'go_to Überfloor "2"', '{"floor":"Ü2"}')
    golden = bytes.fromhex("d6c10b0698eb800858684522cf413074c63ce7fc119568c1e78d26a0384992fe")
    assert digest(seed(), fields) == golden
    assert holds([(*fields, golden)]).newest == StoredRow(*fields, golden)


def test_what_the_manager_writes_has_the_hash_of_the_format_and_holds(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    store = SqliteStore(path, SITE, Limits(keep_days=400, max_mb=500))
    said = [(f"text {n} 電梯", {"a": [1, 2.5, None]}) for n in range(30)]
    store.commit(
        {}, [PendingRow(T0, domain.Row(RowKind.PRESS, text, "öst", "rmf:\u200dá", data)) for text, data in said]
    )
    with open_journal(path) as reader:
        before = seed()
        for row in reader.rows():
            before = digest(before, row)
            assert row.hash == before
        chain = verify(reader, SITE)
    store.close()
    assert (chain.rows, chain.first, chain.cut) == (30, 1, None)


def test_a_whole_journal_holds_and_so_does_one_that_was_cut_and_one_without_rows() -> None:
    assert holds([]) == Chain(0, None, 0, None)
    whole = holds(rows_of(7))
    assert (whole.rows, whole.first, whole.cut) == (7, 1, None)
    cut = holds(CUT_ROWS)
    assert (cut.rows, cut.first) == (LAST - CUT, CUT + 1)
    assert cut.cut is not None
    assert (cut.cut.anchor, cut.cut.through) == (ANCHOR, CUT)


def test_rows_that_an_anchor_let_go_must_not_be_back() -> None:
    broken = found(rows_of(LAST, anchors={ANCHOR: CUT})[2:])
    assert broken.seq == 3
    assert f"was inserted: according to anchor row {ANCHOR} rows up to {CUT} were removed" in str(broken)


@pytest.mark.parametrize("which", ["whole", "cut"])
def test_rows_that_are_cut_off_at_the_end_are_found(which: str) -> None:
    rows = JOURNALS[which]
    broken = found(rows[:-1], head=rows[-1])
    assert str(broken) == f"row {LAST} is missing: row {LAST} was the newest, and the journal ends with row {LAST - 1}"
    assert found(rows[:-3], head=rows[-1]).seq == LAST - 2
    assert str(found([], head=rows[-1])) == f"row {LAST} is missing: it was the newest row, and there are no rows"
    assert str(found(rows, head=rows[-2])) == f"row {LAST} was inserted: row {LAST - 1} was the newest"


JOURNALS = {"whole": rows_of(LAST), "cut": CUT_ROWS}
TEXTS = st.text(max_size=30)
VALUES: dict[str, st.SearchStrategy[object]] = {
    "at": st.integers(-(2**63), 2**63 - 1) | st.floats(0.1, 0.9) | TEXTS.map(lambda text: f"x{text}"),
    **{name: TEXTS | st.binary(max_size=8) for name in ("kind", "lift", "caller", "text", "data")},
    "hash": st.binary(min_size=32, max_size=32) | st.binary(max_size=8) | st.integers(0, 9),
}


@examples(50)
@given(st.data())
@pytest.mark.parametrize("which", JOURNALS)
def test_any_column_of_any_row_that_is_changed_is_found_with_the_number_of_its_row(
    which: str, data: st.DataObject
) -> None:
    rows = JOURNALS[which]
    row = data.draw(st.sampled_from(rows))
    column = data.draw(st.sampled_from(COLUMNS[1:]))
    value = data.draw(VALUES[column].filter(lambda value: value != row[COLUMNS.index(column)]))
    assert found(changed(rows, row[0], column, value), head=rows[-1]).seq == row[0]


@examples(20)
@given(st.data())
@pytest.mark.parametrize("which", JOURNALS)
def test_any_row_that_is_given_another_number_is_found(which: str, data: st.DataObject) -> None:
    rows = JOURNALS[which]
    old = data.draw(st.sampled_from(rows))[0]
    new = data.draw(st.integers(-3, LAST + 5).filter(lambda seq: seq not in {row[0] for row in rows}))
    named = {int(number) for number in re.findall(r"-?\d+", str(found(changed(rows, old, "seq", new))))}
    assert named & {old, new}


@pytest.mark.parametrize("which", JOURNALS)
def test_a_row_that_is_deleted_from_the_middle_is_found(which: str) -> None:
    rows = JOURNALS[which]
    for index in range(1, len(rows) - 1):
        broken = found(rows[:index] + rows[index + 1 :])
        assert broken.seq == rows[index][0]
        assert f"row {broken.seq} is missing: row {broken.seq - 1} is followed by row {broken.seq + 1}" in str(broken)
    several = found(rows[:2] + rows[5:])
    assert str(several).startswith(f"row {rows[2][0]} and all up to row {rows[4][0]} are missing")


@each_row("which", JOURNALS)
@each_row("with_hash", [True, False])
def test_two_rows_that_are_swapped_are_found(which: str, with_hash: bool) -> None:
    rows = JOURNALS[which]
    width = 8 if with_hash else 7
    for low, high in [(a, b) for a in range(len(rows)) for b in range(a)]:
        swapped = list(rows)
        for here, there in ((low, high), (high, low)):
            swapped[here] = (rows[here][0], *rows[there][1:width], *rows[here][width:])  # type: ignore[assignment]
        assert found(swapped).seq == rows[high][0]


@pytest.mark.parametrize("which", JOURNALS)
def test_a_forged_row_at_the_end_is_found(which: str) -> None:
    rows = JOURNALS[which]
    forged = (LAST + 1, *rows[-1][1:7])
    assert found([*rows, (*forged, bytes(32))]).seq == LAST + 1
    assert found([*rows, (*forged, rows[-1][7])]).seq == LAST + 1
    assert found([*rows, (*forged, digest(rows[-2][7], forged))]).seq == LAST + 1


def test_rows_that_are_cut_off_at_the_beginning_without_an_anchor_are_found() -> None:
    assert str(found(rows_of(9)[1:])).startswith("row 1 is missing, and no row of the kind `anchor`")
    broken = found(CUT_ROWS[2:])
    assert broken.seq == CUT + 1
    assert f"according to anchor row {ANCHOR} rows up to {CUT} were removed, no further" in str(broken)
    assert found(CUT_ROWS[-2:]).seq == 1


def test_an_anchor_that_is_forged_is_found() -> None:
    rows = rows_of(9)
    last = rows[-1]

    def anchored(through: int, hash_: bytes) -> list[Row]:
        data = json.dumps({"through": through, "hash": hash_.hex()})
        fields = (10, T0, "anchor", "", "", "rows go", data)
        return [*rows[through:], (*fields, digest(last[7], fields))]

    assert holds(anchored(4, rows[3][7])).rows == 6  # the same as the manager's: the README says what that means
    assert found(anchored(4, rows[4][7])).seq == 5
    assert found(anchored(4, rows[3][7])[1:]).seq == 5
    assert found([*anchored(4, rows[3][7])[:-1], (*anchored(4, rows[3][7])[-1][:7], bytes(32))]).seq == 10
    forged = json.dumps({"through": CUT + 1, "hash": CUT_ROWS[0][7].hex()})
    assert found(changed(CUT_ROWS[1:], ANCHOR, "data", forged)).seq == ANCHOR
    for through in (CUT, CUT + 1, CUT - 1):
        forged = json.dumps({"through": through, "hash": CUT_ROWS[4][7].hex()})
        assert found(changed(CUT_ROWS, ANCHOR, "data", forged)).seq == ANCHOR
    for data in ("{}", "[]", "", '{"through":5}', '{"through":"5","hash":""}', "[" * 100_000):
        fields = (10, T0, "anchor", "", "", "rows go", data)
        broken = found([*rows[4:], (*fields, digest(last[7], fields))])
        assert (broken.seq, "without the rows that were removed" in str(broken)) == (10, True)


def test_a_changed_row_and_a_changed_anchor_are_told_by_the_first() -> None:
    both = changed(changed(CUT_ROWS, 7, "text", ""), ANCHOR, "data", "{}")
    assert found(both).seq == 7
    assert found(changed(changed(CUT_ROWS, 6, "text", ""), 11, "text", "")).seq == 6


def test_a_journal_of_another_site_is_told(tmp_path: Path) -> None:
    other = save(tmp_path / "other.journal.db", rows_of(4, "Depot"), "Depot")
    assert walked(other, site="Depot").rows == 4
    with pytest.raises(JournalUnreadable, match="is the journal of the site 'Depot', not of 'Main hospital'"):
        walked(other)
    renamed = found(rows_of(4, "Depot"))
    assert renamed.seq == 1
    assert "the journal is not of the site 'Main hospital'" in str(renamed)


def test_rows_that_a_manager_cuts_while_they_are_walked_are_no_fault(tmp_path: Path) -> None:
    path = save(tmp_path / "x.db", rows_of(LAST))
    cut = rows_of(LAST + 1, anchors={LAST + 1: CUT})[-1]

    class Cutting(Reader):
        """Its third row is the last of a batch, and the manager cuts before the next."""

        def rows(self, wanted: RowFilter = ALL_ROWS, after: int | None = None) -> Iterator[StoredRow]:
            for row in super().rows(wanted, after):
                yield row
                if row.seq == 3:
                    with closing(sqlite3.connect(path, isolation_level=None)) as manager:
                        manager.execute("DELETE FROM rows WHERE seq <= ?", (CUT,))
                        manager.execute("INSERT INTO rows VALUES (?, ?, ?, ?, ?, ?, ?, ?)", cut)
                        manager.execute("UPDATE head SET seq = ?, hash = ?", (cut[0], cut[-1]))
                    yield from super().rows(wanted, after=3)
                    return

    with Cutting(path, sqlite3.connect(path, isolation_level=None), immutable=False) as reader:
        chain = verify(reader, SITE)
    assert (chain.rows, chain.first) == (LAST + 1 - CUT, CUT + 1)


def sealed(row: Row) -> str:
    return f"{row[0]}:{row[7].hex()}"


def test_a_row_that_was_noted_earlier_is_compared() -> None:
    rows = rows_of(LAST)
    assert holds(rows, sealed(rows[6])).rows == LAST
    assert holds(rows, sealed(rows[6])[:18].upper()).rows == LAST
    assert holds(CUT_ROWS, sealed(rows[CUT - 1])).first == CUT + 1
    gone = found(CUT_ROWS, sealed(rows[1]))
    assert str(gone).startswith("row 2 cannot be compared: it was removed with all rows before row 6")
    assert found(CUT_ROWS, f"{CUT}:{'0' * 64}").seq == CUT


def test_rows_that_were_gone_when_a_seal_was_noted_must_not_be_back() -> None:
    assert holds(CUT_ROWS, f"{sealed(CUT_ROWS[-1])} from {CUT + 1}").first == CUT + 1
    assert holds(CUT_ROWS, f"{sealed(CUT_ROWS[-1])} from 1").first == CUT + 1
    rows = rows_of(LAST)
    back = found(rows, f"{sealed(rows[-1])} from {CUT + 1}")
    assert str(back) == "row 1 exists, and did not when the seal was noted, which begins with row 6: rows were inserted"


def test_only_a_row_that_was_noted_shows_that_everything_was_written_anew() -> None:
    rows = rows_of(LAST)
    noted = sealed(rows[-1])
    assert holds(rows[:-2]).rows == LAST - 2  # with a head to match
    assert "the journal ends with row 10" in str(found(rows[:-2], noted))
    anew = [(*row[:5], "nothing happened", row[6]) for row in rows]
    before, chained = seed(), list[Row]()
    for fields in anew:
        before = digest(before, fields)
        chained.append((*fields, before))
    assert holds(chained).rows == LAST
    assert "was rewritten" in str(found(chained, noted))


@each_row(
    "text",
    [
        "",
        "5",
        "5:",
        f"5:{'0' * 64} from",
        f"5:{'0' * 64}from 1",
        f"5:{'0' * 64} from x",
        ":ab",
        "5:abcd",
        f"-5:{'0' * 64}",
        f"5:{'g' * 64}",
        f"5:{'0' * 65}",
        f"{'9' * 19}:{'0' * 64}",
    ],
)
def test_a_seal_that_is_none_is_refused_in_words(text: str) -> None:
    with pytest.raises(ValueError, match="write NUMBER:HASH"):
        read_seal(text)


def test_a_seal_is_read_in_capitals_too() -> None:
    assert read_seal(f" 12:{'AB' * 8}\n") == Seal(12, "ab" * 8)
    assert read_seal(f"12:{'ab' * 8}  from 7") == Seal(12, "ab" * 8, 7)


def test_bytes_that_are_no_text_are_found(tmp_path: Path) -> None:
    path = save(tmp_path / "x.db", rows_of(4))
    with closing(sqlite3.connect(path, isolation_level=None)) as file:
        file.execute("UPDATE rows SET text = CAST(x'ff41' AS TEXT) WHERE seq = 3")
    with pytest.raises(ChainBroken, match=r"^row 3 does not follow row 2: it was changed"):
        walked(path)


def test_a_page_that_is_damaged_is_found_and_the_place_is_named(tmp_path: Path) -> None:
    path = save(tmp_path / "x.db", rows_of(4000))
    content = bytearray(path.read_bytes())
    half = len(content) // 2 // 4096 * 4096
    content[half : half + 4096] = b"\xff" * 4096
    path.write_bytes(content)
    with pytest.raises(ChainBroken, match=r"^row \d+ cannot be read, .* is damaged"):
        walked(path)
