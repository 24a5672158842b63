"""What the REST interface costs beside what an engineer would write by hand: FastAPI, uvicorn and pymodbus's client.

    python benchmarks/rest.py [--rounds 5] [--presses 12] [--seconds 2] [--folder /var/lib/lift-manager]

Two measures: from POST lift_request to the first byte of the call at the controller, over a new connection each; and GET lift_state
over 64 kept connections, each of which requests again as soon as it has its answer. Three programs take turns, each in a process of
its own:

stock       a handler that awaits `write_register`, and one that answers with a model from memory: no session, rules or journal
manager     `serve`, journal included, which polls its lift ten times a second
no disk     the same without a store (`MemoryRecorder`), for presses only

This process plays the clients and the controllers, so that both ends of a time are read from one clock; a bare commit of SQLite takes
turns with the presses. Run it on the disk that the site has. It takes about 30 s a round and ends by itself.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import random
import re
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import uvicorn
import uvloop
from fastapi import FastAPI, HTTPException
from pydantic import BaseModel
from pymodbus.client import AsyncModbusTcpClient

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from benchmarks.journal import bare
from lift_manager import app as lift_manager
from lift_manager.config.load import load_site
from lift_manager.plain.signals import stop_on_signals
from lift_manager.web.server import listen

STOCK, MANAGER, NO_DISK, FLUSH = "stock", "manager", "no disk", "bare flush"
CLIENTS = 64
SETTLE_S = 0.5
"""Connections open, caches fill."""
TURN_S = tuple(seconds / 4 for seconds in common.PRESS_PAUSE_S)
"""Between two presses, of four contestants."""
ROUND_WITHIN_S = 300.0
"""What takes longer is an error, and no measurement."""
CONTENT_LENGTH = re.compile(rb"content-length: (\d+)", re.IGNORECASE)

Figures = Mapping[str, tuple[float, ...]]
"""Of each program."""
Started = Callable[[int], None]
"""Called with the id of a process."""
Press = Callable[[int], Awaitable[float | None]]
"""Calls the car to a floor by its code; returns the seconds until the controller knows, or None if refused."""


class LiftRequest(BaseModel):
    """The body of a request."""

    floor: str
    door_state: Literal[0, 2]


class RequestReply(BaseModel):
    """Whether it was sent."""

    data: dict[str, str] = {}
    success: bool = True
    msg: str = ""


class LiftState(BaseModel):
    """One lift."""

    available_floors: list[str]
    current_floor: str
    destination_floor: str
    door_state: int
    motion_state: int


class StateReply(BaseModel):
    """The state, in the envelope of the workshop's API."""

    data: LiftState
    success: bool = True
    msg: str = ""


def stock_app(port: int) -> FastAPI:
    """Return the application by hand, for the controller at this port."""
    idle = LiftState(
        available_floors=list(common.FLOORS), current_floor="L1", destination_floor="L1", door_state=0, motion_state=0
    )
    states = {"lift": idle}

    @contextlib.asynccontextmanager
    async def connected(app: FastAPI) -> AsyncIterator[None]:
        app.state.client = client = AsyncModbusTcpClient("127.0.0.1", port=port)
        await client.connect()
        yield
        client.close()

    app = FastAPI(lifespan=connected)

    @app.get("/open-rmf/demo-lift/lift_state")
    async def lift_state(lift_name: str) -> StateReply:
        if (state := states.get(lift_name)) is None:
            raise HTTPException(404)
        return StateReply(data=state)

    @app.post("/open-rmf/demo-lift/lift_request")
    async def lift_request(lift_name: str, request: LiftRequest) -> RequestReply:
        code = common.FLOORS.get(request.floor)
        if lift_name not in states or code is None:
            raise HTTPException(404)
        if (await app.state.client.write_register(common.GO_TO, code)).isError():
            raise HTTPException(502)
        return RequestReply()

    return app


def serve_stock(port: str) -> None:
    """Serve the application by hand, as `uvicorn --loop uvloop --http httptools --no-access-log` does."""
    config = uvicorn.Config(
        stock_app(int(port)), loop="uvloop", http="httptools", access_log=False, log_level="warning"
    )
    with listen("127.0.0.1", 0) as sock:
        _report_ready(sock)
        uvicorn.Server(config).run(sockets=[sock])


def serve_without_disk(site: str) -> None:
    """Run the manager of a site file as `serve` does, but without its store."""
    loaded = load_site(Path(site))

    async def run() -> None:
        stop = asyncio.Event()
        stop_on_signals(stop)
        await lift_manager.run(loaded, sock, stop=stop, ready=partial(_report_ready, sock))

    with listen("127.0.0.1", 0) as sock, asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(run())


def _report_ready(sock: socket.socket) -> None:
    print(f"http://127.0.0.1:{sock.getsockname()[1]}/docs", flush=True)


SERVERS: dict[str, Callable[[str], None]] = {STOCK: serve_stock, NO_DISK: serve_without_disk}
"""Programs that this file is itself, with `--serve` and an argument."""


