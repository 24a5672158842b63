"""Every shipped map against bytes typed by hand from its source: what the driver sends, understands, and meets.

The simulated lift is asked through pymodbus's server over a real socket, with a clock that is set by hand.
"""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Iterable, Sequence
from contextlib import asynccontextmanager

import pytest

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryWire, Reply
from drivers.model import Result
from register_maps.codec import Codec, compile_map
from register_maps.load import load, shipped
from simulator import shaft
from simulator.controller import Parameters
from simulator.modes import Key
from simulator.registers import RegisterFace
from simulator.server import SimulatedController
from tests.register_maps.golden.generic_registers import GENERIC_REGISTERS
from tests.register_maps.golden.two_stop_agv import TWO_STOP_AGV
from tests.register_maps.golden.vectors import Does, Golden, Says
from tests.support.virtual_time import elapse, run_virtual

GOLDEN = (GENERIC_REGISTERS, TWO_STOP_AGV)
POLL_S = 0.1


def allowed() -> None:
    return None


def compiled(golden: Golden) -> Codec:
    return compile_map(load(golden.map_name).map)


def plain(frame: bytes) -> str:
    """A frame as the vectors have it: without its transaction id."""
    return frame[2:].hex(" ").upper()


class Bench:
    """A controller that knows nothing but typed bytes: the poll, and the one request that must come next."""

    def __init__(self, poll: str, says: str, script: Iterable[tuple[str, str]]) -> None:
        self.says = says
        self.after: str | None = None
        """What the poll says from the answer to the next scripted request on."""
        self.polls = 0
        self.heard: list[tuple[float, str]] = []
        self._poll = poll
        self._script = deque(script)

    def extend(self, script: Iterable[tuple[str, str]], *, after: str) -> None:
        self._script.extend(script)
        self.after = after

    def answer(self, frame: bytes) -> list[Reply]:
        request, tid = plain(frame), frame[:2]
        if request == self._poll:
            self.polls += 1
            return [(0.0, tid + bytes.fromhex(self.says))]
        self.heard.append((asyncio.get_running_loop().time(), request))
        if not self._script or self._script[0][0] != request:
            return []
        if self.after is not None:
            self.says, self.after = self.after, None
        return [(0.0, tid + bytes.fromhex(self._script.popleft()[1]))]


@asynccontextmanager
async def driven(golden: Golden, bench: Bench, *, control: bool) -> AsyncIterator[ModbusLift]:
    """The real driver on this bench."""
    link = Link(lambda: MemoryWire(bench.answer), LinkSettings(), name="plc")
    lift = ModbusLift(compiled(golden), link, LiftSettings(name="lift", floors=golden.floors, control=control))
    tasks = [asyncio.ensure_future(link.run()), asyncio.ensure_future(lift.run())]
    await link.wait_up()
    try:
        yield lift
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def each(attribute: str) -> Sequence[object]:
    return [
        pytest.param(golden, vector, id=f"{golden.map_name}: {vector.words}")
        for golden in GOLDEN
        for vector in getattr(golden, attribute)
    ]


each_map = pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.map_name)


def test_every_shipped_map_has_golden_vectors() -> None:
    assert shipped() == tuple(sorted(golden.map_name for golden in GOLDEN))


@each_map
def test_a_poll_is_this_one_request(golden: Golden) -> None:
    bench = Bench(golden.poll, golden.says[0].answer, ())

    async def main() -> None:
        async with driven(golden, bench, control=False) as lift:
            await lift.read()
            await lift.read()

    run_virtual(main)
    assert bench.heard == []
    assert bench.polls == 2


@each_map
def test_a_new_connection_is_first_polled_and_then_asked_for_our_own_outputs(golden: Golden) -> None:
    bench = Bench(golden.poll, golden.says[0].answer, golden.takes_over)

    async def main() -> None:
        async with driven(golden, bench, control=True) as lift:
            for _ in range(20):
                await lift.read()
                await elapse(POLL_S)

    run_virtual(main)
    assert [request for _, request in bench.heard] == [request for request, _ in golden.takes_over]
    assert bench.polls == 20


@pytest.mark.parametrize(("golden", "vector"), each("says"))
def test_an_answer_means_what_its_source_says(golden: Golden, vector: Says) -> None:
    bench = Bench(golden.poll, vector.answer, ())

    async def main() -> None:
        async with driven(golden, bench, control=False) as lift:
            assert (await lift.read()).values == vector.values

    run_virtual(main)


@each_map
def test_answers_mean_the_same_whatever_came_before_them(golden: Golden) -> None:
    bench = Bench(golden.poll, golden.says[0].answer, ())

    async def main() -> None:
        async with driven(golden, bench, control=False) as lift:
            for vector in (*golden.says, *reversed(golden.says)):
                bench.says = vector.answer
                assert (await lift.read()).values == vector.values, vector.words

    run_virtual(main)


@pytest.mark.parametrize(("golden", "vector"), each("does"))
def test_a_command_is_these_bytes_at_these_times_and_nothing_else(golden: Golden, vector: Does) -> None:
    bench = Bench(golden.poll, vector.poll_before, golden.takes_over)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with driven(golden, bench, control=True) as lift:

            async def poll(until: float) -> None:
                while loop.time() < until - POLL_S / 2:
                    await lift.read()
                    await elapse(POLL_S)

            await poll(loop.time() + 1.0)
            given, taken_over = loop.time(), len(bench.heard)
            end = given + vector.exchanges[-1].at_s + 1.0
            bench.extend([(step.request, step.answer) for step in vector.exchanges], after=vector.poll_after)
            outcome = None
            if vector.proof is None:
                lift.hold(vector.command, allowed)
            else:
                outcome = lift.press(vector.command, allowed)
            if vector.let_go_s is not None:
                await poll(given + vector.let_go_s)
                assert vector.proof is not None or lift.held(vector.command)
                lift.let_go(vector.command)
            await poll(end)

            heard = bench.heard[taken_over:]
            assert [request for _, request in heard] == [step.request for step in vector.exchanges]
            times = [at - given for at, _ in heard]
            assert times == pytest.approx([step.at_s for step in vector.exchanges], abs=0.01)
            assert not lift.held(vector.command)
            if outcome is not None:
                done = await outcome
                assert (done.result, done.proof) == (Result.CONFIRMED, vector.proof)
                # the outcome keeps the press as it left: from the unit id on
                assert done.frames == (bytes.fromhex(vector.exchanges[0].request)[4:].hex(),)

    run_virtual(main)


@each_map
def test_the_simulated_lift_meets_the_same_bytes_as_a_lift_of_this_map_would(golden: Golden) -> None:
    building = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(len(golden.floors))))
    face = RegisterFace(compiled(golden), tuple(golden.floors.values()), building, key=Key(golden.key))

    async def main() -> None:
        now = 0.0
        server = SimulatedController({1: face}, clock=lambda: now)
        await server.start()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        try:
            for number, vector in enumerate(golden.face, start=1):
                now = vector.at_s
                writer.write(number.to_bytes(2, "big") + bytes.fromhex(vector.request))
                head = await reader.readexactly(6)
                answer = head + await reader.readexactly(head[5])
                assert plain(answer) == vector.answer, f"at {now} s: {vector.words}"
                assert int.from_bytes(answer[:2], "big") == number
        finally:
            writer.close()
            await writer.wait_closed()
            await server.stop()

    asyncio.run(main())
