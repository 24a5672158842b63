"""All lifts of one site behind one facade; every face uses this and nothing below it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from lift_manager.core.journal import Journal, ShortJournal
from lift_manager.core.lift import LiftTask
from lift_manager.core.memory import Memory, ShortMemory
from lift_manager.core.rides.engine import RideEngine
from lift_manager.core.rides.site_rides import SiteRides
from lift_manager.core.site_sessions import SiteSessions
from lift_manager.core.waiting import WaitingLine
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.description import LiftDescription, LiftSignals
from lift_manager.domain.events import Alarm, Event, Occurrence, StateChanged
from lift_manager.domain.journal import Row
from lift_manager.domain.ride_record import KeptRide
from lift_manager.domain.rmf import RmfRules
from lift_manager.domain.service import (
    Acknowledged,
    Drain,
    DrainEnded,
    ForceReleased,
    Lockout,
    LockoutEnded,
    Remembered,
)
from lift_manager.domain.state import Holder, LiftState
from lift_manager.runtime.bus import Bus, Subscription
from lift_manager.runtime.recorder import Clock, wall_clock
from lift_manager.runtime.refusals import RefusalLog, TurnedAway

Answer = TypeVar("Answer")

CLEARING_LOOK_S = 0.1
"""How often to look whether a lift that the manager waits for can still be read."""

TELL_EVERY_S = 10.0
"""How often to look for what was counted for a minute and not told."""


class LiftManager(SiteSessions, SiteRides):
    """Many lifts. Answers come from memory; nothing here waits for a controller."""

    def __init__(
        self,
        lifts: Iterable[LiftTask],
        bus: Bus[Event],
        memory: Memory | None = None,
        journal: Journal | None = None,
        clock: Clock | None = None,
        *,
        rmf: RmfRules | None = None,
    ) -> None:
        """Put lifts together; `memory`, `journal` and `clock` are what they were made with, if these are not the usual ones."""
        super().__init__({lift.options.name: lift for lift in lifts})
        self._bus = bus
        self._memory = memory or ShortMemory()
        self._journal = journal or ShortJournal()
        self._refusals = RefusalLog(self._journal)
        self.stopping = False
        """It has begun to end."""
        self.rmf = rmf or RmfRules()
        """What the site says about Open-RMF."""
        self._rides = RideEngine(
            self, self.line, self.tap, publish=bus.publish, keep=self._keep_rides, clock=clock or wall_clock()
        )

    async def run(self) -> None:
        """Poll every lift, and go on with rides, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for lift in self._lifts.values():
                tasks.create_task(lift.run())
            tasks.create_task(self._rides.run())
            tasks.create_task(self._tell())

    async def record(self) -> None:
        """Write journal and records until cancelled: for as long as anything may be done or said."""
        await self._journal.run(self._not_recorded)

    def note(self, row: Row) -> None:
        """Write down something that concerns no lift, or no session."""
        self._journal.note(row)

    def turned_away(self, who: TurnedAway) -> None:
        """Write down a request that reached no lift."""
        self._refusals.count(who.lift if who.lift in self._lifts else "", who.code)
        self._refusals.turned_away(who)

    @property
    def refused(self) -> Mapping[tuple[str, str], int]:
        """How often the answer was no, by lift (empty where it was about none) and code."""
        return self._refusals.counts

    @property
    def unwritten(self) -> frozenset[str]:
        """Which of `journal` and `state` cannot be written: then nothing is pressed on any lift."""
        troubles = {"journal": self._journal.trouble, "state": self._memory.trouble}
        return frozenset(file for file, trouble in troubles.items() if trouble)

    def drives(self) -> list[Coroutine[None, None, None]]:
        """Return what carries out each lift's presses and releases, to be run for as long as anything may be held."""
        return [lift.drive() for lift in self._lifts.values()]

    async def first_look(self) -> None:
        """Return once every lift has been read for the first time; bound it with a timeout."""
        for lift in self._lifts.values():
            await lift.first_look()

    def polls(self) -> dict[str, int]:
        """Return how many polls of each lift have ended, well or not."""
        return {name: lift.polls for name, lift in self._lifts.items()}

    async def clear_doors(self) -> bool:
        """Refuse everything from now on and withdraw OPEN; return once no robot needs a held door, and whether one did.

        `stop` comes next. This waits for `lift.CLEAR_AT_STOP_S` at most.
        """
        self.stopping = True
        self._rides.stop()
        for lift in self._lifts.values():
            lift.announce_stop()
        waited = False
        while any(lift.clearing for lift in self._lifts.values()):
            waited = True
            await asyncio.sleep(CLEARING_LOOK_S)
        return waited

    async def stop(self) -> None:
        """Let everything go on every lift and return once it is verified; bound it with a timeout."""
        self.stopping = True
        self._rides.stop()
        try:
            async with asyncio.TaskGroup() as tasks:
                for lift in self._lifts.values():
                    tasks.create_task(lift.stop())
        finally:
            self._refusals.tell(end=True)

    async def settled(self) -> None:
        """Return once everything is written down; bound it with a timeout."""
        await self._journal.settled()

    def lift_names(self) -> tuple[str, ...]:
        """Return the lifts in the order of the site file."""
        return tuple(self._lifts)

    def state(self, lift: str) -> LiftState | None:
        """Return what a lift publishes right now; None for a lift that is not of this site."""
        task = self._lifts.get(lift)
        return None if task is None else task.state()

    def describe(self, lift: str) -> LiftDescription | None:
        """Return what a lift can say and be told; None for a lift that is not of this site."""
        task = self._lifts.get(lift)
        return None if task is None else task.describe()

    def signals(self, lift: str) -> LiftSignals | None:
        """Return every signal as it was read last; None for a lift that is not of this site."""
        task = self._lifts.get(lift)
        return None if task is None else task.signals()

    def line(self, lift: str) -> WaitingLine:
        """Return who waits for a lift. Raises KeyError for one that is not of this site."""
        return self._lifts[lift].line

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide on a request at once."""
        if (task := self._lifts.get(ask.lift)) is not None:
            return self._told(ask.lift, task.request(ask))
        answer = self._unknown(ask.lift)
        self.turned_away(TurnedAway(answer.code, "there is no such lift", ask.lift, str(ask.holder)))
        return answer

    def end_session(self, lift: str, holder: Holder, grace_s: float) -> Accepted | Refused:
        """End the session of `holder` at its word."""
        task = self._lifts.get(lift)
        return self._told(lift, self._unknown(lift) if task is None else task.end_session(holder, grace_s))

    def acknowledge(self, lift: str, by: str) -> Acknowledged | Refused:
        """Take it that a person has checked a lift after a fire, or found no robot in its car."""
        task = self._lifts.get(lift)
        answer = self._unknown(lift) if task is None else task.acknowledge(by)
        return self._heard(lift, by, "acknowledge", answer)

    def lock_out(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> Lockout | Refused:
        """Keep robots off a lift until a person says otherwise."""
        task = self._lifts.get(lift)
        answer = self._unknown(lift) if task is None else task.lock_out(by, reason, at_once=at_once)
        return self._heard(lift, by, "lockout", answer)

    def force_release(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> ForceReleased | Refused:
        """Take a lift from its holder at a person's word."""
        task = self._lifts.get(lift)
        answer = self._unknown(lift) if task is None else task.force_release(by, reason, at_once=at_once)
        return self._heard(lift, by, "release", answer)

    def hand_over(self, lift: str, holder: Holder, to: Holder) -> Accepted | Refused:
        """Give the session of `holder` to another caller, at the holder's own word."""
        task = self._lifts.get(lift)
        return self._told(lift, self._unknown(lift) if task is None else task.hand_over(holder, to))

    def end_lockout(self, lift: str, by: str) -> LockoutEnded | Refused:
        """Let robots on a lift again."""
        task = self._lifts.get(lift)
        answer = self._unknown(lift) if task is None else task.end_lockout(by)
        return self._heard(lift, by, "lockout_end", answer)

    def begin_drain(self, lift: str, by: str, reason: str) -> Drain | Refused:
        """Let sessions on a lift end and no new one begin until a person ends that."""
        task = self._lifts.get(lift)
        answer = self._unknown(lift) if task is None else task.begin_drain(by, reason)
        return self._heard(lift, by, "drain", answer)

    def end_drain(self, lift: str, by: str) -> DrainEnded | Refused:
        """Let sessions on a lift begin again."""
        task = self._lifts.get(lift)
        answer = self._unknown(lift) if task is None else task.end_drain(by)
        return self._heard(lift, by, "drain_end", answer)

    def remembered(self, lift: str) -> Remembered | None:
        """Return what of a lift outlives the manager; None for a lift that is not of this site."""
        task = self._lifts.get(lift)
        return None if task is None else task.remembered()

    async def kept(self, lift: str, within_s: float) -> bool:
        """Wait until all that is remembered of a lift so far is on the disk; False where that took longer than `within_s`."""
        written = self._memory.written(lift)
        if written is None:
            return True
        done, _ = await asyncio.wait([written], timeout=within_s)
        return bool(done)

    @contextmanager
    def listen(self) -> Iterator[Subscription[Event]]:
        """Listen to events; the state of every lift comes first."""
        with self._bus.listen() as subscription:
            for name, task in self._lifts.items():
                subscription.put(StateChanged(name, task.state()))
            yield subscription

    @property
    def boot(self) -> str:
        """What the ids of this process's events begin with."""
        return self._bus.boot

    @property
    def newest(self) -> int:
        """The number of the newest event; 0 before the first."""
        return self._bus.newest

    @contextmanager
    def tap(self, hear: Callable[[Occurrence], None]) -> Iterator[None]:
        """Call `hear` with every event for as long as the context lasts, at once and in order."""
        loop = asyncio.get_running_loop()
        with self._bus.tap(lambda event, item: hear(Occurrence(event, loop.time(), item))):
            yield

    @contextmanager
    def overhear(self, hear: Callable[[Occurrence], None]) -> Iterator[None]:
        """As `tap`, of what is published anyhow: a state that nobody listens to is not worked out for it."""
        loop = asyncio.get_running_loop()
        with self._bus.overhear(lambda event, item: hear(Occurrence(event, loop.time(), item))):
            yield

    def freshen(self, lift: str | None = None) -> None:
        """Publish every change of a state that was not published yet, of one lift or of all."""
        for name in self._lifts if lift is None else (lift,):
            self._lifts[name].freshen()

    async def _tell(self) -> None:
        """Tell what was counted, though nobody asks anything more."""
        while True:
            await asyncio.sleep(TELL_EVERY_S)
            self._refusals.tell()
            for lift in self._lifts.values():
                lift.tell()

    def _heard(self, lift: str, by: str, said: str, answer: Answer | Refused) -> Answer | Refused:
        if isinstance(answer, Refused):
            self._refusals.person_refused(lift, by, said, code=answer.code, message=answer.message)
        return self._told(lift, answer)

    def _told(self, lift: str, answer: Answer | Refused) -> Answer | Refused:
        """Count the answer if it is no, and pass it on. Every answer that may be no goes through here once."""
        if isinstance(answer, Refused):
            self._refusals.count(lift if lift in self._lifts else "", answer.code)
        return answer

    def _keep_rides(self, lift: str, rides: tuple[KeptRide, ...]) -> None:
        self._lifts[lift].note_rides(rides)

    def _not_recorded(self, text: str) -> None:
        for lift in self._lifts:
            alarm = Alarm(lift, text or "journal: rows are written again; robots are taken as before")
            # not published: the journal has a row of its own for the whole site
            self._bus.hand_out(alarm)
