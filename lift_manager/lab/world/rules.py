"""The judge of who may have the lift: fire, lockout, the turn of people, one holder, and no repeated presses.

It keeps its own notes on requests, replies, presses and the physical state.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from drivers.model import FloorName, Result
from lift_manager.lab.world.lift_under_test import (
    MODES_WITHOUT_ROBOTS,
    Finding,
    FloorEvidence,
    LiftUnderTest,
    SuspectValues,
)
from lift_manager.lab.world.oracle import (
    FOREIGN_WRITE_FAULTS,
    FROZEN_FAULTS,
    MISLEADING_FAULTS,
    MODE_ENDS_WITHIN_S,
    Oracle,
    unreported_mode,
)
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
from register_maps.words import Door, Mode
from simulator.faults import PowerLoss
from simulator.wire_faults import Exchange

KNOWN_WITHIN_S = 1.0
"""An operator action or a published fire is in force at once; writes on their way may still arrive within this time."""
REPEAT_AFTER_S = 1.9
"""The same call is not pressed again sooner for the same request. The first pause after a failure is 2 s (DESIGN section 7)."""
NOTICED_WITHIN_S = 2.6
"""How long a state may stay open after our hold dropped out by itself: outputs are compared every 2 s, and the read takes time."""
OWN_RELEASE_WITHIN_S = 0.3
"""The same after our own release, which needs no read."""
MODE_ENDED_S = 2.0
"""How long ago the cause for dropping robot mode may have ended: a mode without robots, a key switch, or a watchdog."""
ROUNDING_S = 1e-6
SAME_INSTANT_S = 0.05
"""A press or release that is due is on the wire within this time."""
HOLD_FAULTS = frozenset({"frozen_registers", "stopped", "ignored_writes", "ignored_writes.stored"})
"""Faults under which a hold may be missing although its output reads back."""
LOST_PRESS = "lost_press"

_CALLS = ("go_to", "call", "go")
_HANDSHAKE = frozenset({"robot_left", "robot_in_place"})
"""Reports to the lift that may still follow a session."""


@dataclass(slots=True)
class _LiftNotes:
    """Notes on one lift for its rules."""

    about: LiftUnderTest
    truth: Truth | None = None
    state: LiftState | None = None
    session: Holder | None = None
    pressed_something: bool = False
    rests_until: float = -math.inf
    fire_since: float = math.inf
    """Since when there is a known fire that nobody has acknowledged."""
    fire_published_at: float = -math.inf
    locked_since: float = math.inf
    mode_at: float = -math.inf
    """When the lift was last in a mode without robots, or kept robots off."""
    live_at: float = -math.inf
    restarted_at: float = -math.inf
    requested_since: dict[Holder, set[FloorName]] | None = None
    """The floors that each holder has requested since the last restart; None if there was no restart."""
    stopping: bool = False
    floor: FloorName | None = None
    """The floor of the last accepted request."""
    calls: dict[tuple[str, int], float] = field(default_factory=dict)
    """When each call was last pressed for the current request."""
    standing_calls: dict[tuple[str, int], float] = field(default_factory=dict)
    """Calls that were pressed for the session, across restarts, until the car has arrived or the call is known to have failed."""
    cleared_at: dict[tuple[str, int], float] = field(default_factory=dict)
    """When somebody else last cleared a call that stays on until its end."""
    held_since: float = math.inf
    """Since when every door hold of the map has been on and obeyed; infinity if one is not."""
    pressed_since: float = math.inf
    """Since when every door hold has been in the registers, obeyed or not."""
    fell_at: float = -math.inf
    """When a door hold last ceased to be on and obeyed."""
    fell_by_us: bool = False
    """Whether a write of ours ended it."""
    invited_at: float = -math.inf
    """When a published state was last open for the robot of a session."""
    invited: tuple[Holder, FloorName | None] | None = None
    """The holder and the floor of that invitation."""
    taken_from: Holder | None = None
    """From whom the lift was taken while a door was said not to be closed, until one is said to be."""
    gave_up_at: dict[Holder, float] = field(default_factory=dict)
    """When each holder last requested no door hold, or another floor."""
    off_at: dict[str, float] = field(default_factory=dict)
    """When each command was last taken from the controller."""
    robot_mode_at: float = -math.inf
    stood_at: float = -math.inf
    """When the car last stood. The manager knows that it has started with the next reading."""
    undecided: list[tuple[float, Holder, Holder | None]] = field(default_factory=list)
    """Accepted requests that are not judged yet: the time, the caller, and the holder at that time."""

    def index(self, floor: FloorName | None) -> int | None:
        """Return the index of a floor; None for a floor that the lift does not have, or for a session without a floor."""
        floors = self.about.floors
        return floors.index(floor) if floor is not None and floor in floors else None

    def mark_reached(self, floor: FloorName) -> None:
        """Drop the calls to this floor: they are served."""
        there = self.index(floor)
        self.standing_calls = {call: since for call, since in self.standing_calls.items() if call[1] != there}


class Rules:
    """A witness that reports its findings to the oracle, which knows the excuses."""

    def __init__(self, oracle: Oracle) -> None:
        self._oracle = oracle
        self._notes: Mapping[str, _LiftNotes] = {name: _LiftNotes(about) for name, about in oracle.lifts.items()}

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        """Check that robot mode is not dropped under way, and judge the requests of earlier instants."""
        notes = self._notes[lift]
        before, notes.truth = notes.truth, truth
        if truth.mode in MODES_WITHOUT_ROBOTS or truth.bars & notes.about.shows.bars:
            notes.mode_at = at
        _track_holds(at, notes, truth)
        if before is not None and before.given != truth.given:
            notes.off_at |= dict.fromkeys(before.commands - truth.commands, at)
            notes.cleared_at |= {
                (name, value): at
                for name, value in set(before.given) - set(truth.given)
                if name not in notes.about.pulses_s and self._oracle.is_foreign_write(lift, name, at)
            }
        if truth.robot_mode:
            notes.robot_mode_at = at
        dropped = before is not None and before.robot_mode and "robot_mode" in before.commands - truth.commands
        if truth.standing:
            notes.stood_at = at
        # with its doors open a car only re-levels
        if dropped and truth.doors_shut and at - notes.stood_at > KNOWN_WITHIN_S:
            self._dropped_under_way(at, lift, notes)
        for pending in [pending for pending in notes.undecided if pending[0] < at]:
            notes.undecided.remove(pending)
            self._decide(at, lift, notes, *pending)

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Check all conditions of a press except the mode."""
        notes = self._notes[lift]
        notes.pressed_something |= bool(commands - _HANDSHAKE)
        names = ", ".join(sorted(commands))
        if at > notes.fire_since + KNOWN_WITHIN_S:
            self._oracle.report(at, lift, "pressed after a fire", f"{names}; nobody has acknowledged it")
        # people cannot use a lift that is still in robot mode, and robot mode under way may be pressed again
        kept = {"robot_mode"} if at - notes.robot_mode_at < MODE_ENDED_S else set()
        if at > notes.locked_since + KNOWN_WITHIN_S:
            self._check_lockout(at, lift, notes, commands, kept)
        if at < notes.rests_until and commands - _HANDSHAKE - kept:
            text = f"{names}, {notes.rests_until - at:.1f} s before the end of people's turn"
            self._oracle.report(at, lift, "pressed in people's turn", text)
        # a person may report as well that a robot has left
        for name in sorted(commands - {"robot_left"} - notes.about.repeated):
            if not self._was_requested(notes, name):
                rule, text = "pressed by a restart", f"{name}, and the holder has not requested that since"
                # frozen registers still show an output that was released meanwhile: it is found on, and refreshed
                frozen = self._oracle.frozen_by(lift, notes.off_at.get(name, -math.inf), at)
                if frozen is not None:
                    self._oracle.excuse_finding(lift, rule, frozen)
                else:
                    self._report_own_press(at, lift, rule, text, name)
        self._check_repeats(at, lift, notes, commands)

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """Check the conditions of an invitation besides the open door, and record what the manager knows."""
        notes = self._notes[lift]
        notes.state = state
        if state.quality is not Quality.LIVE:
            return
        notes.live_at = at
        if not _reports_open_door(state):
            notes.taken_from = None
        if state.standing and state.floor is not None and notes.standing_calls:
            # the manager takes the car to be there; if it is not, another rule finds that
            notes.mark_reached(state.floor)
        if state.mode is Mode.FIRE:
            notes.fire_since = min(notes.fire_since, at)
            notes.fire_published_at = at
        if state.robot_door is RobotDoor.OPEN:
            self._check_invitation(at, lift, notes, state)
        if state.robot_door is RobotDoor.OPEN and state.holder is not None:
            since = at - (state.age_s or 0.0)
            notes.invited_at, notes.invited = at, (state.holder, state.floor)
            if notes.about.holds:
                self._check_hold(at, lift, notes, state.holder, since)
            if notes.about.shows.robot_mode and notes.robot_mode_at < since - KNOWN_WITHIN_S:
                blinded = self._oracle.was_misled(lift, since - KNOWN_WITHIN_S, FROZEN_FAULTS)
                if blinded is None:
                    self._oracle.report(at, lift, "said open without robot mode", f"for {state.holder}")
                else:
                    self._oracle.excuse_finding(lift, "said open without robot mode", blinded)

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """Check whether a write of ours has just ended a hold, and whether the robot had time to clear the door."""
        fallen = [
            lift
            for lift, notes in self._notes.items()
            if notes.fell_at == at and controller in notes.about.controllers
            if not any(self._oracle.is_foreign_write(lift, hold, at) for hold in notes.about.holds)
        ]
        if not fallen or not exchange.executed:
            return
        request = parse_request(exchange.request, timed_coils=True)
        written = (controller, request.unit, request.table, request.address, request.count)
        for lift in fallen if request.is_write else ():
            refreshes = self._notes[lift].about.refreshes
            if written in refreshes and refreshes[written] in (None, *request.values):
                continue  # it fell by itself, and was seen to at this write
            self._notes[lift].fell_by_us = True
            self._check_release(at, lift, self._notes[lift])

    def on_event(self, at: float, event: Event) -> None:
        """Record sessions and operator actions."""
        match event:
            case SessionOpened() | SessionRestored() | HandedOver():
                self._check_holder(at, event)
            case SessionEnded(lift=lift, holder=holder, advice=advice):
                notes = self._notes[lift]
                notes.session, notes.floor = None, None
                # a holder that has ended its session itself gets no advice
                if advice is not None and notes.state is not None and _reports_open_door(notes.state):
                    notes.taken_from = holder
                notes.calls.clear()
                notes.standing_calls.clear()
                if notes.pressed_something:
                    # the event may arrive one turn of the loop after the end of the session
                    notes.rests_until = at + notes.about.between_sessions_s - 0.01
                notes.pressed_something = False
            case Acknowledged(lift=lift):
                self._acknowledged(at, lift, self._notes[lift])
            case RestrictionBegun(lift=lift, restriction=begun) if begun.kind is RestrictionKind.LOCKOUT:
                self._notes[lift].locked_since = at
            case RestrictionEnded(lift=lift, restriction=over) if over.kind is RestrictionKind.LOCKOUT:
                self._notes[lift].locked_since = math.inf
            case CommandEnded(lift=lift, outcome=outcome) if outcome.result is not Result.CONFIRMED:
                standing = self._notes[lift].standing_calls
                self._notes[lift].standing_calls = {
                    call: at for call, at in standing.items() if call[0] != outcome.command.name
                }
            case _:
                pass

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """Record an accepted request, and queue it to be judged unless it is a release or a report."""
        notes, holder, floor = self._notes[request.lift], request.holder, request.floor
        if refused is not None:
            return
        if floor != notes.floor or not request.hold_door:
            # the release may wait for a slow answer, and its holder may request the floor again meanwhile
            notes.gave_up_at[holder] = at
        if floor != notes.floor:
            notes.floor = floor
            notes.calls.clear()
            index = notes.index(floor)
            notes.standing_calls = {call: since for call, since in notes.standing_calls.items() if call[1] == index}
        truth = notes.truth
        shown_by_doors = notes.about.shows.floor_by is FloorEvidence.DOOR
        here = None if truth is None else truth.open_at if shown_by_doors else truth.at
        # a session that stays needs the lift even without a door hold
        releases = not (request.hold_door or request.stays) and truth is not None and here in (floor, None)
        # it is a call if the manager does not see the car at this floor; a robot inside releases nothing
        state = notes.state
        is_not_shown = state is not None and state.quality is Quality.LIVE and state.floor != floor
        is_call = not releases or (truth is not None and here is None) or is_not_shown
        if notes.requested_since is not None and (is_call or request.robot is RobotWord.IN_PLACE):
            notes.requested_since.setdefault(holder, set()).add(floor)
        if releases or request.robot is not None:
            return
        if request.hold_door:  # without it, the request may be a release at a floor that the car has just left
            # judged in the next instant: an operator action of this one may not be known yet
            notes.undecided.append((at, holder, notes.session))

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Forget what a killed manager forgets; operator actions outlast it."""
        for notes in self._notes.values() if change.fault == STOP else ():
            notes.stopping = True
        for lift in change.fault.lifts if isinstance(change.fault, ForgottenRecords) else ():
            self._notes[lift].fire_since = self._notes[lift].locked_since = math.inf
        if isinstance(change.fault, PowerLoss) and change.began and not change.fault.outputs_held:
            # our outputs are off, and only the lift knows which calls it has taken from them
            for lift, notes in self._notes.items():
                if change.where in (lift, *notes.about.controllers):
                    notes.standing_calls.clear()
        if change.fault == RESTART:
            for notes in self._notes.values():
                # if the session continues, the manager reports that it is restored
                notes.session, notes.floor, notes.restarted_at, notes.requested_since = None, None, at, {}
                notes.taken_from = None  # what is known of a door does not outlive the manager
                notes.rests_until = -math.inf
                notes.calls.clear()
                notes.undecided.clear()

    @staticmethod
    def _was_requested(notes: _LiftNotes, name: str) -> bool:
        """Whether the holder, or any caller if there is none, has made a request since the last restart; for a call, for its floor."""
        if notes.requested_since is None:
            return True
        since = notes.requested_since
        floors = since.get(notes.session, set()) if notes.session is not None else set().union(*since.values())
        index = dict(notes.truth.given).get(name) if notes.truth is not None else None
        if name.partition(".")[0] not in _CALLS or index is None:
            return bool(floors)
        return any(notes.index(floor) == index for floor in floors)

    def _report_own_press(self, at: float, lift: str, rule: str, text: str, name: str) -> None:
        """Report a press without a request, unless a foreign writer cleared that output: then a refresh presses it again."""
        self._oracle.report_unless_excused(
            Finding(at, lift, rule, text, SuspectValues.OUTPUT), only=FOREIGN_WRITE_FAULTS, about=name
        )

    def _check_hold(self, at: float, lift: str, notes: _LiftNotes, holder: Holder, since: float) -> None:
        """Check that the door drive is held for the invited robot, and was when the door was read, at `since`."""
        truth = notes.truth
        if truth is not None and truth.mode in MODES_WITHOUT_ROBOTS - notes.about.shows.modes:
            # this mode serves no door buttons
            self._oracle.excuse_finding(lift, "said open and not held", unreported_mode(truth.mode))
        elif truth is not None and notes.about.holds & truth.lost:
            self._oracle.excuse_finding(lift, "said open and not held", LOST_PRESS)
        elif math.isinf(notes.held_since):
            within_s = OWN_RELEASE_WITHIN_S if notes.fell_by_us else NOTICED_WITHIN_S
            if at - notes.fell_at <= within_s:
                return
            blinded = self._oracle.was_misled(lift, notes.fell_at - NOTICED_WITHIN_S, HOLD_FAULTS)
            text = f"for {holder}; no hold has been on for {at - notes.fell_at:.1f} s"
            self._find_unless(blinded, at, lift, "said open and not held", text)
        elif since < notes.pressed_since - ROUNDING_S and at - notes.fell_at > NOTICED_WITHIN_S:
            blinded = self._oracle.was_misled(lift, since, HOLD_FAULTS)
            text = f"for {holder}; the door was read {notes.pressed_since - since:.2f} s before the hold was on"
            self._find_unless(blinded, at, lift, "said open on a reading from before the hold", text)

    def _find_unless(self, blinded: str | None, at: float, lift: str, rule: str, text: str) -> None:
        """Report a finding, or count it as excused by the fault that misled the manager."""
        if blinded is None:
            self._oracle.report(at, lift, rule, text)
        else:
            self._oracle.excuse_finding(lift, rule, blinded)

    def _check_release(self, at: float, lift: str, notes: _LiftNotes) -> None:
        """Check that our release does not close the door on a robot that was invited a moment ago and has not given up."""
        truth = notes.truth
        if truth is None or notes.invited is None or at - notes.invited_at >= notes.about.clear_s - SAME_INSTANT_S:
            return
        holder, floor = notes.invited
        request = self._oracle.request_of(lift, holder)
        requested_it = notes.gave_up_at.get(holder, -math.inf) > notes.invited_at
        gave_up = request is None or request.floor != floor or not request.hold_door or requested_it
        sudden = (
            at - notes.mode_at < MODE_ENDED_S
            or not math.isinf(notes.fire_since)
            or bool(truth.bars)
            or (notes.about.shows.robot_mode and not truth.robot_mode)
            or notes.stopping
            or at - notes.live_at > KNOWN_WITHIN_S
        )
        if truth.open_at != floor or gave_up or sudden:
            return
        # the manager may release the door if the car seems to have departed
        blinded = self._oracle.was_misled(lift, notes.invited_at, MISLEADING_FAULTS)
        text = f"{holder} was invited at {floor} {at - notes.invited_at:.1f} s before our release"
        self._find_unless(blinded, at, lift, "the door fell while a robot was invited", text)

    def _check_invitation(self, at: float, lift: str, notes: _LiftNotes, state: LiftState) -> None:
        """Check that a lift invites nobody after a fire, in a lockout, or through a door that may still be open for its last holder."""
        if at > notes.fire_since + KNOWN_WITHIN_S:
            text = f"at {state.floor}; nobody has acknowledged it"
            self._oracle.report(at, lift, "said open after a fire", text)
        if at > notes.locked_since + KNOWN_WITHIN_S:
            self._oracle.report(at, lift, "said open in a lockout", f"at {state.floor}")
        if state.holder is None and notes.taken_from is not None:
            text = f"at {state.floor}; {notes.taken_from} may not know yet that it lost the lift"
            self._oracle.report(at, lift, "said open after it was taken", text)

    def _check_lockout(
        self, at: float, lift: str, notes: _LiftNotes, commands: frozenset[str], kept: Collection[str]
    ) -> None:
        """Check that nothing is pressed in a lockout.

        Until the end that was announced with it, robot mode that is granted is written again without a look at its cell: the
        controller may take the request out of it, and a stranger who does so looks the same.
        """
        ends_at = notes.locked_since + notes.about.clear_s + SAME_INSTANT_S
        if at <= ends_at and commands <= set(kept) and self._oracle.is_foreign_write(lift, "robot_mode", at):
            self._oracle.excuse_finding(lift, "pressed in a lockout", "foreign_writer")
        else:
            self._oracle.report(at, lift, "pressed in a lockout", ", ".join(sorted(commands)))

    def _decide(
        self, at: float, lift: str, notes: _LiftNotes, requested_at: float, caller: Holder, holder: Holder | None
    ) -> None:
        if requested_at > notes.fire_since + KNOWN_WITHIN_S:
            self._oracle.report(at, lift, "let in after a fire", f"{caller}; nobody has acknowledged it")
        if requested_at > notes.locked_since + KNOWN_WITHIN_S:
            self._oracle.report(at, lift, "let in despite a lockout", str(caller))
        if holder not in (None, caller) and notes.session == holder:
            self._oracle.report(
                at, lift, "two holders", f"the request of {caller} is accepted, and {holder} holds the lift"
            )

    def _check_holder(self, at: float, event: SessionOpened | SessionRestored | HandedOver) -> None:
        notes = self._notes[event.lift]
        if notes.session not in (None, event.holder):
            text = f"{event.holder} gets the lift or hands it over, and {notes.session} holds it"
            self._oracle.report(at, event.lift, "two holders", text)
        if isinstance(event, HandedOver):
            notes.session = event.to
            if notes.invited is not None and notes.invited[0] == event.holder:
                # the robot in the door now belongs to the new holder
                notes.invited = event.to, notes.invited[1]
            request = self._oracle.request_of(event.lift, event.holder)
            if notes.requested_since is not None and request is not None:
                # the old holder requested this floor itself, and the session continues with it
                notes.requested_since.setdefault(event.to, set()).add(request.floor)
        else:
            notes.session, notes.pressed_something = event.holder, isinstance(event, SessionRestored)

    def _acknowledged(self, at: float, lift: str, notes: _LiftNotes) -> None:
        shown = notes.state is not None and notes.state.quality is Quality.LIVE and notes.state.mode is Mode.FIRE
        still = notes.truth is not None and notes.truth.mode is Mode.FIRE
        if shown and still and not math.isinf(notes.fire_since):
            self._oracle.report(at, lift, "acknowledged while on", "the fire is still on")
        notes.fire_since = math.inf

    def _dropped_under_way(self, at: float, lift: str, notes: _LiftNotes) -> None:
        blind = at - notes.live_at > KNOWN_WITHIN_S
        by_mode = at - notes.mode_at < MODE_ENDED_S or not math.isinf(notes.fire_since)
        restarted = at - notes.restarted_at < notes.about.arrive_within_s
        if not (blind or by_mode or restarted or notes.stopping) and self._oracle.is_clean(
            lift, at, MODE_ENDS_WITHIN_S
        ):
            self._oracle.report(at, lift, "robot mode dropped under way", "the car was moving")

    def _check_repeats(self, at: float, lift: str, notes: _LiftNotes, commands: frozenset[str]) -> None:
        given = dict(notes.truth.given) if notes.truth is not None else {}
        for name in commands - notes.about.repeated:
            if name.partition(".")[0] not in _CALLS:
                continue
            key = (name, given.get(name, -1))
            since_s = at - notes.calls.get(key, -math.inf)
            if since_s < REPEAT_AFTER_S:
                self._report_own_press(at, lift, "pressed again", f"{name}, {since_s:.2f} s after its last press", name)
            if self._stands(notes, key):
                text, rule = (
                    f"{name}, and the lift still has the call from before the restart",
                    "pressed again after a restart",
                )
                # frozen registers do not show the call, and the manager presses a call again that nothing shows
                blinded = self._oracle.was_misled(lift, notes.restarted_at, FROZEN_FAULTS)
                # all that is left of a held call after a restart is its output, and here it was cleared
                if blinded is None and notes.cleared_at.get(key, -math.inf) > notes.standing_calls[key]:
                    blinded = "foreign_writer"
                if blinded is not None:
                    self._oracle.excuse_finding(lift, rule, blinded)
                else:
                    self._report_own_press(at, lift, rule, text, name)
            notes.calls[key] = notes.standing_calls[key] = at

    @staticmethod
    def _stands(notes: _LiftNotes, key: tuple[str, int]) -> bool:
        """Whether the lift still has a call that was pressed before the last restart."""
        pressed_at, floors = notes.standing_calls.get(key, math.inf), notes.about.floors
        if notes.truth is None or pressed_at > notes.restarted_at or key[1] not in range(len(floors)):
            return False
        return floors[key[1]] in notes.truth.calls


def _reports_open_door(state: LiftState) -> bool:
    return any(door is not Door.CLOSED for door in state.doors.values())


def _track_holds(at: float, notes: _LiftNotes, truth: Truth) -> None:
    """Record since when door holds are on, and drop the calls that the car has served."""
    if not (notes.about.holds and notes.about.holds <= truth.obeyed):
        if not math.isinf(notes.held_since):
            notes.held_since, notes.fell_at, notes.fell_by_us = math.inf, at, False
    elif math.isinf(notes.held_since):
        notes.held_since = at
    if not notes.about.holds <= truth.commands:
        if not math.isinf(notes.pressed_since):
            # cleared before the drive obeyed it: nobody can know this sooner than of a hold that it obeyed
            notes.fell_at, notes.fell_by_us = at, False
        notes.pressed_since = math.inf
    elif math.isinf(notes.pressed_since):
        notes.pressed_since = at
    if notes.standing_calls and truth.open_at is not None:
        notes.mark_reached(truth.open_at)
