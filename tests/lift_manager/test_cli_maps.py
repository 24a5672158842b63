"""`lift-manager maps`: every shipped map through every command, exit codes, files that are written and files that are not."""

import csv
import io
import json
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

import pytest
from openpyxl import load_workbook
from typer.testing import CliRunner

from lift_manager.cli.main import app
from register_maps.load import MAPS, shipped
from tests.support.programs import run
from tests.support.rows import each_row

each_map = each_row("name", shipped())

SITE = """\
schema: 1
name: A building
controllers:
  plc: {host: 192.0.2.10, map: generic-registers}
lifts:
  main: {controller: plc, floors: {G: 1, First: 2}}
"""

BAD_MAP = """\
schema: 1
name: bad
title: Three mistakes
provenance: {trust: template, sources: [this test]}
addressing: {base: 0}
served: {coil: [[0, 9]]}
signals:
  overload: {at: "coil:50"}
  fir: {at: "coil:1"}
commands:
  hold_door.front: {at: "coil:2", action: hold}
at_floor_evidence: {kind: position_stable, for_s: 1.0}
not_visible: {fire: nothing burns in a test}
"""


@dataclass(frozen=True)
class Done:
    code: int
    out: str
    err: str


def call(*words: str | Path) -> Done:
    """The whole command line in this process; an exception that is not an exit is a failure."""
    result = CliRunner().invoke(app, ["maps", *map(str, words)], env={"COLUMNS": "100", "TERM": "dumb"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return Done(result.exit_code, result.stdout, result.stderr)


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """The working directory, with a site file and a map of three mistakes."""
    (tmp_path / "site.yaml").write_text(SITE)
    (tmp_path / "bad.yaml").write_text(BAD_MAP)
    with chdir(tmp_path):
        yield tmp_path


def test_maps_alone_lists_them_as_maps_list_does() -> None:
    done = call("list")
    assert (done.code, done.err) == (0, "")
    assert call() == done
    for name in shipped():
        assert f"{name}  [" in done.out


def test_the_list_as_json_is_for_other_programs() -> None:
    done = call("list", "--json")
    assert call("--json") == done
    data = json.loads(done.out)
    assert [entry["name"] for entry in data] == list(shipped())
    agv = next(entry for entry in data if entry["name"] == "two-stop-agv")
    assert agv["fire"].startswith("NOT VISIBLE: ")


@each_map
def test_every_map_is_shown(name: str) -> None:
    done = call("show", name)
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith(f"{name}  [")
    assert "LINK AND LIMITS" in done.out


@each_map
def test_every_map_is_shown_as_json(name: str) -> None:
    done = call("show", name, "--json")
    assert done.code == 0
    data = json.loads(done.out)
    assert data["name"] == name
    for entry in (*data["signals"], *data["commands"]):
        for place in entry["places"]:
            assert place["printed"]
            assert 0 <= place["address"] <= 65535
            assert place["table"] in ("coil", "discrete", "holding", "input")


@each_map
def test_every_map_is_checked_without_a_mistake(name: str) -> None:
    done = call("check", name)
    assert (done.code, done.err) == (0, "")
    assert done.out.splitlines()[-1].endswith(": no mistakes")
    assert f"map {name} (" in done.out


@each_map
def test_every_map_is_planned(name: str) -> None:
    done = call("plan", name)
    assert (done.code, done.err) == (0, "")
    assert "One poll: " in done.out
    assert done.out.splitlines()[-1].startswith("Bytes as they stand in a packet")
    frames = [line.strip() for line in done.out.splitlines() if line.startswith(" " * 14 + "00 00 00 ")]
    assert frames
    for frame in frames:
        body = bytes.fromhex(frame)
        assert int.from_bytes(body[2:4], "big") == len(body) - 4


def test_a_map_file_is_taken_by_its_path_wherever_a_name_is() -> None:
    path = MAPS / "two-stop-agv.yaml"
    assert call("show", path) == call("show", "two-stop-agv")
    assert call("plan", path) == call("plan", "two-stop-agv")
    assert call("check", path) == call("check", "two-stop-agv")


def test_check_finds_every_mistake_at_once_and_exits_with_2(folder: Path) -> None:
    done = call("check", "bad.yaml")
    assert (done.code, done.out) == (2, "")
    lines = done.err.splitlines()
    assert lines[-1] == "3 mistakes"
    assert lines[0].startswith("bad.yaml:8: signals.overload.at: ")
    assert lines[1].startswith("bad.yaml:9: signals.fir: ")
    assert "did you mean" in lines[1]
    assert lines[2].startswith("bad.yaml:11: commands.hold_door.front: a hold needs `max_hold_s`")


def test_check_says_what_a_site_has_to_add_and_to_set() -> None:
    assert "a site must add: car_floor: the module has outputs only" in call("check", "adam-pushbutton").out
    (line, *_) = call("check", "seer-siemens-chengdu-block").out.splitlines()
    assert line.startswith("every site must set: first: address on the wire of the first of the eight registers")
    assert line.endswith("; taken here as 1, its example")


def test_check_of_a_site_file_names_the_command_for_it(folder: Path) -> None:
    done = call("check", "site.yaml")
    assert (done.code, done.out) == (2, "")
    assert done.err.splitlines() == [
        "site.yaml: this is a site file and not a map; check it with `lift-manager check`",
        "1 mistake",
    ]


@each_row("command", [("show",), ("check",), ("plan",), ("plc", "-o", "x.st")])
def test_a_map_that_is_not_there_is_named_with_the_nearest_one(folder: Path, command: tuple[str, ...]) -> None:
    done = call(*command, "two-stop-agw")
    assert (done.code, done.out) == (2, "")
    assert "no map has this name; did you mean `two-stop-agv`?" in done.err
    assert not (folder / "x.st").exists()


def test_plan_takes_the_floors_of_a_site() -> None:
    done = call("plan", "generic-registers", "--floors", "B1=-1,L1=1")
    assert done.code == 0
    assert "go_to B1 (code -1)" in done.out
    assert "00 00 00 06 01 06 00 10 FF FF" in done.out


def test_plan_says_which_parameters_are_examples() -> None:
    assert call("plan", "seer-siemens-chengdu-block").out.startswith("every site must set: first: ")


def test_plan_refuses_a_floor_that_the_map_cannot_express() -> None:
    done = call("plan", "generic-registers", "--floors", "L0=0,L1=1")
    assert (done.code, done.out) == (1, "")
    assert done.err.startswith("generic-registers: go_to rests at 0")


def test_plan_refuses_floors_that_cannot_be_read() -> None:
    done = call("plan", "generic-registers", "--floors", "L1")
    assert done.code == 2
    assert "NAME=CODE" in done.err


def test_the_io_list_is_written_in_each_of_its_forms(folder: Path) -> None:
    for ending in ("xlsx", "csv", "html", "XLSX"):
        done = call("iolist", "site.yaml", "-o", f"io-{ending}.{ending}")
        assert (done.code, done.err) == (0, "")
        assert done.out == f"io-{ending}.{ending}: 16 points of 1 lift\n"
    assert load_workbook(folder / "io-xlsx.xlsx").sheetnames == ["Cover", "main"]
    rows = list(csv.reader(io.StringIO((folder / "io-csv.csv").read_text("utf-8-sig"), newline="")))
    assert len(rows) == 17
    assert (folder / "io-html.html").read_text("utf-8").startswith("<!DOCTYPE html>")


def test_a_file_that_is_there_is_replaced_only_when_that_is_said(folder: Path) -> None:
    (folder / "io.csv").write_text("mine")
    done = call("iolist", "site.yaml", "-o", "io.csv")
    assert (done.code, done.out) == (1, "")
    assert done.err == "io.csv: there already; give another name, or --force to replace it\n"
    assert (folder / "io.csv").read_text() == "mine"
    assert call("iolist", "site.yaml", "-o", "io.csv", "--force").code == 0
    assert "car_floor" in (folder / "io.csv").read_text("utf-8-sig")


@each_row("name", ["io.pdf", "io", "io.xls", ".csv"])
def test_an_ending_that_cannot_be_written_is_refused_with_those_that_can(folder: Path, name: str) -> None:
    done = call("iolist", "site.yaml", "-o", name)
    assert (done.code, done.out) == (1, "")
    assert done.err == (f"{name}: the ending says what to write; give the file the ending .xlsx or .csv or .html\n")
    assert not (folder / name).exists()


def test_a_folder_that_is_not_there_is_said_in_one_sentence(folder: Path) -> None:
    done = call("iolist", "site.yaml", "-o", "nowhere/io.csv")
    assert (done.code, done.out) == (1, "")
    assert done.err.splitlines() == ["nowhere/io.csv: cannot be written: No such file or directory"]


def test_a_site_with_a_mistake_gets_no_io_list(folder: Path) -> None:
    (folder / "site.yaml").write_text(SITE.replace("First: 2", "First: 1"))
    done = call("iolist", "site.yaml", "-o", "io.csv")
    assert (done.code, done.out) == (2, "")
    assert "code 1 is floor G already" in done.err
    assert not (folder / "io.csv").exists()


@pytest.mark.parametrize("name", ["generic-coils", "generic-registers"])
def test_a_plc_program_is_written_with_its_wiring_beside_it(folder: Path, name: str) -> None:
    done = call("plc", name, "-o", "block.st", "--floors", "L1=1,L2=2")
    assert (done.code, done.err) == (0, "")
    assert done.out.splitlines() == [
        "block.st: the program",
        "block-wiring.md: its wiring, and what to try before the first robot",
    ]
    assert "END_FUNCTION_BLOCK" in (folder / "block.st").read_text("ascii")
    assert (folder / "block-wiring.md").read_text("utf-8").startswith(f"# Wiring sheet: {name}")


def test_a_plc_program_without_floors_says_that_they_are_examples(folder: Path) -> None:
    done = call("plc", "generic-registers", "-o", "block.st")
    assert done.code == 0
    assert done.out.splitlines()[-1] == "The floors are examples; give the real ones with --floors."


def test_neither_the_program_nor_its_wiring_replaces_a_file(folder: Path) -> None:
    (folder / "block-wiring.md").write_text("mine")
    done = call("plc", "generic-registers", "-o", "block.st")
    assert (done.code, done.out) == (1, "")
    assert "block-wiring.md: there already" in done.err
    assert not (folder / "block.st").exists()
    assert call("plc", "generic-registers", "-o", "block.st", "--force").code == 0
    assert (folder / "block-wiring.md").read_text("utf-8").startswith("# Wiring sheet")


def test_a_map_of_somebody_else_s_program_gets_none(folder: Path) -> None:
    done = call("plc", "two-stop-agv", "-o", "block.st")
    assert (done.code, done.out) == (1, "")
    assert "only for the maps whose name starts with generic-" in done.err
    assert list(folder.glob("block*")) == []


def test_a_program_with_another_ending_is_refused(folder: Path) -> None:
    done = call("plc", "generic-registers", "-o", "block.txt")
    assert (done.code, done.err) == (
        1,
        "block.txt: the ending says what to write; give the file the ending .st\n",
    )


HELP = {
    "": ["list", "show", "check", "plan", "iolist", "plc", "--json"],
    "list": ["shipped maps", "--json"],
    "show": ["MAP", "--json", "on the wire"],
    "check": ["FILE|MAP", "Exits 2"],
    "plan": ["MAP", "--floors", "bytes", "Nothing is sent"],
    "iolist": ["SITE", "--output", "-o", "--force", ".xlsx, .csv or .html"],
    "plc": ["MAP", "--output", "-o", "--floors", "--force", "Structured Text"],
}


@each_row("command", HELP)
def test_help_names_every_option_and_says_what_the_command_is_for(command: str) -> None:
    done = call(*filter(None, [command]), "--help")
    assert (done.code, done.err) == (0, "")
    text = " ".join(done.out.replace("│", " ").split())
    for word in HELP[command]:
        assert word in text


def test_a_file_has_to_be_named_for_what_is_written(folder: Path) -> None:
    done = call("iolist", "site.yaml")
    assert done.code == 2
    assert "--output" in done.err


def test_the_program_itself_lists_maps_and_checks_one() -> None:
    done = run("maps")
    assert (done.returncode, done.stderr) == (0, "")
    assert "generic-registers  [template]" in done.stdout
    done = run("maps", "check", "generic-registers")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1].endswith("map generic-registers (template): no mistakes")
