"""Sites whose map is wrong about the wiring: a lift with an inverted door contact, or with a shifted table of calls.

python -m tests.campaigns.wiring
"""

import asyncio
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.model import FloorName
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.fault_names import fault_name
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest, Witness
from lift_manager.lab.world.world import World
from lift_manager.lift.events import Alarm
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.runtime.bus import Event
from register_maps.load import LoadedMap, MapChanges, load
from register_maps.schema import RegisterMap
from simulator.faults import Fault, WrongFloor
from simulator.people import People, Traffic
from simulator.wire_faults import Exchange
from tests.campaigns.schedules import DeviceFails, Schedule
from tests.campaigns.truth import quiet
from tests.support.trip_sites import COMPLETIONS, Completion, site_of

LIFT = "lift"
CONTRADICTS = frozenset({"says_wrong_floor", "wrong_floor"})
"""Faults that are what the alarm is about."""
ROBOT = Holder("workshop", "workshop")

INVERTED: Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any]]] = {
    "adam-pushbutton": ({"at": "sensor/discrete:0"}, {"at": "sensor/discrete:0", "active": "low"}),
    "robotnik-il-eth": (
        {"at": "holding:0.4", "values": {0: "closed", 1: "open"}},
        {"at": "holding:0.4", "values": {0: "open", 1: "closed"}},
    ),
    "seer-siemens-chengdu": ({"at": "discrete:3", "active": "low"}, {"at": "discrete:3"}),
    "seer-siemens-chengdu-block": (
        {"at": "holding:106", "values": {0: "open", 1: "closed"}},
        {"at": "holding:106", "values": {0: "closed", 1: "open"}},
    ),
    "seer-generic": (
        {"at": "holding:21", "values": {0: "open", 1: "closed"}},
        {"at": "holding:21", "values": {0: "closed", 1: "open"}},
    ),
    "two-stop-agv": ({"at": "discrete:0", "active": "low"}, {"at": "discrete:0"}),
    "generic-coils": ({"at": "discrete:16", "active": "low"}, {"at": "discrete:16"}),
}
"""Door signals of one bit or two words: what the map says, and how the lift is wired; the site has what is missing otherwise."""


def door_map(name: str, door: Mapping[str, Any]) -> LoadedMap:
    """Return a shipped map, completed where a site has to, with this front door."""
    added = COMPLETIONS.get(name, Completion())
    signals = {**added.override.get("signals", {}), "door.front": dict(door)}
    return load(name, changes=MapChanges(added.parameters, {**added.override, "signals": signals}))


@dataclass
class Seen:
    """What was published, what was so, and what people were told."""

    shut_since: float | None = None
    alarms: list[tuple[float, str]] = field(default_factory=list)
    lies: list[str] = field(default_factory=list)
    invitations: int = 0
    opened: list[FloorName] = field(default_factory=list)
    """Floors at which the car has stood open, one after the other."""

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        if not truth.doors_shut:
            self.shut_since = None
        elif self.shut_since is None:
            self.shut_since = at
        if truth.open_at is not None and [truth.open_at] != self.opened[-1:]:
            self.opened.append(truth.open_at)

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        if state.robot_door is RobotDoor.OPEN:
            self.invitations += 1
            if self.shut_since is not None and at - self.shut_since > (state.age_s or 0.0):
                self.lies.append(f"{at:.2f} s: open at {state.floor}, and the door is shut")

    def on_event(self, at: float, event: Event) -> None:
        if isinstance(event, Alarm):
            self.alarms.append((at, event.text))

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Nothing about presses is looked at here."""

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """Nothing about the wire is looked at here."""

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Faults have no effect here."""

    def on_request(self, at: float, request: FloorRequest, refused: object) -> None:
        """Nothing about requests is looked at here."""

    @property
    def contradictions(self) -> list[str]:
        return [text for _, text in self.alarms if text.startswith("contradiction: ")]


class FalseAlarms:
    """Watches schedules without a fault that is a contradiction itself."""

    def __init__(self) -> None:
        self._seen: list[tuple[int, Seen]] = []

    def watch(self, schedule: Schedule) -> Sequence[Witness]:
        """Return who watches this one."""
        faults = (event.fault for event in schedule.events if isinstance(event, DeviceFails))
        if any(fault_name(fault) in CONTRADICTS for fault in faults):
            return ()
        self._seen.append((schedule.seed, Seen()))
        return (self._seen[-1][1],)

    @property
    def watched(self) -> int:
        return len(self._seen)

    @property
    def raised(self) -> list[tuple[int, str]]:
        """Return seed and text of each alarm about a contradiction."""
        return [(seed, text) for seed, seen in self._seen for text in seen.contradictions]


