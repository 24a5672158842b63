"""Requests a lift as a robot's fleet adapter does, and follows the outcome. Pure: times are seconds of any clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum, unique

from lift_manager.rmf.messages import (
    AGV_MODE,
    DOOR_CLOSED,
    DOOR_OPEN,
    END_SESSION,
    HUMAN_MODE,
    LiftRequest,
    LiftState,
    Time,
)
from lift_manager.rmf.watch import describe_state, join_names, short

REPEAT_S = 1.0
"""Until a request is repeated, while it is not fulfilled; fleet adapters repeat theirs with every LiftState."""
FOUND_WITHIN_S = 5.0
"""Until the first state of the lift. With Fast DDS on the other side, discovery can take 3 s."""
PASSED_ON_WITHIN_S = 3.0
"""A supervisor passes a request on at once or with the next LiftState (open-rmf 1.4), which comes once a second at least."""


@unique
class AttemptEnd(Enum):
    """How an attempt ended."""

    FULFILLED = "fulfilled"
    REFUSED = "refused"
    """Nothing was requested, for example because there is no such lift or floor."""
    TOO_LATE = "too late"


@dataclass(frozen=True)
class OperatorRequest:
    """A request from the command line."""

    lift: str
    floor: str | None
    """None to end the session."""
    session: str
    open_door: bool = True
    human: bool = False
    direct: bool = False
    """Send it to the lift adapter itself, whether there is a supervisor or not."""
    instead_of: str | None = None
    """A session that the supervisor serves but that does not hold the lift: it is ended there right before each request. A restarted
    supervisor may serve a robot outside without end, and drop the requests of the robot in the car."""


class Attempt:
    """One request from its first message to its outcome.

    `listeners` returns how many lift adapters may be there; `send` publishes a request, to the supervisor or directly.
    """

    def __init__(
        self,
        requested: OperatorRequest,
        listeners: Callable[[], int],
        send: Callable[[LiftRequest, bool], None],
        *,
        within_s: float,
        now: float,
    ) -> None:
        self._requested = requested
        self._listeners = listeners
        self._send = send
        self._began = now
        self._until = now + within_s
        self._within_s = within_s
        self._found_at: float | None = None
        self._direct = requested.direct
        self._is_relayed = False
        self._sent_at = -math.inf
        self._first_sent_at = math.inf
        self._is_sent = False
        self._others: dict[str, None] = {}
        self._state: LiftState | None = None
        self._last_line = ""
        self.end: AttemptEnd | None = None

    def handle_state(self, state: LiftState, now: float) -> Iterator[str]:
        """Process the state of a lift; yield lines for people."""
        if self._is_over():
            return
        if state.lift_name != self._requested.lift:
            self._others[state.lift_name] = None
            return
        self._state = state
        if self._found_at is None:
            self._found_at = now
            floor = self._requested.floor
            if floor is not None and floor not in state.available_floors:
                yield f"{short(state.lift_name)} has no floor {short(floor)!r}; it has {join_names(state.available_floors)}"
                self.end = AttemptEnd.REFUSED
                return
        if (line := describe_state(state)) != self._last_line:
            self._last_line = line
            yield line
        served = self._requested.instead_of is None or self._is_relayed
        if self._is_sent and served and self._is_fulfilled(state):
            yield from self._fulfilled()

    def handle_relayed_request(self, request: LiftRequest) -> Iterator[str]:
        """Process a request to lift adapters; yield lines for people."""
        ours = request.lift_name == self._requested.lift and request.session_id == self._requested.session
        if ours and not self._direct and not self._is_relayed and self._is_sent:
            self._is_relayed = True
            yield "a lift supervisor passes the request on"

    def tick(self, wall_s: float, now: float) -> Iterator[str]:
        """Send what is due; yield lines for people. `wall_s` is the time in the request."""
        if self._is_over():
            return
        if self._found_at is None:
            if now >= self._began + FOUND_WITHIN_S:
                yield self._not_found()
                self.end = AttemptEnd.REFUSED
            return
        if not self._direct and not self._is_relayed:
            yield from self._choose_recipient(now, self._found_at)
        if self._is_over():
            return
        if now >= self._until:
            yield f"not within {self._within_s:g} s: {self._explain()}"
            self.end = AttemptEnd.TOO_LATE
        elif now >= self._sent_at + REPEAT_S:
            yield from self._send_request(wall_s, now)

    def _send_request(self, wall_s: float, now: float) -> Iterator[str]:
        other, state = self._requested.instead_of, self._state
        if other is not None and not self._is_relayed:
            if state is not None and state.session_id == other:
                yield f"{short(other)} holds the lift itself, so its session is not ended for another"
                self.end = AttemptEnd.REFUSED
                return
            self._send(self._end_request(other, wall_s), False)
        self._first_sent_at = min(self._first_sent_at, now)
        self._sent_at, self._is_sent = now, True
        self._send(self._lift_request(wall_s), self._direct)

    def _choose_recipient(self, now: float, found_at: float) -> Iterator[str]:
        """Send to the supervisor, which decides whose turn it is, or directly if nothing passes requests on (open-rmf 1.2)."""
        if self._requested.instead_of is not None:
            if now >= self._first_sent_at + PASSED_ON_WITHIN_S:
                yield f"not passed on within {PASSED_ON_WITHIN_S:g} s: {self._explain()}"
                self.end = AttemptEnd.TOO_LATE
            return
        if now < found_at + PASSED_ON_WITHIN_S or self._is_held_by_another():
            return
        if not self._listeners():
            yield "nobody receives it: neither a lift supervisor nor a lift adapter reads requests here; are domain, namespace and topics right?"
            self.end = AttemptEnd.REFUSED
            return
        self._direct, self._sent_at = True, -math.inf
        yield "no lift supervisor passes it on: sending it to the lift adapter directly"

    def _is_over(self) -> bool:
        return self.end is not None

    def _is_held_by_another(self) -> bool:
        """Whether another session holds the lift, for which a supervisor passes on nothing else."""
        return self._state is not None and self._state.session_id not in ("", self._requested.session)

    def _lift_request(self, wall_s: float) -> LiftRequest:
        requested = self._requested
        ends = requested.floor is None
        return LiftRequest(
            lift_name=requested.lift,
            request_time=Time.of(wall_s),
            session_id=requested.session,
            request_type=END_SESSION if ends else HUMAN_MODE if requested.human else AGV_MODE,
            destination_floor=requested.floor or "",
            door_state=DOOR_OPEN if requested.open_door and not ends else DOOR_CLOSED,
        )

    def _end_request(self, session: str, wall_s: float) -> LiftRequest:
        return LiftRequest(self._requested.lift, Time.of(wall_s), session, END_SESSION, "", DOOR_CLOSED)

    def _is_fulfilled(self, state: LiftState) -> bool:
        requested = self._requested
        if requested.floor is None:
            return state.session_id != requested.session
        door = DOOR_OPEN if requested.open_door else DOOR_CLOSED
        return (
            state.session_id == requested.session
            and state.current_floor == requested.floor
            and state.door_state == door
        )

    def _fulfilled(self) -> Iterator[str]:
        self.end = AttemptEnd.FULFILLED
        requested = self._requested
        if requested.floor is None:
            yield f"{short(requested.lift)} is not held by {short(requested.session)} any more"
            return
        yield (
            f"{short(requested.lift)} is there, and {short(requested.session)} holds it until `lift-manager rmf request {short(requested.lift)}"
            f" --end --session {short(requested.session)}`"
        )

    def report_open_session(self) -> Iterator[str]:
        """Yield how to end the session if this ended before the lift came: RMF's sessions stay until they are ended."""
        requested, state = self._requested, self._state
        if self.end in (AttemptEnd.FULFILLED, AttemptEnd.REFUSED) or requested.floor is None or not self._is_sent:
            return
        is_held = state is not None and state.session_id == requested.session
        holds = "holds the lift" if is_held else "may still get the lift"
        yield (
            f"{short(requested.session)} {holds}; end it with `lift-manager rmf request {short(requested.lift)} --end --session"
            f" {short(requested.session)}`"
        )

    def _not_found(self) -> str:
        published = join_names(tuple(self._others))
        return f"nobody publishes the state of a lift {short(self._requested.lift)!r}; published lifts: {published}"

    def _explain(self) -> str:
        """Explain the delay, as far as the lift's state shows it."""
        state, requested = self._state, self._requested
        if state is None:
            return "the lift publishes no state"
        if requested.instead_of is not None and not self._is_relayed:
            return f"either there is no lift supervisor, or {short(requested.instead_of)} is not the session it serves; `lift-manager rmf watch` shows that"
        if requested.floor is not None and self._is_held_by_another():
            return f"{short(state.session_id)} holds the lift; it is another's turn once that session has ended"
        if requested.floor is not None and not state.session_id:
            return "the lift did not accept the session; the log of its adapter has the reason"
        return describe_state(state)
