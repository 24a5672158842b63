"""All lifts, or one, as they are now: the newest answer about each, its age, and what one may wait for."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self

from lift_manager.api.events import SessionEvent, Snapshot, StateEvent
from lift_manager.api.lifts import Lift
from lift_manager.client.errors import ClientError, NotFound, Refused
from lift_manager.client.stream import Connected, EventStream
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import Quality
from lift_manager.plain.client_aging import DEFAULT_MAX_AGE_S, SILENT_S, age_s, is_too_old, refresh_pause_s
from lift_manager.plain.text import without_seconds

_log = logging.getLogger(__name__)

MIN_INTERVAL_S = 0.02
"""Chosen: at most fifty requests a second, however many events arrive."""


Condition = Callable[[Lift], bool]


def open_at(floor: str) -> Condition:
    """Return the condition that the lift stands at a floor with its door open for the robot."""

    def is_met(lift: Lift) -> bool:
        at_floor = lift.quality is Quality.LIVE and lift.standing and lift.floor == floor
        return at_floor and lift.robot_door is RobotDoor.OPEN

    return is_met


@dataclass(frozen=True)
class KnownLift:
    """The latest reply about a lift."""

    lift: Lift
    requested_at: float
    """When its request was sent, in monotonic seconds."""
    etag: str = ""

    def at(self, now: float) -> Lift:
        """Return the lift as valid now: with its age, and offline once it is too old."""
        age = age_s(self.lift.age_s, self.requested_at, now)
        if self.lift.quality is Quality.OFFLINE or self.is_current_at(now):
            releases_in_s = _count_down(self.lift.releases_in_s, now - self.requested_at)
            return self.lift.model_copy(update={"age_s": age, "releases_in_s": releases_in_s})
        silent_s = now - self.requested_at
        return self.lift.unread(age, f"the manager has not replied for {silent_s:.1f} s")

    def is_current_at(self, now: float) -> bool:
        """Whether the reply is recent enough, including a reply that the lift is offline."""
        reported_age_s = 0.0 if self.lift.quality is Quality.OFFLINE else self.lift.age_s
        return not is_too_old(age_s(reported_age_s, self.requested_at, now), self.lift.max_age_s)

    def unchanged(self, reported_age_s: float | None, requested_at: float) -> KnownLift:
        """Return the lift after a reply that only its age has changed."""
        session = self.lift.session
        if session is not None:
            session = session.model_copy(update={"for_s": session.for_s + requested_at - self.requested_at})
        releases_in_s = _count_down(self.lift.releases_in_s, requested_at - self.requested_at)
        lift = self.lift.model_copy(
            update={"age_s": reported_age_s, "session": session, "releases_in_s": releases_in_s}
        )
        return KnownLift(lift, requested_at, self.etag)


def _count_down(seconds: float | None, by_s: float) -> float | None:
    """Return a countdown after `by_s` more seconds."""
    return None if seconds is None else max(0.0, seconds - by_s)


def equal_except_time(one: Lift, other: Lift) -> bool:
    """Whether two states differ only in ages and countdowns."""
    return _without_time(one) == _without_time(other)


def _without_time(lift: Lift) -> Lift:
    """Return a lift without its ages, its countdowns and the seconds in its reason."""
    session = None if lift.session is None else lift.session.model_copy(update={"for_s": 0.0})
    cleared: dict[str, object] = {"age_s": None, "releases_in_s": None}
    return lift.model_copy(update={**cleared, "session": session, "reason": without_seconds(lift.reason)})


class StatesClient(Protocol):
    """The part of the client that States needs."""

    async def known_lifts(self, lift: str | None, *, within_s: float) -> tuple[KnownLift, ...]:
        """Get one lift, or all of them; sent once."""
        ...

    def events(self, lift: str | None = None, ride: str | None = None) -> EventStream:
        """Open an event stream."""
        ...


class States:
    """The current states: `states["main"]` is one lift; `async for lift in states` yields each change, including going offline.

    A lift is offline here as soon as its state is older than its `max_age_s`, counted from when the request for it was sent. The
    event stream triggers requests.
    """

    def __init__(self, manager: StatesClient, lift: str | None) -> None:
        self._manager = manager
        self._lift = lift
        self._known: dict[str, KnownLift] = {}
        self._yielded: dict[str, Lift] = {}
        self._poll_due = asyncio.Event()
        self._changed = asyncio.Event()
        self._failed: Refused | None = None

    @property
    def lifts(self) -> tuple[Lift, ...]:
        """Every lift, in the order of the site; empty until the first reply."""
        now = asyncio.get_running_loop().time()
        return tuple(known.at(now) for known in self._known.values())

    def __getitem__(self, name: str) -> Lift:
        """Raises KeyError for an unknown lift."""
        return self._known[name].at(asyncio.get_running_loop().time())

    def is_current(self, name: str) -> bool:
        """Whether the state is from the manager; otherwise the lift is offline because the manager is silent. Raises KeyError."""
        return self._known[name].is_current_at(asyncio.get_running_loop().time())

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Lift:
        """Return the next lift that changed in more than its age. Raises Refused if the manager refuses."""
        while True:
            for lift in self.lifts:
                yielded = self._yielded.get(lift.name)
                if yielded is None or not equal_except_time(lift, yielded):
                    self._yielded[lift.name] = lift
                    return lift
            await self.changed()

    async def changed(self) -> None:
        """Wait for the next reply, or until a lift becomes too old. Raises Refused if the manager refuses."""
        if self._failed is not None:
            raise self._failed
        try:
            async with asyncio.timeout(self._next_too_old_s()):
                await self._changed.wait()
        except TimeoutError:
            return
        self._changed.clear()

    async def follow(self) -> None:
        """Poll the lifts until cancelled."""
        while True:
            requested_at = asyncio.get_running_loop().time()
            try:
                answers = await self._manager.known_lifts(self._lift, within_s=self._valid_for_s)
            except NotFound as error:
                self._failed = error
            except Refused as error:
                # such as a revoked key: it may be replaced meanwhile
                self._failed = None if self._known else error
            except ClientError as error:
                _log.debug("no state of the lifts: %s", error)
            else:
                self._failed = None
                self._known = {known.lift.name: known for known in answers}
            self._changed.set()
            self._poll_due.clear()
            await asyncio.sleep(MIN_INTERVAL_S)
            await self._wait_until(requested_at + refresh_pause_s(self._valid_for_s))

    async def listen(self) -> None:
        """Trigger a request for each relevant event of the event stream."""
        try:
            async with self._manager.events(lift=self._lift) as events:
                async for event in events:
                    if isinstance(event, StateEvent | SessionEvent | Snapshot | Connected):
                        self._poll_due.set()
        except Refused as error:
            _log.warning("no event stream (%s); the lifts are polled", error)

    @property
    def _valid_for_s(self) -> float:
        return min((known.lift.max_age_s for known in self._known.values()), default=DEFAULT_MAX_AGE_S)

    async def _wait_until(self, due_at: float) -> None:
        try:
            async with asyncio.timeout_at(due_at):
                await self._poll_due.wait()
        except TimeoutError:
            return

    def _next_too_old_s(self) -> float:
        now = asyncio.get_running_loop().time()
        ends = [
            known.requested_at + known.lift.max_age_s - (known.lift.age_s or 0.0) - now
            for known in self._known.values()
        ]
        # a lift that is too old already was reported as such
        return min((valid_s + 0.001 for valid_s in ends if valid_s >= 0), default=SILENT_S)
