"""The Modbus/TCP server in front of simulated lifts, over real sockets: pymodbus's own client, and bare bytes."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import pytest
from pymodbus.client import AsyncModbusTcpClient

from register_maps.words import Table
from simulator import shaft
from simulator.controller import Parameters
from simulator.registers import ExceptionReply, RegisterFace
from simulator.server import SimulatedController
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled

HOST = "127.0.0.1"
ANSWERS_WITHIN_S = 60.0
SPAN = 200
"""Cells in each table of a notebook."""


@dataclass
class Notebook:
    """A device that remembers what it was asked, in order."""

    cells: dict[Table, list[int]] = field(default_factory=lambda: {table: [0] * SPAN for table in Table})
    writes: list[tuple[Table, int, list[int]]] = field(default_factory=list)
    reads: list[tuple[Table, int, int]] = field(default_factory=list)
    objects: int = 0
    """Exception code that it answers everything with; 0: none."""
    pulses: list[tuple[int, int]] | None = None
    """Durations that its coils were written with; None: they take none."""

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        self.check(address + count)
        self.reads.append((table, address, count))
        return self.cells[table][address : address + count]

    def write(self, table: Table, address: int, values: list[int], now: float) -> None:
        self.check(address + len(values))
        self.writes.append((table, address, values))
        self.cells[table][address : address + len(values)] = values

    def stored(self, table: Table, address: int, now: float) -> int:
        self.check(address + 1)
        return self.cells[table][address]

    def pulse(self, address: int, counts: int, now: float) -> None:
        self.check(address + 1)
        if self.pulses is None:
            raise ExceptionReply(3)
        self.pulses.append((address, counts))

    def check(self, end: int) -> None:
        if self.objects or end > SPAN:
            raise ExceptionReply(self.objects or 2)


@dataclass
class Line:
    """A bare TCP connection."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    def send(self, *frames: str) -> None:
        """Send these bytes in one segment."""
        self.writer.write(b"".join(bytes.fromhex(frame) for frame in frames))

    async def answer(self) -> str:
        """The next frame that comes."""
        async with asyncio.timeout(ANSWERS_WITHIN_S):
            head = await self.reader.readexactly(6)
            return (head + await self.reader.readexactly(head[5])).hex(" ").upper()

    async def ended(self) -> bool:
        """Whether the other side has closed the connection, or does so now."""
        async with asyncio.timeout(ANSWERS_WITHIN_S):
            try:
                return await self.reader.read(1) == b""
            except ConnectionError:
                return True

    async def close(self) -> None:
        self.writer.close()
        await asyncio.gather(self.writer.wait_closed(), return_exceptions=True)


@asynccontextmanager
async def line(port: int) -> AsyncIterator[Line]:
    made = Line(*await asyncio.open_connection(HOST, port))
    try:
        yield made
    finally:
        await made.close()


@asynccontextmanager
async def client(port: int) -> AsyncIterator[AsyncModbusTcpClient]:
    made = AsyncModbusTcpClient(HOST, port=port, retries=0, reconnect_delay=0, timeout=ANSWERS_WITHIN_S)
    assert await made.connect()
    try:
        yield made
    finally:
        made.close()


def with_server(check: Callable[[SimulatedController, Notebook], Awaitable[None]]) -> None:
    """Run a check against a server of one notebook at unit 1."""

    async def main() -> None:
        notebook = Notebook()
        server = SimulatedController({1: notebook})
        await server.start()
        try:
            await check(server, notebook)
        finally:
            await server.stop()

    asyncio.run(main())


# -- functions


def test_every_read_and_write_function_reaches_its_table() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        for number, table in enumerate(Table, start=1):
            notebook.cells[table][7:10] = [number % 2, 1, 0]
        notebook.cells[Table.HOLDING][7:10] = [1000, 65535, 0]
        notebook.cells[Table.INPUT][7:10] = [2000, 0, 65535]
        async with client(server.port) as modbus:
            assert (await modbus.read_coils(7, count=3)).bits[:3] == [True, True, False]
            assert (await modbus.read_discrete_inputs(7, count=3)).bits[:3] == [False, True, False]
            assert (await modbus.read_holding_registers(7, count=3)).registers == [1000, 65535, 0]
            assert (await modbus.read_input_registers(7, count=3)).registers == [2000, 0, 65535]
            answers = [
                await modbus.write_coil(1, value=True),
                await modbus.write_register(2, 65535),
                await modbus.write_coils(3, [True, False, True]),
                await modbus.write_registers(4, [1, 2, 3]),
            ]
        assert not any(answer.isError() for answer in answers)
        assert notebook.writes == [
            (Table.COIL, 1, [1]),
            (Table.HOLDING, 2, [65535]),
            (Table.COIL, 3, [1, 0, 1]),
            (Table.HOLDING, 4, [1, 2, 3]),
        ]
        assert notebook.reads[:4] == [(table, 7, 3) for table in Table]

    with_server(check)


