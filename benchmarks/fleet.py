"""What a building costs: 100 and 1,000 lifts polled ten times a second by one manager, against a bare pymodbus loop.

    python benchmarks/fleet.py [--lifts 100 1000] [--seconds 5] [--rounds 3] [--beat 5]

One server process plays all controllers, a port each. Every round runs in a fresh process of its own; manager and bare
loop take turns, so that a busy machine slows both, and the table shows medians. It ends by itself after about 90 s.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import random
import statistics
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import uvloop
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from benchmarks.common import POLL_S
from lift_manager.runtime.ticker import BEAT_S

SETTLE_S = 1.0
READY_WITHIN_S = 20.0
SAMPLES_PER_S = 200
MANAGER, BARE, BY_HAND = "manager", "bare pymodbus", "bare asyncio"
HEADINGS = ("", "", "lifts", "polls/s", "rate", "age p50", "age p99", "core", "us/poll", "KB/lift")


@dataclass(frozen=True, slots=True)
class Plan:
    """How one round is run."""

    seconds: float
    core: int | None
    """Where the measured process is pinned; None where the system does not allow it."""


@dataclass(frozen=True, slots=True)
class Round:
    """What one contestant did in one round."""

    polls_per_s: float
    age_p50_s: float
    age_p99_s: float
    core: float
    """CPU time over wall time."""
    poll_us: float
    """CPU time of one poll."""
    memory: float
    """Bytes per lift."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """A contestant at work."""

    polls: Callable[[], int]
    """Polls answered so far, by all lifts."""
    age_s: Callable[[int], float | None]
    """How old this lift's state says it is; None while it has none."""


Contestant = Callable[[list[int]], contextlib.AbstractAsyncContextManager[Fleet]]
"""Polls the controllers at these ports."""


@contextlib.asynccontextmanager
async def manager(ports: list[int]) -> AsyncIterator[Fleet]:
    """The whole path of a poll: wire, link, codec, rules, state."""
    building = common.building(ports, POLL_S)
    site, names = building.site, building.site.lift_names()

    def age_s(index: int) -> float | None:
        return site.state(names[index]).age_s

    async with _running([link.run() for link in building.links]), _running([building.life.run()]):
        yield Fleet(lambda: sum(link.stats.transactions - link.stats.timeouts for link in building.links), age_s)


@contextlib.asynccontextmanager
async def bare_pymodbus(ports: list[int]) -> AsyncIterator[Fleet]:
    """The least that a program on pymodbus's own client does: one task per controller, the words kept as they came."""
    words: list[Sequence[int]] = [[] for _ in ports]
    clients = [AsyncModbusTcpClient("127.0.0.1", port=port, retries=0) for port in ports]
    for client in clients:
        await client.connect()

    async def poll(index: int) -> bool:
        try:
            words[index] = (await clients[index].read_holding_registers(0, count=common.REGISTERS)).registers
        except ModbusException:
            return False
        return True

    async with _polling(poll, len(ports)) as fleet:
        yield fleet
    for client in clients:
        client.close()


@contextlib.asynccontextmanager
async def bare_asyncio(ports: list[int]) -> AsyncIterator[Fleet]:
    """The same bytes and nothing else, sent by one timer for all: the least that any client on asyncio can cost."""
    loop, over = asyncio.get_running_loop(), False
    clients = [(await loop.create_connection(LeastClient, "127.0.0.1", port))[1] for port in ports]
    began, beats = loop.time(), round(POLL_S / BEAT_S)

    def on_beat(number: int) -> None:
        if over:
            return
        now = loop.time()
        for client in clients[number % beats :: beats]:  # spread, as the manager spreads its lifts
            client.poll(now)
        loop.call_at(began + (number + 1) * BEAT_S, on_beat, number + 1)

    def age_s(index: int) -> float | None:
        at = clients[index].read_at
        return None if at is None else loop.time() - at

    on_beat(0)
    yield Fleet(lambda: sum(client.answers for client in clients), age_s)
    over = True
    for client in clients:
        client.close()


