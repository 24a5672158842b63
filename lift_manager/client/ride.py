"""A ride in a robot's hand: what to do now, and the words that the robot says."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from math import inf, nextafter
from typing import Protocol, Self

from lift_manager.api.events import RideEvent
from lift_manager.api.lifts import Lift
from lift_manager.api.rides import Ride
from lift_manager.client.errors import ClientError, NotFound, Refused, Unreachable
from lift_manager.client.ride_step import INVITATIONS, KnownRide, Step, good_for_s, is_owed, step_at
from lift_manager.client.stream import Connected, Disconnected, EventStream
from lift_manager.plain.aging import DEFAULT_MAX_AGE_S, SILENT_S, refresh_pause_s
from lift_manager.rides.ride import OVER, RideWord

_log = logging.getLogger(__name__)

LOOK_EVERY_S = 1.0
"""Chosen: while nothing invites the robot; changes are told by the event stream at once."""
BETWEEN_S = 0.05
"""Chosen: no more questions than twenty a second, however many events there are."""


class Manager(Protocol):
    """What of the client a ride needs."""

    async def get_ride(self, ride: str, *, within_s: float | None = None) -> Ride:
        """Ask for it, once."""
        ...

    async def ride_word(self, ride: str, word: RideWord, *, within_s: float | None = None) -> Ride:
        """Say a word of the robot, once."""
        ...

    async def cancel_ride(self, ride: str, reason: str = "cancelled") -> Ride:
        """End it safely."""
        ...

    async def lift(self, name: str) -> Lift:
        """Ask for the state of a lift."""
        ...

    def events(self, lift: str | None = None, ride: str | None = None) -> EventStream:
        """Listen."""
        ...


class ActiveRide:
    """A ride that goes on. `async for step in ride` yields what the robot is to do, whenever that changes, and ends with the ride.

    An invitation to drive comes only out of an answer to a question that left less than the lift's `max_age_s` ago: the event
    stream says when to ask, and nothing that was delayed on its way can say `enter`. `now` is what holds at this moment; a
    robot that drives through the door looks at it.
    """

    def __init__(self, manager: Manager, begun: Ride, asked_at: float) -> None:
        self._manager = manager
        self._known = KnownRide(begun, asked_at)
        self._left_at = asked_at
        self._max_age_s = DEFAULT_MAX_AGE_S
        self._aged_lift = ""
        self._said: RideWord | None = None
        self._saying = False
        self._trouble = ""
        self._greets = False
        self._ask = asyncio.Event()
        self._news = asyncio.Event()
        self._yielded: Step | None = None

    @property
    def id(self) -> str:
        """Of the ride."""
        return self._known.ride.id

    @property
    def now(self) -> Step:
        """What the robot may act on at this moment."""
        return step_at(self._known, self._said, self._max_age_s, self._time(), self._trouble)

    @property
    def over(self) -> bool:
        """Nothing more is done for it."""
        return self.now.over

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Step:
        """Return the next thing to do: what holds now, if that was not said yet."""
        if self._yielded is not None and self._yielded.over:
            raise StopAsyncIteration
        while not _differs(step := self.now, self._yielded):
            await self._until_news()
        self._yielded = step
        return step

    async def entered(self) -> Step:
        """Say that the robot is inside, until the manager has heard it. Raises Refused where it makes no sense."""
        return await self._say(RideWord.ENTERED)

    async def left(self) -> Step:
        """Say that the robot is outside and clear of the door, until the manager has heard it. Raises Refused where it makes no sense."""
        return await self._say(RideWord.LEFT)

    async def cancel(self, reason: str = "cancelled") -> Step:
        """End it safely: a robot that may be inside is let out first, so go on with what is yielded. Raises ClientError."""
        asked_at = self._leaves_at()
        self._learn(await self._manager.cancel_ride(self.id, reason), asked_at)
        return self.now

    async def follow(self) -> None:
        """Keep what is known fresh, until the ride is over."""
        await self._learn_age(self._known.ride.lift)
        while not self.over:
            await self._look()
            await self._remind()
            self._ask.clear()
            pause_s = refresh_pause_s(self._max_age_s) if self._invited or self._greets else LOOK_EVERY_S
            await asyncio.sleep(BETWEEN_S)
            await _within(self._ask.wait, pause_s - BETWEEN_S)

    async def listen(self) -> None:
        """Ask whenever the event stream says that something happened."""
        connected = False
        try:
            async with self._manager.events(ride=self.id) as events:
                async for event in events:
                    if isinstance(event, Connected | Disconnected):
                        # a manager that ends may have heard the first of the two, and the one that follows it has not
                        self._greets = self._greets or connected
                        connected = True
                    elif not isinstance(event, RideEvent):
                        continue
                    self._ask.set()
        except Refused as error:
            _log.warning("ride %s: no event stream (%s); it is looked at every %g s", self.id, error, LOOK_EVERY_S)

    @property
    def _invited(self) -> bool:
        return self._known.ride.guidance in INVITATIONS

    async def _look(self) -> None:
        """Ask how the ride is; after a time of silence say first that the robot is here, for the manager may have been started anew."""
        asked_at = self._leaves_at()
        # an answer that comes later than it is good for is of no use
        limit_s = good_for_s(self._known.ride, self._max_age_s)
        try:
            if self._greets:
                ride = await self._here(limit_s)
                self._greets = False
            else:
                ride = await self._manager.get_ride(self.id, within_s=limit_s)
        except NotFound as error:
            self._known = KnownRide(self._known.ride, asked_at, gone=str(error))
            self._news.set()
            return
        except ClientError as error:
            self._silence(error)
            return
        self._learn(ride, asked_at)
        await self._learn_age(ride.lift)

    async def _remind(self) -> None:
        """Say a word again that the manager took and has forgotten: it ended before that was written down."""
        word = self._said
        if word is None or self._saying or self._greets or not is_owed(self._known.ride, word):
            return
        asked_at = self._leaves_at()
        try:
            self._learn(await self._manager.ride_word(self.id, word, within_s=SILENT_S), asked_at)
        except Refused as error:
            _log.debug("ride %s: %s is not taken yet: %s", self.id, word, error)
        except ClientError as error:
            self._silence(error)

    async def _here(self, limit_s: float) -> Ride:
        try:
            return await self._manager.ride_word(self.id, RideWord.HERE, within_s=limit_s)
        except NotFound:
            raise
        except Refused:
            # over meanwhile, or not a time for it: the manager is heard all the same
            return await self._manager.get_ride(self.id, within_s=limit_s)

    async def _learn_age(self, lift: str) -> None:
        if lift == self._aged_lift:
            return
        try:
            self._max_age_s = min((await self._manager.lift(lift)).max_age_s, SILENT_S)
            self._aged_lift = lift
        except ClientError as error:
            _log.debug("ride %s: how old the state of %s may be is not known yet: %s", self.id, lift, error)

    async def _say(self, word: RideWord) -> Step:
        before, self._said = self._said, word
        self._saying = True
        self._news.set()
        try:
            return await self._until_taken(word)
        except Refused:
            self._said = before
            raise
        finally:
            self._saying = False

    async def _until_taken(self, word: RideWord) -> Step:
        while True:
            asked_at = self._leaves_at()
            try:
                ride = await self._manager.ride_word(self.id, word, within_s=SILENT_S)
            except Refused:
                # it may have been heard before, and the answer lost
                await self._look()
                if self._known.gone or is_owed(self._known.ride, word):
                    raise
                return self.now
            except ClientError as error:
                self._silence(error)
            else:
                self._learn(ride, asked_at)
                return self.now
            await asyncio.sleep(LOOK_EVERY_S)

    def _silence(self, error: ClientError) -> None:
        self._trouble = error.text if isinstance(error, Unreachable) else str(error)
        self._greets = True
        self._news.set()

    def _learn(self, ride: Ride, asked_at: float) -> None:
        # answers may overtake each other: the question that left last has the newest
        if asked_at >= self._known.asked_at and not self._known.gone:
            self._known = KnownRide(ride, asked_at)
            self._trouble = ""
            self._news.set()

    async def _until_news(self) -> None:
        known = self._known
        good_until = known.asked_at + good_for_s(known.ride, self._max_age_s)
        left_s = good_until - self._time()
        silent = left_s < 0 or known.ride.phase in OVER
        if not silent:
            await _within(self._news.wait, left_s + 0.001)
        else:
            await self._news.wait()
        self._news.clear()

    def _leaves_at(self) -> float:
        """Return when a question leaves that is about to: later than any before it, for some clocks tick in milliseconds."""
        self._left_at = max(self._time(), nextafter(self._left_at, inf))
        return self._left_at

    def _time(self) -> float:
        return asyncio.get_running_loop().time()


async def _within(wait: Callable[[], Awaitable[object]], limit_s: float) -> None:
    try:
        async with asyncio.timeout(max(0.0, limit_s)):
            await wait()
    except TimeoutError:
        return


def _differs(step: Step, before: Step | None) -> bool:
    """Whether a robot or its people would want to know. How long nothing was heard changes all the time."""
    if before is None:
        return True
    if step.heard != before.heard or step.guidance != before.guidance:
        return True
    then, new = before.ride, step.ride
    told = (new.phase, new.lift, new.ahead, new.maybe_aboard) != (then.phase, then.lift, then.ahead, then.maybe_aboard)
    return told or (step.heard and (step.reason, step.advice) != (before.reason, before.advice))
