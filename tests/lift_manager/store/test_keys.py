"""The file of a site's keys: made, revoked, watched, and never trusted when it looks wrong."""

import asyncio
import json
import os
import stat
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest

from drivers.own_files import replace_file
from lift_manager.api.keys import Key, Secret
from lift_manager.api.roles import Role
from lift_manager.lift.journal import Row
from lift_manager.store.errors import KeysUnusable
from lift_manager.store.keys import KeyFile, keys_path, make_key, may_own, read_keys, revoke_key
from tests.support.programs import eventually

SITE = "Main hospital"
AT = datetime(2026, 3, 1, 20, 15, tzinfo=UTC)


def made(path: Path, name: str = "amr-1", role: Role = Role.OPERATOR, lifts: tuple[str, ...] = ()) -> Secret:
    return make_key(path, SITE, Key("", name, role, lifts), by="weber", at=AT)


def watched(path: Path, *, open_without_keys: bool = True) -> KeyFile:
    return KeyFile(path, SITE, open_without_keys=open_without_keys)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return keys_path(tmp_path / "state" / "main-hospital-01234567.json")


def test_the_file_is_beside_that_of_the_state_and_for_its_user_alone(path: Path) -> None:
    made(path)
    assert path.name == "main-hospital-01234567.keys.json"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_key_that_was_made_is_found_and_another_is_not(path: Path) -> None:
    first, second = made(path), made(path, "amr-2", Role.ROBOT, ("east",))
    keys = watched(path)
    assert keys.are_required
    assert keys.names == ("amr-1", "amr-2")
    by_name = {name: keys.find_by_name(name) for name in ("amr-1", "amr-2", "amr")}
    assert {name: key is not None for name, key in by_name.items()} == {"amr-1": True, "amr-2": True, "amr": False}
    assert keys.find(second) == by_name["amr-2"]
    for secret, name, lifts in ((first, "amr-1", ()), (second, "amr-2", ("east",))):
        found = keys.find(secret)
        assert found is not None
        assert (found.name, found.lifts) == (name, lifts)
    assert keys.find(Secret(second.reveal()[:-1] + "g")) is None


def test_the_file_holds_no_secret_and_every_secret_is_another(path: Path) -> None:
    secrets = {made(path, f"amr-{number}").reveal().split("_")[2] for number in range(20)}
    assert len(secrets) == 20
    assert {len(secret) for secret in secrets} == {64}
    written = "".join(file.read_text() for file in path.parent.iterdir())
    assert [secret for secret in secrets if secret in written] == []


def test_names_are_unique_among_live_keys_and_free_again_after_that(path: Path) -> None:
    first = made(path)
    with pytest.raises(KeysUnusable, match="live key named 'amr-1'"):
        made(path)
    revoke_key(path, SITE, "amr-1", by="beck", at=AT)
    second = made(path)
    keys = watched(path)
    assert keys.find(first) is None
    assert keys.find(second) is not None
    form = read_keys(path, SITE)
    assert [(entry.name, entry.revoked_by) for entry in form.keys] == [("amr-1", "beck"), ("amr-1", "")]
    assert form.keys[0].made_by == "weber"


def test_a_key_that_is_not_there_cannot_be_revoked_and_the_live_ones_are_named(path: Path) -> None:
    with pytest.raises(KeysUnusable, match="there is no live key"):
        revoke_key(path, SITE, "amr-1", by="beck", at=AT)
    made(path)
    with pytest.raises(KeysUnusable, match="the live keys are amr-1"):
        revoke_key(path, SITE, "amr-2", by="beck", at=AT)


def test_a_site_without_a_file_has_no_key_and_is_open_only_where_that_is_said(path: Path) -> None:
    assert not watched(path).are_required
    assert watched(path, open_without_keys=False).are_required
    assert not path.parent.exists()


GOOD = {"format": "lift-manager keys", "version": 1, "site": SITE, "keys": []}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "is damaged"),
        ("{}", "is damaged"),
        (json.dumps(GOOD | {"format": "lift-manager state"}), "is damaged"),
        (json.dumps(GOOD | {"version": 2}), "has version 2"),
        (json.dumps(GOOD | {"site": "Clinic"}), "belongs to the site 'Clinic'"),
        (json.dumps(GOOD | {"keys": [{"id": "x"}]}), "is damaged"),
        (json.dumps(GOOD | {"more": 1}), "is damaged"),
    ],
)
def test_a_file_that_cannot_be_relied_on_is_refused_in_words(path: Path, content: str, said: str) -> None:
    path.parent.mkdir()
    path.write_text(content)
    path.chmod(0o600)
    for use in (watched, made):
        with pytest.raises(KeysUnusable) as caught:
            use(path)
        assert said in str(caught.value)
        assert str(path) in str(caught.value)
    assert path.read_text() == content


def test_a_file_that_others_can_write_is_refused(path: Path) -> None:
    made(path)
    path.chmod(0o620)
    with pytest.raises(KeysUnusable, match="chmod 600"):
        watched(path)


HOLDS_THE_LOCK = """
import fcntl, os, sys
lock = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT, 0o600)
fcntl.lockf(lock, fcntl.LOCK_EX)
print("locked", flush=True)
sys.stdin.read()
"""


