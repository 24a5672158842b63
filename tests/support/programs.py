"""Programs as real processes: started, listened to, told to end, and ended by their id whatever happens."""

import json
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from typer.testing import CliRunner

from lift_manager.cli.main import app
from tests.support.forked import Forked

ROOT = Path(__file__).resolve().parents[2]
LIFT_MANAGER = (sys.executable, "-I", "-m", "lift_manager")
HANGS_S = 120.0
"""Whoever waits for longer waits for nothing; on a busy machine everything takes long, and no test fails because of that."""
OUT_WITHIN_S = 5.0
"""SIGTERM and Ctrl-C: out within this time whatever the controller does, on a machine that has nothing else to do."""
OUT_AT_LAST_S = 60.0
"""The same on a machine that has: what waits for something that never comes takes longer."""

Seen = TypeVar("Seen")


def eventually(look: Callable[[], Seen | None], within_s: float = HANGS_S, every_s: float = 0.02) -> Seen:
    """Look until what is seen is true; return it."""
    pause = threading.Event()
    ends_at = time.monotonic() + within_s
    while not (seen := look()):
        assert time.monotonic() < ends_at, f"not within {within_s:g} s: {look}"
        pause.wait(every_s)
    return seen


def soon(attempt: Callable[[], float], within_s: float) -> None:
    """Attempt it until it takes no longer than this: what it waits for by itself takes long each time, and a busy machine does not."""
    took_s: list[float] = []

    def look() -> bool:
        took_s.append(attempt())
        return took_s[-1] < within_s

    eventually(look)


