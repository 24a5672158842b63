"""What all faults of the wire have in common: how often and when, and what each kind of them may do. Pure."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

from simulator.wire_faults.target import EVERYTHING, Target

Reply = tuple[float, bytes | None]
"""After so many seconds these bytes come; None: the connection is reset."""
Replies = tuple[Reply, ...]
"""What comes because of one request, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """How often and when a fault strikes."""

    times: int | None = None
    """How often at most; None: without end."""
    probability: float = 1.0
    """On each occasion."""
    from_s: float = 0.0
    """Window, counted from the start of the engine; `until_s` is the first moment outside."""
    until_s: float = math.inf

    def __post_init__(self) -> None:
        if self.times is not None and self.times < 1:
            raise ValueError(f"times {self.times}, allowed 1 or more")
        if not 0.0 <= self.probability <= 1.0:
            raise ValueError(f"probability {self.probability}, allowed 0 to 1")
        if not 0.0 <= self.from_s < self.until_s:
            raise ValueError(f"from_s {self.from_s} and until_s {self.until_s}: the window has no inside")


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestFault(Limits):
    """Strikes a request or its answer."""

    on: Target = EVERYTHING

    def suits(self, function: int) -> bool:
        """Whether answers to this function have what it changes."""
        return True


@dataclass(frozen=True, slots=True, kw_only=True)
class InsteadFault(RequestFault):
    """Puts something, or nothing, in the place of the answer."""

    @property
    def reaches_device(self) -> bool:
        """Whether the device sees the request."""
        return False

    def instead(self, request: bytes, chance: random.Random) -> Replies:
        """What comes."""
        return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeFault(RequestFault):
    """Changes the answer, or its way. Any number of these may strike one answer; see `ORDER`."""

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        """What comes instead; the same again where there is nothing to change, and then it has not struck."""
        return replies


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldFault(RequestFault):
    """Keeps the answer back until the next one of the same connection; where one is kept already, it does not strike."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConnectionFault(Limits):
    """Strikes an attempt to connect."""


def each(replies: Replies, edit: Callable[[bytes], bytes]) -> Replies:
    return tuple((delay_s, data if data is None else edit(data)) for delay_s, data in replies)


def garbage(length: int, chance: random.Random) -> bytes:
    """The third byte of a frame is 0 (protocol id); of these it never is."""
    data = chance.randbytes(length)
    return data[:2] + bytes([data[2] | 0x80]) + data[3:] if length > 2 else data


def check_within(name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise ValueError(f"{name} {value}, allowed {low} to {high}")


def check_seconds(name: str, value: float) -> None:
    if not 0 <= value < math.inf:
        raise ValueError(f"{name} {value}, allowed 0 s or more")
