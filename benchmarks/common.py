"""Shared by the benchmarks: cheap controllers, and a manager of lifts on top of them."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import multiprocessing
import os
import random
import re
import resource
import ssl
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import uvloop

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.tls import LinkTls
from drivers.modbus.wire import PymodbusWire
from lift_manager.app import ManagerParts, build
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lift.config import LiftConfig
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps import frames
from register_maps.codec import compile_map
from register_maps.load import load
from register_maps.words import Table

MAP = "generic-registers"
"""One block, one request a poll."""
FLOORS = {"L1": 1, "L2": 2, "L3": 3}
REGISTERS = 8
STANDING = (1, 1, 1, 1, 0b101, 0, 0)
"""After the alive counter: at floor 1, stopped, door closed, normal, no fire (1) and level, no destination, no call."""
FORK = multiprocessing.get_context("fork")
PICTURED = 5000
"""Measurements of one picture at the most."""
_OTHER_FILES = 100
POLL = frames.frame(frames.read(Table.HOLDING, 0, REGISTERS), 1)
"""A request for the registers of a lift."""
_POLLED = struct.pack(">HH", 0, REGISTERS)
"""First register and number of registers in a request."""

ROOT = Path(__file__).resolve().parents[1]
FLOOR_NAMES = tuple(FLOORS)
ALIVE, FLOOR, MOTION, DOOR, MODE, BITS, DESTINATION, ACCEPTED = range(8)
GO_TO, HOLD_DOOR, ROBOT_MODE = 16, 17, 18
STOPPED, UP = 1, 2
READY_WITHIN_S = 30.0
LAST_WORDS = 4000
"""Characters of the log of a program that failed: 1,000 lifts make a long one."""
START_WITHIN_S = 120.0
"""A program that takes longer to start or to end hangs, and is killed. Chosen: on a busy computer our imports take half a minute."""
SERVES = r"http://[\d.]+:(\d+)/docs"
"""The ready message of `serve`, with its port."""
LIFT_MANAGER = ("-m", "lift_manager")
POLL_S = 0.1
STATE_REQUEST = b"GET /open-rmf/demo-lift/lift_state?lift_name=%s HTTP/1.1\r\nHost: localhost\r\n\r\n"
PRESS_PAUSE_S = (0.7, 1.1)
"""Between two presses of one lift: a press lasts 0.5 s."""
PRESS_WITHIN_S = 30.0
"""What takes longer is an error, and no measurement."""
PRESS_ATTEMPTS = 5
"""For each press at the most."""
_PLC_REGISTERS = 24
_IDLE = {FLOOR: 1, MOTION: 1, DOOR: 1, MODE: 1, BITS: 0b101}
_GRANTED = 0b10


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the tables in README.md."""

    measure: str
    value: str
    """With its unit."""
    baseline: str = ""
    """What was measured beside it in the same run."""
    times: float | None = None
    """How many times the baseline it is."""
    limit: str = ""
    """What is to be reached."""


@dataclass(frozen=True, slots=True)
class Figures:
    """What one run of a benchmark found, for `python -m benchmarks`."""

    table: list[Figure] = field(default_factory=list)
    latencies_ms: dict[str, list[float]] = field(default_factory=dict)
    """What single measurements took, by the title of their picture."""
    lines: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    """The lines of the one picture of cost against number, by name."""

    def add(self, measure: str, value: str, baseline: str = "", times: float | None = None, limit: str = "") -> None:
        """Add a line to the table."""
        self.table.append(Figure(measure, value, baseline, times, limit))

    def picture(self, title: str, seconds: list[float]) -> None:
        """Keep what single measurements took, or as many of them as a picture needs."""
        kept = seconds if len(seconds) <= PICTURED else random.Random(1).sample(seconds, PICTURED)
        self.latencies_ms[title] = [round(one * 1e3, 3) for one in kept]

    def write(self, file: Path | None) -> None:
        """Write everything where `python -m benchmarks` reads it, which gives `--figures`."""
        if file is not None:
            file.write_text(json.dumps(asdict(self)), "utf-8")


