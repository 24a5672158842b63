"""Simulated devices behind one address, at the end of in-memory wires. The clock is that of the loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Protocol

from register_maps import frames
from register_maps.errors import BadRequest
from register_maps.frames import Request
from register_maps.words import BIT_TABLES
from simulator.registers import Endpoint, ExceptionReply, NoReply, RegisterFace

ANSWER_S = 0.004
"""How long a device takes to answer. Chosen: a quick PLC."""
GATEWAY_TARGET_FAILED = 0x0B

Device = RegisterFace | Endpoint
Reply = tuple[float, bytes | None]


class Connected(Protocol):
    """A connection that the device can reset."""

    def drop(self) -> None:
        """Reset the connection."""


class MemoryController:
    """The devices behind one address, by unit id. Takes frames and returns answers."""

    def __init__(self, devices: Mapping[int, Device], look: Callable[[bool], None]) -> None:
        """Calls `look` after every request that was carried out, with True after a write; and with False before every write."""
        self._devices = devices
        self._look = look
        self.wires: list[Connected] = []
        self.on_network = True
        """While False, it neither answers nor accepts connections."""
        self.keeps_slot = False
        """Whether it still counts a closed connection as open, and so refuses new ones."""

    def switch(self, *, on: bool) -> None:
        """Connect the controller to the network, or take it off and reset every connection."""
        self.on_network = on
        if not on:
            self.hang_up()

    def hang_up(self) -> None:
        """Reset every connection."""
        for wire in tuple(self.wires):
            wire.drop()

    def answer(self, frame: bytes) -> list[Reply]:
        """Carry out one request and return the answers; none while the device is off."""
        try:
            request = frames.parse_request(frame, timed_coils=True)
        except BadRequest as refusal:
            return [(ANSWER_S, frames.exception_answer(frame, refusal.code))]
        device = self._devices.get(request.unit)
        if device is None:
            return [(ANSWER_S, frames.exception_answer(frame, GATEWAY_TARGET_FAILED))]
        if request.is_write:
            self._look(False)
        try:
            payload = carry_out(device, request, asyncio.get_running_loop().time())
        except ExceptionReply as objection:
            return [(ANSWER_S, frames.exception_answer(frame, objection.code))]
        except NoReply:
            return []
        self._look(request.is_write)
        return [(ANSWER_S, frames.answer(request, frames.tid_of(frame), payload))]


def carry_out(device: Device, request: Request, now: float) -> bytes:
    """Read or write, and return the payload of the answer. Raises ExceptionReply, or NoReply while the device is off."""
    if not request.is_write:
        cells = device.read(request.table, request.address, request.count, now)
        if request.table in BIT_TABLES:
            return frames.pack_bits(cells)
        return b"".join(cell.to_bytes(2, "big") for cell in cells)
    if request.function == frames.MASK_WRITE:
        keep, put = request.values
        device.mask_write(request.address, keep, put, now)
    elif request.duration is not None:
        device.pulse(request.address, request.duration, now)
    else:
        device.write(request.table, request.address, request.values, now)
    return b""
