"""A site and links as the metrics see them, and ways to read what they export."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_open_metrics
from prometheus_client.parser import text_string_to_metric_families as parse_plain

from lift_manager.lift.state import LiftState
from lift_manager.metrics.metrics import Metrics
from lift_manager.runtime.bus import Event
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.links import Durations, LinkFigures
from lift_manager.runtime.site import Site
from tests.lift_manager.web.fake import FakeSite, one_lift
from tests.lift_manager.web.fake_lifts import IDLE
from tests.support.virtual_time import run_virtual

OPEN = "application/openmetrics-text;version=1.0.0;q=0.6,text/plain;version=0.0.4;q=0.3,*/*;q=0.1"
Labels = tuple[tuple[str, str], ...]
BOUNDS_S = (0.01, 0.1)
COUNTS = (
    "requests",
    "timeouts",
    "late_answers",
    "desyncs",
    "recycles",
    "connects",
    "failed_connects",
    "losses",
    "exceptions",
)
LINK = LinkFigures(
    link="tower",
    up=True,
    in_doubt=False,
    since_s=3.5,
    answer_age_s=0.25,
    in_flight=True,
    reads_waiting=2,
    commands_waiting=1,
    silent_units=0,
    counts={name: number for number, name in enumerate(COUNTS, start=1)},
    round_trips=Durations(BOUNDS_S, (3, 2, 1), 0.75),
    read_waits=Durations(BOUNDS_S, (1, 0, 0), 0.0),
    command_waits=Durations(BOUNDS_S, (0, 0, 0), 0.0),
)


class FakeLife(SiteLife):
    """Each lift was polled seven times."""

    def __init__(self, site: Site) -> None:
        super().__init__(site, [])
        self._lifts = site.lift_names()

    def polls(self) -> Mapping[str, int]:
        return dict.fromkeys(self._lifts, 7)


class FakeLinks(NamedTuple):
    """As the test says."""

    links: tuple[LinkFigures, ...]

    def link_figures(self) -> tuple[LinkFigures, ...]:
        return self.links


@dataclass
class Rig:
    """Metrics that run, of a site that is as a test says."""

    site: FakeSite
    metrics: Metrics

    def publish(self, *events: Event) -> None:
        for event in events:
            self.site.happens(event)

    async def read(self, accept: str = "") -> dict[str, dict[Labels, float]]:
        """Scrape once: samples by name and labels, as the library's own parser reads them."""
        return samples(*await self.metrics.scrape(accept))

    async def value(self, sample: str, **labels: str) -> float:
        return (await self.read())[sample][tuple(sorted(labels.items()))]


def samples(body: bytes, content_type: str) -> dict[str, dict[Labels, float]]:
    parse = parse_open_metrics if content_type.startswith("application/openmetrics-text") else parse_plain
    found: dict[str, dict[Labels, float]] = {}
    for family in parse(body.decode()):
        for sample in family.samples:
            of_name = found.setdefault(sample.name, {})
            labels = tuple(sorted(sample.labels.items()))
            assert labels not in of_name, f"{sample.name} {labels} is there twice"
            of_name[labels] = sample.value
    return found


def rig_of(site: FakeSite, links: tuple[LinkFigures, ...] = (LINK,)) -> Rig:
    return Rig(site, Metrics(site, FakeLife(site), FakeLinks(links), version="1.2.3"))


def measured(
    check: Callable[[Rig], Awaitable[None]], site: FakeSite | None = None, links: tuple[LinkFigures, ...] = (LINK,)
) -> None:
    """Run a check on virtual time, with the metrics running."""

    async def main() -> None:
        rig = rig_of(site or one_lift(IDLE), links)
        running = asyncio.ensure_future(rig.metrics.run())
        await asyncio.sleep(0)
        try:
            await check(rig)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    run_virtual(main)


def lifts(count: int) -> dict[str, LiftState]:
    return {f"lift{number}": replace(IDLE, lift=f"lift{number}") for number in range(count)}
