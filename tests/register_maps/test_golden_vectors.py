"""Every shipped map against bytes typed by hand from its source: what the driver sends, understands, and meets.

The simulated lift is asked through pymodbus's server over a real socket, with a clock that is set by hand.
"""

import asyncio
import math
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import asynccontextmanager
from functools import cache, partial
from itertools import pairwise

import pytest

from drivers.errors import HeartbeatAwaited
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryWire, Reply
from drivers.modbus.standstill import STILL_S
from drivers.modbus.units import Unit
from drivers.model import Command, CommandKind, Outcome, Result
from register_maps.codec import Codec, Point, compile_map
from register_maps.load import MapChanges, load, shipped
from simulator import shaft
from simulator.controller import Parameters
from simulator.modes import Key
from simulator.registers import RegisterFace
from simulator.server import SimulatedController
from tests.drivers.caller import Caller
from tests.register_maps.golden.adam_io import ADAM_IO
from tests.register_maps.golden.adam_pushbutton import ADAM_PUSHBUTTON
from tests.register_maps.golden.generic_coils import GENERIC_COILS
from tests.register_maps.golden.generic_coils_cluster import GENERIC_COILS_CLUSTER
from tests.register_maps.golden.generic_registers import GENERIC_REGISTERS
from tests.register_maps.golden.generic_registers_cluster import GENERIC_REGISTERS_CLUSTER
from tests.register_maps.golden.moxa_e1211 import MOXA_E1211
from tests.register_maps.golden.moxa_e1212 import MOXA_E1212
from tests.register_maps.golden.moxa_e1214 import MOXA_E1214
from tests.register_maps.golden.robotnik_il_eth import ROBOTNIK_IL_ETH, ROBOTNIK_IL_ETH_OUTPUT_4
from tests.register_maps.golden.seer_generic import SEER_GENERIC
from tests.register_maps.golden.seer_lps3_two_stop import SEER_LPS3_TWO_STOP
from tests.register_maps.golden.seer_siemens_chengdu import SEER_SIEMENS_CHENGDU, SEER_SIEMENS_CHENGDU_FROM_1
from tests.register_maps.golden.seer_siemens_chengdu_block import SEER_SIEMENS_CHENGDU_BLOCK
from tests.register_maps.golden.thingweb_elevator import THINGWEB_ELEVATOR
from tests.register_maps.golden.two_stop_agv import TWO_STOP_AGV, TWO_STOP_AGV_MOVED
from tests.register_maps.golden.vectors import Does, Frames, Golden, Says, frames_of
from tests.register_maps.golden.wago_750 import WAGO_750
from tests.register_maps.golden.waveshare_relay import WAVESHARE_RELAY
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual

GOLDEN = (
    ADAM_IO,
    ADAM_PUSHBUTTON,
    GENERIC_COILS,
    GENERIC_COILS_CLUSTER,
    GENERIC_REGISTERS,
    GENERIC_REGISTERS_CLUSTER,
    MOXA_E1211,
    MOXA_E1212,
    MOXA_E1214,
    ROBOTNIK_IL_ETH,
    ROBOTNIK_IL_ETH_OUTPUT_4,
    SEER_GENERIC,
    SEER_LPS3_TWO_STOP,
    SEER_SIEMENS_CHENGDU,
    SEER_SIEMENS_CHENGDU_FROM_1,
    SEER_SIEMENS_CHENGDU_BLOCK,
    THINGWEB_ELEVATOR,
    TWO_STOP_AGV,
    TWO_STOP_AGV_MOVED,
    WAGO_750,
    WAVESHARE_RELAY,
)
POLL_S = 0.1


def allowed() -> None:
    return None


@cache
def codec_of(title: str) -> Codec:
    """The map that the vectors of this title are about, read once for all tests: it never changes."""
    (golden,) = (golden for golden in GOLDEN if golden.title == title)
    changes = MapChanges(parameters=golden.parameters, override=golden.override)
    return compile_map(load(golden.map_name, changes=changes).map)


def plain(frame: bytes) -> str:
    """A frame as the vectors have it: without its transaction id."""
    return frame[2:].hex(" ").upper()


def counted(frame: str, at: int) -> str:
    """The frame with another count in its alive counter."""
    data = bytearray.fromhex(frame)
    data[at] ^= 1
    return data.hex(" ").upper()


