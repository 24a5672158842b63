"""Wireshark's dissector, which nobody here wrote, opens the capture file of a trace."""

import itertools
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import pytest

from lift_manager.commissioning.trace.pcapng import PcapngWriter
from lift_manager.commissioning.trace.recording import Gap, Header, Item, TracedFrame
from register_maps import frames
from register_maps.frames import Request
from register_maps.words import Table

pytestmark = pytest.mark.external("tshark")

BEGAN = datetime(2026, 11, 23, 12, tzinfo=UTC)
FIELDS = (
    "frame.time_epoch",
    "frame.interface_name",
    "frame.protocols",
    "frame.comment",
    "tcp.stream",
    "tcp.flags.str",
    "modbus.func_code",
    "modbus.exception_code",
    "modbus.regval_uint16",
    "ip.checksum.status",
    "tcp.checksum.status",
    "tcp.analysis.flags",
    "_ws.malformed",
)
GOOD = "1"
"""How tshark calls a right checksum."""

POLL = frames.read(Table.HOLDING, 0, 3)
BITS = frames.read(Table.DISCRETE, 0, 20)


def exchange(at_s: float, tid: int, request: Request, payload: bytes = b"") -> list[Item]:
    return [
        TracedFrame(at_s, True, frames.frame(request, tid)),
        TracedFrame(at_s + 0.0125, False, frames.answer(request, tid, payload)),
    ]


def decoded(items: list[Item], path: Path) -> list[dict[str, str]]:
    """Every packet as tshark sees it, checksums and sequence numbers included."""
    with path.open("wb") as file:
        writer = PcapngWriter(file, Header("plc of the lobby", BEGAN, "lift-manager 1"))
        for item in items:
            writer.add(item)
    wanted = itertools.chain.from_iterable(("-e", name) for name in FIELDS)
    checks = ("-o", "ip.check_checksum:TRUE", "-o", "tcp.check_checksum:TRUE")
    command = ["tshark", "-r", str(path), *checks, "-T", "fields", "-E", "separator=|", "-E", "aggregator= ", *wanted]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=240)
    return [dict(zip(FIELDS, line.split("|"), strict=True)) for line in done.stdout.splitlines()]


def every_kind() -> list[Item]:
    refused = TracedFrame(0.5, True, frames.frame(POLL, 5))
    return [
        *exchange(0, 1, POLL, b"\0\1\0\2\xff\xff"),
        *exchange(0.1, 2, BITS, b"\5\0\1"),
        *exchange(0.2, 3, frames.write_register(16, 2)),
        *exchange(0.3, 4, frames.write_coils(3, [True, False, True])),
        refused,
        TracedFrame(0.51, False, frames.exception_answer(refused.frame, 2)),
        Gap(0.6, "the connection broke"),
        *exchange(0.7, 6, frames.mask_write(4, 0xFFF0, 3)),
        *exchange(0.8, 7, frames.write_registers(9, [1, 2])),
    ]


def test_every_frame_is_modbus_with_its_function_and_none_is_malformed(tmp_path: Path) -> None:
    packets = decoded(every_kind(), tmp_path / "a.pcapng")
    carrying = [packet for packet in packets if packet["tcp.flags.str"].endswith("AP···")]
    assert [packet["modbus.func_code"] for packet in carrying] == [
        function for function in ("3", "2", "6", "15", "3", "22", "16") for _ in range(2)
    ]
    assert [packet["modbus.exception_code"] for packet in carrying if packet["modbus.exception_code"]] == ["2"]
    assert carrying[1]["modbus.regval_uint16"] == "1 2 65535"
    for packet in packets:
        assert packet["_ws.malformed"] == "", packet
        assert packet["frame.interface_name"] == "plc of the lobby"
        assert (packet["ip.checksum.status"], packet["tcp.checksum.status"]) == (GOOD, GOOD)
        # no lost segment, no repetition, no acknowledgement of what was not sent
        assert packet["tcp.analysis.flags"] == ""
    assert all(packet["frame.protocols"].endswith(":mbtcp:modbus") for packet in carrying)


def test_times_are_those_of_the_recording_to_the_microsecond(tmp_path: Path) -> None:
    packets = decoded(exchange(3.25, 1, POLL, bytes(6)), tmp_path / "a.pcapng")
    times = [round(float(packet["frame.time_epoch"]) - BEGAN.timestamp(), 6) for packet in packets[-2:]]
    assert times == [3.25, 3.2625]


def test_after_a_gap_there_is_another_connection_and_a_comment_says_why(tmp_path: Path) -> None:
    packets = decoded(every_kind(), tmp_path / "a.pcapng")
    assert [packet["tcp.stream"] for packet in packets] == ["0"] * 13 + ["1"] * 7
    comments = [packet["frame.comment"] for packet in packets if packet["frame.comment"]]
    assert comments == [
        "the headers are made up; link plc of the lobby, recorded by lift-manager 1",
        "gap: the connection broke",
    ]


def test_a_file_without_frames_is_a_file_without_packets(tmp_path: Path) -> None:
    assert decoded([], tmp_path / "a.pcapng") == []
