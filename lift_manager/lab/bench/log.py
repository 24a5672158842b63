"""What a manager has told and refused, written down for a test."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from drivers.model import Outcome
from lift_manager.core.bus import Bus
from lift_manager.core.facade import LiftFacade
from lift_manager.domain.asking import Accepted, Ask, Refused, TurnedAway
from lift_manager.domain.events import Alarm, CommandEnded, Event
from lift_manager.domain.service import Acknowledged, ForceReleased, Lockout, LockoutEnded, Remembered
from lift_manager.domain.state import Holder, LiftState


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

    def __init__(self, facade: LiftFacade, log: Log) -> None:
        self._facade = facade
        self._log = log

    @property
    def unwritten(self) -> frozenset[str]:
        """What cannot be written."""
        return self._facade.unwritten

    def lift_names(self) -> tuple[str, ...]:
        """Every lift of the site."""
        return self._facade.lift_names()

    def state(self, lift: str) -> LiftState | None:
        """The newest state."""
        return self._facade.state(lift)

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide at once."""
        answer = self._facade.request(ask)
        self._note(ask.lift, answer)
        return answer

    def turned_away(self, who: TurnedAway) -> None:
        """Write down a request that a face refused."""
        self._facade.turned_away(who)

    def acknowledge(self, lift: str, by: str) -> Acknowledged | Refused:
        """Take a person's word that a lift was checked."""
        answer = self._facade.acknowledge(lift, by)
        self._note(lift, answer)
        return answer

    def lock_out(self, lift: str, by: str, reason: str) -> Lockout | Refused:
        """Take a person's word that no robot may command a lift."""
        answer = self._facade.lock_out(lift, by, reason)
        self._note(lift, answer)
        return answer

    def end_lockout(self, lift: str, by: str) -> LockoutEnded | Refused:
        """Take a person's word that robots may command it again."""
        answer = self._facade.end_lockout(lift, by)
        self._note(lift, answer)
        return answer

    def force_release(self, lift: str, by: str, reason: str) -> ForceReleased | Refused:
        """Take a person's word that a session is over."""
        answer = self._facade.force_release(lift, by, reason)
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

    def _note(self, lift: str, answer: object) -> None:
        if isinstance(answer, Refused):
            self._log.add(lift, answer)
