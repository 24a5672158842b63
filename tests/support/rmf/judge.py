"""The judge of the adapter: reads the simulator's physics and what went over the wires, never what the adapter believes.

The rules are those of open-rmf.md 1.6; `RULES` has each in a sentence.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest
from lift_manager.lift.events import RestrictionBegun, RestrictionEnded
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState as Shown
from lift_manager.rmf.messages import DOOR_OPEN, END_SESSION, MODE_OFFLINE, LiftRequest, LiftState
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from register_maps.frames import parse_request
from register_maps.words import Mode
from simulator.wire_faults import Exchange
from tests.support.rmf.timeline import Timeline

RULES: Mapping[str, str] = {
    "open": "OPEN at a floor only if the car stood there with its doors fully open when the data was read",
    "open for another": "OPEN only for the session that the manager holds the lift for, or for nobody",
    "open and not held": "OPEN for a session only while our hold is what keeps the door open",
    "open in fire": "never OPEN a second after a fire began",
    "door fell": "the door stays open while a robot that saw it open drives through it",
    "open too long": "OPEN stands for a session only while it has at least 30 s until the manager itself lets go of the door",
    "stale floor": "no car call but for a floor that the session on the wire wants",
    "storm": "a state that says nothing new goes out twice a second, and not for each request",
    "silent": "a state goes out at least once a second",
    "ended": "a session that was ended is in no further state; but for the time in which the manager cannot know of it",
    "not ended": "a session that its fleet has ended is over soon, whether or not the supervisor passes it on",
    "past the supervisor": "a session has the lift only if it was asked for on `lift_requests`",
    "stolen": "a session goes only by its END, or because something ended it",
    "lost": "a session that keeps asking for a free lift is granted",
    "robot mode": "robot mode does not fall while the car moves",
    "locked out": "no command is pressed, and never OPEN, a second after a person has locked the lift out",
    "never done": "every robot gets where it wants to go, and the lift is free at the end",
}

PERIOD_S = 0.5
READ_S = 0.05
"""Between the look of a device at itself and the arrival of its answer."""
PRESS_S = 1.0
"""How long ago a floor may have been wanted that is called: what is decided is on the wire well within."""
LOST_S = 4.0
"""How long a session may ask for a lift that nothing keeps from it."""
UNCHANGED_MOST = 12
"""States within five seconds that say nothing new: ten, and one at either edge."""
CHANGED_MOST = 40
"""States within five seconds that say something new. Chosen: a ride has about ten changes."""
LOOK_BACK_S = 5.0
ROUNDING_S = 1e-6
PASSES_ON_S = 2.0
"""What a supervisor has for passing on an END."""
FLEET_ENDS_S = 3.0
"""And within what the session is then over: a state and some messages later."""
FIRE_TAKES_S = 1.0
CLEAR_S = 30.0
"""A robot sets out on one OPEN and does not look again: from the last one on it has so long until the door falls."""
WORDS_OF_A_ROBOT = frozenset({"robot_in_place", "robot_left"})
"""What the lift may still be told of a robot that was in it."""
CALLS = frozenset({"go_to", "call", "go", "landing_call"})
FALLS_FOR = frozenset({Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.OUT_OF_SERVICE})


@dataclass(frozen=True)
class Found:
    """Something that must never happen."""

    at: float
    rule: str
    text: str

    def __str__(self) -> str:
        return f"{self.at:.3f} s: {self.rule}: {self.text}"


@dataclass
class _Session:
    """What arrived at the adapter of one session."""

    asked_at: float = -math.inf
    began_at: float = -math.inf
    """When it first asked since it was last ended."""
    ended_at: float = -math.inf
    asks: int = 0
    floor: str = ""
    fleet_asks: bool = False
    """Its fleet has asked for it on `adapter_lift_requests`."""
    fleet_ended_at: float = math.inf
    """When the adapter got the first END of its fleet since that last asked for it; infinite while it goes on."""

    @property
    def lives(self) -> bool:
        return self.asked_at > self.ended_at

    @property
    def asks_ever(self) -> bool:
        return self.asked_at > -math.inf

    @property
    def is_over(self) -> bool:
        return self.asks_ever and not self.lives


@dataclass
class Judge:
    """Of one lift. It is a `Witness` of the world, and hears what goes to and comes from the adapter."""

    lift: str
    """The site's name."""
    floors: Mapping[str, str]
    """Site's floor names to RMF's."""
    grace_s: float
    max_age_s: float
    holds: frozenset[str]
    """The map's door holds; empty where the lift has none."""
    tells_fire: bool = True
    """Whether anything that is read of the lift can tell of a fire."""
    silent_driving: bool = False
    """A robot does not ask while it drives (humble), so that a session that somebody else ended is over."""
    findings: list[Found] = field(default_factory=list)
    states: int = 0
    opens: int = 0
    presses: int = 0
    writes: int = 0
    requests: int = 0

    def __post_init__(self) -> None:
        self.hears: Callable[[], object] = _nobody
        """Called with each finding."""
        self.truth: Timeline[Truth | None] = Timeline(None)
        self.holder: Timeline[Holder | None] = Timeline(None)
        self.said: Timeline[LiftState | None] = Timeline(None)
        """Without their times."""
        self.wanted: dict[str, Timeline[str | None]] = defaultdict(lambda: Timeline(None))
        """What the owner of a session really wants, in RMF's words."""
        self.sessions: dict[str, _Session] = defaultdict(_Session)
        self.excused: Timeline[frozenset[str]] = Timeline(frozenset())
        """What goes on that explains what is otherwise a finding: `down`, `offline`, `fire`, `kept off`, `cut`."""
        self.excused_until: dict[str, float] = defaultdict(lambda: -math.inf)
        self._unchanged: deque[float] = deque()
        self._changed: deque[float] = deque()
        self._ends: deque[float] = deque(maxlen=200)
        self._last_state_at = math.inf
        self._free_since = math.inf
        self._adapter_since = -math.inf
        self._fire = False
        self._locked_since = math.inf
        self._locked_out_at = -math.inf
        """When the newest lockout began, whether or not it has ended since."""
        self._opened: tuple[float, LiftState] | None = None
        """When OPEN was last said for a session, until the door falls or the session wants something else."""

    # -- what the world tells

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        if lift != self.lift:
            return
        before = self.truth.last
        self.truth.add(at, truth)
        self._judge_fall(at, truth)
        if before is None or not before.robot_mode or truth.robot_mode or before.standing or truth.standing:
            return
        if truth.mode not in FALLS_FOR and not self._is_excused("down", "offline", at=at, lately_s=10.0):
            self._find(at, "robot mode", f"it fell while the car moved ({truth})")

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        if lift == self.lift and at > self._locked_since + PRESS_S and commands - WORDS_OF_A_ROBOT:
            self._find(at, "locked out", f"{', '.join(sorted(commands))} is pressed")
        if lift != self.lift or not commands & CALLS or (truth := self.truth.last) is None:
            return
        for command, index in truth.given:
            if command in commands & CALLS:
                self.presses += 1
                self._judge_call(at, list(self.floors.values())[index])

    def on_state(self, at: float, lift: str, state: Shown) -> None:
        if lift == self.lift:
            if at > self._locked_since + PRESS_S and state.robot_door is RobotDoor.OPEN:
                self._find(at, "locked out", f"the door is said to be open at {state.floor}")
            self.holder.add(at, state.holder)
            told = state.restrictions
            kept_off = bool(told.fire_latched or told.lockout or kept_for(state) is not None)
            if kept_off != ("kept off" in self.excused.last):
                self.excuse(at, "kept off", on=kept_off)

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        self.writes += parse_request(exchange.request, timed_coils=True).is_write

    def on_event(self, at: float, event: Event) -> None:
        """Know of lockouts; states are told by `on_state`."""
        match event:
            case RestrictionBegun(lift=self.lift):
                self._locked_since = self._locked_out_at = at
            case RestrictionEnded(lift=self.lift):
                self._locked_since = math.inf
            case _:
                pass

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """Another face requests the lift."""
        if request.lift == self.lift:
            self.wants(at, str(request.holder), self.floors[request.floor])

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Excuses are given by name, see `excuse`."""

    # -- what the world of RMF tells

    def excuse(self, at: float, why: str, *, on: bool, lasts_s: float = 0.0) -> None:
        """Something happens that makes the lift, the manager or the adapter do otherwise; it is over `lasts_s` after its end."""
        self.excused.add(at, self.excused.last | {why} if on else self.excused.last - {why})
        self.excused_until[why] = math.inf if on else at + lasts_s

    def wants(self, at: float, session: str, floor: str | None) -> None:
        """Note what the owner of a session wants."""
        self.wanted[session].add(at, floor)

    def arrived(self, at: float, request: LiftRequest) -> None:
        """Note a request that reaches the adapter."""
        self.requests += 1
        session = self.sessions[request.session_id]
        opened = None if self._opened is None else self._opened[1]
        is_end = request.request_type == END_SESSION
        wants_else = opened is not None and (is_end or request.destination_floor != opened.current_floor)
        if opened is not None and wants_else and request.session_id == opened.session_id:
            self._opened = None  # from its own word on it needs the door no more
        if is_end:
            session.ended_at = at
            session.asks = 0
            self._ends.append(at)
            return
        is_gone = (
            session.fleet_ended_at <= at
            and self.said.last is not None
            and self.said.last.session_id != request.session_id
        )
        if not session.lives or is_gone:
            # the supervisor may be quicker than the fleet's own word, or ask again for one that ended without it
            session.began_at, session.fleet_ended_at = at, math.inf
        session.asked_at, session.floor = at, request.destination_floor
        session.asks += 1

    def fleet_sent(self, at: float, request: LiftRequest) -> None:
        """Note what reaches the adapter on `adapter_lift_requests`."""
        session = self.sessions[request.session_id]
        if request.request_type == END_SESSION:
            session.fleet_ended_at = min(session.fleet_ended_at, at)
        else:
            session.fleet_asks, session.fleet_ended_at = True, math.inf

    def state_sent(self, at: float, state: LiftState) -> None:
        """Judge a LiftState."""
        self.states += 1
        timeless = replace(state, lift_time=replace(state.lift_time, sec=0, nanosec=0))
        before = self.said.last
        self._judge_rate(at, changed=timeless != before)
        self.said.add(at, timeless)
        if state.door_state == DOOR_OPEN:
            self._judge_open(at, state)
            if state.session_id and self.holds:
                self._opened = at, state
        self._judge_session(at, "" if before is None else before.session_id, state)
        self._judge_lost(at, state)

    def quiet(self, at: float) -> None:
        """The adapter is gone: no state is due, and the next one knows of no END."""
        self._last_state_at = math.inf
        self._free_since = math.inf
        self._adapter_since = at
        for session in self.sessions.values():
            session.fleet_ended_at = math.inf

    def drove(self, since: float, at: float, session: str, floor: str) -> None:
        """Judge a robot's way through the door; it began because a LiftState let it."""
        excuses = {"down", "offline", "fire", "kept off"}
        # one that somebody else has ended is over while it drives, if it does not ask, or somebody else was quicker
        others = any(one is not None and one.session_id not in ("", session) for one in self.said.during(since, at))
        was_ended = self.excused_until["ended"] >= since and (self.silent_driving or others)
        if was_ended or self._is_excused(*excuses, at=at, lately_s=at - since):
            return
        site = next(name for name, rmf in self.floors.items() if rmf == floor)
        for began, truth in self.truth.spans(since, at):
            if truth is not None and truth.open_at != site:
                self._find(max(began, since), "door fell", f"{session} drives at {floor} since {since:.3f}: {truth}")
                return

    def finish(self, at: float, *, waiting: str, held: bool) -> None:
        """Judge the end: who did not get done, and whether the lift is still held."""
        if waiting:
            self._find(at, "never done", waiting)
        if held or (self.said.last is not None and self.said.last.session_id):
            self._find(at, "never done", f"the lift is not free: {self.said.last}, held by {self.holder.last}")

    # -- rules

    def _judge_open(self, at: float, state: LiftState) -> None:
        self.opens += 1
        told_at = state.lift_time.sec + state.lift_time.nanosec * 1e-9
        since = max(told_at, at - self.max_age_s) - READ_S
        truths = [truth for truth in self.truth.during(since, at) if truth is not None]
        open_at = {None if truth.open_at is None else self.floors[truth.open_at] for truth in truths if truth.standing}
        if state.current_floor not in open_at:
            self._find(at, "open", f"at {state.current_floor} for {state.session_id!r}, and it was {truths}")
        modes = {None if one is None else one.mode for one in self.truth.during(at - FIRE_TAKES_S, at)}
        if self.tells_fire and modes == {Mode.FIRE}:
            self._find(at, "open in fire", f"at {state.current_floor}")
        holders = set(self.holder.during(since, at))
        ours = Holder("rmf", state.session_id) if state.session_id else None
        if ours is not None and ours not in holders:
            self._find(at, "open for another", f"for {state.session_id!r}, and the manager has it for {holders}")
        elif ours is None and not any(one is None or _session_of(one) != str(one) for one in holders):
            self._find(at, "open for another", f"for nobody, and the manager has it for {holders}")
        if ours is not None and self.holds and not any(truth.commands & self.holds for truth in truths):
            self._find(at, "open and not held", f"at {state.current_floor} for {state.session_id!r}")

    def _judge_fall(self, at: float, truth: Truth) -> None:
        """The door falls for its holder's own word, for a reason that nobody knows beforehand, or no sooner than it was announced."""
        if self._opened is None:
            return
        said_at, state = self._opened
        if truth.open_at is not None and self.floors[truth.open_at] == state.current_floor:
            return
        self._opened = None
        fleet_ended = self.sessions[state.session_id].fleet_ended_at <= at
        excuses = ("down", "offline", "fire", "kept off", "taken", "adapter", "ended")
        excused = truth.mode in FALLS_FOR or self._is_excused(*excuses, at=at, lately_s=at - said_at)
        if at - said_at < CLEAR_S and not fleet_ended and not excused:
            left_s = at - said_at
            self._find(
                at,
                "open too long",
                f"{left_s:.2f} s before the door fell at {state.current_floor} for {state.session_id!r}",
            )

    def _judge_call(self, at: float, floor: str) -> None:
        since = at - PRESS_S
        shown = {state.session_id for state in self.said.during(since, at) if state is not None}
        names = {_session_of(one) for one in self.holder.during(since, at) if one is not None}
        # the manager may press before the adapter has heard that it said yes
        first = {name for name, session in self.sessions.items() if session.lives} if not shown - {""} else set()
        heard = (shown | names | first) & self.wanted.keys()
        wanted = {session: set(self.wanted[session].during(since, at)) for session in heard}
        if not any(floor in floors for floors in wanted.values()) and not self._is_left_over(at, floor):
            self._find(at, "stale floor", f"{floor} is called, and wanted is {wanted}")

    def _is_left_over(self, at: float, floor: str) -> bool:
        """Whether a supervisor still asks for it because a fire or a person, and no END, ended the session of its robot.

        The fleet adapter says so only once the lift is shown as its own again (open-rmf 1.5, L1700).
        """
        asked = any(one.floor == floor and at - one.asked_at < PRESS_S for one in self.sessions.values())
        return asked and self._is_excused("fire", "kept off", "down", at=at, lately_s=PRESS_S)

    def _judge_rate(self, at: float, *, changed: bool) -> None:
        if at - self._last_state_at > 2 * PERIOD_S:
            self._find(at, "silent", f"for {at - self._last_state_at:.2f} s")
        self._last_state_at = at
        times, most = (self._changed, CHANGED_MOST) if changed else (self._unchanged, UNCHANGED_MOST)
        if changed:
            # each END is news, and so is what the supervisor makes of it
            most += 2 * sum(ended_at > at - LOOK_BACK_S for ended_at in self._ends)
        times.append(at)
        while times[0] <= at - LOOK_BACK_S:
            times.popleft()
        if len(times) > most:
            self._find(
                at, "storm", f"{len(times)} states in {LOOK_BACK_S:g} s, {'all changes' if changed else 'unchanged'}"
            )
            times.clear()

    def _judge_session(self, at: float, before: str, state: LiftState) -> None:
        book, session = self.sessions, state.session_id
        if session in book:
            self._judge_ended(at, session, is_offline=state.current_mode == MODE_OFFLINE)
        if session in book and book[session].fleet_asks and not book[session].asks_ever:
            self._find(at, "past the supervisor", f"{session!r} was never asked for on lift_requests")
        if before == session or before not in book or not book[before].asks_ever:
            return
        was_ended = (
            book[before].ended_at >= book[before].began_at
            or at - book[before].fleet_ended_at >= PASSES_ON_S - ROUNDING_S
        )
        ended_since = book[before].ended_at >= self._said_since(before)
        taken = self._is_excused("down", "fire", "kept off", "adapter", "taken", at=at, lately_s=2.0)
        # the manager does not take an offline lift for anybody: who was only promised it has to ask again
        promised = self._is_excused("offline", at=at, lately_s=2.0) and self.holder.last != Holder("rmf", before)
        # it goes once a robot in the door was given its time, although the lockout may be over by then
        locked_out = at - self._locked_out_at <= CLEAR_S + READ_S
        if not (was_ended or ended_since or taken or promised or locked_out):
            self._find(at, "stolen", f"{before!r} becomes {session!r}, and nobody had ended it")

    def _judge_ended(self, at: float, name: str, *, is_offline: bool) -> None:
        """An adapter that has just begun does not know of an END before, and a manager that is away not of one meanwhile."""
        session, is_away = self.sessions[name], "down" in self.excused.last
        if self._is_excused("down", at=at, lately_s=0.0) and (is_offline or not is_away):
            return
        restarted = self._is_excused("adapter", at=at, lately_s=self.grace_s + 2.0)
        if session.is_over and session.ended_at >= self._adapter_since and not restarted:
            self._find(at, "ended", f"{name!r} was ended at {session.ended_at:.3f}")
        if at - session.fleet_ended_at > FLEET_ENDS_S:
            self._find(at, "not ended", f"{name!r} was ended by its fleet at {session.fleet_ended_at:.3f}")

    def _said_since(self, session: str) -> float:
        """Since when it has been said without a break."""
        since = math.inf
        for began, state in self.said.spans(-math.inf, math.inf):
            if state is not None and state.session_id == session:
                since = began
            elif since < math.inf:
                break
        return since

    def _judge_lost(self, at: float, state: LiftState) -> None:
        kept = self._is_excused("down", "offline", "fire", "kept off", "adapter", "taken", at=at, lately_s=LOST_S)
        if state.session_id or state.current_mode == MODE_OFFLINE or kept:
            self._free_since = math.inf
            return
        self._free_since = min(self._free_since, at)
        for name, session in self.sessions.items():
            patient = at - max(session.began_at, self._free_since) > LOST_S and at - session.asked_at < PERIOD_S
            if name and session.lives and session.asks > 1 and patient:
                self._find(at, "lost", f"{name!r} asks since {session.began_at:.3f}, and the lift is free")
                self._free_since = math.inf
                return

    def _is_excused(self, *why: str, at: float, lately_s: float) -> bool:
        """Whether one of these goes on, or did not long ago."""
        if any(self.excused_until[one] >= at for one in why):
            return True
        return any(not names.isdisjoint(why) for names in self.excused.during(at - lately_s, at))

    def _find(self, at: float, rule: str, text: str) -> None:
        self.findings.append(Found(at, rule, text))
        self.hears()


def _session_of(holder: Holder) -> str:
    """Return the session of this RMF that a holder is, or how another face, or another RMF, is shown."""
    return holder.name if holder.face == "rmf" and "@" not in holder.name else str(holder)


def _nobody() -> None:
    """Hears nothing."""


def kept_for(state: Shown) -> Holder | None:
    """Return whose robot may be in the car of a lift that nobody else gets because of that."""
    aboard = state.restrictions.maybe_aboard
    return None if aboard == state.holder else aboard
