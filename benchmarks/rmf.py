"""How long Open-RMF waits for us: from a lift request to the write at the controller, and from a change at the controller to lift_states.

    python benchmarks/rmf.py [--lifts 8] [--times 25] [--poll 0.1] [--way inside beside] [--at-once]

Over real DDS on the loopback interface, with the manager in a process of its own (`serve --rmf`), or with manager and adapter in one
each (`serve` and `rmf`). Beside lift_states the same changes are awaited as events by a client of the REST interface, which then requests
the state from the workshop API. This process plays the controllers and RMF, so that both ends of each time are read from one clock. The journal
is on the disk of --folder. It ends by itself after about 80 s, and with 1 where the 99th percentile of a change or the median of a request is
above the poll period plus 5 ms, or with --at-once the median of a request above 20 ms.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import random
import re
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncGenerator, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from benchmarks.common import (
    FLOOR_NAMES,
    MOTION,
    PRESS_PAUSE_S,
    READY_WITHIN_S,
    SERVES,
    STATE_REQUEST,
    STOPPED,
    UP,
    Controller,
    only,
    running,
    site_file,
)
from lift_manager.rmf.dds import Monitor
from lift_manager.rmf.lift_sessions import REPLAY_S
from lift_manager.rmf.messages import AGV_MODE, DOOR_OPEN, END_SESSION, LiftRequest, LiftState, Time
from lift_manager.rmf.ros_settings import RosSettings

OVERHEAD_S = 0.005
AT_ONCE_S = 0.020
"""Limit of the median of requests that come at one instant."""
LIFT_STATES, EVENT, WORKSHOP = "lift_states", "event at a client", "workshop state"
REQUEST = "request -> controller write"
EVENTS_REQUEST = b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n"
EVENT_DATA = b'data: {"event":"state",'
LONGEST_EVENT = 1 << 20
"""In bytes: the snapshot of all lifts."""
WITHIN_S = 10.0
"""Anything slower is an error, not a measurement."""


class Rmf:
    """RMF's side: records when a lift reports that it moves. Implements `dds.OnlookerHears`, in a thread of Cyclone DDS."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._awaited: dict[str, tuple[int, asyncio.Future[float]]] = {}
        self.lifts_received: set[str] = set()

    def on_state(self, state: LiftState) -> None:
        """Complete the future that waits for this."""
        now = time.monotonic()
        self.lifts_received.add(state.lift_name)
        awaited = self._awaited.get(state.lift_name)
        if awaited is not None and state.motion_state == awaited[0]:
            self._loop.call_soon_threadsafe(_set, awaited[1], now)

    def on_request(self, topic: str, request: LiftRequest) -> None:
        """Ignore requests: there is no other fleet."""

    def on_unreadable(self, text: str) -> None:
        """Stop measuring."""
        raise SystemExit(f"a message that cannot be read: {text}")

    def moving(self, lift: str, motion: int) -> asyncio.Future[float]:
        """Return a future of the time when a lift reports that motion."""
        future: asyncio.Future[float] = self._loop.create_future()
        self._awaited[lift] = motion, future
        return future


