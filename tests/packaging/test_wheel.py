"""What is installed: the four packages with their data, and nothing else. What a packager gets: all that the tests need."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("lift_manager", "drivers", "register_maps", "simulator")
FOLDERS = (*PACKAGES, ".ci", "benchmarks", "constraints", "deploy", "docs", "examples", "scripts", "tests")
FILES = (".gitignore", "CHANGELOG.md", "LICENSE", "MANIFEST.in", "README.md", "SECURITY.md", "pyproject.toml")
CACHES = (
    "__pycache__",
    ".hypothesis",
    ".mypy_cache",
    ".pytest_cache",
    ".ruff_cache",
    ".import_linter_cache",
    "*.egg-info",
)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy, so that building leaves nothing in the repository, with things lying about that must not be shipped."""
    copy = tmp_path_factory.mktemp("tree")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns(*CACHES))
    for name in FILES:
        shutil.copy(ROOT / name, copy)
    (copy / "drivers" / "__pycache__").mkdir()
    (copy / "drivers" / "__pycache__" / "old.cpython-311.pyc").touch()
    (copy / "drivers" / "old.pyc").touch()
    (copy / "benchmarks" / "__init__.py").touch()
    deep = copy / "lift_manager" / "page" / "deep" / "deeper"
    deep.mkdir(parents=True)
    (deep / "page.html").touch()
    (copy / "lift_manager" / "lab").mkdir(exist_ok=True)
    (copy / "lift_manager" / "lab" / "__init__.py").touch()
    (copy / "lift_manager" / "lab" / "a-site.yaml").touch()
    return copy


def built(kind: str, tree: Path, out: Path) -> Path:
    command = [sys.executable, "-m", "build", f"--{kind}", "--no-isolation", "--outdir", str(out), str(tree)]
    done = subprocess.run(command, cwd=out, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = out.iterdir()
    return path


@pytest.fixture(scope="module")
def wheel(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    with zipfile.ZipFile(built("wheel", tree, tmp_path_factory.mktemp("wheel"))) as opened:
        yield opened


JUNK = (
    "notes.txt",
    "site.yaml",
    ".env",
    ".venv/pyvenv.cfg",
    "scratch/plan.py",
    "tests/.hypothesis/example",
    "tests/__pycache__/test_a.cpython-311.pyc",
    "lift_manager/web/app.py.orig",
    "drivers/.mypy_cache/x.json",
    "deploy/ros/build/log",
)
"""What lies about in a checkout, and is nobody else's business."""


@pytest.fixture(scope="module")
def archive(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[set[str], Path]:
    """The files of the source archive, and the archive unpacked."""
    copy = tmp_path_factory.mktemp("checkout") / "tree"
    shutil.copytree(tree, copy, ignore=shutil.ignore_patterns("*.egg-info", "*.pyc", "__pycache__"))
    shutil.rmtree(copy / "build", ignore_errors=True)  # where the wheel was built before
    for name in JUNK:
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).touch()
    out = tmp_path_factory.mktemp("sdist")
    with tarfile.open(built("sdist", copy, out)) as opened:
        opened.extractall(out, filter="data")
        names = {name.partition("/")[2] for name in opened.getnames() if not opened.getmember(name).isdir()}
    (unpacked,) = (path for path in out.iterdir() if path.is_dir())
    return names, unpacked


def test_the_source_archive_holds_the_repository_and_nothing_that_lies_about(
    archive: tuple[set[str], Path], tree: Path
) -> None:
    names, _ = archive
    ours = {name for name in names if not name.startswith("lift_manager.egg-info/")} - {"PKG-INFO", "setup.cfg"}
    files = (path for folder in FOLDERS for path in (tree / folder).rglob("*") if path.is_file())
    expected = {path.relative_to(tree).as_posix() for path in files if path.suffix != ".pyc"} | {*FILES}
    assert ours == expected


def test_what_is_run_from_the_source_archive_can_be_run(archive: tuple[set[str], Path]) -> None:
    _, unpacked = archive
    for name in (
        "scripts/demo",
        "scripts/test",
        "scripts/pin",
        ".ci/run",
        "deploy/deb/build",
        "deploy/wheelhouse/install",
    ):
        assert os.access(unpacked / name, os.X_OK), name


def test_the_wheel_describes_itself_with_the_readme(wheel: zipfile.ZipFile) -> None:
    head, _, description = wheel.read(f"{info(wheel)}/METADATA").decode().partition("\n\n")
    assert "Description-Content-Type: text/markdown" in head
    assert description.strip() == (ROOT / "README.md").read_text("utf-8").strip()


def shipped(wheel: zipfile.ZipFile) -> set[str]:
    return {name for name in wheel.namelist() if ".dist-info/" not in name}


def info(wheel: zipfile.ZipFile) -> str:
    (found,) = {name.split("/")[0] for name in wheel.namelist() if ".dist-info/" in name}
    return found


def test_the_wheel_holds_the_four_packages_and_nothing_beside_them(wheel: zipfile.ZipFile) -> None:
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert tops == {*PACKAGES, info(wheel)}


def test_every_file_of_the_packages_is_shipped_but_their_readmes_and_byte_code(
    wheel: zipfile.ZipFile, tree: Path
) -> None:
    files = {path for package in PACKAGES for path in (tree / package).rglob("*") if path.is_file()}
    expected = {path.relative_to(tree).as_posix() for path in files if path.suffix not in (".md", ".pyc")}
    assert shipped(wheel) == expected


def test_the_data_that_the_program_reads_at_run_time_is_shipped(wheel: zipfile.ZipFile, tree: Path) -> None:
    maps = {path.relative_to(tree).as_posix() for path in (tree / "register_maps" / "maps").glob("*.yaml")}
    assert maps
    wanted = {
        *maps,
        *(f"{package}/py.typed" for package in PACKAGES),
        "lift_manager/page/deep/deeper/page.html",
        "lift_manager/page/vendor/htm-preact.js",
        "lift_manager/page/vendor/SHA256SUMS",
        "lift_manager/lab/a-site.yaml",
    }
    assert wanted - shipped(wheel) == set()


def test_the_wheel_says_its_licence_its_command_and_that_it_is_not_for_upload(wheel: zipfile.ZipFile) -> None:
    metadata = wheel.read(f"{info(wheel)}/METADATA").decode()
    assert "License-Expression: Apache-2.0" in metadata
    assert "Classifier: Private :: Do Not Upload" in metadata
    assert "Requires-Python: >=3.11" in metadata
    assert f"{info(wheel)}/licenses/LICENSE" in wheel.namelist()
    entry_points = wheel.read(f"{info(wheel)}/entry_points.txt").decode()
    assert "[console_scripts]\nlift-manager = lift_manager.__main__:main\n" in entry_points
    assert "[pytest11]\nlift_manager = lift_manager.lab.pytest_plugin\n" in entry_points
