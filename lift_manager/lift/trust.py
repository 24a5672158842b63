"""Whether the signals of a lift agree with each other: what its readings prove of the door signal, and what they contradict.

An inverted wire, or a table of floors that is shifted by one, reads like a lift that works. Only the car's own movement shows it:
a car travels with its doors closed, and comes to rest where it was called to. Until one trip has proved the door signal, an open
door is trusted only if it opens after our own press. What contradicts a trip is distrusted until three trips agree or a person has
looked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum, unique

from drivers.model import Capabilities, FloorName
from lift_manager.lift.call import Call, CallPhase
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.modes import robots_forbidden
from lift_manager.lift.observation import MOVING, Observation, is_shut
from register_maps.vocabulary import CALLS
from register_maps.words import Door, Motion, Side

OPEN_FOR_S = 3.0
"""How long a door whose signal is not proven has to read open. Chosen: a door that reverses under our hold takes less."""

ENDED_AFTER_S = 30.0
"""A car that has stood elsewhere for this long was not on its way to our call. Chosen: longer than people keep a door open in
passing."""

READINGS = 2
"""Readings of a travelling car that have to contradict its door: one may hold parts of different ages."""

TRIPS = 3
"""Trips in a row without a contradiction that end a distrust."""

_NOT_OPEN = frozenset({Door.CLOSED, Door.OPENING, Door.CLOSING, Door.MOVING})
"""Words of a door that is known not to be open."""


@unique
class Contradiction(StrEnum):
    """What is distrusted."""

    DOOR = "door"
    """A door read open while the car travelled."""
    CALL = "call"
    """Calls that were confirmed ended at another floor, twice with the same offset."""


@dataclass(frozen=True, slots=True)
class Distrust:
    """A contradiction that raised the alarm."""

    kind: Contradiction
    text: str
    since: datetime
    trips: int = 0
    """Trips without a contradiction since, in a row."""


@dataclass(frozen=True, slots=True)
class Trust:
    """What is known of the signals of one lift; it outlives the manager."""

    map_hash: str = ""
    """The map that it was learned with."""
    door_proven: bool = False
    """With this map every door has read closed throughout a trip."""
    distrust: tuple[Distrust, ...] = ()
    """One of a kind at most. Another map does not end it."""


@dataclass(frozen=True, slots=True)
class OwnCommands:
    """What of ours is on the lift when it is read."""

    call: Call | None = None
    """The call of the session."""
    pressed: bool = False
    """That call, or the hold of a door at its floor, was pressed."""
    door_believed: bool = False
    """The door at its floor was trusted to stand open for this session, with the present map."""


@dataclass(frozen=True, slots=True)
class _OpenDoor:
    """A door that has read open without a break."""

    floor: FloorName | None
    """The first one that was reported meanwhile."""
    from_rest: bool
    """It began while the car stood."""
    travelling: int = 0
    """Readings of a travelling car in it."""
    elsewhere: bool = False
    """The car has come to another floor meanwhile."""
    alarmed: bool = False
    """It has raised the alarm."""


@dataclass(frozen=True, slots=True)
class _Trip:
    """The outcome of a call that was pressed."""

    floor: FloorName
    start: FloorName | None
    """Where the car was."""
    confirmed: bool = False
    rests: tuple[FloorName, float] | None = None
    """The other floor where the car stands, and since when."""
    over: bool = False


@dataclass(frozen=True, slots=True)
class _Miss:
    """The last confirmed call that ended elsewhere."""

    called: FloorName
    ended: FloorName
    offset: int


@dataclass(frozen=True, slots=True)
class Track:
    """What the readings of one connection add up to."""

    floor: FloorName | None = None
    """The one that was reported last."""
    was_shut: bool = False
    """The reading before showed every door closed."""
    was_under_way: bool = False
    """And its motion signal said that the car moved."""
    between_shut: bool | None = None
    """Since the car reported no floor, every reading has; None while it reports one."""
    trip_shut: bool | None = None
    """At every change of the floor since the last stop every door read closed; None without such a change."""
    runs: Mapping[Side, _OpenDoor] = field(default_factory=dict)
    shut_here: bool = False
    """At this floor every door read closed just before our press, or since."""
    opened_at: float | None = None
    """When the doors of this floor first read open after that."""
    trip: _Trip | None = None
    miss: _Miss | None = None


@dataclass(frozen=True, slots=True)
class Judgement:
    """What one reading adds."""

    track: Track
    trust: Trust
    doubt: str = ""
    """Why a door that reads open is not trusted, as something to wait for; empty while it is trusted."""
    must_close: bool = False
    """Its door has to be read closed before it is trusted."""
    alarms: tuple[str, ...] = ()
    """What a person should know, each once."""
    pending: bool = False
    """Another reading with the same values would add to it."""


def _for_this_map(trust: Trust, capabilities: Capabilities) -> Trust:
    """Return what is remembered as far as it holds for this map."""
    return (
        trust
        if trust.map_hash == capabilities.map_hash
        else replace(trust, map_hash=capabilities.map_hash, door_proven=False)
    )


def printed(config: LiftConfig, name: str) -> str:
    """Return a signal or command with its addresses as the map writes them."""
    places = config.capabilities.printed.get(name, ())
    where = f"{places[0]} to {places[-1]}" if len(places) > 2 else " and ".join(places)
    return f"{name} ({where})" if where else name


def judge(
    config: LiftConfig,
    track: Track,
    trust: Trust,
    observation: Observation,
    own: OwnCommands,
    at: float,
    clock: datetime,
) -> Judgement:
    """Add a reading requested at `at`; `clock` is the time of day."""
    trust = _for_this_map(trust, config.capabilities)
    if robots_forbidden(observation.values.mode):
        # inspection and rescue move the car as they like
        return Judgement(Track(miss=track.miss), trust)
    if not observation.follows:
        track = Track(miss=track.miss)
    step = _TrackedReading(config, track, observation, at, clock)
    runs, trust, doors_alarms = step.doors(trust)
    trip_shut, trust, trips_alarms = step.trips(trust)
    trip, miss, trust, calls_alarms = step.calls(trust, own.call)
    shut_here, opened_at = step.opening(own)
    after = Track(
        floor=track.floor if observation.floor is None else observation.floor,
        was_shut=step.is_shut,
        was_under_way=observation.values.motion in MOVING,
        between_shut=step.between_shut,
        trip_shut=trip_shut,
        runs=runs,
        shut_here=shut_here,
        opened_at=opened_at,
        trip=trip,
        miss=miss,
    )
    doubt = _doubt(config, after, trust, observation, at)
    return Judgement(
        after,
        trust,
        doubt,
        must_close=bool(doubt)
        and not step.is_shut
        and (bool(trust.distrust) or not (shut_here or opened_at is not None)),
        alarms=(*doors_alarms, *trips_alarms, *calls_alarms),
        pending=any(run.from_rest and (step.travels or run.elsewhere) and not run.alarmed for run in runs.values())
        or (opened_at is not None and not trust.door_proven and at - opened_at < OPEN_FOR_S)
        or (trip is not None and trip.rests is not None and not trip.over),
    )


class _TrackedReading:
    """One reading after what was known before it."""

    def __init__(self, config: LiftConfig, track: Track, observation: Observation, at: float, clock: datetime) -> None:
        self._config, self._track, self._observation, self._at, self._clock = config, track, observation, at, clock
        values = observation.values
        self.is_shut = is_shut(values)
        self.came = observation.floor is not None and track.floor not in (None, observation.floor)
        """The car has come to another floor."""
        self.between_shut = None
        if observation.floor is None:
            self.between_shut = self.is_shut and track.between_shut is not False
        tells_nothing = values.motion is None and (observation.floor is None or self.came)
        self.travels = (values.motion in MOVING or tells_nothing) and not values.flags.get("level", False)
        stays = values.motion is Motion.STOPPED or (values.motion not in MOVING and not self.is_shut)
        self.stopped = observation.floor is not None and (stays or observation.is_standing)

    def doors(self, trust: Trust) -> tuple[dict[Side, _OpenDoor], Trust, tuple[str, ...]]:
        """Follow the doors that read open; one that did so from rest to rest, over a change of the floor, cannot be right.

        Its alarm waits for the car to come to rest: an indicator that runs ahead of a car which has yet to close its door is no
        contradiction.
        """
        runs: dict[Side, _OpenDoor] = {}
        for side, door in self._observation.values.doors.items():
            if door is not Door.OPEN:
                continue
            floor = self._observation.floor
            run = self._track.runs.get(side) or _OpenDoor(floor, from_rest=not self.travels)
            first = floor if run.floor is None else run.floor
            elsewhere = run.elsewhere or (floor is not None and floor != first)
            run = replace(run, floor=first, travelling=run.travelling + self.travels, elsewhere=elsewhere)
            is_wrong = run.from_rest and run.elsewhere and run.travelling >= READINGS and not self.travels
            runs[side] = replace(run, alarmed=run.alarmed or is_wrong)
        new = [side for side, run in runs.items() if run.alarmed and not self._was_alarmed(side)]
        if not new:
            return runs, trust, ()
        text = self._door_text(new[0], runs[new[0]])
        trust, alarms = self._distrusted(trust, Contradiction.DOOR, text)
        return runs, replace(trust, door_proven=False), alarms

    def trips(self, trust: Trust) -> tuple[bool | None, Trust, tuple[str, ...]]:
        """See whether the doors read closed whenever the car came to another floor, until it stops."""
        trip_shut = self._track.trip_shut
        if self.came:
            trip_shut = self._came_shut() and trip_shut is not False
        if trip_shut is None or not self.stopped:
            return trip_shut, trust, ()
        if not trip_shut:
            return None, _again(trust, Contradiction.DOOR), ()
        trust, alarms = _agreed(trust, Contradiction.DOOR)
        return None, trust if trust.door_proven else replace(trust, door_proven=True), alarms

    def opening(self, own: OwnCommands) -> tuple[bool, float | None]:
        """Check whether the door of this floor opens after our own press."""
        track, floor = self._track, self._observation.floor
        if self.came:
            return self._came_shut(), None
        pressed = own.pressed and own.call is not None and floor in (None, own.call.floor)
        opened_at = track.opened_at
        # a break in the readings does not undo what the door has shown before it
        shown = track.shut_here or (own.door_believed and track.floor is None)
        if opened_at is None and pressed and shown and self._is_open():
            opened_at = self._at
        return self.is_shut or (pressed and track.shut_here), opened_at

    def _came_shut(self) -> bool:
        """Whether the car came here with its doors closed; they may open as the new floor is reported.

        Where the reading before showed it under way behind closed doors they may be open by now: readings may be a second apart.
        """
        track = self._track
        if track.between_shut is not None:
            return track.between_shut
        not_open = all(door in _NOT_OPEN for door in self._observation.values.doors.values())
        return track.was_shut and (not_open or track.was_under_way)

    def calls(self, trust: Trust, call: Call | None) -> tuple[_Trip | None, _Miss | None, Trust, tuple[str, ...]]:
        """Follow a call until the car rests; the same offset twice in a row is the sign of a shifted table."""
        miss, observation = self._track.miss, self._observation
        trip = self._followed(call)
        if call is None or trip is None or trip.over:
            return trip, miss, trust, ()
        if not observation.is_standing or observation.floor is None:
            return replace(trip, rests=None), miss, trust, ()
        if observation.floor == trip.floor:
            trip = replace(trip, over=True)
            if trip.start in (None, trip.floor):
                return trip, miss, trust, ()
            return trip, None, *_agreed(trust, Contradiction.CALL)
        if observation.floor == trip.start:
            return replace(trip, rests=None), miss, trust, ()
        if trip.rests is None or trip.rests[0] != observation.floor:
            trip = replace(trip, rests=(observation.floor, self._at))
        since = trip.rests[1] if trip.rests is not None else self._at
        has_ended = call.phase is CallPhase.FAILED or self._at - since >= ENDED_AFTER_S
        if not (trip.confirmed and has_ended) or self._is_shown(trip.floor):
            return trip, miss, trust, ()
        now = self._missed(trip, observation.floor)
        trip, trust = replace(trip, over=True), _again(trust, Contradiction.CALL)
        if now is None or miss is None or miss.offset != now.offset:
            return trip, now, trust, ()
        return trip, now, *self._distrusted(trust, Contradiction.CALL, self._call_text(miss, now))

    def _followed(self, call: Call | None) -> _Trip | None:
        trip = self._track.trip
        if call is None:
            return None
        is_new = trip is None or trip.floor != call.floor or (trip.over and call.phase is CallPhase.PRESSED)
        if is_new and call.phase not in (CallPhase.PRESSED, CallPhase.CONFIRMED):
            return None
        if is_new or trip is None:
            trip = _Trip(call.floor, self._observation.floor or self._track.floor)
        return replace(trip, confirmed=trip.confirmed or call.phase is CallPhase.CONFIRMED)

    def _missed(self, trip: _Trip, ended: FloorName) -> _Miss | None:
        floors = self._config.floors
        if trip.floor not in floors or ended not in floors:
            return None
        return _Miss(trip.floor, ended, floors.index(ended) - floors.index(trip.floor))

    def _is_shown(self, floor: FloorName) -> bool:
        values = self._observation.values
        return floor in (values.call_accepted, values.destination) or floor in values.calls

    def _is_open(self) -> bool:
        doors, floor = self._observation.values.doors, self._observation.floor
        here = self._config.doors_at.get(floor, ()) if floor is not None else ()
        return bool(here) and all(doors.get(side) is Door.OPEN for side in here)

    def _was_alarmed(self, side: Side) -> bool:
        run = self._track.runs.get(side)
        return run is not None and run.alarmed

    def _printed(self, name: str) -> str:
        return printed(self._config, name)

    def _distrusted(self, trust: Trust, kind: Contradiction, text: str) -> tuple[Trust, tuple[str, ...]]:
        if any(one.kind is kind for one in trust.distrust):
            return _again(trust, kind), ()
        return replace(trust, distrust=(*trust.distrust, Distrust(kind, text, self._clock))), (text,)

    def _door_text(self, side: Side, run: _OpenDoor) -> str:
        shows = "motion" if self._observation.values.motion is not None else "car_floor"
        moved = f"{self._printed('car_floor')} went from {run.floor} to {self._observation.floor}"
        moved += f" and {self._printed('motion')} showed it moving" if shows == "motion" else ""
        return f"contradiction: {self._printed(f'door.{side}')} read open while the car travelled: {moved}; door contact inverted?"

    def _call_text(self, before: _Miss, now: _Miss) -> str:
        names = [name for name in sorted(self._config.capabilities.printed) if name in CALLS]
        calls = " or ".join(self._printed(name) for name in names)
        by = abs(now.offset)
        where = f"{by} floor{'' if by == 1 else 's'} {'above' if now.offset > 0 else 'below'} the one called"
        ends = f"{before.ended} for {before.called}, then {now.ended} for {now.called}"
        floor = self._printed("car_floor")
        shift = "one" if by == 1 else str(by)
        return (
            f"contradiction: calls by {calls} were confirmed, and twice the car came to rest {where} by {floor} ({ends});"
            f" floor codes shifted by {shift}?"
        )


def _agreed(trust: Trust, kind: Contradiction) -> tuple[Trust, tuple[str, ...]]:
    """Count a trip without a contradiction; the last one that is needed ends the distrust."""
    counted = [replace(one, trips=one.trips + 1) if one.kind is kind else one for one in trust.distrust]
    rest = tuple(one for one in counted if one.trips < TRIPS)
    alarms = tuple(
        f"{TRIPS} trips in a row agreed: no longer distrusted: {one.text}" for one in counted if one not in rest
    )
    return (replace(trust, distrust=rest), alarms) if trust.distrust else (trust, ())


def _again(trust: Trust, kind: Contradiction) -> Trust:
    """Restart the count of trips."""
    if not any(one.kind is kind and one.trips for one in trust.distrust):
        return trust
    return replace(trust, distrust=tuple(replace(one, trips=0) if one.kind is kind else one for one in trust.distrust))


def _doubt(config: LiftConfig, track: Track, trust: Trust, observation: Observation, at: float) -> str:
    doors = config.doors_at.get(observation.floor, ()) if observation.floor is not None else ()
    names = ", ".join(printed(config, f"door.{side}") for side in (doors or config.capabilities.doors))
    if trust.distrust:
        return f"its signals to be trusted again ({trust.distrust[0].text})"
    if any(side in track.runs and track.runs[side].elsewhere for side in doors):
        return f"its door to be seen not open at {observation.floor}: {names} read open while the car came there from another floor"
    if trust.door_proven:
        return ""
    if track.opened_at is None:
        return (
            f"proof that {names} is not inverted: either it closes, and opens after our own press, or it reads closed throughout one"
            " trip; a car that is parked with its door open has to be sent to another floor once"
        )
    if at - track.opened_at < OPEN_FOR_S:
        return f"its door to remain open for {OPEN_FOR_S:g} s: {names} is not proven by a trip yet"
    return ""
