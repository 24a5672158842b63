"""Wireshark's dissector, which nobody here wrote, reads what the driver sends and what it gets.

The frames of a run in virtual time are put into a capture file with headers made here, so that nothing depends on rights
to capture or on timing; tshark then says what it sees.
"""

import asyncio
import itertools
import struct
import subprocess
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.errors import HeartbeatAwaited
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice, MemoryWire, exception
from drivers.modbus.wire import Wire
from drivers.model import Command, CommandKind
from register_maps.words import Side, Table
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse, run_virtual

pytestmark = pytest.mark.external("tshark")

POLLS = 12
POLL_S = 0.1
MODBUS_PORT = 502
CLIENT_PORT = 49152
CLIENT, CONTROLLER = bytes((192, 0, 2, 1)), bytes((192, 0, 2, 2))
"""Addresses for documentation (RFC 5737)."""

GO_L2 = Command(CommandKind.GO_TO, "L2")
HOLD = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)

FIELDS = (
    "tcp.dstport",
    "mbtcp.trans_id",
    "mbtcp.unit_id",
    "modbus.func_code",
    "modbus.reference_num",
    "modbus.word_cnt",
    "modbus.bit_cnt",
    "modbus.data",
    "modbus.regnum16",
    "modbus.regval_uint16",
    "modbus.bitnum",
    "modbus.bitval",
    "modbus.exception_code",
    "modbus.request_frame",
    "_ws.malformed",
    "_ws.expert.message",
    "frame.protocols",
)


@dataclass(frozen=True)
class Sent:
    """One frame on the wire, and when."""

    at_s: float
    out: bool
    data: bytes


@dataclass(frozen=True)
class Seen:
    """One packet as tshark decodes it; fields that it does not have are empty."""

    fields: dict[str, str]

    def __getitem__(self, name: str) -> str:
        return self.fields[name]

    @property
    def is_request(self) -> bool:
        return self["tcp.dstport"] == str(MODBUS_PORT)

    @property
    def asked(self) -> tuple[str, ...]:
        """Function, address and count of a request."""
        count = self["modbus.word_cnt"] or self["modbus.bit_cnt"] or "1"
        return self["modbus.func_code"], self["modbus.reference_num"], count


# -- a capture file


def checksum(data: bytes) -> int:
    """Of the Internet protocols (RFC 1071)."""
    total: int = sum(struct.unpack(f"!{len(data) // 2 + len(data) % 2}H", data + b"\0" * (len(data) % 2)))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def packet(frame: Sent, sequence: int, acknowledged: int) -> bytes:
    """Ethernet, IPv4 and TCP around one frame."""
    source, target = (CLIENT, CONTROLLER) if frame.out else (CONTROLLER, CLIENT)
    ports = (CLIENT_PORT, MODBUS_PORT) if frame.out else (MODBUS_PORT, CLIENT_PORT)
    pushed = 0x5018  # five words of header, PSH and ACK
    tcp = struct.pack("!HHIIHHHH", *ports, sequence, acknowledged, pushed, 65535, 0, 0)
    pseudo = source + target + struct.pack("!BBH", 0, 6, len(tcp) + len(frame.data))
    tcp = tcp[:16] + struct.pack("!H", checksum(pseudo + tcp + frame.data)) + tcp[18:]
    ip = struct.pack("!BBHHHBBH", 0x45, 0, 40 + len(frame.data), 0, 0x4000, 64, 6, 0) + source + target
    ip = ip[:10] + struct.pack("!H", checksum(ip)) + ip[12:]
    ethernet = b"\x02\0\0\0\0\x02" + b"\x02\0\0\0\0\x01" + b"\x08\0"
    return ethernet + ip + tcp + frame.data


