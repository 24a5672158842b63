"""Metrics of the links to controllers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lift_manager.metrics.exposition import Family, Kind, format_labels
from lift_manager.runtime.links import Durations, LinkFigures

_COUNTS = {
    "requests": "Modbus requests sent.",
    "timeouts": "Requests that were not answered in time.",
    "late_answers": "Answers that came too late, or twice; they were thrown away.",
    "desyncs": "Answers that fit no request of ours.",
    "recycles": "Connections that we ended because of time-outs or a desync.",
    "connects": "Connections made.",
    "failed_connects": "Connections that could not be made.",
    "losses": "Connections that the other side ended.",
    "exceptions": "Modbus exceptions that the controller answered with, busy ones included.",
}


def link_families(links: Sequence[LinkFigures]) -> Iterator[Family]:
    """Yield every family about links; labels are the controller as the site file names it, and the lane."""
    labels = [format_labels(link=one.link) for one in links]
    yield _gauge("up", "Whether there is a connection to the controller.", labels, [one.up for one in links])
    yield _gauge(
        "in_doubt",
        "Whether it is up, but the last request was not answered in time: nothing is pressed.",
        labels,
        [one.in_doubt for one in links],
    )
    yield _gauge("since_seconds", "How long it has been up, or down.", labels, [one.since_s for one in links])
    yield _gauge(
        "answer_age_seconds",
        "Since the newest answer of the controller; absent before the first.",
        labels,
        [one.answer_age_s for one in links],
    )
    yield _gauge(
        "in_flight", "Requests that left and are not answered, 1 at the most.", labels, [one.in_flight for one in links]
    )
    yield _gauge(
        "silent_units",
        "Units behind this address that do not answer while others do.",
        labels,
        [one.silent_units for one in links],
    )
    yield _waiting(links)
    for name, text in _COUNTS.items():
        family = Family(f"lift_manager_link_{name}_total", Kind.COUNTER, text)
        for label, one in zip(labels, links, strict=True):
            family.add(label, one.counts[name])
        yield family
    yield _trips(links)
    yield _waits(links)


def _gauge(name: str, text: str, labels: Sequence[str], values: Sequence[float | None]) -> Family:
    family = Family(f"lift_manager_link_{name}", Kind.GAUGE, text)
    for label, value in zip(labels, values, strict=True):
        if value is not None:
            family.add(label, value + 0)  # a bool becomes a number
    return family


def _waiting(links: Sequence[LinkFigures]) -> Family:
    family = Family("lift_manager_link_waiting", Kind.GAUGE, "Requests that wait for their turn on the link.")
    for one in links:
        family.add(format_labels(link=one.link, lane="read"), one.reads_waiting)
        family.add(format_labels(link=one.link, lane="command"), one.commands_waiting)
    return family


def _trips(links: Sequence[LinkFigures]) -> Family:
    family = Family(
        "lift_manager_link_round_trip_seconds",
        Kind.HISTOGRAM,
        "From request to answer, late answers included; what was never answered is among the time-outs.",
    )
    for one in links:
        _add(family, format_labels(link=one.link), one.round_trips)
    return family


def _waits(links: Sequence[LinkFigures]) -> Family:
    family = Family(
        "lift_manager_link_wait_seconds", Kind.HISTOGRAM, "How long requests waited for their turn on the link."
    )
    for one in links:
        _add(family, format_labels(link=one.link, lane="read"), one.read_waits)
        _add(family, format_labels(link=one.link, lane="command"), one.command_waits)
    return family


def _add(family: Family, labels: str, found: Durations) -> None:
    family.add_histogram(labels, found.bounds_s, found.counts, found.total_s)
