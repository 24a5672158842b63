"""Runs all benchmarks, and writes their tables and pictures into README.md.

    .venv/bin/python -m benchmarks [--only fleet link] [--folder /var/lib/lift-manager]

Takes about 25 minutes, and is worth most on a computer with two cores that does nothing else. What one of them found is written as soon
as it has ended, so it can be stopped, and single ones can be run again. With --quick every benchmark is played as short as it can be:
its figures mean nothing, and are written nowhere unless --into names a folder.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from shutil import which

from benchmarks.common import ROOT, Figure, Figures
from benchmarks.pictures import cost_lines, latencies

HERE = Path(__file__).parent
README = "README.md"
BEGIN, END = "<!-- begin: written by `python -m benchmarks` -->", "<!-- end -->"
COLUMNS = "| measure | figure | beside it | times | to reach |\n|---|---|---|---|---|\n"
Arguments = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Benchmark:
    """One file of this folder, and how it is run."""

    name: str
    quick: Arguments
    """Arguments with which it ends as soon as it can."""
    full: tuple[Arguments, ...] = ((),)
    """Arguments of each run of it."""
    on_disk: bool = False
    """Whether it measures the disk of a folder."""
    module: str = "uvloop"
    """What has to be installed."""
    program: str = "sh"

    @property
    def lacks(self) -> str:
        """What it needs and this computer does not have; empty if nothing."""
        if find_spec(self.module) is None:
            return self.module
        return "" if which(self.program) else self.program


BENCHMARKS = (
    Benchmark("startup", ("--rounds", "1", "--lifts", "2", "--settle", "0")),
    Benchmark("link", ("--rounds", "1", "--polls", "10", "--beat", "2")),
    Benchmark(
        "fleet",
        ("--lifts", "2", "3", "--seconds", "0.2", "--rounds", "1"),
        (("--lifts", "100", "500", "1000", "1500", "2000", "2500"),),
    ),
    Benchmark(
        "small_pc",
        ("--neighbours", "1", "--lifts", "2", "--seconds", "0.2", "--presses", "1", "--rounds", "1"),
        on_disk=True,
    ),
    Benchmark(
        "gateway",
        ("--request-ms", "10", "--seconds", "1", "--presses", "1"),
        ((), ("--ridden", "4", "--request-ms", "40", "100", "200")),
    ),
    Benchmark("plc", ("--seconds", "0.5", "--maps", "generic-registers", "two-stop-agv")),
    Benchmark("journal", ("--presses", "2", "--rounds", "1"), on_disk=True),
    Benchmark("press", ("--presses", "2", "--rounds", "1"), on_disk=True),
    Benchmark("rest", ("--rounds", "1", "--presses", "1", "--seconds", "0.1"), on_disk=True),
    Benchmark("lifts", ("--lifts", "2", "--seconds", "0.2", "--rounds", "1")),
    Benchmark("events", ("--streams", "2", "--lifts", "2", "--seconds", "1", "--loop", "uvloop")),
    Benchmark("metrics", ("--lifts", "2", "--seconds", "0.2", "--rounds", "1", "--every", "0.1")),
    Benchmark(
        "rmf",
        ("--lifts", "2", "--times", "2", "--way", "inside", "--at-once"),
        ((), ("--lifts", "50", "--times", "12", "--way", "inside", "--at-once")),
        on_disk=True,
        module="cyclonedds",
    ),
    Benchmark("page", ("--lifts", "2", "--seconds", "1", "--view", "/wall"), program="chromium"),
    Benchmark("simulator", ("--seconds", "10", "--rounds", "1")),
)


def play(*words: str) -> None:
    """Play a benchmark in a process of its own: the path of its program, and its arguments."""
    subprocess.run([sys.executable, *words], cwd=ROOT, check=False)  # noqa: S603  our own; 1 where a limit is missed


Play = Callable[..., None]
"""A function like `play`."""


def run(benchmark: Benchmark, play: Play, *, quick: bool, folder: Path | None) -> Figures | None:
    """Run one benchmark, whose output is shown; None if one of its runs found nothing."""
    whole = Figures()
    for arguments in (benchmark.quick,) if quick else benchmark.full:
        more = ("--folder", str(folder)) if benchmark.on_disk and folder is not None else ()
        with tempfile.TemporaryDirectory() as place:
            file = Path(place, "figures.json")
            words = [str(HERE / f"{benchmark.name}.py"), *arguments, *more]
            print(f"== {' '.join(words)}", flush=True)
            play(*words, "--figures", str(file))
            if not file.exists():
                return None
            found = json.loads(file.read_text("utf-8"))
        whole.table.extend(Figure(**line) for line in found["table"])
        whole.latencies_ms.update(found["latencies_ms"])
        whole.lines.update(found["lines"])
    return whole


def pictures(name: str, found: Figures) -> Iterator[tuple[str, str, str]]:
    """Yield the file, the title and the text of each picture."""
    if found.lines:
        title = "CPU of one core by number of lifts, each polled ten times a second"
        yield f"{name}.svg", title, cost_lines(title, found.lines, "lifts", "% of a core")
    for number, (title, samples_ms) in enumerate(found.latencies_ms.items(), 1):
        if len(samples_ms) > 1:
            yield f"{name}-{number}.svg", title, latencies(title, samples_ms)


def section(name: str, found: Figures, began: str) -> str:
    """Return the part of README.md about one benchmark, without its pictures."""
    rows = []
    for line in found.table:
        times = "" if line.times is None else f"**{line.times:.2f}**"
        rows.append(f"| {line.measure} | {line.value} | {line.baseline} | {times} | {line.limit} |\n")
    return f"### `{name}.py`\n\n{began}\n\n{COLUMNS}{''.join(rows)}"


def with_section(readme: str, name: str, text: str) -> str:
    """Put the part about one benchmark in the place of the former one, or where the order wants it."""
    before, begin, rest = readme.partition(BEGIN)
    inside, end, after = rest.partition(END)
    if not (begin and end):
        raise SystemExit(f"{README} has no place for results between {BEGIN} and {END}")
    parts = {
        match[1]: match[0].strip() for match in re.finditer(r"### `(\w+)\.py`\n.*?(?=\n### |\Z)", inside, re.DOTALL)
    }
    parts[name] = text.strip()
    ordered = (parts[benchmark.name] for benchmark in BENCHMARKS if benchmark.name in parts)
    return "\n\n".join((before + begin, *ordered, end + after))


def keep(name: str, found: Figures, began: str, folder: Path) -> None:
    """Write what a benchmark found into README.md of a folder, with its pictures next to it."""
    text = section(name, found, began)
    for stale in (*folder.glob(f"{name}.svg"), *folder.glob(f"{name}-*.svg")):
        stale.unlink()
    for file, title, picture in pictures(name, found):
        (folder / file).write_text(picture, "utf-8")
        text += f"\n{title}:\n\n![{title}]({file})\n"
    readme = folder / README
    readme.write_text(with_section(readme.read_text("utf-8"), name, text), "utf-8")


def describe_run() -> str:
    """Return date, tree and machine, as they are before a benchmark begins."""
    load = os.getloadavg()[0]
    return (
        f"{datetime.now(UTC):%Y-%m-%d}, tree {_tree()}, {os.cpu_count()} cores ({_processor()}), Python {platform.python_version()},"
        f" load {load:.1f}."
    )


def _tree() -> str:
    git = which("git")
    if git is None or not (ROOT / ".git").exists():
        return "without git"

    def output_of(*arguments: str) -> str:
        command = [git, *arguments]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603  our own

    changed = output_of("status", "--porcelain", "--", ":!benchmarks/*.md", ":!benchmarks/*.svg")
    return f"`{output_of('rev-parse', '--short', 'HEAD')}`{' with changes' if changed else ''}"


def _processor() -> str:
    found = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text("utf-8"), re.MULTILINE)
    return found[1].strip() if found else platform.machine()


def main(words: Sequence[str] | None = None, play: Play = play) -> None:
    """Run what is wanted and possible; exits with 1 if one found nothing. The words are those of the command line by default."""
    names: Mapping[str, Benchmark] = {benchmark.name: benchmark for benchmark in BENCHMARKS}
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0], prog="python -m benchmarks")
    parser.add_argument("--only", nargs="+", choices=list(names), default=list(names), metavar="NAME")
    parser.add_argument("--quick", action="store_true", help="as short as can be, to see that each still runs")
    parser.add_argument("--folder", type=Path, help="a folder on the disk to be measured")
    parser.add_argument("--into", type=Path, help="the folder of the README.md to be written; this one by default")
    chosen = parser.parse_args(words)
    into = chosen.into or (None if chosen.quick else HERE)
    failed = []
    for name in chosen.only:
        if lacks := names[name].lacks:
            print(f"== {name}.py is left out, because there is no {lacks}", flush=True)
            continue
        began = describe_run()
        if (found := run(names[name], play, quick=chosen.quick, folder=chosen.folder)) is None:
            failed.append(name)
        elif into is not None:
            keep(name, found, began, into)
    if failed:
        raise SystemExit(f"nothing was found by {', '.join(failed)}: see above")


if __name__ == "__main__":
    main()