def capture(frames: Sequence[Sent]) -> bytes:
    """The classic pcap format: one header, then each packet with its time and length."""
    written = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    sequence = {True: 1, False: 1}
    for frame in frames:
        data = packet(frame, sequence[frame.out], sequence[not frame.out])
        sequence[frame.out] += len(frame.data)
        micros = round(frame.at_s * 1e6)
        written += struct.pack("<IIII", micros // 1_000_000, micros % 1_000_000, len(data), len(data)) + data
    return written


def decode(frames: Sequence[Sent], path: Path) -> list[Seen]:
    path.write_bytes(capture(frames))
    wanted = list(itertools.chain.from_iterable(("-e", name) for name in FIELDS))
    command = ["tshark", "-r", str(path), "-T", "fields", "-E", "separator=|", "-E", "aggregator= ", *wanted]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=240)
    lines = done.stdout.splitlines()
    return [Seen(dict(zip(FIELDS, line.split("|"), strict=True))) for line in lines]


# -- what is captured


def allowed() -> None:
    return None


def generic_registers() -> tuple[Sent, ...]:
    """Polls, a call of L2 at the first of them, and one answer with an exception at the last."""

    async def ride(device: MemoryDevice, lift: ModbusLift) -> None:
        # beat, floor -1, stopped, closed, robot mode, level and no fire, nothing asked
        device.values[Table.HOLDING].update(enumerate([7, 0xFFFF, 1, 1, 2, 0b111, 0, 0]))
        with pytest.raises(HeartbeatAwaited):
            await lift.read()
        device.values[Table.HOLDING][0] = 8
        await poll(lift, 1)
        outcome = lift.press(GO_L2, allowed)
        await poll(lift, POLLS - 2)
        outcome.cancel()
        device.fail_next(exception(2))
        await asyncio.gather(lift.read(), return_exceptions=True)

    return recorded("generic-registers", {"B1": -1, "L1": 1, "L2": 2}, ride)


def two_stop_agv() -> tuple[Sent, ...]:
    """Polls, and a door that is held and let go."""

    async def ride(device: MemoryDevice, lift: ModbusLift) -> None:
        device.values[Table.DISCRETE].update({0: 1, 2: 1, 4: 1})  # 21: at 4F, open, AGV mode
        await poll(lift, 1)
        lift.hold(HOLD, allowed)
        await poll(lift, 5)
        lift.let_go(HOLD)
        await poll(lift, POLLS - 6)

    return recorded("two-stop-agv", {"4F": 0, "5F": 1}, ride)


async def poll(lift: ModbusLift, times: int) -> None:
    for _ in range(times):
        await lift.read()
        await elapse(POLL_S)


def recorded(
    map_name: str, floors: dict[str, int], ride: Callable[[MemoryDevice, ModbusLift], Awaitable[None]]
) -> tuple[Sent, ...]:
    frames: list[Sent] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        device = MemoryDevice(delay_s=0.005)

        def tapped() -> Wire:
            wire: MemoryWire = device.wire()
            wire.on_bytes = lambda out, data: frames.append(Sent(loop.time(), out, data))
            return wire

        link = Link(tapped, LinkSettings(), name="plc")
        settings = LiftSettings(name="lift", floors=floors, control=True)
        lift = ModbusLift(compiled(map_name), link, settings)
        tasks = [asyncio.ensure_future(link.run()), asyncio.ensure_future(lift.run())]
        await link.wait_up()
        await ride(device, lift)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run_virtual(main)
    return tuple(frames)


@pytest.fixture(scope="module")
def generic(tmp_path_factory: pytest.TempPathFactory) -> list[Seen]:
    return decode(generic_registers(), tmp_path_factory.mktemp("capture") / "generic-registers.pcap")


@pytest.fixture(scope="module")
def two_stop(tmp_path_factory: pytest.TempPathFactory) -> list[Seen]:
    return decode(two_stop_agv(), tmp_path_factory.mktemp("capture") / "two-stop-agv.pcap")


def asked(packets: list[Seen], function: int) -> list[Seen]:
    return [packet for packet in packets if packet.is_request and packet["modbus.func_code"] == str(function)]


# -- what tshark says