class RestClient:
    """A client of the REST interface: records when an event reports that a lift moves, and requests the state of the workshop API."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._awaited: dict[str, tuple[str, asyncio.Future[float]]] = {}

    async def read_events(self) -> None:
        """Read the event stream, and complete the futures that wait for an event."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port, limit=LONGEST_EVENT)
        writer.write(EVENTS_REQUEST)
        async for line in reader:
            if line.startswith(EVENT_DATA):
                now, lift = time.monotonic(), json.loads(line.removeprefix(b"data: "))["lift"]
                motion, future = self._awaited.get(lift["name"], ("", None))
                if future is not None and lift["motion"] == motion:
                    _set(future, now)

    def moving(self, lift: str, motion: str) -> asyncio.Future[float]:
        """Return a future of the time when an event reports that motion of a lift."""
        future: asyncio.Future[float] = asyncio.get_running_loop().create_future()
        self._awaited[lift] = motion, future
        return future

    async def motions(self, lift: str) -> AsyncGenerator[int]:
        """Request the state of a lift each time, over one connection; yields its motion."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
        while True:
            writer.write(STATE_REQUEST % lift.encode())
            head = await reader.readuntil(b"\r\n\r\n")
            length = only_match(rb"content-length: (\d+)", head)
            yield json.loads(await reader.readexactly(int(length)))["data"]["motion_state"]


@dataclass
class Times:
    """What was measured, in seconds."""

    requests: list[float] = field(default_factory=list)
    changes: dict[str, list[float]] = field(default_factory=lambda: {LIFT_STATES: [], EVENT: [], WORKSHOP: []})


def only_match(pattern: bytes, text: bytes) -> bytes:
    """Return what the group of the pattern matches."""
    found = re.search(pattern, text)
    if found is None:
        raise SystemExit(f"{text!r} has no {pattern!r}")
    return found[1]


def _set(future: asyncio.Future[float], now: float) -> None:
    if not future.done():
        future.set_result(now)


@contextlib.contextmanager
def _manager(process_layout: str, site: Path) -> Iterator[int]:
    """Run it and give its port."""
    rmf_option = ["--rmf"] if process_layout == "inside" else []
    with running("serve", str(site), "--port", "0", *rmf_option, pattern=SERVES) as match:
        if process_layout == "inside":
            yield int(match[1])
        else:
            with running("rmf", "--manager-port", match[1], pattern="lift adapter"):
                yield int(match[1])


async def _requests(
    lift: str, controller: Controller, monitor: Monitor, times: Times, count: int, start: asyncio.Barrier
) -> None:
    """Request one floor after the other, each time once as many lifts as `start` waits for are about to."""
    dice, session = random.Random(lift), f"fleet/{lift}"
    for number in range(count + 1):
        code = 2 + number % 2
        await start.wait()
        called, requested_at = controller.called(code), time.monotonic()
        monitor.send_request(
            LiftRequest(lift, Time.of(time.time()), session, AGV_MODE, FLOOR_NAMES[code - 1], DOOR_OPEN), direct=True
        )
        async with asyncio.timeout(WITHIN_S):
            took = await called - requested_at
        if number:  # the first one waits until the controller has granted robot mode
            times.requests.append(took)
        await asyncio.sleep(dice.uniform(*PRESS_PAUSE_S))
    monitor.send_request(LiftRequest(lift, Time(), session, END_SESSION, "", 0), direct=True)


async def _changes(
    lift: str, controller: Controller, rmf: Rmf, rest: RestClient, times: Times, count: int, poll_s: float
) -> None:
    """Let the car start and stop at moments independent of the polls."""
    dice, motions = random.Random(lift), rest.motions(lift)
    for number in range(2 * count):
        moves = not number % 2
        stated, reported = rmf.moving(lift, int(moves)), rest.moving(lift, "up" if moves else "stopped")
        await asyncio.sleep(dice.uniform(1, 3) * poll_s)
        changed_at, controller.registers[MOTION] = time.monotonic(), UP if moves else STOPPED
        async with asyncio.timeout(WITHIN_S):
            times.changes[EVENT].append(await reported - changed_at)
            if await anext(motions) != int(moves):
                raise SystemExit(f"the workshop API does not show what the event of {lift} reported")
            times.changes[WORKSHOP].append(time.monotonic() - changed_at)
            times.changes[LIFT_STATES].append(await stated - changed_at)


async def _measured(process_layout: str, folder: Path, chosen: argparse.Namespace) -> Times:
    loop, times = asyncio.get_running_loop(), Times()
    controllers = {f"lift{number}": Controller() for number in range(1, chosen.lifts + 1)}
    servers = {name: await loop.create_server(partial(only, one), "127.0.0.1", 0) for name, one in controllers.items()}
    site = site_file(
        folder, {name: server.sockets[0].getsockname()[1] for name, server in servers.items()}, chosen.poll
    )
    rmf = Rmf(loop)
    monitor = Monitor(RosSettings.of(os.environ), rmf, lambda call: call())
    starting = contextlib.ExitStack()
    try:
        rest = RestClient(await asyncio.to_thread(starting.enter_context, _manager(process_layout, site)))
        async with asyncio.timeout(READY_WITHIN_S):
            while len(rmf.lifts_received) < len(controllers):  # noqa: ASYNC110  filled by a thread of Cyclone DDS
                await asyncio.sleep(0.05)
        await asyncio.sleep(REPLAY_S + 0.5)
        start = asyncio.Barrier(len(controllers) if chosen.at_once else 1)
        async with asyncio.TaskGroup() as reading:
            events = reading.create_task(rest.read_events())
            async with asyncio.TaskGroup() as tasks:
                for name, controller in controllers.items():
                    tasks.create_task(_changes(name, controller, rmf, rest, times, chosen.times, chosen.poll))
            events.cancel()
        async with asyncio.TaskGroup() as tasks:
            for name, controller in controllers.items():
                tasks.create_task(_requests(name, controller, monitor, times, chosen.times, start))
    finally:
        await asyncio.to_thread(starting.close)
        monitor.close()
        for server in servers.values():
            server.close()
    return times


def _percentiles(found: list[float]) -> tuple[float, float]:
    """Return the median and the 99th."""
    parts = statistics.quantiles(found, n=100)
    return parts[49], parts[98]


def _as_text(found: list[float]) -> str:
    median, most = _percentiles(found)
    return f"{median * 1e3:.1f} ms, p99 {most * 1e3:.1f} ms"


def _show(process_layout: str, what: str, found: list[float], poll_s: float) -> tuple[float, float]:
    median, most = _percentiles(found)
    print(
        f"{process_layout:<9}{what:<30}{len(found):>6}{median * 1e3:>9.1f} ms{most * 1e3:>8.1f} ms{median / poll_s:>10.2f}{most / poll_s:>8.2f}"
        f"{os.getloadavg()[0]:>7.1f}",
        flush=True,
    )
    return median, most


def main() -> None:
    """Measure each way, print, end."""
    parser = common.parser(__doc__)
    parser.add_argument("--lifts", type=int, default=8)
    parser.add_argument("--times", type=int, default=25, help="requests of each lift; twice as many changes")
    parser.add_argument("--poll", type=float, default=0.1, help="seconds from one poll of a lift to its next")
    parser.add_argument("--way", choices=("inside", "beside"), nargs="+", default=["inside", "beside"])
    parser.add_argument("--at-once", action="store_true", help="request every lift at the same instants")
    parser.add_argument("--folder", type=Path, help="where the site and its journal are; a temporary folder without it")
    chosen = parser.parse_args()
    # its own domain: a lift of a nearby building must not be called
    os.environ.update(ROS_DOMAIN_ID=str(1 + os.getpid() % 100), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    print(f"{'':<9}{'':<30}{'':>6}{'median':>12}{'p99':>11}{'/ poll':>10}{'':>8}{'load':>7}", flush=True)
    good, figures = [], common.Figures()
    soon_s = chosen.poll + OVERHEAD_S
    for process_layout in chosen.way:
        with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
            times = asyncio.run(_measured(process_layout, Path(folder), chosen))
        for face, found in times.changes.items():
            good.append(_show(process_layout, f"change -> {face}", found, chosen.poll)[1] < soon_s)
            figures.add(
                f"{chosen.lifts} lifts, adapter {process_layout} the manager: change -> {face}",
                _as_text(found),
                limit=f"p99 below {soon_s * 1e3:g} ms",
            )
        limit_s = AT_ONCE_S if chosen.at_once else soon_s
        good.append(_show(process_layout, REQUEST, times.requests, chosen.poll)[0] < limit_s)
        at_once = " at one instant" if chosen.at_once else ""
        measure = f"{chosen.lifts} lifts, adapter {process_layout} the manager: {REQUEST}{at_once}"
        figures.add(measure, _as_text(times.requests), limit=f"median below {limit_s * 1e3:g} ms")
        figures.picture(measure, times.requests)
    figures.write(chosen.figures)
    if not all(good):
        raise SystemExit("the 99th percentile of a change or the median of a request is above its limit")


if __name__ == "__main__":
    main()
