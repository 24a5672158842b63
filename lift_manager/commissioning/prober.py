"""Reads single addresses of a controller, map or no map, for tools that find out what a controller is. It has no way to write.

Unlike the link of a manager it repeats nothing and hides nothing: an exception, a silence or an answer that does not fit is what the
tool wants to know.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from drivers.modbus.controller_lock import controller_lock
from drivers.modbus.wire import OnBytes, PymodbusWire, Wire
from lift_manager.config.check import canonical_host
from register_maps import frames, identification
from register_maps.errors import ExceptionAnswer, Mismatch
from register_maps.frames import Request
from register_maps.words import Table

GAP_S = 0.05
"""From an answer to the next request. Chosen: twenty requests a second disturb no controller that a manager may poll."""
TIMEOUT_S = 2.0
"""Chosen: longer than any controller or gateway that a manager can use."""
CONNECT_TIMEOUT_S = 3.0
"""Chosen: TCP repeats its request after 1 s, and once more after 3 s."""
NO_ANSWER = "no answer"
"""How the trouble of a read begins that was not answered in time."""


@dataclass(frozen=True, slots=True)
class ProbeAnswer:
    """What one read came to: values, an exception, or trouble."""

    request: Request
    took_s: float
    """From request to answer; or for how long it was waited for."""
    values: tuple[int, ...] | None = None
    """Bits as 0 or 1, registers as 0 to 65535; None if there are none."""
    exception: int | None = None
    """The exception code. It proves that the unit exists."""
    trouble: str = ""
    """Why there is neither: silence, a lost connection, or an answer to something else."""
    echoes_tid: bool = True
    """Whether the answer had the transaction id of the request."""


@dataclass(frozen=True, slots=True)
class Identity:
    """What a controller says that it is."""

    texts: Mapping[str, str] = field(default_factory=dict)
    """By name, such as `vendor` and `revision`; empty if it says nothing."""
    exception: int | None = None
    """The exception code instead; most controllers that have no identity answer 01."""
    trouble: str = ""
    """Why there is neither: as of a read."""


@dataclass(frozen=True, slots=True)
class _Exchange:
    """One request and what arrived after it."""

    frame: bytes
    """Empty if nothing arrived."""
    took_s: float
    trouble: str = ""
    echoes_tid: bool = True


class Prober:
    """One connection to one controller, with one request at a time and a pause after each answer."""

    def __init__(self, wire: Wire, *, unit: int = 1, gap_s: float = GAP_S, timeout_s: float = TIMEOUT_S) -> None:
        """`unit` is where reads go that name no other; nothing is sent before the first read."""
        self.unit = unit
        self.connects = 0
        self.requests = 0
        self._wire = wire
        self._gap_s = gap_s
        self._timeout_s = timeout_s
        self._tid = 0
        self._may_send_at = 0.0
        self._listeners: tuple[OnBytes, ...] = ()
        self._turn = asyncio.Lock()
        self._frame: asyncio.Future[bytes] | None = None
        self._lost = ""
        wire.on_bytes = self._on_bytes

    @property
    def peer(self) -> str:
        """The address of the controller, for messages."""
        return self._wire.peer

    async def connect(self) -> None:
        """Connect, unless it is connected. Raises ConnectFailed, which says whether it is off, refuses, or has no free slot."""
        if not self._wire.is_open:
            self._lost = ""
            await self._wire.open(self._on_frame, self._on_lost, timeout_s=CONNECT_TIMEOUT_S)
            self.connects += 1

    async def read(self, table: Table, address: int, count: int = 1, *, unit: int | None = None) -> ProbeAnswer:
        """Read some addresses as on the wire (the first one is 0), on a new connection if the last one broke. Raises ConnectFailed.

        Raises BadRequest for more than the specification allows in one request.
        """
        request = frames.read(table, address, count, self.unit if unit is None else unit)
        async with self._turn:
            return await self._read(request)

    async def identify(self, *, unit: int | None = None) -> Identity:
        """Read what a controller says that it is (function 43), with the regular objects where it has them. Raises ConnectFailed."""
        unit = self.unit if unit is None else unit
        async with self._turn:
            objects: dict[int, bytes] = {}
            try:
                for category in (identification.BASIC, identification.REGULAR):
                    if not await self._read_objects(unit, category, objects):
                        break
            except ExceptionAnswer as error:
                return Identity(identification.texts(objects), exception=error.code)
            except _Trouble as error:
                return Identity(identification.texts(objects), trouble=str(error))
            return Identity(identification.texts(objects))

    async def _read_objects(self, unit: int, category: int, objects: dict[int, bytes]) -> bool:
        """Add the objects of one category; return whether the controller has a higher one. Raises ExceptionAnswer, _Trouble."""
        first = 0
        while True:
            arrived = await self._exchange(identification.request_body(unit, category, first))
            if not arrived.frame:
                raise _Trouble(arrived.trouble)
            try:
                page = identification.parse_answer(unit, category, arrived.frame)
            except Mismatch as error:
                self.close()
                raise _Trouble(str(error)) from error
            objects.update(page.objects)
            if page.next_object is None or page.next_object <= first:  # backwards it would never end
                return page.has_regular
            first = page.next_object

    async def _read(self, request: Request) -> ProbeAnswer:
        arrived = await self._exchange(request.body)
        if not arrived.frame:
            return ProbeAnswer(request, arrived.took_s, trouble=arrived.trouble)
        try:
            payload = frames.check(request, arrived.frame)
        except ExceptionAnswer as error:
            return ProbeAnswer(request, arrived.took_s, exception=error.code, echoes_tid=arrived.echoes_tid)
        except Mismatch as error:
            self.close()
            return ProbeAnswer(request, arrived.took_s, trouble=str(error), echoes_tid=arrived.echoes_tid)
        values = frames.values_of(request, payload)
        return ProbeAnswer(request, arrived.took_s, values, echoes_tid=arrived.echoes_tid)

    async def _exchange(self, body: bytes) -> _Exchange:
        """Send a frame without its transaction id, and wait for what comes."""
        loop = asyncio.get_running_loop()
        await asyncio.sleep(max(0.0, self._may_send_at - loop.time()))
        sent_at = loop.time()
        try:
            await self.connect()
            self._tid = self._tid % 0xFFFF + 1
            self._frame = loop.create_future()
            sent_at = loop.time()
            self.requests += 1
            self._wire.send(self._tid.to_bytes(2, "big") + body)
            async with asyncio.timeout(self._timeout_s):
                frame = await self._frame
        except TimeoutError:
            self.close()  # what comes late must not pass for the answer to the next request
            return _Exchange(b"", loop.time() - sent_at, f"{NO_ANSWER} within {self._timeout_s:g} s")
        except asyncio.CancelledError:
            self.close()
            raise
        finally:
            self._frame = None
            self._may_send_at = loop.time() + self._gap_s
        took_s = loop.time() - sent_at
        if not frame:
            return _Exchange(b"", took_s, self._lost)
        return _Exchange(frame, took_s, echoes_tid=frames.tid_of(frame) == self._tid)

    def close(self) -> None:
        """Drop the connection; the next read makes another."""
        self._wire.close()

    @contextmanager
    def tap(self, listener: OnBytes) -> Iterator[None]:
        """Call `listener` with (sent, frame) of every frame within the context."""
        self._listeners = (*self._listeners, listener)
        try:
            yield
        finally:
            self._listeners = tuple(one for one in self._listeners if one is not listener)

    def _on_bytes(self, sent: bool, frame: bytes) -> None:  # noqa: FBT001 - as OnBytes has it
        for listener in self._listeners:
            listener(sent, frame)

    def _on_frame(self, frame: bytes) -> None:
        if self._frame is not None and not self._frame.done():
            self._frame.set_result(frame)

    def _on_lost(self, reason: str) -> None:
        self._lost = reason
        self._on_frame(b"")


class _Trouble(Exception):
    """A request was not answered as it should be; the text says why."""


@asynccontextmanager
async def open_prober(
    host: str,
    port: int,
    *,
    unit: int = 1,
    gap_s: float = GAP_S,
    timeout_s: float = TIMEOUT_S,
    make_wire: Callable[[str, int], Wire] = PymodbusWire,
    temporary: Path | None = None,
) -> AsyncIterator[Prober]:
    """Hold the lock of a controller and connect to it.

    Raises ControllerTaken while a manager or another tool of this computer has it, LockUnusable, and ConnectFailed.
    """
    with controller_lock(canonical_host(host), port, temporary=temporary):
        prober = Prober(make_wire(host, port), unit=unit, gap_s=gap_s, timeout_s=timeout_s)
        try:
            await prober.connect()
            yield prober
        finally:
            prober.close()
