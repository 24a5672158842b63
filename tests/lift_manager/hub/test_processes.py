"""The how-to of the hub, command by command, with real programs: hub, leaf node, manager and a simulated controller."""

import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import httpx
import yaml

from tests.lift_manager.hub.rig import NATS_SERVER
from tests.support.pages import blocks, commands
from tests.support.programs import HANGS_S, ROOT, Started, eventually, free_port, run, started

PAGE = ROOT / "docs" / "how-to" / "hub.md"


def words(line: str) -> list[str]:
    program, *rest = shlex.split(line)
    assert program == "lift-manager"
    return rest


def done(line: str, *more: str, cwd: Path) -> str:
    ended = run(*words(line), *more, cwd=cwd)
    assert ended.returncode == 0, line + ended.stdout + ended.stderr
    return ended.stdout + ended.stderr


def fetched(line: str, port: int) -> httpx.Response:
    """Request what a line with curl requests."""
    curl, url = shlex.split(line)
    assert curl == "curl"
    return httpx.get(url.replace(":5080", f":{port}"), trust_env=False, timeout=HANGS_S)


def prepare(folder: Path) -> tuple[int, int]:
    """Write the site file, with the lines of the page, and the ports; return those of the hub and the controller."""
    ports = {name: free_port() for name in ("leaf_port", "client_port", "site_port")}
    hub_port, plc_port = free_port(), free_port()
    (folder / "hub").mkdir(mode=0o700)
    settings = {"http": {"port": hub_port}, "nats": {**ports, "program": NATS_SERVER}}
    (folder / "hub" / "hub.yaml").write_text(yaml.safe_dump(settings))
    (own,) = (yaml.safe_load(block) for block in blocks(PAGE, "yaml"))
    own["hub"] |= {"server": f"nats://127.0.0.1:{ports['site_port']}", "commands": True}
    site = {
        "schema": 1,
        "name": "Berlin",
        "state": "kept",
        "api": {"port": free_port()},
        "controllers": {"plc": {"host": "127.0.0.1", "port": plc_port, "map": "generic-registers"}},
        "lifts": {"goods": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}}},
    }
    (folder / "site.yaml").write_text(yaml.safe_dump(site | own))
    return hub_port, plc_port


def command_lift(lines: list[str], url: str, cwd: Path) -> None:
    open_session, go, close = lines

    def sent(line: str, **replaced: str) -> Any:
        for name, value in replaced.items():
            line = line.replace(name, value)
        return json.loads(done(line, "--hub", url, cwd=cwd))

    session = sent(open_session)["session"]
    assert session["holder"] == "hub:night"
    assert sent(open_session)["session"]["id"] == session["id"]
    first = sent(go, SESSION=session["id"])["command"]
    eventually(lambda: sent(go, SESSION=session["id"])["command"]["status"] == "confirmed")
    assert sent(go, SESSION=session["id"])["command"]["id"] == first["id"]
    assert sent(close, SESSION=session["id"])["session"]["over"]["reason"] == "released"
    words_of_people = ("hub", "send", "berlin", "goods", '{"what": "acknowledge"}', "--key-file", "site.key")
    acknowledged = run(*words_of_people, "--hub", url, cwd=cwd)
    assert (acknowledged.returncode, "(malformed)" in acknowledged.stderr) == (1, True)