async def first_look(lift: Caller, bench: "Bench", alive: Point) -> None:
    """Read once with another count than the vectors have: what is read counts once the counter was seen to change."""
    # protocol 2, length 2, unit, function, count of bytes; two for each register of the poll up to the counter
    bench.counts_at = 7 + 2 * (alive.address - bench.first_polled) + 1
    with pytest.raises(HeartbeatAwaited):
        await lift.read()
    bench.counts_at, bench.polled = None, 0


class Bench:
    """A lift that knows nothing but typed bytes: the poll, the request that must come next, and a block written all the time."""

    def __init__(self, golden: Golden, says: Frames, script: Iterable[tuple[str, str]]) -> None:
        self.says = says
        self.after: Frames | None = None
        """What the poll says once `wait` more of the scripted requests were answered, and the one after them."""
        self.wait = 0
        self.polled = 0
        """Requests of polls."""
        self.cycles: list[float] = []
        self.counts_at: int | None = None
        """Byte of the poll's answer that is other than typed for now: of the alive counter."""
        self.heard: list[tuple[float, str]] = []
        self._poll = frames_of(golden.poll)
        self.first_polled = int.from_bytes(bytes.fromhex(self._poll[0].split(": ")[-1])[6:8], "big")
        self._cycle = golden.cycle
        self._script = deque((request, answer, -math.inf) for request, answer in script)
        self._read_back: dict[str, str] = {}
        """What was answered last to requests of the script: a poll may ask the same."""

    @property
    def polls(self) -> float:
        """Whole polls."""
        return self.polled / len(self._poll)

    def extend(self, script: Iterable[tuple[str, str, float]], *, after: Frames, wait: int = 0) -> None:
        """Expect these requests next: what is asked, what is answered, and before when it is a poll that asks the same."""
        self._script.extend(script)
        self.after, self.wait = after, wait

    def answers(self, device: str = "") -> Callable[[bytes], list[Reply]]:
        """What the lift's controller, or a second device of this name, answers."""
        name = f"{device}: " if device else ""

        def answer(frame: bytes) -> list[Reply]:
            said = self._answer(name + plain(frame))
            return [] if said is None else [(0.0, frame[:2] + bytes.fromhex(said.removeprefix(name)))]

        return answer

    def _answer(self, request: str) -> str | None:
        now = asyncio.get_running_loop().time()
        expected = self._script[0][0] if self._script and now >= self._script[0][2] else None
        if request in self._poll and request != expected:
            self.polled += 1
            said = self._read_back.get(request, frames_of(self.says)[self._poll.index(request)])
            return said if self.counts_at is None else counted(said, self.counts_at)
        if request != expected and self._cycle is not None and request == self._cycle[0]:
            self.cycles.append(now)
            return self._cycle[1]
        self.heard.append((now, request))
        if request != expected:
            return None
        if self.after is not None and self.wait == 0:
            self.says, self.after = self.after, None
        self.wait -= 1
        answer = self._read_back[request] = self._script.popleft()[1]
        return answer


@asynccontextmanager
async def driven(golden: Golden, bench: Bench, *, control: bool) -> AsyncIterator[Caller]:
    """The real driver on this bench."""
    codec = codec_of(golden.title)
    links = {
        device: Link(partial(MemoryWire, bench.answers(device)), LinkSettings(), name=device or "plc")
        for device in ("", *codec.map.endpoints)
    }
    unit_id = codec.map.unit_of("")
    # a look at our outputs now and then is no part of any command
    settings = LiftSettings(name="lift", floors=golden.floors, control=control, unit_id=unit_id, look_s=math.inf)
    endpoints = {device: Unit(links[device], codec.map.unit_of(device)) for device in codec.map.endpoints}
    lift = Caller(ModbusLift(codec, links[""], settings, endpoints))
    running: list[Link | Caller] = [*links.values(), lift]
    tasks = [asyncio.ensure_future(part.run()) for part in running]
    for link in links.values():
        await link.wait_up()
    alive = codec.signals.get("alive")
    if alive is not None:
        await first_look(lift, bench, alive.points[0])
    try:
        yield lift
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def give(lift: Caller, command: Command, *, press: bool | None = None) -> asyncio.Future[Outcome] | None:
    """Press or hold; of a command that comes before, its kind tells which."""
    if press or (press is None and command.kind not in (CommandKind.HOLD_DOOR, CommandKind.ROBOT_MODE)):
        return lift.press(command, allowed)
    lift.hold(command, allowed)
    return None


def each(attribute: str) -> Sequence[object]:
    return [
        pytest.param(golden, vector, id=f"{golden.title}: {vector.words}")
        for golden in GOLDEN
        for vector in getattr(golden, attribute)
    ]


each_map = each_row("golden", GOLDEN)


