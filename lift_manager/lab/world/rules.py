"""The judge of who gets the lift: fire, lockout, turns, one holder, and presses that are not repeated.

It keeps a small book of its own, from what is asked, answered and pressed, and from the truth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.model import FloorName, Result
from lift_manager.lab.world.judged import FORBIDDEN, Finding, FloorBy, Judged, SuspectValues
from lift_manager.lab.world.oracle import FOREIGN, MISREAD, MODE_ENDS_WITHIN_S, STANDS_STILL, Oracle, untold
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import RESTART, STOP, FaultChange, FloorRequest, ForgottenRecords
from lift_manager.lift.events import (
    Acknowledged,
    CommandEnded,
    HandedOver,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from register_maps.frames import parse_request
from register_maps.words import Mode
from simulator.faults import PowerLoss
from simulator.wire_faults import Exchange

KNOWN_WITHIN_S = 1.0
"""A word of a person, or a fire that was published, holds from then on; what was on its way may still arrive for so long."""
AGAIN_AFTER_S = 1.9
"""The same call is not pressed sooner for the same request: the first pause after a failure is 2 s (DESIGN section 7)."""
NOTICED_WITHIN_S = 2.6
"""How long a state may go on to say open after our hold fell by itself: it is looked at every 2 s, and a look takes its time."""
OWN_WITHIN_S = 0.3
"""The same for a hold that we released: nobody has to look at anything."""
MODE_LEFT_S = 2.0
"""How long ago the forbidden mode, or what kept robots off (key switch, watchdog), may have ended because of which robot mode was dropped."""
ROUNDING_S = 1e-6
SAME_INSTANT_S = 0.05
"""A press or release that is due is on the wire within so long."""
BLINDS_TO_A_HOLD = frozenset({"frozen_registers", "stopped", "ignored_writes", "ignored_writes.stored"})
"""Faults under which a hold that was read back may not be there."""
LOST = "lost_press"

_CALLS = ("go_to", "call", "go")
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
    """When the lift was last in a mode without robots, or kept them off."""
    live_at: float = -math.inf
    restarted_at: float = -math.inf
    requested_since: dict[Holder, set[FloorName]] | None = None
    """Who has requested the lift since the last restart, was accepted, and where to; None without a restart."""
    stopping: bool = False
    floor: FloorName | None = None
    """Of the last request that was accepted."""
    calls: dict[tuple[str, int], float] = field(default_factory=dict)
    """When each call was last pressed, for the request that stands."""
    standing_calls: dict[tuple[str, int], float] = field(default_factory=dict)
    """Calls that were pressed for the session, over restarts, until the car is there for them or they are known to have failed."""
    held_since: float = math.inf
    """Since when every door hold of the map has been on and obeyed; infinity while it is not."""
    pressed_since: float = math.inf
    """Since when they have stood in the registers, obeyed or not."""
    fell_at: float = -math.inf
    """When they last ceased to be on and obeyed."""
    fell_by_us: bool = False
    """By a write of ours."""
    invited_at: float = -math.inf
    """When a state last said open for the robot of a session."""
    invited: tuple[Holder, FloorName | None] | None = None
    """To whom, and where."""
    gave_up_at: dict[Holder, float] = field(default_factory=dict)
    """When each caller was last taken to want the door at no floor, or at another one than before."""
    robot_mode_at: float = -math.inf
    stood_at: float = -math.inf
    """When the car was last seen to stand; that it has set out is known with the next reading."""
    doubts: list[tuple[float, Holder, Holder | None]] = field(default_factory=list)
    """Requests that were accepted and are not judged yet: when, of whom, and who held the lift then."""

    def index(self, floor: FloorName | None) -> int | None:
        """Return the place of a floor; None for one that the lift does not have, or for a session that was asked for none."""
        floors = self.about.floors
        return floors.index(floor) if floor is not None and floor in floors else None

    def reached(self, floor: FloorName) -> None:
        """The calls to this floor are served."""
        there = self.index(floor)
        self.standing_calls = {call: since for call, since in self.standing_calls.items() if call[1] != there}


class Rules:
    """A witness that tells its findings to the oracle, which knows what is excused."""

    def __init__(self, oracle: Oracle) -> None:
        self._oracle = oracle
        self._books: Mapping[str, _Book] = {name: _Book(about) for name, about in oracle.judges.items()}

    def looked(self, at: float, lift: str, truth: Truth) -> None:
        """See whether robot mode was dropped under way, and who was given a lift that another one holds."""
        book = self._books[lift]
        before, book.truth = book.truth, truth
        if truth.mode in FORBIDDEN or truth.bars & book.about.shows.bars:
            book.mode_at = at
        _follow(at, book, truth)
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
            self._oracle.find(at, lift, "pressed after a fire", f"{names}; nobody has acknowledged it")
        if at > book.locked_since + KNOWN_WITHIN_S:
            self._oracle.find(at, lift, "pressed in a lockout", names)
        # a lift that is still in robot mode is none for people, and what keeps it so under way may be pressed again
        kept = {"robot_mode"} if at - book.robot_mode_at < MODE_LEFT_S else set()
        if at < book.rests_until and commands - _WORDS - kept:
            text = f"{names}, {book.rests_until - at:.1f} s before people have had their turn"
            self._oracle.find(at, lift, "pressed in people's turn", text)
        # that a robot left is a person's word as well
        for name in sorted(commands - {"robot_left"} - book.about.repeated):
            if not self._was_asked_for(book, name):
                text = f"{name}, and nobody who holds the lift has asked for that since"
                self._by_itself(at, lift, "pressed by a restart", text, name)
        self._again(at, lift, book, commands)

    def published(self, at: float, lift: str, state: LiftState) -> None:
        """See whether what a robot needs besides an open door is there, and know what the manager knows."""
        book = self._books[lift]
        book.state = state
        if state.quality is not Quality.LIVE:
            return
        book.live_at = at
        if state.standing and state.floor is not None and book.standing_calls:
            # for the manager the car was there; where it was not, another rule finds that
            book.reached(state.floor)
        if state.mode is Mode.FIRE:
            book.fire_since = min(book.fire_since, at)
            book.fire_published_at = at
        if state.robot_door is RobotDoor.OPEN:
            self._invited(at, lift, book, state)
        if state.robot_door is RobotDoor.OPEN and state.holder is not None:
            since = at - (state.age_s or 0.0)
            book.invited_at, book.invited = at, (state.holder, state.floor)
            if book.about.holds:
                self._is_held(at, lift, book, state.holder, since)
            if book.about.shows.robot_mode and book.robot_mode_at < since - KNOWN_WITHIN_S:
                blinded = self._oracle.was_blinded(lift, since - KNOWN_WITHIN_S, STANDS_STILL)
                if blinded is None:
                    self._oracle.find(at, lift, "said open without robot mode", f"for {state.holder}")
                else:
                    self._oracle.let_pass(lift, "said open without robot mode", blinded)

    def exchanged(self, at: float, controller: str, exchange: Exchange) -> None:
        """See whether a hold that has just fallen was released by us, and whether its robot had time to clear the door."""
        fallen = [
            lift
            for lift, book in self._books.items()
            if book.fell_at == at and controller in book.about.controllers
            if not any(self._oracle.is_foreign(lift, hold, at) for hold in book.about.holds)
        ]
        if fallen and exchange.executed and parse_request(exchange.request, timed_coils=True).is_write:
            for lift in fallen:
                self._books[lift].fell_by_us = True
                self._let_fall(at, lift, self._books[lift])

    def heard(self, at: float, event: Event) -> None:
        """Keep the book of sessions and of people's words."""
        match event:
            case SessionOpened() | SessionRestored() | HandedOver():
                self._held(at, event)
            case SessionEnded(lift=lift):
                book = self._books[lift]
                book.session, book.floor = None, None
                book.calls.clear()
                book.standing_calls.clear()
                if book.pressed_something:
                    # the instant at which the event is heard may be a turn of the loop later than the end
                    book.rests_until = at + book.about.between_sessions_s - 0.01
                book.pressed_something = False
            case Acknowledged(lift=lift):
                self._acknowledged(at, lift, self._books[lift])
            case RestrictionBegun(lift=lift, restriction=begun) if begun.kind is RestrictionKind.LOCKOUT:
                self._books[lift].locked_since = at
            case RestrictionEnded(lift=lift, restriction=over) if over.kind is RestrictionKind.LOCKOUT:
                self._books[lift].locked_since = math.inf
            case CommandEnded(lift=lift, outcome=outcome) if outcome.result is not Result.CONFIRMED:
                standing = self._books[lift].standing_calls
                self._books[lift].standing_calls = {
                    call: at for call, at in standing.items() if call[0] != outcome.command.name
                }
            case _:
                pass

    def requested(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """See whether this may be accepted; a release always may."""
        book, holder, floor = self._books[request.lift], request.holder, request.floor
        if refused is not None:
            return
        if floor != book.floor or not request.hold_door:
            # the release that follows may wait behind a slow answer, and its holder may request the floor again meanwhile
            book.gave_up_at[holder] = at
        if floor != book.floor:
            book.floor = floor
            book.calls.clear()
            index = book.index(floor)
            book.standing_calls = {call: since for call, since in book.standing_calls.items() if call[1] == index}
        truth = book.truth
        told_by_doors = book.about.shows.floor_by is FloorBy.DOOR
        here = None if truth is None else truth.open_at if told_by_doors else truth.at
        # a session that stays wants the lift also without its door
        releases = not (request.hold_door or request.stays) and truth is not None and here in (floor, None)
        # between floors it is a call, if the manager has not seen the car where it is released; a robot inside releases nothing
        between = truth is not None and here is None
        if book.requested_since is not None and (not releases or between or request.robot is RobotWord.IN_PLACE):
            book.requested_since.setdefault(holder, set()).add(floor)
        if releases or request.robot is not None:
            return
        if request.hold_door:  # without, a floor that the car has just left may be released as well
            # what a person did in this very instant may not be known yet
            book.doubts.append((at, holder, book.session))

    def struck(self, at: float, struck: FaultChange) -> None:
        """Forget what a manager that is killed forgets; what people said is not among it."""
        for book in self._books.values() if struck.fault == STOP else ():
            book.stopping = True
        for lift in struck.fault.lifts if isinstance(struck.fault, ForgottenRecords) else ():
            self._books[lift].fire_since = self._books[lift].locked_since = math.inf
        if isinstance(struck.fault, PowerLoss) and struck.began and not struck.fault.outputs_held:
            # our outputs are gone, and nobody but the lift knows that it has taken a call from them
            for lift, book in self._books.items():
                if struck.where in (lift, *book.about.controllers):
                    book.standing_calls.clear()
        if struck.fault == RESTART:
            for book in self._books.values():
                # the session may go on, and is told then
                book.session, book.floor, book.restarted_at, book.requested_since = None, None, at, {}
                book.rests_until = -math.inf
                book.calls.clear()
                book.doubts.clear()

    @staticmethod
    def _was_asked_for(book: _Book, name: str) -> bool:
        """Whether the holder, or whoever takes the lift now, has asked for this since the last restart; for a call, for its floor."""
        if book.requested_since is None:
            return True
        since = book.requested_since
        floors = since.get(book.session, set()) if book.session is not None else set().union(*since.values())
        index = dict(book.truth.given).get(name) if book.truth is not None else None
        if name.partition(".")[0] not in _CALLS or index is None:
            return bool(floors)
        return any(book.index(floor) == index for floor in floors)

    def _by_itself(self, at: float, lift: str, rule: str, text: str, name: str) -> None:
        """Note a press that nobody asked for, unless somebody else took away what it presses: then a refresh presses it again."""
        self._oracle.weigh(Finding(at, lift, rule, text, SuspectValues.OUTPUT), only=FOREIGN, about=name)

    def _is_held(self, at: float, lift: str, book: _Book, holder: Holder, since: float) -> None:
        """See whether the door drive is held for the robot that is invited, and was when the door was read, at `since`."""
        truth = book.truth
        if truth is not None and truth.mode in FORBIDDEN - book.about.shows.modes:
            # it serves no door buttons
            self._oracle.let_pass(lift, "said open and not held", untold(truth.mode))
        elif truth is not None and book.about.holds & truth.lost:
            self._oracle.let_pass(lift, "said open and not held", LOST)
        elif math.isinf(book.held_since):
            within_s = OWN_WITHIN_S if book.fell_by_us else NOTICED_WITHIN_S
            if at - book.fell_at <= within_s:
                return
            blinded = self._oracle.was_blinded(lift, book.fell_at - NOTICED_WITHIN_S, BLINDS_TO_A_HOLD)
            text = f"for {holder}; no hold has been on for {at - book.fell_at:.1f} s"
            self._find_unless(blinded, at, lift, "said open and not held", text)
        elif since < book.pressed_since - ROUNDING_S and at - book.fell_at > NOTICED_WITHIN_S:
            blinded = self._oracle.was_blinded(lift, since, BLINDS_TO_A_HOLD)
            text = f"for {holder}; it was read {book.pressed_since - since:.2f} s before the hold was on"
            self._find_unless(blinded, at, lift, "said open on a reading from before the hold", text)

    def _find_unless(self, blinded: str | None, at: float, lift: str, rule: str, text: str) -> None:
        """Note a finding, or count the fault that kept the manager from knowing."""
        if blinded is None:
            self._oracle.find(at, lift, rule, text)
        else:
            self._oracle.let_pass(lift, rule, blinded)

    def _let_fall(self, at: float, lift: str, book: _Book) -> None:
        """See whether our release shuts the door on a robot that was invited a moment ago, and did not ask for it."""
        truth = book.truth
        if truth is None or book.invited is None or at - book.invited_at >= book.about.clear_s - SAME_INSTANT_S:
            return
        holder, floor = book.invited
        request = self._oracle.request_of(lift, holder)
        requested_it = book.gave_up_at.get(holder, -math.inf) > book.invited_at
        gave_up = request is None or request.floor != floor or not request.hold_door or requested_it
        sudden = (
            at - book.mode_at < MODE_LEFT_S
            or not math.isinf(book.fire_since)
            or bool(truth.bars)
            or (book.about.shows.robot_mode and not truth.robot_mode)
            or book.stopping
            or at - book.live_at > KNOWN_WITHIN_S
        )
        if truth.open_at != floor or gave_up or sudden:
            return
        # a car that seems to have left takes its door along
        blinded = self._oracle.was_blinded(lift, book.invited_at, MISREAD)
        text = f"{holder} was invited at {floor} {at - book.invited_at:.1f} s before our release"
        self._find_unless(blinded, at, lift, "the door fell while a robot was invited", text)

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
            if book.invited is not None and book.invited[0] == event.holder:
                # the robot in the door is the new holder's, who speaks for it from here on
                book.invited = event.to, book.invited[1]
            request = self._oracle.request_of(event.lift, event.holder)
            if book.requested_since is not None and request is not None:
                # its holder has said so itself, and the session goes on with what it wants
                book.requested_since.setdefault(event.to, set()).add(request.floor)
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
        if not (blind or by_mode or restarted or book.stopping) and self._oracle.is_clean(lift, at, MODE_ENDS_WITHIN_S):
            self._oracle.find(at, lift, "robot mode dropped under way", "the car was moving")

    def _again(self, at: float, lift: str, book: _Book, commands: frozenset[str]) -> None:
        given = dict(book.truth.given) if book.truth is not None else {}
        for name in commands - book.about.repeated:
            if name.partition(".")[0] not in _CALLS:
                continue
            key = (name, given.get(name, -1))
            since_s = at - book.calls.get(key, -math.inf)
            if since_s < AGAIN_AFTER_S:
                self._by_itself(at, lift, "pressed again", f"{name}, {since_s:.2f} s after its last press", name)
            if self._stands(book, key):
                text, rule = f"{name}, and the lift still has the call of before", "pressed again after a restart"
                # registers that stand still do not show the call, and one that nothing shows is pressed again
                if (blinded := self._oracle.was_blinded(lift, book.restarted_at, STANDS_STILL)) is not None:
                    self._oracle.let_pass(lift, rule, blinded)
                else:
                    self._by_itself(at, lift, rule, text, name)
            book.calls[key] = book.standing_calls[key] = at

    @staticmethod
    def _stands(book: _Book, key: tuple[str, int]) -> bool:
        """Whether a call was pressed before the last restart, and the lift still has it."""
        pressed_at, floors = book.standing_calls.get(key, math.inf), book.about.floors
        if book.truth is None or pressed_at > book.restarted_at or key[1] not in range(len(floors)):
            return False
        return floors[key[1]] in book.truth.calls


def _follow(at: float, book: _Book, truth: Truth) -> None:
    """Keep the book of door holds, and of calls that stand until the car is there."""
    if not (book.about.holds and book.about.holds <= truth.obeyed):
        if not math.isinf(book.held_since):
            book.held_since, book.fell_at, book.fell_by_us = math.inf, at, False
    elif math.isinf(book.held_since):
        book.held_since = at
    if not book.about.holds <= truth.commands:
        if not math.isinf(book.pressed_since):
            # cleared before the drive had obeyed it: nobody can know sooner than of one that it obeyed
            book.fell_at = at
        book.pressed_since = math.inf
    elif math.isinf(book.pressed_since):
        book.pressed_since = at
    if book.standing_calls and truth.open_at is not None:
        book.reached(truth.open_at)