def test_the_longest_reads_and_writes_are_served() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with client(server.port) as modbus:
            assert len((await modbus.read_holding_registers(0, count=125)).registers) == 125
            await modbus.write_registers(0, list(range(123)))
            assert notebook.cells[Table.HOLDING][:123] == list(range(123))
            await modbus.write_coils(0, [True] * SPAN)
            assert (await modbus.read_coils(0, count=SPAN)).bits[:SPAN] == [True] * SPAN

    with_server(check)


def test_a_read_after_a_write_sees_it() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with client(server.port) as modbus:
            for value in (1, 0, 2, 65535):
                await modbus.write_register(16, value)
                assert (await modbus.read_holding_registers(16, count=1)).registers == [value]

    with_server(check)


def test_a_mask_write_changes_the_masked_bits_of_what_was_stored() -> None:
    # the example of the specification (V1.1b3, 6.16): register 4 holds 12, AND mask F2, OR mask 25, and holds 17 after it
    masked = "00 01 00 00 00 08 01 16 00 04 00 F2 00 25"

    async def check(server: SimulatedController, notebook: Notebook) -> None:
        notebook.cells[Table.HOLDING][4] = 0x12
        async with line(server.port) as raw:
            raw.send(masked)
            assert await raw.answer() == masked
        assert notebook.writes == [(Table.HOLDING, 4, [0x17])]
        assert notebook.reads == []

    with_server(check)


def test_a_mask_write_of_another_program_is_understood() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        notebook.cells[Table.HOLDING][9] = 0b1010
        async with client(server.port) as modbus:
            answer = await modbus.mask_write_register(address=9, and_mask=0b1101, or_mask=0b0010)
            assert not answer.isError()
        assert notebook.writes == [(Table.HOLDING, 9, [0b1010])]

    with_server(check)


@pytest.mark.parametrize(("word", "counts"), [("00 01", 1), ("00 05", 5), ("7F FF", 32767)])
def test_a_coil_written_with_a_duration_is_pulsed(word: str, counts: int) -> None:
    timed = f"00 01 00 00 00 06 01 05 00 20 {word}"

    async def check(server: SimulatedController, notebook: Notebook) -> None:
        notebook.pulses = []
        async with line(server.port) as raw:
            raw.send(timed)
            assert await raw.answer() == timed
        assert notebook.pulses == [(0x20, counts)]
        assert notebook.writes == []

    with_server(check)


def test_durations_and_plain_writes_of_one_segment_are_carried_out_in_order() -> None:
    on, timed, off = (
        "00 01 00 00 00 06 01 05 00 20 FF 00",
        "00 02 00 00 00 06 01 05 00 20 00 05",
        "00 03 00 00 00 06 01 05 00 20 00 00",
    )

    async def check(server: SimulatedController, notebook: Notebook) -> None:
        notebook.pulses = []
        async with line(server.port) as raw:
            raw.send(on, timed, off)
            assert [await raw.answer() for _ in range(3)] == [on, timed, off]
        assert notebook.writes == [(Table.COIL, 0x20, [1]), (Table.COIL, 0x20, [0])]
        assert notebook.pulses == [(0x20, 5)]

    with_server(check)


# -- exceptions and units


@each_row("code", [1, 2, 3, 4, 6])
def test_what_a_device_objects_is_answered_for_reads_and_for_writes(code: int) -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        notebook.objects = code
        async with client(server.port) as modbus:
            answers = [
                await modbus.read_coils(0, count=1),
                await modbus.read_discrete_inputs(0, count=1),
                await modbus.read_holding_registers(0, count=1),
                await modbus.read_input_registers(0, count=1),
                await modbus.write_coil(0, value=True),
                await modbus.write_register(0, 1),
                await modbus.write_coils(0, [True]),
                await modbus.write_registers(0, [1]),
                await modbus.mask_write_register(address=0, and_mask=1, or_mask=1),
            ]
            assert {answer.exception_code for answer in answers} == {code}
            notebook.objects = 0
            assert not (await modbus.read_coils(0, count=1)).isError()
        assert notebook.writes == []

    with_server(check)


