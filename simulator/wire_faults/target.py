"""Which requests a fault of the wire is meant for."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum, unique

from register_maps import frames
from register_maps.errors import FrameError
from register_maps.frames import Request
from register_maps.words import Table

UNIT_AT, FUNCTION_AT = 6, 7
"""Where unit id and function are in a frame."""


@unique
class Access(StrEnum):
    """What a request does to the device."""

    READS = "reads"
    WRITES = "writes"


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """All conditions that are given must hold; without any, every request is meant.

    A frame that is no request of functions 1 to 6, 15, 16 or 22 is met by conditions on unit and function only.
    """

    functions: tuple[int, ...] = ()
    """Any of these; empty: whichever."""
    table: Table | None = None
    addresses: tuple[int, int] | None = None
    """First and last on the wire, where the first one is 0. A request that touches any of them is meant."""
    access: Access | None = None
    unit: int | None = None

    def __post_init__(self) -> None:
        for function in self.functions:
            if not 1 <= function <= 127:
                raise ValueError(f"function {function}, allowed 1 to 127")
        if self.unit is not None and not 0 <= self.unit <= 255:
            raise ValueError(f"unit {self.unit}, allowed 0 to 255")
        if self.addresses is not None:
            first, last = self.addresses
            if not 0 <= first <= last <= 65535:
                raise ValueError(f"addresses {first} to {last}, allowed 0 to 65535, the lower one first")

    def covers(self, frame: bytes) -> bool:
        """Whether this request frame is meant."""
        if self.functions and frame[FUNCTION_AT] not in self.functions:
            return False
        if self.unit is not None and frame[UNIT_AT] != self.unit:
            return False
        if self.table is None and self.addresses is None and self.access is None:
            return True
        request = parse_request(frame)
        return request is not None and self._covers(request)

    def _covers(self, request: Request) -> bool:
        if self.table is not None and request.table is not self.table:
            return False
        if self.access is not None and request.is_write is not (self.access is Access.WRITES):
            return False
        if self.addresses is None:
            return True
        first, last = self.addresses
        return request.address <= last and first < request.address + request.count


EVERYTHING = Target()


def parse_request(frame: bytes) -> Request | None:
    """The request, with or without a duration for a coil; None for what no device has to understand."""
    try:
        return frames.parse_request(frame, timed_coils=True)
    except FrameError:
        return None
