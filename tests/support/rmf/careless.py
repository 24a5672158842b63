"""Adapters that break one rule each: a judge that does not find them proves nothing. Each is made like `Adapter`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol

from lift_manager.plain.rmf import HeldBy, LiftView, SiteView
from lift_manager.rmf.adapter import Adapter, RmfOutput
from lift_manager.rmf.messages import DOOR_OPEN, END_SESSION, MODE_FIRE, MODE_OFFLINE, LiftRequest, LiftState
from lift_manager.rmf.port import UNREACHABLE, Answer, EndOfSession, Manager, ManagerRequest, SessionDemand

Clock = Callable[[], float]
TOGETHER_S = 0.05
DEAF_S = 10.0


class _Speaks(Protocol):
    """Changes what is published, knowing how the manager's lift is."""

    def __call__(self, state: LiftState, view: LiftView | None) -> LiftState | None: ...


class _Says(Adapter):
    """Publishes something else than it should; None is nothing at all."""

    def __init__(self, manager: Manager, out: RmfOutput, ros_time: Clock, says: _Speaks) -> None:
        self._view: LiftView | None = None

        def publish(state: LiftState) -> None:
            if (said := says(state, self._view)) is not None:
                out.publish(said)

        super().__init__(manager, RmfOutput(publish, out.alarm), ros_time)

    def on_site(self, site: SiteView, asked_at: float, now: float) -> None:
        (self._view,) = site.lifts
        super().on_site(site, asked_at, now)


HOLDS_FOR = 1
"""So many requests for the same floor are passed on as they are."""


class _Asks(Adapter):
    """Asks the manager something else than it should, one thing after the other; it takes the last answer for its own."""

    def __init__(
        self,
        manager: Manager,
        out: RmfOutput,
        ros_time: Clock,
        change: Callable[[ManagerRequest], tuple[ManagerRequest, ...]],
    ) -> None:
        self._real = manager
        self._change = change
        self._asked: ManagerRequest | None = None
        self._still: list[ManagerRequest] = []
        super().__init__(self, out, ros_time)

    def send(self, asked: ManagerRequest) -> None:
        self._asked = asked
        first, *self._still = self._change(asked)
        self._real.send(first)

    def on_answer(self, answer: Answer, now: float) -> None:
        if self._still and answer.code != UNREACHABLE:
            self._real.send(self._still.pop(0))
        elif self._asked is not None:
            super().on_answer(replace(answer, request=self._asked), now)


class ExecutesStaleFloors(Adapter):
    """Sends every floor of a replay to the lift."""

    def on_request_writer(self, now: float) -> None:
        pass


class PublishesPerRequest(Adapter):
    """Answers each request with a state."""

    def __init__(self, manager: Manager, out: RmfOutput, ros_time: Clock) -> None:
        self._last: LiftState | None = None

        def publish(state: LiftState) -> None:
            self._last = state
            out.publish(state)

        self._say = out.publish
        super().__init__(manager, RmfOutput(publish, out.alarm), ros_time)

    def on_request(self, request: LiftRequest, now: float) -> None:
        super().on_request(request, now)
        if self._last is not None:
            self._say(self._last)


class DropsEndBeforeRequest(Adapter):
    """Takes the newest of what comes together: an END is dropped when another session asks right after it."""

    def __init__(self, manager: Manager, out: RmfOutput, ros_time: Clock) -> None:
        self._end: tuple[LiftRequest, float] | None = None
        super().__init__(manager, out, ros_time)

    def on_request(self, request: LiftRequest, now: float) -> None:
        if request.request_type == END_SESSION and request.session_id:
            self._end = request, now + TOGETHER_S
            return
        if self._end is not None and request.session_id != self._end[0].session_id:
            self._end = None
        super().on_request(request, now)

    def tick(self, now: float) -> float:
        if self._end is not None and now >= self._end[1]:
            (request, _), self._end = self._end, None
            super().on_request(request, now)
        due = super().tick(now)
        return due if self._end is None else min(due, self._end[1])


class EndMovesTheCar(_Asks):
    """Takes an END_SESSION with a floor for a command to go there."""

    def __init__(self, manager: Manager, out: RmfOutput, ros_time: Clock) -> None:
        self._floors: Mapping[str, str] = {}
        self._end: LiftRequest | None = None
        super().__init__(manager, out, ros_time, self._with_floor)

    def on_site(self, site: SiteView, asked_at: float, now: float) -> None:
        self._floors = {rmf: floor for floor, rmf in site.lifts[0].floors.items()}
        super().on_site(site, asked_at, now)

    def on_request(self, request: LiftRequest, now: float) -> None:
        if request.request_type == END_SESSION and request.destination_floor in self._floors:
            self._end = request
        super().on_request(request, now)

    def _with_floor(self, asked: ManagerRequest) -> tuple[ManagerRequest, ...]:
        if isinstance(asked, EndOfSession) and self._end is not None and self._end.session_id == asked.session:
            floor, self._end = self._floors[self._end.destination_floor], None
            return (SessionDemand(asked.lift, asked.session, floor, hold_door=False),)
        return (asked,)


