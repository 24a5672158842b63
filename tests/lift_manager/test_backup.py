"""`lift-manager backup` and `restore`: everything of a site comes back, and no robot is served before a person has looked at the lifts."""

import json
import os
import signal
import sqlite3
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import httpx
import pytest

from lift_manager.api.keys import Key
from lift_manager.api.roles import Role
from lift_manager.commissioning.backup import MANIFEST
from lift_manager.commissioning.checkout.record import record_path, save
from lift_manager.hub.folder import HubFolder
from lift_manager.lift.events import Restriction, RestrictionKind
from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.keys import keys_path, make_key, read_keys
from lift_manager.store.place import store_path
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore, read_records
from lift_manager.store.store import PendingRow
from tests.lift_manager.commissioning.checkout.records import SAT
from tests.lift_manager.store.test_recall_contract import EVERYTHING, RECORD
from tests.lift_manager.test_operate import LIFT, Site
from tests.support.certificates import Authority
from tests.support.programs import HANGS_S, ROOT, Started, call, eventually

NAME = "Main hospital"
SITE = """\
schema: 1
name: Main hospital
state: kept
api:
  tls: {certificate: tls/manager.pem, key: tls/manager.key}
controllers:
  plc: {host: 192.0.2.10, map: ./own.yaml}
  pump: {host: 192.0.2.11, map: ../shared.yaml}
lifts:
  east: {controller: plc, floors: {G: 0, First: 1}}
  west: {controller: pump, floors: {G: 0, First: 1}}
"""
FIRE = SavedLift(replace(RECORD, restrictions=()), EVERYTHING.rides)
LIMITS = Limits(keep_days=400, max_mb=500)
AT = datetime(2026, 11, 20, tzinfo=UTC)


def store_of(site: Path) -> Path:
    return store_path(NAME, "kept", site, {})


