"""What is installed: the four packages with their data, and nothing else."""

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("lift_manager", "drivers", "register_maps", "simulator")


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy, so that building leaves nothing in the repository, with things lying about that must not be shipped."""
    copy = tmp_path_factory.mktemp("tree")
    for name in (*PACKAGES, "tests", "scripts"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    (copy / "drivers" / "__pycache__").mkdir()
    (copy / "drivers" / "__pycache__" / "old.cpython-311.pyc").touch()
    (copy / "drivers" / "old.pyc").touch()
    (copy / "benchmarks").mkdir()
    (copy / "benchmarks" / "__init__.py").touch()
    static = copy / "lift_manager" / "web" / "static" / "deep" / "deeper"
    static.mkdir(parents=True)
    (static / "page.html").touch()
    (copy / "lift_manager" / "lab").mkdir(exist_ok=True)
    (copy / "lift_manager" / "lab" / "__init__.py").touch()
    (copy / "lift_manager" / "lab" / "a-site.yaml").touch()
    return copy


@pytest.fixture(scope="module")
def wheel(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(tree)]
    done = subprocess.run(command, cwd=out, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = out.glob("*.whl")
    with zipfile.ZipFile(path) as opened:
        yield opened


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
        "lift_manager/web/static/deep/deeper/page.html",
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
