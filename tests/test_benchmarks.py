"""Benchmarks are for people; here each is played as short as it can be, so that it still runs when somebody needs its figures."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from benchmarks import common
from benchmarks.__main__ import BEGIN, BENCHMARKS, END, main, with_section
from tests.support.programs import HANGS_S, running_script

ROOT = Path(__file__).resolve().parents[1]
SHARED = {"__main__", "common", "pictures"}
NAMES = [
    pytest.param(one.name, marks=pytest.mark.external("chromium")) if one.program == "chromium" else one.name
    for one in BENCHMARKS
]
RUN = "import runpy, sys; del sys.argv[0]; runpy.run_path(sys.argv[0], run_name='__main__')"
README = f"# Benchmarks\n\n{BEGIN}\n\n{END}\n\nHistory\n"


def play_forked(program: str, *words: str) -> None:
    """Play a benchmark in a process that need not import the whole program first."""
    with running_script(RUN, program, *words, cwd=ROOT) as played:
        played.ended(2 * HANGS_S)


@pytest.mark.parametrize("name", NAMES)
def test_every_benchmark_runs_and_its_figures_are_written(name: str, tmp_path: Path) -> None:
    readme, disk = tmp_path / "README.md", tmp_path / "disk"
    readme.write_text(README, "utf-8")
    disk.mkdir()
    main(["--quick", "--only", name, "--into", str(tmp_path), "--folder", str(disk)], play=play_forked)
    written = readme.read_text("utf-8")
    assert f"### `{name}.py`" in written
    figures = [line for line in written.splitlines() if line.startswith("| ") and not line.startswith("| measure ")]
    assert figures
    assert all(re.search(r"\d", line.split("|")[2]) for line in figures), figures
    pictures = set(re.findall(r"\]\((\S+\.svg)\)", written))
    assert {file.name for file in tmp_path.glob("*.svg")} == pictures
    assert all(ET.parse(tmp_path / file).getroot().tag.endswith("svg") for file in pictures)
    assert not list(disk.iterdir())


def test_the_command_refuses_a_benchmark_that_there_is_not() -> None:
    started = "import runpy, sys; sys.path[0] = ''; runpy.run_module('benchmarks', run_name='__main__', alter_sys=True)"
    with running_script(started, "--only", "startups", cwd=ROOT) as played:
        assert played.ended() == 2
        assert "invalid choice: 'startups'" in played.err


def test_the_command_runs_every_benchmark_of_the_folder() -> None:
    files = {file.stem for file in (ROOT / "benchmarks").glob("*.py")}
    names = {benchmark.name for benchmark in BENCHMARKS}
    assert files - SHARED == names
    readme = (ROOT / "benchmarks" / "README.md").read_text("utf-8")
    assert set(re.findall(r"^\| `(\w+)\.py` \| ", readme, re.MULTILINE)) == names
    assert with_section(readme, "rest", "### `rest.py`\n").count("### `rest.py`") == 1


def test_a_benchmark_that_is_run_again_replaces_its_own_figures_alone() -> None:
    once = with_section(with_section(README, "rest", "### `rest.py`\n\none"), "link", "### `link.py`\n\ntwo")
    assert once == f"# Benchmarks\n\n{BEGIN}\n\n### `link.py`\n\ntwo\n\n### `rest.py`\n\none\n\n{END}\n\nHistory\n"
    again = with_section(once, "rest", "### `rest.py`\n\nthree\n\n![four](rest-1.svg)\n")
    assert again == once.replace("one", "three\n\n![four](rest-1.svg)")


def test_a_readme_without_a_place_for_figures_is_left_alone() -> None:
    with pytest.raises(SystemExit, match="no place for results"):
        with_section("# Benchmarks\n", "rest", "### `rest.py`\n")


def test_a_process_of_a_benchmark_that_ends_without_a_figure_ends_the_benchmark() -> None:
    ours, theirs = common.FORK.Pipe(duplex=False)
    process = common.FORK.Process(target=lambda: None)
    process.start()
    with ours, theirs, pytest.raises(SystemExit, match="ended with 0"):
        common.received(ours, process)
    process.join()
