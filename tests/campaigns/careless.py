"""A small Modbus/TCP client that makes one mistake: what the answer fuzzer has to find. Without a mistake it is right."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.errors import (
    AnswerMismatch,
    AnswerTimeout,
    ConnectionLost,
    ControllerException,
    Delivery,
    DriverError,
    LinkDown,
)
from drivers.modbus.settings import LinkSettings
from drivers.modbus.transactions import Permit
from drivers.modbus.wire import Wire
from register_maps import frames
from register_maps.frames import Request

CHECKS = ("transaction id", "unit", "function", "byte count", "length", "echo")
"""Each a mistake where it is left out."""
RAISES = "raises on an exception code above 250"
REFUSES = "refuses exception answers"


class Careless:
    """One request at a time; whatever is wrong ends the connection."""

    def __init__(self, make_wire: Callable[[], Wire], settings: LinkSettings, mistake: str) -> None:
        self._make_wire = make_wire
        self._settings = settings
        self._mistake = mistake
        self._wire: Wire
        self._tid = 0
        self._asked: tuple[Request, asyncio.Future[bytes]] | None = None
        self._lane = asyncio.Lock()
        self._up = asyncio.Event()
        self._down = asyncio.Event()
        self._closed = False

    async def run(self) -> None:
        while not self._closed:
            self._wire = self._make_wire()
            self._down.clear()
            await self._wire.open(self._on_frame, self._end, timeout_s=1.0)
            self._up.set()
            await self._down.wait()

    async def close(self) -> None:
        self._closed = True
        self._end("closed")

    async def wait_up(self) -> int:
        await self._up.wait()
        return 1

    async def read(self, request: Request) -> bytes:
        async with self._lane:
            if not self._up.is_set():
                raise LinkDown("careless", "lost", 0.0)
            self._tid = self._tid % 65535 + 1
            future: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
            self._asked = (request, future)
            wire = self._wire
            wire.send(frames.frame(request, self._tid))
            try:
                async with asyncio.timeout(self._settings.timeout_s):
                    return await future
            except TimeoutError:
                if wire is self._wire:
                    self._end("silence")
                raise AnswerTimeout("careless", str(request), self._settings.timeout_s) from None
            except asyncio.CancelledError:
                if wire is self._wire:
                    self._end("nobody waits")
                raise
            finally:
                self._asked = None

    async def read_urgent(self, request: Request) -> bytes:
        return await self.read(request)

    async def write(self, request: Request, permit: Permit | None = None) -> None:
        await self.read(request)

    def _end(self, reason: str) -> None:
        self._wire.close()
        self._up.clear()
        self._down.set()
        self._tell(ConnectionLost("careless", "a request", reason))

    def _tell(self, told: bytes | DriverError) -> None:
        if self._asked is None or self._asked[1].done():
            return
        if isinstance(told, bytes):
            self._asked[1].set_result(told)
        else:
            self._asked[1].set_exception(told)

    def _on_frame(self, answer: bytes) -> None:
        if self._asked is None:
            self._end("an answer nobody asked for")
            return
        request = self._asked[0]
        is_refusal = len(answer) == 9 and answer[6] == request.unit and answer[7] == request.function | 0x80
        if self._is_foreign(answer):
            self._end("out of step")
        elif is_refusal and self._mistake == REFUSES:
            self._tell(AnswerMismatch("careless", "no answer"))
        elif is_refusal:
            if self._mistake == RAISES and answer[8] > 250:
                raise RuntimeError(RAISES)
            self._tell(ControllerException("careless", str(request), answer[8], Delivery.YES))
        elif self._fits(request, answer):
            self._tell(b"" if request.is_write else answer[9:])
        else:
            self._end("no answer to this")

    def _is_foreign(self, answer: bytes) -> bool:
        if self._mistake == "transaction id" or not self._settings.tid_echo:
            return False
        return frames.tid_of(answer) != self._tid

    def _fits(self, request: Request, answer: bytes) -> bool:
        checks = {
            "unit": answer[6] == request.unit,
            "function": answer[7] == request.function,
            "byte count": request.is_write or answer[8:9] == request.answer_head[-1:],
            "length": len(answer) == request.answer_length,
            "echo": not request.is_write or answer[8:] == request.answer_head[6:],
        }
        return all(right for name, right in checks.items() if name != self._mistake)


def careless(mistake: str = "") -> Callable[[Callable[[], Wire], LinkSettings, str], Careless]:
    """What makes such clients."""
    return lambda make_wire, settings, _: Careless(make_wire, settings, mistake)
