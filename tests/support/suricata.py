"""Suricata over a capture, and captures of conversations that nobody had to hold."""

import json
import struct
import subprocess
from collections.abc import Iterable
from ipaddress import ip_address
from pathlib import Path
from typing import Any

Event = dict[str, Any]

CONFIG = """\
%YAML 1.1
---
vars: {{address-groups: {{HOME_NET: any}}, port-groups: {{HTTP_PORTS: 80}}}}
outputs:
  - eve-log: {{enabled: yes, filetype: regular, filename: eve.json, types: [alert, modbus]}}
app-layer:
  protocols:
    tls: {{enabled: yes}}
    modbus: {{enabled: yes, detection-ports: {{dp: "{ports}"}}, stream-depth: 0}}
stream: {{reassembly: {{depth: 0}}}}
stats: {{enabled: no}}
"""


def suricata(capture: Path, rules: str, folder: Path, ports: str, *options: str) -> list[Event]:
    """Read a capture with these rules and return every alert and Modbus transaction; whatever it complains of fails the test."""
    folder.mkdir()
    (folder / "site.rules").write_text(rules, "utf-8")
    (folder / "suricata.yaml").write_text(CONFIG.format(ports=ports), "utf-8")
    command = [
        "suricata",
        "-c",
        "suricata.yaml",
        "-r",
        str(capture.absolute()),
        "-S",
        "site.rules",
        "-l",
        ".",
        *options,
    ]
    # -k none: the checksums of the loopback interface are never filled in
    done = subprocess.run([*command, "-k", "none"], cwd=folder, capture_output=True, text=True, timeout=60, check=False)
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    assert "Error:" not in said, said
    assert "Warning:" not in said, said
    assert " 0 rules failed" in said, said
    return [json.loads(line) for line in (folder / "eve.json").read_text("utf-8").splitlines()]


def alerts(events: Iterable[Event]) -> list[Event]:
    return [event for event in events if event["event_type"] == "alert"]


class Capture:
    """A capture file of whole TCP connections, in the classic format."""

    _SYN, _SYN_ACK, _ACK, _PSH, _FIN = 0x02, 0x12, 0x10, 0x18, 0x11

    def __init__(self) -> None:
        self._packets: list[bytes] = []
        self._next_port = 40_000

    def connection(self, source: str, target: str, port: int, exchanges: Iterable[tuple[bytes, bytes]] = ()) -> int:
        """Add a connection with these requests and answers; returns the port that it came from."""
        own = self._next_port
        self._next_port += 1
        there, back = (source, own, target, port), (target, port, source, own)
        ours, theirs = 100, 500
        self._add(there, ours, 0, self._SYN)
        self._add(back, theirs, ours + 1, self._SYN_ACK)
        ours, theirs = ours + 1, theirs + 1
        self._add(there, ours, theirs, self._ACK)
        for asked, answered in exchanges:
            self._add(there, ours, theirs, self._PSH, asked)
            ours += len(asked)
            self._add(back, theirs, ours, self._PSH if answered else self._ACK, answered)
            theirs += len(answered)
        self._add(there, ours, theirs, self._FIN)
        self._add(back, theirs, ours + 1, self._FIN)
        self._add(there, ours + 1, theirs + 1, self._ACK)
        return own

    def write(self, path: Path) -> Path:
        path.write_bytes(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1) + b"".join(self._packets))
        return path

    def _add(self, way: tuple[str, int, str, int], sequence: int, seen: int, flags: int, data: bytes = b"") -> None:
        source, source_port, target, target_port = way
        tcp = struct.pack("!HHIIHHHH", source_port, target_port, sequence, seen, 0x5000 | flags, 65535, 0, 0) + data
        ends = ip_address(source).packed + ip_address(target).packed
        if len(ends) == 8:
            header, kind = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(tcp), 0, 0x4000, 64, 6, 0), 0x0800
        else:
            header, kind = struct.pack("!IHBB", 0x60000000, len(tcp), 6, 64), 0x86DD
        packet = b"\x02\0\0\0\0\x02\x02\0\0\0\0\x01" + kind.to_bytes(2, "big") + header + ends + tcp
        micros = 1000 * len(self._packets)
        self._packets.append(
            struct.pack("<IIII", 1_000_000 + micros // 10**6, micros % 10**6, len(packet), len(packet)) + packet
        )
