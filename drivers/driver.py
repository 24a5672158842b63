"""The boundary between the manager and one lift, whatever the lift speaks: the manager calls `LiftDriver`, the driver calls `DriverOwner`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from drivers.model import (
    Capabilities,
    Command,
    CommandInfo,
    CommandStep,
    DriverFailed,
    Hold,
    LiftReading,
    Outcome,
    OutputChanged,
    PlannedWrite,
    PressId,
    SignalValue,
    Written,
)

OnAnswer = Callable[["LiftReading | None"], None]
"""Receives the result of a poll that was begun without a task."""

Report = Outcome | OutputChanged | Written | DriverFailed
"""What a driver reports by itself."""


class DriverOwner(Protocol):
    """Commands a driver and receives what it reports."""

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        """Return what forbids this command now, or None. Has no side effects.

        The driver calls it immediately before the bytes leave, with no await in between, for the command itself and for every
        other command that the same write asserts; and at other times for an estimate. `press` is the press that is not written
        yet; None for a hold and for outputs that are already on.
        """
        ...

    def report(self, item: Report) -> None:
        """Receive a report. The driver is in the middle of its work: queue what needs an answer."""
        ...


class NoOwner:
    """Stands in until an owner is attached: refuses every press and drops every report."""

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        """Forbid every command."""
        return "no owner is attached to this driver"

    def report(self, item: Report) -> None:
        """Drop the report."""


class LiftDriver(Protocol):
    """Reads and commands one lift.

    `declare`, `press` and `cancel` return at once; `run` carries them out. The driver knows its map's rules (exclusions, pauses,
    endings, verification, other writers) and nothing of sessions, journals or disks: record first, then call the driver.
    """

    @property
    def capabilities(self) -> Capabilities:
        """The signals and commands of this lift."""
        ...

    @property
    def source(self) -> str:
        """Controller name and address, for messages."""
        ...

    def attach(self, owner: DriverOwner) -> None:
        """Consult and report to `owner` from now on. Until then nothing may be pressed."""
        ...

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled."""
        ...

    async def read(self) -> LiftReading:
        """Poll once, or finish the poll that was begun. Raises DriverError; an old reading is never returned instead."""
        ...

    def begin_read(self, on_answer: OnAnswer) -> bool:
        """Begin a poll without a task, which costs as much as the rest of a poll. Returns False where that is not possible: call `read`.

        Otherwise `on_answer` is called once, and must not raise: with a reading that repeats the one before in all but its time, or
        with None. In that case `read` returns the reading, or raises, without repeating the request.
        """
        ...

    def declare(self, holds: Mapping[Command, Hold]) -> None:
        """Replace the set of outputs that should be on.

        Outputs that are absent are released; a release is repeated until it is verified or the controller is gone. Declare again
        whenever `until` moves; a hold of which nothing could be sent is then tried again. A hold declared without `begin` before
        the first reading is kept if that reading finds it on. Presses under way are not affected, nor are pulses, which end by
        themselves.
        """
        ...

    def press(self, press: PressId, command: Command, leave_by: float) -> None:
        """Press a command once. It is never repeated, whatever happens to it; its `Outcome` is reported once.

        A press that is not written by the monotonic time `leave_by`, plus the pauses that the map requires, is given up. An output
        that stays on is kept while it is declared, at most for `max_hold_s`. A newer press of the same command replaces it.
        """
        ...

    def cancel(self, press: PressId) -> None:
        """Cancel a press: it is no longer sent, and its output is released unless that is declared.

        A press without an outcome ends as unconfirmed.
        """
        ...

    def frames(self, command: Command) -> tuple[str, ...]:
        """Return the writes that a press of this command would send, as far as they are known without reading."""
        ...

    def commands(self) -> tuple[CommandInfo, ...]:
        """Return every command of the map, whether or not the site grants control."""
        ...

    def plan(self, steps: Sequence[CommandStep]) -> tuple[PlannedWrite, ...]:
        """Return every press and release that these steps would write from rest, in order; what is on at their end is released.

        Nothing is sent. A pulse ends before the next press. Left out are heartbeats, repetitions of what is on, and reads. Raises
        ValueError for a command that the map does not have, or a floor that the site does not have.
        """
        ...

    def fence(self, until: float) -> None:
        """Write nothing at or after this monotonic time, not even releases; a later time lifts the fence.

        Time for which the computer is suspended counts as well.
        """
        ...

    def signals(self, now: float) -> tuple[SignalValue, ...]:
        """Return every signal of the map as last read, with its age at the monotonic time `now`; decoded on each call."""
        ...

    async def released(self) -> None:
        """Return once every output is verified to be at rest. Waits while a controller is away, so give it a time limit."""
        ...
