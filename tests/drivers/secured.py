"""A controller with Modbus/TCP Security on real sockets, and what a wire gets from it."""

import asyncio
import logging
import socket
import ssl
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import pytest

from drivers.errors import ConnectFailed, Delivery
from drivers.modbus.wire import PymodbusWire
from register_maps import frames
from register_maps.words import Table
from tests.support.certificates import Shown
from tests.support.programs import HANGS_S

Test = Callable[[], Coroutine[object, object, None]]
Run = Callable[[Test], None]
READ = frames.read(Table.HOLDING, 0, 1)
ASK = frames.frame(READ, 7)
ANSWER = frames.answer(READ, 7, b"\x00\x07")


def run_quietly(test: Test, loop: Callable[[], asyncio.AbstractEventLoop], caplog: pytest.LogCaptureFixture) -> None:
    async def limited() -> None:
        async with asyncio.timeout(HANGS_S):
            await test()

    with asyncio.Runner(loop_factory=loop) as runner:
        runner.run(limited())
    noise = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    assert noise == [], "what goes wrong is told to whoever uses the wire, and to nobody else"


@dataclass
class Plc(asyncio.Protocol):
    """A controller that answers everything with one frame; it shows and wants certificates."""

    context: ssl.SSLContext | None
    answer: bytes = ANSWER
    heard: list[bytes] = field(default_factory=list)
    transport: asyncio.BaseTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.heard.append(data)
        transport = cast(asyncio.Transport, self.transport)
        if self.answer:
            transport.write(self.answer)
        else:
            transport.close()

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[int]:
        loop = asyncio.get_running_loop()
        listener = socket.create_server(("127.0.0.1", 0))
        server = await loop.create_server(lambda: self, sock=listener, ssl=self.context)
        try:
            yield listener.getsockname()[1]
        finally:
            server.close()
            if self.transport is not None:
                cast(asyncio.Transport, self.transport).abort()


@dataclass
class Near:
    """What the wire handed over."""

    frames: asyncio.Queue[bytes] = field(default_factory=asyncio.Queue)
    lost: asyncio.Queue[str] = field(default_factory=asyncio.Queue)


async def opened(wire: PymodbusWire) -> Near:
    near = Near()
    await wire.open(near.frames.put_nowait, near.lost.put_nowait, timeout_s=HANGS_S)
    return near


async def refusal(wire: PymodbusWire) -> ConnectFailed:
    with pytest.raises(ConnectFailed) as caught:
        await opened(wire)
    assert not wire.is_open
    assert caught.value.sent is Delivery.NO
    return caught.value


def server_side(shown: Shown, believed: Path, newest: ssl.TLSVersion = ssl.TLSVersion.TLSv1_3) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.maximum_version = newest
    context.load_cert_chain(shown.certificate, shown.key)
    context.load_verify_locations(believed)
    context.verify_mode = ssl.CERT_REQUIRED
    return context