class Program:
    """One running process. What it prints goes to files, so that it never waits for a reader."""

    def __init__(
        self,
        command: tuple[str, ...],
        folder: Path,
        cwd: Path | None,
        *,
        forked: bool = False,
        more: Mapping[str, str] | None = None,
        stdin: int | None = None,
        script: str = "",
    ) -> None:
        self._out, self._err = folder / "out", folder / "err"
        self._process: subprocess.Popen[bytes] | Forked
        with self._out.open("wb") as out, self._err.open("wb") as err:
            # what a manager remembers over a restart ends with the test, unless its site file names a folder
            env = os.environ | {"XDG_STATE_HOME": str(folder)} | dict(more or {})
            if forked:
                self._process = Forked(
                    command, env=env, cwd=cwd, out=out.fileno(), err=err.fileno(), stdin=stdin, script=script
                )
            else:
                self._process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, cwd=cwd, env=env
                )

    @property
    def out(self) -> str:
        return _text_so_far(self._out)

    @property
    def err(self) -> str:
        return _text_so_far(self._err)

    @property
    def pid(self) -> int:
        return self._process.pid

    def says(self, pattern: str) -> re.Match[str]:
        """Wait until stdout holds this."""

        def look() -> re.Match[str] | None:
            assert self._process.poll() is None, f"ended with {self._process.returncode}: {self.out}{self.err}"
            return re.search(pattern, self.out)

        return eventually(look)

    def logs(self, pattern: str) -> re.Match[str]:
        """Wait until stderr holds this."""
        return eventually(lambda: re.search(pattern, self.err))

    def tell(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def ended(self, within_s: float = HANGS_S) -> int:
        """Wait for its end; returns the exit code."""
        return self._process.wait(within_s)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, float]:
        """Tell it to end; returns the exit code and how long that took."""
        began = time.monotonic()
        self.tell(number)
        return self.ended(), time.monotonic() - began

    def end(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait(HANGS_S)


def _text_so_far(file: Path) -> str:
    """What a process has written; of what it is just writing there may be half a character."""
    return getincrementaldecoder("utf-8")().decode(file.read_bytes())


@contextmanager
def running(*arguments: str | Path, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Iterator[Program]:
    """Run `lift-manager` with these arguments, forked by the starter; ended by its id whatever happens.

    `env` is added to the environment. Its words are shown where a test has failed.
    """
    with _running(tuple(map(str, arguments)), cwd, forked=True, more=env) as program:
        yield program


@contextmanager
def running_script(script: str, *arguments: str | Path, cwd: Path | None = None) -> Iterator[Program]:
    """Run Python that imports what `lift-manager` imports, as `running` does."""
    with _running(tuple(map(str, arguments)), cwd, forked=True, script=script) as program:
        yield program


@contextmanager
def started(*command: str, cwd: Path | None = None) -> Iterator[Program]:
    """Run any program, as `running` does, from its very start."""
    with _running(command, cwd, forked=False) as program:
        yield program


@contextmanager
def _running(
    command: tuple[str, ...],
    cwd: Path | None,
    *,
    forked: bool,
    more: Mapping[str, str] | None = None,
    script: str = "",
) -> Iterator[Program]:
    with TemporaryDirectory() as folder:
        program = Program(command, Path(folder), cwd, forked=forked, more=more, script=script)
        try:
            yield program
        finally:
            program.end()
            # pytest shows it where a test has failed
            sys.stderr.write(f"--- {' '.join(command)}\n{program.out}{program.err}\n")


class Started(ExitStack):
    """Several programs, and what talks to them, that end together."""

    def __call__(
        self, *arguments: str | Path, cwd: Path | None = None, env: Mapping[str, str] | None = None
    ) -> Program:
        return self.enter_context(running(*arguments, cwd=cwd, env=env))


def run(
    *arguments: str | Path, cwd: Path | None = None, env: Mapping[str, str] | None = None, piped: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run `lift-manager` to its end, forked by the starter; `piped` comes through a pipe as its input, and then that ends."""
    words = tuple(map(str, arguments))
    with TemporaryDirectory() as folder, _pipe_with(piped) as stdin:
        program = Program(words, Path(folder), cwd, forked=True, more=env, stdin=stdin)
        try:
            code = program.ended()
        finally:
            program.end()
        return subprocess.CompletedProcess(words, code, program.out, program.err)


@contextmanager
def _pipe_with(text: str) -> Iterator[int]:
    """The end to read of a pipe that holds this."""
    reads, writes = os.pipe()
    with os.fdopen(reads, "rb") as pipe:
        with os.fdopen(writes, "wb") as filled:
            filled.write(text.encode())
        yield pipe.fileno()


def run_anew(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run `lift-manager` to its end from its very start; findings must survive the narrowest and dumbest of terminals."""
    return subprocess.run(
        [*LIFT_MANAGER, *map(str, arguments)],
        cwd=cwd,
        env=_terminal(arguments),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=HANGS_S,
        check=False,
    )


def call(*arguments: str | Path, **env: str) -> subprocess.CompletedProcess[str]:
    """Run `lift-manager` in this process, which spares the two seconds of a start; an exception that is no exit is a failure."""
    words = [str(argument) for argument in arguments]
    result = CliRunner().invoke(app, words, env={**_terminal(arguments), **env})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return subprocess.CompletedProcess(words, result.exit_code, result.stdout, result.stderr)


_FORKS = """
import gc, json, os, runpy, signal, sys

import lift_manager.cli.main, typer.rich_utils
from lift_manager.cli import audit, check, keys, lab, lifts, maps, network, operate, ride, scenario, serve

gc.freeze()  # else every child copies what it only looks through
folder = sys.argv[1]
for number, call in enumerate(json.load(sys.stdin)):
    if child := os.fork():
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
        continue
    signal.alarm(120)  # ends the child if nothing else does
    for standard, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(f"{folder}/{number}.{name}", os.O_WRONLY | os.O_CREAT), standard)
    sys.argv[1:] = call
    runpy.run_module("lift_manager", run_name="__main__", alter_sys=True)
    break
"""
"""Imports everything once, and forks for each call where `run_anew` starts anew, which takes a second."""


def run_each(calls: Sequence[tuple[str, ...]], cwd: Path) -> list[subprocess.CompletedProcess[str]]:
    """Run `lift-manager` to its end with each of these arguments, in a process each; one terminal must suit them all."""
    env = _terminal(calls[0])
    assert all(_terminal(call) == env for call in calls), "the width of the terminal is read when rich is imported"
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-I", "-c", _FORKS, folder]
        codes = subprocess.run(
            command, cwd=cwd, env=env, input=json.dumps(calls), stdout=subprocess.PIPE, text=True, check=True
        ).stdout.split()

        def said(number: int, name: str) -> str:
            return (Path(folder) / f"{number}.{name}").read_text("utf-8")

        return [
            subprocess.CompletedProcess(call, int(code), said(number, "out"), said(number, "err"))
            for number, (call, code) in enumerate(zip(calls, codes, strict=True))
        ]


def _terminal(arguments: Sequence[str | Path]) -> Mapping[str, str]:
    return os.environ | {"COLUMNS": "40" if "check" in arguments else "100", "TERM": "dumb"}


def free_port() -> int:
    """A port that nobody listens on, for what must know its port before it starts.

    None of those that the kernel gives away by itself, on Linux from 32768 on: another test could have it by then.
    """
    while True:
        port = random.SystemRandom().randrange(10_000, 32_768)
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
