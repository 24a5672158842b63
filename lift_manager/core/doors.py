"""The holds of the doors that serve a floor."""

from __future__ import annotations

from drivers.model import Command, CommandKind, FloorName
from lift_manager.core.options import LiftOptions
from lift_manager.core.outputs import LiftOutputs, Permit
from register_maps.words import Side


class DoorHolds:
    """Holds every door of a floor, and lets them all go."""

    def __init__(self, outputs: LiftOutputs, options: LiftOptions) -> None:
        self._outputs = outputs
        self._able = outputs.capabilities
        self._options = options

    def known(self, floor: FloorName) -> bool:
        """Whether the map has a hold for every door that serves a floor."""
        return all(_hold(side).name in self._able.commands for side in self._options.doors_at[floor])

    def hold(self, floor: FloorName, permit: Permit, *, begin: bool = True) -> bool:
        """Hold the doors that serve a floor, or renew that; only renew it where it may not `begin`. Returns whether any is held."""
        holds = [_hold(side) for side in self._options.doors_at[floor]]
        wanted = holds if begin else [hold for hold in holds if self._outputs.given(hold)]
        for hold in wanted:
            self._outputs.hold(hold, permit, begin=begin)
        return bool(wanted)

    def keep(self) -> None:
        """Press none again that is lost; what is on is renewed by `hold`."""
        for side in self._able.doors:
            self._outputs.keep(_hold(side))

    def adopt(self, floor: FloorName, permit: Permit) -> None:
        """Keep the holds of a floor's doors that are found on after a restart."""
        for side in self._options.doors_at[floor]:
            if (hold := _hold(side)).name in self._able.commands:
                self._outputs.adopt(hold, permit)

    def held(self, floor: FloorName) -> bool:
        """Whether the hold of every door at a floor is on and verified, where the map has one."""
        holds = [_hold(side) for side in self._options.doors_at[floor]]
        return all(self._outputs.held(hold) for hold in holds if hold.name in self._able.commands)

    @property
    def given(self) -> bool:
        """Whether the hold of any door is on or asked for."""
        return any(self._outputs.given(_hold(side)) for side in self._able.doors)

    @property
    def at_rest(self) -> bool:
        """Whether every door is let go, and that is verified."""
        return all(self._outputs.at_rest(_hold(side)) for side in self._able.doors)

    def let_go(self) -> None:
        """Let go of every door."""
        for side in self._able.doors:
            self._outputs.let_go(_hold(side))


def _hold(side: Side) -> Command:
    return Command(CommandKind.HOLD_DOOR, side=side)
