"""The power fails while the journal is written, on a small scale."""

import sys
from pathlib import Path
from random import Random

import pytest

from tests.campaigns.lossy_disk import (
    CannotTrace,
    CutTo,
    Flushed,
    LossyDisk,
    Made,
    Removed,
    Renamed,
    Said,
    Wrote,
    traced,
)
from tests.campaigns.power_loss import campaign
from tests.support.programs import ROOT

WRITES = """
import os, sys
folder = sys.argv[1]
handle = os.open(f"{folder}/a", os.O_RDWR | os.O_CREAT)
os.pwrite(handle, b"one\\n", 512)
os.fsync(handle)
os.write(1, b"done\\n")
os.ftruncate(handle, 3)
os.close(handle)
handle = os.open(folder, os.O_RDONLY)
os.fsync(handle)
os.rename(f"{folder}/a", f"{folder}/b")
os.unlink(f"{folder}/b")
"""


@pytest.mark.external("strace")
def test_no_row_that_was_answered_is_gone_and_the_journal_verifies_after_a_power_loss() -> None:
    report = campaign(30, 7, per_round=15)
    assert report.findings == []
    assert report.losses == 30
    assert report.rows_answered > 250
    assert report.cuts > 0


@pytest.mark.external("strace")
def test_a_writer_that_flushes_nothing_is_found() -> None:
    assert len(campaign(10, 7, per_round=10, careless=True).findings) > 2


@pytest.mark.external("strace")
def test_what_a_program_does_to_its_files_is_seen_in_order(tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    assert traced([sys.executable, "-c", WRITES, str(folder)], folder, ROOT) == [
        Made("a"),
        Wrote("a", 512, b"one\n"),
        Flushed("a"),
        Said("done\n"),
        CutTo("a", 3),
        Flushed(""),
        Renamed("a", "b"),
        Removed("b"),
    ]


@pytest.mark.external("strace")
def test_a_program_that_cannot_be_traced_to_its_end_is_no_success(tmp_path: Path) -> None:
    with pytest.raises(CannotTrace, match="ended with 3; where it says that ptrace is not permitted"):
        traced([sys.executable, "-c", "raise SystemExit(3)"], tmp_path / "files", ROOT)


def found_after(disk: LossyDisk, tmp_path: Path) -> set[bytes | None]:
    """Lose the power often; returns every content that the file had."""
    found = set()
    for seed in range(200):
        folder = tmp_path / str(seed)
        folder.mkdir()
        disk.fail(Random(seed), folder)
        found.add((folder / "a").read_bytes() if (folder / "a").exists() else None)
    return found


def test_what_was_flushed_is_there_and_of_the_rest_any_sectors_are(tmp_path: Path) -> None:
    (tmp_path / "begin").mkdir()
    (tmp_path / "begin" / "a").write_bytes(b"0" * 512)
    disk = LossyDisk(tmp_path / "begin")
    disk.take(Wrote("a", 0, b"1" * 1024))
    none, first, second, both = b"0" * 512, b"1" * 512, b"0" * 512 + b"1" * 512, b"1" * 1024
    assert found_after(disk, tmp_path / "begin") == {none, first, second, both}
    disk.take(Flushed("a"))
    disk.take(CutTo("a", 100))
    (tmp_path / "end").mkdir()
    assert found_after(disk, tmp_path / "end") == {both, both[:100]}


def test_a_file_that_is_renamed_may_have_either_name_until_its_folder_was_flushed(tmp_path: Path) -> None:
    (tmp_path / "begin").mkdir()
    disk = LossyDisk(tmp_path / "begin")
    for event in (Made("b"), Wrote("b", 0, b"1"), Flushed("b"), Renamed("b", "a")):
        disk.take(event)
    assert found_after(disk, tmp_path / "begin") == {None, b"1"}
    disk.take(Flushed(""))
    (tmp_path / "end").mkdir()
    assert found_after(disk, tmp_path / "end") == {b"1"}


def test_a_name_is_safe_only_once_its_folder_was_flushed(tmp_path: Path) -> None:
    (tmp_path / "begin").mkdir()
    disk = LossyDisk(tmp_path / "begin")
    for event in (Made("a"), Wrote("a", 0, b"1"), Flushed("a")):
        disk.take(event)
    assert found_after(disk, tmp_path / "begin") == {None, b"1"}
    disk.take(Flushed(""))
    (tmp_path / "then").mkdir()
    assert found_after(disk, tmp_path / "then") == {b"1"}
    disk.take(Removed("a"))
    (tmp_path / "end").mkdir()
    assert found_after(disk, tmp_path / "end") == {None, b"1"}