def test_every_shipped_map_has_golden_vectors() -> None:
    assert shipped() == tuple(sorted({golden.map_name for golden in GOLDEN}))


@each_map
def test_a_poll_is_these_requests(golden: Golden) -> None:
    bench = Bench(golden, golden.says[0].answer, ())

    async def main() -> None:
        async with driven(golden, bench, control=False) as lift:
            await lift.read()
            await lift.read()

    run_virtual(main)
    assert bench.heard == []
    assert bench.polls == 2


@each_map
def test_a_new_connection_is_first_polled_and_then_asked_for_our_own_outputs(golden: Golden) -> None:
    bench = Bench(golden, golden.says[0].answer, golden.takes_over)

    async def main() -> None:
        async with driven(golden, bench, control=True) as lift:
            for _ in range(20):
                await lift.read()
                await elapse(POLL_S)

    run_virtual(main)
    assert [request for _, request in bench.heard] == [request for request, _ in golden.takes_over]
    assert bench.polls == 20


@pytest.mark.parametrize("golden", [golden for golden in GOLDEN if golden.cycle], ids=lambda golden: golden.title)
def test_a_block_that_is_written_all_the_time_is_written_at_rest_too(golden: Golden) -> None:
    bench = Bench(golden, golden.says[0].answer, golden.takes_over)

    async def main() -> None:
        async with driven(golden, bench, control=True) as lift:
            for _ in range(50):
                await lift.read()
                await elapse(POLL_S)

    run_virtual(main)
    gaps = [later - earlier for earlier, later in pairwise(bench.cycles)]
    assert len(gaps) >= 4
    assert gaps == pytest.approx([golden.cycle_s] * len(gaps), abs=0.01)


@each_row(("golden", "vector"), each("says"))
def test_an_answer_means_what_its_source_says(golden: Golden, vector: Says) -> None:
    bench = Bench(golden, vector.answer, ())

    async def main() -> None:
        async with driven(golden, bench, control=False) as lift:
            assert (await lift.read()).values == vector.values

    run_virtual(main)


@each_map
def test_answers_mean_the_same_whatever_came_before_them(golden: Golden) -> None:
    bench = Bench(golden, golden.says[0].answer, ())

    async def main() -> None:
        async with driven(golden, bench, control=False) as lift:
            for vector in (*golden.says, *reversed(golden.says)):
                bench.says = vector.answer
                assert (await lift.read()).values == vector.values, vector.words

    run_virtual(main)


@each_row(("golden", "vector"), each("does"))
def test_a_command_is_these_bytes_at_these_times_and_nothing_else(golden: Golden, vector: Does) -> None:
    bench = Bench(golden, vector.poll_before, golden.takes_over)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with driven(golden, bench, control=True) as lift:

            async def poll(until: float) -> None:
                while loop.time() < until - POLL_S / 2:
                    await lift.read()
                    await elapse(POLL_S)

            # so long that the car is known to stand; a lift with an alive counter, which stands still here, tells motion
            codec = codec_of(golden.title)
            still_s = codec.map.at_floor_evidence.for_s or (0.0 if "alive" in codec.signals else STILL_S)
            await poll(loop.time() + max(1.0, still_s + POLL_S))
            if vector.before is not None:
                bench.extend([(*step, -math.inf) for step in vector.before_by], after=vector.poll_before)
                give(lift, vector.before)
                await poll(loop.time() + vector.before_s)
            given, taken_over = loop.time(), len(bench.heard)
            end = given + vector.exchanges[-1].at_s + vector.lasts_s + 1.0
            script = [(step.request, step.answer, given + step.at_s - 0.01) for step in vector.exchanges]
            bench.extend(script, after=vector.poll_after, wait=vector.shows_after)
            outcome = give(lift, vector.command, press=vector.proof is not None)
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
            assert vector.before is None or lift.held(vector.before) is not vector.gives_way
            if outcome is not None:
                done = await outcome
                assert (done.result, done.proof) == (Result.CONFIRMED, vector.proof)
                # the outcome keeps the press as it left: from the unit id on
                press = vector.press or (vector.exchanges[0].request,)
                assert done.frames == tuple(bytes.fromhex(request)[4:].hex() for request in press)

    run_virtual(main)


@each_row("golden", [golden for golden in GOLDEN if golden.face])
def test_the_simulated_lift_meets_the_same_bytes_as_a_lift_of_this_map_would(golden: Golden) -> None:
    building = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(len(golden.floors))))
    face = RegisterFace(codec_of(golden.title), tuple(golden.floors.values()), building, key=Key(golden.key))

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
