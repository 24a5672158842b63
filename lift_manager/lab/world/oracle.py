"""The judge: compares what the manager says and does with what the simulated lifts really do.

It reads the simulator's own physics and the exchanges on the wire, and nothing that the manager believes, except the age
that it gives its own words: those may not be newer than the data that reached it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from drivers.model import Command, CommandKind, Result
from lift_manager.commissioning.detection import Detection, Lie
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.events import CommandEnded, Event
from lift_manager.domain.state import LiftState, Quality, RobotDoor
from lift_manager.lab.world.fault_names import fault_name
from lift_manager.lab.world.truth import History, Truth
from lift_manager.lab.world.witness import Struck
from register_maps.frames import parse_request
from register_maps.words import ROBOT_FORBIDDEN_MODES
from simulator.wire_faults import Exchange

ROUNDING_S = 1e-6
ANSWER_TAKES_S = 0.02
"""Between the moment at which a device looks at itself and the arrival of its answer, on a quick wire."""
KEPT_S = 30.0
"""How long the past is remembered; longer than any outcome takes to come, and than any window below."""
ANSWERS_KEPT = 256
"""Right answers that are remembered: more than are asked for within the age of any reading, and those still on their way."""
RELEASES_WITHIN_S = 6.0
"""How long an output may stay on that nobody wants, on a wire that works: retries of a release come up to 2 s apart, a pulse of
the map has its own width, and a slow trip of the car comes to its end before robot mode falls."""
MODE_KNOWN_WITHIN_S = 1.0
"""How soon a mode without robots is known on a wire that works: two polls, the second for a map read in several blocks."""
SILENT_S = 1.0
"""A wire on which nothing was asked for so long does not work: a lift is polled five times as often."""
FOREIGN_CLEARED_S = 70.0
"""What somebody else has pressed is let go of at most once a minute (`drivers.modbus.foreign`), and the release takes its time."""
SETTLES_S = 2.0
"""How long what a fault has spoiled may show after its end: two readings, and the age of the last wrong one."""

DISOBEYS = frozenset({"ignored_writes", "ignored_writes.stored", "stopped", "foreign_writer"})
"""Faults under which nobody can let go of an output, as nobody can on a wire that fails."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that must never happen."""

    at: float
    lift: str
    rule: str
    text: str
    lie: Lie | None = None
    """What kind of thing is wrong, where a fault may make it so."""

    def __str__(self) -> str:
        return f"{self.at:8.3f} s  {self.lift}: {self.rule}: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What the judge must know of one lift."""

    controllers: tuple[str, ...]
    max_age_s: float
    max_session_hold_s: float
    arrive_within_s: float
    detections: Mapping[str, Detection]
    """What becomes of each fault, by its name; without any, nothing is excused."""
    levels: frozenset[str]
    """Commands that stay on until they are let go."""
    fleeting: frozenset[str] = frozenset()
    """Commands that the device ends by itself."""


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
    unwanted_since: dict[str, float] = field(default_factory=dict)
    """Of these, those that nobody wants."""
    excuses: list[_Excuse] = field(default_factory=list)
    active: list[_Excuse] = field(default_factory=list)
    newest: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=ANSWERS_KEPT))
    """Right answers to reads: when they arrive, and when they were asked for."""
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
        disobeyed = any(excuse.fault in DISOBEYS for excuse in watched.active)
        if disobeyed or at - watched.last_exchange > SILENT_S:
            watched.clean_since = at
        if watched.on_since:
            self._outputs(at, lift, watched, truth)

    def published(self, at: float, lift: str, state: LiftState) -> None:
        """Compare what is said with what is so."""
        watched = self._lifts[lift]
        watched.state = state
        self.judged += 1
        if state.quality is not Quality.LIVE:
            return
        if state.age_s is None or not self._is_fresh(watched, at):
            self._find(
                at,
                lift,
                "stale",
                f"the state looks current, and no answer of the last {watched.about.max_age_s:g} s bears it out",
            )
        if state.robot_door is RobotDoor.OPEN:
            self.invitations += 1
            self._invitation(at, lift, watched, state)

    def pressed(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """See whether anything may be pressed now."""
        watched = self._lifts[lift]
        truth = watched.history.last
        if truth is None or truth.mode not in ROBOT_FORBIDDEN_MODES:
            return
        for_s = at - watched.mode_since
        clean_s = at - max(watched.mode_since, watched.clean_since)
        if clean_s > MODE_KNOWN_WITHIN_S or for_s > watched.about.max_age_s + ANSWER_TAKES_S:
            names = ", ".join(sorted(commands))
            self._find(
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
        is_read = not parse_request(exchange.request, timed_coils=True).is_write
        for watched in self._lifts.values():
            if controller not in watched.about.controllers:
                continue
            if not usable or exchange.faults or exchange.sent_at - watched.last_exchange > SILENT_S:
                watched.clean_since = max(at, arrives if arrives < math.inf else at)
            watched.last_exchange = exchange.sent_at
            if usable and is_read:
                watched.newest.append((arrives, exchange.sent_at))

    def heard(self, at: float, event: Event) -> None:
        """See whether what is said to be confirmed has happened."""
        if isinstance(event, CommandEnded) and event.outcome.result is Result.CONFIRMED:
            watched = self._lifts[event.lift]
            if not self._had_effect(watched, event.outcome.command, at):
                text = f"{event.outcome.command} is said to be confirmed by {event.outcome.proof}, and had no effect"
                self._find(at, event.lift, "confirmed without effect", text, Lie.EFFECT)

    def asked(self, at: float, ask: Ask, answer: Accepted | Refused) -> None:
        """Requests decide nothing here."""

    def struck(self, at: float, struck: Struck) -> None:
        """Know what cannot be detected, and how soon the rest must be."""
        name = fault_name(struck.fault)
        for lift, watched in self._lifts.items():
            if struck.where in watched.about.controllers and struck.where != lift:
                watched.clean_since = at
            if struck.where != lift:
                continue
            watched.clean_since = at
            detection = watched.about.detections.get(name)
            if detection is None:
                continue
            if struck.began:
                until = math.inf if detection.within_s is None or detection.goes_on else at + detection.within_s
                watched.active.append(_Excuse(detection.lies, at, until, name))
            else:
                self._over(watched, name, at)

    # -- how it is judged

    def _over(self, watched: _Watched, name: str, at: float) -> None:
        for excuse in [one for one in watched.active if one.fault == name][:1]:
            watched.active.remove(excuse)
            if math.isinf(excuse.until) and Lie.OUTPUT in excuse.lies and not watched.about.detections[name].goes_on:
                # what was not let go meanwhile, and cannot be read back, stays on until it is written again
                watched.excuses.append(replace(excuse, lies=(Lie.OUTPUT,)))
            settles_s = FOREIGN_CLEARED_S if name == "foreign_writer" else SETTLES_S
            excuse.until = min(excuse.until, at + settles_s)
            watched.excuses.append(excuse)

    def _invitation(self, at: float, lift: str, watched: _Watched, state: LiftState) -> None:
        since = at - (state.age_s or 0.0) - ROUNDING_S
        truths = list(watched.history.during(since, at))
        if not any(truth.open_at == state.floor for truth in truths):
            was = truths[-1]
            text = f"said open at {state.floor}, {state.age_s:.2f} s old; the car was {_words(was)}"
            self._find(at, lift, "said open and was not", text, Lie.OPEN)
        if all(truth.mode in ROBOT_FORBIDDEN_MODES for truth in truths):
            self._find(at, lift, "said open in a forbidden mode", f"the mode was {truths[0].mode}", Lie.MODE)

    def _is_fresh(self, watched: _Watched, at: float) -> bool:
        oldest = at - watched.about.max_age_s - ROUNDING_S
        return any(arrives <= at + ROUNDING_S and asked >= oldest for arrives, asked in reversed(watched.newest))

    def _outputs(self, at: float, lift: str, watched: _Watched, truth: Truth) -> None:
        for name in tuple(watched.on_since):
            if name in watched.about.fleeting:
                continue
            if self._is_wanted(watched, name, truth, at):
                watched.unwanted_since.pop(name, None)
                continue
            since = watched.unwanted_since.setdefault(name, at)
            limit_s = (
                RELEASES_WITHIN_S if name.startswith("hold_door") else RELEASES_WITHIN_S + watched.about.arrive_within_s
            )
            if at - max(since, watched.clean_since) > limit_s:
                text = f"{name} is on, and nobody has wanted it for {at - since:.1f} s"
                held = watched.state is not None and watched.state.holder is not None
                by_mode = held and truth.mode in ROBOT_FORBIDDEN_MODES
                self._find(at, lift, "output on too long", text, Lie.MODE if by_mode else Lie.OUTPUT)
                watched.unwanted_since[name] = at

    def _is_wanted(self, watched: _Watched, name: str, truth: Truth, at: float) -> bool:
        state = watched.state
        if state is None or state.holder is None:
            return False
        if truth.mode in ROBOT_FORBIDDEN_MODES and state.quality is Quality.LIVE:
            return False
        on_s = at - watched.on_since[name]
        return not name.startswith("hold_door") or on_s <= watched.about.max_session_hold_s

    def _had_effect(self, watched: _Watched, command: Command, at: float) -> bool:
        truths = watched.history.during(at - KEPT_S, at)
        if command.kind in (CommandKind.GO_TO, CommandKind.CALL, CommandKind.GO):
            return any(command.floor in truth.calls or command.floor == truth.at for truth in truths)
        return any(command.name in truth.commands for truth in truths)

    def _find(self, at: float, lift: str, rule: str, text: str, lie: Lie | None = None) -> None:
        watched = self._lifts[lift]
        for excuse in (*watched.active, *watched.excuses):
            if lie in excuse.lies and excuse.since - ROUNDING_S <= at <= excuse.until:
                key = (lift, rule, excuse.fault)
                self.excused[key] = self.excused.get(key, 0) + 1
                return
        self.findings.append(Finding(at, lift, rule, text, lie))


def _words(truth: Truth) -> str:
    where = f"at {truth.at}" if truth.at is not None else "between floors"
    doors = (
        "doors shut"
        if truth.doors_shut
        else "doors fully open"
        if truth.open_at is not None
        else "doors not fully open"
    )
    return f"{where}, {'standing' if truth.standing else 'moving'}, {doors}"
