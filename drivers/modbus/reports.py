"""Connects one driver with its `DriverOwner`: checks presses with it and reports outputs as they change."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from drivers.driver import DriverOwner, NoOwner, Report
from drivers.modbus.confirm import Expectation, confirmation_of, find_proof
from drivers.modbus.output import Output
from drivers.modbus.outputs import Outputs
from drivers.modbus.steps import Phase
from drivers.model import (
    Command,
    CommandKind,
    DriverFailed,
    FloorName,
    LiftValues,
    OutputChanged,
    OutputState,
    PressId,
    Proof,
)
from register_maps.schema import Confirm
from register_maps.words import Side


class DriverReports:
    """Reports of one lift's driver to its owner."""

    def __init__(self, outputs: Outputs, floors: Mapping[int, FloorName]) -> None:
        """`floors` are floor names by code."""
        self.owner: DriverOwner = NoOwner()
        self.values: LiftValues | None = None
        """The newest values of the lift; None before the first reading."""
        self.states: Mapping[str, OutputState] = dict.fromkeys(outputs.names, OutputState.AT_REST)
        """As last reported; a new object whenever one has changed."""
        self.ignored: str | None = None
        """Why the controller would not obey; None while it would."""
        self._outputs = outputs
        self._floors = floors

    def report(self, item: Report) -> None:
        """Report to the owner."""
        self.owner.report(item)

    def report_failure(self, reason: str) -> None:
        """Report a bug."""
        self.owner.report(DriverFailed(reason))

    def report_states(self) -> bool:
        """Report each output whose state has changed. Returns whether there is any."""
        changed = {name: state for name, known in self.states.items() if (state := self._state(name)) is not known}
        if not changed:
            return False
        self.states = {**self.states, **changed}
        for name, state in changed.items():
            self.owner.report(OutputChanged(name, state))
        return True

    def blocked_by(self, name: str, press: PressId | None) -> str | None:
        """Return what forbids writing an output as pressed, or None."""
        return self.ignored or self.owner.blocked_by(self.command(name), press)

    def command(self, name: str) -> Command:
        """Return the command that an output carries out."""
        return self._command_of(name, self._outputs.output(name))

    def confirmation(self, name: str) -> Confirm:
        """Return what shows that this command took effect."""
        return confirmation_of(self._outputs.output(name).spec)

    def _command_of(self, name: str, output: Output) -> Command:
        floor = self._floors.get(output.code) if output.codec.is_call and output.code is not None else None
        return _command(name, floor)

    def _state(self, name: str) -> OutputState:
        output = self._outputs.output(name)
        match output.phase:
            case Phase.REST:
                return OutputState.REQUESTED if output.awaits_look else OutputState.AT_REST
            case Phase.DUE | Phase.LEAVING:
                return OutputState.REQUESTED
            case Phase.RELEASING:
                return OutputState.RELEASING
            case Phase.ON if output.is_lost:
                return OutputState.LOST
            case _:
                return OutputState.HELD if self._is_held(name, output) else OutputState.ON

    def _is_held(self, name: str, output: Output) -> bool:
        """Whether an output is on and verified, by read-back or, where the map asks for it, by its effect."""
        if self.values is None or not output.is_held:
            return False
        if output.codec.is_call:
            return output.verified  # where the car goes does not show what is still on
        any_of = confirmation_of(output.spec).any_of
        if "readback" in any_of and not output.verified:
            return False  # a door that is open for another reason does not prove the hold
        expected = Expectation(self._command_of(name, output), any_of, None, ())
        return find_proof(expected, self.values, read_back=output.verified) is not Proof.NONE


@lru_cache(1024)
def _command(name: str, floor: FloorName | None) -> Command:
    """Return the command of this name: the same one for every look at its output."""
    kind, _, side = name.partition(".")
    return Command(CommandKind(kind), floor, Side(side) if side else None)