def commit(site: Path, *rows: str, **records: SavedLift) -> None:
    store = SqliteStore(store_of(site), NAME, LIMITS)
    store.commit(records, [PendingRow(1_700_000_000_000_000, Row(RowKind.MANAGER, text)) for text in rows])
    store.close()


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A site with something of every kind; lift east had a fire, held a session and a ride."""
    folder = tmp_path / "etc"
    (folder / "tls").mkdir(parents=True)
    (folder / "site.yaml").write_text(SITE)
    shipped = (ROOT / "register_maps" / "maps" / "two-stop-agv.yaml").read_text()
    for path, name in ((folder / "own.yaml", "own"), (tmp_path / "shared.yaml", "shared")):
        path.write_text(shipped.replace("name: two-stop-agv", f"name: {name}"))
    Authority(folder / "tls").issue("manager", "127.0.0.1")
    (folder / "tls" / "manager.key").chmod(0o640)
    site = folder / "site.yaml"
    commit(site, "a manager started", east=FIRE)
    make_key(keys_path(store_of(site)), NAME, Key("", "amr-7", Role.ROBOT, ("east",)), by="Anna Berg", at=AT)
    return site


@pytest.fixture
def archive(site: Path, tmp_path: Path) -> Path:
    done = call("backup", site, "-o", tmp_path / "b.tar.gz")
    assert done.returncode == 0, done.stderr
    return tmp_path / "b.tar.gz"


def test_the_leaf_node_of_a_site_with_a_hub_comes_back_with_its_secrets(site: Path, tmp_path: Path) -> None:
    (tmp_path / "hub").mkdir(mode=0o700)
    files = HubFolder(tmp_path / "hub").add_site("berlin")
    files.rename(site.parent / "berlin")
    site.write_text(f"{site.read_text()}hub: {{site: berlin, password: berlin/manager.password}}\n")
    done = call("backup", site, "-o", tmp_path / "b.tar.gz")
    lines = done.stdout.splitlines()
    assert "  berlin/manager.password: the password for the leaf node" in lines, done.stderr
    assert "  berlin/leaf.conf: the configuration of the leaf node, with the site's key for the hub" in lines
    assert (
        "  left out: the rows that the leaf node keeps for the hub: they are copies of the journal, which is in here"
        in lines
    )
    new = tmp_path / "new" / "site.yaml"
    restored(tmp_path / "b.tar.gz", new)
    for name in ("leaf.conf", "manager.password"):
        back = new.parent / "berlin" / name
        assert back.read_bytes() == (site.parent / "berlin" / name).read_bytes()
        assert back.stat().st_mode & 0o777 == 0o600
    (site.parent / "berlin" / "leaf.conf").unlink()
    without = call("backup", site, "-o", tmp_path / "c.tar.gz")
    assert (
        "berlin/leaf.conf: the configuration of the leaf node, with the site's key for the hub: it is not beside"
        in without.stdout
    )


def restored(archive: Path, site: Path, *options: str) -> str:
    done = call("restore", archive, site, "--by", "Anna Berg", *options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def refused(*words: str | Path) -> str:
    done = call(*words)
    assert (done.returncode, done.stdout) == (1, "")
    return done.stderr


def test_a_backup_is_for_its_owner_alone_and_says_what_it_holds(site: Path, tmp_path: Path) -> None:
    done = call("backup", site, "-o", tmp_path / "b.tar.gz")
    assert (tmp_path / "b.tar.gz").stat().st_mode & 0o777 == 0o600
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"{tmp_path / 'b.tar.gz'}: 8 files of {NAME}, ")
    assert {
        "  site.yaml: the site file",
        "  own.yaml: a map of this site",
        f"  {tmp_path / 'shared.yaml'}: a map of this site",
        "  tls/manager.key: a private key",
        f"  {store_of(site).name}: the state of the lifts, and the journal",
    } <= set(lines)
    assert "state    1 lift; robots are kept off east" in lines
    assert any(line.startswith("journal  1 row, and the chain holds; seal 1:") for line in lines)
    assert "keys     1 live API key" in lines


def test_a_backup_puts_nothing_beside_the_files_of_the_site(site: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    call("backup", site, "-o", tmp_path / "b.tar.gz")
    assert sorted(tmp_path.rglob("*")) == sorted([*before, tmp_path / "b.tar.gz"])


def test_what_a_running_manager_is_just_writing_is_no_part_of_it(site: Path, tmp_path: Path) -> None:
    store = store_of(site)
    for ending in (".new", ".new-journal"):  # of a store that is being made
        store.with_name(f"{store.name}{ending}").touch()
    done = call("backup", site, "-o", tmp_path / "b.tar.gz")
    assert f"{tmp_path / 'b.tar.gz'}: 8 files of {NAME}, " in done.stdout


def test_every_file_comes_back_with_its_permissions(archive: Path, site: Path, tmp_path: Path) -> None:
    new = tmp_path / "new" / "tower.yaml"
    said = restored(archive, new)
    assert new.read_text() == SITE
    for name in ("own.yaml", "tls/manager.key", "tls/manager.pem"):
        before, after = site.parent / name, new.parent / name
        assert (after.read_bytes(), after.stat().st_mode) == (before.read_bytes(), before.stat().st_mode)
    keys = read_keys(keys_path(store_of(new)), NAME)
    assert keys == read_keys(keys_path(store_of(site)), NAME)
    assert "keys       1 live API key: amr-7; one that was revoked since works again" in said
    assert (store_of(new).stat().st_mode & 0o777, store_of(new).parent.stat().st_mode & 0o777) == (0o600, 0o700)


def test_nothing_is_written_outside_of_the_two_folders(archive: Path, tmp_path: Path) -> None:
    (tmp_path / "shared.yaml").unlink()
    new = tmp_path / "new" / "site.yaml"
    said = restored(archive, new)
    aside = new.parent / "elsewhere" / str(tmp_path / "shared.yaml").lstrip("/")
    assert f"by hand    {aside} belongs to {tmp_path / 'shared.yaml'}" in said
    assert aside.is_file()
    assert not (tmp_path / "shared.yaml").exists()


def test_after_a_restore_every_lift_is_locked_out_and_what_kept_robots_off_still_does(
    archive: Path, tmp_path: Path
) -> None:
    new = tmp_path / "new" / "site.yaml"
    said = restored(archive, new)
    assert "Every lift is locked out (east, west)" in said
    records = read_records(store_of(new), NAME)
    for lift in ("east", "west"):
        lockout = records[lift].record.restriction(RestrictionKind.LOCKOUT)
        assert lockout is not None
        assert lockout.by == "Anna Berg"
        assert lockout.reason.startswith("restored from a backup: look at the lift and into its car")
        assert records[lift].rides == ()
    assert records["east"].record == replace(FIRE.record, restrictions=records["east"].record.restrictions)


def test_an_older_lockout_keeps_its_name_and_reason(site: Path, tmp_path: Path) -> None:
    older = Restriction(RestrictionKind.LOCKOUT, "M. Weber", "new ropes", AT)
    commit(site, west=SavedLift(replace(RECORD, restrictions=(older,))))
    call("backup", site, "-o", tmp_path / "b.tar.gz")
    new = tmp_path / "new" / "site.yaml"
    restored(tmp_path / "b.tar.gz", new)
    assert read_records(store_of(new), NAME)["west"].record.restrictions == (older,)


def test_the_journal_goes_on_from_the_backup_and_says_that_it_was_restored(archive: Path, tmp_path: Path) -> None:
    new = tmp_path / "new" / "site.yaml"
    restored(archive, new)
    assert "rows    4, from 1 to 4" in call("audit", "--journal", store_of(new), "--verify").stdout
    table = call("audit", "--journal", store_of(new), COLUMNS="200").stdout
    assert "a manager started" in table
    assert "the site was restored by Anna Berg" in table
    assert table.count("locked out by Anna Berg") == 2


def test_checkout_records_and_their_photos_are_part_of_it(site: Path, tmp_path: Path) -> None:
    record = SAT
    (store_of(site).parent / "door.jpg").write_bytes(b"a photo")
    first, *rest = record.results
    record = record.model_copy(
        update={"site": NAME, "lift": "east", "results": (first.model_copy(update={"photos": ("door.jpg", "gone.jpg")}), *rest)}
    )  # fmt: skip
    save(record_path(store_of(site), "east", record.stage), record)
    done = call("backup", site, "-o", tmp_path / "b.tar.gz")
    assert f"  left out: {store_of(site).parent / 'gone.jpg'}: a photo of a checkout that is not there" in done.stdout
    new = tmp_path / "new" / "site.yaml"
    restored(tmp_path / "b.tar.gz", new)
    assert record_path(store_of(new), "east", record.stage).is_file()
    assert (store_of(new).parent / "door.jpg").read_bytes() == b"a photo"


def test_files_that_are_there_are_replaced_only_when_that_is_asked_for_and_kept(archive: Path, site: Path) -> None:
    site.write_text(f"{SITE}# changed\n")
    commit(site, "a newer row")
    before = store_of(site).read_bytes()
    said = refused("restore", archive, site, "--by", "Anna Berg")
    assert said.startswith(f"nothing was changed: there already, and different: {store_of(site)}, {site}; --force")
    assert store_of(site).read_bytes() == before
    assert site.read_text() != SITE
    assert "replaced   what was there is kept in" in restored(archive, site, "--force")
    assert site.read_text() == SITE
    (kept,) = store_of(site).parent.glob("before-restore-*")
    assert (kept / str(store_of(site)).lstrip("/")).read_bytes() == before
    assert (kept / str(site).lstrip("/")).read_text().endswith("# changed\n")


def test_the_log_of_the_former_store_is_not_applied_to_the_restored_one(archive: Path, site: Path) -> None:
    open_store = SqliteStore(store_of(site), NAME, LIMITS)
    open_store.commit({}, [PendingRow(1_800_000_000_000_000, Row(RowKind.MANAGER, "a newer row"))])
    crashed = {ending: Path(f"{store_of(site)}{ending}").read_bytes() for ending in ("", "-wal")}
    open_store.close()
    for ending, content in crashed.items():
        Path(f"{store_of(site)}{ending}").write_bytes(content)
    restored(archive, site, "--force")
    assert "rows    4, from 1 to 4" in call("audit", "--journal", store_of(site), "--verify").stdout


def test_a_backup_of_the_wrong_folder_is_refused_and_not_taken_for_one_without_state(
    site: Path, tmp_path: Path
) -> None:
    said = refused_in(tmp_path / "other", "backup", site, "-o", tmp_path / "b.tar.gz")
    assert f"there is nothing of '{NAME}' in {tmp_path / 'other'}" in said
    assert "`STATE_DIRECTORY=/var/lib/lift-manager` before the command" in said
    assert not (tmp_path / "b.tar.gz").exists()


def refused_in(state: Path, *words: str | Path) -> str:
    done = call(*words, STATE_DIRECTORY=str(state))
    assert done.returncode == 1
    return done.stderr


def test_a_backup_is_not_written_over_another_nor_where_others_could_replace_it(
    site: Path, archive: Path, tmp_path: Path
) -> None:
    before = archive.read_bytes()
    assert "--force to replace it" in refused("backup", site, "-o", archive)
    assert archive.read_bytes() == before
    assert call("backup", site, "-o", archive, "--force").returncode == 0
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    assert "others can write to this folder" in refused("backup", site, "-o", tmp_path / "open" / "b.tar.gz")


def test_a_journal_that_was_changed_is_not_backed_up_as_if_it_were_whole(site: Path, tmp_path: Path) -> None:
    commit(site, "a second row", "a third row")
    with sqlite3.connect(store_of(site)) as connection:
        connection.execute("UPDATE rows SET text = 'another' WHERE seq = 2")
    connection.close()
    said = refused("backup", site, "-o", tmp_path / "b.tar.gz")
    assert said.startswith("nothing was written: the journal does not hold: row 2 ")
    assert not (tmp_path / "b.tar.gz").exists()


def member(archive: Path, name: str) -> bytes:
    with tarfile.open(archive) as found:
        content = found.extractfile(name)
        assert content is not None
        return content.read()


def rewritten(archive: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """Return a copy in which files are changed, or left out."""
    target = archive.with_name(f"changed-{len(list(archive.parent.iterdir()))}.tar.gz")
    with tarfile.open(archive) as source, tarfile.open(target, "w:gz") as copy:
        for info in source.getmembers():
            if (content := change(info.name, member(archive, info.name))) is not None:
                info.size = len(content)
                scratch = archive.with_name("scratch")
                scratch.write_bytes(content)
                with scratch.open("rb") as file:
                    copy.addfile(info, file)
    return target


def test_an_archive_that_is_damaged_or_something_else_changes_nothing(archive: Path, tmp_path: Path) -> None:
    def listing(**changes: object) -> Callable[[str, bytes], bytes]:
        return lambda name, content: (
            json.dumps({**json.loads(content), **changes}).encode() if name == MANIFEST else content
        )

    entries = json.loads(member(archive, MANIFEST))["entries"]
    outside = [{**entries[0], "name": "../../evil"}, *entries[1:]]
    cut = tmp_path / "cut.tar.gz"
    cut.write_bytes(archive.read_bytes()[:-200])
    text = tmp_path / "text"
    text.write_text("not an archive")
    cases = [
        (rewritten(archive, lambda name, content: content + b"#" if name == "site/own.yaml" else content), "own.yaml is not"),
        (rewritten(archive, lambda name, content: None if name == "site/own.yaml" else content), "site/own.yaml is not the file"),
        (rewritten(archive, listing(version=2)), "has version 2 of a backup, and this program reads version 1"),
        (rewritten(archive, listing(entries=outside)), "is no path inside a folder"),
        (rewritten(archive, listing(site="another")), "is not that of 'another'"),
        (cut, "is damaged"),
        (text, "is no backup of a lift manager"),
        (tmp_path / "none", "cannot be read (No such file or directory)"),
    ]  # fmt: skip
    new = tmp_path / "new" / "site.yaml"
    for path, words in cases:
        said = refused("restore", path, new, "--by", "Anna Berg")
        assert said.startswith("nothing was changed: "), said
        assert words in said
        assert list(new.parent.iterdir()) == []


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Site]:
    with Started() as programs:
        yield Site(programs, tmp_path)


def is_stored(site: Path) -> bool:
    saved = read_records(store_of(site), NAME).get(LIFT)
    return saved is not None and saved.record.session is not None


def since_restore(site: Path) -> list[str]:
    """Return the kind of every row of the journal that is not older than the restore."""
    rows = [json.loads(line) for line in call("audit", site, "--jsonl", "-").stdout.splitlines()]
    return [row["kind"] for row in rows[next(at for at, row in enumerate(rows) if "was restored by" in row["text"]) :]]


def test_a_session_of_a_backup_of_a_running_manager_does_not_come_back(running: Site, tmp_path: Path) -> None:
    assert running.refuses() == ""  # a robot holds the lift
    eventually(lambda: is_stored(running.file))  # the answer does not wait for the disk
    done = call("backup", running.file, "-o", tmp_path / "b.tar.gz")
    assert done.returncode == 0, done.stderr
    assert running.refuses() == ""
    said = refused("restore", tmp_path / "b.tar.gz", running.file, "--by", "Anna Berg", "--force")
    assert "a manager runs for 'Main hospital'" in said

    running.file = tmp_path / "new" / "site.yaml"
    restored(tmp_path / "b.tar.gz", running.file)
    running.restart(signal.SIGKILL)
    assert "restored from a backup" in running.refuses()
    shown = httpx.get(f"{running.url}/api/v1/lifts/{LIFT}", trust_env=False, timeout=HANGS_S).json()
    assert shown["session"] is None
    eventually(lambda: "session" in since_restore(running.file))  # how the one of the backup ended
    assert "press" not in since_restore(running.file)
    running.say("lockout", LIFT, "--by", "Anna Berg", "--end")
    assert running.refuses() == ""


def test_root_gives_every_file_to_its_former_owner(site: Path, tmp_path: Path) -> None:
    owner = 65534 if os.geteuid() == 0 else os.geteuid()
    for path in [*store_of(site).parent.iterdir(), store_of(site).parent]:
        os.chown(path, owner, -1)
    call("backup", site, "-o", tmp_path / "b.tar.gz")
    new = tmp_path / "new" / "site.yaml"
    restored(tmp_path / "b.tar.gz", new)
    kept = store_of(new).parent
    assert {path.stat().st_uid for path in [kept, *kept.iterdir()]} == {owner}
    assert new.stat().st_uid == os.geteuid()
