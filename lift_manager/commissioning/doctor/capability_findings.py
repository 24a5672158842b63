"""Notes what a controller can do: for how many clients, on which ports, in which tables, and how much in one read. Pure."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from operator import itemgetter

from drivers.errors import ILLEGAL_FUNCTION
from lift_manager.commissioning.doctor.connection_facts import ConnectionFacts
from lift_manager.commissioning.doctor.evidence import ControllerEvidence, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.wording import TABLE_NAMES
from register_maps.words import BIT_TABLES, READ_FUNCTION, Table


def clients(facts: ConnectionFacts) -> Iterator[Finding]:
    """Judge for how many clients a controller has slots."""
    slots = facts.evidence.slots
    if slots is None:
        return
    if slots.further == 0:
        text = "it serves one client at a time"
        cure = (
            "Keep every other client off it while the manager runs; watch, trace and poke then work through the manager, building"
            " management needs another way; write `max_connections: 1` under `link` in the map"
        )
        is_known = facts.controller.link.max_connections == 1
        yield facts.finding(Severity.NOTE if is_known else Severity.WARNING, "single-slot", text, cure)
    elif not slots.first_survived:
        yield facts.finding(
            Severity.WARNING,
            "drops-oldest",
            "a new connection throws the oldest one out",
            "Keep every other client off it: a diagnosis tool would cut off the manager",
        )
    else:
        most = f"{slots.further + 1}" if slots.further < slots.tried else f"at least {slots.further + 1}"
        yield facts.finding(Severity.NOTE, "slots", f"it serves {most} clients at once")


def ports(facts: ConnectionFacts) -> Iterator[Finding]:
    """Note which of the usual ports accept a connection."""
    if facts.evidence.open_ports is not None:
        accepting = ", ".join(map(str, facts.evidence.open_ports)) or "none"
        yield facts.finding(Severity.NOTE, "ports", f"of the usual ports these accept a connection: {accepting}")


def tables(facts: ConnectionFacts) -> Iterator[Finding]:
    """Note which tables there are, and which addresses of them are served."""
    for table in Table:
        at_zero = [a for a in facts.evidence.of(Purpose.RANGE) if a.table is table]
        if at_zero and all(answer.exception == ILLEGAL_FUNCTION for answer in at_zero):
            yield facts.finding(
                Severity.NOTE,
                "no-table",
                f"it has no {TABLE_NAMES[table]} (function {READ_FUNCTION[table]} is refused)",
            )
    for (unit, table), ranges in served_ranges(facts.evidence).items():
        text = ", ".join(f"{low} to {high}" if high > low else f"{low}" for low, high in ranges)
        yield facts.finding(
            Severity.NOTE, "served", f"{TABLE_NAMES[table]} that answered, on the wire: {text} (unit {unit})"
        )


def read_lengths(facts: ConnectionFacts) -> Iterator[Finding]:
    """Judge how much a controller answers in one read."""
    for (unit, table, start), (good, refused) in largest_blocks(facts.evidence).items():
        noun = TABLE_NAMES[table]
        limit = _limit(facts, table)
        if refused is not None and good < limit:
            key = "max_bits_per_read" if table in BIT_TABLES else "max_registers_per_read"
            yield facts.finding(
                Severity.ERROR if good < _longest_poll(facts, table) else Severity.NOTE,
                "largest-block",
                f"it answers reads of up to {good} {noun}, and refuses {refused} ({start} on the wire, unit {unit})",
                f"Write `{key}: {good}` for this controller" if good < _longest_poll(facts, table) else "",
            )
        elif refused is None:
            yield facts.finding(
                Severity.NOTE,
                "largest-block",
                f"it answers all {good} {noun} from {start} on the wire in one read (unit {unit})",
            )


def _limit(facts: ConnectionFacts, table: Table) -> int:
    link = facts.controller.link
    return link.max_bits_per_read if table in BIT_TABLES else link.max_registers_per_read


def _longest_poll(facts: ConnectionFacts, table: Table) -> int:
    polls = facts.subjects.polls_on(facts.controller.name)
    return max((block.count for _, block in polls if block.table is table), default=0)


def served_ranges(evidence: ControllerEvidence) -> dict[tuple[int, Table], tuple[tuple[int, int], ...]]:
    """Return the addresses that answered with values, by unit and table, as ranges without a refused address in them."""
    read: dict[tuple[int, Table], dict[int, bool]] = {}
    if not any(True for _ in evidence.of(Purpose.RANGE)):
        return {}
    for answer in evidence.of(Purpose.RANGE, Purpose.POLL, Purpose.POINT, Purpose.OUTPUTS):
        if answer.values is not None or answer.count == 1:
            addresses = range(answer.address, answer.address + answer.count)
            read.setdefault((answer.unit, answer.table), {}).update(dict.fromkeys(addresses, answer.values is not None))
    found = {key: tuple(_ranges(sorted(tried.items()))) for key, tried in sorted(read.items())}
    return {key: ranges for key, ranges in found.items() if ranges}


def largest_blocks(evidence: ControllerEvidence) -> dict[tuple[int, Table, int], tuple[int, int | None]]:
    """Return the longest read that was answered, and the shortest that was not, by unit, table and first address."""
    found: dict[tuple[int, Table, int], tuple[int, int | None]] = {}
    for answer in evidence.of(Purpose.BLOCK):
        key = answer.unit, answer.table, answer.address
        good, refused = found.get(key, (0, None))
        if answer.values is not None:
            found[key] = max(good, answer.count), refused
        else:
            found[key] = good, answer.count if refused is None else min(refused, answer.count)
    return found


def _ranges(tried: Iterable[tuple[int, bool]]) -> Iterator[tuple[int, int]]:
    """Yield (first, last) of the addresses that answered, up to the next one that did not."""
    for answered, run in itertools.groupby(tried, key=itemgetter(1)):
        if answered:
            first, *rest = (address for address, _ in run)
            yield first, rest[-1] if rest else first