class IgnoresEndWithoutFloor(Adapter):
    """Checks the floor of an END, as the workshop's adapter does."""

    def on_request(self, request: LiftRequest, now: float) -> None:
        if request.request_type != END_SESSION or request.destination_floor:
            super().on_request(request, now)


class TakesAnyEnd(Adapter):
    """Ends whatever session there is, whoever says so."""

    def __init__(self, manager: Manager, out: RmfOutput, ros_time: Clock) -> None:
        self._session = ""
        super().__init__(manager, out, ros_time)

    def on_request(self, request: LiftRequest, now: float) -> None:
        if request.request_type != END_SESSION:
            self._session = self._session or request.session_id
        elif self._session:
            request, self._session = replace(request, session_id=self._session), ""
        super().on_request(request, now)


class ForgetsWhoComesNext(Adapter):
    """Hears nobody for a while after a session has ended."""

    def __init__(self, manager: Manager, out: RmfOutput, ros_time: Clock) -> None:
        self._deaf_until = -math.inf
        super().__init__(manager, out, ros_time)

    def on_request(self, request: LiftRequest, now: float) -> None:
        if request.request_type == END_SESSION:
            if request.session_id:
                self._deaf_until = now + DEAF_S
        elif now < self._deaf_until:
            return
        super().on_request(request, now)


class LetsAnybodySteal(Adapter):
    """Gives the lift to whoever asked last."""

    def __init__(self, manager: Manager, out: RmfOutput, ros_time: Clock) -> None:
        self._session = ""
        super().__init__(manager, out, ros_time)

    def on_request(self, request: LiftRequest, now: float) -> None:
        if request.request_type != END_SESSION and request.session_id != self._session:
            if self._session:
                super().on_request(replace(request, session_id=self._session, request_type=END_SESSION), now)
            self._session = request.session_id
        super().on_request(request, now)


class DoesNotReadAlong(Adapter):
    """Takes what a supervisor passes on, and nothing that fleets send to it."""

    def on_fleet_request(self, request: LiftRequest, now: float) -> None:
        pass


class TakesWhatFleetsWant(Adapter):
    """Does what fleets ask of their supervisor, as LCI does."""

    def on_fleet_request(self, request: LiftRequest, now: float) -> None:
        self.on_request(request, now)


class EndsWhatGoesOn(Adapter):
    """Ends a session after an END of its fleet that was not passed on, though the fleet has asked for it since."""

    def on_fleet_request(self, request: LiftRequest, now: float) -> None:
        if request.request_type == END_SESSION:
            super().on_fleet_request(request, now)


class TakesAnotherRmf(Adapter):
    """Takes a session of another RMF for one of its own."""

    def on_site(self, site: SiteView, asked_at: float, now: float) -> None:
        lifts = tuple(
            lift if lift.holder is None else replace(lift, holder=replace(lift.holder, adapter=""))
            for lift in site.lifts
        )
        super().on_site(replace(site, lifts=lifts), asked_at, now)


class ForgetsWhatIsUndelivered(Adapter):
    """Publishes no session any more whose END waits for the manager: a robot of humble then says it no more."""

    def __init__(self, manager: Manager, out: RmfOutput, ros_time: Clock) -> None:
        self._over: set[str] = set()

        def publish(state: LiftState) -> None:
            out.publish(replace(state, session_id="") if state.session_id in self._over else state)

        super().__init__(manager, RmfOutput(publish, out.alarm), ros_time)

    def on_request(self, request: LiftRequest, now: float) -> None:
        if request.request_type == END_SESSION:
            self._over.add(request.session_id)
        else:
            self._over.discard(request.session_id)
        super().on_request(request, now)


def _cleared_on_arrival(state: LiftState, view: LiftView | None) -> LiftState:
    arrived = state.door_state == DOOR_OPEN and state.current_floor == state.destination_floor
    return replace(state, session_id="") if arrived else state


def _open_for_another(state: LiftState, view: LiftView | None) -> LiftState:
    foreign = view is not None and view.holder is not None and view.holder.face != "rmf"
    return replace(state, door_state=DOOR_OPEN) if foreign and _is_open(view) else state