def parser(about: str | None) -> argparse.ArgumentParser:
    """Return the parser of a benchmark with this docstring."""
    found = argparse.ArgumentParser(description=(about or "").splitlines()[0])
    found.add_argument("--figures", type=Path, help=argparse.SUPPRESS)
    return found


def building(ports: list[int], poll_s: float) -> ManagerParts:
    """Return a read-only manager of one lift at each port, built as from a site file."""
    lift = {"floors": FLOORS, "poll_s": poll_s}
    site = Site.model_validate(
        {
            "schema": 1,
            "name": "benchmark",
            "controllers": {f"controller{port}": {"host": "127.0.0.1", "port": port, "map": MAP} for port in ports},
            "lifts": {f"lift{port}": {"controller": f"controller{port}", **lift} for port in ports},
        }
    )
    loaded = load(MAP)
    return build(LoadedSite(site, dict.fromkeys(site.lifts, loaded), loaded.path))


def make_link(port: int, tls: LinkTls | None = None) -> Link:
    """Return a link over the real wire."""
    return Link(lambda: PymodbusWire("127.0.0.1", port, tls=tls), name="benchmark")


def make_driver(link: Link) -> ModbusLift:
    """Return the read-only driver of one lift."""
    return ModbusLift(compile_map(load(MAP).map), link, LiftSettings(name="lift", floors=FLOORS, control=False))


def make_actor(driver: ModbusLift) -> LiftActor:
    """Return the manager's actor of that lift."""
    config = LiftConfig(
        name="lift",
        source=driver.source,
        floors=tuple(FLOORS),
        doors_at=dict.fromkeys(FLOORS, driver.capabilities.doors),
        control=False,
        capabilities=driver.capabilities,
    )
    return LiftActor(driver, config, Bus(), MemoryRecorder())


def two_cores() -> tuple[int | None, int | None]:
    """One core for the measured process and one for the controllers; None where the system does not let us choose."""
    try:
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, cores)
    except (AttributeError, OSError):
        return None, None
    return cores[0], cores[-1]


def pin(core: int | None, process: int = 0) -> None:
    """Keep a process on one core, this one by default."""
    if core is not None:
        os.sched_setaffinity(process, {core})


