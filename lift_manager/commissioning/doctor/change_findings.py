"""Judges how signals change: heartbeats that stand still, floors that jump, inputs that are stuck or drift or never changed. Pure."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from lift_manager.commissioning.doctor.evidence import Probe
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.lift_facts import LiftFacts
from lift_manager.commissioning.doctor.picture import MOVING, Misfit, changes, trips

MOST_LISTED = 8
"""Signals that did not change that are listed; of more only the number is given."""
DRIFT_STEPS = 5
"""Changes in one direction that are no noise. Chosen."""
RIDE_S = 120
"""Long enough for a ride by hand through a building, for the advice."""


def still_heartbeat(facts: LiftFacts, misfit: Misfit) -> Finding:
    """Explain an alive counter that never changed."""
    return facts.finding(
        Severity.ERROR,
        "heartbeat-still",
        misfit.signal,
        f"the alive counter stands at {misfit.raw}: the controller answers, but its program does not run, or it counts elsewhere",
        "Start the program of the controller, or correct the address of `alive` in the map",
    )


def slow_heartbeat(facts: LiftFacts) -> Iterator[Finding]:
    """Compare the longest pause of an alive counter that does change with what the map allows."""
    alive = facts.lift.codec.map.signals.get("alive")
    times = [(p.at_s, p.raw["alive"]) for p in facts.pictures if "alive" in p.raw]
    if alive is None or alive.must_change_within_s is None or len(times) < 2:
        return
    since, longest_s = times[0][0], 0.0
    for (_, before), (at_s, raw) in itertools.pairwise(times):
        if raw == before:
            longest_s = max(longest_s, at_s - since)
        else:
            since = at_s
    if len({raw for _, raw in times}) > 1 and longest_s > alive.must_change_within_s:
        yield facts.finding(
            Severity.ERROR,
            "heartbeat-slow",
            "alive",
            f"the alive counter stood still for {longest_s:.1f} s, and the map allows {alive.must_change_within_s:g} s",
            "Let the controller count faster, or raise `must_change_within_s` of `alive` in the map: a dead program is noticed as late",
        )


def restless_floor(facts: LiftFacts, misfit: Misfit) -> Finding:
    """Explain a floor that jumps about."""
    return facts.finding(
        Severity.ERROR,
        "restless",
        misfit.signal,
        "the floor changes as that of no car does: this address holds something else, such as a counter or a clock",
        f"Compare the address with the vendor's table{facts.suggested(Probe.OFFSET)}",
    )


def stuck(facts: LiftFacts) -> Iterator[Finding]:
    """Name the signals that did not change while the car changed floors."""
    found, signals = facts.pictures, facts.lift.codec.signals
    times = trips(found)
    if not times or any(misfit.signal == "car_floor" for misfit in facts.misfits):
        return
    for name in signals:
        if (name.startswith("door.") or name in ("motion", "level")) and not changes(found, name):
            yield facts.finding(
                Severity.WARNING,
                "stuck",
                name,
                f"did not change while the car changed floors {times} time{'' if times == 1 else 's'}",
                "Look at the contact while the lift is ridden with the door used: it is stuck, not wired, or at another address",
            )


def drifting(facts: LiftFacts) -> Iterator[Finding]:
    """Name numbers that go on in one direction although the car stands with its doors shut."""
    lift, found = facts.lift, facts.pictures
    doors = [name for name in lift.codec.signals if name.startswith("door.")]
    stands = not trips(found) and not any(changes(found, name) for name in ("motion", *doors))
    if any(p.values.get("motion") in MOVING for p in found) or not stands:
        return
    for name in ("car_position", "load"):
        numbers = [p.values[name] for p in found if name in p.values]
        steps = [b - a for a, b in itertools.pairwise(numbers) if isinstance(a, int) and isinstance(b, int) and a != b]
        if len(steps) >= DRIFT_STEPS and (all(step > 0 for step in steps) or all(step < 0 for step in steps)):
            yield facts.finding(
                Severity.WARNING,
                "drifts",
                name,
                f"went from {numbers[0]} to {numbers[-1]} while the car stood with its doors shut",
                "Look at the sensor and its shield; what drifts past the tolerance of a floor shows the car somewhere else",
            )


def never_changed(facts: LiftFacts) -> Iterator[Finding]:
    """Name what this run could not prove."""
    found = facts.pictures
    still = [name for name in facts.lift.codec.signals if name != "alive" and not changes(found, name)]
    if still and facts.span_s:
        signals = len(facts.lift.codec.signals)
        count = f"{len(still)} of {signals} signals" if len(still) < signals else f"all {signals} signals"
        which = ", ".join(still) if len(still) <= MOST_LISTED else count
        yield facts.finding(
            Severity.NOTE,
            "never-changed",
            "",
            f"{which} did not change in {facts.span_s:.0f} s, so nothing is proven about {'it' if len(still) == 1 else 'them'}",
            f"Ride the lift by hand with `--seconds {RIDE_S}`; `checkout` proves them one by one",
        )
