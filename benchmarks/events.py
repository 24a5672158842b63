"""What listeners cost: 500 event streams of 10 events a second each and 200 requests a second, while 100 lifts are polled ten times a second.

    python benchmarks/events.py [--streams 500] [--rate 10] [--requests 200] [--lifts 100] [--seconds 10] [--loop uvloop asyncio]

Three processes on loopback: the manager with its web server, on a core of its own if there are two, the controllers, and the clients. The
lag of an event is from its publication in the manager until the kernel has its bytes for the client, by the clock of the computer. It ends
by itself after about 20 s for each loop, with 1 where the 99th percentile is not below 15 ms.
"""

from __future__ import annotations

import asyncio
import gc
import os
import random
import re
import select
import socket
import statistics
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeVar

import uvloop

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from benchmarks.common import POLL_S
from lift_manager.app import ManagerParts
from lift_manager.runtime.bus import StateChanged
from lift_manager.web.app import make_app
from lift_manager.web.connections import ConnectionLimits
from lift_manager.web.server import listen, serve

SETTLE_S = 3.0
"""Streams open, caches fill."""
WITHIN_S = 0.015
"""The limit of the 99th percentile."""
CLIENTS = 20
"""Connections over which requests are made."""
LOOPS: dict[str, Callable[[], asyncio.AbstractEventLoop]] = {
    "uvloop": uvloop.new_event_loop,
    "asyncio": asyncio.new_event_loop,
}
PUBLISHED = re.compile(rb"published at ([0-9.]+) s")
STAMP = 35
"""SO_TIMESTAMPNS of Linux, for which Python 3.11 has no name."""
STAMP_BYTES = socket.CMSG_SPACE(struct.calcsize("ll"))
READ_BYTES = 64 * 1024
STREAM_REQUEST = b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n"


@dataclass(frozen=True, slots=True)
class Plan:
    """The load of one round."""

    streams: int
    rate: float
    """Events of one stream a second."""
    requests: float
    """A second, together."""
    seconds: float


@dataclass(frozen=True, slots=True)
class Received:
    """What the clients received."""

    lags: list[float]
    """Seconds from publication to arrival, of every event of every stream."""
    lost: int
    answers: list[float]
    """Seconds from a request to the first byte of its answer."""


@dataclass(frozen=True, slots=True)
class Cost:
    """The cost to the manager."""

    core: float
    """CPU time over wall time."""
    polls_per_s: float
    events: int
    """Published."""


AnyClient = TypeVar("AnyClient", "Listener", "Requester")


