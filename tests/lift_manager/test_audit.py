"""`lift-manager audit`: what it prints and writes, how it ends, and its table as a terminal shows it."""

import csv
import hashlib
import io
import json
import signal
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from rich.console import Console
from typer.testing import CliRunner, Result

from lift_manager.cli.audit_text import RowTable, escape_unprintable, write_csv, write_jsonl
from lift_manager.cli.main import app
from lift_manager.lift.journal import Json, Row, RowKind
from lift_manager.store.chain import StoredRow
from lift_manager.store.place import store_path
from lift_manager.store.read import open_journal
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from lift_manager.store.store import PendingRow
from tests.support.programs import Started, run
from tests.support.rows import each_row

NAME = "Main hospital"
SITE = {
    "schema": 1,
    "name": NAME,
    "timezone": "Asia/Singapore",
    "state": "kept",
    "controllers": {"plc": {"host": "127.0.0.1", "map": "generic-registers"}},
    "lifts": {"east-wing": {"controller": "plc", "floors": {"L1": 1, "L2": 2}}},
}
NOON = datetime(2026, 11, 20, 4, 0, tzinfo=UTC)
"""In Singapore it is noon."""
EVIL = '=HYPERLINK("http://x")\x1b[2J\u202e;@SUM(1)'


def called(*words: str) -> Result:
    """Call it in this process, which saves a second; only its own ways to end are let pass."""
    done = CliRunner().invoke(app, words)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