@pytest.mark.parametrize("name", ["generic", "two_stop"])
def test_every_frame_is_modbus_and_none_is_malformed(name: str, request: pytest.FixtureRequest) -> None:
    packets: list[Seen] = request.getfixturevalue(name)
    assert packets
    for seen in packets:
        assert seen["frame.protocols"].endswith(":mbtcp:modbus"), seen
        assert seen["_ws.malformed"] == "", seen
        assert seen["mbtcp.unit_id"] == "1"
    complaints = [seen for seen in packets if seen["_ws.expert.message"] and not seen["modbus.exception_code"]]
    assert complaints == []


@pytest.mark.parametrize("name", ["generic", "two_stop"])
def test_every_request_has_its_own_transaction_id_and_exactly_one_answer(
    name: str, request: pytest.FixtureRequest
) -> None:
    packets: list[Seen] = request.getfixturevalue(name)
    requests = [seen["mbtcp.trans_id"] for seen in packets if seen.is_request]
    answers = [seen for seen in packets if not seen.is_request]
    assert len(set(requests)) == len(requests)
    assert [seen["mbtcp.trans_id"] for seen in answers] == requests
    # one transaction in flight: tshark finds the request of each answer in the packet before it (it looks for none for an
    # exception)
    for number, answer in enumerate(answers):
        assert answer["modbus.request_frame"] == str(2 * number + 1) or answer["modbus.exception_code"]


def test_a_poll_of_generic_registers_is_one_read_of_eight_holding_registers(generic: list[Seen]) -> None:
    polls = [seen for seen in asked(generic, 3) if seen.asked == ("3", "0", "8")]
    assert len(polls) == POLLS + 1
    # besides the polls: four looks at our own outputs on connecting, one after the release, and, when the controller
    # refused an address of the poll, one for each of its signals
    others = [seen.asked for seen in asked(generic, 3) if seen not in polls]
    assert others == [("3", str(address), "1") for address in (16, 17, 18, 19, 16, *range(8))]


def test_an_answer_of_generic_registers_carries_the_words_of_the_controller(generic: list[Seen]) -> None:
    first = next(seen for seen in generic if not seen.is_request)
    assert first["modbus.func_code"] == "3"
    assert first["modbus.regnum16"] == "0 1 2 3 4 5 6 7"
    assert first["modbus.regval_uint16"] == "7 65535 1 1 2 7 0 0"


def test_a_call_is_one_write_of_its_register_and_one_that_lets_go(generic: list[Seen]) -> None:
    writes = asked(generic, 6)
    assert [(seen["modbus.reference_num"], seen["modbus.data"]) for seen in writes] == [("16", "0002"), ("16", "0000")]
    functions = {seen["modbus.func_code"] for seen in generic}
    assert functions == {"3", "6"}


def test_an_exception_answer_is_seen_as_one(generic: list[Seen]) -> None:
    assert [seen["modbus.exception_code"] for seen in generic if seen["modbus.exception_code"]] == ["2"]


def test_a_poll_of_two_stop_agv_is_one_read_of_six_discrete_inputs(two_stop: list[Seen]) -> None:
    polls = asked(two_stop, 2)
    assert {seen.asked for seen in polls} == {("2", "0", "6")}
    assert len(polls) == POLLS


def test_an_answer_of_two_stop_agv_carries_the_bits_of_the_controller(two_stop: list[Seen]) -> None:
    first = next(seen for seen in two_stop if not seen.is_request)
    numbers, bits = first["modbus.bitnum"].split(), first["modbus.bitval"].split()
    assert numbers[:6] == ["0", "1", "2", "3", "4", "5"]
    assert bits[:6] == ["1", "0", "1", "0", "1", "0"]


def test_a_hold_is_a_write_of_all_four_coils_and_is_read_back(two_stop: list[Seen]) -> None:
    writes = asked(two_stop, 15)
    assert {seen.asked for seen in writes} == {("15", "0", "4")}
    assert [seen["modbus.data"] for seen in writes] == ["04", "00"]
    # on connecting, after the hold and after the release
    assert [seen.asked for seen in asked(two_stop, 1)] == [("1", "0", "4")] * 3
