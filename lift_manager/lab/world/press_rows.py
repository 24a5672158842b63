"""The judge of the disk: no command is pressed before its row and its session are on the disk, so none while the disk fails.

Releases need no rule here: `oracle` finds outputs that stay on without a request, whatever the disk does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.modbus.steps import StepKind
from lift_manager.lab.world.disk import SimulatedDisk
from lift_manager.lab.world.oracle import Oracle
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import RESTART, FaultChange, FloorRequest
from lift_manager.lift.journal import Row, RowKind
from lift_manager.lift.state import LiftState
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from register_maps.vocabulary import CALLS
from simulator.wire_faults import Exchange

SESSION_COMMANDS = frozenset(CALLS)
"""Commands that are pressed only during a session. A hold may outlast its session for a while."""


class PressRows:
    """A witness of presses and of the disk. It reports its findings to the oracle."""

    def __init__(self, oracle: Oracle, disk: SimulatedDisk) -> None:
        self._oracle = oracle
        self._disk = disk
        self._fresh: set[tuple[str, str]] = set()
        """Lifts and commands whose row is on the disk and whose press has not come yet."""
        self._pressed: set[tuple[str, str]] = set()
        """Lifts and commands that were pressed and not released since."""
        self._commands: dict[str, frozenset[str]] = {}
        """The outputs of each lift that were on in its last physical state."""
        self._off_at: dict[tuple[str, str], float] = {}
        """When an output last fell, by lift and command."""
        self._restarted_at = -math.inf
        disk.on_recorded.append(self._on_recorded)
        disk.on_committed.append(self._on_committed)

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Check that each press has a row. A hold that the controller dropped may be pressed again with its old row."""
        for name in sorted(commands - self._oracle.lifts[lift].repeated):
            key = (lift, name)
            if key not in self._fresh and (name in SESSION_COMMANDS or key not in self._pressed):
                rule, text = "pressed before its row", f"{name} is pressed, and its row is not on the disk"
                frozen = self._hidden_release(at, lift, name)
                if frozen is not None:
                    self._oracle.excuse_finding(lift, rule, frozen)
                else:
                    self._oracle.report(at, lift, rule, text)
            self._fresh.discard(key)
            self._pressed.add(key)
        saved = self._disk.store.records.get(lift)
        if commands & SESSION_COMMANDS and (saved is None or saved.record.session is None):
            text = f"{', '.join(sorted(commands))}, and a restart would not know the holder"
            self._oracle.report(at, lift, "pressed before its session", text)

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        """Note when each output falls."""
        commands = truth.commands
        self._off_at |= dict.fromkeys(((lift, name) for name in self._commands.get(lift, commands) - commands), at)
        self._commands[lift] = commands

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """This judge needs no published states."""

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """This judge needs no exchanges."""

    def on_event(self, at: float, event: Event) -> None:
        """This judge needs no events."""

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """This judge needs no requests."""

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Note when the manager was killed. The oracle knows the other faults."""
        if change.fault == RESTART:
            self._restarted_at = at

    def _hidden_release(self, at: float, lift: str, name: str) -> str | None:
        """Return the fault that hides the last release of a hold from a manager started since; None without one.

        Frozen registers still show the output on, and the record on the disk may be older than the release: the hold is found on, and refreshed.
        """
        off_at = self._off_at.get((lift, name), -math.inf)
        if name in SESSION_COMMANDS or off_at > self._restarted_at:
            return None
        return self._oracle.frozen_by(lift, off_at, at)

    def _on_recorded(self, row: Row) -> None:
        if row.kind is RowKind.WRITE and row.data.get("what") == StepKind.RELEASE:
            self._pressed.discard((row.lift, str(row.data["command"])))

    def _on_committed(self, rows: Sequence[Row]) -> None:
        self._fresh |= {(row.lift, str(row.data["command"])) for row in rows if row.kind is RowKind.PRESS}
