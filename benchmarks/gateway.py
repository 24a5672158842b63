"""What a slow gateway leaves of four lifts: how old their states are, and how long a call waits, at 40 to 400 ms a request.

    python benchmarks/gateway.py [--request-ms 40 100 200 400] [--lifts 4] [--ridden 1] [--seconds 20] [--presses 8]

One gateway answers one request at a time, each after the time of a row; its lifts have unit ids of their own, and the manager (`serve`)
is to poll each ten times a second, which the gateway cannot do. Robots have --ridden of the lifts, with robot mode and the door held:
each hold is written again every second, over the same line. This process plays the gateway and a client of the REST interface. It
takes twice the seconds a row, and ends by itself.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import random
import statistics
import struct
import sys
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path

import httpx

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common

SAMPLES_PER_S = 10.0
MAX_AGE_S = 10.0
"""The most that a site file may say: how old a state is shall be measured, not judged."""


class Gateway(asyncio.Protocol):
    """Passes one request at a time to the lift with its unit id, and answers after a while."""

    def __init__(self, lifts: dict[int, common.Controller], request_s: float) -> None:
        self._lifts = lifts
        self._request_s = request_s
        self._requests: asyncio.Queue[bytes] = asyncio.Queue()
        self.served = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to serve."""
        for lift in self._lifts.values():
            lift.connection_made(transport)
        self._serving = asyncio.ensure_future(self._serve())

    def data_received(self, data: bytes) -> None:
        """Take requests, which may come several at a time."""
        while data:
            end = 6 + int(struct.unpack(">H", data[4:6])[0])
            self._requests.put_nowait(data[:end])
            data = data[end:]

    def connection_lost(self, exc: Exception | None) -> None:
        """Serve no longer."""
        self._serving.cancel()

    async def _serve(self) -> None:
        while True:
            request = await self._requests.get()
            await asyncio.sleep(self._request_s)
            self._lifts[request[6]].data_received(request)
            self.served += 1


def site_file(folder: Path, port: int, lifts: int) -> Path:
    """Write the site file of lifts on one controller."""
    lift = {"controller": "gateway", "access": "control", "floors": common.FLOORS, "poll_s": common.POLL_S}
    site = {
        "schema": 1,
        "name": "benchmark",
        "state": "state",
        "controllers": {"gateway": {"host": "127.0.0.1", "port": port, "map": common.MAP, "timeout_s": 2.0}},
        "lifts": {f"lift{unit}": {**lift, "unit_id": unit, "max_age_s": MAX_AGE_S} for unit in range(1, lifts + 1)},
    }
    file = folder / "site.yaml"
    file.write_text(json.dumps(site), "utf-8")  # JSON is YAML
    return file


@contextlib.asynccontextmanager
async def serving(
    request_s: float, lifts: int, folder: Path
) -> AsyncIterator[tuple[dict[int, common.Controller], Gateway, str]]:
    """Play the gateway, and run a manager behind it."""
    controllers = {unit: common.Controller() for unit in range(1, lifts + 1)}
    gateways: list[Gateway] = []

    def connected() -> Gateway:
        gateways.append(Gateway(controllers, request_s))
        return gateways[-1]

    program = contextlib.ExitStack()
    server = await asyncio.get_running_loop().create_server(connected, "127.0.0.1", 0)
    try:
        site = site_file(folder, server.sockets[0].getsockname()[1], lifts)
        serve = common.running("serve", str(site), "--port", "0", pattern=common.SERVES)
        match = await asyncio.to_thread(program.enter_context, serve)
        yield controllers, gateways[-1], match[1]
    finally:
        await asyncio.to_thread(program.close)
        server.close()


