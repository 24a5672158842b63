"""Judges contacts that are made although they should not be: together with another one, or all the time. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.lift_facts import LiftFacts
from lift_manager.commissioning.doctor.picture import Misfit, always
from register_maps.schema import Kind, Signal


def contradiction(facts: LiftFacts, misfit: Misfit) -> Finding:
    """Explain contacts that are made together."""
    name = misfit.signal
    signal, spec = facts.lift.codec.signals[name], facts.lift.codec.map.signals[name]
    often = "all the time" if misfit.is_constant else "at times"
    if signal.kind is Kind.DOOR and spec.open_limit is not None:
        return facts.finding(
            Severity.ERROR,
            "door-contradiction",
            name,
            f"the door reads fully open and fully closed at once, {often}",
            "Open and close the door and look at each contact: one of them is inverted or bridged; a normally-closed pair needs"
            f" `active: {_inverse(spec)}`",
        )
    made = misfit.raw.bit_count()
    kind = {Kind.FLOOR: "floors", Kind.MOTION: "directions", Kind.DOOR: "floors"}[signal.kind]
    if made == len(signal.points) - 1 and len(signal.points) > 2:
        return facts.finding(
            Severity.ERROR,
            "inverted",
            name,
            f"all of its {len(signal.points)} bits but one are made, {often}: they are inverted",
            f"Write `active: {_inverse(spec)}` for this signal in the map",
        )
    return facts.finding(
        Severity.ERROR,
        "contradiction",
        name,
        f"{made} {kind} at once, {often}",
        f"Look at each contact while the car moves: one is stuck, bridged, or inverted (`active: {_inverse(spec)}`)",
    )


def asserted(facts: LiftFacts, misfit: Misfit) -> Finding:
    """Explain a flag or a mode that keeps robots away."""
    name = misfit.signal
    signal, spec = facts.lift.codec.signals[name], facts.lift.codec.map.signals[name]
    value = facts.last_value(name)
    if signal.kind is Kind.MODE:
        return facts.finding(
            Severity.WARNING,
            "in-mode",
            name,
            f"reads {misfit.raw}, {value}: no robot rides in this mode",
            "If the lift is in that mode, put it back into normal service; if it is not, compare the values with the vendor's table",
        )
    contact = "open" if spec.active == "low" else "closed"
    cure = f"this is a normally-{contact} contact: write `active: {_inverse(spec)}` for it in the map"
    if spec.thresholds:
        cure = _compare_thresholds(spec, misfit.raw)
    return facts.finding(
        Severity.WARNING,
        "asserted",
        name,
        f"reports {name.replace('_', ' ')}{'' if misfit.is_constant else ' at times'}: no robot rides",
        f"If it is so, let the lift company reset it; if the lift is at rest, {cure}",
    )


def never_at_rest(facts: LiftFacts) -> Iterator[Finding]:
    """Name the light curtains and overload contacts that report something all the time."""
    for name in facts.lift.codec.signals:
        if (name.startswith("obstruction.") or name == "overload") and always(facts.pictures, name, True):
            spec = facts.lift.codec.map.signals[name]
            what = "an overload" if name == "overload" else "something in the doorway"
            cure = f"it is a normally-closed contact (`active: {_inverse(spec)}` in the map), or a dirty sensor"
            if spec.thresholds:
                cure = _compare_thresholds(spec, facts.last_raw(name))
            yield facts.finding(
                Severity.WARNING,
                "asserted",
                name,
                f"reports {what} all the time",
                f"Look whether that is so; if not, {cure}",
            )


def _inverse(spec: Signal) -> str:
    """Return what `active` would be in the map if this contact is inverted."""
    return "high" if spec.active == "low" else "low"


def _compare_thresholds(spec: Signal, raw: int) -> str:
    """Return the cure for a flag that a number shows."""
    keys = " and ".join(f"`{key}: {number}`" for key, number in spec.thresholds.items())
    return f"compare {keys} with the vendor's table: it reads {raw}"
