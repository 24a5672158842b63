"""Tests that need a program from outside: left out where it is absent, except under CI."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).resolve().parents[1] / "conftest.py"
SUITE = """
import pytest

@pytest.mark.external("no-such-lift-tool")
def test_one(): ...

@pytest.mark.external("sh", "no-such-lift-tool")
def test_two(): ...

@pytest.mark.external("sh")
def test_three(): ...

def test_four(): ...
"""


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    shutil.copy(CONFTEST, tmp_path)
    (tmp_path / "test_suite.py").write_text(SUITE)
    (tmp_path / "pytest.ini").write_text("[pytest]\naddopts = --strict-markers\nmarkers = external(*programs): x\n")
    return tmp_path


def run(suite: Path, *args: str, ci: str = "false") -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    # of the plugins only what -n needs: to load the others takes three seconds in each process
    environment |= {"CI": ci, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "xdist", *args]
    return subprocess.run(command, cwd=suite, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["in one process", "in two workers"])
def test_where_a_program_is_absent_its_tests_are_left_out_and_one_line_says_so(
    suite: Path, workers: tuple[str, ...]
) -> None:
    done = run(suite, *workers)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("no-such-lift-tool") == 1
    assert "no-such-lift-tool not found: 2 external test(s) deselected" in done.stdout
    assert "2 passed" in done.stdout


def test_under_ci_an_absent_program_fails_its_tests_and_is_named(suite: Path) -> None:
    done = run(suite, ci="true")
    assert done.returncode == 1
    assert "2 passed, 2 errors" in done.stdout
    assert "no-such-lift-tool not found, and under CI every external test must run" in done.stdout
