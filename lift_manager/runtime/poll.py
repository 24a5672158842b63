"""Polls one lift at its pace. A poll that fails affects no other lift."""

from __future__ import annotations

import asyncio
import math

from drivers.errors import DriverError
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.ticker import Ticker


class LiftPoll:
    """The poll loop of one lift."""

    def __init__(self, actor: LiftActor, ticker: Ticker | None = None, *, first_poll_s: float = 0.0) -> None:
        """The lifts of a site share a ticker. `first_poll_s` delays the first poll, so that they do not poll in one burst."""
        self.polls = 0
        """Polls that have ended, well or not: it rises for as long as our own loop advances."""
        self.looked = asyncio.Event()
        """The lift has been read."""
        self._actor = actor
        self._first_poll_s = first_poll_s
        self._ticker = ticker or Ticker()

    async def run(self) -> None:
        """Go on with the session of before this start, and poll the lift until cancelled."""
        self._actor.begin()
        loop, actor, poll_s = asyncio.get_running_loop(), self._actor, self._actor.config.poll_s
        await asyncio.sleep(self._first_poll_s)
        due = loop.time()
        while True:
            try:
                reading = await actor.driver.read()
            except DriverError as error:
                actor.take_failure(error)
            else:
                actor.take_reading(reading)
                self.looked.set()
            self.polls += 1
            due += poll_s
            late = loop.time() - due
            if late > 0:
                # an overloaded poller skips polls; queued ones would only bring older and older news
                due += math.ceil(late / poll_s) * poll_s
            await self._ticker.sleep_until(due)
