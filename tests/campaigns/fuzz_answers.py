"""The answer fuzzer: mutated answers to the driver, over the wire Protocol, over real sockets and to whole lifts.

    python -m tests.campaigns.fuzz_answers --memory 1000000 --sockets 20000 --seed 1

Prints a verdict and exits 1 on a finding. A finding names its batch, and `--replay BATCH` runs that one alone: in memory the same
bytes come at the same times, over sockets the same bytes.
"""

from __future__ import annotations

import argparse
import logging
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed

from tests.campaigns.answer_lift import lift_batch
from tests.campaigns.answer_memory import memory_batch
from tests.campaigns.answer_rig import Report
from tests.campaigns.answer_sockets import socket_batch

Batch = Callable[[int, int, int], Report]

PARTS: dict[str, tuple[Batch, int]] = {
    "memory": (memory_batch, 10_000),
    "lifts": (lift_batch, 5_000),
    "sockets": (socket_batch, 2_500),
}
"""Each part, and how many cases make one batch."""
LEAST_TAKEN = 0.1
"""Chosen: about a third of the answers can be taken; with far fewer the fuzz would test the making of connections."""
_SHOWN = 10


class FormatOnly(logging.Handler):
    """Formats every message and throws it away: what cannot be put into words is a finding as well."""

    def emit(self, record: logging.LogRecord) -> None:
        self.format(record)


def batches(part: str, cases: int) -> Iterator[tuple[int, int]]:
    """(number, cases) of each batch of a part."""
    size = PARTS[part][1]
    for number, start in enumerate(range(0, cases, size)):
        yield number, min(size, cases - start)


def run_batch(part: str, seed: int, number: int, cases: int) -> Report:
    """Run one batch in this process."""
    root = logging.getLogger()
    kept, root.handlers, level = root.handlers, [FormatOnly()], root.level
    root.setLevel(logging.DEBUG)
    logging.getLogger("asyncio").setLevel(logging.INFO)
    try:
        return PARTS[part][0](seed, number, cases)
    finally:
        root.handlers = kept
        root.setLevel(level)


def run_part(part: str, seed: int, cases: int, workers: int) -> Report:
    """Run all batches of a part on so many processes."""
    total = Report()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        runs = [pool.submit(run_batch, part, seed, number, count) for number, count in batches(part, cases)]
        for number, done in enumerate(as_completed(runs), start=1):
            total.add(done.result())
            if number % (len(runs) // 10 + 1) == 0:
                sys.stderr.write(f"{part}: {total.cases} of {cases}, {len(total.findings)} finding(s)\n")
    return total


def verdict(part: str, report: Report, wanted: int) -> str:
    """Why a part has failed, in one sentence; empty if it has not."""
    if report.findings:
        return f"{len(report.findings)} finding(s)"
    if report.cases < wanted:
        return f"only {report.cases} of {wanted} cases were put to it"
    if report.taken < LEAST_TAKEN * report.cases:
        return f"only {report.taken} of {report.cases} answers were taken: the {part} part tests too little"
    return ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns.fuzz_answers", description=__doc__)
    parser.add_argument("--memory", type=int, default=1_000_000, help="answers over the wire Protocol, on virtual time")
    parser.add_argument("--lifts", type=int, default=100_000, help="answers to whole lifts, on virtual time")
    parser.add_argument("--sockets", type=int, default=20_000, help="answers over real sockets")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--replay", metavar="BATCH", help="one batch again, as a finding names it: memory:1:37:10000")
    asked = parser.parse_args(arguments)
    if asked.replay:
        part, seed, number, cases = asked.replay.split(":")
        return _tell(part, run_batch(part, int(seed), int(number), int(cases)), int(cases), 0.0)
    failed = 0
    for part, cases in (("memory", asked.memory), ("lifts", asked.lifts), ("sockets", asked.sockets)):
        if cases:
            began = time.monotonic()
            # sockets share one machine's time-outs: two at once would only make each other late
            report = run_part(part, asked.seed, cases, 1 if part == "sockets" else asked.workers)
            failed |= _tell(part, report, cases, time.monotonic() - began)
    return failed


def _tell(part: str, report: Report, wanted: int, took_s: float) -> int:
    for finding in report.findings[:_SHOWN]:
        sys.stdout.write(f"{finding}\n")
    why = verdict(part, report, wanted)
    sys.stdout.write(
        f"{part}: {report.cases} mutated answers, {report.taken} taken, {report.owed} of them owed, "
        f"{len(report.findings)} finding(s), {took_s:.0f} s: {f'FAILED, {why}' if why else 'passed'}\n"
    )
    sys.stdout.flush()
    return 1 if why else 0


if __name__ == "__main__":
    sys.exit(main())
