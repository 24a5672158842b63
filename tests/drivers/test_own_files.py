"""Files of our own in folders that other users know of: no link is followed, nothing of theirs is written to."""

import os
import stat
import threading
from pathlib import Path

import pytest

from drivers.errors import ControllerTaken, LockUnusable
from drivers.modbus.controller_lock import controller_lock
from drivers.own_files import is_shared, make_own, open_own, read_own


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    path = tmp_path / "theirs"
    path.write_text("precious")
    return path


def test_a_link_in_the_place_of_a_file_is_neither_read_nor_written(tmp_path: Path, theirs: Path) -> None:
    link = tmp_path / "ours"
    link.symlink_to(theirs)
    for use in (open_own, read_own):
        with pytest.raises(OSError, match="it is a symbolic link, and links are not followed"):
            use(link)
    os.close(make_own(link))
    assert (link.is_symlink(), link.read_text(), theirs.read_text()) == (False, "", "precious")


def test_a_file_is_made_for_this_user_alone_and_never_on_top_of_another(tmp_path: Path) -> None:
    path = tmp_path / "ours"
    os.close(open_own(path))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    before = path.stat().st_ino
    held = path.open()  # or its number would be given to the next file
    os.close(make_own(path))
    held.close()
    assert path.stat().st_ino != before


@pytest.mark.parametrize(
    ("mode", "shared"), [(0o700, False), (0o755, False), (0o775, True), (0o757, True), (0o1777, True)]
)
def test_a_folder_is_shared_where_group_or_others_can_write(tmp_path: Path, mode: int, *, shared: bool) -> None:
    folder = tmp_path / "folder"
    assert not is_shared(folder)
    folder.mkdir()
    folder.chmod(mode)
    assert is_shared(folder) is shared


def test_a_second_lock_of_a_controller_is_refused_and_names_the_process(tmp_path: Path) -> None:
    with controller_lock("10.0.0.5", 502, temporary=tmp_path):
        with pytest.raises(ControllerTaken, match=f"by process {os.getpid()} "):  # noqa: SIM117
            with controller_lock("10.0.0.5", 502, temporary=tmp_path):
                raise AssertionError(threading.current_thread())
        with controller_lock("10.0.0.6", 502, temporary=tmp_path):
            pass


def test_a_lock_in_a_folder_that_somebody_else_prepared_is_refused(tmp_path: Path, theirs: Path) -> None:
    folder = tmp_path / f"lift-manager-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o777)
    with pytest.raises(LockUnusable, match="can be written by others"):  # noqa: SIM117
        with controller_lock("10.0.0.5", 502, temporary=tmp_path):
            pass
    folder.chmod(0o700)
    (folder / "10.0.0.5_502.lock").symlink_to(theirs)
    with pytest.raises(LockUnusable, match="symbolic link"):  # noqa: SIM117
        with controller_lock("10.0.0.5", 502, temporary=tmp_path):
            pass
    assert theirs.read_text() == "precious"
