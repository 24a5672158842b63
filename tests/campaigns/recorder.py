"""Writes down what a world and its manager do, as plain JSON in the words of the public interfaces and of the wire.

This is the only file of the recordings that knows the manager's own values: a rebuilt core changes this file, and what it
writes must stay the same. Ids, transaction ids, boots and ages are left out: they are others in every process, or follow from the rest.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Coroutine, Mapping
from dataclasses import asdict, is_dataclass, replace
from typing import Any

from lift_manager.config.load import LoadedSite
from lift_manager.lab.world.disk import SimulatedDisk
from lift_manager.lab.world.fault_names import fault_name
from lift_manager.lab.world.oracle_setup import oracle_of
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest, ForgottenRecords
from lift_manager.lab.world.world import World
from lift_manager.lift.journal import Row
from lift_manager.lift.refusals import Refused
from lift_manager.lift.state import LiftState, Quality
from lift_manager.runtime.bus import Event, StateChanged
from lift_manager.runtime.errors import RequestRefused
from lift_manager.web.events.encoding import encode_event
from lift_manager.web.workshop import state_data
from register_maps import frames
from register_maps.errors import FrameError
from register_maps.frames import Request
from register_maps.words import BIT_TABLES
from simulator.wire_faults import Exchange
from tests.campaigns.playing import Played, disk_for, play, site_for
from tests.campaigns.recordings import Json, Recording
from tests.campaigns.schedules import Schedule
from tests.campaigns.truth import quiet
from tests.campaigns.visits import actors


def record(schedule: Schedule, *, visited: bool = False) -> Recording:
    """Play a schedule and return everything that happened, channel by channel; `visited`: with what `visits` adds to its seed."""
    disk = disk_for(schedule)
    recorder = Recorder(site_for(schedule), disk)
    recorder.recording["inputs"].append([0.0, {"map": schedule.map, "speed": schedule.speed, "seed": schedule.seed}])

    def more(world: World) -> list[Coroutine[Any, Any, None]]:
        return actors(world, schedule.seed, recorder.called) if visited else []

    with quiet():
        played = play(schedule, witnesses=(recorder,), disk=disk, steady=True, more=more)
    recorder.end(played)
    return recorder.recording


class Recorder:
    """A witness that writes into channels; every entry has the time at which it happened."""

    def __init__(self, loaded: LoadedSite, disk: SimulatedDisk) -> None:
        self.recording: Recording = {
            name: [] for name in ("inputs", "replies", "states", "workshop", "events", "journal")
        }
        self._max_age_s = {name: about.max_age_s for name, about in oracle_of(loaded).lifts.items()}
        self._states: dict[str, LiftState] = {}
        self._workshop: dict[str, Json] = {}
        self._ids: dict[str, str] = {}
        """Ids of sessions, commands and rides that answers have told, by the name that they have in the recording."""
        self._exchanges: dict[str, list[Exchange]] = {name: [] for name in loaded.controllers}
        disk.on_recorded.append(self._on_recorded)

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        """The lift itself is not recorded: the simulator is not what is compared."""

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Presses are on the wire."""

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """Write down a state that differs from the one before in more than its ages, as /api/v1 and as the workshop have it."""
        timeless = replace(state, age_s=None, held_since_s=None)
        if self._states.get(lift) == timeless:
            return
        self._states[lift] = timeless
        said = encode_event(StateChanged(lift, timeless), self._max_age_s[lift]).model_dump(mode="json")["lift"]
        self._add("states", at, said)
        live = state.quality is Quality.LIVE
        workshop: Json = {"lift": lift, "success": live, "data": _plain(state_data(state)) if live else {}}
        if self._workshop.get(lift) != workshop:
            self._workshop[lift] = workshop
            self._add("workshop", at, workshop)

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """Keep it: it is decoded at the end, when its answers are known."""
        self._exchanges[controller].append(exchange)

    def on_event(self, at: float, event: Event) -> None:
        """Write down an event as the event stream has it."""
        self._add("events", at, encode_event(event, self._max_age_s[event.lift]).model_dump(mode="json"))

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """Write down a request, and the reply."""
        said = {
            "lift": request.lift,
            "holder": str(request.holder),
            "floor": request.floor,
            "hold_door": request.hold_door,
            "robot": request.robot,
        }
        self._replied(at, said, refused)

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Write down a fault, a restart or the end."""
        what = "begins" if change.began else "ends"
        match change.fault:
            case ForgottenRecords(lifts=lifts):
                said: dict[str, Json] = {"fault": "forgotten by the restart", "lifts": list(lifts)}
            case str() as word:
                said = {"fault": str(word)}
            case fault:
                values = asdict(fault) if is_dataclass(fault) and not isinstance(fault, type) else {}
                said = {"fault": fault_name(fault), "values": _plain(values)}
        self._add("inputs", at, {"where": change.where, "what": what, **said})

    def called(self, at: float, request: Mapping[str, Json], reply: Mapping[str, Json]) -> None:
        """Write down a request over HTTP, and its reply."""
        body = reply["body"]
        if isinstance(body, dict) and isinstance(body.get("id"), str):
            self._ids.setdefault(body["id"], f"id-{len(self._ids) + 1}")
        self._add("inputs", at, request)
        self._add("replies", at, {**request, "reply": reply})

    def end(self, played: Played) -> None:
        """Write down what is known at the end only."""
        for at, event, refused in played.people:
            self._replied(at, {"person": event.what}, refused)
        for controller, exchanges in self._exchanges.items():
            self.recording[f"wire.{controller}"] = [
                [_ms(exchange.sent_at), _decoded(exchange)] for exchange in exchanges
            ]
        if any(finding.rule == "crash" for finding in played.findings):
            self._add("inputs", 0.0, {"crash": [finding.text for finding in played.findings]})
        for name, channel in self.recording.items():
            channel.sort(key=lambda entry: entry[0])
            if self._ids and not name.startswith("wire"):
                text = json.dumps(channel)
                for number, other in self._ids.items():
                    text = text.replace(number, other)
                self.recording[name] = json.loads(text)

    def _replied(self, at: float, said: Mapping[str, object], refused: RequestRefused | Refused | None) -> None:
        self._add("inputs", at, _plain(said))
        reply: dict[str, Json] = {"success": True}
        if refused is not None:
            reply = {"success": False, "code": refused.code, "msg": refused.message}
        self._add("replies", at, _plain({**said, "reply": reply}))

    def _on_recorded(self, row: Row) -> None:
        said = {"kind": row.kind, "lift": row.lift, "caller": row.caller, "text": row.text, "data": row.data}
        self._add("journal", asyncio.get_running_loop().time(), _plain(said))

    def _add(self, channel: str, at: float, entry: Json) -> None:
        self.recording[channel].append([_ms(at), entry])


def _decoded(exchange: Exchange) -> Json:
    """Return an exchange without its transaction ids: what was asked for, what came back how much later, and what went wrong."""
    try:
        request = frames.parse_request(exchange.request, timed_coils=True)
    except FrameError:
        return {"bytes": exchange.request[2:].hex()}
    said: dict[str, Json] = {"unit": request.unit, "function": request.function, "address": request.address}
    if request.is_write:
        said["values"] = list(request.values)
    else:
        said["count"] = request.count
    if request.duration is not None:
        said["duration"] = request.duration
    if exchange.honest:
        answer = b"".join(data for _, data in exchange.answers)
        said |= {"answer": _payload(request, answer), "after_s": _ms(exchange.answers[-1][0] - exchange.sent_at)}
    else:
        said["answer"] = [[_ms(arrives - exchange.sent_at), data.hex()] for arrives, data in exchange.answers]
        said["executed"] = exchange.executed
    if exchange.faults:
        said["faults"] = [fault_name(fault) for fault in exchange.faults]
    return said


def _payload(request: Request, answer: bytes) -> Json:
    try:
        payload = frames.check(request, answer)
    except FrameError:
        return f"exception {answer[8]}" if len(answer) == 9 else answer[2:].hex()
    if request.is_write:
        return "ok"
    if request.table in BIT_TABLES:
        return list(frames.unpack_bits(payload, request.count))
    return [int.from_bytes(payload[place : place + 2], "big") for place in range(0, len(payload), 2)]


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: words of an enum are words, and everything else that has no form of its own is in words."""
    match value:
        case Mapping():
            return {str(key): _plain(one) for key, one in value.items()}
        case list() | tuple():
            return [_plain(one) for one in value]
        case set() | frozenset():
            return sorted(map(str, value))
        case str():
            return str(value)
        case bool() | int() | float() | None:
            return value
        case _:
            return str(value)


def _ms(seconds: float) -> float:
    return round(seconds, 3)
