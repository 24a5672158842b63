"""When bytes that were written reach the kernel: a term is compared with the clock just before."""

import asyncio
import socket
import time

from lift_manager.cli.loop import run


def test_the_loop_hands_bytes_to_the_kernel_within_the_call_that_writes_them() -> None:
    async def write() -> bytes:
        near, far = socket.socketpair()
        near.setblocking(False)
        far.setblocking(False)
        with near, far:
            transport, _ = await asyncio.get_running_loop().create_connection(asyncio.Protocol, sock=near)
            transport.write(b"press")
            received = far.recv(100)
            transport.abort()
            await asyncio.sleep(0)
        return received

    assert run(write()) == b"press"


def test_the_clock_of_the_loop_does_not_stand_still_within_a_turn() -> None:
    async def look() -> float:
        loop = asyncio.get_running_loop()
        began = loop.time()
        stall(0.05)  # as if this process were stopped
        return loop.time() - began

    assert run(look()) >= 0.04


def stall(for_s: float) -> None:
    ends_at = time.monotonic() + for_s
    while time.monotonic() < ends_at:
        pass
