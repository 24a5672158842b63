"""The judge: compares what the manager says and does with what the simulated lifts really do.

It reads the simulator's own physics and the exchanges on the wire, and nothing that the manager believes, except the age
that it gives its own words: those may not be newer than the data that reached it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.model import Command, CommandKind, FloorName, Outcome, Proof, Result
from lift_manager.commissioning.detection import Lie
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.events import CommandEnded, Event
from lift_manager.domain.state import LiftState, Quality, RobotDoor
from lift_manager.lab.world.fault_names import fault_name
from lift_manager.lab.world.judged import Finding, Judged, Read
from lift_manager.lab.world.truth import History, Truth, in_words, sets_out
from lift_manager.lab.world.witness import Struck
from lift_manager.web.workshop import DOOR_OPEN, state_data
from register_maps.frames import parse_request
from register_maps.words import ROBOT_FORBIDDEN_MODES
from simulator.faults import ForeignWriter
from simulator.wire_faults import Exchange

ROUNDING_S = 1e-6
ANSWER_TAKES_S = 0.02
"""Between the moment at which a device looks at itself and the arrival of its answer, on a quick wire."""
KEPT_S = 30.0
"""How long the past is remembered; longer than any outcome takes to come, and than any window below."""
ANSWERS_KEPT = 256
"""Right answers that are remembered: more than are asked for within the age of any reading, and those still on their way."""
REGISTERS_WITHIN_S = 0.5
"""A controller registers a call with its next scan, and a car that sets out may have been seen before that."""
RELEASES_WITHIN_S = 6.0
"""How long an output may stay on that nobody wants, on a wire that works: retries of a release come up to 2 s apart, a pulse of
the map has its own width, and a slow trip of the car comes to its end before robot mode falls."""
MODE_KNOWN_WITHIN_S = 1.0
"""How soon a mode without robots is known on a wire that works: two polls, the second for a map read in several blocks."""
SILENT_S = 1.0
"""A wire on which nothing was asked for so long does not work: a lift is polled five times as often."""
FOREIGN_CLEARED_S = 70.0
"""What somebody else has pressed is let go of at most once a minute (`drivers.modbus.foreign`), and the release takes its time."""
LINGERS_S = {"reboot": 60.0, "lost_press": 30.0, "ignored_writes": 30.0, "ignored_writes.stored": 30.0}
"""How long some faults go on to be felt: a lift looks for its lowest floor after a restart, and a press that was lost stays so for as
long as it lasts, which is a ride where a robot's word is kept on."""
SETTLES_S = 2.0
"""How long what a fault has spoiled may show after its end: two readings, and the age of the last wrong one."""

_CALLS = frozenset({CommandKind.GO_TO, CommandKind.CALL, CommandKind.GO})
DISOBEYS = frozenset({"ignored_writes", "ignored_writes.stored", "stopped"})
"""Faults under which nobody can let go of an output, as nobody can on a wire that fails."""

MISREAD = frozenset({"says_wrong_floor", "contradicting_limits", "frozen_registers", "stopped", "homing", "reboot"})
"""Faults under which a car may look like one that goes, or has come, although it does not."""
FOR_OTHERS = "a car that set out for somebody else"
"""Where nothing but the car itself tells of a call, one that sets out the right way after a press is all that anybody can see."""


_Claim = tuple[float, float, Outcome]
"""When a command was said to be confirmed, when it was pressed, and what was said."""


@dataclass(slots=True)
class _Excuse:
    lies: tuple[Lie, ...]
    since: float
    until: float
    fault: str


@dataclass(slots=True)
class _Watched:
    """One lift, as the judge remembers it."""

    about: Judged
    history: History = field(default_factory=History)
    mode_since: float = -math.inf
    on_since: dict[str, float] = field(default_factory=dict)
    """Commands that are present at the controller, with the time since when."""
    unwanted_since: dict[str, tuple[float, Lie]] = field(default_factory=dict)
    """Of these, those that nobody wants, with the time since when, and whether it is for the mode alone."""
    excuses: list[_Excuse] = field(default_factory=list)
    active: list[_Excuse] = field(default_factory=list)
    newest: dict[Read, deque[tuple[float, float]]] = field(default_factory=dict)
    """Right answers to each block of the poll: when they arrive, and when they were asked for."""
    pressed_at: dict[str, float] = field(default_factory=dict)
    under_way_at: float = -math.inf
    """When robot mode was last on, and not wanted, under way: it is not dropped then."""
    claims: list[_Claim] = field(default_factory=list)
    """Commands that are said to be confirmed and are not judged yet."""
    stuck: set[str] = field(default_factory=set)
    """Outputs that a fault left on, and that nobody can see."""
    foreign: dict[str, float] = field(default_factory=dict)
    """Outputs that somebody else writes, with the time until which what was written may stand."""
    floor: FloorName | None = None
    """Of the last request that was accepted, and since when it is that one."""
    floor_asked_at: float = -math.inf
    troubles: int = 0
    """Faults that are present, on the lift and on its wires."""
    troubled_until: float = -math.inf
    clean_since: float = -math.inf
    last_exchange: float = -math.inf
    state: LiftState | None = None


