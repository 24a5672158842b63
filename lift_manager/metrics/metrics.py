"""All metrics of one running manager."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from prometheus_client import generate_latest
from prometheus_client.openmetrics.exposition import generate_latest as generate_open_metrics

from lift_manager.metrics.counts import EventCounts
from lift_manager.metrics.exposition import OPEN_TYPE, PLAIN_TYPE, Family, Kind, accepts_open_metrics, format_labels
from lift_manager.metrics.lag import ProcessLag
from lift_manager.metrics.lifts import LiftFamilies
from lift_manager.metrics.links import link_families
from lift_manager.metrics.rmf import AdapterCounts, rmf_families
from lift_manager.runtime.bus import Occurrence
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.links import LinkSource
from lift_manager.runtime.site import Site

_LIFTS_AT_ONCE = 10
"""Lifts processed in one turn of the loop. Chosen: that takes less than a millisecond."""
_FILES = ("journal", "state")


class Metrics:
    """Counts while `run` runs, and answers scrapes from memory: none waits for a controller."""

    def __init__(self, site: Site, life: SiteLife, links: LinkSource, *, version: str) -> None:
        self._site = site
        self._life = life
        self._links = links
        self._version = version
        self._counts = EventCounts({name: site.config(name).capabilities.commands for name in site.lift_names()})
        self._lag = ProcessLag()
        self._rmf: AdapterCounts | None = None

    def count_rmf(self, counts: AdapterCounts) -> None:
        """Include the counts of an Open-RMF adapter in this process."""
        self._rmf = counts

    async def run(self) -> None:
        """Count and measure until cancelled."""
        with self._site.overhear(self._on_event):
            await self._lag.run()

    async def scrape(self, accept: str) -> tuple[bytes, str]:
        """Return body and content type, in the format that an `Accept` header names. Other tasks run in between."""
        open_metrics = accepts_open_metrics(accept)
        parts = []
        async for family in self._families():
            parts.append(family.text(open_metrics=open_metrics))
            await asyncio.sleep(0)
        body = "".join(parts).encode()
        if open_metrics:
            rest = generate_open_metrics(self._lag.registry)  # type: ignore[no-untyped-call]  # the library has no types there
            return body + rest, OPEN_TYPE
        return body + generate_latest(self._lag.registry), PLAIN_TYPE

    def _on_event(self, occurrence: Occurrence) -> None:
        self._counts.count_event(occurrence.event)
        self._lag.measure_event(occurrence)

    async def _families(self) -> AsyncIterator[Family]:
        yield self._build()
        yield self._files_written()
        lifts = LiftFamilies()
        for index, name in enumerate(self._site.lift_names(), start=1):
            lifts.add(self._site.state(name))
            if not index % _LIFTS_AT_ONCE:
                await asyncio.sleep(0)
        for family in (*lifts.families(), self._polls(), self._refusals(), *self._counts.families()):
            yield family
        for family in link_families(self._links.link_figures()):
            yield family
        for family in () if self._rmf is None else rmf_families(self._rmf):
            yield family

    def _build(self) -> Family:
        family = Family("lift_manager_build_info", Kind.GAUGE, "1, with the version of the program.")
        family.add(format_labels(version=self._version), 1)
        return family

    def _files_written(self) -> Family:
        text = "Whether this can be written; while one cannot, nothing is pressed on any lift."
        family = Family("lift_manager_file_written", Kind.GAUGE, text)
        for file in _FILES:
            family.add(format_labels(file=file), int(file not in self._site.unwritten))
        return family

    def _polls(self) -> Family:
        family = Family("lift_manager_polls_total", Kind.COUNTER, "Polls of a lift that have ended, well or not.")
        for lift, count in self._life.polls().items():
            family.add(format_labels(lift=lift), count)
        return family

    def _refusals(self) -> Family:
        text = "Requests that were refused, by code; the lift is empty where none of the site was named."
        family = Family("lift_manager_refusals_total", Kind.COUNTER, text)
        for (lift, code), count in self._site.refusals.counts.items():
            family.add(format_labels(lift=lift, code=code), count)
        return family
