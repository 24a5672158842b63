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
from lift_manager.plain.aging import DEFAULT_MAX_AGE_S, SILENT_S, age_s, is_too_old, refresh_pause_s
from lift_manager.plain.text import without_seconds

_log = logging.getLogger(__name__)

BETWEEN_S = 0.02
"""Chosen: no more questions than fifty a second, however many events there are."""


Condition = Callable[[Lift], bool]


def open_at(floor: str) -> Condition:
    """Return the condition that the lift stands at a floor with its door open for the robot."""

    def met(lift: Lift) -> bool:
        at_floor = lift.quality is Quality.LIVE and lift.standing and lift.floor == floor
        return at_floor and lift.robot_door is RobotDoor.OPEN

    return met


@dataclass(frozen=True)
class KnownLift:
    """The newest answer about a lift."""

    lift: Lift
    asked_at: float
    """When its question left, in monotonic seconds."""
    etag: str = ""

    def at(self, now: float) -> Lift:
        """Return it as it is to be taken now: with its age, and offline by itself once it is too old."""
        age = age_s(self.lift.age_s, self.asked_at, now)
        if self.lift.quality is Quality.OFFLINE or self.heard_at(now):
            releases_in_s = _after(self.lift.releases_in_s, now - self.asked_at)
            return self.lift.model_copy(update={"age_s": age, "releases_in_s": releases_in_s})
        silent_s = now - self.asked_at
        return self.lift.unread(age, f"the manager has not been heard for {silent_s:.1f} s")

    def heard_at(self, now: float) -> bool:
        """Whether it is still what the manager says, be it that the lift is offline."""
        told_s = 0.0 if self.lift.quality is Quality.OFFLINE else self.lift.age_s
        return not is_too_old(age_s(told_s, self.asked_at, now), self.lift.max_age_s)

    def same(self, told_s: float | None, asked_at: float) -> KnownLift:
        """Return it after the manager said that nothing but the age has changed."""
        held = self.lift.session
        if held is not None:
            held = held.model_copy(update={"for_s": held.for_s + asked_at - self.asked_at})
        releases_in_s = _after(self.lift.releases_in_s, asked_at - self.asked_at)
        lift = self.lift.model_copy(update={"age_s": told_s, "session": held, "releases_in_s": releases_in_s})
        return KnownLift(lift, asked_at, self.etag)


def _after(seconds: float | None, by_s: float) -> float | None:
    """Return what is left of a countdown."""
    return None if seconds is None else max(0.0, seconds - by_s)


def same_but_for_time(one: Lift, other: Lift) -> bool:
    """Whether two differ in nothing but what passes by itself."""
    return _timeless(one) == _timeless(other)


def _timeless(lift: Lift) -> Lift:
    """Return a lift without its age, for how long it is held, and the seconds in its reason; the reason itself stays."""
    held = None if lift.session is None else lift.session.model_copy(update={"for_s": 0.0})
    timeless: dict[str, object] = {"age_s": None, "releases_in_s": None}
    return lift.model_copy(update={**timeless, "session": held, "reason": without_seconds(lift.reason)})


class Manager(Protocol):
    """What of the client the states need."""

    async def known_lifts(self, lift: str | None, *, within_s: float) -> tuple[KnownLift, ...]:
        """Ask for one lift, or for all of them, once."""
        ...

    def events(self, lift: str | None = None, ride: str | None = None) -> EventStream:
        """Listen."""
        ...


class States:
    """`states["main"]` is a lift as it may be taken now; `async for lift in states` yields each that changed, going offline included.

    A lift is offline here as soon as what is known of it is older than its `max_age_s`, counted from when the question
    for it left. The event stream says when to ask.
    """

    def __init__(self, manager: Manager, lift: str | None) -> None:
        self._manager = manager
        self._lift = lift
        self._known: dict[str, KnownLift] = {}
        self._shown: dict[str, Lift] = {}
        self._ask = asyncio.Event()
        self._news = asyncio.Event()
        self._failed: Refused | None = None

    @property
    def lifts(self) -> tuple[Lift, ...]:
        """Every lift, in the site's order; empty until the manager was heard for the first time."""
        now = asyncio.get_running_loop().time()
        return tuple(known.at(now) for known in self._known.values())

    def __getitem__(self, name: str) -> Lift:
        """Raises KeyError for a lift that was never heard of."""
        return self._known[name].at(asyncio.get_running_loop().time())

    def heard(self, name: str) -> bool:
        """Whether a lift is as the manager says; otherwise it is offline because the manager is silent. Raises KeyError."""
        return self._known[name].heard_at(asyncio.get_running_loop().time())

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Lift:
        """Return the next lift that changed in more than its age. Raises Refused where the manager will not tell."""
        while True:
            for lift in self.lifts:
                shown = self._shown.get(lift.name)
                if shown is None or not same_but_for_time(lift, shown):
                    self._shown[lift.name] = lift
                    return lift
            await self.changed()

    async def changed(self) -> None:
        """Wait until something was heard, or the next lift is too old. Raises Refused where the manager will not tell."""
        if self._failed is not None:
            raise self._failed
        try:
            async with asyncio.timeout(self._next_too_old_s()):
                await self._news.wait()
        except TimeoutError:
            return
        self._news.clear()

    async def follow(self) -> None:
        """Keep what is known fresh."""
        while True:
            asked_at = asyncio.get_running_loop().time()
            try:
                heard = await self._manager.known_lifts(self._lift, within_s=self._good_for_s)
            except NotFound as error:
                self._failed = error
            except Refused as error:
                # such as a key that was revoked: it may be mended while this waits
                self._failed = None if self._known else error
            except ClientError as error:
                _log.debug("nothing is heard of the lifts: %s", error)
            else:
                self._failed = None
                self._known = {known.lift.name: known for known in heard}
            self._news.set()
            self._ask.clear()
            await asyncio.sleep(BETWEEN_S)
            await self._until_due(asked_at + refresh_pause_s(self._good_for_s))

    async def listen(self) -> None:
        """Ask whenever the event stream says that something happened."""
        try:
            async with self._manager.events(lift=self._lift) as events:
                async for event in events:
                    if isinstance(event, StateEvent | SessionEvent | Snapshot | Connected):
                        self._ask.set()
        except Refused as error:
            _log.warning("no event stream (%s); the lifts are asked for by the clock", error)

    @property
    def _good_for_s(self) -> float:
        return min((known.lift.max_age_s for known in self._known.values()), default=DEFAULT_MAX_AGE_S)

    async def _until_due(self, due_at: float) -> None:
        try:
            async with asyncio.timeout_at(due_at):
                await self._ask.wait()
        except TimeoutError:
            return

    def _next_too_old_s(self) -> float:
        now = asyncio.get_running_loop().time()
        ends = [
            known.asked_at + known.lift.max_age_s - (known.lift.age_s or 0.0) - now for known in self._known.values()
        ]
        # one that is too old already is shown as that
        return min((left_s + 0.001 for left_s in ends if left_s >= 0), default=SILENT_S)
