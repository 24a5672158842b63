"""What GET /api/v1/lifts costs with 100 lifts: CPU for each lift of an answer, next to FastAPI with a response model.

    python benchmarks/lifts.py [--lifts 100] [--seconds 2] [--rounds 5]

Two programs take turns, each in a process of its own: `serve` with that many lifts, polled ten times a second, and an application by hand
that answers with the same lifts from memory, as a model. This process makes the requests, over one kept connection, one after the
other. What the polls cost is measured without requests and left out. It ends by itself.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import httpx
import uvicorn
from fastapi import FastAPI

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from lift_manager.api.lifts import Lifts
from lift_manager.web.server import listen

STOCK, MANAGER = "stock", "manager"
POLL_S = 0.1
LIMIT_US = 20.0
STEP_S = 0.01
"""Less than one step of `cpu_s` cannot be measured."""


def stock_app(lifts: Lifts) -> FastAPI:
    """Return the application by hand."""
    app = FastAPI()

    @app.get("/api/v1/lifts")
    async def every() -> Lifts:
        return lifts

    return app


def serve_stock(answer: Path) -> None:
    """Serve it as `uvicorn --loop uvloop --http httptools --no-access-log` does."""
    app = stock_app(Lifts.model_validate_json(answer.read_bytes()))
    config = uvicorn.Config(app, loop="uvloop", http="httptools", access_log=False, log_level="warning")
    with listen("127.0.0.1", 0) as sock:
        print(f"http://127.0.0.1:{sock.getsockname()[1]}/docs", flush=True)
        uvicorn.Server(config).run(sockets=[sock])


def live(url: str) -> httpx.Response:
    """Return the answer once every lift in it is live: it takes the change of an alive counter."""
    ends = time.monotonic() + common.READY_WITHIN_S
    while time.monotonic() < ends:
        answer = httpx.get(url, trust_env=False).raise_for_status()
        if all(lift["quality"] == "live" for lift in answer.json()["lifts"]):
            return answer
        time.sleep(POLL_S)
    raise SystemExit("not every lift is live: this computer is too busy to read them")


async def idle(process: int, seconds: float) -> float:
    """Return the CPU time of a program that nobody requests anything of, over wall time."""
    cpu_s = common.cpu_s(process)
    await asyncio.sleep(seconds)
    return (common.cpu_s(process) - cpu_s) / seconds


async def cost_us(client: httpx.AsyncClient, process: int, seconds: float, lifts: int) -> float:
    """Return the microseconds of CPU for each lift of an answer."""
    background = await idle(process, seconds)
    loop = asyncio.get_running_loop()
    began, cpu_s, answers = loop.time(), common.cpu_s(process), 0
    while loop.time() - began < seconds:
        (await client.get("/api/v1/lifts")).raise_for_status()
        answers += 1
    spent_s = common.cpu_s(process) - cpu_s - background * (loop.time() - began)
    return max(spent_s, STEP_S) / answers / lifts * 1e6


async def measure(ports: tuple[str, str], processes: list[int], chosen: argparse.Namespace) -> dict[str, list[float]]:
    """Let both take turns."""
    found: dict[str, list[float]] = {STOCK: [], MANAGER: []}
    for _ in range(chosen.rounds):
        for name, port, process in zip((MANAGER, STOCK), ports, processes, strict=True):
            async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", trust_env=False) as client:
                found[name].append(await cost_us(client, process, chosen.seconds, chosen.lifts))
    return found


def main(chosen: argparse.Namespace) -> None:
    """Start both, measure, print, end."""
    if chosen.serve is not None:
        serve_stock(chosen.serve)
        return
    common.allow_files(2 * chosen.lifts)
    core, other = common.two_cores()
    common.pin(other)
    processes: list[int] = []
    run = partial(common.running, pattern=common.SERVES, core=core, started=processes.append)
    with common.controllers(chosen.lifts, 5, other) as ports, tempfile.TemporaryDirectory() as folder:
        site = common.site_file(Path(folder), {f"lift{port}": port for port in ports}, POLL_S)
        with run("serve", str(site), "--port", "0") as manager:
            answer = live(f"http://127.0.0.1:{manager[1]}/api/v1/lifts")
            kept = Path(folder, "answer.json")
            kept.write_bytes(answer.content)
            with run("--serve", str(kept), program=(__file__,)) as stock:
                found = asyncio.run(measure((manager[1], stock[1]), processes, chosen))
    ours, theirs = (statistics.median(found[name]) for name in (MANAGER, STOCK))
    print(f"GET /api/v1/lifts, {chosen.lifts} lifts, {len(answer.content)} bytes: CPU for each lift")
    print(f"{MANAGER} {ours:.1f} us, {STOCK} {theirs:.1f} us: {ours / theirs:.2f} times")
    figures = common.Figures()
    measure_text = f"GET /api/v1/lifts of {chosen.lifts} lifts: CPU for each lift"
    figures.add(measure_text, f"{ours:.1f} us", f"{STOCK} {theirs:.1f} us", ours / theirs, f"at most {LIMIT_US:g} us")
    figures.write(chosen.figures)


if __name__ == "__main__":
    parser = common.parser(__doc__)
    parser.add_argument("--lifts", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=2.0, help="of requests in each round, of each program")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--serve", type=Path, metavar="ANSWER", help=argparse.SUPPRESS)
    main(parser.parse_args())