def play(
    loaded: LoadedMap,
    wired: RegisterMap,
    *,
    seed: int,
    lasts_s: float = 180.0,
    asks_for_s: int = 20,
    restart_at: float | None = None,
    faults: tuple[Fault, ...] = (),
) -> Seen:
    """Let a robot ask for one floor after the other, and people ride, on a lift that is wired in another way than its map says."""
    floors = site_of(loaded.map.name).floors
    endpoints = loaded.map.endpoints
    lift = {
        "controller": "plc",
        "access": "control",
        "floors": dict(floors),
        "poll_s": max(0.4, loaded.map.link.min_poll_s),
        "endpoints": {endpoint: {"controller": endpoint} for endpoint in endpoints},
        "infer_occupancy": True,
        "accept_latching": "the controller is simulated",
        "between_sessions_s": 1.0,
    }
    devices: dict[str, dict[str, Any]] = {"plc": {"host": "memory", "port": 1, "map": loaded.map.name}} | {
        endpoint: {"host": "memory", "port": number} for number, endpoint in enumerate(endpoints, start=2)
    }
    site = Site.model_validate({"schema": 1, "name": "wiring", "controllers": devices, "lifts": {LIFT: lift}})
    seen = Seen()

    async def main() -> None:
        world = World(LoadedSite(site, {LIFT: loaded}, Path("wiring")), (seen,), seed=seed, wired={LIFT: wired})
        async with world.running():
            world.populate(LIFT, People(seed=seed, floors=len(floors), traffic=Traffic(per_minute=4.0)))
            restart = None if restart_at is None else asyncio.ensure_future(_restart(world, restart_at))
            names = list(floors)
            for fault in faults:
                world.begin(LIFT, fault)
            for turn in range(round(lasts_s / asks_for_s)):
                floor = names[(seed + turn) % len(names)]
                for _ in range(asks_for_s):
                    world.request(FloorRequest(LIFT, ROBOT, floor, hold_door=turn % 3 != 2))
                    await elapse(1.0)
                if turn % 4 == 3:
                    here = world.site.state(LIFT).floor
                    world.request(FloorRequest(LIFT, ROBOT, here or floor, hold_door=False))
                    await elapse(12.0)
            if restart is not None:
                await restart

    run_virtual(main, limit_s=20 * lasts_s)
    return seen


async def _restart(world: World, at: float) -> None:
    await elapse(at)
    await world.restart()


def shifted(loaded: LoadedMap, command: str = "go_to") -> RegisterMap:
    """Return the map of a lift whose calls are wired one floor up, the last one to the lowest floor."""
    spec = loaded.map.commands[command]
    assert spec.one_of is not None
    places = (spec.one_of[-1], *spec.one_of[:-1])
    return loaded.map.model_copy(
        update={"commands": {**loaded.map.commands, command: spec.model_copy(update={"one_of": places})}}
    )


def completed(name: str) -> LoadedMap:
    """Return a shipped map, completed where a site has to."""
    added = COMPLETIONS.get(name, Completion())
    return load(name, changes=MapChanges(added.parameters, added.override))


def inverted(name: str, *, lasts_s: float = 180.0, restart_at: float | None = None) -> list[str]:
    """Return what is wrong where the door contact is wired the other way round: nobody may be invited, and one alarm names it."""
    says, wired = (door_map(name, door) for door in INVERTED[name])
    seen = play(says, wired.map, seed=1, lasts_s=lasts_s, restart_at=restart_at)
    wrong = _named_once(seen, "door contact inverted?")
    if seen.invitations:
        wrong.append(f"{seen.invitations} invitations")
    if len(seen.opened) <= 3:
        wrong.append(f"the lift was not ridden, it opened at {seen.opened}")
    return wrong


def right(name: str, *, lasts_s: float = 180.0) -> list[str]:
    """Return what is wrong on the same lift with the right map: it invites, and nothing is said of its door contact."""
    _, wired = (door_map(name, door) for door in INVERTED[name])
    seen = play(wired, wired.map, seed=1, lasts_s=lasts_s)
    return [*seen.lies, *seen.contradictions, *([] if seen.invitations > 10 else ["hardly an invitation"])]


def shifted_table(name: str) -> list[str]:
    """Return what is wrong where the table of calls is shifted: calls that end one floor up are named after the second one."""
    says = completed(name)
    return _shifted(play(says, shifted(says), seed=1, lasts_s=120.0))


def shifted_lift(name: str) -> list[str]:
    """Return what is wrong where the lift goes one floor too far."""
    says = completed(name)
    return _shifted(play(says, says.map, seed=1, lasts_s=240.0, asks_for_s=60, faults=(WrongFloor(),)))


def _shifted(seen: Seen) -> list[str]:
    wrong = _named_once(seen, "floor codes shifted by one?")
    return wrong if any("go_to (" in text for text in seen.contradictions) else [*wrong, "no alarm names go_to"]


def _named_once(seen: Seen, question: str) -> list[str]:
    named = [text for text in seen.contradictions if text.endswith(question)]
    return seen.lies if len(named) == len(seen.contradictions) == 1 else [*seen.lies, f"alarms: {seen.alarms}"]


Story = Callable[[str], list[str]]
STORIES: tuple[tuple[Story, str], ...] = (
    *((story, name) for name in INVERTED for story in (inverted, right)),
    (shifted_table, "generic-coils"),
    (shifted_lift, "generic-registers"),
)


def main() -> int:
    failed = 0
    for story, name in STORIES:
        with quiet():
            wrong = story(name)
        failed += bool(wrong)
        sys.stdout.write(f"{story.__name__} {name}: {'; '.join(wrong) or 'as it should be'}\n")
    sys.stdout.write(f"{len(STORIES)} stories, {failed} failed\n")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