class Oracle:
    """Judges every lift of a world; `findings` is what must never happen and did."""

    def __init__(self, lifts: Mapping[str, Judged]) -> None:
        self.findings: list[Finding] = []
        self.excused: dict[tuple[str, str, str], int] = {}
        """How often something was let pass, by lift, rule and fault: no excuse is silent."""
        self.judged = 0
        """How many published states were compared."""
        self.invitations = 0
        """How many of them said open."""
        self.judges = lifts
        """What is known of each lift."""
        self._lifts = {name: _Watched(about) for name, about in lifts.items()}

    # -- what is told

    def looked(self, at: float, lift: str, truth: Truth) -> None:
        """Take the truth, and see to outputs that stay on."""
        watched = self._lifts[lift]
        if truth is not watched.history.last:
            self._changed(at, watched, truth)
        disobeyed = any(excuse.fault in DISOBEYS for excuse in watched.active)
        if disobeyed or self._is_cut_off(watched, at):
            watched.clean_since = at
        if watched.on_since:
            self._outputs(at, lift, watched, truth)
        while watched.claims and at - watched.claims[0][0] > REGISTERS_WITHIN_S:
            self._claimed(lift, watched, at, watched.claims.pop(0))

    def published(self, at: float, lift: str, state: LiftState) -> None:
        """Compare what is said with what is so."""
        watched = self._lifts[lift]
        watched.state = state
        self.judged += 1
        if state.quality is not Quality.LIVE:
            return
        if state.age_s is None or not self._is_fresh(watched, at):
            self.find(
                at,
                lift,
                "stale",
                f"the state looks current, and no answer of the last {watched.about.max_age_s:g} s bears it out",
            )
        shown = state_data(state)
        floors = {state.floor} if state.robot_door is RobotDoor.OPEN else set()
        floors |= {str(shown["current_floor"])} if shown["door_state"] == DOOR_OPEN else set()
        for floor in floors:
            self.invitations += 1
            self._invitation(at, lift, watched, state, floor)

    def pressed(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """See whether anything may be pressed now."""
        watched = self._lifts[lift]
        watched.pressed_at |= dict.fromkeys(commands, at)
        truth = watched.history.last
        if truth is None or truth.mode not in ROBOT_FORBIDDEN_MODES:
            return
        for_s = at - watched.mode_since
        clean_s = at - max(watched.mode_since, watched.clean_since)
        if clean_s > MODE_KNOWN_WITHIN_S or for_s > watched.about.max_age_s + ANSWER_TAKES_S:
            names = ", ".join(sorted(commands))
            self.find(
                at,
                lift,
                "pressed in a forbidden mode",
                f"{names}, {for_s:.2f} s after the mode became {truth.mode}",
                Lie.MODE,
            )

    def exchanged(self, at: float, controller: str, exchange: Exchange) -> None:
        """Keep book of what reached the manager."""
        came = b"".join(data for _, data in exchange.answers)
        usable = exchange.right is not None and came.startswith(exchange.right)
        arrives = exchange.answers[0][0] if exchange.answers else math.inf
        request = parse_request(exchange.request, timed_coils=True)
        read = (controller, request.unit, request.table, request.address, request.count)
        for watched in self._lifts.values():
            if controller not in watched.about.controllers:
                continue
            if not usable or exchange.faults or self._is_cut_off(watched, exchange.sent_at):
                watched.clean_since = max(at, arrives if arrives < math.inf else at)
            watched.last_exchange = exchange.sent_at
            if usable and not request.is_write and read in watched.about.blocks:
                kept = watched.newest.setdefault(read, deque(maxlen=ANSWERS_KEPT))
                kept.append((arrives, exchange.sent_at))

    def heard(self, at: float, event: Event) -> None:
        """See whether what is said to be confirmed has happened."""
        if isinstance(event, CommandEnded) and event.outcome.result is Result.CONFIRMED:
            watched = self._lifts[event.lift]
            pressed_at = watched.pressed_at.get(event.outcome.command.name, at - KEPT_S)
            watched.claims.append((at, pressed_at, event.outcome))

    def asked(self, at: float, ask: Ask, answer: Accepted | Refused) -> None:
        """Know since when the lift is wanted where it is: no press for that floor is older."""
        watched = self._lifts[ask.lift]
        if isinstance(answer, Accepted) and ask.floor != watched.floor:
            watched.floor, watched.floor_asked_at = ask.floor, at

    def struck(self, at: float, struck: Struck) -> None:
        """Know what cannot be detected, and how soon the rest must be."""
        for lift, watched in self._lifts.items():
            if struck.where not in (lift, *watched.about.controllers):
                continue
            watched.clean_since = at
            watched.troubles += 1 if struck.began else -1
            watched.troubled_until = at + RELEASES_WITHIN_S
            if struck.where == lift:
                self._is_faulty(watched, struck, at)

    def is_clean(self, lift: str, at: float, for_s: float) -> bool:
        """Whether everything that was asked of this lift was answered rightly and obeyed for so long."""
        watched = self._lifts[lift]
        return not watched.troubles and at - watched.clean_since > for_s

    def wanted_since(self, lift: str) -> float:
        """Since when the lift is wanted where it is wanted last."""
        return self._lifts[lift].floor_asked_at

    # -- how it is judged

    def _changed(self, at: float, watched: _Watched, truth: Truth) -> None:
        """Take a truth that may be another one than the last."""
        before = watched.history.last
        watched.history.add(at, truth)
        watched.history.forget(at - KEPT_S)
        if before is None or before.mode is not truth.mode:
            watched.mode_since = at
        for name in truth.commands - watched.on_since.keys():
            watched.on_since[name] = at
        for name in watched.on_since.keys() - truth.commands:
            del watched.on_since[name]
            watched.unwanted_since.pop(name, None)
            watched.stuck.discard(name)

    def _is_faulty(self, watched: _Watched, struck: Struck, at: float) -> None:
        name = fault_name(struck.fault)
        detection = watched.about.detections.get(name)
        if isinstance(struck.fault, ForeignWriter):
            watched.foreign[struck.fault.command] = math.inf if struck.began else at + FOREIGN_CLEARED_S
        if detection is None:
            return
        if struck.began:
            until = math.inf if detection.within_s is None or detection.goes_on else at + detection.within_s
            watched.active.append(_Excuse(detection.lies, at, until, name))
            return
        for excuse in [one for one in watched.active if one.fault == name][:1]:
            watched.active.remove(excuse)
            if math.isinf(excuse.until) and Lie.OUTPUT in excuse.lies and not detection.goes_on:
                # what was not let go meanwhile, and cannot be read back, stays on until it is written again
                watched.stuck |= watched.on_since.keys()
            excuse.until = min(excuse.until, at + LINGERS_S.get(name, SETTLES_S))
            watched.excuses.append(excuse)

    @staticmethod
    def _is_cut_off(watched: _Watched, at: float) -> bool:
        """Whether nothing was asked for so long because nobody could ask; a manager that merely keeps silent has no excuse."""
        troubled = watched.troubles > 0 or at < watched.troubled_until
        return troubled and at - watched.last_exchange > max(SILENT_S, 3 * watched.about.poll_s)

    def _invitation(self, at: float, lift: str, watched: _Watched, state: LiftState, floor: FloorName | None) -> None:
        since = at - (state.age_s or 0.0) - ROUNDING_S
        truths = list(watched.history.during(since, at))
        if floor is None or not any(truth.open_at == floor for truth in truths):
            was = truths[-1]
            text = f"said open at {floor}, {state.age_s:.2f} s old; the car was {in_words(was)}"
            self.find(at, lift, "said open and was not", text, Lie.OPEN)
        if all(truth.mode in ROBOT_FORBIDDEN_MODES for truth in truths):
            self.find(at, lift, "said open in a forbidden mode", f"the mode was {truths[0].mode}", Lie.MODE)

    def _is_fresh(self, watched: _Watched, at: float) -> bool:
        """Whether every block of the poll was rightly answered within the age of a reading."""
        oldest = at - watched.about.max_age_s - ROUNDING_S
        return all(
            any(
                arrives <= at + ROUNDING_S and asked >= oldest
                for arrives, asked in reversed(watched.newest.get(read, ()))
            )
            for read in watched.about.blocks
        )

    def _outputs(self, at: float, lift: str, watched: _Watched, truth: Truth) -> None:
        for name in tuple(watched.on_since):
            if name in watched.about.fleeting:
                continue
            if self._is_wanted(watched, name, truth, at):
                watched.unwanted_since.pop(name, None)
                continue
            held = watched.state is not None and watched.state.holder is not None
            why = Lie.MODE if held and truth.mode in ROBOT_FORBIDDEN_MODES else Lie.OUTPUT
            since, before = watched.unwanted_since.setdefault(name, (at, why))
            if before is Lie.MODE and why is Lie.OUTPUT:
                # the manager may not know of the mode; that the session is over it knows from now on
                since, _ = watched.unwanted_since[name] = at, why
            if name == "robot_mode" and not truth.standing:
                watched.under_way_at = at
            if at - max(since, watched.clean_since, watched.under_way_at) > self._limit_s(watched, name, truth):
                text = f"{name} is on, and nobody has wanted it for {at - since:.1f} s"
                if not self._is_let_pass(watched, lift, name, at):
                    self.find(at, lift, "output on too long", text, why)
                watched.unwanted_since[name] = at, why

    @staticmethod
    def _limit_s(watched: _Watched, name: str, truth: Truth) -> float:
        """Return how long this may stay on although nobody wants it.

        Robot mode is not dropped under way, and that a robot left is told for as long as it takes.
        """
        if (name == "robot_mode" and not truth.standing) or name == "robot_left":
            return RELEASES_WITHIN_S + watched.about.arrive_within_s
        return RELEASES_WITHIN_S

    def _is_let_pass(self, watched: _Watched, lift: str, name: str, at: float) -> bool:
        fault = "foreign_writer" if at <= watched.foreign.get(name, -math.inf) else "left on unseen"
        if fault == "left on unseen" and name not in watched.stuck:
            return False
        self._let_pass(lift, "output on too long", fault)
        return True

    def _let_pass(self, lift: str, rule: str, why: str) -> None:
        key = (lift, rule, why)
        self.excused[key] = self.excused.get(key, 0) + 1

    def _is_wanted(self, watched: _Watched, name: str, truth: Truth, at: float) -> bool:
        state = watched.state
        if state is None or state.holder is None:
            return False
        if truth.mode in ROBOT_FORBIDDEN_MODES and state.quality is Quality.LIVE:
            return False
        on_s = at - watched.on_since[name]
        return not name.startswith("hold_door") or on_s <= watched.about.max_session_hold_s

    def _claimed(self, lift: str, watched: _Watched, at: float, claim: _Claim) -> None:
        claimed_at, pressed_at, outcome = claim
        if self._had_effect(watched, outcome.command, pressed_at, at):
            return
        text = f"{outcome.command} is said to be confirmed by {outcome.proof}, and had no effect"
        by_motion = outcome.proof is Proof.EFFECT and outcome.command.kind in _CALLS
        if by_motion and self._set_out(watched, outcome.command, pressed_at, claimed_at):
            self._let_pass(lift, "confirmed without effect", FOR_OTHERS)
            return
        since = min(pressed_at, watched.floor_asked_at)
        only = MISREAD if by_motion else None
        self.find(claimed_at, lift, "confirmed without effect", text, Lie.EFFECT, since=since, only=only)

    @staticmethod
    def _set_out(watched: _Watched, command: Command, pressed_at: float, claimed_at: float) -> bool:
        """Whether the car stood, from the reading before a press on, and set out for there before the claim.

        One whose motion nobody tells looks like one that stands until it comes to another floor.
        """
        since = pressed_at - watched.about.max_age_s
        if not watched.about.tells_motion:
            since = watched.history.floor_since(since)
        truths = list(watched.history.during(since, claimed_at))
        return command.floor is not None and sets_out(reversed(truths), command.floor, watched.about.floors)

    def _had_effect(self, watched: _Watched, command: Command, since: float, at: float) -> bool:
        truths = list(watched.history.during(since, at))
        if command.kind in _CALLS:
            came = truths[-1].passed != command.floor == truths[0].passed
            return came or any(command.floor in truth.calls or command.floor == truth.at for truth in truths)
        return any(command.name in truth.commands for truth in truths)

    def find(
        self,
        at: float,
        lift: str,
        rule: str,
        text: str,
        lie: Lie | None = None,
        *,
        since: float | None = None,
        only: frozenset[str] | None = None,
    ) -> None:
        """Note a finding, unless a fault excuses this kind of lie: one that is present, or was at some time after `since`.

        `only` names the faults that may; None: any.
        """
        began = at if since is None else since
        watched = self._lifts[lift]
        for excuse in (*watched.active, *watched.excuses):
            may = only is None or excuse.fault in only
            if may and lie in excuse.lies and excuse.since - ROUNDING_S <= at and began <= excuse.until:
                self._let_pass(lift, rule, excuse.fault)
                return
        self.findings.append(Finding(at, lift, rule, text, lie))