def cpu_s(process: int) -> float:
    """Return the CPU seconds that a process has used, in steps of a hundredth of a second."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def allow_files(connections: int) -> None:
    """Raise the soft limit of open files as far as so many connections need it."""
    needed = connections + _OTHER_FILES
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise SystemExit(
            f"{needed} open files are needed, the limit is {hard}: measure fewer lifts or raise `ulimit -Hn`"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


def received(pipe: Connection, process: BaseProcess) -> Any:
    """Return what a process sends. One that ends without a word would otherwise be waited for without end: others have its pipe open too."""
    wait([pipe, process.sentinel])
    if not pipe.poll():
        process.join()
        raise SystemExit(f"{process.name} ended with {process.exitcode}; its traceback is above")
    return pipe.recv()


@contextlib.contextmanager
def controllers(count: int, beat: int, core: int | None, tls: ssl.SSLContext | None = None) -> Iterator[list[int]]:
    """Run so many controllers in one process of their own, with or without TLS; gives their ports."""
    ours, theirs = FORK.Pipe(duplex=False)
    server = FORK.Process(target=_serve, args=(count, beat, core, theirs, tls), daemon=True)
    server.start()
    theirs.close()
    try:
        yield received(ours, server)
    finally:
        server.terminate()
        server.join()


class _Controller(asyncio.Protocol):
    """Answers a poll with the same image, from precomputed bytes, and any other read with zeros: no output is on."""

    def __init__(self, answers: list[bytes]) -> None:
        self._answers = answers
        self._requests = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        if data[8:12] == _POLLED:
            self._requests += 1
            answer = self._answers[self._requests % len(self._answers)]
        else:
            size = 2 * data[11]
            answer = struct.pack(">HHBBB", 0, 3 + size, data[6], data[7], size) + bytes(size)
        self._transport.write(data[:2] + answer)  # type: ignore[attr-defined]  # a transport for writing


def _serve(count: int, beat: int, core: int | None, pipe: Connection, tls: ssl.SSLContext | None) -> None:
    """Open the ports, send their numbers, and answer until terminated. The alive counter counts every `beat` answers."""
    pin(core)
    head = struct.pack(">HHBBB", 0, 3 + 2 * REGISTERS, 1, 3, 2 * REGISTERS)
    answers = [head + struct.pack(f">{REGISTERS}H", place // beat, *STANDING) for place in range(100 * beat)]

    async def forever() -> None:
        loop = asyncio.get_running_loop()
        servers = [
            await loop.create_server(lambda: _Controller(answers), "127.0.0.1", 0, ssl=tls) for _ in range(count)
        ]
        pipe.send([server.sockets[0].getsockname()[1] for server in servers])
        await loop.create_future()

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(forever())


class Controller(asyncio.Protocol):
    """A lift that stands still, accepts writes, and records when the car is called."""

    def __init__(self) -> None:
        self.registers = [0] * _PLC_REGISTERS
        for address, value in _IDLE.items():
            self.registers[address] = value
        self.reads = 0
        """How many reads it has answered."""
        self._awaited: tuple[int, asyncio.Future[float]] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Answer one request; a link has no second one in flight."""
        head, function = data[:4], data[7]
        if function == 3:
            start, count = struct.unpack(">HH", data[8:12])
            self.reads += 1
            self.registers[ALIVE] = int(2 * time.monotonic()) & 0xFFFF  # twice a second, as in the simulator
            values = struct.pack(f">{count}H", *self.registers[start : start + count])
            self._answer(head, data[6:8] + bytes([2 * count]) + values)
        elif function == 6:
            self._write(*struct.unpack(">HH", data[8:12]))
            self._answer(head, data[6:12])
        else:
            start, count = struct.unpack(">HH", data[8:12])
            for offset, value in enumerate(struct.unpack(f">{count}H", data[13 : 13 + 2 * count])):
                self._write(start + offset, value)
            self._answer(head, data[6:12])

    def called(self, code: int) -> asyncio.Future[float]:
        """Return a future of the time when the car is called to that floor."""
        future: asyncio.Future[float] = asyncio.get_running_loop().create_future()
        self._awaited = code, future
        return future

    def _write(self, address: int, value: int) -> None:
        self.registers[address] = value
        if address == ROBOT_MODE:
            self.registers[BITS] = _IDLE[BITS] | (_GRANTED if value else 0)
            self.registers[MODE] = 2 if value else 1
        if address == GO_TO and value:
            self.registers[DESTINATION] = self.registers[ACCEPTED] = value
            if self._awaited is not None and self._awaited[0] == value and not self._awaited[1].done():
                self._awaited[1].set_result(time.monotonic())

    def _answer(self, head: bytes, rest: bytes) -> None:
        self._transport.write(head + struct.pack(">H", len(rest)) + rest)  # type: ignore[attr-defined]  # a transport for writing


def only(controller: Controller) -> Controller:
    """Return the one protocol object of a controller, which has one connection at a time."""
    return controller


def site_file(folder: Path, ports: Mapping[str, int], poll_s: float) -> Path:
    """Write the site file of one lift at each port, whose state is kept in the folder, too."""
    lift = {"access": "control", "floors": {name: code for code, name in enumerate(FLOOR_NAMES, 1)}, "poll_s": poll_s}
    site = {
        "schema": 1,
        "name": "benchmark",
        "state": "state",
        "controllers": {lift: {"host": "127.0.0.1", "port": port, "map": MAP} for lift, port in ports.items()},
        "lifts": {name: {"controller": name, **lift} for name in ports},
    }
    file = folder / "site.yaml"
    file.write_text(json.dumps(site), "utf-8")  # JSON is YAML
    return file


def memory(process: int | None = None) -> int:
    """Memory of a process in bytes, of this one by default, without what it maps from files: that comes in when it is first used."""
    for line in Path(f"/proc/{process or 'self'}/status").read_text("ascii").splitlines():
        if line.startswith("RssAnon:"):
            return int(line.split()[1]) * 1024
    raise SystemExit("this kernel does not report RssAnon in /proc/PID/status")


