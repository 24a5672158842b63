"""What `lift-manager hub` refuses, and what it prints about that."""

import ssl
from datetime import timedelta
from pathlib import Path

import httpx
import pytest
import yaml

from tests.lift_manager.hub.rig import NATS_SERVER
from tests.support.certificates import Authority
from tests.support.programs import HANGS_S, call, eventually, free_port, run, running


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a hub, in the current one."""
    (tmp_path / "hub").mkdir(mode=0o700)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "hub"


def settings(folder: Path, **http: object) -> int:
    """Write settings with free ports; return that of the API."""
    port = free_port()
    nats = {"leaf_port": free_port(), "client_port": free_port(), "program": NATS_SERVER}
    (folder / "hub.yaml").write_text(yaml.safe_dump({"http": {"port": port, **http}, "nats": nats}))
    return port


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("site", "add", "Berlin"), "'Berlin' cannot be the id of a site: 1 to 32 small letters"),
        (("site", "remove", "rome"), "there is no site 'rome'; the sites are none"),
        (("site", "off", "rome", "--by", "A", "--reason", "B"), "there is no site 'rome'"),
        (("keys", "revoke", "none"), "no live key is named 'none'"),
    ],
)
def test_what_is_not_there_is_named(folder: Path, words: tuple[str, ...], message: str) -> None:
    done = call("hub", *words)
    assert (done.returncode, message in done.stderr) == (1, True), done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--role", "robot"), "name the lifts of a robot, as in berlin/goods"),
        (("--role", "robot", "--lift", "goods"), "write site and lift, as in berlin/goods"),
        (("--role", "viewer", "--lift", "berlin/goods"), "a key with another role is for every lift"),
        (("--role", "rmf", "--lift", "berlin/goods"), "a hub has no Open-RMF"),
    ],
)
def test_a_key_that_makes_no_sense_for_a_hub_is_not_made(folder: Path, words: tuple[str, ...], message: str) -> None:
    done = call("hub", "keys", "make", "--name", "x", *words, COLUMNS="300")
    assert (done.returncode, message in done.stderr) == (2, True), done.stderr
    assert not (folder / "hub.keys.json").exists()


def test_a_hub_that_others_can_reach_needs_a_key_or_a_reason(folder: Path) -> None:
    settings(folder, host="0.0.0.0")
    done = run("hub", cwd=folder.parent)
    assert done.returncode == 1
    assert "others can reach 0.0.0.0, and there is no key to identify callers" in done.stderr
    assert "keys cross the network as they are" in done.stderr


def test_a_hub_serves_https_with_the_certificate_of_its_settings(folder: Path, tmp_path: Path) -> None:
    authority = Authority(tmp_path / "ca")
    shown = authority.issue("hub", "127.0.0.1", until=timedelta(days=20))
    port = settings(folder, tls={"certificate": str(shown.certificate), "key": str(shown.key)})
    context = ssl.create_default_context(cafile=authority.file)
    with running("hub", cwd=folder.parent) as hub:
        hub.says(rf"hub: 0 sites on https://127.0.0.1:{port}\n")
        url = f"https://127.0.0.1:{port}"
        ready = httpx.get(f"{url}/readyz", verify=context, timeout=HANGS_S)
        assert ready.json() == {"ready": True, "sites": 0, "online": 0}
        assert "the certificate of `http: tls` in hub.yaml is valid until" in hub.err
        before = (folder / "nats.pid").read_text()
        hub_lock = run("hub", cwd=folder.parent)
        assert (hub_lock.returncode, "is in use by another program" in hub_lock.stderr) == (1, True)
        assert (folder / "nats.pid").read_text() == before
        assert hub.stop()[0] == 0
    eventually(lambda: not Path(f"/proc/{before}").exists())


def test_a_mistake_in_the_settings_is_named_with_its_key(folder: Path) -> None:
    (folder / "hub.yaml").write_text("http: {port: 99999}\n")
    done = call("hub")
    assert (done.returncode, "http.port" in done.stderr) == (1, True), done.stderr
