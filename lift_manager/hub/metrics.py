"""The metrics of a hub: one target for all sites."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime

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
        yield from self._of_the_hub()
        yield from self._of_sites()
        yield from self._of_updates()

    def _of_the_hub(self) -> Iterator[Family]:
        build = Family("lift_manager_hub_build_info", Kind.GAUGE, "1, with the version of the program.")
        build.add(format_labels(version=running_version()), 1)
        up = Family("lift_manager_hub_nats_up", Kind.GAUGE, "Whether the hub reaches its NATS server.")
        up.lines.append(f"{up.name} {int(self._hub.is_up)}\n")
        refused = Family("lift_manager_hub_refusals_total", Kind.COUNTER, "Requests that the hub refused, by code.")
        for code, count in self._refusals.items():
            refused.add(format_labels(code=code), count)
        left = Family(
            "lift_manager_hub_certificate_remaining_seconds",
            Kind.GAUGE,
            "How long a certificate of the hub is still valid; 0 for one that cannot be read.",
        )
        now = datetime.now(UTC)
        for name, until in self._hub.certificates.items():
            left.add(format_labels(certificate=name), 0 if until is None else (until - now).total_seconds())
        yield from (build, up, refused, left)

    def _of_sites(self) -> Iterator[Family]:
        state = Family("lift_manager_hub_site_state", Kind.GAUGE, "1 for the state that a site is in.")
        sites = Family("lift_manager_hub_sites", Kind.GAUGE, "How many sites are in a state.")
        age = Family(
            "lift_manager_hub_site_news_age_seconds", Kind.GAUGE, "How long ago the newest news of a site arrived."
        )
        offline = Family("lift_manager_hub_site_offline_total", Kind.COUNTER, "How often a site has turned offline.")
        lifts = Family("lift_manager_hub_site_lifts", Kind.GAUGE, "Lifts of a site, according to its newest news.")
        live = Family("lift_manager_hub_site_lifts_live", Kind.GAUGE, "Those of them that could be read then.")
        behind = Family(
            "lift_manager_hub_site_rows_behind", Kind.GAUGE, "Rows of a journal that the hub has still to read."
        )
        rows = Family("lift_manager_hub_site_rows_total", Kind.COUNTER, "Rows read from the stream of a site.")
        unreadable = Family("lift_manager_hub_site_unreadable_total", Kind.COUNTER, "Messages that could not be read.")
        states = {site: self._hub.state(site) for site in self._hub.registry.sites}
        words = [(other, format_labels(state=other.value)) for other in SiteState]
        for site, now in states.items():
            of_site = format_labels(site=site)
            for other, word in words:
                state.add(f"{of_site},{word}", int(other is now))
        counts = Counter(states.values())
        for one in SiteState:
            sites.add(format_labels(state=one.value), counts[one])
        for site, remote in self._hub.sites.items():
            labels = format_labels(site=site)
            offline.add(labels, remote.times_offline)
            rows.add(labels, remote.rows_read)
            unreadable.add(labels, remote.unreadable)
            if remote.news is not None and (news_age_s := remote.news_age_s) is not None:
                age.add(labels, news_age_s)
                lifts.add(labels, remote.news.lifts)
                live.add(labels, remote.news.live)
            if (count := remote.rows_behind) is not None:
                behind.add(labels, count)
        yield from (state, sites, age, offline, lifts, live, behind, rows, unreadable)

    def _of_updates(self) -> Iterator[Family]:
        installed = Family(
            "lift_manager_hub_site_update_installed",
            Kind.GAUGE,
            "The number of the configuration update by which a site runs, as it has reported last; 0 for none.",
        )
        progress = Family(
            "lift_manager_hub_site_update_progress", Kind.GAUGE, "1 for how far a site is with the newest roll-out."
        )
        for site in self._hub.registry.sites:
            found = self._hub.update_of(site)
            if (report := found.status.report) is not None:
                installed.add(format_labels(site=site), report.installed)
            if (word := found.progress) is not None:
                progress.add(format_labels(site=site, progress=word.value), 1)
        yield from (installed, progress)
