"""Polls one lift at its pace. A poll that fails affects no other lift."""

from __future__ import annotations

import asyncio

from drivers.errors import DriverError
from drivers.flag import Flag
from drivers.model import LiftReading
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
    """Polls one lift.

    A poll that repeats the one before is begun by the ticker and ended by its answer, and wakes no task; any other is finished
    in the task of `run`.
    """

    # every poll touches it: see benchmarks/README.md
    __slots__ = (
        "_actor",
        "_began",
        "_driver",
        "_due",
        "_first_poll_s",
        "_loop",
        "_needed",
        "_pause",
        "_reading",
        "_sleeps",
        "_slowest_s",
        "_ticker",
        "looked",
        "polls",
    )

    def __init__(self, actor: LiftActor, ticker: Ticker | None = None, *, first_poll_s: float = 0.0) -> None:
        """The lifts of a site share a ticker. `first_poll_s` delays the first poll, so that they do not poll in one burst."""
        self.polls = 0
        """Polls that have ended, well or not: it rises for as long as our own loop advances."""
        self.looked = Flag()
        """The lift has been read."""
        self._actor = actor
        self._driver = actor.driver
        self._pause = actor.pause
        self._first_poll_s = first_poll_s
        self._ticker = ticker or Ticker()
        self._due = self._began = 0.0
        """When the newest poll was due, and when it began."""
        self._slowest_s = 0.0
        """The slowest recent poll, decaying; the wait for other lifts on its line, and for our own loop, counts too."""
        self._loop: asyncio.AbstractEventLoop
        self._needed: asyncio.Future[None]
        """Wakes the task of `run`."""
        self._sleeps = False
        """Whether that task waits to be woken; not while it is at work, nor once it has ended."""
        self._reading: LiftReading | None = None
        """The result of the poll for which the task was woken, if it is known."""

    async def run(self) -> None:
        """Continue with the session from before this start, and poll the lift until cancelled."""
        self._actor.begin()
        self._loop = asyncio.get_running_loop()
        await asyncio.sleep(self._first_poll_s)
        self._due = self._began = self._loop.time()
        try:
            while True:
                is_answered = await self._poll()
                self._needed, self._sleeps = self._loop.create_future(), True
                self._end_poll(self._loop.time(), is_answered=is_answered)
                await self._needed
        finally:
            self._sleeps = False

    async def _poll(self) -> bool:
        """Make a poll, or finish the one that was begun. Returns whether it was answered."""
        reading, self._reading = self._reading, None
        try:
            if reading is None:
                reading = await self._driver.read()
        except DriverError as error:
            self._actor.take_failure(error)
            return False
        self._actor.take_reading(reading, self._loop.time())
        self.looked.set()
        return True

    def _begin_poll(self) -> None:
        """Begin the poll that is due."""
        if not self._sleeps:
            return
        self._due, self._began = self._pause.until, self._loop.time()
        try:
            if not self._driver.begin_read(self._on_answer):
                self._wake()
        except Exception as bug:  # noqa: BLE001 - raised by the task, as any other bug of this lift
            self._wake(bug)

    def _on_answer(self, reading: LiftReading | None) -> None:
        """Take the result of a poll that was begun, and continue in the task if it needs more than that."""
        if not self._sleeps:
            return
        now = self._loop.time()
        try:
            if reading is not None and self._actor.take_repetition(reading, now):
                self._end_poll(now, is_answered=True)
                return
        except Exception as bug:  # noqa: BLE001 - as above
            self._wake(bug)
            return
        self._reading = reading
        self._wake()

    def _wake(self, bug: Exception | None = None) -> None:
        """Continue in the task, which raises this bug."""
        self._sleeps = False
        if self._needed.done():
            return  # the task is being cancelled
        if bug is None:
            self._needed.set_result(None)
        else:
            self._needed.set_exception(bug)

    def _end_poll(self, ended: float, *, is_answered: bool) -> None:
        """Count a poll that has ended, and have the next one begun when it is due."""
        self.polls += 1
        self._slowest_s = max(ended - self._began, self._slowest_s * FORGETS)
        due = self._next_due(self._due, ended, is_answered=is_answered)
        self._pause.last_until(due, self._ticker, self._begin_poll)

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