class Client(asyncio.Protocol):
    """One connection that requests the state again as soon as it has an answer; records how long each state took.

    On a computer too busy to read the lift in time the manager answers without one.
    """

    def __init__(self, answers: list[float], lost: asyncio.Event) -> None:
        self._answers = answers
        self._lost = lost
        self._length = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Make the first request."""
        self._transport = transport
        self._request()

    def data_received(self, data: bytes) -> None:
        """Take an answer, once it is whole; all of them are as long as the newest, mostly, which saves this process the work."""
        self._received += data
        if len(self._received) != self._length:
            head, _, body = self._received.partition(b"\r\n\r\n")
            length = CONTENT_LENGTH.search(head)
            if length is None or len(body) < int(length[1]):
                return
            self._length = len(self._received)
        if b'"success":true' in self._received:
            self._answers.append(time.monotonic() - self._requested_at)
        self._request()

    def connection_lost(self, exc: Exception | None) -> None:
        """Do not go on without it."""
        self._lost.set()

    def _request(self) -> None:
        self._received, self._requested_at = b"", time.monotonic()
        self._transport.write(common.STATE_REQUEST % b"lift")  # type: ignore[attr-defined]  # it is a transport for writing


async def load(server: common.LiftServer, process: int, seconds: float) -> tuple[float, float, float, float]:
    """Let all clients request as fast as they can.

    Returns states a second, the CPU time of the process for each in microseconds, the 99th percentile in ms, and polls of the lift a
    second. The CPU time depends less on what else this computer does.
    """
    loop, answers, lost = asyncio.get_running_loop(), list[float](), asyncio.Event()
    make = partial(Client, answers, lost)
    async with asyncio.timeout(common.READY_WITHIN_S):
        transports = [(await loop.create_connection(make, "127.0.0.1", server.port))[0] for _ in range(CLIENTS)]
    await asyncio.sleep(SETTLE_S)
    answers.clear()
    began, reads, cpu_s = time.monotonic(), server.controller.reads, common.cpu_s(process)
    await asyncio.sleep(seconds)
    while not (lost.is_set() or (answers and common.cpu_s(process) > cpu_s)):  # noqa: ASYNC110  a busy computer: nothing to measure yet
        await asyncio.sleep(seconds)
    took, cpu_s, reads = time.monotonic() - began, common.cpu_s(process) - cpu_s, server.controller.reads - reads
    found = sorted(answers)
    if lost.is_set() or not found:
        raise SystemExit("a connection was lost" if found else "there was no state in any answer")
    for transport in transports:
        transport.abort()
    return len(found) / took, cpu_s / len(found) * 1e6, found[len(found) * 99 // 100] * 1e3, reads / took


async def press_in_turns(contestants: dict[str, Press], presses: int) -> Figures:
    """Return p50 and p90 of each contestant, in milliseconds."""
    dice = random.Random(1)
    took: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(common.PRESS_ATTEMPTS * presses):
        for name, press in contestants.items():
            if (seconds := await press(2 + len(took[name]) % 2)) is not None:
                took[name].append(seconds * 1e3)
            await asyncio.sleep(dice.uniform(*TURN_S))
        if all(len(found) > presses for found in took.values()):
            break
    else:
        raise SystemExit("too many requests were refused: this computer is too busy to read a lift in time")
    # with the first press a manager waits until the controller has granted robot mode
    measured = {name: sorted(found[1 : presses + 1]) for name, found in took.items()}
    return {name: (statistics.median(found), found[presses * 9 // 10]) for name, found in measured.items()}


@contextlib.asynccontextmanager
async def flush(folder: Path) -> AsyncIterator[Press]:
    """A bare commit, in the place of a press."""
    async with bare(folder) as commit:

        async def press(_: int) -> float:
            began = time.monotonic()
            await commit()
            return time.monotonic() - began

        yield press


@dataclass(frozen=True, slots=True)
class Round:
    """What one round found."""

    presses: Figures
    """p50 and p90, in milliseconds."""
    states: Figures
    """What `load` returns."""


async def measure(folder: Path, core: int | None, loaded: Sequence[str], chosen: argparse.Namespace) -> Round:
    """Start every program, load those that are named one after the other, then let all press in turns."""
    processes: dict[str, int] = {}
    note = partial(partial, processes.__setitem__)
    programs: dict[str, Callable[[int], common.Program]] = {
        STOCK: lambda port: _own_program(STOCK, str(port), core, note(STOCK)),
        MANAGER: partial(common.manager, _made(folder / MANAGER), core=core, started=note(MANAGER)),
        NO_DISK: partial(_without_disk, _made(folder / NO_DISK), core, note(NO_DISK)),
    }
    async with asyncio.timeout(ROUND_WITHIN_S), contextlib.AsyncExitStack() as ends:
        servers = {name: await ends.enter_async_context(common.serving(make)) for name, make in programs.items()}
        states = {name: await load(servers[name], processes[name], chosen.seconds) for name in loaded}
        # as far behind the manager as can be: what that writes at the end of a press is on the disk by then
        contestants: dict[str, Press] = {
            STOCK: servers[STOCK].press,
            FLUSH: await ends.enter_async_context(flush(folder)),
        }
        contestants |= {name: servers[name].press for name in (MANAGER, NO_DISK)}
        return Round(await press_in_turns(contestants, chosen.presses), states)


def _without_disk(folder: Path, core: int | None, started: Started, port: int) -> common.Program:
    return _own_program(NO_DISK, str(common.site_file(folder, {"lift": port}, common.POLL_S)), core, started)


def _own_program(name: str, argument: str, core: int | None, started: Started) -> common.Program:
    program = (__file__, "--serve", name, argument)
    return common.running(pattern=common.SERVES, program=program, core=core, started=started)


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def show(first: str, second: str, form: str, rounds: Sequence[Figures]) -> None:
    """Print median figures, and how many times those of stock they are: in the median round, and the range of all rounds."""
    print(f"{first:>42}{second:>9}{f'{first}/stock':>12}{f'{second}/stock':>29}")
    for name in sorted(rounds[0], key=STOCK.__ne__):
        figures, ratios = "", ""
        for place in range(2):
            figures += f"{statistics.median(one[name][place] for one in rounds):>9{form}}"
            times = sorted(one[name][place] / one[STOCK][place] for one in rounds)
            ratios += f"{statistics.median(times):>12.2f}{f' ({times[0]:.2f} to {times[-1]:.2f})':<17}"
        print(f"{name:<33}{figures}{ratios}")


def figures_of(rounds: Sequence[Round]) -> common.Figures:
    """Return the medians of all rounds."""
    figures = common.Figures()
    p50 = {name: statistics.median(one.presses[name][0] for one in rounds) for name in rounds[0].presses}
    for name, limit in ((MANAGER, "at most 1.5, plus one flush"), (NO_DISK, "at most 1.0"), (FLUSH, "")):
        times = statistics.median(one.presses[name][0] / one.presses[STOCK][0] for one in rounds)
        measure = f"POST lift_request to the first byte of the call: {name}"
        figures.add(measure, f"{p50[name]:.2f} ms", f"{STOCK} {p50[STOCK]:.2f} ms", times, limit)
    rate = {name: statistics.median(one.states[name][0] for one in rounds) for name in rounds[0].states}
    times = statistics.median(one.states[MANAGER][0] / one.states[STOCK][0] for one in rounds)
    measure = f"GET lift_state over {CLIENTS} connections: answers a second"
    figures.add(measure, f"{rate[MANAGER]:,.0f}", f"{STOCK} {rate[STOCK]:,.0f}", times, "at least 3")
    cpu_us = {name: statistics.median(one.states[name][1] for one in rounds) for name in rounds[0].states}
    times = statistics.median(one.states[MANAGER][1] / one.states[STOCK][1] for one in rounds)
    figures.add(
        f"GET lift_state over {CLIENTS} connections: CPU of an answer",
        f"{cpu_us[MANAGER]:.1f} us",
        f"{STOCK} {cpu_us[STOCK]:.1f} us",
        times,
        "at most 0.33",
    )
    return figures


def main() -> None:
    """Measure every round, print, end."""
    parser = common.parser(__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--presses", type=int, default=12, help="in each round, of each program")
    parser.add_argument("--seconds", type=float, default=2.0, help="of load in each round, on each program")
    parser.add_argument("--folder", type=Path, default=None, help="a folder on the disk to be measured")
    parser.add_argument("--serve", nargs=2, metavar=("PROGRAM", "ARGUMENT"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.serve is not None:
        name, argument = chosen.serve
        SERVERS[name](argument)
        return
    core, other = common.two_cores()
    common.pin(other)
    print(
        "not pinned" if core is None else f"programs on core {core}, clients and controllers on core {other}",
        flush=True,
    )
    rounds = []
    for number in range(chosen.rounds):
        loaded = (STOCK, MANAGER) if number % 2 else (MANAGER, STOCK)
        with (
            tempfile.TemporaryDirectory(dir=chosen.folder) as folder,
            asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
        ):
            rounds.append(runner.run(measure(Path(folder), core, loaded, chosen)))
    print(
        f"{chosen.rounds} rounds of {chosen.presses} presses and {chosen.seconds:g} s of load;"
        f" {os.cpu_count()} cores with a load of {os.getloadavg()[0]:.1f}"
    )
    print("\nPOST lift_request -> first byte of the call, ms, a new connection each")
    show("p50", "p90", ".2f", [one.presses for one in rounds])
    print(f"\nGET lift_state, {CLIENTS} connections: states a second, us of CPU for each")
    show("rate", "CPU", ".1f", [one.states for one in rounds])
    figures_of(rounds).write(chosen.figures)
    polls = statistics.median(one.states[MANAGER][3] for one in rounds)
    print(
        f"meanwhile the manager polled its lift {polls:.1f} times a second, of the {1 / common.POLL_S:.0f} that it is set to"
    )


if __name__ == "__main__":
    main()
