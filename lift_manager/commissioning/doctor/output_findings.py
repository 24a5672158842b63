"""Judges the outputs of a lift: whether another client writes them, or nobody could have. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lift_manager.commissioning.doctor.evidence import Probe, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.lift_facts import LiftFacts
from register_maps.codec import CommandCodec
from register_maps.words import Table

MOST_STATES = 4
"""Different states of one output that a line lists."""


def foreign_outputs(facts: LiftFacts) -> Iterator[Finding]:
    """Look for another client: outputs that change, or are on, although nothing was written."""
    for command in facts.lift.own_outputs:
        states = list(_states(facts, command))
        if (odd := next((raw for raw, _ in states if not _can_hold(facts, command, raw)), None)) is not None:
            yield facts.finding(
                Severity.ERROR,
                "odd-output",
                command.name,
                f"reads {' '.join(map(str, odd))}, which no client would write: this address holds something else",
                f"Compare the address with the vendor's table{facts.suggested(Probe.OFFSET, Probe.TABLE)}",
            )
        elif len({raw for raw, _ in states}) > 1:
            seen = list(dict.fromkeys(" ".join(map(str, raw)) for raw, _ in states))
            yield facts.finding(
                Severity.ERROR,
                "second-master",
                command.name,
                f"changes between {' and '.join(seen[:MOST_STATES])}, and doctor writes nothing: another client commands this lift",
                "Find and end it (another manager, building management, a test tool, the controller's own web page): two masters"
                " press against each other",
            )
        elif states and states[-1][1]:
            yield facts.finding(
                Severity.WARNING,
                "output-on",
                command.name,
                f"is on (reads {' '.join(map(str, states[-1][0]))}) although no manager runs here",
                "Find the other client, or what a test has left behind; the manager releases it when it starts with `access: control`",
            )


def _can_hold(facts: LiftFacts, command: CommandCodec, raws: Sequence[int]) -> bool:
    """Whether a client that uses this command would leave these values: rest, a press, or a floor of this lift."""
    codes = facts.lift.floors if command.is_call and facts.lift.floors else None
    if command.is_call and codes is None and command.spec.one_of is None:
        return True
    presses = [None, *(codes or command.spec.floor_codes or [1])]
    for code in presses:
        try:
            pressed = command.encode(code)
        except ValueError:
            continue
        if list(raws) == [pressed[point] for point in command.points]:
            return True
    return command.spec.payload is not None or len(raws) > 1


def _states(facts: LiftFacts, command: CommandCodec) -> Iterator[tuple[tuple[int, ...], bool]]:
    """Yield what the points of a command read, and whether that is another value than its rest."""
    rest = command.encode(None)
    cells: dict[tuple[str, int, Table, int], int] = {}
    for name, controller in facts.evidence.controllers.items():
        for answer in controller.of(Purpose.OUTPUTS):
            if answer.values is None:
                continue
            for place, value in enumerate(answer.values):
                cells[name, answer.unit, answer.table, answer.address + place] = value
            raws = []
            for point in command.read_points:
                device = facts.lift.device(point)
                cell = cells.get((device.controller, device.unit_id, point.table, point.address))
                if cell is None:
                    break
                raws.append(point.within(cell))
            else:
                expected = [rest[point] for point in command.points]
                yield tuple(raws), raws != expected


def is_on(facts: LiftFacts, name: str) -> bool:
    """Whether an output was seen at another value than its rest; False for one that the map does not have."""
    command = facts.lift.codec.commands.get(name)
    return command is not None and any(on for _, on in _states(facts, command))