@contextlib.contextmanager
def running(
    *arguments: str,
    pattern: str,
    tree: Path = ROOT,
    program: tuple[str, ...] = LIFT_MANAGER,
    core: int | None = None,
    started: Callable[[int], None] | None = None,
) -> Iterator[re.Match[str]]:
    """Run a Python program, the `lift-manager` of a source tree by default, in its own process until the block ends.

    Yields the match of its ready message; calls `started` with the id of the process.
    """
    # the locks of controllers lie in the temporary folder: another manager on this computer may have had one of these ports
    with tempfile.TemporaryFile("w+") as log, tempfile.TemporaryDirectory() as locks:
        process = subprocess.Popen(  # noqa: S603  our own program and arguments
            [sys.executable, *program, *arguments],
            cwd=tree,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            env={**os.environ, "TMPDIR": locks},
        )
        try:
            pin(core, process.pid)
            if started is not None:
                started(process.pid)
            yield _first_match(process, pattern)
        except BaseException:
            log.seek(0)
            print(log.read()[-LAST_WORDS:], file=sys.stderr)
            raise
        finally:
            process.terminate()
            with _killed_if_stuck(process):
                process.wait()


def _first_match(process: subprocess.Popen[str], pattern: str) -> re.Match[str]:
    with _killed_if_stuck(process):
        for line in process.stdout or ():
            if (found := re.search(pattern, line)) is not None:
                return found
        raise SystemExit(f"the program ended with {process.wait()} before it was ready")


@contextlib.contextmanager
def _killed_if_stuck(process: subprocess.Popen[str]) -> Iterator[None]:
    """Kill a process if the block, which waits for it, takes too long."""
    timer = threading.Timer(START_WITHIN_S, process.kill)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


Program = contextlib.AbstractContextManager[re.Match[str]]
"""A program that runs within the context, and the match of its ready message."""


@dataclass(frozen=True, slots=True)
class LiftServer:
    """A running program that serves the workshop's API, and the controller of one of its lifts."""

    controller: Controller
    port: int
    lift: str = "lift"

    async def press(self, code: int) -> float | None:
        """Request a floor over a new connection; return the seconds until the first byte of the call is at the controller.

        None if the request was refused: another floor was requested too often, or the computer is too busy to read its lift in time.
        """
        body = json.dumps({"floor": FLOOR_NAMES[code - 1], "door_state": 2})
        head = f"POST /open-rmf/demo-lift/lift_request?lift_name={self.lift} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(body)}\r\n"
        called, requested_at = self.controller.called(code), time.monotonic()
        async with asyncio.timeout(PRESS_WITHIN_S):
            reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
            writer.write(f"{head}Content-Type: application/json\r\nConnection: close\r\n\r\n{body}".encode())
            _, _, answer = (await reader.read()).partition(b"\r\n\r\n")
            writer.close()
            return await called - requested_at if json.loads(answer)["success"] else None


@contextlib.asynccontextmanager
async def serving(serve: Callable[[int], Program]) -> AsyncIterator[LiftServer]:
    """Play the controller of a lift, and run the program that `serve` makes for the controller's port."""
    controller, program = Controller(), contextlib.ExitStack()
    server = await asyncio.get_running_loop().create_server(partial(only, controller), "127.0.0.1", 0)
    try:
        match = await asyncio.to_thread(program.enter_context, serve(server.sockets[0].getsockname()[1]))
        yield LiftServer(controller, int(match[1]))
    finally:
        await asyncio.to_thread(program.close)
        server.close()


def manager(
    folder: Path,
    port: int,
    *,
    tree: Path = ROOT,
    core: int | None = None,
    started: Callable[[int], None] | None = None,
) -> Program:
    """Run `serve` for the lift at this port, with its journal in the folder; calls `started` with the id of the process."""
    site = site_file(folder, {"lift": port}, POLL_S)
    return running("serve", str(site), "--port", "0", pattern=SERVES, tree=tree, core=core, started=started)
