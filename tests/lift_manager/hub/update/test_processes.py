"""The how-to of configuration updates, command by command, with real programs: hub, leaf node, manager and a simulated controller."""

import json
import shlex
import shutil
from pathlib import Path
from typing import Any

import yaml

from tests.lift_manager.hub.rig import NATS_SERVER
from tests.support.pages import blocks, commands, not_run
from tests.support.programs import ROOT, Started, eventually, free_port, run, started

PAGE = ROOT / "docs" / "how-to" / "update-sites.md"
RESTART = 75


def words(line: str) -> list[str]:
    program, *rest = shlex.split(line)
    assert program == "lift-manager"
    return rest


def done(line: str, cwd: Path, code: int = 0) -> str:
    ended = run(*words(line), cwd=cwd)
    assert ended.returncode == code, line + ended.stdout + ended.stderr
    return ended.stdout + ended.stderr


def prepare(folder: Path) -> dict[str, Any]:
    """Make a hub with a site, carry over what the site needs, and return its site file with the lines of the page."""
    ports = {name: free_port() for name in ("leaf_port", "client_port", "site_port")}
    (folder / "hub").mkdir(mode=0o700)
    settings = {"http": {"port": free_port()}, "nats": {**ports, "program": NATS_SERVER}}
    (folder / "hub" / "hub.yaml").write_text(yaml.safe_dump(settings))
    done("lift-manager hub site add berlin", folder)
    shutil.move(folder / "hub" / "sites" / "berlin", folder / "berlin")
    (own,) = (yaml.safe_load(block) for block in blocks(PAGE, "yaml"))
    assert own["hub"]["site"] == "berlin"
    own["hub"] |= {
        "server": f"nats://127.0.0.1:{ports['site_port']}",
        "password": str(folder / "berlin" / Path(own["hub"]["password"]).name),
        "updates": [str(folder / Path(file).name) for file in own["hub"]["updates"]],
    }
    return {
        "schema": 1,
        "name": "Berlin",
        "api": {"port": free_port()},
        "controllers": {"plc": {"host": "127.0.0.1", "port": free_port(), "map": "generic-registers"}},
        "lifts": {"goods": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}}},
        **own,
    }


def test_the_how_to_makes_a_key_rolls_out_an_update_and_goes_back(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    key, adopt, serve, make, offer, status, stop, back = (line for line in commands(PAGE) if line not in not_run(PAGE))
    site = prepare(tmp_path)
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(site, sort_keys=False))
    (tmp_path / "drafts" / "berlin").mkdir(parents=True)
    site["lifts"]["goods"]["floors"] = {"L1": 1, "Hall": 2}
    (tmp_path / "drafts" / "berlin" / "site.yaml").write_text(yaml.safe_dump(site, sort_keys=False))
    assert "office.pub: the public key" in done(key, tmp_path)
    assert "serve" in done(adopt, tmp_path)
    assert "berlin.update: update 1, " in done(make, tmp_path)
    assert "update 1: 1 site, berlin first" in done(offer, tmp_path)
    with Started() as start:
        hub = start("hub", cwd=tmp_path)
        start.callback(hub.stop)  # a hub that is killed leaves its NATS server running
        hub.says("hub: 1 site")
        start(
            "simulate", "generic-registers", "--port", str(site["controllers"]["plc"]["port"]), "--floors", "L1=1,L2=2"
        )
        start.enter_context(started(NATS_SERVER, "-c", "leaf.conf", cwd=tmp_path / "berlin"))
        manager = start(*words(serve), cwd=tmp_path)
        assert manager.ended() == RESTART, manager.err
        second = start(*words(serve), cwd=tmp_path)
        second.logs("configuration update 1, made by M. Weber and signed with office.pub")
        second.logs("goods: is only watched, whatever the site file says, because update 1 changes its floors")
        eventually(lambda: "berlin: on trial, runs by 1" in done(status, tmp_path))
        assert "offered to no further site" in done(stop, tmp_path)
        assert "a manager runs with" in done(back, tmp_path, code=1)
        assert second.stop()[0] == 0
        assert "the configuration before update 1 is in its place" in done(back, tmp_path)
        third = start(*words(serve), cwd=tmp_path)
        third.logs("configuration update 1 is rolled back.*Anna Berg has decided it")
        assert "only watched" not in third.err
        eventually(lambda: "berlin: rolled back, runs by its first configuration" in done(status, tmp_path))
        assert third.stop()[0] == 0
    rows = done("lift-manager audit updates/current/site.yaml --kind manager --jsonl -", tmp_path)
    texts = [json.loads(row)["text"] for row in rows.splitlines()]
    steps = ("is checked", "is applied", "is rolled back")
    assert [next(step for step in steps if step in text) for text in texts if "configuration update" in text] == [
        *steps
    ]


def test_an_update_with_which_the_manager_cannot_start_is_rolled_back_at_once(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    key, adopt, serve, *_ = commands(PAGE)
    site = prepare(tmp_path)
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(site, sort_keys=False))
    done(key, tmp_path)
    done(adopt, tmp_path)
    place = tmp_path / "updates"
    shutil.copytree(place / "0", place / "1")
    (place / "1" / "site.yaml").write_text("half of a fi")
    installed = json.loads((place / "installed.json").read_text())
    trial = {"current": {"number": 1}, "before": {"number": 0}, "on_trial": True, "highest": 1, "rollout": "r1"}
    (place / "installed.json").write_text(json.dumps(installed | trial))
    ended = run(*words(serve), cwd=tmp_path)
    assert ended.returncode == RESTART, ended.stderr
    assert "update 1 cannot be started, and is rolled back" in ended.stderr
    with Started() as start:
        manager = start(*words(serve), cwd=tmp_path)
        manager.logs("configuration update 1 is rolled back, and the configuration before all updates is in its place")
        assert manager.stop()[0] == 0
