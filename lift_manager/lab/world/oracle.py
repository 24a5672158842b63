"""The judge: compares what the manager publishes and does with what the simulated lifts really do.

It reads the physics of the simulator and the exchanges on the wire. From the manager it takes only the age of published states, and
checks that no state claims to be newer than the data behind it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from drivers.model import Command, CommandKind, FloorName, Outcome, Proof, Result
from lift_manager.lab.world.fault_names import fault_name
from lift_manager.lab.world.lift_under_test import (
    MODES_WITHOUT_ROBOTS,
    Finding,
    LiftUnderTest,
    PolledBlock,
    SuspectValues,
)
from lift_manager.lab.world.published_state import FalseClaim, false_claims
from lift_manager.lab.world.requested_outputs import is_output_requested
from lift_manager.lab.world.truth import History, Truth, starts_towards, truth_text
from lift_manager.lab.world.witness import RESTART, FaultChange, FloorRequest, ForgottenRecords
from lift_manager.lift.events import CommandEnded, HandedOver
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from lift_manager.web.workshop import DOOR_OPEN, state_data
from register_maps.frames import parse_request
from register_maps.words import Mode
from simulator.faults import ForeignWriter
from simulator.wire_faults import Exchange

ROUNDING_S = 1e-6
ANSWER_TAKES_S = 0.02
"""Time from the moment at which a device samples its state to the arrival of its reply, on a fast wire."""
HISTORY_S = 30.0
"""How much history is kept: longer than any outcome takes, and than any limit below."""
MAX_KEPT_ANSWERS = 256
"""Correct replies that are kept. More than arrive within the maximum age of a reading, including those still on their way."""
REGISTERS_WITHIN_S = 0.5
"""A controller registers a call with its next scan; a starting car may be observed before that."""
RELEASES_WITHIN_S = 3.0
"""How long an output may stay on without a request while the wire works. A release is sent at once, or after one reply, and verified.
Chosen: three polls of the slowest map."""
MODE_ENDS_WITHIN_S = 6.0
"""The same for robot mode, which outlasts the trip and is released once the car is known to stand."""
RETRIES_WITHIN_S = 2.0
"""A failed release is repeated within this time. Each failed write extends the limit by it."""
RELEASE_EXCHANGES = 8
"""Replies that a release may have to wait for: a running poll, a read before the write, the write, and the read-back."""
SLOW_FOR_S = 10.0
"""How long a slow reply extends the limits."""
MODE_KNOWN_WITHIN_S = 1.0
"""How soon the manager knows of a mode without robots on a working wire: two polls, as a map may be read in several blocks."""
SILENT_S = 1.0
"""A wire without a request for this long does not work: a lift is polled five times in that time."""
FOREIGN_CLEARED_S = 70.0
"""How long a foreign press may stay on. It is released at most once a minute (`drivers.modbus.foreign_writes`); the release takes time."""
AFTER_EFFECT_S = {"reboot": 60.0, "lost_press": 30.0, "ignored_writes": 30.0, "ignored_writes.stored": 30.0}
"""How long the effects of some faults outlast them. After a restart a lift looks for its lowest floor. A lost press stays lost while it
lasts, which may be a whole ride for a report of the robot."""
SETTLES_S = 2.0
"""How long wrong data may be published after a fault: two readings, and the age of the last wrong one."""

_CALLS = frozenset({CommandKind.GO_TO, CommandKind.CALL, CommandKind.GO})
WRITE_FAULTS = frozenset({"ignored_writes", "ignored_writes.stored", "stopped"})
"""Faults under which no output can be released, as on a failing wire."""
FROZEN_FAULTS = frozenset({"frozen_registers", "stopped"})
"""Faults under which registers keep the values that they had when the fault began."""

MISLEADING_FAULTS = frozenset(
    {"says_wrong_floor", "contradicting_limits", "frozen_registers", "stopped", "homing", "reboot"}
)
"""Faults under which a car may seem to move or to have arrived although it has not."""
FOREIGN_WRITE_FAULTS = frozenset({"foreign_writer"})
FOR_OTHERS = "a car that set out for somebody else"
"""Where only the motion of the car confirms a call, a car that starts in its direction after the press is all the evidence there is."""


_Confirmation = tuple[float, float, Outcome]
"""When a command was reported as confirmed, when it was pressed, and the outcome."""


@dataclass(slots=True)
class _Fault:
    """A fault of a lift, and the findings that it excuses."""

    name: str
    kinds: frozenset[SuspectValues]
    since: float
    until: float
    command: str = ""
    """The only command that it affects; empty if it affects all."""
    ended_at: float = math.inf
    unread_within_s: float | None = None
    """For registers that nobody has read since they froze: how soon after that reading it must be noticed. None once they were read.
    A change just before they froze is news to that reading."""

    def touches(self, command: str) -> bool:
        """Whether the fault affects this command. A foreign call affects every call: the car moves for it."""
        return self.command in ("", command) or (_is_call(self.command) and _is_call(command))


@dataclass(slots=True)
class _WireHealth:
    """The wire to one controller."""

    fails: bool = False
    """Whether the last exchange failed: it got no correct reply in time."""
    failed_writes: int = 0
    slow_s: float = 0.0
    """The slowest recent correct reply."""
    slow_at: float = -math.inf


@dataclass(slots=True)
class _UnrequestedOutput:
    """An output that is on without a request."""

    since: float
    lost_s: float
    """The value of `_WatchedLift.lost_s` at that time."""
    failed_writes: int


@dataclass(slots=True)
class _WatchedLift:
    """What the judge has recorded of one lift."""

    about: LiftUnderTest
    history: History = field(default_factory=History)
    restarted_at: float = -math.inf
    """When the manager was last restarted."""
    mode_since: float = -math.inf
    bars_since: float = math.inf
    on_since: dict[tuple[str, int], float] = field(default_factory=dict)
    """Since when each command is present at the controller, by its name and the index of the floor of a call."""
    unrequested: dict[tuple[str, int], _UnrequestedOutput] = field(default_factory=dict)
    faults: list[_Fault] = field(default_factory=list)
    """Current and recent faults."""
    newest: dict[PolledBlock, deque[tuple[float, float]]] = field(default_factory=dict)
    """For each block of the poll, when correct replies arrive and when they were requested."""
    pressed_at: dict[str, float] = field(default_factory=dict)
    under_way_at: float = -math.inf
    """When the car last moved while robot mode was on without a request."""
    stuck: dict[str, float] = field(default_factory=dict)
    """Until when an undetectable fault excuses an output that it may have left on."""
    foreign: dict[str, float] = field(default_factory=dict)
    """Until when a foreign press excuses each output."""
    claims: deque[_Confirmation] = field(default_factory=deque)
    requests: dict[Holder, tuple[FloorRequest, FloorRequest]] = field(default_factory=dict)
    """The last accepted request of each holder, and the last one before it for another floor."""
    forgotten: set[Holder] = field(default_factory=set)
    """Holders whose newest request may not have been on the disk at a restart: the manager goes on with what it remembers."""
    in_place_at: dict[Holder, float] = field(default_factory=dict)
    """When the robot of each holder last reported that it was inside, explicitly or by requesting another floor."""
    floor: FloorName | None = None
    """The floor of the last accepted request; `floor_since` is when that floor was first requested."""
    floor_since: float = -math.inf
    troubles: int = 0
    """How many faults the lift and its wires have now."""
    troubled_until: float = -math.inf
    clean_since: float = -math.inf
    last_exchange: float = -math.inf
    looked_at: float = -math.inf
    lost_s: float = 0.0
    """Total time in which no release was possible: the wire failed, or the device did not obey."""
    state: LiftState | None = None


class Oracle:
    """Judges every lift of a world. `findings` lists the violations."""

    def __init__(self, lifts: Mapping[str, LiftUnderTest]) -> None:
        self.findings: list[Finding] = []
        self.excused: dict[tuple[str, str, str], int] = {}
        """How often a finding was excused, by lift, rule and fault."""
        self.judged = 0
        """How many published states were compared with the lift."""
        self.invitations = 0
        """How many invitations these states had: floors at which a door was published as open."""
        self.lifts = lifts
        """The facts about each lift."""
        self._lifts = {name: _WatchedLift(about) for name, about in lifts.items()}
        self._wires = {controller: _WireHealth() for about in lifts.values() for controller in about.controllers}

    # -- Witness

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        """Record the physical state, and check for outputs that stay on too long."""
        watched = self._lifts[lift]
        if truth is not watched.history.last:
            self._changed(at, watched, truth)
        disobeyed = any(fault.name in WRITE_FAULTS and math.isinf(fault.ended_at) for fault in watched.faults)
        cut_off = self._is_cut_off(watched, at)
        if disobeyed or cut_off:
            watched.clean_since = at
        if disobeyed or cut_off or any(self._wires[name].fails for name in watched.about.controllers):
            watched.lost_s += max(0.0, at - watched.looked_at)
        watched.looked_at = at
        if watched.on_since:
            self._check_outputs(at, lift, watched, truth)
        while watched.claims and at - watched.claims[0][0] > REGISTERS_WITHIN_S:
            self._check_confirmation(lift, watched, at, watched.claims.popleft())

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """Compare a published state with the physical state."""
        watched = self._lifts[lift]
        watched.state = state
        self.judged += 1
        if state.quality is not Quality.LIVE:
            return
        if state.age_s is None or not self._is_fresh(watched, at):
            text = f"the state looks current, and no answer of the last {watched.about.max_age_s:g} s supports it"
            self.report(at, lift, "stale", text)
        shown = state_data(state)
        floors = {state.floor} if state.robot_door is RobotDoor.OPEN else set()
        floors |= {str(shown["current_floor"])} if shown["door_state"] == DOOR_OPEN else set()
        self.invitations += len(floors)
        truth = watched.history.last
        if floors and truth is not None and truth.mode in MODES_WITHOUT_ROBOTS - watched.about.shows.modes:
            self.excuse_finding(lift, "said open in a forbidden mode", unreported_mode(truth.mode))
        self._check_state(at, lift, watched, state, floors)

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Check that the mode allows a press now."""
        watched = self._lifts[lift]
        watched.pressed_at |= dict.fromkeys(commands, at)
        truth = watched.history.last
        if truth is None:
            return
        names = ", ".join(sorted(commands))
        if (
            truth.mode in MODES_WITHOUT_ROBOTS
            and (for_s := self._known_for(watched, watched.mode_since, at)) is not None
        ):
            text = f"{names}, {for_s:.2f} s after the mode became {truth.mode}"
            if truth.mode not in watched.about.shows.modes:
                self.excuse_finding(lift, "pressed in a forbidden mode", unreported_mode(truth.mode))
            elif not self._was_frozen(lift, "pressed in a forbidden mode", watched.mode_since, at):
                self.report(at, lift, "pressed in a forbidden mode", text, SuspectValues.MODE)
        barred = truth.bars & watched.about.shows.bars
        if barred and (for_s := self._known_for(watched, watched.bars_since, at)) is not None:
            text = f"{names}, {for_s:.2f} s after {', '.join(sorted(barred))} kept robots off"
            if not self._was_frozen(lift, "pressed while kept off", watched.bars_since, at):
                self.report(at, lift, "pressed while kept off", text)

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """Record which data reached the manager."""
        came = b"".join(data for _, data in exchange.answers)
        usable = exchange.right is not None and came.startswith(exchange.right)
        arrives = exchange.answers[0][0] if exchange.answers else math.inf
        request = parse_request(exchange.request, timed_coils=True)
        read = (controller, request.unit, request.table, request.address, request.count)
        self._track_wire(
            self._wires[controller],
            controller,
            at,
            arrives - exchange.sent_at,
            exchange,
            usable=usable,
            writes=request.is_write,
        )
        for watched in self._lifts.values():
            if controller not in watched.about.controllers:
                continue
            if not usable or exchange.faults or self._is_cut_off(watched, exchange.sent_at):
                watched.clean_since = max(at, arrives if arrives < math.inf else at)
            watched.last_exchange = exchange.sent_at
            if usable and not request.is_write and read in watched.about.blocks:
                kept = watched.newest.setdefault(read, deque(maxlen=MAX_KEPT_ANSWERS))
                kept.append((arrives, exchange.sent_at))
                self._note_first_reading(watched, exchange.sent_at)

    def on_event(self, at: float, event: Event) -> None:
        """Check the evidence of confirmed commands, and move the requests of a session that is handed over."""
        if isinstance(event, HandedOver):
            watched = self._lifts[event.lift]
            if event.holder in watched.requests:
                watched.requests[event.to] = watched.requests[event.holder]
            if event.holder in watched.forgotten:
                watched.forgotten.add(event.to)
        if isinstance(event, CommandEnded) and event.outcome.result is Result.CONFIRMED:
            watched, outcome = self._lifts[event.lift], event.outcome
            proofs = watched.about.shows.proofs.get(outcome.command.kind)
            if proofs is not None and outcome.proof not in proofs:
                text = f"{outcome.command} is reported as confirmed by {outcome.proof}; valid on this map: {', '.join(sorted(proofs))}"
                self.report(at, event.lift, "confirmed by what proves nothing", text)
            pressed_at = watched.pressed_at.get(outcome.command.name, at - HISTORY_S)
            watched.claims.append((at, pressed_at, outcome))

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """Record the last request of each holder, and since when its floor is requested."""
        if refused is not None:
            return
        watched, holder = self._lifts[request.lift], request.holder
        if request.floor != watched.floor:
            watched.floor, watched.floor_since = request.floor, at
        last, before = watched.requests.get(holder, (request, request))
        if request.robot is RobotWord.IN_PLACE or request.floor != last.floor:
            # a robot without a handshake shows by its next floor that it is inside
            watched.in_place_at[holder] = at
        watched.requests[holder] = request, before if last.floor == request.floor else last
        watched.forgotten.discard(holder)

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Record which findings the fault excuses, and until when."""
        for lift, watched in self._lifts.items():
            if change.fault == RESTART:
                watched.restarted_at = at
                watched.unrequested.clear()  # nothing could be released while the manager was down
            if isinstance(change.fault, ForgottenRecords) and lift in change.fault.lifts:
                watched.forgotten.update(watched.requests)
            if change.where not in (lift, *watched.about.controllers):
                continue
            watched.clean_since = at
            watched.troubles += 1 if change.began else -1
            watched.troubled_until = at + MODE_ENDS_WITHIN_S
            if change.where == lift:
                self._track_fault(watched, change, at)

    def is_clean(self, lift: str, at: float, for_s: float) -> bool:
        """Whether every request to this lift has been answered correctly and obeyed for this long."""
        watched = self._lifts[lift]
        return not watched.troubles and at - watched.clean_since > for_s

    def request_of(self, lift: str, holder: Holder) -> FloorRequest | None:
        """Return the last request of a holder that was accepted."""
        requests = self._lifts[lift].requests.get(holder)
        return None if requests is None else requests[0]

    def is_foreign_write(self, lift: str, command: str, at: float) -> bool:
        """Whether somebody else writes this command, or did so recently."""
        return at <= self._lifts[lift].foreign.get(command, -math.inf)

    def was_misled(self, lift: str, since: float, names: frozenset[str], command: str = "") -> str | None:
        """Return which of these faults was present after `since` and affects the command; None if none was."""
        for fault in self._lifts[lift].faults:
            if fault.name in names and fault.ended_at >= since and fault.touches(command):
                return fault.name
        return None

    def frozen_by(self, lift: str, since: float, at: float) -> str | None:
        """Return which fault has kept the registers as they were before `since`; None if none has."""
        for fault in self._lifts[lift].faults:
            if fault.name in FROZEN_FAULTS and fault.since <= since + ANSWER_TAKES_S and at <= fault.until:
                return fault.name
        return None

    # -- how it is judged

    def _changed(self, at: float, watched: _WatchedLift, truth: Truth) -> None:
        """Record a physical state that may differ from the last one."""
        before = watched.history.last
        watched.history.add(at, truth)
        # under these faults a published state may show the lift as it was when the fault began
        still = (fault.since for fault in watched.faults if fault.name in FROZEN_FAULTS)
        watched.history.forget(min([at - HISTORY_S, *still]))
        if before is None or before.mode is not truth.mode:
            watched.mode_since = at
        barred = truth.bars & watched.about.shows.bars
        if not barred:
            watched.bars_since = math.inf
        elif math.isinf(watched.bars_since):
            watched.bars_since = at
        if before is not None and before.given == truth.given:
            return
        given = frozenset(truth.given)
        for output in given - watched.on_since.keys():
            watched.on_since[output] = at
        for output in watched.on_since.keys() - given:
            del watched.on_since[output]
            watched.unrequested.pop(output, None)
            watched.stuck.pop(output[0], None)

    def _track_fault(self, watched: _WatchedLift, change: FaultChange, at: float) -> None:
        name = fault_name(change.fault)
        excuse = watched.about.excuses.get(name)
        command = change.fault.command if isinstance(change.fault, ForeignWriter) else ""
        if command:
            watched.foreign[command] = math.inf if change.began else at + FOREIGN_CLEARED_S
        if excuse is None:
            return
        # a present fault is kept even if it excuses nothing any more
        watched.faults = [
            one for one in watched.faults if math.isinf(one.ended_at) or at - max(one.until, one.ended_at) <= HISTORY_S
        ]
        if change.began:
            until = math.inf if excuse.within_s is None else at + excuse.within_s
            began = _Fault(name, excuse.kinds, at, until, command)
            if name in FROZEN_FAULTS:
                # what another fault has put into the registers stays there
                began.kinds = began.kinds.union(*(one.kinds for one in watched.faults if one.since <= at <= one.until))
                began.until, began.unread_within_s = math.inf, excuse.within_s
            watched.faults.append(began)
            return
        for fault in watched.faults:
            if (fault.name, fault.command, fault.ended_at) == (name, command, math.inf):
                fault.ended_at = at
                if math.isinf(fault.until) and SuspectValues.OUTPUT in fault.kinds and not command:
                    # an output that was not released meanwhile stays on until the next comparison of outputs
                    watched.stuck |= dict.fromkeys((on for on, _ in watched.on_since), at + FOREIGN_CLEARED_S)
                fault.until = min(fault.until, at + AFTER_EFFECT_S.get(name, SETTLES_S))
                return

    @staticmethod
    def _note_first_reading(watched: _WatchedLift, requested_at: float) -> None:
        """From the first complete reading of frozen registers on, the time runs in which they must be noticed."""
        for fault in watched.faults:
            if fault.unread_within_s is not None and all(
                block in watched.newest and watched.newest[block][-1][1] >= fault.since
                for block in watched.about.blocks
            ):
                fault.until = min(fault.until, requested_at + fault.unread_within_s)
                fault.unread_within_s = None

    def _track_wire(
        self,
        wire: _WireHealth,
        controller: str,
        at: float,
        took_s: float,
        exchange: Exchange,
        *,
        usable: bool,
        writes: bool,
    ) -> None:
        timeout_s = min(about.timeout_s.get(controller, math.inf) for about in self.lifts.values())
        wire.fails = not usable or took_s > timeout_s
        if writes and (wire.fails or exchange.faults):
            wire.failed_writes += 1
        if not wire.fails and (took_s >= wire.slow_s or at - wire.slow_at > SLOW_FOR_S):
            wire.slow_s, wire.slow_at = took_s, at

    @staticmethod
    def _is_cut_off(watched: _WatchedLift, at: float) -> bool:
        """Whether the wire is silent because of a fault. A manager that sends nothing without a fault has no excuse."""
        troubled = watched.troubles > 0 or at < watched.troubled_until
        return troubled and at - watched.last_exchange > max(SILENT_S, 3 * watched.about.poll_s)

    def _check_state(
        self, at: float, lift: str, watched: _WatchedLift, state: LiftState, floors: set[str | None]
    ) -> None:
        """Compare a live state with the lift since its data was requested, and under frozen registers since the fault began."""
        since = at - (state.age_s or 0.0) - ROUNDING_S
        truths = list(watched.history.during(since, at))
        found = list(_false_claims(state, watched.about, truths, floors)) if truths else []
        if not found:
            return
        for fault in watched.faults:
            # once the registers move again nothing tells that an answer from before that was of frozen ones
            is_to_be_noticed = fault.until < at < fault.ended_at
            if fault.name in FROZEN_FAULTS and since <= fault.ended_at and not is_to_be_noticed:
                wider = list(watched.history.during(min(since, fault.since), at))
                still = {rule for rule, _, _ in _false_claims(state, watched.about, wider, floors)}
                for rule, _, _ in found:
                    if rule not in still:
                        self.excuse_finding(lift, rule, fault.name)
                found = [one for one in found if one[0] in still]
        for rule, text, wrong in found:
            self.report(at, lift, rule, f"{text}; {state.age_s:.2f} s old", wrong)

    @staticmethod
    def _known_for(watched: _WatchedLift, since: float, at: float) -> float | None:
        """Return how long a condition has lasted that the manager must know by now; None if it need not know it yet."""
        for_s, clean_s = at - since, at - max(since, watched.clean_since)
        known = clean_s > MODE_KNOWN_WITHIN_S or for_s > watched.about.max_age_s + ANSWER_TAKES_S
        return for_s if known else None

    def _was_frozen(self, lift: str, rule: str, since: float, at: float) -> bool:
        """Excuse a finding about a change after the registers froze: they cannot show it."""
        name = self.frozen_by(lift, since, at)
        if name is not None:
            self.excuse_finding(lift, rule, name)
        return name is not None

    def _is_fresh(self, watched: _WatchedLift, at: float) -> bool:
        """Whether every block of the poll was answered correctly within the maximum age of a reading."""
        oldest = at - watched.about.max_age_s - ROUNDING_S
        return all(
            any(
                arrives <= at + ROUNDING_S and requested >= oldest
                for arrives, requested in reversed(watched.newest.get(read, ()))
            )
            for read in watched.about.blocks
        )

    def _check_outputs(self, at: float, lift: str, watched: _WatchedLift, truth: Truth) -> None:
        failed_writes = sum(self._wires[name].failed_writes for name in watched.about.controllers)
        for output in tuple(watched.on_since):
            name, floor = output
            if name in watched.about.fleeting:
                continue
            if self._is_requested(watched, name, floor, truth, at):
                watched.unrequested.pop(output, None)
                continue
            unrequested = watched.unrequested.setdefault(output, _UnrequestedOutput(at, watched.lost_s, failed_writes))
            since = unrequested.since
            if name == "robot_mode" and not truth.standing:
                watched.under_way_at = at
            if name == "robot_mode":
                since = max(since, min(self._stands_unknown_at(watched, at), since + watched.about.arrive_within_s))
            hindered_s = watched.lost_s - unrequested.lost_s
            hindered_s += RETRIES_WITHIN_S * (failed_writes - unrequested.failed_writes)
            if at - since - hindered_s > self._limit_s(watched, name, truth):
                text = f"{name} is on without a request for {at - unrequested.since:.1f} s, {hindered_s:.1f} s of them hindered"
                if not self._is_excused(watched, lift, name, at):
                    self.report_unless_excused(
                        Finding(at, lift, "output on too long", text, SuspectValues.OUTPUT), about=name
                    )
                watched.unrequested[output] = _UnrequestedOutput(at, watched.lost_s, failed_writes)

    @staticmethod
    def _stands_unknown_at(watched: _WatchedLift, at: float) -> float:
        """Return when the manager last could not know that the car stands: it moved, readings failed, or nothing that changes was shown."""
        return at if _is_car_hidden(watched, at) else max(watched.under_way_at, watched.clean_since)

    def _limit_s(self, watched: _WatchedLift, name: str, truth: Truth) -> float:
        """Return how long an output may stay on without a request.

        Robot mode is not dropped under way, and `robot_left` stays on for as long as the lift needs it.
        """
        slow_s = max(self._wires[controller].slow_s for controller in watched.about.controllers)
        if name == "robot_left" or (name == "robot_mode" and not truth.standing):
            return MODE_ENDS_WITHIN_S + watched.about.arrive_within_s
        least_s = MODE_ENDS_WITHIN_S if name == "robot_mode" else RELEASES_WITHIN_S
        return least_s + watched.about.pulses_s.get(name, 0.0) + RELEASE_EXCHANGES * slow_s

    def _is_excused(self, watched: _WatchedLift, lift: str, name: str, at: float) -> bool:
        if self.is_foreign_write(lift, name, at):
            self.excuse_finding(lift, "output on too long", "foreign_writer")
        elif at <= watched.stuck.get(name, -math.inf):
            self.excuse_finding(lift, "output on too long", "left on unseen")
        else:
            return False
        return True

    def excuse_finding(self, lift: str, rule: str, why: str) -> None:
        """Count a finding that a fault excuses; every excuse is reported."""
        key = (lift, rule, why)
        self.excused[key] = self.excused.get(key, 0) + 1

    def _is_requested(self, watched: _WatchedLift, name: str, floor: int, truth: Truth, at: float) -> bool:
        state, about = watched.state, watched.about
        if state is None or state.holder is None:
            return False
        if state.quality is Quality.LIVE and (truth.mode in about.shows.modes or truth.bars & about.shows.bars):
            return False
        on_s = at - watched.on_since[name, floor]
        requests = watched.requests.get(state.holder)
        if requests is None:
            # the request came over a face that the judge does not see
            return not name.startswith("hold_door") or on_s <= about.max_session_hold_s
        report_due = watched.pressed_at.get("robot_in_place", -math.inf) < watched.in_place_at.get(
            state.holder, -math.inf
        )
        if name.startswith("hold_door") and _is_car_hidden(watched, at):
            # it is kept for a robot that may be in the door
            truth = replace(truth, at=None)
        remembered = [requests]
        if state.holder in watched.forgotten:
            last, before = requests
            remembered += ((replace(one, hold_door=True), before) for one in (last, before))
        return any(
            is_output_requested(about, name, floor, truth, pair, on_s=on_s, report_due=report_due)
            for pair in remembered
        )

    def _check_confirmation(self, lift: str, watched: _WatchedLift, at: float, claim: _Confirmation) -> None:
        claimed_at, pressed_at, outcome = claim
        if self._had_effect(watched, outcome.command, pressed_at, at):
            return
        text = f"{outcome.command} is reported as confirmed by {outcome.proof}, and had no effect"
        by_motion = outcome.proof is Proof.EFFECT and outcome.command.kind in _CALLS
        if by_motion and self._started_towards(watched, outcome.command, pressed_at, claimed_at):
            self.excuse_finding(lift, "confirmed without effect", FOR_OTHERS)
            return
        if outcome.proof is Proof.READBACK and (mode := self._unreported_mode(watched, pressed_at, at)) is not None:
            # the register has the call, and the lift ignores it in that mode
            self.excuse_finding(lift, "confirmed without effect", unreported_mode(mode))
            return
        since = min(pressed_at, watched.floor_since)
        only = MISLEADING_FAULTS if by_motion else None
        name = outcome.command.name
        finding = Finding(claimed_at, lift, "confirmed without effect", text, SuspectValues.EFFECT)
        self.report_unless_excused(finding, since=since, only=only, about=name)

    @staticmethod
    def _unreported_mode(watched: _WatchedLift, since: float, until: float) -> Mode | None:
        """Return a mode without robots that the lift was in between these times and that its map does not show."""
        modes = (truth.mode for truth in watched.history.during(since, until))
        return next((mode for mode in modes if mode in MODES_WITHOUT_ROBOTS - watched.about.shows.modes), None)

    @staticmethod
    def _started_towards(watched: _WatchedLift, command: Command, pressed_at: float, claimed_at: float) -> bool:
        """Whether the car stood at the reading before the press, and started towards the floor of the call before the claim.

        Without a motion signal a car seems to stand until it reaches another floor.
        """
        since = pressed_at - watched.about.max_age_s
        if not watched.about.shows.motion:
            since = watched.history.floor_since(since)
        truths = list(watched.history.during(since, claimed_at))
        return command.floor is not None and starts_towards(reversed(truths), command.floor, watched.about.floors)

    def _had_effect(self, watched: _WatchedLift, command: Command, since: float, at: float) -> bool:
        truths = list(watched.history.during(since, at))
        if command.kind in _CALLS:
            came = truths[-1].passed != command.floor == truths[0].passed
            return came or any(command.floor in truth.calls or command.floor == truth.at for truth in truths)
        return any(command.name in truth.commands for truth in truths)

    def report(self, at: float, lift: str, rule: str, text: str, wrong: SuspectValues | None = None) -> None:
        """Add a finding, unless a current fault excuses what is `wrong`."""
        self.report_unless_excused(Finding(at, lift, rule, text, wrong))

    def report_unless_excused(
        self, finding: Finding, *, since: float | None = None, only: frozenset[str] | None = None, about: str = ""
    ) -> None:
        """Add a finding, unless a fault excuses what is wrong: a current fault, or one that was present after `since`.

        `only` names the faults that count; None for all. `about` is the command of the finding: faults of other commands do not count.
        """
        at, wrong = finding.at, finding.wrong
        began = at if since is None else since
        for fault in self._lifts[finding.lift].faults if wrong is not None else ():
            may = (only is None or fault.name in only) and fault.touches(about)
            if may and wrong in fault.kinds and fault.since - ROUNDING_S <= at and began <= fault.until:
                self.excuse_finding(finding.lift, finding.rule, fault.name)
                return
        self.findings.append(finding)


def _false_claims(
    state: LiftState, about: LiftUnderTest, truths: Sequence[Truth], floors: set[str | None]
) -> Iterator[FalseClaim]:
    """Yield every claim of a live state that was true at none of these moments: first its invitations to `floors`."""
    shows, was = about.shows, truths[-1]
    for floor in floors:
        if floor is None or not any(truth.open_at == floor for truth in truths):
            yield (
                "said open and was not",
                f"published as open at {floor}; the car was {truth_text(was)}",
                SuspectValues.OPEN,
            )
        elif shows.permits and not any(truth.awaits and truth.open_at == floor for truth in truths):
            yield (
                "said open without permission",
                f"published as open at {floor}; the lift did not let the robot in or out",
                SuspectValues.OPEN,
            )
        if all(truth.mode in shows.modes for truth in truths):
            yield "said open in a forbidden mode", f"the mode was {was.mode}", SuspectValues.MODE
    yield from false_claims(state, shows, truths)


def _is_car_hidden(watched: _WatchedLift, at: float) -> bool:
    """Whether nothing that is read shows where the car is, or that it stands.

    Registers that stand still show a car that moved when they came to a stand as moving. A manager that was started since has not
    seen their heartbeat beat, and believes nothing else that they show.
    """
    return any(
        fault.name == "frozen_heartbeat"
        or (
            fault.name in FROZEN_FAULTS
            and (
                not all(truth.standing for truth in watched.history.during(fault.since, fault.since))
                or (watched.about.shows.beats_within_s is not None and watched.restarted_at >= fault.since)
            )
        )
        for fault in watched.faults
        if at <= fault.ended_at
    )


def unreported_mode(mode: Mode) -> str:
    """Return the name of the fault for a mode without a signal."""
    return f"in_mode.{mode}"


def _is_call(command: str) -> bool:
    return command.partition(".")[0] in ("go_to", "call", "go")