@each_row(
    ("asked", "answer"),
    [
        # a function that does not exist
        ("00 05 00 00 00 06 01 42 00 00 00 01", "00 05 00 00 00 03 01 C2 01"),
        # more than a frame can carry, and nothing at all
        ("00 06 00 00 00 06 01 03 00 00 00 7E", "00 06 00 00 00 03 01 83 03"),
        ("00 07 00 00 00 06 01 03 00 00 00 00", "00 07 00 00 00 03 01 83 03"),
        # beyond the last address
        ("00 08 00 00 00 06 01 03 FF FF 00 02", "00 08 00 00 00 03 01 83 02"),
        # a coil that takes no duration, and values that are none
        ("00 0D 00 00 00 06 01 05 00 00 00 05", "00 0D 00 00 00 03 01 85 03"),
        ("00 0E 00 00 00 06 01 05 00 00 80 00", "00 0E 00 00 00 03 01 85 03"),
        ("00 0F 00 00 00 06 01 05 00 00 FF 01", "00 0F 00 00 00 03 01 85 03"),
        ("00 10 00 00 00 04 01 05 00 00", "00 10 00 00 00 03 01 85 03"),
        ("00 11 00 00 00 08 01 16 FF FF 00 00 00 00", "00 11 00 00 00 03 01 96 02"),
        # what it is, of a device without an identity, and a request for it that is cut short
        ("00 14 00 00 00 05 01 2B 0E 01 00", "00 14 00 00 00 03 01 AB 01"),
        ("00 15 00 00 00 03 01 2B 0E", "00 15 00 00 00 03 01 AB 01"),
        # units that nobody plays
        ("00 16 00 00 00 05 07 2B 0E 01 00", "00 16 00 00 00 03 07 AB 0B"),
        ("00 09 00 00 00 06 02 03 00 00 00 01", "00 09 00 00 00 03 02 83 0B"),
        ("00 0A 00 00 00 06 00 06 00 10 00 01", "00 0A 00 00 00 03 00 86 0B"),
        ("00 0B 00 00 00 08 FF 0F 00 00 00 01 01 01", "00 0B 00 00 00 03 FF 8F 0B"),
        ("00 12 00 00 00 06 07 05 00 00 00 05", "00 12 00 00 00 03 07 85 0B"),
        ("00 13 00 00 00 08 07 16 00 00 00 00 00 00", "00 13 00 00 00 03 07 96 0B"),
    ],
)
def test_what_it_cannot_do_is_answered_with_the_exception_of_the_specification(asked: str, answer: str) -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with line(server.port) as raw:
            raw.send(asked)
            assert await raw.answer() == answer
            # and the next request is answered as if nothing had been
            raw.send("00 0C 00 00 00 06 01 03 00 00 00 01")
            assert await raw.answer() == "00 0C 00 00 00 05 01 03 02 00 00"
        assert notebook.writes == []

    with_server(check)


def test_each_unit_has_registers_of_its_own() -> None:
    async def main() -> None:
        first, second = Notebook(), Notebook()
        server = SimulatedController({1: first, 17: second})
        await server.start()
        async with client(server.port) as modbus:
            await modbus.write_register(5, 11, device_id=1)
            await modbus.write_register(5, 22, device_id=17)
            assert (await modbus.read_holding_registers(5, count=1, device_id=1)).registers == [11]
            assert (await modbus.read_holding_registers(5, count=1, device_id=17)).registers == [22]
            assert (await modbus.read_holding_registers(5, count=1, device_id=2)).exception_code == 0x0B
        await server.stop()
        assert first.writes == [(Table.HOLDING, 5, [11])]
        assert second.writes == [(Table.HOLDING, 5, [22])]

    asyncio.run(main())


def identified(identity: dict[int, str], asked: str) -> str:
    """Return the answer of a controller with this identity to one request."""

    async def main() -> str:
        server = SimulatedController({1: Notebook()}, identity=identity)
        await server.start()
        try:
            async with line(server.port) as raw:
                raw.send(asked)
                return await raw.answer()
        finally:
            await server.stop()

    return asyncio.run(main())


