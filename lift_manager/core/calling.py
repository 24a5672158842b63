"""The one call that a session has on: which command it is, and when it is let go."""

from __future__ import annotations

from asyncio import Future
from collections.abc import Callable

from drivers.model import Command, CommandKind, FloorName, Outcome
from lift_manager.core.options import LiftOptions
from lift_manager.core.outputs import LiftOutputs, Permit
from register_maps.words import Side

Press = Callable[[Command, Permit], Future[Outcome]]
"""Gives a command and sees to it that its outcome is heard."""

_ACKNOWLEDGEMENTS = frozenset({"robot_in_place", "robot_left"})


class CallButton:
    """Presses the call of the map that moves the car now, and never has two of them on."""

    def __init__(self, outputs: LiftOutputs, options: LiftOptions, press: Press) -> None:
        self._outputs = outputs
        self._able = outputs.capabilities
        self._options = options
        self._press = press
        self._on: Command | None = None
        """The newest call pressed; a pulse has ended by itself since."""
        self._held_door: Command | None = None
        """The newest call that kept the door open."""
        self._until = ""

    def command(self, floor: FloorName, *, aboard: bool) -> Command | None:
        """Return what brings the car to a floor; None where the map has nothing for it.

        Where the door is part of the call, it is the front one if the floor has it.
        """
        if "go_to" in self._able.commands:
            return Command(CommandKind.GO_TO, floor)
        sides = [Command(CommandKind.GO_TO, floor, side) for side in Side if side in self._options.doors_at[floor]]
        plain = Command(CommandKind.GO if aboard else CommandKind.CALL, floor)
        return next((call for call in (*sides, plain) if call.name in self._able.commands), None)

    @property
    def until(self) -> str:
        """What ends the call that is on; empty for a pulse, or for none."""
        return self._until if self._on is not None else ""

    def holds_door(self, floor: FloorName, *, aboard: bool) -> bool:
        """Whether the call to a floor keeps the door open there, because it stays on while the robot boards or leaves."""
        call = self.command(floor, aboard=aboard)
        return call is not None and self._ends(call, aboard=aboard) in _ACKNOWLEDGEMENTS

    @property
    def keeps_door(self) -> bool:
        """Whether the newest call keeps the door open, and nothing has ended it."""
        return self.until in _ACKNOWLEDGEMENTS

    @property
    def door_at_rest(self) -> bool:
        """Whether no call keeps the door open, and that is verified."""
        return not self.keeps_door and (self._held_door is None or self._outputs.at_rest(self._held_door))

    @property
    def forgotten(self) -> bool:
        """Whether the call should be on, and the controller no longer holds it."""
        return self._on is not None and self._until != "" and not self._outputs.given(self._on)

    def press(self, floor: FloorName, permit: Permit, *, aboard: bool) -> Future[Outcome] | None:
        """Press the call that brings the car to a floor; another one that is on is let go first. None where the map has none."""
        command = self.command(floor, aboard=aboard)
        if command is None:
            return None
        if self._on is not None and self._on.name != command.name:
            self.let_go()
        self._take(command, aboard=aboard)
        return self._press(command, permit)

    def adopt(self, floor: FloorName, permit: Permit, *, aboard: bool) -> None:
        """Keep the call to a floor, pressed before a restart, on if it is found on. A pulse has ended by itself."""
        command = self.command(floor, aboard=aboard)
        if command is not None and command.name in self._able.until:
            self._take(command, aboard=aboard)
            self._outputs.adopt(command, permit)

    def _take(self, command: Command, *, aboard: bool) -> None:
        self._on = command
        self._until = self._ends(command, aboard=aboard)
        if self.keeps_door:
            self._held_door = command

    def _ends(self, command: Command, *, aboard: bool) -> str:
        until = self._able.until.get(command.name, "")
        # a robot aboard is in place already
        return "arrived" if aboard and until == "robot_in_place" else until

    def let_go(self) -> None:
        """Let go of the call, if one is on."""
        if self._on is not None:
            self._outputs.let_go(self._on)
            self._on = None

    def let_go_at(self, end: str) -> None:
        """Let go of the call if this is what ends it."""
        if self.until == end:
            self.let_go()

    def let_go_of_door(self) -> None:
        """Let go of a call that keeps the door open."""
        if self.keeps_door:
            self.let_go()

    def interrupt(self) -> None:
        """Let go of a call that keeps the door open, and miss it: it is `forgotten` from here on."""
        if self._on is not None and self.keeps_door:
            self._outputs.let_go(self._on)

    def keep_on(self, permit: Permit) -> None:
        """Renew a call that keeps the door open, unless the controller forgot it."""
        if self._on is not None and self.keeps_door and self._outputs.given(self._on):
            self._outputs.hold(self._on, permit, begin=False)
