"""The boundary between the manager and one lift, whatever the lift speaks: the manager calls `LiftDriver`, the driver calls `DriverOwner`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from drivers.model import (
    Capabilities,
    Command,
    DriverFailed,
    Hold,
    LiftReading,
    Outcome,
    OutputChanged,
    PressId,
    SignalValue,
    Written,
)

Report = Outcome | OutputChanged | Written | DriverFailed
"""What a driver reports by itself."""


class DriverOwner(Protocol):
    """The side that commands a driver."""

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        """Return what forbids this command now; None where nothing does. Changes nothing.

        Asked immediately before the bytes leave, with no await in between, for the command itself and for every other one
        that the same write asserts; and at other times for an estimate. `press` is the press that has not been written yet;
        None for a hold, and for what is on already.
        """
        ...

    def report(self, item: Report) -> None:
        """Take note of something. The driver is in the middle of its work: queue what needs an answer."""
        ...


class NoOwner:
    """Nobody is above: every press is refused, and reports go nowhere."""

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        """Forbid everything."""
        return "nobody commands this lift"

    def report(self, item: Report) -> None:
        """Drop it."""


class LiftDriver(Protocol):
    """One lift as an object: what it says and what it can be told.

    `declare`, `press` and `cancel` only take note and return at once; `run` carries them out. The driver knows its map's rules
    (what excludes what, pauses, endings, verification, other writers) and nothing of sessions, journals or disks: whoever must
    write something down first calls it afterwards.
    """

    @property
    def capabilities(self) -> Capabilities:
        """What this lift can say and be told."""
        ...

    @property
    def source(self) -> str:
        """Where it is, for messages: controller name and address."""
        ...

    def attach(self, above: DriverOwner) -> None:
        """Ask and report to `above` from now on. Until then nothing may be pressed."""
        ...

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled."""
        ...

    async def read(self) -> LiftReading:
        """Poll once. Raises DriverError: then there is no reading, and nothing old stands in for it."""
        ...

    def declare(self, holds: Mapping[Command, Hold]) -> None:
        """Replace what should be on. What is absent is released: repeated until verified or the controller is gone.

        Repeat it whenever `until` moves; a hold that could not be put on, with nothing of it sent, is then tried again. What is
        declared before the lift is read for the first time without `begin` is kept if the first look finds it on. Presses that
        are on their way are left alone, and so are pulses: they end by themselves.
        """
        ...

    def press(self, press: PressId, command: Command, leave_by: float) -> None:
        """Give a command once. It is never repeated, whatever happens to it; its `Outcome` is reported once.

        One that was not written by the monotonic time `leave_by`, and the pauses that the map asks for, is given up. What stays
        on is kept for as long as it is declared, at most for `max_hold_s`. A newer press of the same command replaces it.
        """
        ...

    def cancel(self, press: PressId) -> None:
        """Take a press back: it does not leave any more, and what it put on is released, unless that is declared.

        Without an outcome until then it ends as unconfirmed.
        """
        ...

    def frames(self, command: Command) -> tuple[str, ...]:
        """Return the writes that a press of this command would be, as far as they are known without reading."""
        ...

    def fence(self, until: float) -> None:
        """Write nothing at or after this monotonic time, releases included; a later time lifts the fence."""
        ...

    def signals(self, now: float) -> tuple[SignalValue, ...]:
        """Return every signal of the map as it was read last, with its age at the monotonic time `now`; decoded when asked for."""
        ...

    async def released(self) -> None:
        """Return once every output is at rest, and that is verified; while a controller is away it waits, so bound it."""
        ...
