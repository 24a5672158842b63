"""The driver's end of `DriverOwner`: asks on behalf of outputs, and reports the states of outputs as they change."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.driver import DriverOwner, NoOwner, Report
from drivers.modbus.confirm import Expectation, confirmation_of, find_proof
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
    """What one lift's driver says to whoever is attached."""

    def __init__(self, outputs: Outputs, floors: Mapping[int, FloorName]) -> None:
        """`floors` are the names of floors by their codes."""
        self.owner: DriverOwner = NoOwner()
        self.values: LiftValues | None = None
        """What the lift said last; None before it said anything."""
        self.states: Mapping[str, OutputState] = dict.fromkeys(outputs.names, OutputState.AT_REST)
        """As they were reported last; another object whenever one has changed."""
        self._outputs = outputs
        self._floors = floors

    def report(self, item: Report) -> None:
        """Report something."""
        self.owner.report(item)

    def report_failure(self, reason: str) -> None:
        """Report that a bug was met."""
        self.owner.report(DriverFailed(reason))

    def report_states(self) -> bool:
        """Report each output that is in another state than was reported last; returns whether there is any."""
        changed = {name: state for name, known in self.states.items() if (state := self._state(name)) is not known}
        if not changed:
            return False
        self.states = {**self.states, **changed}
        for name, state in changed.items():
            self.owner.report(OutputChanged(name, state))
        return True

    def blocked_by(self, name: str, press: PressId | None) -> str | None:
        """Ask what forbids an output to be written as pressed."""
        return self.owner.blocked_by(self.command(name), press)

    def command(self, name: str) -> Command:
        """Return what an output is on for, or will be."""
        output = self._outputs.output(name)
        kind, _, side = name.partition(".")
        floor = self._floors.get(output.code) if output.codec.is_call and output.code is not None else None
        return Command(CommandKind(kind), floor, Side(side) if side else None)

    def confirmation(self, name: str) -> Confirm:
        """Return what shows that this command took effect."""
        return confirmation_of(self._outputs.output(name).spec)

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
                return OutputState.HELD if self._is_held(name) else OutputState.ON

    def _is_held(self, name: str) -> bool:
        """Whether an output is on and verified, by read-back or, where the map asks for it, by its effect."""
        output = self._outputs.output(name)
        if self.values is None or not output.is_held:
            return False
        if output.codec.is_call:
            return output.verified  # where the car goes says nothing of what is still on
        any_of = self.confirmation(name).any_of
        if "readback" in any_of and not output.verified:
            return False  # a door that is open by itself does not make up for a hold that is not there
        expected = Expectation(self.command(name), any_of, None, ())
        return find_proof(expected, self.values, read_back=output.verified) is not Proof.NONE
