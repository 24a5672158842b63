"""Judges the addresses of a lift that its controller refuses: points, whole tables, blocks, and outputs that cannot be read back. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from drivers.errors import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION
from lift_manager.commissioning.doctor.evidence import Answer, Probe, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.lift_facts import LiftFacts
from lift_manager.commissioning.doctor.subjects import SIBLING
from lift_manager.commissioning.wording import FUNCTIONS, TABLE_NAMES
from register_maps.codec import Block, Point
from register_maps.errors import EXCEPTION_NAMES
from register_maps.words import BIT_TABLES, READ_FUNCTION, Table


def refusals(facts: LiftFacts) -> Iterator[Finding]:
    """Name the points that were answered with an exception, and blocks that only as a whole were."""
    refused = list(_refused_points(facts))
    by_code: dict[tuple[str, Table, int], list[Point]] = {}
    for point, code in refused:
        by_code.setdefault((point.endpoint, point.table, code), []).append(point)
    for (endpoint, table, code), points in by_code.items():
        of_table = {p.cell for p in facts.lift.codec.signal_points if (p.endpoint, p.table) == (endpoint, table)}
        is_all = len({p.cell for p in points}) == len(of_table)
        if code == ILLEGAL_FUNCTION or (code == ILLEGAL_ADDRESS and is_all):
            yield _refused_table(facts, points[0], len(of_table), code)
        else:
            yield from _refused_one_by_one(facts, points, code)
    yield from _refused_blocks(facts, {point.cell for point, _ in refused})
    yield from _refused_outputs(facts)


def _refused_points(facts: LiftFacts) -> Iterator[tuple[Point, int]]:
    """Yield the points of signals that were answered with an exception when read by themselves, with its code."""
    lift = facts.lift
    answers: dict[tuple[str, int, Table, int], Answer] = {
        (name, answer.unit, answer.table, answer.address): answer
        for name, controller in facts.evidence.controllers.items()
        for answer in controller.of(Purpose.POLL, Purpose.POINT)
        if answer.count == 1
    }
    for point in dict.fromkeys(point for signal in lift.codec.signals.values() for point in signal.points):
        device = lift.device(point)
        answer = answers.get((device.controller, device.unit_id, point.table, point.address))
        if answer is not None and answer.exception is not None and answer.is_refusal:
            yield point, answer.exception


def _refused_table(facts: LiftFacts, first: Point, count: int, code: int) -> Finding:
    function = READ_FUNCTION[first.table]
    return Finding(
        Severity.ERROR,
        "table-refused",
        facts.lift.name,
        facts.lift.printed_cell(first),
        f"the controller refuses all {count} {TABLE_NAMES[first.table]} of the map (function {function},"
        f" {FUNCTIONS[function]}: exception {code:02X}, {EXCEPTION_NAMES.get(code, '')})",
        f"Look up in the vendor's table whether they are {TABLE_NAMES[SIBLING[first.table]]}, and from which number it counts"
        f"{facts.suggested(Probe.TABLE, Probe.OFFSET)}",
    )


def _refused_one_by_one(facts: LiftFacts, points: Sequence[Point], code: int) -> Iterator[Finding]:
    first_of: dict[tuple[str, Table, int], Point] = {}
    for point in points:
        first_of.setdefault(point.cell, point)
    for point in first_of.values():
        yield Finding(
            Severity.ERROR,
            "refused-point",
            facts.lift.name,
            facts.lift.printed_cell(point),
            f"the controller answers exception {code:02X} ({EXCEPTION_NAMES.get(code, 'not in the specification')})",
            "Compare this address with the vendor's table; a signal that this controller does not have is left out of the map"
            if code == ILLEGAL_ADDRESS
            else "Ask the vendor what this answer means; the manager cannot use the point like this",
        )


def _refused_blocks(facts: LiftFacts, explained: set[tuple[str, Table, int]]) -> Iterator[Finding]:
    """Name the first block of each controller that is refused although none of its cells is."""
    for name, controller in facts.evidence.controllers.items():
        for answer in controller.of(Purpose.POLL):
            block = _polled_block(facts, name, answer)
            if not answer.is_refusal or block is None or block.count == 1 or explained & set(block.cells):
                continue
            yield Finding(
                Severity.ERROR,
                "refused-block",
                facts.lift.name,
                f"{block.table} {block.start} to {block.start + block.count - 1} on the wire",
                f"the controller answers each address, but not these {block.count} in one read (exception {answer.exception:02X})",
                "Correct `served` of the map where there is a hole, or write a smaller "
                f"`{'max_bits_per_read' if block.table in BIT_TABLES else 'max_registers_per_read'}` for this controller"
                f"{facts.suggested(Probe.BLOCK)}",
            )
            break


def _polled_block(facts: LiftFacts, controller: str, answer: Answer) -> Block | None:
    """Return the block of the lift that a read was made for."""
    return next(
        (
            block
            for block in facts.lift.blocks
            if (block.table, block.start, block.count) == (answer.table, answer.address, answer.count)
            and facts.lift.device(block).controller == controller
        ),
        None,
    )


def _refused_outputs(facts: LiftFacts) -> Iterator[Finding]:
    for name, controller in facts.evidence.controllers.items():
        refused = next((answer for answer in controller.of(Purpose.OUTPUTS) if answer.is_refusal), None)
        if refused is None:
            continue
        commands = [
            command.name
            for command in facts.lift.own_outputs
            if any(
                (point.table, facts.lift.device(point).controller) == (refused.table, name)
                and refused.address <= point.address < refused.address + refused.count
                for point in command.read_points
            )
        ]
        if commands:
            yield facts.finding(
                Severity.ERROR,
                "refused-output",
                commands[0],
                f"the outputs {', '.join(commands)} cannot be read back (exception {refused.exception:02X}): the manager could not"
                " verify that they are released",
                "Compare these addresses with the vendor's table, and say in the map where they are read back (`read_at`)",
            )
