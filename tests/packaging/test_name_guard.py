"""The guard at the start: packages of the same name from elsewhere are named before a line of them runs."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SIBLINGS = ("drivers", "register_maps", "simulator")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """An installation that consists of the guard and says `started` where the program would start."""
    home = tmp_path / "home"
    for name in ("lift_manager", *SIBLINGS):
        (home / name).mkdir(parents=True)
        (home / name / "__init__.py").touch()
    shutil.copy(ROOT / "lift_manager" / "__main__.py", home / "lift_manager")
    (home / "lift_manager" / "cli").mkdir()
    (home / "lift_manager" / "cli" / "__init__.py").touch()
    (home / "lift_manager" / "cli" / "main.py").write_text("import drivers\ndef app() -> None:\n    print('started')\n")
    return home


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    (tmp_path / "elsewhere").mkdir()
    return tmp_path / "elsewhere"


def start(home: Path, *, first: Path) -> subprocess.CompletedProcess[str]:
    """Start it with `first` in front of it on Python's path."""
    return subprocess.run(
        [sys.executable, "-m", "lift_manager"],
        cwd=first,
        env=os.environ | {"PYTHONPATH": str(home)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_program_starts_when_every_package_lies_beside_it(home: Path, elsewhere: Path) -> None:
    done = start(home, first=elsewhere)
    assert (done.returncode, done.stdout, done.stderr) == (0, "started\n", "")


@pytest.mark.parametrize("name", SIBLINGS)
def test_a_package_of_the_same_name_from_elsewhere_is_named_and_never_run(
    home: Path, elsewhere: Path, name: str
) -> None:
    (elsewhere / name).mkdir()
    (elsewhere / name / "__init__.py").write_text("print('the intruder ran')")
    done = start(home, first=elsewhere)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.count("\n") == 1
    assert f"package '{name}' resolves to {elsewhere / name}, expected {home / name}" in done.stderr
    assert "python -I -m lift_manager" in done.stderr


def test_a_module_of_the_same_name_is_an_intruder_too(home: Path, elsewhere: Path) -> None:
    (elsewhere / "simulator.py").write_text("print('the intruder ran')")
    done = start(home, first=elsewhere)
    assert (done.returncode, done.stdout) == (1, "")
    assert f"package 'simulator' resolves to {elsewhere / 'simulator.py'}" in done.stderr


def test_a_package_that_is_missing_is_named(home: Path, elsewhere: Path) -> None:
    (home / "register_maps" / "__init__.py").unlink()
    (home / "register_maps").rmdir()
    done = start(home, first=elsewhere)
    assert (done.returncode, done.stdout) == (1, "")
    assert "package 'register_maps' resolves to " in done.stderr
    assert f"expected {home / 'register_maps'}" in done.stderr


def test_nothing_of_ours_is_imported_before_the_guard_has_run() -> None:
    code = "import sys, lift_manager.__main__; print(*(name for name in sys.modules if name.split('.')[0] in sys.argv))"
    done = subprocess.run(
        [sys.executable, "-c", code, "lift_manager", *SIBLINGS], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) == {"lift_manager", "lift_manager.__main__"}