async def ages(port: str, seconds: float) -> list[float]:
    """Return ages of the lifts at random instants, as a client sees them."""
    loop, dice, found = asyncio.get_running_loop(), random.Random(1), list[float]()
    async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", trust_env=False, timeout=60.0) as client:
        async with asyncio.timeout(common.READY_WITHIN_S):
            while any(lift["age_s"] is None for lift in (await client.get("/api/v1/lifts")).json()["lifts"]):  # noqa: ASYNC110  of another process
                await asyncio.sleep(0.1)
        ends = loop.time() + seconds
        while loop.time() < ends:
            await asyncio.sleep(dice.expovariate(SAMPLES_PER_S))
            found += [lift["age_s"] for lift in (await client.get("/api/v1/lifts")).json()["lifts"]]
    return found


async def presses(controllers: dict[int, common.Controller], port: str, count: int) -> list[float]:
    """Return the seconds from a request to the call at its lift, one lift after the other."""
    took, dice = list[float](), random.Random(1)
    lifts = [common.LiftServer(lift, int(port), f"lift{unit}") for unit, lift in controllers.items()]
    for number in range(len(lifts) + common.PRESS_ATTEMPTS * count):
        lift = lifts[number % len(lifts)]
        seconds = await lift.press(2 + number // len(lifts) % 2)
        if (
            number >= len(lifts) and seconds is not None
        ):  # the first one waits until the controller has granted robot mode
            took.append(seconds)
        if len(took) == count:
            break
        await asyncio.sleep(dice.uniform(*common.PRESS_PAUSE_S))
    else:
        raise SystemExit("too many requests were refused: this computer is too busy, or the gateway too slow")
    return took


async def measure(request_s: float, chosen: argparse.Namespace, figures: common.Figures) -> None:
    """Measure one row, and print it."""
    with tempfile.TemporaryDirectory() as folder:
        async with serving(request_s, chosen.lifts, Path(folder)) as (controllers, gateway, port):
            served, began = gateway.served, asyncio.get_running_loop().time()
            found = await ages(port, chosen.seconds)
            rate = (gateway.served - served) / (asyncio.get_running_loop().time() - began)
            took = await presses(dict(list(controllers.items())[: chosen.ridden]), port, chosen.presses)
    percentiles = statistics.quantiles(found, n=100)
    p50_s, p99_s, press_s = percentiles[49], percentiles[98], statistics.median(took)
    turn_s = request_s * chosen.lifts
    print(
        f"{request_s * 1e3:>7.0f} ms{rate:>12.1f}{rate * request_s:>7.0%}{p50_s:>8.2f}{p99_s:>8.2f}{p99_s / turn_s:>8.1f}"
        f"{press_s:>9.2f}{max(took):>8.2f}{press_s / request_s:>8.1f}",
        flush=True,
    )
    row = f"{chosen.lifts} lifts, {request_s * 1e3:g} ms a request"
    figures.add(f"{row}: use of the line", f"{rate * request_s:.0%}")
    figures.add(f"{row}: age, p99", f"{p99_s:.2f} s", f"one read of every lift {turn_s:.2f} s", p99_s / turn_s)
    figures.add(
        f"{row}: POST to the call at the lift, {chosen.ridden} of them ridden",
        f"{press_s:.2f} s",
        f"one request {request_s:.2f} s",
        press_s / request_s,
    )


def main(chosen: argparse.Namespace) -> None:
    """Measure each row, end."""
    print(
        f"{'request':>10}{'requests/s':>12}{'line':>7}{'age p50':>8}{'p99 s':>8}{'/ turn':>8}{'POST p50':>9}{'max s':>8}{'/ one':>8}"
    )
    figures = common.Figures()
    for request_ms in chosen.request_ms:
        asyncio.run(measure(request_ms / 1e3, chosen, figures))
    figures.write(chosen.figures)


if __name__ == "__main__":
    parser = common.parser(__doc__)
    parser.add_argument("--request-ms", type=float, nargs="+", default=[40.0, 100.0, 200.0, 400.0])
    parser.add_argument("--lifts", type=int, default=4)
    parser.add_argument("--ridden", type=int, default=1, help="lifts that robots have at the same time")
    parser.add_argument("--seconds", type=float, default=20.0, help="in which ages are drawn, of each row")
    parser.add_argument("--presses", type=int, default=8)
    main(parser.parse_args())