@each_row(
    ("asked", "answer"),
    [
        # "AB", "C" and "1" from the first object on, from the last one on, and from one that is not there
        ("01 00", "01 02 00 00 03 00 02 41 42 01 01 43 02 01 31"),
        ("01 02", "01 02 00 00 01 02 01 31"),
        ("01 09", "01 02 00 00 03 00 02 41 42 01 01 43 02 01 31"),
        # with "M" as its model
        ("02 00", "02 02 00 00 04 00 02 41 42 01 01 43 02 01 31 05 01 4D"),
    ],
)
def test_a_controller_with_an_identity_says_what_it_is(asked: str, answer: str) -> None:
    identity = {0: "AB", 1: "C", 2: "1", 5: "M"}
    length = 3 + len(bytes.fromhex(answer))
    assert (
        identified(identity, f"00 01 00 00 00 05 01 2B 0E {asked}") == f"00 01 00 00 00 {length:02X} 01 2B 0E {answer}"
    )


def test_a_controller_with_basic_objects_alone_has_no_other_category() -> None:
    identity = {0: "AB", 1: "C", 2: "1"}
    answer = identified(identity, "00 01 00 00 00 05 01 2B 0E 02 00")
    assert answer == "00 01 00 00 00 12 01 2B 0E 02 01 00 00 03 00 02 41 42 01 01 43 02 01 31"
    assert identified(identity, "00 01 00 00 00 05 01 2B 0E 07 00") == "00 01 00 00 00 03 01 AB 03"


# -- order


def test_every_write_of_a_client_arrives_and_in_order() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with line(server.port) as raw:
            for number in range(200):
                raw.send(f"{number:04X} 0000 0006 01 06 0010 {number:04X}")
                assert (
                    await raw.answer()
                    == bytes.fromhex(f"{number:04X} 0000 0006 01 06 0010 {number:04X}").hex(" ").upper()
                )
        assert notebook.writes == [(Table.HOLDING, 16, [number]) for number in range(200)]

    with_server(check)


def test_a_press_and_its_release_in_one_segment_are_two_writes() -> None:
    press = "00 01 00 00 00 06 01 06 00 10 00 02"
    release = "00 02 00 00 00 06 01 06 00 10 00 00"

    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with line(server.port) as raw:
            raw.send(press, release)
            assert [await raw.answer(), await raw.answer()] == [press, release]
        assert notebook.writes == [(Table.HOLDING, 16, [2]), (Table.HOLDING, 16, [0])]

    with_server(check)


def test_requests_that_are_sent_without_waiting_are_each_carried_out_once() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with line(server.port) as raw:
            frames = [f"{number:04X} 0000 0006 01 06 0010 {number:04X}" for number in range(1, 21)]
            for frame in frames:
                raw.send(frame)
                await asyncio.sleep(0)
            answers = [await raw.answer() for _ in frames]
            assert answers == [bytes.fromhex(frame).hex(" ").upper() for frame in frames]
        assert [values for _, _, values in notebook.writes] == [[number] for number in range(1, 21)]

    with_server(check)


@pytest.mark.parametrize("requests", [22, 30, 100])
def test_every_request_of_one_long_segment_is_answered_in_order(requests: int) -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        # every tenth asks for a function that nobody knows; it is answered in its turn, too
        asked = [
            f"{number:04X} 0000 0006 01 {'63' if number % 10 == 9 else '06'} {number:04X} {number:04X}"
            for number in range(requests)
        ]
        async with line(server.port) as bare:
            bare.send(*asked)
            answers = [await bare.answer() for _ in asked]
        right = [
            f"{number:04X} 0000 0003 01 E3 01" if number % 10 == 9 else asked[number] for number in range(requests)
        ]
        assert [bytes.fromhex(answer) for answer in answers] == [bytes.fromhex(each) for each in right]
        written = [number for number in range(requests) if number % 10 != 9]
        assert notebook.writes == [(Table.HOLDING, number, [number]) for number in written]

    with_server(check)


def test_the_longest_request_and_one_behind_it_are_both_carried_out() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with line(server.port) as bare:
            bare.send("0001 0000 00FD 01 10 0000 007B F6" + "0007" * 123, "0002 0000 0006 01 06 0005 0009")
            assert await bare.answer() == "00 01 00 00 00 06 01 10 00 00 00 7B"
            assert await bare.answer() == "00 02 00 00 00 06 01 06 00 05 00 09"
        assert len(notebook.writes) == 2

    with_server(check)