class Client:
    """One connection of the clients. The kernel notes when data arrives, so the clients may read late and keep out of the manager's way."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setsockopt(socket.SOL_SOCKET, STAMP, 1)
        self.socket.setblocking(False)

    def received(self) -> tuple[bytes, float]:
        """Return what has come, and by the clock of the computer when the last of it came; nothing at the end of the connection."""
        data, notes, _, _ = self.socket.recvmsg(READ_BYTES, STAMP_BYTES)
        return data, next((_seconds(note) for _, kind, note in notes if kind == STAMP), 0.0)


class Listener(Client):
    """One event stream: records the age of each event on receipt, and nothing else."""

    def __init__(self, port: int, lags: list[float]) -> None:
        super().__init__(port)
        self._lags = lags
        self.lost = 0
        self.socket.sendall(STREAM_REQUEST)

    def read(self) -> None:
        """Take what has come: an event is one packet."""
        data, at = self.received()
        if not data:
            raise SystemExit("the manager has ended a stream")
        self.lost += data.count(b"event: lost")
        self._lags += [at - float(published) for published in PUBLISHED.findall(data)]


class Requester(Client):
    """One connection over which requests are made, one after the other."""

    def __init__(self, port: int, answers: list[float]) -> None:
        super().__init__(port)
        self._answers = answers
        self._requested_at: float | None = None
        self.is_closed = False

    def request(self, lift: str) -> None:
        """Request the state of a lift, unless an answer is still awaited."""
        if self._requested_at is None:
            self._requested_at = time.time()
            self.socket.sendall(common.STATE_REQUEST % lift.encode())

    def read(self) -> None:
        """Take an answer, which is one packet."""
        data, at = self.received()
        if not data:
            self.is_closed = True
            self.socket.close()
        elif self._requested_at is not None:
            self._answers.append(at - self._requested_at)
        self._requested_at = None


def _seconds(stamp: bytes) -> float:
    seconds, nanoseconds = struct.unpack("ll", stamp)
    return float(seconds + nanoseconds * 1e-9)


def _clients(port: int, lifts: list[str], plan: Plan, core: int | None, pipe: Connection) -> None:
    """Run the process of the clients: open everything, settle, count for so many seconds, send the result."""
    common.pin(core)
    common.allow_files(plan.streams + CLIENTS)
    gc.disable()  # what was imported before the fork is much to look through
    lags, answers, dice = list[float](), list[float](), random.Random(1)
    clients: dict[int, Listener | Requester] = {}
    readable = select.epoll()

    def connected(client: AnyClient) -> AnyClient:
        clients[client.socket.fileno()] = client
        readable.register(client.socket, select.EPOLLIN)
        return client

    listeners = [connected(Listener(port, lags)) for _ in range(plan.streams)]
    requesters = [connected(Requester(port, answers)) for _ in range(CLIENTS)]
    pipe.send("open")
    due = time.monotonic()
    begins, number, counting = due + SETTLE_S, 0, False
    while due < begins + plan.seconds:
        due += 1 / plan.requests
        time.sleep(max(0.0, due - time.monotonic()))
        if requesters[number % CLIENTS].is_closed:
            # the server closes what was silent for some seconds, as this process may be on a busy computer
            requesters[number % CLIENTS] = connected(Requester(port, answers))
        requesters[number % CLIENTS].request(dice.choice(lifts))
        number += 1
        for ready, _ in readable.poll(0):
            clients[ready].read()
        if not counting and due >= begins:
            counting = True
            lags.clear()
            answers.clear()
    pipe.send(Received(lags, sum(listener.lost for listener in listeners), answers))


async def _publish(building: ManagerParts, rate: float, until: float) -> int:
    """Let a lift change so many times a second; when that was is in the event."""
    loop, site = asyncio.get_running_loop(), building.site
    state = site.state(site.lift_names()[0])
    due, count = loop.time(), 0
    while loop.time() < until:
        due += 1 / rate
        await asyncio.sleep(max(0.0, due - loop.time()))
        building.bus.publish(StateChanged(state.lift, replace(state, reason=f"published at {time.time():.6f} s")))
        count += 1
    return count


async def measure(ports: list[int], plan: Plan, clients: Connection, port_of: Connection) -> Cost:
    """Run the manager under load."""
    loop, building = asyncio.get_running_loop(), common.building(ports, POLL_S)
    sock = listen("127.0.0.1", 0)
    async with asyncio.TaskGroup() as group:
        works = [link.run() for link in building.links]
        app = make_app(building.site, streams=plan.streams, host_names=("lifts",))
        works += [building.life.run(), serve(app, sock, limits=ConnectionLimits.of(plan.streams + 2 * CLIENTS))]
        tasks = [group.create_task(work) for work in works]
        gc.freeze()  # as `serve` does
        port_of.send((sock.getsockname()[1], building.site.lift_names()))
        while not clients.poll():  # noqa: ASYNC110  a pipe from another process
            await asyncio.sleep(0.05)
        clients.recv()
        await _publish(building, plan.rate, loop.time() + SETTLE_S)
        began, cpu, polls = time.monotonic(), time.process_time(), sum(building.life.polls().values())
        events = await _publish(building, plan.rate, loop.time() + plan.seconds)
        took, cpu = time.monotonic() - began, time.process_time() - cpu
        polls = sum(building.life.polls().values()) - polls
        for task in tasks:
            task.cancel()
    return Cost(cpu / took, polls / took, events)


def _manager(ports: list[int], plan: Plan, name: str, core: int | None, clients: Connection, pipe: Connection) -> None:
    """The process of the manager."""
    common.pin(core)
    common.allow_files(len(ports) + plan.streams + 2 * CLIENTS)
    with asyncio.Runner(loop_factory=LOOPS[name]) as runner:
        pipe.send(runner.run(measure(ports, plan, clients, pipe)))


def round_of(ports: list[int], plan: Plan, name: str) -> tuple[Cost, Received]:
    """Run a manager and its clients, each in a process of its own."""
    core, others = common.two_cores()
    from_manager, manager = common.FORK.Pipe(duplex=False)
    from_clients, clients = common.FORK.Pipe(duplex=False)
    opened, open_ = common.FORK.Pipe(duplex=False)
    server = common.FORK.Process(target=_manager, args=(ports, plan, name, core, opened, manager), daemon=True)
    server.start()
    port, lifts = common.received(from_manager, server)
    client = common.FORK.Process(target=_clients, args=(port, list(lifts), plan, others, clients), daemon=True)
    client.start()
    try:
        open_.send(common.received(from_clients, client))
        received: Received = common.received(from_clients, client)
        cost: Cost = common.received(from_manager, server)
    finally:
        for process in (client, server):
            process.terminate()
            process.join()
    return cost, received


def show(name: str, cost: Cost, received: Received, plan: Plan) -> bool:
    """Print one round; returns whether the lag is within its limit."""
    lags, answers = (statistics.quantiles(found, n=100) for found in (received.lags, received.answers))
    print(
        f"{name:<9}{cost.polls_per_s:>9.0f}{len(received.lags) / plan.seconds:>10.0f}{lags[49] * 1e3:>9.1f} ms{lags[98] * 1e3:>7.1f} ms"
        f"{max(received.lags) * 1e3:>7.1f} ms{len(received.answers) / plan.seconds:>10.0f}{answers[49] * 1e3:>9.1f} ms{answers[98] * 1e3:>7.1f} ms"
        f"{cost.core:>8.1%}{received.lost:>6}{os.getloadavg()[0]:>7.1f}",
        flush=True,
    )
    return lags[98] < WITHIN_S


def figures_of(found: dict[str, tuple[Cost, Received]], plan: Plan) -> common.Figures:
    """Return what every loop needed."""
    figures = common.Figures()
    for name, (cost, received) in found.items():
        lags, answers = (statistics.quantiles(one, n=100) for one in (received.lags, received.answers))
        load = f"{plan.streams} streams of {plan.rate:g} events a second, {name}"
        figures.add(
            f"{load}: lag of an event",
            f"{lags[49] * 1e3:.1f} ms, p99 {lags[98] * 1e3:.1f} ms",
            limit=f"p99 below {WITHIN_S * 1e3:g} ms",
        )
        figures.add(f"{load}: time of an answer", f"{answers[49] * 1e3:.1f} ms, p99 {answers[98] * 1e3:.1f} ms")
        figures.add(f"{load}: CPU of the manager", f"{cost.core:.0%} of a core")
        figures.picture(f"Lag of an event, {load}", received.lags)
    return figures


def main() -> None:
    """Start the controllers, measure on each loop, print, end."""
    parser = common.parser(__doc__)
    parser.add_argument("--streams", type=int, default=500)
    parser.add_argument("--rate", type=float, default=10.0, help="events a second of each stream")
    parser.add_argument("--requests", type=float, default=200.0, help="a second, together")
    parser.add_argument("--lifts", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=10.0, help="measured in each round")
    parser.add_argument("--loop", choices=sorted(LOOPS), nargs="+", default=["uvloop", "asyncio"])
    chosen = parser.parse_args()
    plan = Plan(chosen.streams, chosen.rate, chosen.requests, chosen.seconds)
    common.allow_files(2 * chosen.lifts)
    print(
        f"{'loop':<9}{'polls/s':>9}{'events/s':>10}{'lag p50':>12}{'p99':>10}{'max':>10}{'answers/s':>10}{'p50':>12}{'p99':>10}"
        f"{'core':>8}{'lost':>6}{'load':>7}",
        flush=True,
    )
    with common.controllers(chosen.lifts, 5, common.two_cores()[1]) as ports:
        found = {name: round_of(ports, plan, name) for name in chosen.loop}
    good = [show(name, *one, plan) for name, one in found.items()]
    figures_of(found, plan).write(chosen.figures)
    if not all(good):
        raise SystemExit(f"the 99th percentile of the lag is not below {WITHIN_S * 1e3:.0f} ms")


if __name__ == "__main__":
    main()
