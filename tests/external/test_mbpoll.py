"""Debian's mbpoll, which nobody here wrote, works a simulated lift: every function it has, and whole rides.

Real time and real sockets; car and doors run ten times as fast. Nothing waits: each look is a run of mbpoll, and their
number is bounded.
"""

import asyncio
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from register_maps.codec import compile_map
from register_maps.load import load
from simulator import shaft
from simulator.controller import Parameters
from simulator.modes import Key
from simulator.registers import RegisterFace
from simulator.server import SimulatedController

pytestmark = pytest.mark.external("mbpoll")

FOUR_TABLES = Path(__file__).parent / "four-tables.yaml"
GENERIC = "generic-registers"
TWO_STOP = "two-stop-agv"

COIL, DISCRETE, INPUT, HOLDING = "0", "1", "3", "4"
"""mbpoll's option -t."""

MOST_RUNS = 300
"""Of mbpoll, 25 ms each, in one wait. A ride of one floor takes 0.8 s at this speed; the rest is for a busy machine."""


@dataclass(frozen=True)
class Run:
    """What one run of mbpoll printed."""

    code: int
    values: dict[int, int]
    """By reference, as mbpoll numbers it."""
    said: str
    complaint: str
    """The last line of what it complained about."""
    sent: str
    """The request as it left, in hex after the transaction id."""


