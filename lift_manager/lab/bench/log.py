"""What a manager has told and refused, written down for a test."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TypeVar

from drivers.model import Outcome
from lift_manager.core.facade import Facade
from lift_manager.domain.asking import Accepted, Ask, Refused, RobotWord
from lift_manager.domain.description import LiftDescription, LiftSignals
from lift_manager.domain.events import Alarm, CommandEnded, Event, Occurrence
from lift_manager.domain.ride import Ride, RideBegun, RidePlan, RideRequest, RideWord
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
from lift_manager.domain.session_requests import Followed, OpenSession, SessionBegun, SessionInfo, SessionRequest
from lift_manager.domain.state import Holder, LiftState
from lift_manager.runtime.bus import Bus
from lift_manager.runtime.refusals import TurnedAway

Answer = TypeVar("Answer")


@dataclass(frozen=True, slots=True)
class Logged:
    """One thing that happened, beside changes of state."""

    at_s: float
    """By `time.monotonic`."""
    lift: str
    what: Event | Refused


class Log:
    """Everything that happened, oldest first."""

    def __init__(self) -> None:
        self.entries: list[Logged] = []
        self.news: Bus[Logged] = Bus()

    def add(self, lift: str, what: Event | Refused) -> None:
        """Write down what happens now."""
        entry = Logged(asyncio.get_running_loop().time(), lift, what)
        self.entries.append(entry)
        self.news.publish(entry)

    @property
    def alarms(self) -> tuple[str, ...]:
        """What a person should know of, in words."""
        return tuple(entry.what.text for entry in self.entries if isinstance(entry.what, Alarm))

    @property
    def refusals(self) -> tuple[Refused, ...]:
        """Every answer no."""
        return tuple(entry.what for entry in self.entries if isinstance(entry.what, Refused))

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """What became of commands."""
        return tuple(entry.what.outcome for entry in self.entries if isinstance(entry.what, CommandEnded))


class NotingFacade:
    """A facade that writes down every answer no, through whichever face it is given."""

    def __init__(self, facade: Facade, log: Log) -> None:
        self._facade = facade
        self._log = log

    @property
    def unwritten(self) -> frozenset[str]:
        """What cannot be written."""
        return self._facade.unwritten

    @property
    def stopping(self) -> bool:
        """Whether it has begun to end."""
        return self._facade.stopping

    @property
    def rmf(self) -> RmfRules:
        """What the site says about Open-RMF."""
        return self._facade.rmf

    def lift_names(self) -> tuple[str, ...]:
        """Every lift of the site."""
        return self._facade.lift_names()

    def state(self, lift: str) -> LiftState | None:
        """The newest state."""
        return self._facade.state(lift)

    def describe(self, lift: str) -> LiftDescription | None:
        """What a lift can say and be told."""
        return self._facade.describe(lift)

    def signals(self, lift: str) -> LiftSignals | None:
        """Every signal of a lift."""
        return self._facade.signals(lift)

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide at once."""
        answer = self._facade.request(ask)
        self._note(ask.lift, answer)
        return answer

    def end_session(self, lift: str, holder: Holder, grace_s: float) -> Accepted | Refused:
        """End the session of a face without ids of sessions."""
        answer = self._facade.end_session(lift, holder, grace_s)
        self._note(lift, answer)
        return answer

    def turned_away(self, who: TurnedAway) -> None:
        """Write down a request that a face refused."""
        self._facade.turned_away(who)

    def acknowledge(self, lift: str, by: str) -> Acknowledged | Refused:
        """Take a person's word that a lift was checked."""
        answer = self._facade.acknowledge(lift, by)
        self._note(lift, answer)
        return answer

    def lock_out(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> Lockout | Refused:
        """Take a person's word that no robot may command a lift."""
        answer = self._facade.lock_out(lift, by, reason, at_once=at_once)
        self._note(lift, answer)
        return answer

    def end_lockout(self, lift: str, by: str) -> LockoutEnded | Refused:
        """Take a person's word that robots may command it again."""
        answer = self._facade.end_lockout(lift, by)
        self._note(lift, answer)
        return answer

    def begin_drain(self, lift: str, by: str, reason: str) -> Drain | Refused:
        """Take a person's request that no new session begins."""
        answer = self._facade.begin_drain(lift, by, reason)
        self._note(lift, answer)
        return answer

    def end_drain(self, lift: str, by: str) -> DrainEnded | Refused:
        """Take a person's request that sessions may begin again."""
        answer = self._facade.end_drain(lift, by)
        self._note(lift, answer)
        return answer

    def force_release(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> ForceReleased | Refused:
        """Take a person's word that a session is over."""
        answer = self._facade.force_release(lift, by, reason, at_once=at_once)
        self._note(lift, answer)
        return answer

    def hand_over(self, lift: str, holder: Holder, to: Holder) -> Accepted | Refused:
        """Give the session to another caller, at its holder's word."""
        answer = self._facade.hand_over(lift, holder, to)
        self._note(lift, answer)
        return answer

    def remembered(self, lift: str) -> Remembered | None:
        """What outlives the manager."""
        return self._facade.remembered(lift)

    async def kept(self, lift: str, within_s: float) -> bool:
        """Wait until it is written."""
        return await self._facade.kept(lift, within_s)

    # -- sessions

    def open_session(self, wish: OpenSession) -> SessionBegun | Refused:
        """Take the lift for a caller."""
        return self._noted(wish.lift, self._facade.open_session(wish))

    def session(self, lift: str, session: str, holder: Holder | None) -> SessionInfo | Refused:
        """A session by its id."""
        return self._noted(lift, self._facade.session(lift, session, holder))

    def renew_session(self, lift: str, session: str, holder: Holder, ttl_s: float | None) -> SessionInfo | Refused:
        """Begin its lease anew."""
        return self._noted(lift, self._facade.renew_session(lift, session, holder, ttl_s))

    def close_session(self, lift: str, session: str, holder: Holder, robot: RobotWord | None) -> SessionInfo | Refused:
        """End it at its holder's word."""
        return self._noted(lift, self._facade.close_session(lift, session, holder, robot))

    def hand_session_over(self, lift: str, session: str, holder: Holder, to: Holder) -> SessionInfo | Refused:
        """Give it to another caller."""
        return self._noted(lift, self._facade.hand_session_over(lift, session, holder, to))

    def ask_within(self, request: SessionRequest) -> Followed | Refused:
        """Take a request of a session's holder."""
        return self._noted(request.lift, self._facade.ask_within(request))

    def followed(self, lift: str, session: str, holder: Holder | None, number: str) -> Followed | Refused:
        """A request within a session."""
        return self._noted(lift, self._facade.followed(lift, session, holder, number))

    async def until_ended(
        self, lift: str, session: str, holder: Holder | None, number: str, within_s: float
    ) -> Followed | Refused:
        """The same, once it has ended."""
        return self._noted(lift, await self._facade.until_ended(lift, session, holder, number, within_s))

    # -- rides

    def plan_ride(self, wish: RideRequest) -> RidePlan | Refused:
        """Say what a ride would come to."""
        return self._noted("", self._facade.plan_ride(wish))

    def begin_ride(self, wish: RideRequest) -> RideBegun | Refused:
        """Begin one, or queue it."""
        return self._noted("", self._facade.begin_ride(wish))

    def ride(self, ride: str) -> Ride | None:
        """A ride by its id."""
        return self._facade.ride(ride)

    def rides(self) -> tuple[Ride, ...]:
        """Every ride that is remembered."""
        return self._facade.rides()

    def ride_word(self, ride: str, word: RideWord, caller: Holder | None) -> Ride | Refused:
        """Take the robot's word."""
        return self._noted("", self._facade.ride_word(ride, word, caller))

    def cancel_ride(self, ride: str, caller: Holder | None, reason: str) -> Ride | Refused:
        """End it safely."""
        return self._noted("", self._facade.cancel_ride(ride, caller, reason))

    # -- events

    @property
    def boot(self) -> str:
        """What the ids of this process's events begin with."""
        return self._facade.boot

    @property
    def newest(self) -> int:
        """The number of the newest event."""
        return self._facade.newest

    def freshen(self, lift: str | None = None) -> None:
        """Publish what of a state is not published yet."""
        self._facade.freshen(lift)

    def tap(self, hear: Callable[[Occurrence], None]) -> AbstractContextManager[None]:
        """Call `hear` with every event."""
        return self._facade.tap(hear)

    def _noted(self, lift: str, answer: Answer | Refused) -> Answer | Refused:
        self._note(lift, answer)
        return answer

    def _note(self, lift: str, answer: object) -> None:
        if isinstance(answer, Refused):
            self._log.add(lift, answer)
