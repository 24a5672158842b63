"""Keys against a running manager: made, needed, revoked, and never written down."""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from tests.lift_manager.test_operate import LIFT, Site
from tests.support.forked import Forked
from tests.support.programs import HANGS_S, Started, call, eventually, free_port, running
from tests.support.rows import each_row

WORKSHOP = "/open-rmf/demo-lift"
LOCKOUT = f"/api/v1/lifts/{LIFT}/lockout"


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with Started() as programs:
        yield Site(programs, tmp_path)


def command(*words: str | Path, key: str = "", code: int = 0) -> str:
    """Run `lift-manager`, with a key in its environment; returns stdout, or stderr where it is to fail."""
    done = call(*words, COLUMNS="400", LIFT_MANAGER_KEY=key)
    assert done.returncode == code, done
    return (done.stderr if code else done.stdout).strip()


def make(site: Site, name: str, role: str, *more: str) -> str:
    return command("keys", "make", site.file, "--name", name, "--role", role, *more)


def asked(site: Site, key: str = "", *, method: str = "GET", path: str = f"{WORKSHOP}/lift_names") -> int:
    headers = {"Authorization": f"Bearer {key}"} if key else {}
    return httpx.request(method, site.url + path, headers=headers, trust_env=False, timeout=HANGS_S).status_code


def test_a_key_counts_soon_after_it_is_made_and_no_longer_once_it_is_revoked(site: Site) -> None:
    assert asked(site) == 200
    key = make(site, "amr-1", "robot", "--lift", LIFT)
    eventually(lambda: asked(site) == 401)
    assert asked(site, key) == 200
    assert asked(site, key[:-1]) == 401
    desk = make(site, "desk", "operator")
    eventually(lambda: asked(site, desk) == 200)
    command("keys", "revoke", site.file, "amr-1")
    eventually(lambda: asked(site, key) == 401)
    assert asked(site, desk) == 200
    site.restart()
    assert (asked(site), asked(site, key), asked(site, desk)) == (401, 401, 200)
    listed = command("keys", "list", site.file).splitlines()
    assert [line.split(",")[0] for line in listed] == [f"amr-1: robot for {LIFT}", "desk: operator"]
    assert " revoked 20" in listed[0]
    assert [line for line in listed if key.split("_")[2] in line or desk.split("_")[2] in line] == []


def test_a_robot_holds_the_lift_in_its_own_name_until_an_operator_takes_it(site: Site, tmp_path: Path) -> None:
    robot, other = make(site, "amr-1", "robot", "--lift", LIFT), make(site, "amr-2", "robot", "--lift", LIFT)
    desk = make(site, "desk", "operator")
    eventually(lambda: asked(site) == 401 and asked(site, desk) == 200)

    def call(key: str) -> str:
        answer = httpx.post(
            f"{site.url}{WORKSHOP}/lift_request",
            params={"lift_name": LIFT},
            json={"floor": "L2", "door_state": 2},
            headers={"Authorization": f"Bearer {key}"},
            trust_env=False,
            timeout=HANGS_S,
        )
        assert answer.status_code == 200
        return str(answer.json()["msg"])

    assert call(robot) == ""
    assert "workshop:amr-1" in call(other)
    words = ("release", LIFT, "--by", "M. Weber", "--reason", "carried away", "--manager", site.url)
    assert "a key is needed" in command(*words, code=1)
    assert "role operator or commissioner; this key's is robot" in command(*words, key=robot, code=1)
    file = tmp_path / "desk.key"
    file.write_text(f"{desk}\n")
    file.chmod(0o644)
    assert f"chmod 600 {file}" in command(*words, "--key-file", file, code=1)
    file.chmod(0o600)
    said = command(*words, "--key-file", file)
    assert said.startswith("M. Weber (key desk), 20")
    assert "the session of workshop:amr-1 on east-wing is over" in said
    assert "nobody holds" in command(*words, key=desk, code=1)


def test_the_first_key_says_what_it_does_to_a_robot_that_rides_without_one(tmp_path: Path) -> None:
    file = site_file(tmp_path)
    told = [call("keys", "make", file, "--name", name, "--role", "viewer", COLUMNS="400").stderr for name in ("a", "b")]
    for words in ("rides without a key", "while no robot rides", "`lift-manager release`", "`lift-manager ack`"):
        assert words in told[0]
        assert words not in told[1]