def send_robot(lines: list[str], url: str, cwd: Path) -> None:
    begin, cancel = lines
    ride = json.loads(done(begin, "--hub", url, cwd=cwd))["ride"]
    assert (ride["caller"], ride["phase"], ride["robot"]) == ("ride:night/amr-7", "queued", "amr-7")
    assert json.loads(done(begin, "--hub", url, cwd=cwd))["ride"]["id"] == ride["id"]

    def phase() -> str:
        shown = httpx.get(f"{url}/api/v1/sites/berlin/rides/{ride['id']}", trust_env=False, timeout=HANGS_S).json()[
            "ride"
        ]
        assert not {"guidance", "reason"} & set(shown)
        return str(shown["phase"])

    assert phase() == "queued"
    manager = f"http://127.0.0.1:{yaml.safe_load((cwd / 'site.yaml').read_text())['api']['port']}"
    key = {"Authorization": f"Bearer {(cwd / 'site.key').read_text().strip()}"}
    report = httpx.post(f"{manager}/api/v1/rides/{ride['id']}/here", headers=key, trust_env=False, timeout=HANGS_S)
    assert report.status_code == 200, report.text
    eventually(lambda: phase() in ("called", "boarding"))
    done(cancel.replace("RIDE", ride["id"]), "--hub", url, cwd=cwd)
    eventually(lambda: phase() in ("cancelled", "clearing"))
    no_lift = run("hub", "send", "berlin", '{"what": "close", "session": "x"}', "--key-file", "site.key", cwd=cwd)
    assert (no_lift.returncode, "name the lift before the action" in no_lift.stderr) == (1, True)


def use_keys(lines: list[str], url: str, cwd: Path) -> None:
    make, list_keys, revoke = lines

    def status(method: str, path: str, key: str = "") -> int:
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        return httpx.request(
            method, f"{url}/api/v1/{path}", headers=headers, trust_env=False, timeout=HANGS_S
        ).status_code

    viewer = re.findall("lm_.*", done(make, cwd=cwd))[0]
    eventually(lambda: status("GET", "sites") == 401)
    assert "dashboard: viewer" in done(list_keys, cwd=cwd)
    assert status("GET", "sites/berlin/lifts", viewer) == 200
    assert status("POST", "sites/berlin/tickets", viewer) == 403
    done(revoke, cwd=cwd)
    eventually(lambda: status("GET", "sites") == 200)


def test_the_how_to_starts_a_hub_and_a_site_and_commands_its_lift(tmp_path: Path) -> None:
    lines = commands(PAGE)
    add, serve_hub, leaf, serve = lines[:4]
    every, offline, lifts, metrics = lines[4:8]
    off, on, list_sites = lines[16:]
    hub_port, plc_port = prepare(tmp_path)
    url = f"http://127.0.0.1:{hub_port}"
    with Started() as start:
        assert "carry hub/sites/berlin" in done(add, cwd=tmp_path)
        shutil.move(tmp_path / "hub" / "sites" / "berlin", tmp_path / "berlin")
        hub = start(*words(serve_hub), cwd=tmp_path)
        hub.says(rf"hub: 1 site on {url}\n")
        assert "WARNING" not in hub.err
        start("simulate", "generic-registers", "--port", str(plc_port), "--floors", "L1=1,L2=2")
        change_folder, start_leaf = leaf.split(" && ")
        leaf_words = [NATS_SERVER, *shlex.split(start_leaf)[1:]]
        start.enter_context(started(*leaf_words, cwd=tmp_path / shlex.split(change_folder)[1]))
        key = run("keys", "make", "site.yaml", "--name", "night", "--role", "operator", cwd=tmp_path).stdout
        (tmp_path / "site.key").write_text(key)
        (tmp_path / "site.key").chmod(0o600)
        manager = start(*words(serve), cwd=tmp_path)
        manager.says("hub: site berlin")

        def is_live() -> bool:
            found = fetched(lifts, hub_port)
            return found.status_code == 200 and found.json()["lifts"][0]["quality"] == "live"

        eventually(is_live)
        eventually(lambda: fetched(every, hub_port).json()["sites"][0]["state"] == "online")
        assert fetched(offline, hub_port).json() == {"sites": []}
        assert 'lift_manager_hub_site_state{site="berlin",state="online"} 1' in fetched(metrics, hub_port).text

        command_lift(lines[11:14], url, tmp_path)
        send_robot(lines[14:16], url, tmp_path)
        use_keys(lines[8:11], url, tmp_path)

        done(off, cwd=tmp_path)
        eventually(lambda: fetched(every, hub_port).json()["sites"][0]["state"] == "off")
        assert "its key was copied" in done(list_sites, cwd=tmp_path)
        done(on, cwd=tmp_path)
        eventually(is_live)
        assert manager.stop()[0] == 0
        assert hub.stop()[0] == 0
