"""All lifts of one site behind one facade; every face uses this and nothing below it."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterable, Iterator
from contextlib import contextmanager

from lift_manager.core.bus import Bus, Subscription
from lift_manager.core.lift import LiftTask
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused
from lift_manager.domain.events import Event, StateChanged
from lift_manager.domain.state import LiftState


class LiftManager:
    """Many lifts. Answers come from memory; nothing here waits for a controller."""

    def __init__(self, lifts: Iterable[LiftTask], bus: Bus[Event]) -> None:
        self._lifts = {lift.options.name: lift for lift in lifts}
        self._bus = bus

    async def run(self) -> None:
        """Poll every lift until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for lift in self._lifts.values():
                tasks.create_task(lift.run())

    def drives(self) -> list[Coroutine[None, None, None]]:
        """Return what carries out each lift's presses and releases, to be run for as long as anything may be held."""
        return [lift.drive() for lift in self._lifts.values()]

    async def first_look(self) -> None:
        """Return once every lift has been read for the first time; bound it with a timeout."""
        for lift in self._lifts.values():
            await lift.first_look()

    async def stop(self) -> None:
        """Let everything go on every lift and return once it is verified; bound it with a timeout."""
        async with asyncio.TaskGroup() as tasks:
            for lift in self._lifts.values():
                tasks.create_task(lift.stop())

    def lift_names(self) -> tuple[str, ...]:
        """Return the lifts in the order of the site file."""
        return tuple(self._lifts)

    def state(self, lift: str) -> LiftState | None:
        """Return what a lift publishes right now; None for a lift that is not of this site."""
        task = self._lifts.get(lift)
        return None if task is None else task.state()

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide on a request at once."""
        task = self._lifts.get(ask.lift)
        if task is None:
            return Refused(Refusal.UNKNOWN_LIFT, f"no lift {ask.lift!r}; the lifts are {', '.join(self._lifts)}")
        return task.request(ask)

    @contextmanager
    def listen(self) -> Iterator[Subscription[Event]]:
        """Listen to events; the state of every lift comes first."""
        with self._bus.listen() as subscription:
            for name, task in self._lifts.items():
                subscription.put(StateChanged(name, task.state()))
            yield subscription
