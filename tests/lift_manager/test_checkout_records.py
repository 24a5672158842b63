"""Records of acceptance tests at the command line: the report of one, and what a running manager makes of it."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from lift_manager.cli.serve_checks import with_checkouts
from lift_manager.commissioning.checkout.plan import lift_digest
from lift_manager.commissioning.checkout.record import MapIdentity, Outcome, Record, Stage, load, record_path, save
from lift_manager.config.load import load_site
from lift_manager.store.place import store_path
from tests.lift_manager.commissioning.checkout.records import FAT, SAT, UNSIGNED, result, signed
from tests.lift_manager.test_operate import LIFT, Site
from tests.support.programs import HANGS_S, Started, call, free_port, run
from tests.support.rows import each_row

SITE = """\
schema: 1
name: Main hospital
state: kept
controllers:
  plc: {host: 192.0.2.10, map: generic-registers}
lifts:
  bed-lift:
    controller: plc
    floors: {B1: -1, L1: 1, L2: 2, L3: 3}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a site file and the records of a test in the factory and one at the lift."""
    (tmp_path / "site.yaml").write_text(SITE, "utf-8")
    store = store_path("Main hospital", "kept", tmp_path / "site.yaml", {})
    for record in (FAT, SAT):
        save(record_path(store, record.lift, record.stage), record)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def report(*words: str | Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    done = call("checkout-report", *words, COLUMNS="400")
    assert done.returncode == code, done
    assert "Traceback" not in done.stderr
    return done


def test_the_report_of_the_test_at_the_lift_shows_what_differs_from_the_factory(folder: Path) -> None:
    done = report("site.yaml", "bed-lift", "-o", "report.html")
    assert done.stdout.splitlines() == [
        f"report.html: bed-lift, sat, passed under conditions; record sha256 {SAT.sha256[:16]}",
        "compared with the fat of 2026-11-02 08:00: 4 of 18 items differ",
    ]
    assert (
        done.stderr
        == "photo photos/fire-panel.png is not in the report: it cannot be read (No such file or directory)\n"
    )
    assert "Difference FAT → SAT" in (folder / "report.html").read_text("utf-8")


def test_a_report_is_written_from_the_file_of_a_record_against_another_one(folder: Path) -> None:
    sat, fat = (next((folder / "kept").glob(f"*.{stage}.json")) for stage in (Stage.SAT, Stage.FAT))
    report(sat, "-o", "sat.json")
    assert json.loads((folder / "sat.json").read_text("utf-8"))["difference"]["before"]["stage"] == "fat"
    assert report(fat, "-o", "fat.csv").stdout.splitlines()[1:] == []
    report(fat, "-o", "other.json", "--against", sat)
    assert json.loads((folder / "other.json").read_text("utf-8"))["difference"]["before"]["stage"] == "sat"
    assert report("site.yaml", "bed-lift", "-o", "f.csv", "--stage", "fat").stdout.startswith("f.csv: bed-lift, fat, ")


def test_a_file_that_is_there_is_replaced_only_if_that_is_asked_for(folder: Path) -> None:
    report("site.yaml", "bed-lift", "-o", "report.csv")
    assert "report.csv: there already" in report("site.yaml", "bed-lift", "-o", "report.csv", code=1).stderr
    report("site.yaml", "bed-lift", "-o", "report.csv", "--force")


@each_row(
    ("words", "code", "problem"),
    [
        ("site.yaml cellar -o r.html", 1, "site.yaml has no lift cellar; it has bed-lift"),
        ("site.yaml bed-lift -o r.html --stage proof", 1, "there is no record "),
        ("none.json -o r.html", 1, "there is no record none.json"),
        ("site.yaml -o r.html", 1, "site.yaml is no record of a checkout"),
        ("site.yaml bed-lift -o r.pdf", 1, "give the file the ending .html or .json or .csv"),
        ("none.yaml bed-lift -o r.html", 2, "none.yaml: there is no such file"),
        ("site.yaml bed-lift", 2, "--output"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_what_cannot_be_reported_is_said_in_one_sentence(words: str, code: int, problem: str) -> None:
    assert problem in report(*words.split(), code=code).stderr


def test_a_test_that_goes_on_has_the_address_at_which_the_controller_is_now(folder: Path) -> None:
    site = folder / "site.yaml"
    site.write_text(SITE.replace("host: 192.0.2.10", f"host: 127.0.0.1, port: {free_port()}"), "utf-8")
    done = run("checkout", str(site), "bed-lift", "--by", "Ana Keller")
    assert done.returncode == 1  # nothing answers there
    loaded = load_site(site)
    after = load(record_path(store_path("Main hospital", "kept", site, {}), "bed-lift", Stage.SAT))
    assert after is not None
    assert (after.controller.host, after.controller.port) == ("127.0.0.1", loaded.site.controllers["plc"].port)
    assert (after.controller.identity, after.controller.fingerprint) == (
        SAT.controller.identity,
        SAT.controller.fingerprint,
    )


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with Started() as programs:
        yield Site(programs, tmp_path)


def passed(site: Site) -> Record:
    """Return the record of a test that the lift of a site has passed."""
    loaded = load_site(site.file)
    plc = loaded.site.controllers["plc"]
    base = UNSIGNED.model_copy(
        update={
            "site": loaded.site.name,
            "lift": LIFT,
            "map": MapIdentity(name="x", sha256=loaded.maps[LIFT].sha256, lift_sha256=lift_digest(loaded, LIFT)),
            "controller": UNSIGNED.controller.model_copy(update={"host": plc.host, "port": plc.port}),
            "items": UNSIGNED.items[:1],
            "results": (result("S-01", Outcome.PASSED, 3),),
            "punch_list": (),
        }
    )
    return signed(base)


def test_a_running_manager_names_the_record_that_lets_robots_use_its_lift(site: Site) -> None:
    def known() -> object:
        return httpx.get(f"{site.url}/api/v1/lifts/{LIFT}/capabilities", trust_env=False, timeout=HANGS_S).json()[
            "checkout"
        ]

    assert known() is None
    assert f"{LIFT}: robots may use it, and there is no checkout record of it in {site.kept}" in site.manager.err
    record, loaded = passed(site), load_site(site.file)
    store = store_path(loaded.site.name, loaded.site.state, site.file, {})
    save(record_path(store, LIFT, Stage.SAT), record)
    assert list(with_checkouts(loaded).checkouts) == [LIFT]
    site.restart()
    assert "checkout record" not in site.manager.err
    assert known() == {"sha256": record.sha256, "ended_at": "2026-11-23T10:02:00Z"}
    rows = call("audit", site.file, "--kind", "manager", "--jsonl", "-").stdout.splitlines()
    starts = [row["data"]["lifts"][LIFT] for row in map(json.loads, rows) if "lifts" in row["data"]]
    assert [start.get("checkout") for start in starts] == [
        None,
        {"sha256": record.sha256, "ended_at": "2026-11-23T10:02:00+00:00"},
    ]
