"""Reads the timeline of a scenario, and checks every step against the lifts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lift_manager.lab.scenario.faults import WireFaultSpec, read_fault, read_people, read_wire
from lift_manager.lab.scenario.matching import Match, read_match
from lift_manager.lab.scenario.mistakes import Mistakes
from lift_manager.lab.scenario.schema import ACTIONS, STEP_KEY_NEEDS, Scenario, Step
from lift_manager.lab.scenario.trace import TracedLift
from lift_manager.lab.world.fault_names import fault_name
from register_maps.source import KeyPath
from simulator.faults import DisconnectedSignal, Fault, ForeignCell, ForeignWriter
from simulator.people import Traffic


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of a step with readers of their own; None if the step does not have them."""

    when: Match | None
    until: Match | None
    fault: Fault | None
    wire: WireFaultSpec | None
    people: tuple[int | None, Traffic] | None
    """The seed, None for the scenario's own, and how they behave."""


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """One step, ready to be carried out."""

    line: int
    """Its line in the file."""
    action: str
    """One of `schema.ACTIONS`."""
    step: Step
    lift: str
    parts: Parts


def read_steps(
    scenario: Scenario | None, lifts: Mapping[str, TracedLift], mistakes: Mistakes
) -> tuple[PlannedStep, ...]:
    """Read the timeline and add what is wrong with it to the mistakes. Without lifts, names are not checked."""
    raw = mistakes.source.data
    listed = raw.get("do") if isinstance(raw, dict) else None
    for index, step in enumerate(listed if isinstance(listed, list) else ()):
        if isinstance(step, dict) and scenario is None:
            # the models have refused the file; these parts have readers of their own, which add their mistakes
            _parts(step, ("do", index), mistakes, None)
    if listed == []:
        mistakes.add(("do",), "is empty; add a step")
    if scenario is None:
        return ()
    planned = [_planned(index, step, scenario, lifts, mistakes) for index, step in enumerate(scenario.do)]
    return tuple(one for one in planned if one is not None)


def lift_of(lift: str | None, lifts: Mapping[str, TracedLift], path: KeyPath, mistakes: Mistakes) -> str:
    """Return the lift of a step or expectation. If there are several, it must be named."""
    if lift is None and len(lifts) > 1:
        mistakes.add(path, f"must name the `lift`; there is {', '.join(lifts)}")
    if lift is not None and lifts and lift not in lifts:
        mistakes.add((*path, "lift"), f"no lift {lift!r}; there is {', '.join(lifts)}")
    return lift if lift is not None else next(iter(lifts), "")


def check_key_needs(
    given: Iterable[str], needs: Mapping[str, tuple[str, ...]], path: KeyPath, mistakes: Mistakes
) -> None:
    """Report keys that are given without any of the keys that they need."""
    keys = set(given)
    for key in sorted(keys & needs.keys()):
        if not keys & set(needs[key]):
            needed = " or ".join(f"`{one}`" for one in needs[key])
            mistakes.add((*path, key), f"belongs to {needed}, and there is none here")


def one_of(given: Iterable[str], allowed: tuple[str, ...], path: KeyPath, mistakes: Mistakes) -> str | None:
    """Return the only one of these keys that is given; None, with a mistake, if there is none or more than one."""
    found = [key for key in allowed if key in set(given)]
    if len(found) == 1:
        return found[0]
    if found:
        mistakes.add((*path, found[1]), f"cannot go with `{found[0]}`; write two entries, each with one of them")
    else:
        mistakes.add(path, f"must have one of {', '.join(allowed)}")
    return None


def keys_of(step: Step) -> list[str]:
    """Return the keys that a step has."""
    return [key for key in step.model_fields_set if getattr(step, key) is not None]


def _planned(
    index: int, step: Step, scenario: Scenario, lifts: Mapping[str, TracedLift], mistakes: Mistakes
) -> PlannedStep | None:
    path: KeyPath = ("do", index)
    given = keys_of(step)
    lift = lift_of(step.lift, lifts, path, mistakes)
    known = lifts.get(lift)
    check_key_needs(given, STEP_KEY_NEEDS, path, mistakes)
    parts = _parts({key: getattr(step, key) for key in given}, path, mistakes, known)
    action = one_of(given, ACTIONS, path, mistakes)
    if step.at is None and step.when is None:
        mistakes.add(path, "needs `at`, a time in seconds, or `when`, a match")
    if step.at is not None and step.at >= scenario.lasts_s:
        mistakes.add((*path, "at"), f"is after the end: the scenario lasts {scenario.lasts_s:g} s")
    if known is not None:
        _check_names(step, path, known, mistakes)
        _check_parts(parts, path, known, mistakes)
    return None if action is None else PlannedStep(mistakes.source.line(path) or 0, action, step, lift, parts)


def _parts(given: Mapping[str, object], path: KeyPath, mistakes: Mistakes, known: TracedLift | None) -> Parts:
    floors = None if known is None else known.floors

    def match(key: str) -> Match | None:
        return read_match(given[key], (*path, key), mistakes, floors) if key in given else None

    people = given.get("people")
    return Parts(
        when=match("when"),
        until=match("until"),
        fault=read_fault(given["fault"], (*path, "fault"), mistakes, floors) if "fault" in given else None,
        wire=read_wire(given["wire"], (*path, "wire"), mistakes) if "wire" in given else None,
        people=read_people(people, (*path, "people"), mistakes) if "people" in given else None,
    )


def _check_names(step: Step, path: KeyPath, known: TracedLift, mistakes: Mistakes) -> None:
    named: list[tuple[KeyPath, str]] = []
    if step.request is not None:
        named.append((("request", "floor"), step.request.floor))
    if step.robot is not None:
        named += [(("robot", "from"), step.robot.from_), (("robot", "to"), step.robot.to)]
        if step.robot.from_ == step.robot.to:
            mistakes.add((*path, "robot", "to"), "is where the robot starts; name another floor")
    if step.inputs is not None:
        for key in ("car_buttons", "landing_buttons"):
            named += [(("inputs", key, place), floor) for place, floor in enumerate(getattr(step.inputs, key))]
        if not any(value for _, value in step.inputs):
            mistakes.add((*path, "inputs"), "is empty; name what people press or block")
    for place, floor in named:
        if floor not in known.floors:
            mistakes.add((*path, *place), f"no floor {floor!r}; there is {', '.join(known.floors)}")


def _check_parts(parts: Parts, path: KeyPath, known: TracedLift, mistakes: Mistakes) -> None:
    if parts.wire is not None and parts.wire.controller not in (None, *known.controllers):
        message = f"no controller {parts.wire.controller!r}; there is {', '.join(known.controllers)}"
        mistakes.add((*path, "wire", "controller"), message)
    if isinstance(parts.fault, ForeignCell | DisconnectedSignal) and (objection := known.objection(parts.fault)):
        mistakes.add((*path, "fault", fault_name(parts.fault)), objection)
    if not isinstance(parts.fault, ForeignWriter):
        return
    here: KeyPath = (*path, "fault", "foreign_writer")
    if parts.fault.command not in known.commands:
        message = f"no command {parts.fault.command!r}; the map has {', '.join(sorted(known.commands))}"
        mistakes.add((*here, "command"), message)
    elif parts.fault.command in known.calls and parts.fault.pressed and parts.fault.floor is None:
        mistakes.add(here, f"must name the `floor` for which {parts.fault.command} is written")
