"""Runs the lifts of a site, and ends them in order: OPEN is withdrawn, robots leave the doorways, everything is released."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterable, Mapping
from contextlib import suppress

from lift_manager.lift import doors
from lift_manager.lift.freshness import fresh
from lift_manager.lift.inputs import AnnounceStop, Stop
from lift_manager.lift.session import CLEAR_AT_STOP_S
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.poll import LiftPoll
from lift_manager.runtime.site import Site
from lift_manager.runtime.ticker import Ticker

CLEARING_LOOK_S = 0.1
"""How often to look whether a lift that the manager waits for can still be read."""

SUM_UP_EVERY_S = 10.0
"""How often to check for counts that were not written down for a minute."""


class SiteLife:
    """The lifts of a site, from the first poll to the last release."""

    def __init__(self, site: Site, actors: Iterable[LiftActor]) -> None:
        """The lifts share one ticker."""
        ticker = Ticker()
        self._site = site
        self._actors = tuple(actors)
        self._polls = {
            actor.config.name: LiftPoll(actor, ticker, first_poll_s=actor.config.poll_s * number / len(self._actors))
            for number, actor in enumerate(self._actors)
        }

    async def run(self) -> None:
        """Poll every lift, and process rides, until cancelled."""
        bug: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        for actor in self._actors:
            actor.inbox.report_bugs(bug)
            actor.begin()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(_raised(bug))
            for poll in self._polls.values():
                tasks.create_task(poll.run())
            tasks.create_task(self._site.rides.run())
            tasks.create_task(self._sum_up())

    def drives(self) -> list[Coroutine[None, None, None]]:
        """Return what carries out each lift's presses and releases, to be run for as long as anything may be held."""
        return [actor.driver.run() for actor in self._actors]

    async def first_look(self) -> None:
        """Return once every lift has been read for the first time; bound it with a timeout."""
        for poll in self._polls.values():
            await poll.looked.wait()

    def polls(self) -> Mapping[str, int]:
        """Return how many polls of each lift have ended, well or not."""
        return {name: poll.polls for name, poll in self._polls.items()}

    async def clear_doors(self, clear_s: float = CLEAR_AT_STOP_S, hurry: asyncio.Event | None = None) -> bool:
        """Refuse everything from now on and withdraw OPEN; return once no robot needs a held door, and whether one did.

        `stop` comes next. This waits for `clear_s` at most, and not once `hurry` is set.
        """
        self._site.begin_stopping()
        for actor in self._actors:
            actor.handle(AnnounceStop(clear_s))
        waited, hurry = False, hurry or asyncio.Event()
        while any(is_clearing(actor) for actor in self._actors) and not hurry.is_set():
            waited = True
            with suppress(TimeoutError):
                async with asyncio.timeout(CLEARING_LOOK_S):
                    await hurry.wait()
        return waited

    async def stop(self) -> None:
        """Release everything on every lift and return once that is verified; bound it with a timeout."""
        self._site.begin_stopping()
        try:
            async with asyncio.TaskGroup() as tasks:
                for actor in self._actors:
                    tasks.create_task(release(actor))
        finally:
            self._site.refusals.report(end=True)

    async def _sum_up(self) -> None:
        """Write the rows of what was counted, even if no more requests come."""
        while True:
            await asyncio.sleep(SUM_UP_EVERY_S)
            self._site.refusals.report()
            for actor in self._actors:
                actor.journal.report(asyncio.get_running_loop().time())


async def _raised(bug: asyncio.Future[None]) -> None:
    await bug


def is_clearing(actor: LiftActor) -> bool:
    """Whether a door whose release was announced is still held for a robot in it."""
    moment = actor.moment
    observation = fresh(actor.config, actor.record, moment)
    return doors.is_clearing(actor.config, actor.record, observation, moment.now)


async def release(actor: LiftActor) -> None:
    """Refuse everything from now on, release everything, and return once that is verified; bound it with a timeout."""
    actor.handle(Stop())
    actor.outputs.cancel_all()
    try:
        await actor.driver.released()
    finally:
        actor.journal.report(asyncio.get_running_loop().time(), end=True)
