"""Open-RMF's lift supervisor, one class for each behaviour that a distribution has. Written from open-rmf.md 1.4 alone.

They step by message: what each method returns is published on `lift_requests`, in that order. A restart is a new one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace

from lift_manager.rmf.messages import DOOR_CLOSED, END_SESSION, LiftRequest, LiftState, Time

Published = list[LiftRequest]


class Supervisor(ABC):
    """One request at a time for each lift, by its name."""

    replays: bool
    """Whether its subscription to `adapter_lift_requests` gets old requests when it starts (1.3: TRANSIENT_LOCAL from iron on)."""

    def __init__(self) -> None:
        self.current: dict[str, LiftRequest] = {}

    def asked(self, request: LiftRequest, now: float) -> Published:
        """Take what a fleet adapter, or rmf-web, published on `adapter_lift_requests`."""
        current = self.current.get(request.lift_name)
        if current is not None and current.session_id != request.session_id:
            return []
        if request.request_type != END_SESSION:
            self.current[request.lift_name] = request
            return self._taken(request, now)
        if current is None:
            return self._ended_without_session(request, now)
        del self.current[request.lift_name]
        return [self._end(request, now)]

    def heard(self, state: LiftState, now: float) -> Published:
        """Take a LiftState."""
        current = self.current.get(state.lift_name)
        if current is None:
            return self._idle(state, now)
        return [_stamped(current, now)] if self._repeats(current, state) else []

    def _taken(self, request: LiftRequest, now: float) -> Published:
        return [_stamped(request, now)]

    def _end(self, request: LiftRequest, now: float) -> LiftRequest:
        return _stamped(request, now)

    def _ended_without_session(self, request: LiftRequest, now: float) -> Published:
        return []

    @abstractmethod
    def _repeats(self, current: LiftRequest, state: LiftState) -> bool:
        """Whether a request that is already active is published again on this state."""

    @abstractmethod
    def _idle(self, state: LiftState, now: float) -> Published:
        """What a state of a lift is answered with for which there is no session."""


class Humble(Supervisor):
    """Publishes only on a LiftState; the END of the owner goes out once, as it came."""

    replays = False

    def _taken(self, request: LiftRequest, now: float) -> Published:
        return []

    def _end(self, request: LiftRequest, now: float) -> LiftRequest:
        return request

    def _repeats(self, current: LiftRequest, state: LiftState) -> bool:
        return current.destination_floor != state.current_floor or current.door_state != state.door_state

    def _idle(self, state: LiftState, now: float) -> Published:
        return []


class Iron(Supervisor):
    """Publishes on every LiftState, satisfied or not; with no session, an END for whatever session the state has, `""` too."""

    replays = True

    def _taken(self, request: LiftRequest, now: float) -> Published:
        return []

    def _repeats(self, current: LiftRequest, state: LiftState) -> bool:
        return True

    def _idle(self, state: LiftState, now: float) -> Published:
        return [_end_of(state, now)]


class Jazzy(Iron):
    """As iron, and every request of a fleet goes out at once, an END without a session too."""

    def _taken(self, request: LiftRequest, now: float) -> Published:
        return [_stamped(request, now)]

    def _ended_without_session(self, request: LiftRequest, now: float) -> Published:
        return [_stamped(request, now)]


class Kilted(Supervisor):
    """Kilted and main: at once, and again only on a mismatch; an END only for a session that should not be."""

    replays = True

    def _repeats(self, current: LiftRequest, state: LiftState) -> bool:
        if state.session_id != current.session_id or state.door_state != current.door_state:
            return True
        wanted = current.destination_floor
        return not (
            wanted == state.destination_floor or (not state.destination_floor and wanted == state.current_floor)
        )

    def _idle(self, state: LiftState, now: float) -> Published:
        return [_end_of(state, now)] if state.session_id else []


SUPERVISORS: Mapping[str, Callable[[], Supervisor]] = {
    "humble": Humble,
    "iron": Iron,
    "jazzy": Jazzy,
    "kilted": Kilted,
}
"""By distribution; rolling and main are as kilted."""


def _stamped(request: LiftRequest, now: float) -> LiftRequest:
    return replace(request, request_time=Time.of(now))


def _end_of(state: LiftState, now: float) -> LiftRequest:
    return LiftRequest(state.lift_name, Time.of(now), state.session_id, END_SESSION, state.current_floor, DOOR_CLOSED)
