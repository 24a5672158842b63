"""The trace of a run: what happened, entry by entry, in order."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import assert_never

from drivers.model import FloorName
from lift_manager.lab.scenario.vocabulary import KINDS
from lift_manager.lab.world.fault_names import fault_name
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest
from lift_manager.lift import events
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.rides.inputs import RideChanged
from lift_manager.runtime.bus import Event, StateChanged
from lift_manager.runtime.errors import RequestRefused
from register_maps.words import Side
from simulator.faults import Fault
from simulator.wire_faults import Exchange

Value = bool | float | str | tuple[str, ...] | None
Subject = tuple[str, str, Value, Value]

_TIME_OF_DAY = re.compile(r" since \d{4}-\d\d-\d\d \d\d:\d\d| \(\d{4}-\d\d-\d\d \d\d:\d\d\)")
"""The time of day in texts for people. It is removed, so that every run of a scenario has the same trace."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One thing that happened."""

    at_s: float
    """Seconds since the start of the run."""
    lift: str
    kind: str
    fields: Mapping[str, Value]
    """As in `vocabulary.KINDS`; a field without a value is None."""

    @property
    def subject(self) -> Subject:
        """What the entry is about: an entry that lasts holds until the next one with the same subject."""
        fields = self.fields if self.kind in ("fault", "wire") else {}
        return self.lift, self.kind, fields.get("fault"), fields.get("controller")

    def as_json(self) -> str:
        """Return the entry as one line of a trace file."""
        return json.dumps({"at_s": self.at_s, "lift": self.lift, "kind": self.kind, **self.fields}, ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class TracedLift:
    """The facts about one lift that the recorder needs."""

    floors: tuple[FloorName, ...]
    commands: frozenset[str]
    calls: frozenset[str]
    """The commands that name a floor."""
    controllers: tuple[str, ...]
    objection: Callable[[Fault], str]
    """Returns why the simulated lift cannot have a fault; empty if it can."""


class Recorder:
    """A witness of a world that writes the trace. Times are rounded to microseconds."""

    def __init__(self, lifts: Mapping[str, TracedLift]) -> None:
        self.entries: list[Entry] = []
        self.on_entry: Callable[[Entry], None] | None = None
        self._lifts = lifts
        self._newest: dict[Subject, Entry] = {}
        self._given: dict[str, Mapping[str, int]] = {lift: {} for lift in lifts}
        self._open = True

    def holding(self, lift: str, kind: str) -> list[Entry]:
        """Return the entries of this kind that hold now."""
        return [entry for entry in self._newest.values() if (entry.lift, entry.kind) == (lift, kind)]

    def close(self) -> None:
        """Ignore everything from now on: it belongs to the end of the run."""
        self._open = False

    def note(self, at: float, lift: str, kind: str, fields: Mapping[str, object]) -> None:
        """Add an entry; missing fields are None."""
        if not self._open:
            return
        entry = Entry(round(at, 6), lift, kind, {name: _value(fields.get(name)) for name in KINDS[kind].fields})
        if KINDS[kind].lasts:
            self._newest[entry.subject] = entry
        self.entries.append(entry)
        if self.on_entry is not None:
            self.on_entry(entry)

    # -- Witness

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        """Record a changed physical state, and the commands that are no longer written."""
        before, given = self._given[lift], dict(truth.given)
        self._given[lift] = given
        self._changed(at, lift, "truth", _truth_fields(truth, self._lifts[lift].floors))
        for name, value in before.items():
            if name not in given:
                self.note(at, lift, "release", self._command(lift, name, value))

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Record each new command."""
        for name in sorted(commands):
            self.note(at, lift, "press", self._command(lift, name, self._given[lift].get(name, 0)))

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """Record a state that differs from the one before in more than its age."""
        self._changed(at, lift, "state", _state_fields(state))

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """Record nothing: the effects are in the other entries."""

    def on_event(self, at: float, event: Event) -> None:
        """Record an event of the manager."""
        found = _event_fields(event)
        if found is not None:
            kind, fields = found
            self.note(at, event.lift, kind, fields)

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """Record a request with its answer."""
        fields = {
            "holder": request.holder,
            "floor": request.floor,
            "door": "open" if request.hold_door else "closed",
            "robot": request.robot,
            **reply_fields(refused),
        }
        self.note(at, request.lift, "request", fields)

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Record a fault; a fault on a wire is recorded for every lift behind it."""
        fields = {"fault": fault_name(change.fault), "began": change.began}
        if change.where in self._lifts:
            self.note(at, change.where, "fault", fields)
            return
        for lift, known in self._lifts.items():
            if change.where in known.controllers:
                self.note(at, lift, "wire", {**fields, "controller": change.where})

    def _changed(self, at: float, lift: str, kind: str, fields: Mapping[str, object]) -> None:
        held = self.holding(lift, kind)
        if held and all(held[0].fields[name] == _value(value) for name, value in fields.items() if name != "age_s"):
            return
        self.note(at, lift, kind, fields)

    def _command(self, lift: str, name: str, value: int) -> Mapping[str, object]:
        known = self._lifts[lift]
        floor = known.floors[value] if name in known.calls and 0 <= value < len(known.floors) else None
        return {"command": name, "floor": floor}


def reply_fields(refused: RequestRefused | None) -> Mapping[str, object]:
    """Return the fields of an answer of the manager; `refused` is None for an accepted request."""
    if refused is None:
        return {"accepted": True}
    return {"accepted": False, "code": refused.code, "message": refused.message}


def changes(entries: Iterable[Entry]) -> Iterator[tuple[Entry, Mapping[str, Value]]]:
    """Yield each entry with its relevant fields: of a state or truth those that have changed, of others those with a value."""
    newest: dict[Subject, Entry] = {}
    for entry in entries:
        before = newest.get(entry.subject) if KINDS[entry.kind].lasts and entry.kind in ("state", "truth") else None
        if before is None:
            yield entry, {name: value for name, value in entry.fields.items() if value not in (None, ())}
        else:
            changed = {n: v for n, v in entry.fields.items() if v != before.fields[n] and n != "age_s"}
            yield entry, changed
        newest[entry.subject] = entry


def _value(value: object) -> Value:
    match value:
        case None | bool() | int() | tuple():
            return value
        case float():
            return round(value, 6)
        case _:
            return _TIME_OF_DAY.sub("", str(value)) or None


def _truth_fields(truth: Truth, floors: tuple[FloorName, ...]) -> Mapping[str, object]:
    return {
        "floor": truth.at,
        "open_at": truth.open_at,
        "standing": truth.standing,
        "doors_shut": truth.doors_shut,
        "mode": truth.mode,
        "robot_mode": truth.robot_mode,
        "calls": tuple(floor for floor in floors if floor in truth.calls),
        "commands": tuple(sorted(truth.commands)),
    }


def _state_fields(state: LiftState) -> Mapping[str, object]:
    held = state.restrictions
    return {
        "quality": state.quality,
        "reason": state.reason,
        "age_s": state.age_s,
        "floor": state.floor,
        "standing": state.standing,
        "destination": state.destination,
        "robot_door": state.robot_door,
        **{f"door.{side}": state.doors.get(side) for side in Side},
        "motion": state.motion,
        "mode": state.mode,
        "holder": state.holder,
        "fire_latched": held.fire_latched,
        "lockout": held.lockout,
        "drain": held.drain,
        "maybe_aboard": held.maybe_aboard,
        "waiting_for": held.waiting_for,
    }


def _event_fields(event: Event) -> tuple[str, Mapping[str, object]] | None:
    match event:
        case events.SessionOpened(holder=holder, floor=floor):
            return "session", {"open": True, "holder": holder, "floor": floor}
        case events.SessionRestored(holder=holder, floor=floor, text=text):
            return "session", {"open": True, "holder": holder, "floor": floor, "text": text}
        case events.HandedOver(holder=holder, to=to):
            return "session", {"open": True, "holder": to, "text": f"handed over by {holder}"}
        case events.SessionEnded(holder=holder, reason=reason, text=text, advice=advice):
            return "session", {"open": False, "holder": holder, "reason": reason, "text": text, "advice": advice}
        case events.Advised(holder=holder, advice=advice, text=text):
            return "advice", {"holder": holder, "advice": advice, "text": text}
        case events.CommandEnded(outcome=outcome):
            fields = {"command": outcome.command.name, "floor": outcome.command.floor}
            return "outcome", {**fields, "result": outcome.result, "proof": outcome.proof, "reason": outcome.reason}
        case events.Alarm(text=text, holder=holder):
            return "alarm", {"text": text, "holder": holder}
        case (
            StateChanged()
            | events.RestrictionBegun()
            | events.RestrictionEnded()
            | events.Acknowledged()
            | events.ForceReleased()
            | events.CommandFollowed()
            | RideChanged()
        ):
            return None  # states and answers to people have entries of their own; the others are not part of a trace
        case _:
            assert_never(event)


def holder_of(text: str) -> Holder:
    """Parse a holder: `fleet:r1`, or one word for a face with a single caller."""
    face, _, name = text.partition(":")
    return Holder(face, name or face)
