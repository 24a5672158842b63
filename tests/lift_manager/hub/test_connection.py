"""Connections to a NATS server: one that hangs, and a task that is ended."""

import asyncio
import gc
import ssl
import warnings
from pathlib import Path

from lift_manager.hub.connection import Connection, client_context
from tests.lift_manager.hub.rig import Rig
from tests.support.certificates import Authority
from tests.support.virtual_time import cancel_at_every_turn


def test_a_connection_to_a_server_that_hangs_ends_at_once(tmp_path: Path) -> None:
    authority = Authority(tmp_path)
    shown = authority.issue("server", "127.0.0.1")
    server_side = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server_side.load_cert_chain(shown.certificate, shown.key)

    async def main() -> None:
        hanging: asyncio.Future[asyncio.Transport] = asyncio.Future()

        async def accept(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            assert isinstance(writer.transport, asyncio.Transport)
            writer.transport.pause_reading()
            hanging.set_result(writer.transport)

        server = await asyncio.start_server(accept, "127.0.0.1", 0, ssl=server_side)
        async with server:
            address = server.sockets[0].getsockname()
            _, writer = await asyncio.open_connection(*address, ssl=client_context(authority.file))
            accepted = await hanging
            writer.close()
            async with asyncio.timeout(20):  # asyncio's own limit is 30 s
                await writer.wait_closed()
            accepted.abort()

    asyncio.run(main())


def test_a_task_that_opens_and_closes_a_connection_can_be_ended_at_any_moment(rig: Rig) -> None:
    url, password = rig.access("berlin")

    async def use() -> None:
        connection = Connection("test", (url,), "manager", password)
        try:
            await connection.open()
        finally:
            await connection.close()

    async def main() -> None:
        await use()  # the server has started
        await cancel_at_every_turn(use)
        gc.collect()

    with rig.leaf("berlin"), warnings.catch_warnings():
        # nats-py leaves a socket that is not connected yet to the collector
        warnings.simplefilter("ignore", ResourceWarning)
        asyncio.run(main())