@dataclass(frozen=True)
class Mbpoll:
    """Mbpoll against one port."""

    port: int

    async def run(self, *words: str) -> Run:
        process = await asyncio.create_subprocess_exec(
            *("mbpoll", "-v", "-q", "-1", "-p", str(self.port), *words),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        out, complaint = (text.decode() for text in await process.communicate())
        values = {int(place): int(value) for place, value in re.findall(r"^\[(\d+)\]:\s+(\d+)", out, re.MULTILINE)}
        frame = re.search(r"^(?:\[[0-9A-F]{2}\]){9,}$", out, re.MULTILINE)
        sent = " ".join(re.findall("[0-9A-F]{2}", frame[0])[2:]) if frame else ""
        assert process.returncode is not None
        return Run(process.returncode, values, out, (complaint.strip().splitlines() or [""])[-1], sent)

    async def read(self, table: str, first: int, count: int = 1, *options: str) -> Run:
        return await self.run("-t", table, "-r", str(first), "-c", str(count), *options, "127.0.0.1")

    async def write(self, table: str, first: int, *values: int) -> Run:
        done = await self.run("-t", table, "-r", str(first), "127.0.0.1", *map(str, values))
        assert f"Written {len(values)} references." in done.said, done.complaint
        return done

    async def watch(
        self, table: str, first: int, count: int, until: Callable[[dict[int, int]], bool]
    ) -> dict[int, int]:
        """Look again and again; returns what was seen when it was so."""
        seen: dict[int, int] = {}
        for _ in range(MOST_RUNS):
            seen = (await self.read(table, first, count)).values
            if until(seen):
                return seen
        raise AssertionError(f"not within {MOST_RUNS} runs of mbpoll; it reads {seen}")


@asynccontextmanager
async def served(source: str | Path, floors: Mapping[str, int], key: Key) -> AsyncIterator[Mbpoll]:
    """A lift of this map, its doors slow to close again so that no look comes too late."""
    codec = compile_map(load(source).map)
    building = shaft.Parameters(heights_m=shaft.even_heights(len(floors)))
    face = RegisterFace(codec, tuple(floors.values()), Parameters(shaft=building, speed=10, dwell_s=600), key=key)
    server = SimulatedController({1: face})
    await server.start()
    try:
        yield Mbpoll(server.port)
    finally:
        await server.stop()


def with_mbpoll(
    source: str | Path,
    check: Callable[[Mbpoll], Awaitable[None]],
    floors: Mapping[str, int],
    key: Key = Key.NORMAL,
) -> None:
    async def main() -> None:
        async with served(source, floors, key) as tool:
            await check(tool)

    asyncio.run(main())


THREE = {"B1": -1, "L1": 1, "L2": 2}
TWO = {"4F": 0, "5F": 1}
BASEMENT = 0xFFFF


# -- every function


def test_it_reads_and_writes_each_of_the_four_tables_with_functions_1_to_6() -> None:
    async def check(tool: Mbpoll) -> None:
        coils = await tool.read(COIL, 1, 2)
        assert coils.values == {1: 0, 2: 0}
        assert coils.sent == "00 00 00 06 01 01 00 00 00 02"

        # not open, closed, level, no robot mode, no fire (active low), no obstruction
        inputs = await tool.read(DISCRETE, 1, 6)
        assert inputs.values == {1: 0, 2: 1, 3: 1, 4: 0, 5: 1, 6: 0}
        assert inputs.sent == "00 00 00 06 01 02 00 00 00 06"

        holding = await tool.read(HOLDING, 1, 2)
        assert holding.values == {1: 0, 2: 0}
        assert holding.sent == "00 00 00 06 01 03 00 00 00 02"

        # floor -1, stopped, no destination, no call
        words = await tool.read(INPUT, 1, 4)
        assert words.values == {1: BASEMENT, 2: 1, 3: 0, 4: 0}
        assert words.sent == "00 00 00 06 01 04 00 00 00 04"

        coil = await tool.write(COIL, 2, 1)
        assert coil.sent == "00 00 00 06 01 05 00 01 FF 00"
        assert (await tool.read(COIL, 1, 2)).values == {1: 0, 2: 1}

        register = await tool.write(HOLDING, 1, 2)
        assert register.sent == "00 00 00 06 01 06 00 00 00 02"
        assert (await tool.read(HOLDING, 1, 2)).values == {1: 2, 2: 0}

    with_mbpoll(FOUR_TABLES, check, THREE)


def test_it_writes_several_coils_and_registers_at_once_with_functions_15_and_16() -> None:
    async def check(tool: Mbpoll) -> None:
        coils = await tool.write(COIL, 1, 1, 1)
        assert coils.sent == "00 00 00 08 01 0F 00 00 00 02 01 03"
        assert (await tool.read(COIL, 1, 2)).values == {1: 1, 2: 1}

        registers = await tool.write(HOLDING, 1, 2, 0)
        assert registers.sent == "00 00 00 0B 01 10 00 00 00 02 04 00 02 00 00"
        assert (await tool.read(HOLDING, 1, 2)).values == {1: 2, 2: 0}

    with_mbpoll(FOUR_TABLES, check, THREE)


def test_numbers_count_from_1_unless_it_is_told_to_count_from_0() -> None:
    async def check(tool: Mbpoll) -> None:
        from_one = await tool.read(HOLDING, 2)
        from_zero = await tool.read(HOLDING, 1, 1, "-0")
        assert from_one.sent == from_zero.sent == "00 00 00 06 01 03 00 01 00 01"
        assert from_one.values == {2: BASEMENT}
        assert from_zero.values == {1: BASEMENT}

    with_mbpoll(GENERIC, check, THREE)


# -- rides


def test_a_floor_is_called_with_function_6_and_the_car_arrives() -> None:
    async def check(tool: Mbpoll) -> None:
        # generic-registers counts from 0: holding:18 is its robot mode and mbpoll's number 19
        await tool.write(HOLDING, 19, 1)
        await tool.watch(HOLDING, 6, 1, lambda seen: seen[6] & 0b10 != 0)
        await tool.write(HOLDING, 17, 2)
        await tool.watch(HOLDING, 1, 8, lambda seen: 2 in (seen[8], seen[2]))
        await tool.write(HOLDING, 17, 0)
        # floor 2, stopped, door open, level; the call is served
        arrived = await tool.watch(HOLDING, 1, 8, lambda seen: seen[4] == 3)
        assert arrived[2] == 2
        assert arrived[3] == 1
        assert arrived[6] & 0b101 == 0b101
        assert (arrived[7], arrived[8]) == (0, 0)

    with_mbpoll(GENERIC, check, THREE)


def test_a_floor_is_called_with_function_16_and_the_car_arrives() -> None:
    async def check(tool: Mbpoll) -> None:
        # go to, hold the door, robot mode, close: all four together, as a controller with cyclic writes has them
        await tool.write(HOLDING, 17, 0, 0, 1, 0)
        await tool.watch(HOLDING, 6, 1, lambda seen: seen[6] & 0b10 != 0)
        await tool.write(HOLDING, 17, 1, 0, 1, 0)
        await tool.watch(HOLDING, 1, 8, lambda seen: 1 in (seen[8], seen[2]))
        await tool.write(HOLDING, 17, 0, 1, 1, 0)
        arrived = await tool.watch(HOLDING, 1, 8, lambda seen: seen[4] == 3)
        assert arrived[2] == 1
        # and back down to -1, which is FFFF
        await tool.write(HOLDING, 17, 0, 0, 1, 1)
        await tool.watch(HOLDING, 4, 1, lambda seen: seen[4] == 1)
        await tool.write(HOLDING, 17, BASEMENT, 0, 1, 0)
        await tool.watch(HOLDING, 1, 8, lambda seen: BASEMENT in (seen[8], seen[2]))
        await tool.write(HOLDING, 17, 0, 0, 1, 0)
        arrived = await tool.watch(HOLDING, 1, 8, lambda seen: seen[4] == 3)
        assert arrived[2] == BASEMENT

    with_mbpoll(GENERIC, check, THREE)


def test_a_floor_is_called_with_function_15_and_the_car_arrives() -> None:
    async def check(tool: Mbpoll) -> None:
        # 22 of the source's value table: at 4F, closed, AGV mode
        before = await tool.read(DISCRETE, 1, 6)
        assert before.values == {1: 0, 2: 1, 3: 1, 4: 0, 5: 1, 6: 0}
        await tool.write(COIL, 1, 0, 1, 0, 0)
        between = await tool.watch(DISCRETE, 1, 6, lambda seen: (seen[3], seen[4]) == (0, 0))
        assert between[2] == 1
        arrived = await tool.watch(DISCRETE, 1, 6, lambda seen: seen[1] == 1)
        # 25: at 5F, open, AGV mode
        assert arrived == {1: 1, 2: 0, 3: 0, 4: 1, 5: 1, 6: 0}
        await tool.write(COIL, 1, 0, 0, 0, 0)

    with_mbpoll(TWO_STOP, check, TWO, Key.ROBOT)


def test_a_floor_is_called_with_function_5_and_the_car_arrives() -> None:
    async def check(tool: Mbpoll) -> None:
        await tool.write(COIL, 2, 1)
        arrived = await tool.watch(DISCRETE, 1, 6, lambda seen: seen[1] == 1)
        assert arrived == {1: 1, 2: 0, 3: 0, 4: 1, 5: 1, 6: 0}
        await tool.write(COIL, 2, 0)
        # hold closed until it is
        await tool.write(COIL, 4, 1)
        closed = await tool.watch(DISCRETE, 1, 6, lambda seen: seen[2] == 1)
        assert closed == {1: 0, 2: 1, 3: 0, 4: 1, 5: 1, 6: 0}

    with_mbpoll(TWO_STOP, check, TWO, Key.ROBOT)


def test_a_ride_is_seen_in_input_registers_and_discrete_inputs() -> None:
    async def check(tool: Mbpoll) -> None:
        await tool.write(HOLDING, 1, 2)
        going = await tool.watch(INPUT, 1, 4, lambda seen: seen[2] == 2)
        assert (going[3], going[4]) == (2, 2)
        await tool.write(HOLDING, 1, 0)
        there = await tool.watch(INPUT, 1, 4, lambda seen: seen[1] == 2 and seen[2] == 1)
        assert there[1] == 2
        await tool.watch(DISCRETE, 1, 6, lambda seen: (seen[1], seen[2], seen[3]) == (1, 0, 1))

    with_mbpoll(FOUR_TABLES, check, THREE)


# -- what is refused


def test_an_address_that_is_not_served_is_refused_with_exception_2() -> None:
    async def check(tool: Mbpoll) -> None:
        read = await tool.read(HOLDING, 9)
        assert read.code != 0
        assert read.complaint == "Read output (holding) register failed: Illegal data address"
        assert "<83><02>" in read.said

        written = await tool.run("-r", "9", "127.0.0.1", "5")
        assert written.code != 0
        assert written.complaint == "Write output (holding) register failed: Illegal data address"
        assert "<86><02>" in written.said

    with_mbpoll(GENERIC, check, THREE)


def test_a_table_that_is_not_there_is_refused_with_exception_1() -> None:
    async def check(tool: Mbpoll) -> None:
        read = await tool.read(COIL, 1)
        assert read.complaint == "Read discrete output (coil) failed: Illegal function"
        assert "<81><01>" in read.said

    with_mbpoll(GENERIC, check, THREE)


def test_a_unit_that_nobody_plays_is_refused_with_exception_0b() -> None:
    async def check(tool: Mbpoll) -> None:
        read = await tool.read(HOLDING, 1, 1, "-a", "7")
        assert read.complaint == "Read output (holding) register failed: Target device failed to respond"
        assert "<07><83><0B>" in read.said
        assert (await tool.read(HOLDING, 2)).values == {2: BASEMENT}

    with_mbpoll(GENERIC, check, THREE)
