"""Metrics of an Open-RMF adapter, inside the manager or as a program of its own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from prometheus_client.core import CounterMetricFamily
from prometheus_client.registry import Collector

from lift_manager.metrics.exposition import Family, Kind, format_labels


class AdapterCounts(Protocol):
    """The counts of an adapter, such as `rmf.counts.Counts`."""

    @property
    def requests(self) -> Mapping[tuple[str, str], int]:
        """By RMF's lift name, empty for an unknown lift, and what was done."""
        ...

    @property
    def states(self) -> Mapping[str, int]:
        """By RMF's lift name."""
        ...


@dataclass(frozen=True)
class _Counter:
    name: str
    text: str
    labels: tuple[str, ...]
    samples: tuple[tuple[tuple[str, ...], int], ...]


def rmf_families(counts: AdapterCounts) -> Iterator[Family]:
    """Yield the counts for `/metrics` of the manager."""
    for counter in _counters(counts):
        family = Family(f"{counter.name}_total", Kind.COUNTER, counter.text)
        for words, count in counter.samples:
            family.add(format_labels(**dict(zip(counter.labels, words, strict=True))), count)
        yield family


class RmfCollector(Collector):
    """The same counts for a registry of prometheus-client, whose server runs in threads of its own."""

    def __init__(self, counts: AdapterCounts) -> None:
        self._counts = counts

    def collect(self) -> Iterable[CounterMetricFamily]:
        """Yield the counts."""
        for counter in _counters(self._counts):
            family = CounterMetricFamily(counter.name, counter.text, labels=counter.labels)
            for words, count in counter.samples:
                family.add_metric(words, count)
            yield family


def _counters(counts: AdapterCounts) -> Iterator[_Counter]:
    # each is copied in one step, because another thread may count meanwhile
    requests, states = dict(counts.requests), dict(counts.states)
    yield _Counter(
        "lift_manager_rmf_requests",
        "Lift requests of Open-RMF, by what was done with them; the lift is RMF's, and empty where none of ours was named.",
        ("lift", "result"),
        tuple(requests.items()),
    )
    yield _Counter(
        "lift_manager_rmf_states",
        "Lift states published to Open-RMF.",
        ("lift",),
        tuple(((lift,), count) for lift, count in states.items()),
    )
