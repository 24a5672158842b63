"""All lifts, or one, as they are now."""

from __future__ import annotations

import asyncio
import logging
from typing import Protocol, Self

from lift_manager.api.events import SessionEvent, Snapshot, StateEvent
from lift_manager.api.lifts import Lift
from lift_manager.client.errors import ClientError, NotFound, Refused
from lift_manager.client.lift_cache import KnownLift, same_but_for_time
from lift_manager.client.stream import Connected, EventStream
from lift_manager.plain.aging import DEFAULT_MAX_AGE_S, SILENT_S, ask_again_s

_log = logging.getLogger(__name__)

BETWEEN_S = 0.02
"""Chosen: no more questions than fifty a second, however many events there are."""


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
            await self._until_due(asked_at + ask_again_s(self._good_for_s))

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
