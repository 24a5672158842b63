"""What each shipped map can show of its lift, reviewed by hand against its source; and which findings each fault excuses.

The judge relies on this table and not on `lift_manager.commissioning.detection`, the codec or the lists of the product: an error there
must not excuse itself. A map that is not listed here, or that a site has changed, is described from its text (`described`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from drivers.model import Proof
from lift_manager.lab.world.lift_under_test import (
    MODES_WITHOUT_ROBOTS,
    DoorEvidence,
    Excuse,
    FloorEvidence,
    MapEvidence,
    SuspectValues,
)
from register_maps.schema import RegisterMap
from register_maps.words import Mode

ALL_MODES = frozenset({Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.OUT_OF_SERVICE})
ONLY_FIRE = frozenset({Mode.FIRE})
NO_MODES = frozenset[Mode]()

_EFFECT, _READBACK, _LAMP = frozenset({Proof.EFFECT}), frozenset({Proof.READBACK}), frozenset({Proof.LAMP})
_RELAYS: Mapping[str, frozenset[Proof]] = {"go_to": _EFFECT, "hold_door": _READBACK}
"""Only the car confirms a call of a relay module; the relay itself confirms a hold."""
_GENERIC: Mapping[str, frozenset[Proof]] = {
    "go_to": _LAMP | _EFFECT,
    "hold_door": _READBACK,
    "close_door": _EFFECT,
    "robot_mode": _EFFECT,
}
_HANDSHAKE: Mapping[str, frozenset[Proof]] = {
    "call": _EFFECT,
    "go": _EFFECT,
    "robot_in_place": _READBACK,
    "robot_left": _READBACK,
}


@dataclass(frozen=True, slots=True)
class Row:
    """One reviewed map, with the names that it had then."""

    names: str
    """Its signals, a vertical bar, and its commands; a map with other names counts as not reviewed."""
    shows: MapEvidence


def _relays(*, fire: bool, max_age_s: float = 1.0, bars: frozenset[str] = frozenset()) -> MapEvidence:
    """Return the evidence of a map with two door limits, a contact per floor, and no motion signal."""
    return MapEvidence(
        max_age_s=max_age_s,
        modes=ONLY_FIRE if fire else NO_MODES,
        motion=False,
        direction=False,
        floor_by=FloorEvidence.SWITCH,
        bars=bars,
        proofs=_RELAYS,
    )


REVIEWED: Mapping[str, Row] = {
    "adam-io": Row("car_floor door.front fire | go_to hold_door.front", _relays(fire=True, max_age_s=2.0)),
    "adam-pushbutton": Row(
        "car_floor door.front | close_door.front go_to hold_door.front",
        MapEvidence(
            max_age_s=2.0,
            modes=NO_MODES,
            motion=False,
            direction=False,
            floor_by=FloorEvidence.SWITCH,
            door_by=DoorEvidence.OPEN_CONTACT,
            proofs={**_RELAYS, "close_door": _EFFECT},
        ),
    ),
    "generic-coils": Row(
        "call_accepted car_floor door.front emergency_power fire independent inspection level motion obstruction.front"
        " out_of_service overload robot_mode_on robots_allowed | close_door.front go_to hold_door.front robot_mode",
        MapEvidence(
            modes=ALL_MODES,
            floor_by=FloorEvidence.SWITCH,
            robot_mode=True,
            bars=frozenset({"robots_allowed"}),
            proofs=_GENERIC,
        ),
    ),
    "generic-coils-cluster": Row(
        "call_accepted car_floor door.front emergency_power epoch fire independent inspection level motion obstruction.front"
        " out_of_service overload owner robot_mode_on robots_allowed | close_door.front go_to hold_door.front robot_mode",
        MapEvidence(
            modes=ALL_MODES,
            floor_by=FloorEvidence.SWITCH,
            robot_mode=True,
            bars=frozenset({"robots_allowed"}),
            proofs=_GENERIC,
        ),
    ),
    "generic-registers-cluster": Row(
        "alive call_accepted car_floor destination door.front epoch fire level mode motion obstruction.front overload owner"
        " robot_mode_on | close_door.front go_to hold_door.front robot_mode",
        MapEvidence(modes=ALL_MODES, beats_within_s=3.0, robot_mode=True, proofs=_GENERIC),
    ),
    "generic-registers": Row(
        "alive call_accepted car_floor destination door.front fire level mode motion obstruction.front overload robot_mode_on"
        " | close_door.front go_to hold_door.front robot_mode",
        MapEvidence(modes=ALL_MODES, beats_within_s=3.0, robot_mode=True, proofs=_GENERIC),
    ),
    "moxa-e1211": Row(
        "car_floor door.front watchdog_tripped | go_to hold_door.front",
        _relays(fire=False, bars=frozenset({"watchdog_tripped"})),
    ),
    "moxa-e1212": Row("car_floor door.front fire | go_to hold_door.front", _relays(fire=True)),
    "moxa-e1214": Row("car_floor door.front fire | go_to hold_door.front", _relays(fire=True)),
    "robotnik-il-eth": Row(
        "car_floor door.front | go_to hold_door.front robot_mode",
        MapEvidence(
            modes=NO_MODES,
            motion=False,
            direction=False,
            floor_by=FloorEvidence.SWITCH,
            proofs={**_RELAYS, "robot_mode": _READBACK},
        ),
    ),
    "seer-generic": Row(
        "car_floor door.front emergency_power motion | close_door.front go_to hold_door.front",
        MapEvidence(modes=frozenset({Mode.EMERGENCY}), proofs={**_RELAYS, "close_door": _EFFECT}),
    ),
    "seer-lps3-two-stop": Row(
        "car_floor door.front | call robot_in_place",
        MapEvidence(
            max_age_s=2.0,
            modes=NO_MODES,
            motion=False,
            direction=False,
            floor_by=FloorEvidence.DOOR,
            door_by=DoorEvidence.OPEN_LIMITS,
            # nothing shows that the car is coming; the output itself is the only evidence
            proofs={"call": _READBACK, "robot_in_place": _READBACK},
        ),
    ),
    "seer-siemens-chengdu": Row(
        "car_floor door.front may_enter may_leave | call go robot_in_place robot_left",
        MapEvidence(
            modes=NO_MODES,
            motion=False,
            direction=False,
            door_by=DoorEvidence.OPEN_CONTACT,
            permits=True,
            proofs=_HANDSHAKE,
        ),
    ),
    "seer-siemens-chengdu-block": Row(
        "car_floor door.front may_enter may_leave | call go robot_in_place robot_left",
        MapEvidence(
            modes=NO_MODES,
            motion=False,
            direction=False,
            door_by=DoorEvidence.OPEN_CONTACT,
            permits=True,
            proofs=_HANDSHAKE,
        ),
    ),
    "two-stop-agv": Row(
        "car_floor door.front fault robot_mode_on | close_door.front go_to hold_door.front",
        MapEvidence(
            modes=NO_MODES,  # its fault lamp shows no mode that a simulated controller changes to
            motion=False,
            direction=False,
            floor_by=FloorEvidence.SWITCH,
            robot_mode=True,
            proofs={**_RELAYS, "close_door": _EFFECT},
        ),
    ),
    "wago-750": Row(
        "car_floor door.front fire watchdog_time watchdog_tripped | go_to hold_door.front",
        _relays(fire=True, bars=frozenset({"watchdog_tripped"})),
    ),
    "waveshare-relay": Row("car_floor door.front | go_to hold_door.front", _relays(fire=False)),
}
"""The shipped maps with which a robot can ride, completed as in the campaigns."""

TWO_DOORS = {"door.front": "door.rear", "hold_door.front": "hold_door.rear", "close_door.front": "close_door.rear"}
"""The signals and commands of a second door, which a site may add."""


def evidence_of(source: RegisterMap) -> tuple[MapEvidence, bool]:
    """Return what a map can show, and whether it was reviewed."""
    row = REVIEWED.get(source.name)
    if row is not None and _names(source) == row.names:
        return row.shows, True
    return described(source), False


def _names(source: RegisterMap) -> str:
    second = set(TWO_DOORS.values())
    signals, commands = (" ".join(sorted(set(named) - second)) for named in (source.signals, source.commands))
    return f"{signals} | {commands}"


def described(source: RegisterMap) -> MapEvidence:
    """Describe a map from its text."""
    signals, floor = source.signals, source.signals.get("car_floor")
    doors = [spec for name, spec in signals.items() if name.startswith("door.")]
    by_limits = any(spec.open_limits is not None for spec in doors)
    shared = floor is not None and any(set(spec.addresses) == set(floor.addresses) for spec in doors)
    per_floor = floor is not None and floor.one_of is not None
    both = all(
        spec.open_limit is not None or spec.open_at is not None or len(set((spec.values or {}).values())) > 2
        for spec in doors
    )
    beat = signals.get("alive")
    return MapEvidence(
        max_age_s=source.link.max_age_s,
        modes=frozenset(_modes(source)),
        beats_within_s=beat.must_change_within_s if beat is not None else None,
        motion=not signals.keys().isdisjoint({"motion", "level"}),
        direction="motion" in signals,
        floor_by=FloorEvidence.DOOR if shared else FloorEvidence.SWITCH if per_floor else FloorEvidence.CODE,
        door_by=DoorEvidence.OPEN_LIMITS
        if by_limits
        else DoorEvidence.BOTH_ENDS
        if both
        else DoorEvidence.OPEN_CONTACT,
        robot_mode="robot_mode_on" in signals,
        permits="robot_in_place" in source.commands and not signals.keys().isdisjoint({"may_enter", "may_leave"}),
        bars=frozenset(signals.keys() & {"robots_allowed", "watchdog_tripped"}),
    )


_FLAGS = {
    "fire": Mode.FIRE,
    "emergency_power": Mode.EMERGENCY,
    "inspection": Mode.INSPECTION,
    "independent": Mode.INDEPENDENT,
    "out_of_service": Mode.OUT_OF_SERVICE,
}


def _modes(source: RegisterMap) -> Iterator[Mode]:
    yield from (mode for flag, mode in _FLAGS.items() if flag in source.signals)
    word = source.signals.get("mode")
    yield from (
        (Mode(text) for text in (word.values or {}).values() if Mode(text) in MODES_WITHOUT_ROBOTS) if word else ()
    )


# -- faults

_LATE_FAULTS = frozenset({SuspectValues.EFFECT})
_UNDETECTABLE_FAULTS = frozenset({SuspectValues.EFFECT, SuspectValues.OUTPUT})
"""For frozen registers. The judge itself knows what may be published meanwhile: the lift as it was when they froze."""


def excuses(shows: MapEvidence, *, max_age_s: float, arrive_within_s: float) -> dict[str, Excuse]:
    """Return what each fault may make wrong, by its name. A fault that is missing here excuses nothing."""
    # the time for the next beat runs from the first reading on; after that the last valid reading is kept for its maximum age
    stands_still = None if shows.beats_within_s is None else shows.beats_within_s + max_age_s
    found = {
        # a call counts as taken while the car moves; until the time limit of the trip nothing shows that the car does not come
        "wrong_floor": Excuse(_LATE_FAULTS, arrive_within_s),
        "homing": Excuse(_LATE_FAULTS | _lost_floor(shows), arrive_within_s),
        "calls_cancelled": Excuse(_LATE_FAULTS, arrive_within_s),
        "reboot": Excuse(_LATE_FAULTS | _lost_floor(shows), arrive_within_s),
        # the door is held for the robot at the published floor
        "says_wrong_floor": Excuse(
            frozenset({SuspectValues.OPEN, SuspectValues.EFFECT, SuspectValues.FLOOR, SuspectValues.OUTPUT}), None
        ),
        "floor_ahead": Excuse(frozenset({SuspectValues.FLOOR}), None),
        "contradicting_limits": Excuse(frozenset({SuspectValues.OPEN, SuspectValues.SHOWN}), max_age_s),
        "frozen_registers": Excuse(_UNDETECTABLE_FAULTS, stands_still),
        "stopped": Excuse(_UNDETECTABLE_FAULTS, stands_still),
        # it makes nothing wrong, but nothing is known of the car
        "frozen_heartbeat": Excuse(frozenset(), None),
        "lost_press": Excuse(_LATE_FAULTS, None),
        "ignored_writes": Excuse(_LATE_FAULTS | {SuspectValues.OUTPUT}, None),
        "ignored_writes.stored": Excuse(_LATE_FAULTS | {SuspectValues.OUTPUT}, None),
        "foreign_writer": Excuse(_LATE_FAULTS | {SuspectValues.OUTPUT}, None),
    }
    for mode in ALL_MODES:
        if mode not in shows.modes:
            # the lift takes no calls in this mode, and a car that moves for people looks like the response
            found[f"in_mode.{mode}"] = Excuse(_LATE_FAULTS, None)
    return found


def _lost_floor(shows: MapEvidence) -> frozenset[SuspectValues]:
    """Return what is wrong while a controller searches for its floor: a floor code keeps its last value."""
    return frozenset({SuspectValues.FLOOR}) if shows.floor_by is FloorEvidence.CODE else frozenset()
