"""Decides whether something may be pressed: when a step starts, and again when its bytes leave."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping

from drivers.modbus.alive_counter import AliveCounter
from drivers.modbus.outputs import Outputs
from drivers.modbus.presses import Press, Presses
from drivers.modbus.reports import DriverReports
from drivers.modbus.steps import KINDS_WITH_PERMIT, READ_ONLY_KINDS, Step, StepKind
from drivers.modbus.transactions import Permit
from drivers.modbus.units import Units
from drivers.model import LiftValues, Result
from register_maps.codec import Codec, CommandCodec
from register_maps.words import Door, Side

_UNREQUESTED_KINDS = frozenset({StepKind.BEAT, StepKind.RESET})

READ_WITHIN_S = 1.0
"""How long after a connection a release that covers declared neighbours waits for the first reading. Chosen: `max_age_s`."""


class Permissions:
    """Checks presses against what the lift reports, then with the driver's owner."""

    def __init__(
        self,
        codec: Codec,
        outputs: Outputs,
        presses: Presses,
        units: Units,
        alive: AliveCounter,
        reports: DriverReports,
        is_unread: Callable[[], bool],
    ) -> None:
        """`is_unread` tells whether a connection is new and was not read yet."""
        self._commands = codec.commands
        self._signals = codec.signals
        self._outputs = outputs
        self._presses = presses
        self._units = units
        self._alive = alive
        self._reports = reports
        self._is_unread = is_unread

    def missing_flags(self, name: str) -> list[str]:
        """Return the flags that a command requires and the lift does not show."""
        values = self._reports.values
        flags = values.flags if values is not None else {}
        return [flag for flag in self._commands[name].spec.requires if not flags.get(flag, False)]

    def is_watchdog_tripped(self) -> bool:
        """Whether the lift reports that a watchdog has released our outputs."""
        values = self._reports.values
        return values is not None and values.flags.get("watchdog_tripped", False)

    def must_wait(self, step: Step) -> bool:
        """Whether a release is postponed because it would also release neighbours in the same cells.

        Before the first reading of a connection they may not be pressed, even if they are declared. And a press of somebody else
        is no reason to release outputs of ours.
        """
        if step.kind not in (StepKind.RELEASE, StepKind.PAUSE):
            return False
        neighbours = self._outputs.neighbours(step)
        if neighbours and self._outputs.output(step.name).foreign:
            return self._first_refusal(neighbours) is not None
        return bool(neighbours) and self._awaits_first_reading(self._outputs.output(step.name).codec.endpoint)

    def _awaits_first_reading(self, endpoint: str) -> bool:
        """Whether a connection was lost or is new, and its first reading is still to be expected."""
        up_for_s = self._units.up_for_s(endpoint)
        return up_for_s is None or (self._is_unread() and up_for_s < READ_WITHIN_S)

    def permit_for(self, step: Step, press: Press | None) -> Permit | None:
        """Return the check to make immediately before a step is sent; None for a release, which is never refused.

        A write presses its neighbours again. Neighbours that may not be pressed now are released with it, and are checked again
        when the bytes leave.
        """
        if step.kind not in KINDS_WITH_PERMIT:
            if step.kind in READ_ONLY_KINDS:
                return None
            if step.kind is StepKind.CYCLE:
                return self._refusal_if_unread
            if step.kind in _UNREQUESTED_KINDS:
                return self._permit_for_unrequested(step)
            self._drop_refused(step)
            return None

        if self._outputs.neighbours(step) and self._refusal(step.name) is None:
            self._drop_refused(step)

        def allowed() -> str | None:
            if not self._outputs.is_needed(step):
                return "it is no longer requested"
            if press is not None and self.missing_flags(step.name):
                press.grant_missing = True
            if self._alive.is_awaited:
                # of this step alone: neighbours that are on are not released because of it
                return "its alive counter has not changed on this connection yet"
            return self._refusal(step.name) or self._first_refusal(self._outputs.neighbours(step))

        return allowed

    def _refusal_if_unread(self) -> str | None:
        """Return why nothing is written before the first reading, not even a block at rest: outputs that are on may still be needed."""
        return "the connection is new and has not been read yet" if self._is_unread() else None

    def _permit_for_unrequested(self, step: Step) -> Permit | None:
        """Return the check for a write without a request: it may not press neighbours that may not be pressed.

        Its content is as old as the step: a look that has found a neighbour on since then overrides it.
        """
        neighbours = self._outputs.neighbours(step)
        early = self._is_unread() and bool(self._outputs.others_in_cells(step))
        if not neighbours and not early:
            return None

        def allowed() -> str | None:
            if early and not self._is_unread():
                return "our outputs were read back meanwhile"
            return self._first_refusal(neighbours)

        return allowed

    def _drop_refused(self, step: Step) -> None:
        """Release the neighbours that this write may not press again."""
        for name in self._outputs.neighbours(step):
            if (reason := self._refusal(name)) is not None:
                self._outputs.release(name)
                self._presses.end(name, Result.UNCONFIRMED, f"released together with {step.name}: {reason}")

    def _refusal(self, name: str) -> str | None:
        """Return why an output may not be written as pressed now, or None."""
        if (unread := self._refusal_if_unread()) is not None:
            return unread
        if missing := self.missing_flags(name):
            return f"{name} needs {', '.join(missing)}"
        values = self._reports.values
        if values is not None and name in closes_to_release({name: self._commands[name]}, values, self._signals):
            return "the door is shut or opens, or something is in its way"
        press = self._presses.get(name)
        unwritten = press is not None and press.expected is None
        return self._reports.blocked_by(name, press.id if press is not None and unwritten else None)

    def _first_refusal(self, names: tuple[str, ...]) -> str | None:
        reasons = ((name, self._refusal(name)) for name in names)
        return next((f"{name} would be pressed with it: {reason}" for name, reason in reasons if reason), None)


def closes_to_release(
    commands: Mapping[str, CommandCodec], values: LiftValues, signals: Collection[str]
) -> Iterator[str]:
    """Yield the close commands to release: the door is shut, opens again, or is obstructed, or the car is overloaded.

    `signals` are those that the map declares; one that cannot be read counts as an obstruction.
    """
    for side in Side:
        name = f"close_door.{side}"
        if name not in commands:
            continue
        door = values.doors.get(side)
        flags = (f"obstruction.{side}", "overload", "nudging")
        is_obstructed = any(flag in signals and values.flags.get(flag, True) for flag in flags)
        if is_obstructed or door in (Door.CLOSED, Door.OPENING):
            yield name