def test_one_change_at_a_time(path: Path) -> None:
    made(path)
    command = [sys.executable, "-c", HOLDS_THE_LOCK, str(path.with_name(f"{path.name}.lock"))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"locked\n"
        with pytest.raises(KeysUnusable, match="try again"):
            made(path, "amr-2")
        other.communicate()
    made(path, "amr-2")


class Watch:
    """A KeyFile that runs, and what it notes."""

    def __init__(self, path: Path) -> None:
        self.keys = watched(path)
        self.rows: list[Row] = []
        self._news = asyncio.Event()

    def note(self, row: Row) -> None:
        self.rows.append(row)
        self._news.set()

    async def poll(self) -> None:
        async with asyncio.timeout(1.0):
            await self._news.wait()
        self._news.clear()


def test_a_running_manager_knows_of_a_made_and_a_revoked_key_within_a_second(path: Path) -> None:
    async def main() -> None:
        watch = Watch(path)
        running = asyncio.create_task(watch.keys.run(watch.note))
        secret = made(path, "amr-1", Role.ROBOT, ("east", "west"))
        await watch.poll()
        assert watch.keys.find(secret) is not None
        revoke_key(path, SITE, "amr-1", by="beck", at=AT)
        await watch.poll()
        assert watch.keys.find(secret) is None
        running.cancel()
        assert [row.text for row in watch.rows] == [
            "the robot key amr-1 for east, west was made by weber",
            "the robot key amr-1 for east, west was revoked by beck",
        ]
        assert secret.reveal().split("_")[2] not in str(watch.rows)

    asyncio.run(main())


def spoil(path: Path, damage: str) -> None:
    match damage:
        case "gone":
            path.unlink()
        case "damaged":
            path.write_bytes(path.read_bytes()[:-20])
        case _:
            path.chmod(0o666)


@pytest.mark.parametrize("open_without_keys", [True, False])
def test_a_file_that_is_gone_at_a_start_although_there_were_keys_is_refused_in_words(
    path: Path, *, open_without_keys: bool
) -> None:
    watched(path, open_without_keys=open_without_keys)
    made(path)
    path.unlink()
    with pytest.raises(KeysUnusable) as caught:
        watched(path, open_without_keys=open_without_keys)
    assert f"{path} is gone, although there were keys" in str(caught.value)
    assert "restore a copy of it, or make keys" in str(caught.value)
    made(path)
    assert watched(path, open_without_keys=open_without_keys).are_required


def test_a_site_that_is_to_have_no_keys_any_more_is_served_without_once_its_lock_is_removed(path: Path) -> None:
    made(path)
    path.unlink()
    with pytest.raises(KeysUnusable, match=f"remove {path}.lock"):
        watched(path)
    path.with_name(f"{path.name}.lock").unlink()
    assert not watched(path).are_required


def test_a_key_that_could_not_be_revoked_leaves_no_sign_of_keys(path: Path) -> None:
    with pytest.raises(KeysUnusable, match="there is no live key"):
        revoke_key(path, SITE, "amr-1", by="beck", at=AT)
    assert not watched(path).are_required


@pytest.mark.parametrize("mode", [0o770, 0o707])
def test_a_folder_that_others_can_write_to_is_refused(path: Path, mode: int) -> None:
    made(path)
    path.parent.chmod(mode)
    for use in (watched, made):
        with pytest.raises(KeysUnusable, match=f"other users can write to.* `chmod go-w {path.parent}`"):
            use(path)


def test_a_link_in_the_place_of_the_file_is_refused(path: Path, tmp_path: Path) -> None:
    made(path)
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(KeysUnusable, match="it is a symbolic link"):
        watched(path)


@pytest.mark.parametrize(
    ("owner", "me", "folder", "may"),
    [
        (7, 7, 7, True),
        (0, 7, 7, True),
        (8, 7, 7, False),
        (8, 7, 8, False),
        (0, 0, 8, True),
        (8, 0, 8, True),
        (8, 0, 0, False),
    ],
)
def test_a_file_may_be_of_the_manager_of_root_and_for_root_of_the_user_of_its_folder(
    owner: int, me: int, folder: int, *, may: bool
) -> None:
    assert may_own(owner, me=me, folder=folder) is may


def test_a_file_of_another_user_is_refused(path: Path) -> None:
    made(path)
    if os.geteuid() == 0:
        os.chown(path, 12345, 12345)
        expected = "belongs to another user"
    else:
        # nobody but root can give a file away; this is the nearest to it
        path.chmod(0o666)
        expected = "can be written by others"
    with pytest.raises(KeysUnusable, match=expected):
        read_keys(path, SITE)


@pytest.mark.parametrize("damage", ["gone", "damaged", "open to others"])
def test_a_file_that_goes_bad_under_way_neither_opens_the_door_nor_shuts_it(
    path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    secret = made(path)
    good = path.read_bytes()

    async def main() -> None:
        watch = Watch(path)
        running = asyncio.create_task(watch.keys.run(watch.note))
        spoil(path, damage)
        await asyncio.to_thread(eventually, lambda: caplog.records, 3)
        assert watch.keys.are_required
        assert watch.keys.find(secret) is not None
        replace_file(path, good)
        revoke_key(path, SITE, "amr-1", by="beck", at=AT)
        await watch.poll()
        assert watch.keys.find(secret) is None
        running.cancel()

    asyncio.run(main())
    assert len([record for record in caplog.records if record.levelname == "ERROR"]) == 1
