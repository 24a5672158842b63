"""The store of one site: whose it is, where it is, and when nothing starts because of what is kept of it, or is not."""

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from lift_manager.lift.trust import Trust
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.database import open_database
from lift_manager.store.errors import StoreUnusable
from lift_manager.store.place import store_path
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_store, read_records_of_site
from lift_manager.store.sqlite import SqliteStore
from tests.lift_manager.store.journal_disk import LIFTS, SITE, journal, opened_raw
from tests.lift_manager.store.test_recall_contract import EVERYTHING, RECORD
from tests.support.programs import HANGS_S

FIRE = SavedLift(replace(RECORD, restrictions=(), occupied=None, acknowledged=None, trust=Trust()))
CALM = SavedLift(replace(RECORD, fire_since=None, restrictions=(), occupied=None, trust=Trust()))
LIMITS = Limits(400, 500)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file in a folder that is not there yet."""
    return tmp_path / "var" / "lib" / "site.db"


def write_down(path: Path, record: SavedLift, lift: str = "east") -> None:
    store = SqliteStore(path, SITE, LIMITS)
    store.commit({lift: record}, [])
    store.close()


def unusable(path: Path) -> str:
    with pytest.raises(StoreUnusable) as refused:
        journal(path)
    assert str(path) in str(refused.value)
    assert "nothing starts without it" in str(refused.value)
    return str(refused.value)


def files(path: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in path.parent.iterdir()}


def test_reading_changes_nothing_and_needs_no_manager_to_have_ended(path: Path) -> None:
    write_down(path, EVERYTHING)
    before = files(path)
    assert read_records_of_site(path, SITE, LIFTS) == {"east": EVERYTHING}
    assert files(path) == before
    running = SqliteStore(path, SITE, LIMITS)
    running.commit({"east": FIRE}, [])
    assert read_records_of_site(path, SITE, LIFTS) == {"east": FIRE}
    running.close()


def test_a_store_that_is_not_there_holds_nothing_and_is_not_made_by_reading(path: Path) -> None:
    assert read_records_of_site(path, SITE, LIFTS) == {}
    assert not path.parent.exists()


def test_a_folder_where_nothing_can_be_written_keeps_nobody_from_reading(path: Path) -> None:
    """SQLite wants a third file beside a store with a log, and a folder in its place is as good as a disk that is read-only."""
    store = SqliteStore(path, SITE, LIMITS)
    store.commit({"east": FIRE}, [])
    copy = path.with_name("copy.db")
    shutil.copy(path, copy)
    shutil.copy(f"{path}-wal", f"{copy}-wal")
    copy.with_name("copy.db-shm").mkdir()
    store.close()
    assert read_records_of_site(copy, SITE, LIFTS) == {"east": FIRE}


@pytest.mark.parametrize(
    ("statement", "words"),
    [
        (
            "PRAGMA user_version = 2",
            "is version 2 of a store, and this program reads versions up to 1; it records which",
        ),
        ("PRAGMA application_id = 7", "is not a store of a lift manager; it records which"),
        ("UPDATE about SET value = 'Villa' WHERE key = 'site'", "belongs to the site 'Villa'; it records which"),
    ],
)
def test_a_store_of_another_program_site_or_newer_version_is_refused(path: Path, statement: str, words: str) -> None:
    write_down(path, EVERYTHING)
    with opened_raw(path) as connection:
        connection.execute(statement)
    assert words in unusable(path)


def test_a_log_whose_store_is_gone_is_not_taken_for_an_empty_folder(path: Path) -> None:
    write_down(path, EVERYTHING)
    path.rename(path.with_name("site.db-wal"))
    assert "is not there, and site.db-wal is" in unusable(path)


def test_a_lift_that_is_gone_and_kept_nobody_out_is_carried_along(path: Path) -> None:
    write_down(path, CALM, "gone")
    write_down(path, FIRE)
    assert read_records_of_site(path, SITE, LIFTS) == {"gone": CALM, "east": FIRE}


def test_a_lift_that_is_gone_and_keeps_robots_out_is_asked_for(path: Path) -> None:
    write_down(path, FIRE, "west")
    words = unusable(path)
    assert "keeps robots off lift 'west', which is not in the site file" in words
    assert "put it back under that name until a person has ended that" in words


def test_a_site_with_a_corrected_name_does_not_forget_what_keeps_robots_out(path: Path) -> None:
    write_down(path.with_name("other.db"), EVERYTHING)
    with pytest.raises(StoreUnusable) as refused:
        open_store(path, "Main hospitals", LIFTS, LIMITS)
    said = str(refused.value)
    assert "other.db in the same folder keeps robots off lift 'east' of the site 'Main hospital'" in said
    assert "if that is the former name of this site, use that name again until people have ended that" in said


def test_stores_of_other_buildings_and_other_files_in_the_folder_are_let_be(path: Path) -> None:
    write_down(path.with_name("calm.db"), CALM)
    write_down(path.with_name("old.db"), FIRE)
    path.with_name("notes.db").write_bytes(b"{")
    path.with_name("empty.db").touch()
    path.with_name("folder.db").mkdir()
    assert open_store(path, "Harbour office", ["north"], LIMITS).recall("north") is None


HOLDS = """
import sys
from pathlib import Path
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_store
kept = open_store(Path(sys.argv[1]), "Main hospital", ["east"], Limits(400, 500))
sys.stdout.write("open\\n")
sys.stdout.flush()
sys.stdin.read()
"""


def test_two_managers_do_not_share_a_store(path: Path) -> None:
    command = [sys.executable, "-c", HOLDS, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "open\n"
        with pytest.raises(StoreUnusable, match="another manager on this computer already serves a site of this name"):
            journal(path)
        other.communicate("", timeout=HANGS_S)
    assert journal(path).recall("east") is None


def test_a_folder_where_the_store_should_be_is_refused(path: Path) -> None:
    path.mkdir(parents=True)
    assert "cannot be read" in unusable(path)


@pytest.mark.parametrize(
    ("environ", "said", "folder"),
    [
        (
            {"STATE_DIRECTORY": "/var/lib/lift-manager:/var/lib/other", "XDG_STATE_HOME": "/x"},
            "kept",
            "/var/lib/lift-manager",
        ),
        ({"XDG_STATE_HOME": "/x"}, "kept", "/etc/lifts/kept"),
        ({"XDG_STATE_HOME": "/x"}, "/srv/kept", "/srv/kept"),
        ({"XDG_STATE_HOME": "/x"}, None, "/x/lift-manager"),
        ({}, None, "~/.local/state/lift-manager"),
    ],
)
def test_the_place_is_that_of_systemd_or_of_the_site_or_of_the_user(
    environ: dict[str, str], said: str | None, folder: str
) -> None:
    place = store_path(SITE, said, Path("/etc/lifts/site.yaml"), environ)
    assert place.parent == Path(folder).expanduser()


def test_sites_whose_names_look_alike_have_files_of_their_own() -> None:
    names = [
        store_path(name, None, Path("site.yaml"), {}).name for name in ("A/B", "A B", "a b", "病院", "...", "../..")
    ]
    assert len(set(names)) == len(names)
    assert all("/" not in name and not name.startswith(".") for name in names)
    assert names[0].startswith("a-b-")
    assert names[3].startswith("site-")


@pytest.mark.parametrize("mode", [0o770, 0o707])
def test_a_folder_that_others_can_write_to_is_refused(path: Path, mode: int) -> None:
    path.parent.mkdir(parents=True)
    path.parent.chmod(mode)
    assert f"`chmod go-w {path.parent}`" in unusable(path)
    assert list(path.parent.iterdir()) == []


def test_no_link_is_followed(path: Path, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.write_text("precious")
    path.parent.mkdir(parents=True)
    path.with_name(f"{path.name}.new").symlink_to(theirs)
    write_down(path, FIRE)
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    assert "it is a symbolic link" in unusable(path)
    with pytest.raises(OSError, match="it is a symbolic link"):
        open_database(path, SITE)
    assert theirs.read_text() == "precious"
