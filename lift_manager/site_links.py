"""The links of a site, for faces: their counters and their frames."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from drivers.modbus.histogram import BOUNDS_S, Histogram
from drivers.modbus.link import Link, LinkState
from lift_manager.runtime.links import Durations, LinkFigures, WireFrame


class SiteLinks:
    """The links by the names that their controllers have in the site file: a FrameSource and a LinkSource."""

    def __init__(self, links: Mapping[str, Link]) -> None:
        self._links = dict(links)

    def link_names(self) -> tuple[str, ...]:
        """Return every controller of the site file by its name there."""
        return tuple(self._links)

    @contextmanager
    def tap_frames(self, link: str, callback: Callable[[WireFrame], None]) -> Iterator[None]:
        """Call `callback` with every frame of a link within the context. Raises KeyError for an unknown link."""
        loop = asyncio.get_running_loop()
        with self._links[link].tap(lambda sent, frame: callback(WireFrame(link, sent, frame, loop.time()))):
            yield

    def link_figures(self) -> tuple[LinkFigures, ...]:
        """Return the state and the counters of every link."""
        now = asyncio.get_running_loop().time()
        return tuple(_figures(name, link, now) for name, link in self._links.items())


def _figures(name: str, link: Link, now: float) -> LinkFigures:
    stats = link.stats
    reads, commands = link.waiting
    return LinkFigures(
        link=name,
        up=link.state is LinkState.UP,
        in_doubt=link.in_doubt,
        since_s=None if link.since is None else now - link.since,
        answer_age_s=None if stats.answered_at is None else now - stats.answered_at,
        in_flight=link.in_flight,
        reads_waiting=reads,
        commands_waiting=commands,
        silent_units=len(stats.silent_units),
        counts={
            "requests": stats.transactions,
            "timeouts": stats.timeouts,
            "late_answers": stats.late,
            "desyncs": stats.desyncs,
            "recycles": stats.recycles,
            "connects": stats.connects,
            "failed_connects": stats.failed_connects,
            "losses": stats.losses,
            "exceptions": stats.exceptions,
        },
        round_trips=_durations(stats.round_trips),
        read_waits=_durations(stats.read_waits),
        command_waits=_durations(stats.command_waits),
    )


def _durations(histogram: Histogram) -> Durations:
    return Durations(BOUNDS_S, tuple(histogram.counts), histogram.total_s)
