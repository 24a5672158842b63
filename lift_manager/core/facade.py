"""What every face sees of the manager."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from lift_manager.domain.asking import Accepted, Ask, Refused, RobotWord
from lift_manager.domain.description import LiftDescription, LiftSignals, WireFrame
from lift_manager.domain.events import Occurrence
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
from lift_manager.runtime.refusals import TurnedAway


class LiftFacade(Protocol):
    """All lifts of a site, as a face uses them; nothing but `kept` waits, so a hung controller delays nobody."""

    @property
    def unwritten(self) -> frozenset[str]:
        """Which of `journal` and `state` cannot be written: then nothing is pressed on any lift."""
        ...

    @property
    def stopping(self) -> bool:
        """Whether it has begun to end: nobody holds a lift any more, and sessions are kept for the next start."""
        ...

    @property
    def rmf(self) -> RmfRules:
        """What the site says about Open-RMF."""
        ...

    def lift_names(self) -> tuple[str, ...]:
        """Every lift of the site, in the site's order, whether or not it can be reached."""
        ...

    def state(self, lift: str) -> LiftState | None:
        """The newest state, from memory; None when the site has no such lift."""
        ...

    def describe(self, lift: str) -> LiftDescription | None:
        """What a lift can say and be told, and what the site allows; None when the site has no such lift."""
        ...

    def signals(self, lift: str) -> LiftSignals | None:
        """Every signal as it was read last, from memory; None when the site has no such lift."""
        ...

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide at once. All session rules live behind this call, the release rule for a closed door included."""
        ...

    def end_session(self, lift: str, holder: Holder, grace_s: float) -> Accepted | Refused:
        """End the session of `holder`, wherever the car is; one that is over already is over. The car is not moved by it.

        For `grace_s` door hold and robot mode stay as they are and nothing new is pressed; a request of the same holder within
        it goes on as if nothing had been said. Another holder's session is refused.
        """
        ...

    def turned_away(self, who: TurnedAway) -> None:
        """Write down a request that a face refused by itself."""
        ...

    def acknowledge(self, lift: str, by: str) -> Acknowledged | Refused:
        """Take a person's word that a lift was checked after a fire, or that no robot is in its car; `by` is their name."""
        ...

    def lock_out(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> Lockout | Refused:
        """Take a person's word that no robot may command a lift.

        OPEN is withdrawn at once. The door is released `clear_s` later while a robot may be in it, unless `at_once`; everything
        else is released now.
        """
        ...

    def end_lockout(self, lift: str, by: str) -> LockoutEnded | Refused:
        """Take a person's word that robots may command a lift again."""
        ...

    def begin_drain(self, lift: str, by: str, reason: str) -> Drain | Refused:
        """Take a person's request that no new session begins on a lift; the present one goes on to its end."""
        ...

    def end_drain(self, lift: str, by: str) -> DrainEnded | Refused:
        """Take a person's request that sessions may begin again."""
        ...

    def force_release(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> ForceReleased | Refused:
        """Take a person's word that a session is over; everything is released as at the end of any session, when `lock_out` does."""
        ...

    def hand_over(self, lift: str, holder: Holder, to: Holder) -> Accepted | Refused:
        """Give the session of `holder` to another caller, at the holder's own word; the car and its door stay as they are."""
        ...

    def remembered(self, lift: str) -> Remembered | None:
        """What people said about a lift, and what outlives the manager; None when the site has no such lift."""
        ...

    async def kept(self, lift: str, within_s: float) -> bool:
        """Wait until all that is remembered of a lift so far is on the disk; False where that took longer than `within_s`."""
        ...


class SessionFacade(Protocol):
    """Sessions that their holder opens and closes. Each answer is from memory and at once."""

    def open_session(self, wish: OpenSession) -> SessionBegun | Refused:
        """Take the lift for a caller; nothing is called by it."""
        ...

    def session(self, lift: str, session: str, holder: Holder | None) -> SessionInfo | Refused:
        """A session by its id, or one that was over not long ago; `holder` None reads whosesoever it is."""
        ...

    def renew_session(self, lift: str, session: str, holder: Holder, ttl_s: float | None) -> SessionInfo | Refused:
        """Begin its lease anew; a session from before a restart goes on. `ttl_s` as in `OpenSession`."""
        ...

    def close_session(self, lift: str, session: str, holder: Holder, robot: RobotWord | None) -> SessionInfo | Refused:
        """End it at its holder's word, the car where it is; one that is over already is returned as it is."""
        ...

    def hand_session_over(self, lift: str, session: str, holder: Holder, to: Holder) -> SessionInfo | Refused:
        """Give it to another caller at its holder's word. It gets a new id: the old one ends."""
        ...

    def ask_within(self, request: SessionRequest) -> Followed | Refused:
        """Take a request of a session's holder; what becomes of it is to be had from `followed`."""
        ...

    def followed(self, lift: str, session: str, holder: Holder | None, number: str) -> Followed | Refused:
        """A request within a session by its id, as it is now."""
        ...

    async def until_ended(
        self, lift: str, session: str, holder: Holder | None, number: str, within_s: float
    ) -> Followed | Refused:
        """The same, once it is no longer pending or `within_s` has passed."""
        ...


class RideFacade(Protocol):
    """Rides: the manager does the whole dance. Each answer is from memory and at once."""

    def plan_ride(self, wish: RideRequest) -> RidePlan | Refused:
        """Say what a ride would come to now; nothing is begun, pressed or kept."""
        ...

    def begin_ride(self, wish: RideRequest) -> RideBegun | Refused:
        """Begin one, or queue it."""
        ...

    def ride(self, ride: str) -> Ride | None:
        """A ride by its id, or one that ended not long ago; None for one that nobody remembers."""
        ...

    def rides(self) -> tuple[Ride, ...]:
        """Every ride that goes on, and those that ended not long ago; the oldest first."""
        ...

    def ride_word(self, ride: str, word: RideWord, caller: Holder | None) -> Ride | Refused:
        """Take the robot's word; `caller` None is an operator, who may speak for every robot."""
        ...

    def cancel_ride(self, ride: str, caller: Holder | None, reason: str) -> Ride | Refused:
        """End it safely: a robot that may be inside is let out first, and somebody is told. Twice is once."""
        ...


class EventSource(Protocol):
    """What happens, as it happens."""

    @property
    def boot(self) -> str:
        """What the ids of this process's events begin with."""
        ...

    @property
    def newest(self) -> int:
        """The number of the newest event; 0 before the first."""
        ...

    def freshen(self, lift: str | None = None) -> None:
        """Publish what of a state has changed and is not published yet: after it that of this lift, or every one, is as its newest event says."""
        ...

    def tap(self, hear: Callable[[Occurrence], None]) -> AbstractContextManager[None]:
        """Call `hear` with every event for as long as the context lasts, at once and in order. It must neither wait nor raise."""
        ...


class FrameSource(Protocol):
    """What goes over the wires, for tools."""

    def link_names(self) -> tuple[str, ...]:
        """Every controller of the site file by its name there."""
        ...

    def tap_frames(self, link: str, hear: Callable[[WireFrame], None]) -> AbstractContextManager[None]:
        """Call `hear` with every frame of a link for as long as the context lasts. It must neither wait nor raise."""
        ...


class Facade(LiftFacade, SessionFacade, RideFacade, EventSource, Protocol):
    """Everything a face may use."""
