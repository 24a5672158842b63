"""A manager that is killed loses no row that it was told is written."""

import subprocess
import sys
from pathlib import Path
from random import Random

from tests.lift_manager.store.journal_disk import numbers, stored
from tests.support.programs import ROOT

PRESSES = 1_000


def test_every_press_that_was_answered_is_there_after_kill_9(tmp_path: Path) -> None:
    path, random, answered, written = tmp_path / "site.db", Random(0), list[int](), [-1]
    for _ in range(4):  # killed, started on what is left, killed again
        answered += killed_after(path, written[-1] + 1, random.randrange(1, 150), random.uniform(0, 0.004))
        written = numbers(path)
        assert written == sorted(set(written))
        assert set(answered) <= set(written)
        # what was not answered may be there: at most the press that was under way
        assert len(written) - len(answered) <= 4
        stored(path)


def killed_after(path: Path, first: int, answers: int, moment_s: float) -> list[int]:
    """Kill a writer some moment after so many answers; returns the numbers that it said."""
    arguments = [
        sys.executable,
        "-m",
        "tests.lift_manager.store.journal_program",
        str(path),
        str(first),
        str(PRESSES),
        "1",
    ]
    with subprocess.Popen(arguments, cwd=ROOT, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        said = [int(program.stdout.readline()) for _ in range(answers)]
        try:
            program.wait(moment_s)
        except subprocess.TimeoutExpired:
            program.kill()
        said += [int(line) for line in program.stdout if line.endswith("\n")]
    assert len(said) < PRESSES
    return said
