"""Watches a lift while it is tried: what it shows, what has changed, and waiting for it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

from lift_manager.api.lifts import Lift, Signal
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import ClientError
from lift_manager.commissioning.poke.trial import ROBOT_MODE
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import Quality
from register_maps.vocabulary import SIGNALS, Kind

LOOK_EVERY_S = 0.2
"""Chosen: as often as most lifts are polled."""
AT_REST = (None, "at rest")
"""States of an output on which nothing is left to release."""
_RUNNING = (Kind.COUNTER, Kind.NUMBER)
"""Signals that change all the time."""

Show = Callable[[str], None]
"""Prints a line."""


@dataclass(frozen=True, slots=True)
class View:
    """What one look at a lift shows."""

    lift: Lift
    outputs: Mapping[str, str | None]
    """The state of each output."""
    signals: Mapping[str, Signal]

    @property
    def robot_mode(self) -> str | None:
        """The state of the output that asks for robot mode; None if that is unknown, or the lift has none."""
        return self.outputs.get(ROBOT_MODE)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the manager says about the lift."""
        lift = self.lift
        return tuple(
            note for note in (lift.reason, lift.restrictions.waiting_for, lift.restrictions.distrusted) if note
        )

    def has_arrived(self, floor: str) -> bool:
        """Whether the car is known to stand at a floor."""
        return self.lift.quality is Quality.LIVE and self.lift.standing and self.lift.floor == floor

    def stands_open_at(self, floor: str) -> bool:
        """Whether a robot could enter or leave at a floor."""
        return self.lift.floor == floor and self.lift.robot_door is RobotDoor.OPEN

    def reads_yes(self, flag: str) -> bool:
        """Whether the lift has a flag, and it reads yes."""
        return flag in self.signals and self.signals[flag].value is True

    @property
    def not_at_rest(self) -> Mapping[str, str | None]:
        """The outputs that are not at rest, with their states."""
        return {name: state for name, state in self.outputs.items() if state not in AT_REST}


def changes(before: View, after: View) -> Iterator[str]:
    """Tell what has changed from one look to the next: outputs first, then signals, then the car."""
    for name, state in after.outputs.items():
        if state is not None and before.outputs.get(name) != state:
            yield f"output {name}: {before.outputs.get(name) or 'unknown'} -> {state}"
    for name, signal in after.signals.items():
        old = before.signals.get(name)
        if old is not None and (old.value, old.raw) != (signal.value, signal.raw) and SIGNALS.get(name) not in _RUNNING:
            yield f"signal {name}: {_value(old)} -> {_value(signal)}   ({', '.join(signal.addresses)})"
    yield from _changes_of_car(before, after)
    if after.notes != before.notes:
        waits_for = after.lift.restrictions.waiting_for
        yield from (f"waiting for {note}" if note == waits_for else note for note in after.notes)


def _changes_of_car(before: View, after: View) -> Iterator[str]:
    was, lift = before.lift, after.lift
    if lift.standing and (was.standing, was.floor) != (True, lift.floor):
        yield f"the car stands at {lift.floor}"
    elif was.standing and not lift.standing:
        yield "the car is not seen to stand any more"
    if was.mode != lift.mode and "mode" not in after.signals:
        yield f"mode: {was.mode} -> {lift.mode}"


def _value(signal: Signal) -> str:
    if isinstance(signal.value, bool):
        return "yes" if signal.value else "no"
    return f"raw {signal.raw}" if signal.value is None else str(signal.value)


async def look(client: LiftManagerClient, lift: str) -> View:
    """Read a lift, its outputs and its signals. Raises ClientError."""
    state = await client.lift(lift)
    outputs = {command.name: command.state for command in (await client.commands(lift)).commands}
    signals = {signal.name: signal for signal in (await client.signals(lift)).signals}
    return View(state, outputs, signals)


class Watcher:
    """Looks at a lift again and again, and tells what changes."""

    def __init__(self, client: LiftManagerClient, view: View, show: Show, *, began: float) -> None:
        """`view` is the first look, of which nothing is told; `began` is when the trial did."""
        self.view = view
        self._client = client
        self._show = show
        self._began = began
        self._was_held = view.lift.session is not None

    def report(self, text: str) -> None:
        """Print a line, with the time since the trial began."""
        self._show(f"{asyncio.get_running_loop().time() - self._began:7.1f} s  {text}")

    async def watch(self) -> None:
        """Look until it is cancelled."""
        while True:
            with suppress(ClientError):
                await self._look()
            await asyncio.sleep(LOOK_EVERY_S)

    async def until(self, is_met: Callable[[View], bool], within_s: float, *, looks: bool = False) -> bool:
        """Wait until what the watch sees meets a condition, or the session is over; return whether it does.

        `looks` where nothing watches: after the end of the session. It alone raises ClientError.
        """
        ends_at = asyncio.get_running_loop().time() + within_s
        while True:
            if looks:
                await self._look()
            if is_met(self.view):
                return True
            is_over = self._was_held and self.view.lift.session is None and not looks
            if is_over or asyncio.get_running_loop().time() >= ends_at:
                return False
            await asyncio.sleep(LOOK_EVERY_S)

    async def _look(self) -> None:
        before, self.view = self.view, await look(self._client, self.view.lift.name)
        self._was_held = self._was_held or self.view.lift.session is not None
        for line in changes(before, self.view):
            self.report(line)
