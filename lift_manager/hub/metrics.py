"""The metrics of a hub: one target for all sites."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from prometheus_client import CollectorRegistry, PlatformCollector, ProcessCollector, generate_latest
from prometheus_client.openmetrics.exposition import generate_latest as generate_open_metrics

from lift_manager.hub.remote_site import SiteState
from lift_manager.hub.service import Hub
from lift_manager.metrics.exposition import OPEN_TYPE, PLAIN_TYPE, Family, Kind, accepts_open_metrics, format_labels
from lift_manager.plain.version import running_version


class HubMetrics:
    """Answers scrapes from memory: no site is contacted for them."""

    def __init__(self, hub: Hub, refusals: Mapping[str, int]) -> None:
        """`refusals` counts requests that were refused, by code."""
        self._hub = hub
        self._refusals = refusals
        self._registry = CollectorRegistry()
        for collector in (ProcessCollector(registry=None), PlatformCollector(registry=None)):
            self._registry.register(collector)

    def scrape(self, accept: str) -> tuple[bytes, str]:
        """Return body and content type, in the format that an `Accept` header names."""
        open_metrics = accepts_open_metrics(accept)
        body = "".join(family.text(open_metrics=open_metrics) for family in self._families()).encode()
        if open_metrics:
            rest = generate_open_metrics(self._registry)  # type: ignore[no-untyped-call]  # the library has no types there
            return body + rest, OPEN_TYPE
        return body + generate_latest(self._registry), PLAIN_TYPE

    def _families(self) -> Iterator[Family]:
        build = Family("lift_manager_hub_build_info", Kind.GAUGE, "1, with the version of the program.")
        build.add(format_labels(version=running_version()), 1)
        up = Family("lift_manager_hub_nats_up", Kind.GAUGE, "Whether the hub reaches its NATS server.")
        up.lines.append(f"{up.name} {int(self._hub.is_up)}\n")
        state = Family("lift_manager_hub_site_state", Kind.GAUGE, "1 for the state that a site is in.")
        age = Family(
            "lift_manager_hub_site_news_age_seconds", Kind.GAUGE, "How long ago the newest news of a site arrived."
        )
        lifts = Family("lift_manager_hub_site_lifts", Kind.GAUGE, "Lifts of a site, according to its newest news.")
        live = Family("lift_manager_hub_site_lifts_live", Kind.GAUGE, "Those of them that could be read then.")
        behind = Family(
            "lift_manager_hub_site_rows_behind", Kind.GAUGE, "Rows of a journal that the hub has still to read."
        )
        rows = Family("lift_manager_hub_site_rows_total", Kind.COUNTER, "Rows read from the stream of a site.")
        unreadable = Family("lift_manager_hub_site_unreadable_total", Kind.COUNTER, "Messages that could not be read.")
        for site in self._hub.registry.sites:
            now = self._hub.state(site)
            for other in SiteState:
                state.add(format_labels(site=site, state=other.value), int(other is now))
        for site, remote in self._hub.sites.items():
            labels = format_labels(site=site)
            rows.add(labels, remote.rows_read)
            unreadable.add(labels, remote.unreadable)
            if remote.news is not None and (news_age_s := remote.news_age_s) is not None:
                age.add(labels, news_age_s)
                lifts.add(labels, remote.news.lifts)
                live.add(labels, remote.news.live)
            if (count := remote.rows_behind) is not None:
                behind.add(labels, count)
        refused = Family("lift_manager_hub_refusals_total", Kind.COUNTER, "Requests that the hub refused, by code.")
        for code, count in self._refusals.items():
            refused.add(format_labels(code=code), count)
        yield from (build, up, state, age, lifts, live, behind, rows, unreadable, refused)
