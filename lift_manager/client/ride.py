"""A ride for the program of a robot: current guidance, and the reports of the robot."""

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
from lift_manager.client.ride_step import INVITATIONS, KnownRide, Step, is_unacknowledged, step_at, valid_for_s
from lift_manager.client.stream import Connected, Disconnected, EventStream
from lift_manager.plain.client_aging import DEFAULT_MAX_AGE_S, SILENT_S, refresh_pause_s
from lift_manager.rides.ride import OVER, RideWord

_log = logging.getLogger(__name__)

POLL_EVERY_S = 1.0
"""Chosen: the pause while the robot has no invitation; the event stream announces changes at once."""
MIN_INTERVAL_S = 0.05
"""Chosen: at most twenty requests a second, however many events arrive."""


class RideClient(Protocol):
    """The part of the client that a ride needs."""

    async def get_ride(self, ride: str, *, within_s: float | None = None) -> Ride:
        """Get a ride; sent once."""
        ...

    async def ride_word(self, ride: str, word: RideWord, *, within_s: float | None = None) -> Ride:
        """Report for the robot; sent once."""
        ...

    async def cancel_ride(self, ride: str, reason: str = "cancelled") -> Ride:
        """End a ride safely."""
        ...

    async def lift(self, name: str) -> Lift:
        """Get the state of a lift."""
        ...

    def events(self, lift: str | None = None, ride: str | None = None) -> EventStream:
        """Open an event stream."""
        ...


