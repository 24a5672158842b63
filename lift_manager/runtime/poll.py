"""Polls one lift at its pace. A poll that fails affects no other lift."""

from __future__ import annotations

import asyncio

from drivers.errors import DriverError
from drivers.flag import Flag
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.ticker import Ticker

QUICK = 0.25
"""Share of `poll_ridden_s` that the slowest recent poll may take for a lift to be polled at that pace: beyond it, more polls would fill the
line that commands have to take too."""
FORGETS = 0.97
"""Decay of the slowest poll with each poll. Chosen: one slow poll in a hundred does not decide, and after one that takes twice as long as
it may the pace is back within 24 polls."""

RESPITE_S = 0.2
"""At most so long after a poll that failed the next one follows. Chosen: a controller that pauses for 0.9 s keeps its connection, which is
given up after two time-outs of 0.25 and 0.5 s, and one lost answer takes no lift offline whose `max_age_s` is twice its `poll_s`."""


class LiftPoll:
    """The poll loop of one lift."""

    def __init__(self, actor: LiftActor, ticker: Ticker | None = None, *, first_poll_s: float = 0.0) -> None:
        """The lifts of a site share a ticker. `first_poll_s` delays the first poll, so that they do not poll in one burst."""
        self.polls = 0
        """Polls that have ended, well or not: it rises for as long as our own loop advances."""
        self.looked = Flag()
        """The lift has been read."""
        self._actor = actor
        self._first_poll_s = first_poll_s
        self._ticker = ticker or Ticker()
        self._slowest_s = 0.0
        """The slowest recent poll, decaying; the wait for other lifts on its line, and for our own loop, counts too."""

    async def run(self) -> None:
        """Continue with the session from before this start, and poll the lift until cancelled."""
        self._actor.begin()
        loop, actor, pause = asyncio.get_running_loop(), self._actor, self._actor.pause
        await asyncio.sleep(self._first_poll_s)
        due = loop.time()
        while True:
            began = loop.time()
            try:
                reading = await actor.driver.read()
            except DriverError as error:
                actor.take_failure(error)
                is_answered = False
            else:
                actor.take_reading(reading, loop.time())
                self.looked.set()
                is_answered = True
            self.polls += 1
            ended = loop.time()
            self._slowest_s = max(ended - began, self._slowest_s * FORGETS)
            await pause.last_until(self._next_due(due, ended, is_answered=is_answered), self._ticker)
            due = pause.until

    def _next_due(self, due: float, ended: float, *, is_answered: bool) -> float:
        """Return when the next poll is due, after one that was due at `due`."""
        config, pace_s = self._actor.config, self._pace_s()
        if is_answered:
            # one that took too long is followed by the next at once; those that it delayed are not made up for
            return max(due + pace_s, ended)
        # a controller that pauses may still answer: asked again at once, it would soon be taken for dead
        return max(due + min(config.poll_s, config.poll_ridden_s), ended + min(pace_s, RESPITE_S))

    def _pace_s(self) -> float:
        """Return the time from one poll to the next."""
        config = self._actor.config
        if self._actor.record.session is None or self._slowest_s > QUICK * config.poll_ridden_s:
            return config.poll_s
        return min(config.poll_s, config.poll_ridden_s)
