"""The part of `subprocess.Popen` that tests need, for a `lift-manager`, or a script that uses it, that the starter forks."""

import atexit
import functools
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.support.starter import Order

STARTER = Path(__file__).with_name("starter.py")
STARTS_WITHIN_S = 120.0
TERMINAL = {"COLUMNS": "100", "TERM": "dumb"}
"""Of all that the starter starts: the program reads how wide it is when it is imported."""


class Forked:
    """A running process."""

    def __init__(
        self,
        words: Sequence[str],
        *,
        env: Mapping[str, str],
        out: int,
        err: int,
        cwd: Path | None = None,
        stdin: int | None = None,
        script: str = "",
    ) -> None:
        """Start it, or the script, with these open files; nothing can be read from a `stdin` that is not given."""
        self._words = words
        self._code: int | None = None
        order = Order(script=script, words=list(words), env=dict(env), cwd=str(cwd or Path.cwd()))
        self._answers, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            files = [theirs.fileno(), out, err, *(() if stdin is None else (stdin,))]
            socket.send_fds(_starter(), [json.dumps(order).encode()], files)
        self._answers.settimeout(STARTS_WITHIN_S)
        self.pid = int(self._answers.recv(32))

    @property
    def returncode(self) -> int | None:
        return self._code

    def poll(self) -> int | None:
        """Return the exit code, or None while it runs."""
        try:
            return self.wait(0)
        except subprocess.TimeoutExpired:
            return None

    def wait(self, timeout: float) -> int:
        """Wait for its end; returns the exit code. Raises `subprocess.TimeoutExpired`."""
        if self._code is None:
            self._answers.settimeout(timeout)
            try:
                self._code = int(self._answers.recv(32))
            except (TimeoutError, BlockingIOError):
                raise subprocess.TimeoutExpired(list(self._words), timeout) from None
            self._answers.close()
        return self._code

    def send_signal(self, number: signal.Signals) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


@functools.cache
def _starter() -> socket.socket:
    """Start the starter; one serves all tests of this process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        # a session of its own, for Ctrl-C at the terminal of the tests is not meant for it
        process = subprocess.Popen(
            [sys.executable, "-I", str(STARTER)],
            env=os.environ | TERMINAL,
            stdin=theirs.fileno(),
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours
