"""Every shipped map as a site would use it for a robot: what it lacks by itself is said here, once for each map."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from lift_manager.lab.plant import default_floors
from register_maps.codec import Codec, compile_map
from register_maps.load import MapChanges, load
from register_maps.schema import CALLS
from register_maps.words import Door


@dataclass(frozen=True)
class Completion:
    """What a site adds to a map that is not a whole lift by itself."""

    parameters: Mapping[str, int | float | str] = field(default_factory=dict)
    override: Mapping[str, Any] = field(default_factory=dict)


TWO_STOP_SENSOR: Mapping[str, Any] = {
    "endpoints": {"sensor": {"unit_id": 2, "served": {"discrete": [[0, 3]]}}},
    "signals": {
        "door.front": {"open_limit": "sensor/discrete:0", "closed_limit": "sensor/discrete:1"},
        "car_floor": {"one_of": ["sensor/discrete:2", "sensor/discrete:3"]},
    },
}
"""A module with four inputs: the two limits of the door, and the car at each of two stops."""

COMPLETIONS: Mapping[str, Completion] = {
    # elevator-interfaces 1.5: one inverted contact at the door; three floor contacts, which the source does not have
    "adam-pushbutton": Completion(
        override={
            "endpoints": {"sensor": {"unit_id": 2, "addressing": {"base": 0}, "served": {"discrete": [[0, 3]]}}},
            "signals": {
                "door.front": {"at": "sensor/discrete:0", "active": "low"},
                "car_floor": {"one_of": ["sensor/discrete:1", "sensor/discrete:2", "sensor/discrete:3"]},
            },
        }
    ),
    "moxa-e1211": Completion(override=TWO_STOP_SENSOR),
    "waveshare-relay": Completion(override=TWO_STOP_SENSOR),
    # its only contact is that of the closed door, and not closed is not open
    "robotnik-il-eth": Completion(
        override={
            "endpoints": {"sensor": {"unit_id": 2, "served": {"discrete": [[0, 0]]}}},
            "signals": {"door.front": {"open_limit": "sensor/discrete:0", "closed_limit": "holding:0.4"}},
        },
    ),
    "seer-generic": Completion(
        parameters={
            "dest_floor": 10,
            "open_door": 11,
            "close_door": 12,
            "lift_floor": 20,
            "door_status": 21,
            "move_status": 22,
            "emergency": 23,
            "first_register": 10,
            "last_register": 23,
            "reset_first_s": 0.5,
        }
    ),
    "seer-siemens-chengdu-block": Completion(parameters={"first": 100}),
}

NO_TRIP: Mapping[str, str] = {"thingweb-elevator": "it has no door"}
"""Maps of what is not a lift for anybody to enter, with the reason."""


class Incomplete(Exception):
    """A map that can neither make a trip by itself nor is told here what it lacks."""


@dataclass(frozen=True)
class Site:
    """One lift of a site: a map with everything that it needs, and names for its floors."""

    name: str
    codec: Codec
    floors: Mapping[str, int]
    """Names and codes, lowest floor first."""


@cache
def site_of(name: str) -> Site:
    """Return a shipped map as it is used here, made once for all tests of a process. Raises Incomplete if it lacks something still."""
    return completed_site(name, COMPLETIONS)


def completed_site(name: str, completions: Mapping[str, Completion]) -> Site:
    """Return a shipped map with what completes it. Raises Incomplete if it lacks something still."""
    added = completions.get(name, Completion())
    loaded = load(name, changes=MapChanges(added.parameters, added.override))
    codec = compile_map(loaded.map)
    lacks = [f"parameter {parameter}" for parameter in loaded.unset]
    lacks += [*(signal for signal in loaded.map.needs if signal not in codec.signals), *lacking(codec)]
    if name in NO_TRIP:
        lacks.remove("a door that can be open")
    if lacks:
        raise Incomplete(f"{name} has no {', '.join(lacks)}: complete it in COMPLETIONS, or list it in NO_TRIP")
    return Site(name, codec, default_floors(loaded.map))


def lacking(codec: Codec) -> list[str]:
    """List what a map lacks for a robot to ride: a floor, a call, a door that is ever seen open."""
    has = {
        "car_floor": "car_floor" in codec.signals,
        "command that calls the car": any(command in CALLS for command in codec.commands),
        "a door that can be open": any(
            _can_be_open(codec, signal) for signal in codec.signals if signal.startswith("door.")
        ),
    }
    return [what for what, there in has.items() if not there]


def _can_be_open(codec: Codec, signal: str) -> bool:
    door = codec.signals[signal]
    try:
        door.insert(codec.empty_image(), frozenset({0}) if door.per_floor else Door.OPEN)
    except ValueError:
        return False
    return True


def stops(site: Site) -> tuple[str, str]:
    """Where the robot is, and where it goes: not where the car stands, and not at the end of the shaft if there is a choice."""
    names = list(site.floors)[:4]
    return names[-1], names[0 if len(names) == 2 else 1]