def test_a_request_that_is_still_coming_in_while_an_answer_leaves_is_not_forgotten() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with line(server.port) as bare:
            bare.send("0001 0000 0006 01 06 0005 0009", "0002 0000 00")
            assert await bare.answer() == "00 01 00 00 00 06 01 06 00 05 00 09"
            bare.send("06 01 06 0006 0008")
            assert await bare.answer() == "00 02 00 00 00 06 01 06 00 06 00 08"
        assert len(notebook.writes) == 2

    with_server(check)


def test_a_request_may_come_in_pieces() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with line(server.port) as raw, client(server.port) as modbus:
            for piece in ("00 01 00", "00 00 06 01 06 00", "10 00"):
                raw.send(piece)
                # an answer to another client shows that the server has had its turn
                await modbus.read_coils(0, count=1)
            assert notebook.writes == []
            raw.send("02")
            assert await raw.answer() == "00 01 00 00 00 06 01 06 00 10 00 02"
        assert notebook.writes == [(Table.HOLDING, 16, [2])]

    with_server(check)


# -- clients and restarts


def test_several_clients_are_served_at_once_and_each_gets_its_own_answers() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async def work(place: int) -> None:
            async with client(server.port) as modbus:
                for value in range(50):
                    await modbus.write_register(place, value)
                    answer = await modbus.read_holding_registers(place, count=1)
                    assert answer.registers == [value]

        await asyncio.gather(*(work(place) for place in range(8)))
        for place in range(8):
            values = [values for _, address, values in notebook.writes if address == place]
            assert values == [[value] for value in range(50)]

    with_server(check)


def test_a_client_that_leaves_in_the_middle_of_a_request_disturbs_nobody() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with client(server.port) as modbus:
            for _ in range(20):
                async with line(server.port) as raw:
                    raw.send("00 01 00 00 00 06 01 06 00")
            assert not (await modbus.write_register(1, 1)).isError()
        assert notebook.writes == [(Table.HOLDING, 1, [1])]

    with_server(check)


def test_stopping_ends_every_connection() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        async with line(server.port) as one, line(server.port) as other:
            one.send("00 01 00 00 00 06 01 03 00 00 00 01")
            await one.answer()
            await server.stop()
            assert await one.ended()
            assert await other.ended()
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(HOST, server.port)

    with_server(check)


def test_it_starts_again_on_the_same_port_with_what_its_device_remembers() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        port = server.port
        for value in range(5):
            async with client(port) as modbus:
                await modbus.write_register(1, value)
                # while a client is still there: its end of the old connection lingers
                await server.stop()
                await server.start()
            assert server.port == port
            async with client(port) as modbus:
                assert (await modbus.read_holding_registers(1, count=1)).registers == [value]

    with_server(check)


def test_stopping_twice_is_as_good_as_once() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        await server.stop()
        await server.stop()

    with_server(check)


def test_a_port_that_is_taken_is_an_error_and_disturbs_its_owner_in_nothing() -> None:
    async def check(server: SimulatedController, notebook: Notebook) -> None:
        second = SimulatedController({1: Notebook()}, port=server.port)
        with pytest.raises(OSError, match="in use"):
            await second.start()
        async with client(server.port) as modbus:
            assert not (await modbus.write_register(1, 1)).isError()
        await second.stop()
        assert notebook.writes == [(Table.HOLDING, 1, [1])]

    with_server(check)


def test_two_servers_that_choose_their_ports_get_two() -> None:
    async def main() -> None:
        first, second = SimulatedController({1: Notebook()}), SimulatedController({1: Notebook()})
        await first.start()
        await second.start()
        assert first.port != second.port != 0
        await second.stop()
        await first.stop()

    asyncio.run(main())


# -- a lift behind it


def test_each_access_is_carried_out_at_the_time_its_clock_says() -> None:
    async def main() -> None:
        building = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(2)))
        face = RegisterFace(compiled("generic-registers"), (1, 2), building)
        now = 0.0
        server = SimulatedController({1: face}, clock=lambda: now)
        await server.start()
        async with client(server.port) as modbus:

            async def door() -> int:
                word: int = (await modbus.read_holding_registers(3, count=1)).registers[0]
                return word

            await modbus.write_register(17, 1)
            assert await door() == 1
            now = 1.0
            assert await door() == 2
            now = 2.5
            assert await door() == 3
            await modbus.write_register(17, 0)
            now = 6.5
            assert await door() == 4
        await server.stop()

    asyncio.run(main())
