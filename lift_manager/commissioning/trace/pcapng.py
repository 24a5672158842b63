"""Writes frames as a capture file that Wireshark and tshark open as Modbus/TCP.

A link shows frames and no packets, so the headers of Ethernet, IPv4 and TCP are made here, with addresses for documentation
(RFC 5737). The format is that of draft-ietf-opsawg-pcapng: a section header, an interface, and enhanced packets.
"""

from __future__ import annotations

import struct
from typing import BinaryIO

from lift_manager.commissioning.trace.recording import Gap, Header, Item

MANAGER, CONTROLLER = bytes((192, 0, 2, 1)), bytes((192, 0, 2, 2))
MODBUS_PORT = 502
FIRST_PORT = 49152
"""Of the manager's end, for the first connection; the next one has the next port, up to the last of the dynamic ports (RFC 6335, 6)."""

_SECTION_HEADER, _INTERFACE, _ENHANCED_PACKET = 0x0A0D0D0A, 1, 6
_BYTE_ORDER_MAGIC = 0x1A2B3C4D
_UNKNOWN_LENGTH = 0xFFFF_FFFF_FFFF_FFFF
_ETHERNET = 1
_END, _COMMENT = 0, 1
_USER_APPLICATION = 4
_INTERFACE_NAME = 2
_PACKET_FLAGS, _INBOUND, _OUTBOUND = 2, 1, 2

_MACS = {True: b"\x02\0\0\0\0\x01", False: b"\x02\0\0\0\0\x02"}
"""Of manager and controller: locally administered."""
_TCP = 6
_SYN, _PUSH, _ACK = 0x02, 0x08, 0x10
_WINDOW = 65535
_DO_NOT_FRAGMENT = 0x4000


class PcapngWriter:
    """Writes the file of one link, which is whole after every call.

    Frames before and after a gap are on connections of their own, because no analyser could follow their sequence numbers.
    """

    def __init__(self, file: BinaryIO, header: Header) -> None:
        self._file = file
        self._began_us = round(header.began.timestamp() * 1e6)
        self._packets = 0
        self._port = FIRST_PORT - 1
        self._is_connected = False
        self._next = {True: 0, False: 0}
        """The next sequence number of the manager (True) and of the controller."""
        self._comment = f"the headers are made up; link {header.link}, recorded by {header.program}"
        section = struct.pack("<IHHQ", _BYTE_ORDER_MAGIC, 1, 0, _UNKNOWN_LENGTH)
        interface = struct.pack("<HHI", _ETHERNET, 0, 0)
        self._write(
            _block(_SECTION_HEADER, section, (_USER_APPLICATION, header.program.encode())),
            _block(_INTERFACE, interface, (_INTERFACE_NAME, header.link.encode())),
        )

    def add(self, item: Item) -> None:
        """Write a frame, or note a gap."""
        if isinstance(item, Gap):
            self._is_connected = False
            self._comment = f"gap: {item.reason}"
            return
        at_us = self._began_us + round(item.at_s * 1e6)
        packets = []
        if not self._is_connected:
            self._is_connected = True
            self._port = FIRST_PORT if self._port == 0xFFFF else self._port + 1
            self._next = {True: 0, False: 0}
            packets = [
                self._packet(at_us, _SYN, from_manager=True),
                self._packet(at_us, _SYN | _ACK, from_manager=False),
                self._packet(at_us, _ACK, from_manager=True),
            ]
        self._write(*packets, self._packet(at_us, _PUSH | _ACK, item.frame, from_manager=item.is_request))

    def _packet(self, at_us: int, flags: int, data: bytes = b"", *, from_manager: bool) -> bytes:
        """Return the block of one packet, and count it."""
        self._packets += 1
        ends = (MANAGER, CONTROLLER) if from_manager else (CONTROLLER, MANAGER)
        ports = (self._port, MODBUS_PORT) if from_manager else (MODBUS_PORT, self._port)
        acknowledged = self._next[not from_manager] if flags & _ACK else 0
        tcp = _tcp(ends, ports, (self._next[from_manager], acknowledged), flags, data)
        self._next[from_manager] = (self._next[from_manager] + len(data) + bool(flags & _SYN)) & 0xFFFF_FFFF
        packet = _MACS[not from_manager] + _MACS[from_manager] + b"\x08\0" + _ipv4(ends, tcp, self._packets)
        head = struct.pack("<IIIII", 0, at_us >> 32, at_us & 0xFFFF_FFFF, len(packet), len(packet))
        direction = struct.pack("<I", _OUTBOUND if from_manager else _INBOUND)
        comment, self._comment = self._comment.encode(), ""
        options = ((_PACKET_FLAGS, direction), *([(_COMMENT, comment)] if comment else []))
        return _block(_ENHANCED_PACKET, head + _padded(packet), *options)

    def _write(self, *blocks: bytes) -> None:
        self._file.write(b"".join(blocks))
        self._file.flush()


def _block(kind: int, body: bytes, *options: tuple[int, bytes]) -> bytes:
    listed = b"".join(struct.pack("<HH", code, len(value)) + _padded(value) for code, value in options)
    body += listed + struct.pack("<HH", _END, 0)
    length = struct.pack("<I", 12 + len(body))
    return struct.pack("<I", kind) + length + body + length


def _padded(data: bytes) -> bytes:
    return data + b"\0" * (-len(data) % 4)


def _ipv4(ends: tuple[bytes, bytes], payload: bytes, number: int) -> bytes:
    head = struct.pack("!BBHHHBB", 0x45, 0, 20 + len(payload), number & 0xFFFF, _DO_NOT_FRAGMENT, 64, _TCP)
    addresses = ends[0] + ends[1]
    return head + _checksum(head + b"\0\0" + addresses) + addresses + payload


def _tcp(
    ends: tuple[bytes, bytes], ports: tuple[int, int], sequence: tuple[int, int], flags: int, data: bytes
) -> bytes:
    head = struct.pack("!HHIIBBH", *ports, *sequence, 5 << 4, flags, _WINDOW)
    pseudo = ends[0] + ends[1] + struct.pack("!BBH", 0, _TCP, 20 + len(data))
    return head + _checksum(pseudo + head + b"\0\0\0\0" + data) + b"\0\0" + data


def _checksum(data: bytes) -> bytes:
    """Of the Internet protocols (RFC 1071)."""
    total: int = sum(struct.unpack(f"!{(len(data) + 1) // 2}H", data + b"\0" * (len(data) % 2)))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return struct.pack("!H", ~total & 0xFFFF)
