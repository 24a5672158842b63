"""The fuzz over real sockets: a raw server that answers with whatever the seed says, and pymodbus's transport as the client."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random
from typing import cast

import uvloop

from drivers.modbus.link import Link
from drivers.modbus.settings import LinkSettings
from drivers.modbus.wire import PymodbusWire
from tests.campaigns.answer_rig import Asker, Device, Finding, Player, Report, together, unhandled_in_loop
from tests.campaigns.judge_answers import whole_frames

LINKS = 32
TIMEOUT_S = 0.1
"""Chosen: fifty times what an answer over the loopback takes, and short enough for thousands of time-outs."""
LIMIT_S = 600.0


def socket_batch(seed: int, batch: int, cases: int) -> Report:
    """Put so many mutated answers on sockets; even batches run on asyncio's own loop, odd ones on uvloop.

    The bytes come from the seed; how they meet the requests is up to the machine.
    """
    report = Report()
    where = f"sockets:{seed}:{batch}:{cases}"
    with asyncio.Runner(loop_factory=uvloop.new_event_loop if batch % 2 else None) as runner:
        try:
            runner.run(asyncio.wait_for(_batch(seed, batch, cases, report, where), LIMIT_S))
        except TimeoutError:
            report.find(Finding(where, f"not done within {LIMIT_S:g} s: a client waits for ever"))
    return report


class _Peer(asyncio.Protocol):
    """The server's end of one connection."""

    def __init__(self, device: Device, peers: dict[bytes, _Peer]) -> None:
        self.written = b""
        self._device = device
        self._peers = peers
        self._rest = b""
        self._named = False
        self._transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # not asserted: the transports of uvloop are no asyncio.Transport
        self._transport = cast(asyncio.Transport, transport)

    def data_received(self, data: bytes) -> None:
        self._rest += data
        for frame in whole_frames(self._rest):
            self._rest = self._rest[len(frame) :]
            if self._transport.is_closing():
                return
            if not self._named:
                self._named = True
                self._peers[frame] = self
            Player(self._device.answer(frame), self._deliver).start()

    def _deliver(self, data: bytes | None) -> bool:
        if self._transport.is_closing():
            return False
        if data is not None:
            self.written += data
            self._transport.write(data)
        elif self._device.rng.random() < 0.5:
            self._transport.close()
        else:
            self._transport.abort()
        return True


def _peers_of(device: Device, peers: dict[bytes, _Peer]) -> Callable[[], _Peer]:
    return lambda: _Peer(device, peers)


class _Wires:
    """Makes the wires of one link, and writes down what came over each."""

    def __init__(self, device: Device, address: tuple[str, int]) -> None:
        self.came: dict[bytes, list[bytes]] = {}
        """The frames that came over each connection, by the first request on it."""
        self._device = device
        self._address = address

    def make(self) -> PymodbusWire:
        hearing, first = self._device.hearing(), b""

        def on_bytes(sent: bool, frame: bytes) -> None:
            nonlocal first
            now = asyncio.get_running_loop().time()
            if sent:
                first = first or frame
                self.came.setdefault(first, [])
                self._device.heard(hearing, frame, now)
            else:
                self.came.setdefault(first, []).append(frame)
                hearing.came(frame, now)

        wire = PymodbusWire(*self._address)
        wire.on_bytes = on_bytes
        return wire


async def _batch(seed: int, batch: int, cases: int, report: Report, where: str) -> None:
    unhandled_in_loop(report, where)
    devices, links, asking, running, servers = [], [], [], [], []
    heard: list[tuple[_Wires, dict[bytes, _Peer]]] = []
    for number in range(LINKS):
        rng = Random(f"{seed}/{batch}/{number}")
        settings = LinkSettings(
            timeout_s=TIMEOUT_S,
            reconnect_min_s=0.001,
            reconnect_max_s=0.002,
            tid_echo=number % 4 != 0,
        )
        device = Device(rng, settings)
        peers: dict[bytes, _Peer] = {}
        server = await asyncio.get_running_loop().create_server(_peers_of(device, peers), "127.0.0.1", 0)
        wires = _Wires(device, server.sockets[0].getsockname())
        link = Link(wires.make, settings, name=f"link {number}")
        share = cases // LINKS + (number < cases % LINKS)
        servers.append(server)
        devices.append(device)
        links.append(link)
        heard.append((wires, peers))
        asking.append(asyncio.ensure_future(Asker(where, link, device, report, rng).ask_until(share)))
        running.append(asyncio.ensure_future(link.run()))
    try:
        await together(asking, running, report, where)
    finally:
        for link in links:
            await link.close()
        await asyncio.wait(running)
        for server in servers:
            server.close()
            await server.wait_closed()
        report.cases = sum(device.asked for device in devices)
    for wires, peers in heard:
        for what in _misframed(wires, peers):
            report.find(Finding(where, what))


def _misframed(wires: _Wires, peers: dict[bytes, _Peer]) -> list[str]:
    """Connections on which the client saw a frame that the server's bytes do not hold, or not in this order.

    It need not see all of them: the connection may end before, and what came too late to matter may be left out.
    """
    found = []
    for first, came in wires.came.items():
        written = peers[first].written if first in peers else b""
        frames = iter(whole_frames(written))
        if not all(any(frame == other for other in frames) for frame in came):
            found.append(f"took {b''.join(came).hex(' ')} for frames, and the server wrote {written.hex(' ')}")
    return found
