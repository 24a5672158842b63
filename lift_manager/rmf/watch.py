"""Describes RMF's messages about lifts in words, to show why a robot waits. Pure: times are seconds of any clock."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from lift_manager.rmf.messages import (
    AGV_MODE,
    DOOR_CLOSED,
    DOOR_MOVING,
    DOOR_OPEN,
    END_SESSION,
    HUMAN_MODE,
    MODE_AGV,
    MODE_EMERGENCY,
    MODE_FIRE,
    MODE_HUMAN,
    MODE_OFFLINE,
    MODE_UNKNOWN,
    MOTION_DOWN,
    MOTION_STOPPED,
    MOTION_UNKNOWN,
    MOTION_UP,
    LiftRequest,
    LiftState,
    Time,
)

REPEAT_COUNT_S = 10.0
"""How often the count of a repeated message is reported while it goes on. Chosen."""
SILENT_S = 3.0
"""A lift without a state for this long is reported. This adapter publishes twice a second, others once."""
MAX_KEPT = 1000
"""How many lifts, and how many messages, are remembered: more than any site has. The oldest are forgotten first."""
TEXT_LIMIT = 80
"""Characters of a received text that are shown."""

_DOORS = {DOOR_CLOSED: "door closed", DOOR_MOVING: "door not open", DOOR_OPEN: "door open"}
_MOTIONS = {
    MOTION_STOPPED: "stopped",
    MOTION_UP: "going up",
    MOTION_DOWN: "going down",
    MOTION_UNKNOWN: "motion unknown",
}
_MODES = {
    MODE_UNKNOWN: "mode unknown",
    MODE_HUMAN: "HUMAN",
    MODE_AGV: "AGV",
    MODE_FIRE: "FIRE",
    MODE_OFFLINE: "OFFLINE",
    MODE_EMERGENCY: "EMERGENCY",
}
_TYPES = {AGV_MODE: "AGV", HUMAN_MODE: "HUMAN"}


@dataclass(frozen=True)
class Topics:
    """The names of the request topics."""

    to_supervisor: str
    to_lift: str


@dataclass
class _ReportedLine:
    """The latest line of one kind, and how often it was repeated since it was reported."""

    text: str
    reported_at: float
    repetitions: int = 0


class Watch:
    """Turns messages into lines; repetitions are only counted."""

    def __init__(self, topics: Topics, lift: str | None = None) -> None:
        """Without `lift`, all lifts are watched."""
        self._topics = topics
        self._lift = lift
        self._lines: OrderedDict[tuple[str, str, str], _ReportedLine] = OrderedDict()
        """By topic, lift and session as `short` shows them: what looks the same counts as the same. The latest is last."""
        self._states: OrderedDict[str, tuple[int, float]] = OrderedDict()
        """By lift as `short` shows it: a hash of its state, and when it was received. The latest is last."""
        self._silent: set[str] = set()

    @property
    def lifts(self) -> tuple[str, ...]:
        """The lifts whose state was received, as `short` shows them."""
        return tuple(self._states)

    def report_state(self, state: LiftState, now: float) -> Iterator[str]:
        """Yield a line if the state of a lift has changed."""
        if not self._is_watched(state.lift_name):
            return
        name, mark = short(state.lift_name), hash(replace(state, lift_time=Time()))
        before = self._states.pop(name, None)
        self._states[name] = (mark, now)
        if len(self._states) > MAX_KEPT:
            self._silent.discard(self._states.popitem(last=False)[0])
        if before is None:
            yield f"{name}: has the floors {', '.join(map(short, state.available_floors)) or 'none'}"
        if name in self._silent:
            self._silent.discard(name)
            yield f"{name}: its state is published again"
        if before is None or before[0] != mark:
            yield describe_state(state)

    def report_request(self, topic: str, request: LiftRequest, now: float) -> Iterator[str]:
        """Yield a line for a request, unless it repeats the previous one."""
        if not self._is_watched(request.lift_name):
            return
        key = (topic, short(request.lift_name), short(request.session_id))
        yield from self._report(key, f"{describe_request(request)}, {self._recipient(topic)}", now)

    def report_unreadable(self, text: str, now: float) -> Iterator[str]:
        """Yield a line for a message that cannot be decoded; `text` is the reason."""
        line = f"unreadable message: {short(text)}"
        yield from self._report(("", "", line), line, now)

    def report_elapsed(self, now: float) -> Iterator[str]:
        """Yield what only the passing of time shows: lifts that fell silent, and counts that are due."""
        for line in self._lines.values():
            yield from _report_repetitions(line, now, REPEAT_COUNT_S)
        for name, (_, at) in self._states.items():
            if now - at >= SILENT_S and name not in self._silent:
                self._silent.add(name)
                yield f"{name}: nobody has published its state for {SILENT_S:g} s"

    def report_counts(self, now: float) -> Iterator[str]:
        """Yield the counts that were not reported yet."""
        for line in self._lines.values():
            yield from _report_repetitions(line, now, 0.0)

    def _report(self, key: tuple[str, str, str], line: str, now: float) -> Iterator[str]:
        before = self._lines.get(key)
        if before is not None:
            self._lines.move_to_end(key)
            if before.text == line:
                before.repetitions += 1
                yield from _report_repetitions(before, now, REPEAT_COUNT_S)
                return
            yield from _report_repetitions(before, now, 0.0)
        self._lines[key] = _ReportedLine(line, now)
        yield line
        if len(self._lines) > MAX_KEPT:
            _, forgotten = self._lines.popitem(last=False)
            yield from _report_repetitions(forgotten, now, 0.0)

    def _is_watched(self, lift: str) -> bool:
        return self._lift is None or lift == self._lift

    def _recipient(self, topic: str) -> str:
        return "to the supervisor" if topic == self._topics.to_supervisor else "to the lift"


def _report_repetitions(line: _ReportedLine, now: float, every_s: float) -> Iterator[str]:
    if line.repetitions and now - line.reported_at >= every_s:
        more = "once more" if line.repetitions == 1 else f"{line.repetitions} more times"
        yield f"{line.text}: {more}"
        line.repetitions, line.reported_at = 0, now


def describe_state(state: LiftState) -> str:
    """Return one line about a lift: `lift1: at L2, door open, stopped, AGV, held by fleet/robot1`."""
    parts = [f"at {short(state.current_floor)}" if state.current_floor else "at no known floor"]
    if state.destination_floor not in ("", state.current_floor):
        parts.append(f"called to {short(state.destination_floor)}")
    parts.append(_DOORS.get(state.door_state, f"door_state {state.door_state}"))
    parts.append(_MOTIONS.get(state.motion_state, f"motion_state {state.motion_state}"))
    parts.append(_MODES.get(state.current_mode, f"mode {state.current_mode}"))
    parts.append(f"held by {short(state.session_id)}" if state.session_id else "free")
    return f"{short(state.lift_name)}: {', '.join(parts)}"


def describe_request(request: LiftRequest) -> str:
    """Return one line about a request: `lift1: fleet/robot1 requests L2, door open (AGV)`."""
    session = short(request.session_id) if request.session_id else "somebody without a session id"
    lift = short(request.lift_name)
    if request.request_type == END_SESSION:
        is_mistake = request.door_state == DOOR_OPEN and request.session_id
        # what request_lift.py of rmf_demos sends by mistake (open-rmf 1.6.13)
        hint = f" (END_SESSION, although it names {short(request.destination_floor)}, door open)" if is_mistake else ""
        return f"{lift}: {session} ends its session{hint}"
    door = {DOOR_CLOSED: "door closed", DOOR_OPEN: "door open"}.get(request.door_state)
    kind = _TYPES.get(request.request_type, f"request_type {request.request_type}")
    demand = f"{short(request.destination_floor) or 'no floor'}, {door or f'door_state {request.door_state}'}"
    return f"{lift}: {session} requests {demand} ({kind})"


def short(text: str) -> str:
    """Return a received text as it may appear in a line."""
    cut = text if len(text) <= TEXT_LIMIT else f"{text[:TEXT_LIMIT]}..."
    return cut if cut.isprintable() else repr(cut)[1:-1]


def join_names(lifts: Sequence[str]) -> str:
    """Return lifts or floors as a list in words."""
    return ", ".join(map(short, lifts)) if lifts else "none"
