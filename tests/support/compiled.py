"""Compiles the program and its tests once, before workers start that would each do it for themselves.

    python -m tests.support.compiled

On a fresh checkout that spares each of them twenty seconds of a processor: pytest rewrites the assertions of all tests,
and of `lift_manager` because it brings a plugin of pytest. How it does so is private to pytest; should it change, workers
compile for themselves again, and a test says so.
"""

import compileall
import importlib.util
import os
import re
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from _pytest.assertion.rewrite import PYC_TAIL, _rewrite_test, _write_pyc_fp, get_cache_dir

ROOT = Path(__file__).parents[2]
PACKAGES = ("lift_manager", "drivers", "register_maps", "simulator", "tests")
AT_A_TIME = 20
ONLY_REWRITTEN = re.compile(r"/(test_\w+|conftest)\.py$")
"""What pytest imports, and nobody else."""


def compile_once(root: Path) -> None:
    """Compile what has not been compiled since it was changed, on all processors."""
    files = [file for package in PACKAGES for file in (root / package).rglob("*.py")]
    tests = [file for file in files if is_rewritten(file.relative_to(root)) and not _is_compiled(file)]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for _ in pool.map(rewrite, tests, chunksize=AT_A_TIME):
            pass
    for package in PACKAGES:
        compileall.compile_dir(root / package, quiet=2, workers=os.cpu_count() or 1, rx=ONLY_REWRITTEN)


def is_rewritten(file: Path) -> bool:
    """Whether pytest rewrites the assertions of this file, relative to the top folder."""
    return file.parts[0] == "lift_manager" or file.name == "conftest.py" or file.match("test_*.py")


def compiled_by_pytest(file: Path) -> Path:
    """Return where pytest keeps what it compiled."""
    return get_cache_dir(file) / f"{file.stem}{PYC_TAIL}"


def _is_compiled(file: Path) -> bool:
    try:
        with compiled_by_pytest(file).open("rb") as compiled:
            return compiled.read(16)[8:] == importlib.util.source_hash(file.read_bytes())
    except FileNotFoundError:
        return False


def rewrite(file: Path) -> None:
    """Compile one file as pytest does."""
    source_hash, code = _rewrite_test(file, None)  # type: ignore[arg-type]  # it can do without a configuration
    goal = compiled_by_pytest(file)
    goal.parent.mkdir(exist_ok=True)
    beside = goal.with_name(f"{goal.name}.{os.getpid()}")
    with beside.open("wb") as written:
        _write_pyc_fp(written, source_hash, code)
    beside.replace(goal)


if __name__ == "__main__":
    compile_once(ROOT)
