"""The judge of who gets the lift: fire, lockout, turns, one holder, and presses that are not repeated.

It keeps a small book of its own, from what is asked, answered and pressed, and from the truth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.model import FloorName
from lift_manager.commissioning.detection import Lie
from lift_manager.domain.asking import Accepted, Ask, Refused, RobotWord
from lift_manager.domain.events import (
    Event,
    HandedOver,
    LockedOut,
    LockoutOver,
    PersonAcknowledged,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.domain.state import Holder, LiftState, Quality, RobotDoor
from lift_manager.lab.world.judged import Judged
from lift_manager.lab.world.oracle import RELEASES_WITHIN_S, Oracle
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import Struck
from register_maps.vocabulary import CALLS
from register_maps.words import ROBOT_FORBIDDEN_MODES, Mode
from simulator.wire_faults import Exchange

KNOWN_WITHIN_S = 1.0
"""A word of a person, or a fire that was published, holds from then on; what was on its way may still arrive for so long."""
AGAIN_AFTER_S = 1.9
"""The same call is not pressed sooner for the same request: the first pause after a failure is 2 s (DESIGN section 7)."""
HELD_WITHIN_S = 2.6
"""How long ago our hold may have been seen when the state says open: it is looked at every 2 s, and a look takes its time."""
MODE_LEFT_S = 2.0
"""How long ago the mode may have ended because of which robot mode was dropped."""

RESTART = "restart"
"""What a world strikes when the manager is killed and started again."""
STOP = "stop"
"""And before its orderly end, which lets go of robot mode too, wherever the car is: nobody is left to do it later."""


@dataclass(frozen=True, slots=True)
class Forgot:
    """And with a restart, if the disk did not have the newest of some lifts: a fire or a lockout may be forgotten with it."""

    lifts: tuple[str, ...]


_WORDS = frozenset({"robot_left", "robot_in_place"})
"""What the lift may still be told after a session."""


@dataclass(slots=True)
class _Book:
    """One lift, as its rules see it."""

    about: Judged
    truth: Truth | None = None
    state: LiftState | None = None
    session: Holder | None = None
    pressed_something: bool = False
    rests_until: float = -math.inf
    fire_since: float = math.inf
    """Since when a fire is known that nobody has acknowledged."""
    fire_published_at: float = -math.inf
    locked_since: float = math.inf
    mode_at: float = -math.inf
    """When the lift was last in a mode without robots."""
    live_at: float = -math.inf
    restarted_at: float = -math.inf
    asked_since: bool = True
    """Whether anybody has asked for the lift since the last restart, and was accepted."""
    stopping: bool = False
    floor: FloorName | None = None
    """Of the last request that was accepted."""
    calls: dict[tuple[str, int], float] = field(default_factory=dict)
    """When each call was last pressed, for the request that stands."""
    held_at: float = -math.inf
    """When one of our door holds was last on."""
    robot_mode_at: float = -math.inf
    stood_at: float = -math.inf
    """When the car was last seen to stand; that it has set out is known with the next reading."""
    doubts: list[tuple[float, Holder, Holder | None]] = field(default_factory=list)
    """Requests that were accepted and are not judged yet: when, of whom, and who held the lift then."""


class Rules:
    """A witness that tells its findings to the oracle, which knows what is excused."""

    def __init__(self, oracle: Oracle) -> None:
        self._oracle = oracle
        self._books: Mapping[str, _Book] = {name: _Book(about) for name, about in oracle.judges.items()}

    def looked(self, at: float, lift: str, truth: Truth) -> None:
        """See whether robot mode was dropped under way, and who was given a lift that another one holds."""
        book = self._books[lift]
        before, book.truth = book.truth, truth
        if truth.mode in ROBOT_FORBIDDEN_MODES:
            book.mode_at = at
        if book.about.holds & truth.commands:
            book.held_at = at
        if truth.robot_mode:
            book.robot_mode_at = at
        dropped = before is not None and before.robot_mode and "robot_mode" in before.commands - truth.commands
        if truth.standing:
            book.stood_at = at
        # with its doors open a car only re-levels
        if dropped and truth.doors_shut and at - book.stood_at > KNOWN_WITHIN_S:
            self._dropped_under_way(at, lift, book)
        for doubt in [doubt for doubt in book.doubts if doubt[0] < at]:
            book.doubts.remove(doubt)
            self._decide(at, lift, book, *doubt)

    def pressed(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """See whether anything may be pressed now, by everything but the mode."""
        book = self._books[lift]
        book.pressed_something |= bool(commands - _WORDS)
        names = ", ".join(sorted(commands))
        if at > book.fire_since + KNOWN_WITHIN_S:
            self._oracle.find(at, lift, "pressed after a fire", f"{names}; nobody has acknowledged it", Lie.OUTPUT)
        if at > book.locked_since + KNOWN_WITHIN_S:
            self._oracle.find(at, lift, "pressed in a lockout", names, Lie.OUTPUT)
        # a lift that is still in robot mode is none for people, and what keeps it so under way may be pressed again
        kept = {"robot_mode"} if at - book.robot_mode_at < MODE_LEFT_S else set()
        if at < book.rests_until and commands - _WORDS - kept:
            text = f"{names}, {book.rests_until - at:.1f} s before people have had their turn"
            self._oracle.find(at, lift, "pressed in people's turn", text, Lie.OUTPUT)
        if not book.asked_since and (by_itself := commands - {"robot_left"} - book.about.repeated):
            # that a robot left is a person's word as well
            text = f"{', '.join(sorted(by_itself))}, and nobody has asked for the lift since"
            self._oracle.find(at, lift, "pressed by a restart", text, Lie.OUTPUT)
        self._again(at, lift, book, commands)

    def published(self, at: float, lift: str, state: LiftState) -> None:
        """See whether what a robot needs besides an open door is there, and know what the manager knows."""
        book = self._books[lift]
        book.state = state
        if state.quality is not Quality.LIVE:
            return
        book.live_at = at
        if state.mode is Mode.FIRE:
            book.fire_since = min(book.fire_since, at)
            book.fire_published_at = at
        if state.robot_door is RobotDoor.OPEN:
            self._invited(at, lift, book, state)
        if state.robot_door is RobotDoor.OPEN and state.holder is not None:
            since = at - (state.age_s or 0.0)
            if book.about.holds and book.held_at < since - HELD_WITHIN_S:
                wanted = self._oracle.wanted_since(lift)
                self._oracle.find(at, lift, "said open and not held", f"for {state.holder}", Lie.EFFECT, since=wanted)
            if book.about.tells_robot_mode and book.robot_mode_at < since - KNOWN_WITHIN_S:
                self._oracle.find(at, lift, "said open without robot mode", f"for {state.holder}", Lie.MODE)

    def exchanged(self, at: float, controller: str, exchange: Exchange) -> None:
        """Nothing about the wire is judged here."""

    def heard(self, at: float, event: Event) -> None:
        """Keep the book of sessions and of people's words."""
        match event:
            case SessionOpened() | SessionRestored() | HandedOver():
                self._held(at, event)
            case SessionEnded(lift=lift):
                book = self._books[lift]
                book.session, book.floor = None, None
                book.calls.clear()
                if book.pressed_something:
                    # the instant at which the event is heard may be a turn of the loop later than the end
                    book.rests_until = at + book.about.between_sessions_s - 0.01
                book.pressed_something = False
            case PersonAcknowledged(lift=lift):
                self._acknowledged(at, lift, self._books[lift])
            case LockedOut(lift=lift):
                self._books[lift].locked_since = at
            case LockoutOver(lift=lift):
                self._books[lift].locked_since = math.inf
            case _:
                pass

    def asked(self, at: float, ask: Ask, answer: Accepted | Refused) -> None:
        """See whether this may be accepted; letting go always may."""
        book = self._books[ask.lift]
        if not isinstance(answer, Accepted):
            return
        if ask.floor != book.floor:
            book.floor = ask.floor
            book.calls.clear()
        truth = book.truth
        here = None if truth is None else truth.open_at if book.about.told_by_doors else truth.at
        lets_go = not ask.hold_door and truth is not None and here in (ask.floor, None)
        # between floors it is a call, if the manager has not seen the car where it is let go of; a robot inside lets go of nothing
        between = truth is not None and here is None
        book.asked_since |= not lets_go or between or ask.robot is RobotWord.IN_PLACE
        if lets_go or ask.robot is not None:
            return
        if ask.hold_door:  # without, a floor that the car has just left may be let go of as well
            # what a person said in this very instant may not have been heard yet
            book.doubts.append((at, ask.holder, book.session))

    def struck(self, at: float, struck: Struck) -> None:
        """Forget what a manager that is killed forgets; what people said is not among it."""
        for book in self._books.values() if struck.fault == STOP else ():
            book.stopping = True
        for lift in struck.fault.lifts if isinstance(struck.fault, Forgot) else ():
            self._books[lift].fire_since = self._books[lift].locked_since = math.inf
        if struck.fault == RESTART:
            for book in self._books.values():
                # the session may go on, and is told then
                book.session, book.floor, book.restarted_at, book.asked_since = None, None, at, False
                book.rests_until = -math.inf
                book.calls.clear()
                book.doubts.clear()

    def _invited(self, at: float, lift: str, book: _Book, state: LiftState) -> None:
        """Nobody is invited by a lift that a person must check, or keeps robots off."""
        if at > book.fire_since + KNOWN_WITHIN_S:
            text = f"at {state.floor}; nobody has acknowledged it"
            self._oracle.find(at, lift, "said open after a fire", text)
        if at > book.locked_since + KNOWN_WITHIN_S:
            self._oracle.find(at, lift, "said open in a lockout", f"at {state.floor}")

    def _decide(self, at: float, lift: str, book: _Book, asked_at: float, asker: Holder, holder: Holder | None) -> None:
        if asked_at > book.fire_since + KNOWN_WITHIN_S:
            self._oracle.find(at, lift, "let in after a fire", f"{asker}; nobody has acknowledged it")
        if asked_at > book.locked_since + KNOWN_WITHIN_S:
            self._oracle.find(at, lift, "let in despite a lockout", str(asker))
        if holder not in (None, asker) and book.session == holder:
            self._oracle.find(at, lift, "two holders", f"{asker} is obeyed, and {holder} holds the lift")

    def _held(self, at: float, event: SessionOpened | SessionRestored | HandedOver) -> None:
        book = self._books[event.lift]
        if book.session not in (None, event.holder):
            text = f"{event.holder} gets the lift, or gives it away, and {book.session} holds it"
            self._oracle.find(at, event.lift, "two holders", text)
        if isinstance(event, HandedOver):
            book.session = event.to
        else:
            book.session, book.pressed_something = event.holder, isinstance(event, SessionRestored)

    def _acknowledged(self, at: float, lift: str, book: _Book) -> None:
        shown = book.state is not None and book.state.quality is Quality.LIVE and book.state.mode is Mode.FIRE
        still = book.truth is not None and book.truth.mode is Mode.FIRE
        if shown and still and not math.isinf(book.fire_since):
            self._oracle.find(at, lift, "acknowledged while on", "the fire is still on")
        book.fire_since = math.inf

    def _dropped_under_way(self, at: float, lift: str, book: _Book) -> None:
        blind = at - book.live_at > KNOWN_WITHIN_S
        by_mode = at - book.mode_at < MODE_LEFT_S or not math.isinf(book.fire_since)
        restarted = at - book.restarted_at < book.about.arrive_within_s
        if not (blind or by_mode or restarted or book.stopping) and self._oracle.is_clean(lift, at, RELEASES_WITHIN_S):
            self._oracle.find(at, lift, "robot mode dropped under way", "the car was moving")

    def _again(self, at: float, lift: str, book: _Book, commands: frozenset[str]) -> None:
        given = dict(book.truth.given) if book.truth is not None else {}
        for name in commands & set(CALLS) - book.about.repeated:
            key = (name, given.get(name, -1))
            since_s = at - book.calls.get(key, -math.inf)
            if since_s < AGAIN_AFTER_S:
                self._oracle.find(
                    at, lift, "pressed again", f"{name}, {since_s:.2f} s after its last press", Lie.OUTPUT
                )
            book.calls[key] = at