def _open_for_whom_it_was_not(state: LiftState, view: LiftView | None) -> LiftState:
    other = view is not None and view.holder not in (None, HeldBy("rmf", state.session_id))
    return replace(state, door_state=DOOR_OPEN) if other and state.session_id and _is_not_closed(view) else state


def _open_before_it_is(state: LiftState, view: LiftView | None) -> LiftState:
    opens = view is not None and view.live and view.standing and view.door == "moving" and state.current_floor
    return replace(state, door_state=DOOR_OPEN) if opens and state.session_id else state


def _forgets_offline(state: LiftState, view: LiftView | None) -> LiftState:
    return replace(state, session_id="") if state.current_mode == MODE_OFFLINE else state


def _is_open(view: LiftView | None) -> bool:
    return view is not None and view.live and view.standing and view.door == "open"


def _is_not_closed(view: LiftView | None) -> bool:
    return view is not None and view.live and view.standing and view.door != "closed"


def _open_until_fire_is_over() -> _Speaks:
    last: LiftState | None = None

    def say(state: LiftState, view: LiftView | None) -> LiftState:
        nonlocal last
        if state.current_mode == MODE_FIRE and last is not None and last.door_state == DOOR_OPEN:
            return replace(state, door_state=DOOR_OPEN)
        last = state
        return state

    return say


def _keeps_ended() -> _Speaks:
    last = ""

    def say(state: LiftState, view: LiftView | None) -> LiftState:
        nonlocal last
        said = replace(state, session_id=state.session_id or last)
        last = state.session_id
        return said

    return say


def _only_changes() -> _Speaks:
    last: LiftState | None = None

    def say(state: LiftState, view: LiftView | None) -> LiftState | None:
        nonlocal last
        before, last = last, state
        return None if before is not None and replace(before, lift_time=state.lift_time) == state else state

    return say


def _frozen() -> _Speaks:
    last: LiftState | None = None

    def say(state: LiftState, view: LiftView | None) -> LiftState:
        nonlocal last
        if state.current_mode != MODE_OFFLINE or last is None:
            last = state
        return last

    return say


def _says(make: Callable[[], _Speaks]) -> Callable[[Manager, RmfOutput, Clock], Adapter]:
    return lambda manager, out, ros_time: _Says(manager, out, ros_time, make())


def _without_grace(manager: Manager, out: RmfOutput, ros_time: Clock) -> Adapter:
    def change(asked: ManagerRequest) -> tuple[ManagerRequest, ...]:
        return (replace(asked, grace_s=0.0) if isinstance(asked, EndOfSession) else asked,)

    return _Asks(manager, out, ros_time, change)


def _lets_go_of_the_door(manager: Manager, out: RmfOutput, ros_time: Clock) -> Adapter:
    wanted: list[SessionDemand] = []

    def change(asked: ManagerRequest) -> tuple[ManagerRequest, ...]:
        if not isinstance(asked, SessionDemand):
            return (asked,)
        wanted[:] = [*(one for one in wanted if one == asked), asked]
        return (asked if len(wanted) <= HOLDS_FOR else replace(asked, hold_door=False),)

    return _Asks(manager, out, ros_time, change)


CARELESS: Mapping[str, Callable[[Manager, RmfOutput, Clock], Adapter]] = {
    "executes stale floors": ExecutesStaleFloors,
    "clears the session on arrival": _says(lambda: _cleared_on_arrival),
    "publishes per request": PublishesPerRequest,
    "says open while another face holds the lift": _says(lambda: _open_for_another),
    "says open to the next one while the last one has it": _says(lambda: _open_for_whom_it_was_not),
    "says open while the door moves": _says(lambda: _open_before_it_is),
    "says open in a fire": _says(_open_until_fire_is_over),
    "repeats the last state of an offline lift": _says(_frozen),
    "forgets the session of an offline lift": _says(lambda: _forgets_offline),
    "drops an END before another request": DropsEndBeforeRequest,
    "ignores an END without a floor": IgnoresEndWithoutFloor,
    "moves the car on END": EndMovesTheCar,
    "shows an ended session once more": _says(_keeps_ended),
    "takes an END for the session of another": TakesAnyEnd,
    "gives the lift to whoever asks": LetsAnybodySteal,
    "does not hear who comes next": ForgetsWhoComesNext,
    "has no grace": _without_grace,
    "lets go of the door after a while": _lets_go_of_the_door,
    "publishes changes only": _says(_only_changes),
    "does not read what fleets say": DoesNotReadAlong,
    "does what fleets want of their supervisor": TakesWhatFleetsWant,
    "ends a session that its fleet goes on with": EndsWhatGoesOn,
    "clears a session before the manager knows of its END": ForgetsWhatIsUndelivered,
    "takes the session of another RMF": TakesAnotherRmf,
}
"""By what they do wrong."""
