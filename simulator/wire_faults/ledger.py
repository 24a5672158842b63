"""Which faults are set, which of them strike, and what became of it. Pure."""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from register_maps import frames
from simulator.wire_faults.bases import ConnectionFault, InsteadFault, RequestFault
from simulator.wire_faults.faults import WireFault
from simulator.wire_faults.losses import ConnectionLimit
from simulator.wire_faults.target import FUNCTION_AT

SLOT_S = 1.0
"""A steady chance is drawn by the request and the slot of this length in which it comes. Chosen: longer than requests shift
because others are sent before them, and shorter than faults last."""


class StruckFault(NamedTuple):
    """One fault that has struck."""

    at: float
    """On the caller's clock."""
    fault: WireFault
    frame: bytes | None
    """The request; None for an attempt to connect."""

    @property
    def about(self) -> str:
        """What it struck, in plain words."""
        return "an attempt to connect" if self.frame is None else frames.describe(self.frame)


@dataclass(frozen=True, slots=True)
class Exchange:
    """One request and what became of it."""

    sent_at: float
    """When it came from the client, on the caller's clock."""
    request: bytes
    executed: bool
    """Whether the device saw it; it may have refused it."""
    right: bytes | None
    """What the device answered; None if it did not."""
    answers: tuple[tuple[float, bytes], ...]
    """(when, bytes) of every segment that the client gets because of it, in time order; of a segment that is shared
    with another answer only the part that belongs here."""
    honest: bool
    """Whether these bytes, put together, are the device's answer: no more, no fewer, no others. They may be late all the same."""
    faults: tuple[WireFault, ...]
    """What struck it."""


@dataclass(slots=True, eq=False)
class Entry:
    """A fault that is set."""

    fault: WireFault
    chance: random.Random
    """Its own, so that a fault does the same whichever others are set."""
    used: int = 0
    steady: SteadyChance | None = None
    """Where what it draws depends on the request and the time alone."""

    def strikes(self, elapsed_s: float, frame: bytes = b"") -> bool:
        """Whether this occasion is one of those; it is used up then. `frame` is the request; empty for an attempt to connect."""
        fault = self.fault
        if self.steady is not None:
            self.chance = self.steady.chance(elapsed_s, frame)
        if not fault.from_s <= elapsed_s < fault.until_s:
            return False
        if fault.times is not None and self.used >= fault.times:
            return False
        if fault.probability < 1.0 and self.chance.random() >= fault.probability:
            return False
        self.used += 1
        return True

    def take_back(self) -> None:
        """It found nothing to change, so the occasion does not count."""
        self.used -= 1


class SteadyChance:
    """Draws for one fault: the same for the nth request of a kind within a slot, whatever other requests there are."""

    def __init__(self, seed: str) -> None:
        self._seed = seed
        self._slot = -1
        self._counts: Counter[bytes] = Counter()

    def chance(self, elapsed_s: float, frame: bytes) -> random.Random:
        """Return what to draw from for a request; its transaction id does not matter."""
        slot, content = math.floor(elapsed_s / SLOT_S), frame[2:]
        if slot != self._slot:
            self._slot = slot
            self._counts.clear()
        self._counts[content] += 1
        return random.Random(f"{self._seed} {slot} {content.hex()} {self._counts[content]}")


@dataclass(slots=True)
class Ledger:
    """The faults that are set, and the record of what they did."""

    seed: int
    start: float | None
    strikes: list[StruckFault] = field(default_factory=list)
    on_exchange: Callable[[Exchange], None] | None = None
    entries: list[Entry] = field(default_factory=list)
    clients: int = 0
    """Connections that were let in and are not closed yet."""
    steady: bool = False
    """Whether draws depend on the request and the time alone, and not on earlier requests."""
    _added: dict[str, int] = field(default_factory=dict)

    def add(self, fault: WireFault) -> None:
        """Set it; it has used up nothing yet."""
        name = repr(fault)
        nth = self._added[name] = self._added.get(name, 0) + 1
        seed = f"{self.seed} {name} {nth}"
        self.entries.append(Entry(fault, random.Random(seed), steady=SteadyChance(seed) if self.steady else None))

    def remove(self, fault: WireFault) -> None:
        """Take away the one that was set first, of several equal ones."""
        for entry in self.entries:
            if entry.fault == fault:
                self.entries.remove(entry)
                return
        raise ValueError(f"{fault} is not set")

    def elapsed_s(self, now: float) -> float:
        """Return the seconds since the start, by default the first call."""
        if self.start is None:
            self.start = now
        return now - self.start

    def on_request(self, frame: bytes, now: float) -> list[Entry]:
        """Those that strike a request, of which one at most comes in the place of the answer."""
        elapsed_s, struck, taken = self.elapsed_s(now), [], False
        for entry in self.entries:
            fault = entry.fault
            if not isinstance(fault, RequestFault) or (taken and isinstance(fault, InsteadFault)):
                continue
            if not fault.suits(frame[FUNCTION_AT]) or not fault.on.covers(frame) or not entry.strikes(elapsed_s, frame):
                continue
            struck.append(entry)
            taken = taken or isinstance(fault, InsteadFault)
        return struck

    def on_connect(self, now: float) -> WireFault | None:
        """The one that keeps a client out."""
        elapsed_s = self.elapsed_s(now)
        for entry in self.entries:
            fault = entry.fault
            if not isinstance(fault, ConnectionFault):
                continue
            if isinstance(fault, ConnectionLimit) and self.clients < fault.clients:
                continue
            if entry.strikes(elapsed_s):
                self.strikes.append(StruckFault(now, fault, None))
                return fault
        return None
