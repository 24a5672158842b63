"""What a poll of one lift costs in CPU time, layer by layer, against one read with pymodbus's own client.

    python benchmarks/link.py [--loop asyncio] [--polls 3000] [--rounds 5] [--beat 5] [--tls]

The server is a process of its own, so only the asking side is measured. The contestants take turns, round by round, so
that a busy machine slows all of them; the table shows the median round. It ends by itself after about a minute at most.
The lift is only watched: the looks at outputs of a lift that may be told something, one read in about 2 s, are not in it.
With --tls a link over mutual TLS takes part; what it costs is said as times the link without.
"""

from __future__ import annotations

import asyncio
import contextlib
import ssl
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path

import uvloop
from pymodbus.client import AsyncModbusTcpClient

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run from a bare checkout

from benchmarks import common
from benchmarks.common import REGISTERS
from drivers.errors import HeartbeatStopped
from drivers.modbus.link import Link
from drivers.modbus.tls import LinkTls
from drivers.model import LiftReading
from register_maps import frames
from register_maps.words import Table

LIMIT_S = 120.0
BARE, BY_HAND = "bare pymodbus", "bare asyncio"
LINK = "link"
LINK_OVER_TLS = "link over TLS"
READ, POLL = "lift: read", "lift: read, rules"
BEATS_WITHIN = 1000
"""Polls within which the alive counter has to change."""
Poll = Callable[[], Awaitable[object]]
Contestant = Callable[[int], contextlib.AbstractAsyncContextManager[Poll]]
"""Connects to a port and gives the coroutine function that makes one poll."""


@contextlib.asynccontextmanager
async def bare_pymodbus(port: int) -> AsyncIterator[Poll]:
    """One read with pymodbus's own client, as its documentation shows it."""
    client = AsyncModbusTcpClient("127.0.0.1", port=port, retries=0, reconnect_delay=0)
    await client.connect()

    async def poll() -> None:
        response = await client.read_holding_registers(0, count=REGISTERS, device_id=1)
        if len(response.registers) != REGISTERS:
            raise SystemExit("wrong answer")

    yield poll
    client.close()


class BareClient(asyncio.Protocol):
    """Sends one poll and takes what comes as its answer, unchecked."""

    @classmethod
    async def connected(cls, port: int) -> BareClient:
        """Connect to a controller."""
        _, client = await asyncio.get_running_loop().create_connection(cls, "127.0.0.1", port)
        return client

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        if not self._answer.done():  # the measurement is over
            self._answer.set_result(data)

    async def poll(self) -> bytes:
        """Return the answer."""
        self._answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._transport.write(common.POLL)  # type: ignore[attr-defined]  # a transport for writing
        return await self._answer

    def close(self) -> None:
        """Hang up."""
        self._transport.close()


@contextlib.asynccontextmanager
async def bare_asyncio(port: int) -> AsyncIterator[Poll]:
    """The same bytes, and nothing checked: what the kernel, the loop and one future cost."""
    client = await BareClient.connected(port)
    yield client.poll
    client.close()


@contextlib.asynccontextmanager
async def link_read(port: int, tls: LinkTls | None = None) -> AsyncIterator[Poll]:
    """One checked read over the link and the real wire."""
    request = frames.read(Table.HOLDING, 0, REGISTERS)
    async with _link_up(port, tls) as link:

        async def poll() -> None:
            if len(await link.read(request)) != 2 * REGISTERS:
                raise SystemExit("wrong answer")

        yield poll


@contextlib.asynccontextmanager
async def lift_read(port: int) -> AsyncIterator[Poll]:
    """The same, turned into the reading of a lift."""
    async with _link_up(port) as link:
        yield common.make_driver(link).read


@contextlib.asynccontextmanager
async def lift_poll(port: int) -> AsyncIterator[Poll]:
    """The same, with what the manager makes of the reading."""
    async with _link_up(port) as link:
        driver, loop = common.make_driver(link), asyncio.get_running_loop()
        actor = common.make_actor(driver)

        async def poll() -> None:
            answered: asyncio.Future[LiftReading | None] = loop.create_future()  # in the manager a poll has none
            reading = await answered if driver.begin_read(answered.set_result) else None
            actor.take_reading(reading or await driver.read(), loop.time())

        yield poll


async def _live(poll: Poll) -> None:
    """Poll until the alive counter was seen to change: before that, and after a long turn of the others, no reading counts."""
    for _ in range(BEATS_WITHIN):
        with contextlib.suppress(HeartbeatStopped):
            await poll()
            return
    raise SystemExit("the controller's alive counter does not change; give a smaller --beat")