class ActiveRide:
    """An active ride. `async for step in ride` yields what the robot has to do, whenever that changes, and ends with the ride.

    An invitation to drive comes only from the reply to a request that was sent less than the lift's `max_age_s` ago. The event
    stream only triggers requests, so nothing that was delayed on its way can say `enter`. `now` is the current step; a robot that
    drives through the door checks it.
    """

    def __init__(self, manager: RideClient, ride: Ride, requested_at: float) -> None:
        self._manager = manager
        self._known = KnownRide(ride, requested_at)
        self._last_request_at = requested_at
        self._max_age_s = DEFAULT_MAX_AGE_S
        self._max_age_lift = ""
        self._reported: RideWord | None = None
        self._is_reporting = False
        self._trouble = ""
        self._must_announce = False
        self._poll_due = asyncio.Event()
        self._changed = asyncio.Event()
        self._yielded: Step | None = None

    @property
    def id(self) -> str:
        """The id of the ride."""
        return self._known.ride.id

    @property
    def now(self) -> Step:
        """What the robot may act on at this moment."""
        return step_at(self._known, self._reported, self._max_age_s, self._time(), self._trouble)

    @property
    def over(self) -> bool:
        """Whether the ride is over."""
        return self.now.over

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Step:
        """Return the next step: the current one, if it was not returned yet."""
        if self._yielded is not None and self._yielded.over:
            raise StopAsyncIteration
        while not _is_different(step := self.now, self._yielded):
            await self._wait_for_change()
        self._yielded = step
        return step

    async def entered(self) -> Step:
        """Report that the robot is inside, repeated until the manager has recorded it. Raises Refused if it is not possible now."""
        return await self._report(RideWord.ENTERED)

    async def left(self) -> Step:
        """Report that the robot is outside and clear of the door, repeated until the manager has recorded it. Raises Refused."""
        return await self._report(RideWord.LEFT)

    async def cancel(self, reason: str = "cancelled") -> Step:
        """End the ride safely: a robot that may be inside is let out first, so keep following the steps. Raises ClientError."""
        requested_at = self._next_request_time()
        self._update(await self._manager.cancel_ride(self.id, reason), requested_at)
        return self.now

    async def follow(self) -> None:
        """Poll the ride until it is over."""
        await self._learn_max_age(self._known.ride.lift)
        while not self.over:
            await self._poll()
            await self._repeat_report()
            self._poll_due.clear()
            pause_s = refresh_pause_s(self._max_age_s) if self._invited or self._must_announce else POLL_EVERY_S
            await asyncio.sleep(MIN_INTERVAL_S)
            await _wait_at_most(self._poll_due.wait, pause_s - MIN_INTERVAL_S)

    async def listen(self) -> None:
        """Trigger a request for each relevant event of the event stream."""
        connected = False
        try:
            async with self._manager.events(ride=self.id) as events:
                async for event in events:
                    if isinstance(event, Connected | Disconnected):
                        # a manager that stops may have received the first announcement, but the one that replaces it has not
                        self._must_announce = self._must_announce or connected
                        connected = True
                    elif not isinstance(event, RideEvent):
                        continue
                    self._poll_due.set()
        except Refused as error:
            _log.warning("ride %s: no event stream (%s); polling every %g s", self.id, error, POLL_EVERY_S)

    @property
    def _invited(self) -> bool:
        return self._known.ride.guidance in INVITATIONS

    async def _poll(self) -> None:
        """Get the ride; after a silence announce the robot first, because the manager may have restarted."""
        requested_at = self._next_request_time()
        # a reply that arrives after its validity is useless
        limit_s = valid_for_s(self._known.ride, self._max_age_s)
        try:
            if self._must_announce:
                ride = await self._announce(limit_s)
                self._must_announce = False
            else:
                ride = await self._manager.get_ride(self.id, within_s=limit_s)
        except NotFound as error:
            self._known = KnownRide(self._known.ride, requested_at, unknown_reason=str(error))
            self._changed.set()
            return
        except ClientError as error:
            self._note_silence(error)
            return
        self._update(ride, requested_at)
        await self._learn_max_age(ride.lift)

    async def _repeat_report(self) -> None:
        """Repeat a report that the manager accepted and lost: it stopped before the report was recorded."""
        word = self._reported
        if word is None or self._is_reporting or self._must_announce or not is_unacknowledged(self._known.ride, word):
            return
        requested_at = self._next_request_time()
        try:
            self._update(await self._manager.ride_word(self.id, word, within_s=SILENT_S), requested_at)
        except Refused as error:
            _log.debug("ride %s: %s is not accepted yet: %s", self.id, word, error)
        except ClientError as error:
            self._note_silence(error)

    async def _announce(self, limit_s: float) -> Ride:
        try:
            return await self._manager.ride_word(self.id, RideWord.HERE, within_s=limit_s)
        except NotFound:
            raise
        except Refused:
            # the ride is over, or at another point: the manager has replied anyway
            return await self._manager.get_ride(self.id, within_s=limit_s)

    async def _learn_max_age(self, lift: str) -> None:
        if lift == self._max_age_lift:
            return
        try:
            self._max_age_s = min((await self._manager.lift(lift)).max_age_s, SILENT_S)
            self._max_age_lift = lift
        except ClientError as error:
            _log.debug("ride %s: max_age_s of %s is not known yet: %s", self.id, lift, error)

    async def _report(self, word: RideWord) -> Step:
        before, self._reported = self._reported, word
        self._is_reporting = True
        self._changed.set()
        try:
            return await self._report_until_recorded(word)
        except Refused:
            self._reported = before
            raise
        finally:
            self._is_reporting = False

    async def _report_until_recorded(self, word: RideWord) -> Step:
        while True:
            requested_at = self._next_request_time()
            try:
                ride = await self._manager.ride_word(self.id, word, within_s=SILENT_S)
            except Refused:
                # an earlier attempt may have been accepted, and its reply lost
                await self._poll()
                if self._known.unknown_reason or is_unacknowledged(self._known.ride, word):
                    raise
                return self.now
            except ClientError as error:
                self._note_silence(error)
            else:
                self._update(ride, requested_at)
                if ride.recorded:
                    return self.now
                # a crash could still lose it, and after a ride nobody would repeat it
            await asyncio.sleep(POLL_EVERY_S)

    def _note_silence(self, error: ClientError) -> None:
        self._trouble = error.text if isinstance(error, Unreachable) else str(error)
        self._must_announce = True
        self._changed.set()

    def _update(self, ride: Ride, requested_at: float) -> None:
        # replies may overtake each other: the request that was sent last has the newest one
        if requested_at >= self._known.requested_at and not self._known.unknown_reason:
            self._known = KnownRide(ride, requested_at)
            self._trouble = ""
            self._changed.set()

    async def _wait_for_change(self) -> None:
        known = self._known
        good_until = known.requested_at + valid_for_s(known.ride, self._max_age_s)
        valid_s = good_until - self._time()
        is_silent = valid_s < 0 or known.ride.phase in OVER
        if not is_silent:
            await _wait_at_most(self._changed.wait, valid_s + 0.001)
        else:
            await self._changed.wait()
        self._changed.clear()

    def _next_request_time(self) -> float:
        """Return the time of the request that is sent next: later than any before it, because some clocks tick in milliseconds."""
        self._last_request_at = max(self._time(), nextafter(self._last_request_at, inf))
        return self._last_request_at

    def _time(self) -> float:
        return asyncio.get_running_loop().time()


async def _wait_at_most(wait: Callable[[], Awaitable[object]], limit_s: float) -> None:
    try:
        async with asyncio.timeout(max(0.0, limit_s)):
            await wait()
    except TimeoutError:
        return


def _is_different(step: Step, before: Step | None) -> bool:
    """Whether a step differs in more than the running time of a silence."""
    if before is None:
        return True
    if step.is_current != before.is_current or step.guidance != before.guidance:
        return True
    old, new = before.ride, step.ride
    has_changed = (new.phase, new.lift, new.ahead, new.maybe_aboard) != (
        old.phase,
        old.lift,
        old.ahead,
        old.maybe_aboard,
    )
    return has_changed or (step.is_current and (step.reason, step.advice) != (before.reason, before.advice))
