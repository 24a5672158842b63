"""People first: what keeps robots off one lift whatever they ask, and what people say about that. Nothing here waits."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from datetime import datetime

from lift_manager.core.memory import Memory
from lift_manager.core.options import LiftOptions
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.contradictions import TRIPS, Trust
from lift_manager.domain.events import DrainBegun, DrainOver, Event, LockedOut, LockoutOver, PersonAcknowledged
from lift_manager.domain.hours import wall_clock
from lift_manager.domain.ride_record import KeptRide
from lift_manager.domain.service import (
    Acknowledged,
    Cause,
    Drain,
    DrainEnded,
    Lockout,
    LockoutEnded,
    Occupied,
    Remembered,
    how_to_acknowledge,
    how_to_end_drain,
    how_to_end_lockout,
    how_to_release,
)
from lift_manager.domain.session import KeptSession
from lift_manager.domain.state import Holder, Restrictions
from lift_manager.runtime.bus import Bus
from lift_manager.runtime.recorder import Clock

_log = logging.getLogger(__name__)


class PeopleFirst:
    """Fire latch, lockout, robot hours, the rest between sessions, and the car that may hold a robot."""

    def __init__(self, options: LiftOptions, bus: Bus[Event], memory: Memory, clock: Clock) -> None:
        """Take over what the memory has of this lift."""
        self._options = options
        self._bus = bus
        self._memory = memory
        self.clock = clock
        """The time of day in the building."""
        self._rests_until = -math.inf
        self.remembered = memory.recall(options.name)
        if self.remembered.keeps_robots_out or self.remembered.left_untold is not None:
            _log.warning("%s: from before this start: %s", options.name, self._in_words(), extra={"lift": options.name})

    @property
    def fire_latched(self) -> bool:
        """Whether there was a fire that nobody has acknowledged."""
        return self.remembered.fire_since is not None

    @property
    def lockout(self) -> str:
        """Who locked the lift out, since when and why; empty when nobody did."""
        lockout = self.remembered.lockout
        return "" if lockout is None else f"by {lockout.by} since {self._shown(lockout.since)}: {lockout.reason}"

    @property
    def drain(self) -> str:
        """Who lets sessions end and no new one begin, since when and why; empty when nobody does."""
        drain = self.remembered.drain
        return "" if drain is None else f"by {drain.by} since {self._shown(drain.since)}: {drain.reason}"

    @property
    def distrusted(self) -> str:
        """What its signals contradicted each other in, and what ends the distrust; empty where they did not."""
        distrust = self.remembered.trust.distrust
        if not distrust:
            return ""
        said = "; ".join(f"{one.text} (since {self._shown(one.since)})" for one in distrust)
        name = self._options.name
        return f"{said}. No door counts as open for robots until {TRIPS} trips in a row agree, or a person has looked: {how_to_acknowledge(name)}"

    def restrictions(self, waiting_for: str) -> Restrictions:
        """Return what keeps robots off, as every face shows it; `waiting_for` is what the session waits for."""
        occupied = self.remembered.occupied
        return Restrictions(
            fire_latched=self.fire_latched,
            lockout=self.lockout,
            drain=self.drain,
            maybe_aboard=occupied.holder if occupied is not None else None,
            distrusted=self.distrusted,
            waiting_for=waiting_for,
        )

    def why_no_press(self, *, closing: bool = False) -> str | None:
        """Say which word of people forbids every press now; `closing` is a session whose held door the lockout releases soon."""
        if self.fire_latched:
            return "there was a fire"
        return f"it is locked out {self.lockout}" if self.lockout and not closing else None

    def locked_out(self) -> Refused | None:
        """Refuse a request while a person keeps robots off."""
        if not self.lockout:
            return None
        name = self._options.name
        text = f"{name} is locked out {self.lockout}; a person ends it with {how_to_end_lockout(name)}"
        return Refused(Refusal.LOCKED_OUT, text)

    def after_fire(self) -> Refused | None:
        """Refuse a request until a person has acknowledged a fire."""
        since, occupied, name = self.remembered.fire_since, self.remembered.occupied, self._options.name
        if since is None:
            return None
        robot = "" if occupied is None else f" look for a robot of {occupied.holder} in its car, and"
        text = (
            f"{name} was in fire service ({self._shown(since)}); a person must check it, and{robot} say so once the alarm is"
            f" over: {how_to_acknowledge(name)}"
        )
        return Refused(Refusal.FIRE_LATCHED, text)

    def draining(self) -> Refused | None:
        """Refuse a new session while a person lets the present ones end."""
        if not self.drain:
            return None
        name = self._options.name
        text = f"no new session begins on {name}: drain {self.drain}; a person ends it with {how_to_end_drain(name)}"
        return Refused(Refusal.DRAINING, text)

    def outside_hours(self) -> Refused | None:
        """Refuse to begin with a robot at this time of day."""
        hours, now = self._options.robot_hours, self.clock()
        if hours is None or hours.now_open(now):
            return None
        text = (
            f"{self._options.name} takes robots {hours}, and here it is {wall_clock(now)};"
            f" robots may begin again {hours.next_begin(now)}"
        )
        return Refused(Refusal.OUTSIDE_HOURS, text)

    def session_ended(self, now: float) -> None:
        """Let people have the lift for a while after a session that pressed something."""
        self._rests_until = now + self._options.between_sessions_s

    def resting(self, now: float) -> bool:
        """Whether people have the lift to themselves between two robots."""
        return now < self._rests_until

    @property
    def resting_text(self) -> str:
        """Say what a session waits for while people have their turn."""
        return f"the turn of people, who have the lift for {self._options.between_sessions_s:g} s after each robot"

    def latch_fire(self) -> None:
        """Keep robots out until a person has checked the lift."""
        self._keep(replace(self.remembered, fire_since=self.clock()))

    def note_occupied(self, by: tuple[Holder, bool] | None) -> None:
        """Remember whose robot may be in the car, and whether it is known to be; called often, written on change."""
        known = self.remembered.occupied
        if by is None:
            if known is not None:
                self._keep(replace(self.remembered, occupied=None))
        elif known is None or (known.holder, known.aboard) != by:
            since = known.since if known is not None and known.holder == by[0] else self.clock()
            self._keep(replace(self.remembered, occupied=Occupied(*by, since)))

    def note_left_untold(self, *, owed: bool) -> None:
        """Remember that the lift has not taken the word that a robot left; called often, written on change."""
        if owed is not (self.remembered.left_untold is not None):
            self._keep(replace(self.remembered, left_untold=self.clock() if owed else None))

    def note_robot_mode(self, until: datetime | None) -> None:
        """Remember until when robot mode is kept although its session is over."""
        if until != self.remembered.robot_mode_until:
            self._keep(replace(self.remembered, robot_mode_until=until))

    def note_session(self, session: KeptSession | None) -> None:
        """Remember who holds the lift."""
        if session != self.remembered.session:
            self._keep(replace(self.remembered, session=session))

    def note_trust(self, trust: Trust) -> None:
        """Remember what its readings have proved and contradicted; called often, written on change."""
        if trust != self.remembered.trust:
            self._keep(replace(self.remembered, trust=trust))

    def note_rides(self, rides: tuple[KeptRide, ...]) -> None:
        """Remember the rides on it."""
        if rides != self.remembered.rides:
            self._keep(replace(self.remembered, rides=rides))

    def lock_out(self, by: str, reason: str) -> Lockout | Refused:
        """Keep robots off until a person says otherwise; a second word does not cover up the first."""
        name = self._options.name
        if self.lockout:
            text = f"{name} is locked out {self.lockout}; end that one first: {how_to_end_lockout(name)}"
            return Refused(Refusal.LOCKED_OUT, text)
        lockout = Lockout(by, reason, self.clock())
        self._keep(replace(self.remembered, lockout=lockout))
        said = {"event": self._bus.publish(LockedOut(name, lockout)), "lift": name}
        _log.warning("%s: locked out by %s: %s", name, by, reason, extra=said)
        return lockout

    def end_lockout(self, by: str) -> LockoutEnded | Refused:
        """Let robots on the lift again."""
        name, lockout = self._options.name, self.remembered.lockout
        if lockout is None:
            return Refused(Refusal.NOT_LOCKED_OUT, f"{name} is not locked out")
        ended, shown = LockoutEnded(by, self.clock(), lockout), self.lockout
        self._keep(replace(self.remembered, lockout=None))
        said = {"event": self._bus.publish(LockoutOver(name, ended)), "lift": name}
        _log.warning("%s: the lockout %s is ended by %s", name, shown, by, extra=said)
        return ended

    def begin_drain(self, by: str, reason: str) -> Drain | Refused:
        """Let sessions end and no new one begin until a person ends that; a second request does not replace the first."""
        if (draining := self.draining()) is not None:
            return draining
        name, drain = self._options.name, Drain(by, reason, self.clock())
        self._keep(replace(self.remembered, drain=drain))
        said = {"event": self._bus.publish(DrainBegun(name, drain)), "lift": name}
        _log.warning("%s: no new session begins: drain by %s: %s", name, by, reason, extra=said)
        return drain

    def end_drain(self, by: str) -> DrainEnded | Refused:
        """Let sessions begin again."""
        name, drain = self._options.name, self.remembered.drain
        if drain is None:
            return Refused(Refusal.NOT_DRAINING, f"there is no drain of {name}")
        ended, shown = DrainEnded(by, self.clock(), drain), self.drain
        self._keep(replace(self.remembered, drain=None))
        said = {"event": self._bus.publish(DrainOver(name, ended)), "lift": name}
        _log.warning("%s: the drain %s is ended by %s", name, shown, by, extra=said)
        return ended

    def acknowledge(self, by: str, *, occupied: bool, held: Holder | None = None) -> Acknowledged | Refused:
        """Take it that a person has checked the lift. `occupied` says whether a robot left in the car is one thing to check.

        A robot whose session goes on is not left: `held` says whose that is.
        """
        name = self._options.name
        trust = self.remembered.trust
        causes = {
            Cause.FIRE: self.fire_latched,
            Cause.OCCUPIED: occupied,
            Cause.CONTRADICTION: bool(trust.distrust),
        }
        what = tuple(cause for cause, given in causes.items() if given)
        if not what:
            text = f"{name} has nothing to acknowledge: there was no fire, no robot was left in the car, and its signals agree"
            if held is not None:
                text += f"; {held} holds it, and a person ends that session with {how_to_release(name)}"
            return Refused(Refusal.NOTHING_TO_ACKNOWLEDGE, text)
        said = Acknowledged(by, self.clock(), what)
        kept = None if occupied else self.remembered.occupied
        self._keep(
            replace(
                self.remembered, fire_since=None, occupied=kept, trust=replace(trust, distrust=()), acknowledged=said
            )
        )
        event = self._bus.publish(PersonAcknowledged(name, said))
        _log.warning("%s: %s acknowledged by %s", name, " and ".join(what), by, extra={"event": event, "lift": name})
        return said

    def _in_words(self) -> str:
        fire, occupied = self.remembered.fire_since, self.remembered.occupied
        words = (
            f"a fire at {self._shown(fire)} that nobody has acknowledged" if fire is not None else "",
            f"locked out {self.lockout}" if self.lockout else "",
            f"drain {self.drain}" if self.drain else "",
            f"a robot of {occupied.holder} that may be in the car" if occupied is not None else "",
            "robot_left, which the lift has not taken" if self.remembered.left_untold is not None else "",
            self.distrusted,
        )
        return "; ".join(word for word in words if word)

    def _keep(self, remembered: Remembered) -> None:
        self.remembered = remembered
        self._memory.keep(self._options.name, remembered)

    def _shown(self, at: datetime) -> str:
        return f"{at.astimezone(self.clock().tzinfo):%Y-%m-%d %H:%M}"
