"""Benchmarks are for people; here one is played as short as it can be, so that it still runs when somebody needs its figures."""

import subprocess
import sys
from pathlib import Path

from tests.support.programs import HANGS_S

ROOT = Path(__file__).resolve().parents[1]


def test_the_rest_benchmark_compares_every_program_with_stock(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "benchmarks" / "rest.py"), "--folder", str(tmp_path)]
    tiny = ["--rounds", "1", "--presses", "1", "--seconds", "0.1"]
    done = subprocess.run(
        [*command, *tiny], cwd=tmp_path, capture_output=True, text=True, timeout=2 * HANGS_S, check=False
    )
    assert done.returncode == 0, done.stderr
    _, presses, states = done.stdout.split("\n\n")
    assert [line[:12].strip() for line in presses.splitlines()[2:]] == ["stock", "bare flush", "manager", "no disk"]
    assert [line[:12].strip() for line in states.splitlines()[2:4]] == ["stock", "manager"]
    assert not list(tmp_path.iterdir())
