"""Judges the signals of the car and its doors against each other. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.lift_facts import LiftFacts
from lift_manager.commissioning.doctor.output_findings import is_on
from lift_manager.commissioning.doctor.picture import MOVING, Misfit, always, is_open_between_floors
from register_maps.words import Door, Motion


def doors_against_the_car(facts: LiftFacts) -> Iterator[Finding]:
    """Name doors that read open where no door is."""
    lift, found = facts.lift, facts.pictures
    odd = {misfit.signal for misfit in facts.misfits}
    doors = [name for name in lift.codec.signals if name.startswith("door.") and name not in odd]
    for name in doors:
        if is_open_between_floors(found, name):
            yield open_under_way(facts, name)
        elif always(found, name, Door.OPEN) and not is_on(facts, f"hold_{name}"):
            yield facts.finding(
                Severity.WARNING,
                "door-open",
                name,
                f"the door reads open all the time ({facts.span_s:.0f} s), and nobody holds it",
                "Look at the door: if it is shut, its contact is inverted (`active` in the map) or its two limits are exchanged; if it"
                " really stands open, shut it and run this again",
            )
        if any(
            p.values.get(name) is Door.OPEN
            and p.values.get("level") is False
            and p.values.get("motion") is Motion.STOPPED
            for p in found
        ) and not any(p.values.get("level") is True for p in found):
            yield facts.finding(
                Severity.WARNING,
                "open-not-level",
                name,
                f"the door reads open while the car is not level with any floor ({facts.printed('level')})",
                "Look at both: door and level inputs may be exchanged, or one of them inverted",
            )


def neither_open_nor_shut(facts: LiftFacts, misfit: Misfit) -> Finding:
    """Explain a door that was never seen at either end."""
    return facts.finding(
        Severity.WARNING,
        "door-between",
        misfit.signal,
        f"the door is neither open nor shut, all the time ({facts.span_s:.0f} s)",
        "Look at the door; if it is shut, its closed contact is inverted (`active` in the map), not wired, or at another address",
    )


def open_under_way(facts: LiftFacts, name: str) -> Finding:
    """Explain a door that is not shut, or a car that is level, while the car moves."""
    motion = f" ({facts.printed('motion')})" if "motion" in facts.lift.codec.signals else ""
    if name == "level":
        text, cure = (
            "the car is level while it moves",
            "this contact is inverted (`active` in the map) or another signal",
        )
    else:
        text = "the door is not shut while the car moves"
        cure = "its contact is inverted (`active` in the map), its two limits are exchanged, or it is another signal"
    return facts.finding(
        Severity.ERROR,
        "open-under-way",
        name,
        f"{text}{motion}",
        f"Watch the lift: if it stands, correct the motion; otherwise {cure}",
    )


def standing_nowhere(facts: LiftFacts) -> Iterator[Finding]:
    """Judge a car that stands all the time: it has to show a floor, and the map's evidence that it stands there."""
    found, signals = facts.pictures, facts.lift.codec.signals
    moves = any(p.values.get("motion") in MOVING for p in found)
    if moves or any(misfit.signal in ("car_floor", "level", "motion") for misfit in facts.misfits):
        return
    needs_door = facts.lift.codec.map.at_floor_evidence.kind == "door_limit"
    if "car_floor" in signals and not needs_door and always(found, "car_floor", None):
        yield facts.finding(
            Severity.WARNING,
            "no-floor",
            "car_floor",
            "no floor is reported, all the time",
            "If the car stands at a floor, look at the switch of that floor; a car that lost its position needs a trip to an end floor",
        )
    elif "level" in signals and always(found, "level", False):
        yield facts.finding(
            Severity.WARNING,
            "not-level",
            "level",
            "the car stands, and is never level with a floor: the manager waits for that before it believes an open door",
            "If the car stands level, this contact is inverted (`active` in the map), not wired, or at another address",
        )
