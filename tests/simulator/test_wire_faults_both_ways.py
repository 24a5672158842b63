"""The same faults on the wire in memory and through the proxy: our link sees the same, and never a wrong answer."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import dataclass

import pytest
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusIOException

from drivers.errors import (
    AnswerMismatch,
    AnswerTimeout,
    ConnectionLost,
    ConnectProblem,
    ControllerException,
    DriverError,
    LinkDown,
)
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice, MemoryWire
from drivers.modbus.wire import PymodbusWire, Wire
from register_maps import frames
from register_maps.frames import Request
from register_maps.words import Table
from simulator.proxy import FaultProxy
from simulator.server import SimulatedController
from simulator.wire_faults import (
    EVERYTHING,
    WIRE_FAULTS,
    AcceptAndSayNothing,
    AnswerWithException,
    Bandwidth,
    ConnectionLimit,
    ConnectOutcome,
    Delay,
    DropAnswer,
    DropRequest,
    DuplicateAnswer,
    EchoPart,
    Exchange,
    GarbageAnswer,
    GarbageBefore,
    HalfOpen,
    LateAnswer,
    LongTailedDelay,
    MergeAnswers,
    RefuseConnections,
    ReorderAnswers,
    ResetConnection,
    SplitAnswer,
    Target,
    TruncateAnswer,
    UniformDelay,
    WireFault,
    WireFaults,
    WrongCount,
    WrongEcho,
    WrongFunction,
    WrongTransactionId,
    WrongUnit,
    faulty,
)
from tests.support.rows import each_row
from tests.support.virtual_time import run_virtual

SHORT_S = 0.08
"""Time-out of a link that is to run into it."""
LONG_S = 2.0
"""And of one that is not, however busy the machine is."""
LIMIT_S = 60.0
FIRST = frames.read(Table.HOLDING, 10, 3)
SECOND = frames.read(Table.HOLDING, 50, 3)
PRESS = frames.write_register(7, 1)
PRESSES = frames.write_registers(7, [1, 2])


class Cells:
    """Holding registers that say their own address plus 100, whatever is written."""

    def __init__(self) -> None:
        self.writes: list[list[int]] = []

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        return [100 + at for at in range(address, address + count)]

    def write(self, table: Table, address: int, values: list[int], now: float) -> None:
        self.writes.append(values)

    def stored(self, table: Table, address: int, now: float) -> int:
        return self.writes[-1][0]

    def pulse(self, address: int, counts: int, now: float) -> None:
        self.writes.append([counts])


class Bench:
    """One controller behind faults, and links to it."""

    def __init__(self, faults: WireFaults, make_wire: Callable[[], Wire], written: Callable[[], int]) -> None:
        self.faults = faults
        self.told: list[Exchange] = []
        faults.on_exchange = self.told.append
        self.written = written
        """How many writes the controller carried out."""
        self._make_wire = make_wire

    @contextlib.asynccontextmanager
    async def link(self, timeout_s: float) -> AsyncIterator[Link]:
        settings = LinkSettings(timeout_s=timeout_s, reconnect_min_s=0.01, reconnect_max_s=0.05, busy_retries=0)
        link = Link(self._make_wire, settings, name="lobby")
        async with asyncio.TaskGroup() as group:
            group.create_task(link.run())
            yield link
            await link.close()


class FaultyWire(MemoryWire):
    """A wire in memory that has faults."""

    def __init__(self, device: MemoryDevice, faults: WireFaults) -> None:
        self._far = faulty(device.answer, faults, asyncio.get_running_loop().time)
        super().__init__(self._far, admit=self._admitted)

    def close(self) -> None:
        super().close()
        self._far.close()

    def _admitted(self) -> ConnectProblem | None:
        return ConnectProblem.REFUSED if self._far.admit() is ConnectOutcome.REFUSED else None


Check = Callable[[Bench], Coroutine[object, object, None]]
Way = Callable[[list[WireFault], Check], None]


def in_memory(faults: list[WireFault], check: Check) -> None:
    device = MemoryDevice()
    device.values[Table.HOLDING] = {address: 100 + address for address in range(100)}
    engine = WireFaults(faults)
    bench = Bench(engine, lambda: FaultyWire(device, engine), lambda: len(device.writes))
    run_virtual(lambda: check(bench))


def through_the_proxy(faults: list[WireFault], check: Check) -> None:
    async def main() -> None:
        cells = Cells()
        server = SimulatedController({1: cells})
        await server.start()
        try:
            async with asyncio.timeout(LIMIT_S), FaultProxy("127.0.0.1", server.port, WireFaults(faults)) as proxy:
                await check(
                    Bench(proxy.faults, lambda: PymodbusWire("127.0.0.1", proxy.port), lambda: len(cells.writes))
                )
        finally:
            await server.stop()

    asyncio.run(main())


@pytest.fixture(params=[in_memory, through_the_proxy])
def way(request: pytest.FixtureRequest) -> Way:
    way: Way = request.param
    return way


CLASSES: dict[type[DriverError], str] = {
    AnswerTimeout: "time-out",
    AnswerMismatch: "mismatch",
    ConnectionLost: "lost",
    ControllerException: "exception",
    LinkDown: "down",
}


async def outcome(link: Link, request: Request) -> str:
    """The class of what the link says; a right answer is the only one that is an answer."""
    try:
        if request.is_write:
            await link.write(request)
            return "answer"
        payload = await link.read(request)
    except DriverError as error:
        return CLASSES[type(error)]
    expected = b"".join((100 + request.address + nth).to_bytes(2, "big") for nth in range(request.count))
    return "answer" if payload == expected else f"WRONG: {payload.hex(' ')}"


@dataclass(frozen=True)
class Case:
    """A fault at the first of three requests; the others are reads of other registers."""

    fault: WireFault
    first: str
    second: str = "answer"
    request: Request = FIRST
    carried_out: int = 0
    """Writes."""

    def __str__(self) -> str:
        common = f"times=1, probability=1.0, from_s=0.0, until_s=inf, on={EVERYTHING}"
        return f"{self.fault}".replace(f"{common}, ", "").replace(common, "")


CASES = [
    Case(DropRequest(times=1), "time-out"),
    Case(DropRequest(times=1), "time-out", request=PRESS),
    Case(DropAnswer(times=1), "time-out"),
    Case(DropAnswer(times=1), "time-out", request=PRESS, carried_out=1),
    *(Case(AnswerWithException(code, times=1), "exception") for code in (1, 2, 3, 4, 5, 6, 8)),
    Case(AnswerWithException(5, times=1, executed=True), "exception", request=PRESS, carried_out=1),
    Case(AnswerWithException(4, times=1), "exception", request=PRESS),
    Case(GarbageAnswer(times=1), "lost"),
    Case(GarbageAnswer(3, times=1), "time-out", "lost"),
    Case(ResetConnection(times=1), "lost", request=PRESS),
    Case(ResetConnection(times=1, executed=True), "lost", request=PRESS, carried_out=1),
    Case(HalfOpen(times=1), "time-out", "time-out"),
    Case(WrongTransactionId(times=1), "mismatch"),
    Case(WrongTransactionId(-1, times=1), "mismatch"),
    Case(WrongTransactionId(fixed=0, times=1), "mismatch"),
    Case(WrongUnit(times=1), "mismatch"),
    Case(WrongFunction(times=1), "mismatch"),
    Case(WrongCount(-1, times=1), "mismatch"),
    Case(WrongCount(1, times=1), "mismatch"),
    Case(WrongCount(-1, field_only=True, times=1), "mismatch"),
    Case(WrongCount(-1, times=1), "mismatch", request=PRESSES, carried_out=1),
    Case(WrongEcho(times=1), "mismatch", request=PRESS, carried_out=1),
    Case(WrongEcho(EchoPart.ADDRESS, times=1), "mismatch", request=PRESSES, carried_out=1),
    Case(TruncateAnswer(times=1), "time-out", "lost"),
    Case(TruncateAnswer(15, times=1), "time-out"),
    Case(GarbageBefore(times=1), "lost"),
    Case(DuplicateAnswer(times=1), "answer"),
    Case(DuplicateAnswer(0.02, times=1), "answer"),
    Case(SplitAnswer(times=1), "answer"),
    Case(SplitAnswer(15, 0.001, times=1), "answer"),
    Case(SplitAnswer(2, 0.1, times=1), "time-out"),
    Case(Delay(0.02, times=1), "answer"),
    Case(Delay(0.1, times=1), "time-out"),
    Case(UniformDelay(0.01, 0.03, times=1), "answer"),
    Case(LongTailedDelay(0.01, most_s=0.03, times=1), "answer"),
    Case(LateAnswer(0.1, times=1), "time-out"),
    Case(LateAnswer(5.0, times=1), "time-out"),
    Case(Bandwidth(1000.0, times=1), "answer"),
    Case(Bandwidth(250.0, times=1), "time-out"),
    Case(ReorderAnswers(times=1), "time-out"),
    Case(MergeAnswers(times=1), "time-out"),
    Case(AcceptAndSayNothing(times=1), "time-out", "time-out"),
    Case(ConnectionLimit(0, silent=True, times=1), "time-out", "time-out"),
]


@each_row("case", CASES)
def test_the_link_sees_the_same_in_memory_and_over_tcp(way: Way, case: Case) -> None:
    async def check(bench: Bench) -> None:
        async with bench.link(SHORT_S if "time-out" in (case.first, case.second) else LONG_S) as link:
            seen: list[str] = []
            for request in (case.request, SECOND, FIRST):
                await link.wait_up()
                seen.append(await outcome(link, request))
            assert seen == [case.first, case.second, "answer"]
        assert bench.written() == case.carried_out
        assert [struck.fault for struck in bench.faults.strikes] == [case.fault]

    way([case.fault], check)


def test_every_fault_is_in_the_table_but_those_that_differ() -> None:
    """A refused connection: in memory the attempt fails; over TCP it is made and reset, for the host accepts first.

    See `test_a_refused_client_gets_in_later`.
    """
    assert {type(case.fault) for case in CASES} == set(WIRE_FAULTS) - {RefuseConnections}


async def answered(link: Link) -> None:
    """Ask until there is an answer."""
    seen = ""
    while seen != "answer":
        await link.wait_up()
        seen = await outcome(link, FIRST)


def test_a_refused_client_gets_in_later(way: Way) -> None:
    async def check(bench: Bench) -> None:
        async with bench.link(LONG_S) as link:
            await answered(link)
            assert link.stats.failed_connects + link.stats.losses == 3

    way([RefuseConnections(times=3)], check)


def test_one_client_too_many_gets_in_when_another_has_left(way: Way) -> None:
    async def check(bench: Bench) -> None:
        async def too_many() -> None:
            async with bench.link(LONG_S) as link:
                await answered(link)

        async with asyncio.TaskGroup() as group, bench.link(LONG_S) as link:
            await answered(link)
            waiting = group.create_task(too_many())
            while not bench.faults.strikes:
                assert await outcome(link, SECOND) == "answer"
            assert not waiting.done()

    way([ConnectionLimit(1)], check)


# -- the classic traps: an answer to one question is never taken for the answer to another


TRAPS: list[list[WireFault]] = [
    [LateAnswer(0.1, on=Target(addresses=(10, 10)))],
    [WrongTransactionId(-1, probability=0.5), LateAnswer(0.1, probability=0.5)],
    [WrongTransactionId(fixed=0, probability=0.5)],
    [WrongCount(-1, probability=0.5), WrongCount(-1, field_only=True, probability=0.3)],
    [ReorderAnswers(probability=0.5), MergeAnswers(probability=0.5)],
    [DuplicateAnswer(0.01, probability=0.7), DropAnswer(probability=0.3)],
    [TruncateAnswer(3, probability=0.4), SplitAnswer(5, 0.002, probability=0.5)],
    [WrongUnit(probability=0.3), WrongFunction(probability=0.3), WrongEcho(probability=0.3)],
]


@each_row("faults", TRAPS)
def test_no_wrong_answer_is_taken_and_no_write_is_repeated(way: Way, faults: list[WireFault]) -> None:
    async def check(bench: Bench) -> None:
        seen: list[str] = []
        async with bench.link(SHORT_S) as link:
            for nth in range(9):
                await link.wait_up()
                seen.append(await outcome(link, (FIRST, SECOND, PRESS)[nth % 3]))
        assert not [each for each in seen if each.startswith("WRONG")]
        assert set(seen) > {"answer"}
        assert bench.written() == len({each.request for each in bench.told if each.executed and is_press(each.request)})

    way(faults, check)


def is_press(frame: bytes) -> bool:
    return frames.parse_request(frame).is_write


async def pymodbus_says(faults: list[WireFault], *asks: Request) -> list[list[int] | str]:
    """What pymodbus's own client makes of it, through the proxy: registers, or the name of its error."""
    server = SimulatedController({1: Cells()})
    await server.start()
    said: list[list[int] | str] = []
    try:
        async with FaultProxy("127.0.0.1", server.port, WireFaults(faults)) as proxy:
            client = AsyncModbusTcpClient("127.0.0.1", port=proxy.port, timeout=2 * SHORT_S, retries=0)
            await client.connect()
            for request in asks:
                try:
                    answer = await client.read_holding_registers(request.address, count=request.count)
                    said.append(list(answer.registers))
                except ModbusIOException as error:
                    said.append(type(error).__name__)
            client.close()
    finally:
        await server.stop()
    return said


SHORT_LIST: list[WireFault] = [WrongCount(-1, times=1)]
LATE_WITHOUT_ID: list[WireFault] = [MergeAnswers(times=1), WrongTransactionId(fixed=0, times=1)]


def test_the_traps_are_real_ones() -> None:
    """pymodbus's client walks into them (field notes C4 and C5)."""
    assert asyncio.run(pymodbus_says(SHORT_LIST, FIRST)) == [[110, 111]]
    assert asyncio.run(pymodbus_says(LATE_WITHOUT_ID, FIRST, SECOND)) == ["ModbusIOException", [110, 111, 112]]


def test_our_link_does_not_walk_into_them(way: Way) -> None:
    seen: list[str] = []

    def check(timeout_s: float) -> Check:
        async def two_reads(bench: Bench) -> None:
            async with bench.link(timeout_s) as link:
                for request in (FIRST, SECOND):
                    await link.wait_up()
                    seen.append(await outcome(link, request))

        return two_reads

    way(SHORT_LIST, check(LONG_S))
    way(LATE_WITHOUT_ID, check(2 * SHORT_S))
    assert seen == ["mismatch", "answer", "time-out", "mismatch"]
