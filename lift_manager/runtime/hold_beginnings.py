"""Which declared holds may begin: each beginning is written down first, and has a number of its own.

`lift.outputs` declares which holds should be on; the driver switches one on once for every number that it is given. Between the
two, a beginning waits for the disk as a press does. Releases and renewals do not.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from drivers.model import Command, Hold, OutputState
from lift_manager.lift import outputs
from lift_manager.lift.inputs import Outputs

_ON = frozenset({OutputState.ON, OutputState.HELD})
_GIVEN = _ON | {OutputState.REQUESTED}


class UnrecordedHold(NamedTuple):
    """A hold that has to be written down before it is switched on."""

    command: Command
    again: bool
    """It was on, and was found off."""


@dataclass(slots=True)
class _Waiting:
    """A beginning that waits for the disk."""

    commit: int | None = None
    """None until it was handed to the store."""


class Holds:
    """The holds of one lift, as they are declared to its driver."""

    def __init__(self) -> None:
        self.declared: Mapping[Command, Hold] = {}
        """As the driver has it."""
        self.states: dict[str, OutputState] = {}
        """Of every output, as the driver reported it last."""
        self._number = 0
        self._numbers: dict[str, int] = {}
        """Under which number each hold is on."""
        self._requested: Mapping[str, outputs.Hold] = {}
        self._waiting: dict[str, _Waiting] = {}
        self._unwritten: dict[str, None] = {}
        """Holds that are on the disk and were not switched on since: they need no other row."""
        self._committed = 0

    def update(
        self, requested: Mapping[Command, outputs.Hold], pressed: Collection[str], *, may_begin: bool
    ) -> tuple[UnrecordedHold, ...]:
        """Take what should be on; return what has to be written down before it begins.

        `pressed` are the outputs whose press is not with the driver yet: what is on for the same command stays, and what is on for
        another one is released. Nothing new may begin while nothing can be written down.
        """
        self._requested = {command.name: hold for command, hold in requested.items()}
        for name in [name for name in (*self._waiting, *self._unwritten) if not self._begins(name)]:
            self._waiting.pop(name, None)
            self._unwritten.pop(name, None)
        for name in self._numbers.keys() - self._requested.keys():
            del self._numbers[name]
        before = {command.name: (command, hold) for command, hold in self.declared.items()}
        after = {
            command: hold for command, hold in self.declared.items() if command.name in pressed and command in requested
        }
        beginnings = []
        for command, hold in requested.items():
            name = command.name
            if name in pressed:
                continue
            known = before[name][1] if name in before else None
            if not hold.begin:
                after[command] = Hold(0, hold.until)
            elif known is not None and self._needs_no_beginning(name):
                after[command] = Hold(self._numbers.get(name, 0), hold.until)
            elif self._is_written_down(name):
                after[command] = Hold(self._next_number(name), hold.until)
            else:
                if known is not None:
                    after[command] = Hold(known.begin, hold.until)
                if may_begin and name not in self._waiting:
                    self._waiting[name] = _Waiting()
                    beginnings.append(UnrecordedHold(command, self._state(name) is OutputState.LOST))
        self.declared = after
        return tuple(beginnings)

    def handed_over(self, commit: int) -> None:
        """Record under which number the beginnings that `update` returned are committed."""
        for waiting in self._waiting.values():
            if waiting.commit is None:
                waiting.commit = commit

    def committed(self, commit: int) -> None:
        """Note that everything up to this commit is on the disk."""
        self._committed = max(self._committed, commit)

    def not_committed(self, commit: int) -> tuple[str, ...]:
        """Forget the beginnings of a commit that failed, and return which they are."""
        gone = [name for name, one in self._waiting.items() if one.commit is not None and one.commit <= commit]
        for name in gone:
            del self._waiting[name]
        return tuple(gone)

    def put_on(self, name: str) -> None:
        """Note that the driver has written it: another beginning needs another row."""
        self._unwritten.pop(name, None)

    def shown(self, pressed: Collection[str]) -> Outputs:
        """Return the state of every output as the rules know it: what waits for the disk is requested."""
        return {
            name: self.shown_of(name, pressed) for name in {**self.states, **self._waiting, **dict.fromkeys(pressed)}
        }

    def shown_of(self, name: str, pressed: Collection[str]) -> OutputState:
        """Return the same for one output.

        A hold that a restart found on stays what it is, although it waits to be written down for its holder.
        """
        state = self._state(name)
        if name in pressed or (state is OutputState.LOST and self._begins(name)):
            return OutputState.REQUESTED
        if name in self._waiting and not (state in _ON and any(name == command.name for command in self.declared)):
            return OutputState.REQUESTED
        return state

    def _begins(self, name: str) -> bool:
        return name in self._requested and self._requested[name].begin

    def _needs_no_beginning(self, name: str) -> bool:
        """Whether a hold is on, or on its way. One that a restart found on is only kept until it is written down for its holder."""
        state = self._state(name)
        return state in _GIVEN and (name in self._numbers or state is OutputState.REQUESTED)

    def _is_written_down(self, name: str) -> bool:
        waiting = self._waiting.get(name)
        if waiting is None:
            return name in self._unwritten
        if waiting.commit is None or waiting.commit > self._committed:
            return False
        del self._waiting[name]
        self._unwritten[name] = None
        return True

    def _state(self, name: str) -> OutputState:
        return self.states.get(name, OutputState.AT_REST)

    def _next_number(self, name: str) -> int:
        self._number += 1
        self._numbers[name] = self._number
        return self._number