class Building:
    """A site file, and a journal where the manager keeps it."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "site.yaml"
        self.file.write_text(json.dumps(SITE), "utf-8")  # JSON is YAML
        self.journal = store_path(NAME, "kept", self.file, {})
        self._store: SqliteStore | None = None

    def write(self, *rows: tuple[datetime, str, str, str, str], data: Mapping[str, Json] | None = None) -> None:
        if self._store is None:
            self._store = SqliteStore(self.journal, NAME, Limits(keep_days=400, max_mb=500))
        noted = [
            PendingRow(int(at.timestamp()) * 1_000_000 + 123_456, Row(RowKind(kind), text, lift, caller, data or {}))
            for at, kind, lift, caller, text in rows
        ]
        self._store.commit({}, noted)

    def end(self) -> None:
        if self._store is not None:
            self._store.close()
            self._store = None

    def audit(self, *words: str, code: int = 0) -> str:
        done = called("audit", str(self.file), *words)
        assert done.exit_code == code, done.output
        return done.stderr if code else done.stdout

    def sql(self, text: str) -> None:
        with closing(sqlite3.connect(self.journal, isolation_level=None)) as file:
            file.execute(text)


@pytest.fixture
def building(tmp_path: Path) -> Building:
    return Building(tmp_path)


@pytest.fixture
def used(building: Building) -> Building:
    """Four rows of two days; a caller who means no good."""
    building.write(
        (NOON - timedelta(days=1), "manager", "", "", "a manager started"),
        (NOON, "request", "east-wing", "workshop:r1", "requests L2"),
        (NOON + timedelta(minutes=1), "alarm", "east-wing", "rmf:=evil", EVIL),
        (NOON + timedelta(hours=2), "person", "old lift", "M. Weber", "locked out: Türantrieb"),
        data={"floor": "Ü2", "evil": EVIL},
    )
    return building


def numbers(printed: str) -> list[int]:
    return [int(line.split()[0]) for line in printed.splitlines()]


def test_the_rows_are_printed_by_the_clock_of_the_building(used: Building) -> None:
    lines = used.audit().splitlines()
    assert lines[0] == "     1  2026-11-19 12:00:00             manager               a manager started"
    assert lines[1] == "     2  2026-11-20 12:00:00  east-wing  request  workshop:r1  requests L2"
    assert lines[3].split() == [
        "4",
        "2026-11-20",
        "14:00:00",
        "old",
        "lift",
        "person",
        "M.",
        "Weber",
        "locked",
        "out:",
        "Türantrieb",
    ]
    assert len(lines) == 4


def test_rows_are_chosen(used: Building) -> None:
    for words, wanted in (
        (("--lift", "east-wing"), [2, 3]),
        (("--kind", "alarm", "--kind", "person"), [3, 4]),
        (("--caller", "rmf"), [3]),
        (("--find", "TÜR"), [4]),
        (("--last", "2"), [3, 4]),
        (("--since", "2026-11-20"), [2, 3, 4]),
        (("--until", "2026-11-19"), [1]),
        (("--since", "2026-11-20T12:01"), [3, 4]),
        (("--since", "2026-11-20 04:01Z", "--until", "2026-11-20T14:00+08:00"), [3]),
        (("--until", "1d"), [1, 2, 3, 4]),
    ):
        assert numbers(used.audit(*words)) == wanted, words


def test_how_long_ago_and_a_time_of_today_are_understood(building: Building) -> None:
    now = datetime.now(UTC)
    local = now.astimezone(ZoneInfo("Asia/Singapore"))
    building.write(*((now - timedelta(hours=hours), "link", "", "", "x") for hours in (50, 3, 1)))
    assert numbers(building.audit("--since", "2h")) == [3]
    assert numbers(building.audit("--since", "240m", "--until", "7200s")) == [2]
    assert numbers(building.audit("--since", "1w")) == [1, 2, 3]
    today = [3] if (local - timedelta(hours=1)).date() == local.date() else []
    assert [3] * (3 in numbers(building.audit("--since", "00:00"))) == today


def test_where_no_row_is_wanted_it_says_so_and_names_the_lifts(used: Building) -> None:
    done = called("audit", str(used.file), "--lift", "west")
    assert (done.exit_code, done.stdout) == (0, "")
    assert done.stderr.strip() == "no row is of a lift 'west'; the lifts of this site are east-wing"
    assert called("audit", str(used.file), "--find", "nothing").stderr.strip() == "no row matches"
    assert numbers(used.audit("--lift", "old lift")) == [4]


def test_the_newest_fifty_are_shown_and_how_to_see_more(building: Building) -> None:
    building.write(*((NOON, "link", "", "", f"{n}") for n in range(60)))
    done = called("audit", str(building.file))
    assert numbers(done.stdout) == list(range(11, 61))
    assert "--last N shows more" in done.stderr
    assert called("audit", str(building.file), "--last", "60").stderr == ""


def test_no_control_character_reaches_the_terminal(used: Building, tmp_path: Path) -> None:
    for words in ((), ("--csv", "-"), ("--jsonl", "-")):
        printed = used.audit(*words)
        assert "\\u001b[2J" in printed
        assert all(sign.isprintable() or sign in "\r\n" for sign in printed)
    used.end()
    used.sql("UPDATE about SET value = 'x\x1b[2J'")
    for journal in ((), ("--journal", str(used.journal))):
        assert "\x1b" not in used.audit(*journal, "--verify", code=1)


def test_the_spreadsheet_runs_no_cell_and_has_every_column(used: Building, tmp_path: Path) -> None:
    file = tmp_path / "rows.csv"
    assert used.audit("--csv", str(file)) == f"4 rows in {file}\n"
    content = file.read_bytes()
    assert content.startswith(b"\xef\xbb\xbfseq,at,kind,lift,caller,text,data,hash\r\n")
    assert used.audit("--csv", "-").encode() == content[3:].replace(b"\r\n", b"\n")  # which is read as text
    rows = list(csv.DictReader(io.StringIO(content.decode("utf-8-sig"), newline="")))
    assert rows[2]["at"] == "2026-11-20T04:01:00.123456Z"
    assert rows[2]["text"] == "'=HYPERLINK(\"http://x\")\\u001b[2J\\u202e;'@SUM(1)"
    assert rows[2]["caller"] == "rmf:=evil"
    assert json.loads(rows[3]["data"])["floor"] == "Ü2"
    assert len(bytes.fromhex(rows[3]["hash"])) == 32


@each_row("text", ["=1", "+1", "-1", "@x", "\t=1", "\r=1", "\n=1", "\uff1d1", "a;=1", 'a;"=1', ";;-1", '"=1'])
def test_no_cell_begins_as_a_formula_even_where_a_semicolon_parts_cells(text: str) -> None:
    file = io.BytesIO()
    write_csv([StoredRow(1, 0, text, text, text, text, text, b"")], file)
    for delimiter in ",;":
        for line in csv.reader(io.StringIO(file.getvalue().decode(), newline=""), delimiter=delimiter):
            assert not [
                cell for cell in line if cell.lstrip('"').startswith(("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d"))
            ]


def test_the_lines_of_json_are_exact_so_that_the_chain_can_be_walked_from_them(used: Building, tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    used.audit("--jsonl", str(file))
    before = hashlib.sha256(f"lift-manager journal\n{NAME}".encode()).digest()
    lines = file.read_text("utf-8").splitlines()
    assert len(lines) == 4
    for line in lines:
        row = json.loads(line)
        at = datetime.fromisoformat(row["at"])
        micros = int(at.timestamp()) * 1_000_000 + at.microsecond
        data = json.dumps(row["data"], ensure_ascii=False, sort_keys=True, separators=(",", ":"))
        fields = [row["seq"], micros, row["kind"], row["lift"], row["caller"], row["text"], data]
        text = json.dumps(fields, ensure_ascii=False, separators=(",", ":"))
        before = hashlib.sha256(before + text.encode()).digest()
        assert row["hash"] == before.hex()


def test_data_that_no_manager_has_written_is_exported_as_text() -> None:
    for text in ("{", '{"b":1,"a":2}', '{"a": 1}', "NaN", '{"a":1,"a":2}', "[" * 100_000):
        file = io.BytesIO()
        assert write_jsonl([StoredRow(1, 0, "", "", "", "", text, b"")], file) == 1
        assert json.loads(file.getvalue())["data"] == text


def test_an_export_writes_a_row_before_it_takes_the_next_but_a_few_so_that_a_million_need_no_memory() -> None:
    file = io.BytesIO()
    ahead = []

    def rows() -> Iterator[StoredRow]:
        for seq in range(1, 2001):
            ahead.append((seq - 1) * 100 - len(file.getvalue()))
            yield StoredRow(seq, 0, "", "", "", "x" * 100, "{}", b"")

    for write in (write_csv, write_jsonl):
        file = io.BytesIO()
        write(rows(), file)
    assert max(ahead) < 20_000


def test_a_file_that_is_there_is_replaced_only_if_asked_for(used: Building, tmp_path: Path) -> None:
    file = tmp_path / "rows.csv"
    file.write_text("mine")
    assert "there already" in used.audit("--csv", str(file), code=1)
    assert file.read_text() == "mine"
    used.audit("--csv", str(file), "--last", "1", "--force")
    assert len(file.read_text("utf-8-sig").splitlines()) == 2
    assert "cannot be written" in used.audit("--csv", str(tmp_path / "none" / "rows.csv"), code=1)
    assert "there already" in used.audit("--csv", str(tmp_path), "--force", code=1)
    used.end()
    used.sql("UPDATE rows SET caller = x'00' WHERE seq = 3")
    file.write_text("mine")
    assert "row 3 has no text as its caller" in used.audit("--csv", str(file), "--force", code=1)
    assert file.read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"site.yaml", "kept", "rows.csv"}


def test_a_chain_that_holds_is_told_with_a_seal_and_the_seal_is_checked_later(used: Building) -> None:
    told = used.audit("--verify")
    assert "the chain of the site Main hospital holds" in told
    assert "rows    4, from 1 to 4" in told
    assert "newest  2026-11-20 14:00:00.123456 +0800" in told
    seal = told.split("seal    ")[1].split()[0]
    assert seal.startswith("4:")
    used.write((NOON, "link", "", "", "more"))
    assert "row 4 is the one that was noted" in used.audit("--since-seal", seal)
    used.end()
    used.sql("DELETE FROM rows WHERE seq >= 4")
    used.sql("UPDATE head SET seq = 3, hash = (SELECT hash FROM rows WHERE seq = 3)")  # by somebody who knows
    assert "the chain" in used.audit("--verify")
    assert "row 4 was noted, and does not exist" in used.audit("--since-seal", seal, code=1)


def test_a_seal_says_where_the_journal_began_and_a_cut_since_then_is_told(used: Building) -> None:
    told = used.audit("--verify")
    seal = told.split("seal    ")[1].splitlines()[0]
    assert seal.endswith(" from 1")
    assert "row 4 is the one that was noted\n        no row was cut since\n" in used.audit("--since-seal", seal)
    cut_through(used, 2)
    told = used.audit("--since-seal", seal)
    assert "noted   row 4 is the one that was noted\n        rows 1 to 2 were there then, and were cut since\n" in told
    assert "from 3\n" in told.split("seal    ")[1]
    assert "cut since" not in used.audit("--since-seal", seal.split()[0])


def cut_through(building: Building, through: int, at: datetime = NOON + timedelta(hours=3)) -> None:
    """Cut as a manager does, or as somebody who knows how it does."""
    with open_journal(building.journal) as reader:
        last = reader.row(through)
    assert last is not None
    building.write(
        (at, "anchor", "", "", "rows go: they are too old"), data={"through": through, "hash": last.hash.hex()}
    )
    building.end()
    building.sql(f"DELETE FROM rows WHERE seq <= {through}")


def test_a_cut_of_rows_that_the_site_keeps_is_named_as_odd_and_is_no_error(used: Building) -> None:
    cut_through(used, 2)
    told = used.audit("--verify")
    assert (
        "odd     that cut left rows of the last 0 days; the site file keeps 400, and the journal has 0 of 500 MB:"
        in told
    )
    assert "or has somebody cut it?" in told


def test_a_cut_of_rows_that_are_too_old_or_too_many_is_not_odd(used: Building) -> None:
    cut_through(used, 2, NOON + timedelta(days=400))
    assert "odd " not in used.audit("--verify")
    used.write((NOON, "link", "", "", "x" * 9_500_000))
    cut_through(used, 3)
    used.file.write_text(json.dumps(SITE | {"journal": {"keep_days": 400, "max_mb": 10}}), "utf-8")
    assert "odd " not in used.audit("--verify")
    used.file.write_text(json.dumps(SITE | {"journal": {"keep_days": 400, "max_mb": 11}}), "utf-8")
    assert "odd " in used.audit("--verify")


def test_a_broken_chain_is_told_and_ends_with_1(used: Building) -> None:
    used.end()
    used.sql("UPDATE rows SET text = 'requests L1' WHERE seq = 2")
    done = called("audit", str(used.file), "--verify")
    assert done.exit_code == 1
    what = "row 2 does not follow row 1: it was changed, or stands in the place of another"
    assert done.stderr == f"{used.journal}: {what}\n"
    assert done.stdout == "     2  2026-11-20 12:00:00  east-wing  request  workshop:r1  requests L1\n"
    used.sql("UPDATE rows SET text = x'00' WHERE seq = 2")
    assert "row 2 was changed: it has no text as its text" in used.audit("--verify", code=1)


def test_a_cut_is_told_and_so_is_a_row_that_is_gone_from_the_end(used: Building) -> None:
    cut_through(used, 2)
    assert "rows    3, from 3 to 5\ncut     rows up to 2 were cut, says row 5\nodd" in used.audit("--verify")


def test_a_row_that_is_gone_from_the_end_is_told(used: Building) -> None:
    used.end()
    used.sql("DELETE FROM rows WHERE seq = 4")
    assert "row 4 is missing: row 4 was the newest, and the journal ends with row 3" in used.audit("--verify", code=1)


def test_a_copy_is_read_with_and_without_a_site_file(used: Building, tmp_path: Path) -> None:
    used.end()
    copy = used.journal.rename(tmp_path / "copy.db")
    assert numbers(used.audit("--journal", str(copy))) == [1, 2, 3, 4]
    done = called("audit", "--journal", str(copy), "--verify")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "the chain of the site Main hospital holds" in done.stdout
    assert "does not exist: no manager has run for this site" in used.audit(code=1)


def test_what_cannot_be_read_is_told_in_one_line(building: Building, tmp_path: Path) -> None:
    assert len(building.audit(code=1).splitlines()) == 1
    building.journal.parent.mkdir()
    building.journal.write_bytes(b"no journal " * 99)
    for words in ((), ("--follow",), ("--verify",), ("--csv", "-")):
        told = building.audit(*words, code=1)
        assert len(told.splitlines()) == 1
        assert "is not a journal, or is damaged" in told
    assert called("audit", str(tmp_path / "none.yaml")).exit_code == 2


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("--verify", "--follow"), "do not go together"),
        (("--csv", "-", "--jsonl", "-"), "do not go together"),
        (("--verify", "--last", "3"), "the whole chain is verified"),
        (("--since", "yesterday"), "is no time"),
        (("--until", "2026-13-01"), "is no time"),
        (("--since", "999999w"), "is no time"),
        (("--since", "0001-01-01"), "is no time"),
        (("--since-seal", "12"), "NUMBER:HASH"),
        (("--kind", "pres"), "pres"),
    ],
)
def test_words_that_make_no_sense_are_refused(used: Building, words: tuple[str, ...], what: str) -> None:
    assert what in " ".join(used.audit(*words, code=2).replace("│", " ").split())


def test_without_a_site_and_a_file_it_asks_for_one() -> None:
    done = called("audit")
    assert done.exit_code == 2
    assert "--journal FILE" in done.stderr


def test_new_rows_are_followed_until_ctrl_c_also_over_a_cut_and_a_restart(used: Building) -> None:
    with Started() as start:
        audit = start("audit", used.file, "--follow", "--lift", "east-wing", "--last", "1")
        audit.says("HYPERLINK")
        used.write((NOON, "link", "east-wing", "", "first news"), (NOON, "link", "west", "", "not wanted"))
        audit.says("first news")
        used.end()
        used.write((NOON, "link", "east-wing", "", "after a restart"))
        audit.says("after a restart")
        used.sql("DELETE FROM rows WHERE seq <= 3")
        used.write((NOON, "link", "east-wing", "", "after a cut"))
        audit.says("after a cut")
        audit.tell(signal.SIGINT)
        assert audit.ended() == 0
        assert audit.err == ""
        assert numbers(audit.out) == [3, 5, 7, 8]


def test_as_a_process_it_prints_utf_8_and_ends_with_what_was_found(used: Building) -> None:
    used.end()
    done = run("audit", used.file, "--find", "tür")
    assert (done.returncode, numbers(done.stdout), done.stderr) == (0, [4], "")
    used.sql("DELETE FROM rows WHERE seq = 2")
    done = run("audit", used.file, "--verify")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.endswith("row 2 is missing: row 1 is followed by row 3\n")


ROWS = [
    StoredRow(
        7,
        1_795_147_200_000_000,
        "request",
        "goods lift 2 (north)",
        "rmf:fleet_a/tiny robot",
        "requests L2, hold the door there",
        "{}",
        b"",
    ),
    StoredRow(
        8,
        1_795_190_400_000_000,
        "alarm",
        "",
        "",
        "[bold]no markup[/bold] :door: \x1b[2J and words for a second line 電梯",
        "{}",
        b"",
    ),
    StoredRow(9, 1_795_190_401_000_000, "of a later version", "east", "", "", "{}", b""),
]


def table(width: int) -> list[str]:
    file = io.StringIO()
    console = Console(file=file, width=width, force_terminal=True, color_system=None, emoji=False)
    sheet = RowTable(console, ZoneInfo("Asia/Singapore"), ROWS, ["east"])
    sheet.show(ROWS[:1])
    sheet.show(ROWS[1:])
    return [line.rstrip() for line in file.getvalue().splitlines()]


def test_a_terminal_gets_a_table_with_a_heading_for_each_day() -> None:
    assert table(120) == [
        "Friday 2026-11-20, +08",
        "   row  time      lift                  kind     caller                  text",
        "     7  12:00:00  goods lift 2 (north)  request  rmf:fleet_a/tiny robot  requests L2, hold the door there",
        "",
        "Saturday 2026-11-21, +08",
        "     8  00:00:00                        alarm                            [bold]no markup[/bold] :door: \\u001b[2J and",
        "                                                                         words for a second line 電梯",
        "     9  00:00:01  east                  of a",
        "                                        later",
        "                                        version",
    ]


def test_a_narrow_terminal_gets_it_too() -> None:
    lines = table(80)
    assert lines[1] == "time      lift        kind     caller              text"
    assert lines[2] == "12:00:00  goods lift  request  rmf:fleet_a/tiny    requests L2, hold the door"
    assert lines[3] == "          2 (north)            robot               there"
    assert max(map(len, lines)) <= 80


def test_what_is_seen_is_shown_as_it_is_and_the_rest_as_its_number() -> None:
    assert (
        escape_unprintable("Türantrieb 電梯 \u0645\u06cc\u200c\u062e a\u00a0b")
        == "Türantrieb 電梯 \u0645\u06cc\u200c\u062e a\u00a0b"
    )
    assert escape_unprintable("\x00\x07\x7f\x9b\n\u2028\u202e\U000e0041\ud800") == (
        "\\u0000\\u0007\\u007f\\u009b\\u000a\\u2028\\u202e\\udb40\\udc41\\ud800"
    )


def test_the_row_of_an_event_is_found_by_the_id_that_the_log_has(building: Building) -> None:
    building.write((NOON, "alarm", "east-wing", "", "the door is blocked"), data={"event": "mi9x1k2a-42", "n": 1})
    building.write(
        (NOON, "alarm", "east-wing", "", 'no event: "event":"mi9x1k2a-42"'), data={"text": '"event":"mi9x1k2a-42"'}
    )
    building.write((NOON, "alarm", "east-wing", "", "another"), data={"event": "mi9x1k2a-421"})
    building.write((NOON, "alarm", "east-wing", "", "from before such ids"))
    assert numbers(building.audit("--event", "mi9x1k2a-42")) == [1]
    assert building.audit("--event", "mi9x1k2a-42").rstrip().endswith("the door is blocked  [mi9x1k2a-42]")
    assert building.audit("--event", "mi9x1k2a-4") == ""
    (line,) = building.audit("--event", "mi9x1k2a-42", "--jsonl", "-").splitlines()
    assert json.loads(line)["data"] == {"event": "mi9x1k2a-42", "n": 1}
    assert "[" not in building.audit("--find", "from before")
    assert "holds" in building.audit("--verify")


def test_a_wide_terminal_has_a_column_of_events(building: Building) -> None:
    building.write((NOON, "alarm", "east-wing", "", "the door is blocked"), data={"event": "mi9x1k2a-42"})
    building.end()
    with open_journal(building.journal) as reader:
        rows = list(reader.rows())
    for width, there in ((140, True), (139, False)):
        console = Console(file=io.StringIO(), force_terminal=True, width=width, color_system=None)
        RowTable(console, ZoneInfo("UTC"), rows, ()).show(rows)
        assert isinstance(console.file, io.StringIO)
        assert ("mi9x1k2a-42" in console.file.getvalue()) is there