class LeastClient(asyncio.Protocol):
    """Sends a poll when it is told to, and takes what comes as its answer, unchecked."""

    __slots__ = ("_sent_at", "_transport", "answers", "read_at")

    def __init__(self) -> None:
        self.answers = 0
        self.read_at: float | None = None
        """When the poll was sent whose answer came last."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        self.answers += 1
        self.read_at = self._sent_at

    def poll(self, now: float) -> None:
        """Send a poll."""
        self._sent_at = now
        self._transport.write(common.POLL)  # type: ignore[attr-defined]  # a transport for writing

    def close(self) -> None:
        """Hang up."""
        self._transport.close()


@contextlib.asynccontextmanager
async def _polling(poll: Callable[[int], Awaitable[bool]], lifts: int) -> AsyncIterator[Fleet]:
    """Poll each lift at its pace, in a task of its own; `poll` returns whether it was answered."""
    loop, polls = asyncio.get_running_loop(), 0
    over = False  # Python 3.11's wait_for, inside pymodbus, loses a cancellation that comes together with an answer
    read_at: list[float | None] = [None] * lifts
    began = loop.time()

    async def poll_lift(index: int) -> None:
        nonlocal polls
        due = began + POLL_S * index / lifts  # spread, as the manager spreads its lifts
        await asyncio.sleep(due - loop.time())
        while not over:
            at = loop.time()
            if await poll(index):
                read_at[index] = at
                polls += 1
            due += POLL_S
            while due < loop.time():
                due += POLL_S
            await asyncio.sleep(due - loop.time())

    def age_s(index: int) -> float | None:
        at = read_at[index]
        return None if at is None else loop.time() - at

    async with _running([poll_lift(index) for index in range(lifts)]):
        yield Fleet(lambda: polls, age_s)
        over = True


@contextlib.asynccontextmanager
async def _running(works: list[Coroutine[Any, Any, None]]) -> AsyncIterator[None]:
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(work) for work in works]
        yield
        for task in tasks:
            task.cancel()


CONTESTANTS: dict[str, Contestant] = {MANAGER: manager, BARE: bare_pymodbus, BY_HAND: bare_asyncio}


async def measure(contestant: Contestant, ports: list[int], plan: Plan) -> Round:
    """Let a contestant poll, and watch it from outside its poll path."""
    empty = common.memory()
    async with contestant(ports) as fleet:
        async with asyncio.timeout(READY_WITHIN_S):
            await _all_read(fleet, len(ports))
        gc.freeze()  # as `serve` does
        await asyncio.sleep(SETTLE_S)
        memory = (common.memory() - empty) / len(ports)
        began, cpu, polls = time.monotonic(), time.process_time(), fleet.polls()
        ages = await _sample_ages(fleet, len(ports), began + plan.seconds)
        took, cpu, polls = time.monotonic() - began, time.process_time() - cpu, fleet.polls() - polls
    percentiles = statistics.quantiles(ages, n=100)
    return Round(polls / took, percentiles[49], percentiles[98], cpu / took, cpu / max(polls, 1) * 1e6, memory)


async def _all_read(fleet: Fleet, lifts: int) -> None:
    while any(fleet.age_s(index) is None for index in range(lifts)):  # noqa: ASYNC110 - it is to be left in peace
        await asyncio.sleep(0.1)


async def _sample_ages(fleet: Fleet, lifts: int, until: float) -> list[float]:
    """Ages of lifts drawn at random at random instants, as a client that asks now and then would see them."""
    loop, ages, dice = asyncio.get_running_loop(), [], random.Random(1)
    while time.monotonic() < until:
        await asyncio.sleep(dice.expovariate(SAMPLES_PER_S))
        age_s = fleet.age_s(dice.randrange(lifts))
        if age_s is not None:
            # The loop's clock stands still while a turn of the loop lasts; the client's does not.
            ages.append(age_s + time.monotonic() - loop.time())
    return ages


def run_round(name: str, ports: list[int], plan: Plan) -> Round:
    """One round in a process of its own."""
    ours, theirs = common.FORK.Pipe(duplex=False)
    child = common.FORK.Process(target=_round_process, args=(name, ports, plan, theirs), daemon=True)
    child.start()
    theirs.close()
    try:
        result: Round = common.received(ours, child)
    finally:
        child.join()
    return result


def _round_process(name: str, ports: list[int], plan: Plan, pipe: Connection) -> None:
    common.pin(plan.core)
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        pipe.send(runner.run(measure(CONTESTANTS[name], ports, plan)))


def median(rounds: list[Round]) -> Round:
    """Return the median of each figure."""
    return Round(*(statistics.median(values) for values in zip(*(_row(one) for one in rounds), strict=True)))


def _row(one: Round) -> tuple[float, ...]:
    return one.polls_per_s, one.age_p50_s, one.age_p99_s, one.core, one.poll_us, one.memory


def show(lifts: int, results: dict[str, list[Round]]) -> None:
    """Print the medians of one size, and what bare pymodbus costs for each unit that the manager costs."""
    for name, rounds in results.items():
        one = median(rounds)
        rate = one.polls_per_s * POLL_S / lifts
        print(
            f"{name:<18}{lifts:>9}{one.polls_per_s:>9.0f}{rate:>9.1%}"
            f"{one.age_p50_s * 1e3:>6.0f} ms{one.age_p99_s * 1e3:>6.0f} ms{one.core:>9.1%}{one.poll_us:>9.1f}{one.memory / 1024:>9.1f}"
        )
    if BARE in results and len(results) > 1:
        ours, bare = (median(results[name]).poll_us for name in (MANAGER, BARE))
        print(f"bare pymodbus costs {bare / ours:.2f} times the CPU of the manager\n", flush=True)


def add_figures(figures: common.Figures, lifts: int, medians: dict[str, Round]) -> None:
    """Add one size."""
    for name, one in medians.items():
        figures.lines.setdefault(name, []).append((lifts, one.core * 100))
    if (ours := medians.get(MANAGER)) is None or (bare := medians.get(BARE)) is None:
        return
    of, times = f"{BARE} {bare.poll_us:.1f} us", ours.poll_us / bare.poll_us
    figures.add(f"{lifts:,} lifts: CPU of one poll", f"{ours.poll_us:.1f} us", of, times, "at most 0.5")
    if (by_hand := medians.get(BY_HAND)) is not None:
        least, times = f"{by_hand.poll_us:.1f} us", by_hand.poll_us / bare.poll_us
        figures.add(f"{lifts:,} lifts: CPU of one poll, {BY_HAND}", least, of, times)
    rate, theirs = (one.polls_per_s * POLL_S / lifts for one in (ours, bare))
    figures.add(
        f"{lifts:,} lifts: polls that took place", f"{rate:.1%}", f"{BARE} {theirs:.1%}", None, "90 % up to 2,500"
    )
    age = f"{ours.age_p99_s * 1e3:.0f} ms"
    figures.add(f"{lifts:,} lifts: age, p99", age, f"{BARE} {bare.age_p99_s * 1e3:.0f} ms", None, "below 250 ms")
    figures.add(f"{lifts:,} lifts: memory of one", f"{ours.memory / 1024:.1f} KB", f"{BARE} {bare.memory / 1024:.1f} KB", None, "at most 32 KB")  # fmt: skip


def main() -> None:
    """Start the controllers, take turns, print, end."""
    parser = common.parser(__doc__)
    parser.add_argument("--lifts", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--seconds", type=float, default=5.0, help="measured in each round")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--beat", type=int, default=5, help="polls to a count of the alive counter")
    parser.add_argument("--only", choices=sorted(CONTESTANTS), help="one contestant alone, for a profiler")
    chosen = parser.parse_args()
    # In the process of the controllers: a listening socket and an accepted one for every lift.
    common.allow_files(2 * max(chosen.lifts))
    figures = common.Figures()
    core, other = common.two_cores()
    plan = Plan(chosen.seconds, core)
    names = [chosen.only] if chosen.only else list(CONTESTANTS)
    print("not pinned" if core is None else f"measured process on core {core}, controllers on core {other}")
    print("".join(f"{word:>9}" for word in HEADINGS), flush=True)
    with common.controllers(max(chosen.lifts), chosen.beat, other) as ports:
        for lifts in chosen.lifts:
            results: dict[str, list[Round]] = {name: [] for name in names}
            for _ in range(chosen.rounds):
                for name, rounds in results.items():
                    rounds.append(run_round(name, ports[:lifts], plan))
            show(lifts, results)
            add_figures(figures, lifts, {name: median(rounds) for name, rounds in results.items()})
    figures.write(chosen.figures)


if __name__ == "__main__":
    main()