@each_row(
    ("words", "said"),
    [
        (("--name", "amr", "--role", "robot"), "name the lifts that this key may command: east-wing"),
        (("--name", "amr", "--role", "robot", "--lift", "west"), "no lift 'west'; there is east-wing"),
        (("--name", "amr", "--role", "viewer", "--lift", LIFT), "is for every lift"),
        (("--name", "a:b", "--role", "viewer"), "letters, digits, spaces, points and hyphens"),
        (("--name", "", "--role", "viewer"), "letters, digits, spaces, points and hyphens"),
        (("--name", "x" * 33, "--role", "viewer"), "letters, digits, spaces, points and hyphens"),
        (("--name", "Workshop", "--role", "viewer"), "is the name of a face"),
        (("--name", "amr", "--role", "king"), "'viewer', 'robot', 'rmf', 'operator'"),
    ],
)
def test_a_key_that_makes_no_sense_is_not_made(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    file = site_file(tmp_path)
    assert said in " ".join(command("keys", "make", file, *words, code=2).replace("│", " ").split())
    assert "there is no key" in command("keys", "list", file)


def site_file(folder: Path, **api: object) -> Path:
    content = {
        "schema": 1,
        "name": "Keyed",
        "state": "kept",
        "api": {"host": "0.0.0.0", **api},
        "controllers": {"plc": {"host": "127.0.0.1", "port": free_port(), "map": "generic-registers"}},
        "lifts": {LIFT: {"controller": "plc", "floors": {"L1": 1, "L2": 2}}},
    }
    file = folder / "site.yaml"
    file.write_text(json.dumps(content), "utf-8")  # JSON is YAML
    return file


def test_no_other_address_is_served_without_a_key_or_a_word_why(tmp_path: Path) -> None:
    file = site_file(tmp_path)
    said = command("serve", file, "--port", "0", code=1)
    assert "others can reach 0.0.0.0, and there is no key to identify callers" in said
    assert "`api: {without_keys: ...}`" in said
    checked = command("check", file, code=2)
    assert f"{file}: api.host: {said}" in checked, "check and serve have the same words for it"
    command("keys", "make", file, "--name", "desk", "--role", "viewer")
    assert "no mistakes" in command("check", file)
    with running("serve", file, "--port", "0") as manager:
        url = manager.says(r"http://0\.0\.0\.0(:\d+)/docs")[1]
        assert (
            httpx.get(f"http://127.0.0.1{url}{WORKSHOP}/lift_names", trust_env=False, timeout=HANGS_S).status_code
            == 401
        )
        # the last key goes, and the door stays shut
        command("keys", "revoke", file, "desk")
        manager.logs("was revoked by")
        assert (
            httpx.get(f"http://127.0.0.1{url}{WORKSHOP}/lift_names", trust_env=False, timeout=HANGS_S).status_code
            == 401
        )


def test_a_site_that_says_why_is_served_without_keys_and_cautioned_at_every_start(tmp_path: Path) -> None:
    file = site_file(tmp_path, without_keys="a network of its own, behind a locked door")
    with running("serve", file, "--port", "0") as manager:
        url = manager.says(r"http://0\.0\.0\.0(:\d+)/docs")[1]
        assert (
            httpx.get(f"http://127.0.0.1{url}{WORKSHOP}/lift_names", trust_env=False, timeout=HANGS_S).status_code
            == 200
        )
        assert "accepted: a network of its own, behind a locked door" in manager.err


def test_a_file_of_keys_that_is_damaged_stops_the_start_in_words(tmp_path: Path) -> None:
    file = site_file(tmp_path)
    command("keys", "make", file, "--name", "desk", "--role", "viewer")
    (kept,) = (tmp_path / "kept").glob("*.keys.json")
    kept.write_text(kept.read_text()[:-30])
    said = command("serve", file, "--port", "0", code=1)
    assert "is not a key file of a lift manager" in said
    assert said in command("check", file, code=2)


def test_a_state_that_cannot_be_relied_on_is_found_by_check_as_well(tmp_path: Path) -> None:
    file = site_file(tmp_path, host="127.0.0.1")
    kept = tmp_path / "kept"
    kept.mkdir(mode=0o700)
    command("keys", "make", file, "--name", "desk", "--role", "viewer")
    (keys,) = kept.glob("*.keys.json")
    keys.with_name(keys.name.replace(".keys.json", ".db")).write_text("{}")
    said = command("serve", file, "--port", "0", code=1)
    assert said in command("check", file, code=2)


def test_a_key_that_was_redirected_to_a_file_is_taken_from_there(site: Site, tmp_path: Path) -> None:
    key_file = tmp_path / "desk.key"
    key_file.touch(mode=0o644)
    words = ("keys", "make", str(site.file), "--name", "desk", "--role", "viewer")
    with key_file.open("w") as out, (tmp_path / "said").open("w") as err:
        made = Forked(words, env=os.environ, out=out.fileno(), err=err.fileno())
    assert made.wait(HANGS_S) == 0, (tmp_path / "said").read_text()
    assert key_file.stat().st_mode & 0o777 == 0o600
    eventually(lambda: asked(site) == 401)
    assert LIFT in command("lifts", "--manager", site.url, "--key-file", key_file)


def test_a_key_that_no_site_knows_is_refused_where_none_is_needed(site: Site) -> None:
    assert asked(site) == 200
    assert asked(site, f"lm_{'0' * 8}_{'0' * 64}") == 401
    assert asked(site, "anything") == 401


def test_no_secret_is_ever_written_down_wherever_a_caller_puts_it(site: Site) -> None:
    robot, desk = make(site, "amr-1", "robot", "--lift", LIFT), make(site, "desk", "operator")
    eventually(lambda: asked(site, desk) == 200)
    mistyped = desk[:-1] + ("0" if desk[-1] != "0" else "1")
    heard: list[bytes] = []
    with httpx.Client(base_url=site.url, trust_env=False, timeout=HANGS_S) as client:
        for bearer in (robot, desk, mistyped, desk.upper(), desk[:-8]):
            for placed in (robot, desk, mistyped, desk[:-8], desk.split("_")[2]):
                heard += places(client, bearer, placed)
    first = site.manager
    site.restart()
    heard += [file.read_bytes() for file in site.kept.iterdir()]
    heard += [text.encode() for manager in (first, site.manager) for text in (manager.err, manager.out)]
    assert len(heard) > 150
    assert b"was refused" in b"".join(heard)
    for key in (robot, desk):
        # most of it is as good as all of it
        found = [text for text in heard if key.split("_")[2][:40].encode().lower() in text.lower()]
        assert found == []


def places(client: httpx.Client, bearer: str, placed: str) -> Iterator[bytes]:
    """Put a key wherever a caller can put one; yields whole answers."""
    headers = {"Authorization": f"Bearer {bearer}"}
    words = {"by": placed, "reason": placed}
    request = f"{WORKSHOP}/lift_request"
    answers = [
        client.get(f"{WORKSHOP}/lift_state", params={"lift_name": placed}, headers=headers),
        client.get(f"/{placed}", headers=headers),
        client.get(f"/{placed}"),
        client.request(placed[:20].upper(), f"{WORKSHOP}/lift_names", headers=headers),
        client.post(request, params={"lift_name": LIFT}, json={"floor": placed, "door_state": 0}, headers=headers),
        client.post(request, params={"lift_name": LIFT}, json={placed: placed}, headers=headers),
        client.post(request, params={"lift_name": LIFT}, content=placed, headers=headers),
        client.post(f"/api/v1/lifts/{placed}/lockout", json=words, headers=headers),
        client.post(LOCKOUT, json=words, headers=headers),
        client.post(LOCKOUT, json={"by": "M. Weber", "reason": f"new ropes {placed}"}, headers=headers),
        client.post(LOCKOUT, json={placed: 1}, headers={**headers, "X-Key": placed, "Cookie": f"key={placed}"}),
        client.post(LOCKOUT, content=f"by={placed}", headers={**headers, "Content-Type": placed}),
    ]
    for answer in answers:
        yield str(answer.headers).encode() + answer.content
