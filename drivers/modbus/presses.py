"""Keeps the presses of one lift until each has its outcome."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from drivers.modbus.confirm import Expectation, find_proof
from drivers.modbus.standstill import StandstillEvidence
from drivers.modbus.write_reports import hex_part
from drivers.model import Command, FloorName, LiftValues, Outcome, PressId, Proof, Result
from register_maps.frames import Request
from register_maps.schema import Confirm, Evidence

REPLACED = "replaced by a newer command"
NOT_SENT = "not sent: another command replaced it, or it could not be sent in time"


@dataclass(slots=True, eq=False)
class Press:
    """One press."""

    id: PressId
    command: Command
    frames: list[str] = field(default_factory=list)
    expected: Expectation | None = None
    """Set once the write was echoed."""
    written_at: float = math.inf
    read_back: bool = False
    grant_missing: bool = False
    ended: bool = False

    def add_frame(self, request: Request) -> None:
        """Record a request that was answered."""
        self.frames.append(hex_part(request).hex())


class Presses:
    """Holds at most one press per command; a newer one ends the older."""

    # every poll touches it: see benchmarks/README.md
    __slots__ = ("_by_name", "_floors", "_report", "_standing", "waiting")

    def __init__(self, floors: Sequence[FloorName], evidence: Evidence, report: Callable[[Outcome], None]) -> None:
        """`floors`, lowest first; `evidence` is the map's rule for a car that stands."""
        self._floors = tuple(floors)
        self._report = report
        self._by_name: dict[str, Press] = {}
        self.waiting: list[Press] = []
        """Those for whose proof readings are checked."""
        self._standing = StandstillEvidence(evidence)

    @property
    def unwritten(self) -> tuple[str, ...]:
        """The commands whose press is not written yet."""
        return tuple(name for name, press in self._by_name.items() if press.expected is None)

    def begin(self, press: Press) -> None:
        """Add a new press."""
        self.end(press.command.name, Result.UNCONFIRMED, REPLACED)
        self._by_name[press.command.name] = press

    def get(self, name: str) -> Press | None:
        """Return the press of a command that has no outcome yet, or None."""
        return self._by_name.get(name)

    def end(self, name: str, result: Result, reason: str) -> None:
        """End the press of a command, if there is one."""
        press = self._by_name.get(name)
        if press is not None:
            self.finish(press, result, reason)

    def end_all(self, reason: str) -> None:
        """End every press as unconfirmed."""
        for name in tuple(self._by_name):
            self.end(name, Result.UNCONFIRMED, reason)

    def await_proof(self, press: Press, confirm: Confirm, before: LiftValues | None) -> None:
        """Wait for readings that prove a press whose write was echoed, until its time is over."""
        loop = asyncio.get_running_loop()
        press.written_at = loop.time()
        was_standing = self._standing.is_standing(press.written_at)
        press.expected = Expectation(press.command, confirm.any_of, before, self._floors, was_standing)
        self.waiting.append(press)
        loop.call_later(confirm.within_s, self._give_up, press, confirm.within_s)

    def check_proof(self, values: LiftValues, at: float) -> None:
        """Check the waiting presses against a reading; only one requested after the write counts."""
        for press in tuple(self.waiting):
            if press.expected is None or at < press.written_at:
                continue
            found = find_proof(press.expected, values, read_back=press.read_back)
            if found is not Proof.NONE:
                self.finish(press, Result.CONFIRMED, "", found)
            elif not press.expected.was_standing and self._standing.is_standing(at):
                press.expected = replace(press.expected, before=values, was_standing=True)

    def update(self, values: LiftValues, at: float) -> None:
        """Take a reading that differs from the one before, whether or not a press waits."""
        self._standing.update(values, at)

    def restart(self, values: LiftValues, at: float) -> None:
        """Take the first reading after a gap, whether or not it differs from the last one before."""
        self._standing.reset()
        self._standing.update(values, at)

    def finish(self, press: Press, result: Result, reason: str, found: Proof = Proof.NONE) -> None:
        """Give a press its outcome."""
        if press in self.waiting:
            self.waiting.remove(press)
        if self._by_name.get(press.command.name) is press:
            del self._by_name[press.command.name]
        if not press.ended:
            press.ended = True
            frames = tuple(press.frames)
            self._report(Outcome(press.command, result, reason, found, frames, press.grant_missing, press.id))

    def _give_up(self, press: Press, within_s: float) -> None:
        self.finish(press, Result.UNCONFIRMED, f"nothing showed within {within_s:g} s that the lift took it")
