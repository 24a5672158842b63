"""Starts `lift-manager`, or a script that uses it, without the second that its imports take: a process that has imported it forks for each.

Started as a program with a socket as its stdin. Each message on it is one start (`Order`, as JSON) with three open
files: a socket, and what becomes stdout and stderr; a fourth one becomes stdin. Into the socket goes the id of the process, and when that has ended
its exit code. The end of stdin ends the starter, and none of what it started.
"""

import gc
import json
import os
import runpy
import signal
import socket
import sys
import time
from contextlib import suppress
from importlib import import_module
from typing import NoReturn, TypedDict

from lift_manager.cli.main import COMMANDS


class Order(TypedDict):
    """One start."""

    script: str
    """Python to run in the place of `lift-manager`, or empty."""
    words: list[str]
    env: dict[str, str]
    cwd: str


def serve() -> Order | None:
    """Fork for each order; returns it in the process that is to carry it out, and None when no more can come."""
    with socket.socket(fileno=os.dup(0)) as orders:
        while True:
            message, files, _, _ = socket.recv_fds(orders, 2**18, 4)
            if not message:
                return None
            if os.fork():
                for file in files:
                    os.close(file)
                continue
            orders.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            if process := os.fork():
                wait_for(process, files[0])
            if len(files) == 3:
                files.append(os.open(os.devnull, os.O_RDONLY))
            for file, standard in zip(files[1:], (1, 2, 0), strict=True):
                os.dup2(file, standard)
                os.close(file)
            os.close(files[0])
            order: Order = json.loads(message)
            return order


def wait_for(process: int, answers: int) -> NoReturn:
    """Say which process it is, and how it ended; a test that has ended asks no more."""
    with suppress(BrokenPipeError):
        os.write(answers, str(process).encode())
        os.write(answers, str(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])).encode())
    os._exit(0)


def carry_out(order: Order) -> None:
    os.environ.clear()
    os.environ.update(order["env"])
    time.tzset()
    os.chdir(order["cwd"])
    sys.argv[1:] = order["words"]
    if order["script"]:
        exec(order["script"], {"__name__": "__main__"})
        return
    runpy.run_module("lift_manager", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    for module in (f"lift_manager.cli.{place.partition(':')[0]}" for place in COMMANDS.values()):
        import_module(module)
    import_module("typer.rich_utils")  # which typer imports when a first command is built
    gc.freeze()  # else every process copies what it only looks through
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody asks how those that wait have ended
    if start := serve():
        carry_out(start)