@contextlib.asynccontextmanager
async def _link_up(port: int, tls: LinkTls | None = None) -> AsyncIterator[Link]:
    link = common.make_link(port, tls)
    async with asyncio.TaskGroup() as group:
        group.create_task(link.run())
        await link.wait_up()
        yield link
        await link.close()


CONTESTANTS: dict[str, Contestant] = {
    BARE: bare_pymodbus,
    BY_HAND: bare_asyncio,
    LINK: link_read,
    READ: lift_read,
    POLL: lift_poll,
}


@contextlib.contextmanager
def over_tls(beat: int, core: int | None) -> Iterator[Contestant]:
    """A link over mutual TLS 1.3, to a controller of its own."""
    import trustme  # noqa: PLC0415  of the test environment alone

    with tempfile.TemporaryDirectory() as folder:
        authority = trustme.CA()
        ca, ours = Path(folder, "ca.pem"), Path(folder, "ours.pem")
        authority.cert_pem.write_to_path(ca)
        authority.issue_cert("lift-manager").private_key_and_cert_chain_pem.write_to_path(ours)
        theirs = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        authority.issue_cert("127.0.0.1").configure_cert(theirs)
        authority.configure_trust(theirs)
        theirs.verify_mode = ssl.CERT_REQUIRED
        with common.controllers(1, beat, core, theirs) as ports:
            tls = LinkTls(ca=ca, certificate=ours, key=ours)
            yield lambda _: link_read(ports[0], tls)


async def measure(contestants: dict[str, Contestant], port: int, polls: int, rounds: int) -> dict[str, float]:
    """Microseconds of CPU per poll, the median round of each contestant."""
    cost_us: dict[str, list[float]] = {name: [] for name in contestants}
    async with contextlib.AsyncExitStack() as stack, asyncio.timeout(LIMIT_S):
        ready = {name: await stack.enter_async_context(make(port)) for name, make in contestants.items()}
        for turn in range(rounds + 1):
            for name, poll in ready.items():
                await _live(poll)
                began = time.process_time()
                for _ in range(polls):
                    await poll()
                if turn:  # the first round warms up
                    cost_us[name].append((time.process_time() - began) / polls * 1e6)
    return {name: statistics.median(costs) for name, costs in cost_us.items()}


def main() -> None:
    """Measure, print, end."""
    parser = common.parser(__doc__)
    parser.add_argument("--loop", choices=["uvloop", "asyncio"], default="uvloop")
    parser.add_argument("--polls", type=int, default=3000, help="in each round")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--beat", type=int, default=5, help="polls to a count of the alive counter")
    parser.add_argument("--tls", action="store_true", help="with a link over mutual TLS")
    chosen = parser.parse_args()
    core, other = common.two_cores()
    factory = uvloop.new_event_loop if chosen.loop == "uvloop" else asyncio.new_event_loop
    contestants = dict(CONTESTANTS)
    with contextlib.ExitStack() as stack:
        ports = stack.enter_context(common.controllers(1, chosen.beat, other))
        if chosen.tls:
            contestants[LINK_OVER_TLS] = stack.enter_context(over_tls(chosen.beat, other))
        runner = stack.enter_context(asyncio.Runner(loop_factory=factory))
        common.pin(core)
        costs = runner.run(measure(contestants, ports[0], chosen.polls, chosen.rounds))
    print("not pinned" if core is None else f"measured process on core {core}, controller on core {other}")
    print(f"{'loop: ' + chosen.loop:<20}{'CPU per poll':>14}{'bare is':>12}")
    for name, cost_us in costs.items():
        print(f"{name:<20}{cost_us:>11.1f} us{costs[BARE] / cost_us:>6.2f} times")
    if chosen.tls:
        print(f"TLS costs {costs[LINK_OVER_TLS] / costs[LINK]:.2f} times the link without")
    figures = common.Figures()
    bare = f"{BARE} {costs[BARE]:.1f} us"
    for name, limit in ((BY_HAND, ""), (LINK, ""), (READ, ""), (POLL, "at most 0.5")):
        figures.add(f"CPU of one poll: {name}", f"{costs[name]:.1f} us", bare, costs[name] / costs[BARE], limit)
    ours_us = costs[POLL] - costs[BY_HAND]
    figures.add("CPU of one poll: what we add", f"{ours_us:.1f} us", f"{BY_HAND} {costs[BY_HAND]:.1f} us", None, "2 us")
    figures.write(chosen.figures)


if __name__ == "__main__":
    main()
