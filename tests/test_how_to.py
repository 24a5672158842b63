"""The commands of the how-to pages and of the journal's page, run in the order in which a reader types them."""

import json
import re
import shlex
import subprocess
from pathlib import Path

import pytest
import yaml

from lift_manager.commissioning.checkout.record import record_path, save
from lift_manager.lab.bench import LiftSite
from lift_manager.store.place import store_path
from tests.lift_manager.commissioning.checkout.records import FAT, SAT
from tests.support.pages import blocks, commands
from tests.support.programs import HANGS_S, ROOT, Started, call, eventually, free_port, run

HOW_TO = ROOT / "docs" / "how-to"
TUTORIAL = ROOT / "register_maps" / "TUTORIAL.md"


def words(line: str) -> list[str]:
    """Return what a command of the program has after its name, without comment and redirection."""
    program, *rest = shlex.split(re.split(r" +#| > ", line)[0])
    assert program == "lift-manager"
    return rest


def done(line: str, *more: str) -> str:
    ended: subprocess.CompletedProcess[str] = call(*words(line), *more)
    assert ended.returncode == 0, line + ended.stdout + ended.stderr
    return ended.stdout + ended.stderr


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a reader types: `site.yaml` with the lift `east`, and a map of one's own."""
    site = yaml.safe_load((ROOT / "examples" / "first-site.yaml").read_text("utf-8"))
    site |= {"state": "kept", "lifts": {"east": site["lifts"]["main"]}}
    site["controllers"]["plc"]["port"] = free_port()
    site["api"] = {"port": free_port()}
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(site), "utf-8")
    (map_of_tutorial,) = blocks(TUTORIAL, "yaml")
    (tmp_path / "my-lift.yaml").write_text(map_of_tutorial.replace("name: acme-lc3", "name: my-lift"), "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("folder")
def test_keys_are_made_listed_and_revoked() -> None:
    *make, list_keys, revoke = commands(HOW_TO / "keys-and-tls.md", "lift-manager keys ")
    assert [re.findall("--role (.*?) ", f"{line} ")[0] for line in make] == ["operator", "robot", "rmf", "viewer"]
    assert all("lm_" in done(line) for line in make)
    assert all(name in done(list_keys) for name in ("desk", "amr-1", "adapter", "hall"))
    done(revoke)
    assert "amr-1" not in done(list_keys) or "revoked" in done(list_keys)


@pytest.mark.external("curl")
def test_a_simulated_lift_is_worked_through_its_panel() -> None:
    simulate, *curls = commands(HOW_TO / "the-panel.md")
    with Started() as start:
        program = start(*words(simulate), "--port", "0", "--panel", "0")
        panel = program.says(r"make faults: http://(\S+)/")[1]
        replies = []
        for line in curls:
            command = shlex.split(line.replace("127.0.0.1:5004", panel))
            done = subprocess.run(command, capture_output=True, timeout=HANGS_S, check=True)
            replies.append(json.loads(done.stdout))
    pressed, held, slow, fast, reset, last = replies
    assert pressed["car"]["floor"] == "L1"
    assert (held["inputs"]["obstruction"], held["inputs"]["key"]) == (["front"], "independent")
    assert [fault["name"] for fault in slow["faults"]] == ["delay"]
    assert fast["faults"] == reset["faults"] == []
    assert last["inputs"] == pressed["inputs"]


@pytest.mark.lift("main")
def test_an_operator_locks_out_drains_releases_and_acknowledges(lift_site: LiftSite) -> None:
    here = ("--manager", lift_site.address)
    lock, unlock, drain, undrain, release, acknowledge = commands(HOW_TO / "people-first.md")
    done(lock, *here)
    assert lift_site.state().restrictions.lockout
    done(unlock, *here)
    assert not lift_site.state().restrictions.lockout
    done(drain, *here)
    assert lift_site.state().restrictions.drain
    done(undrain, *here)
    lift_site.request("L2", by="robot 2")
    lift_site.wait_for(lambda state: state.robot_door == "open", within_s=60)
    done(release, *here)
    lift_site.wait_for(lambda state: state.holder is None, within_s=60)
    done(acknowledge, *here)
    lift_site.wait_for(lambda state: state.restrictions.maybe_aboard is None, within_s=60)


def test_a_site_file_is_written_and_its_controller_examined(folder: Path) -> None:
    init, *doctor = commands(HOW_TO / "doctor.md")
    with Started() as start:
        simulated = start("simulate", "generic-registers", "--port", "0")
        address = simulated.says(r"(127\.0\.0\.1:\d+), unit 1")[1]
        assert "car at G" in done(init.replace("127.0.0.1:5020", address))
        for line in doctor:
            # 1 is what a busy computer comes to: slow answers
            ended = call(*words(line), "--seconds", "1")
            assert ended.returncode in (0, 1), line + ended.stdout + ended.stderr
            if " > " in line:
                (folder / line.rpartition(" > ")[2]).write_text(ended.stdout, "utf-8")


def test_a_site_and_a_map_are_checked_shown_and_handed_to_the_lift_company(folder: Path) -> None:
    for line in commands(HOW_TO / "commissioning.md"):
        assert done(line) or "-o" in line, line
    assert {"io.xlsx", "block.st", "block-wiring.md"} <= {path.name for path in folder.iterdir()}


def test_the_commands_of_a_lift_are_listed_shown_and_tried(folder: Path) -> None:
    site = yaml.safe_load((folder / "site.yaml").read_text("utf-8"))
    site["lifts"]["east"] |= {"floors": {"L1": 1, "L2": 2}}
    (folder / "site.yaml").write_text(yaml.safe_dump(site), "utf-8")
    controller = site["controllers"]["plc"]
    list_commands, dry_run, *trials, unlock = commands(HOW_TO / "try-a-command.md")
    assert "--unlock" in unlock  # test_poke.py unlocks a draft map
    with Started() as start:
        port = str(controller["port"])
        start("simulate", controller["map"], "--port", port, "--speed", "10").says(port)
        assert "hold_door.front" in done(list_commands)
        assert "dry run: nothing was sent (--dry-run)" in done(dry_run)
        for line in trials:
            tried = run(*words(line), "--yes", "--for", "0", cwd=folder)
            assert tried.returncode == 0, tried
            assert "verified: " in tried.stdout


def test_an_acceptance_test_is_reported_in_every_form_and_against_the_factory(folder: Path) -> None:
    store = store_path("My first site", "kept", folder / "site.yaml", {})
    for record in (FAT, SAT):
        save(record_path(store, "east", record.stage), record.model_copy(update={"lift": "east"}))
    save(folder / "fat-record.json", FAT)
    for line in commands(HOW_TO / "checkout-report.md"):
        assert "record sha256" in done(line)
    assert {"report.html", "report.csv", "fat.json", "both.html"} <= {path.name for path in folder.iterdir()}


def test_the_journal_is_read_exported_and_verified(folder: Path) -> None:
    with Started() as start:
        start("serve", "site.yaml", cwd=folder).says("/docs")
    (store,) = (folder / "kept").glob("*.db")
    for file in (folder / "kept").glob("*.db*"):
        (folder / file.name.replace(store.stem, "copy")).write_bytes(file.read_bytes())
    lines = commands(ROOT / "docs" / "reference" / "journal.md")
    follow = [line for line in lines if "--follow" in line]
    assert len(follow) == 1  # test_audit.py follows: it ends with Ctrl-C only
    for line in lines:
        if line not in follow:
            done(line)
    assert "manager" in (folder / "rows.csv").read_text("utf-8")


def test_a_controller_is_watched_and_traced_through_its_manager_and_without_one(folder: Path) -> None:
    site = yaml.safe_load((folder / "site.yaml").read_text("utf-8"))
    site["lifts"] = {"main": site["lifts"]["east"]}
    (folder / "site.yaml").write_text(yaml.safe_dump(site), "utf-8")
    port, here = site["controllers"]["plc"]["port"], ("--manager", f"127.0.0.1:{site['api']['port']}")
    watch, watch_alone, changed, chosen, once, *traces = commands(HOW_TO / "watch-and-trace.md")
    record, record_alone, *shows, replay = traces
    with Started() as start:
        start("simulate", "generic-registers", "--port", str(port)).says(str(port))
        with Started() as start_manager:
            start_manager("serve", "site.yaml", cwd=folder).says("/docs")
            for line in (watch, chosen):
                start_manager(*words(line), *here, cwd=folder).says("car_floor")
            start_manager(*words(changed), *here, cwd=folder)
            eventually((folder / "changes.csv").exists)
            assert "car_floor" in done(once, *here)
            done(record, *here, "--for", "1")
        start(*words(watch_alone), cwd=folder).says("car_floor")
    with Started() as start:
        start("simulate", "generic-registers", "--port", str(port)).says(str(port))
        done(record_alone, "--for", "1")
    for line in shows:
        assert done(line) or "--errors" in line or "--writes" in line, line
    with Started() as start:
        start(*words(replay), "--port", "0", cwd=folder).says("the last answers")


def test_an_archive_for_support_is_made(folder: Path) -> None:
    (line,) = commands(ROOT / "docs" / "reference" / "commands.md")
    (folder / "trace.jsonl").write_text("", "utf-8")
    assert "support.zip" in done(line)
    assert (folder / "support.zip").stat().st_size > 0
