"""TLS to a NATS server that hangs."""

import asyncio
import ssl
from pathlib import Path

from lift_manager.hub.connection import client_context
from tests.support.certificates import Authority


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
