"""Measures how late the program itself is: its loop, and its events."""

from __future__ import annotations

import asyncio

from prometheus_client import CollectorRegistry, Histogram, ProcessCollector

from lift_manager.runtime.bus import Occurrence

MEASURE_EVERY_S = 0.25
"""How often the loop is measured. Chosen: a hang of a second is measured four times, and 4 turns a second cost nothing."""
_BOUNDS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)


class ProcessLag:
    """Lag of the process, in a registry of its own, because one process may run several managers."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry(auto_describe=True)
        ProcessCollector(registry=self.registry)
        self._loop_lag = Histogram(
            "lift_manager_loop_lag_seconds",
            "How late the event loop does what is due: a state or a press may be so much older.",
            buckets=_BOUNDS_S,
            registry=self.registry,
        )
        self._event_lag = Histogram(
            "lift_manager_event_lag_seconds",
            "From the publishing of an event until all who wait for it have had their turn.",
            buckets=_BOUNDS_S,
            registry=self.registry,
        )
        self._is_measuring = False

    def measure_event(self, occurrence: Occurrence) -> None:
        """Measure how long an event waits; in each turn of the loop the first one, which waits longest."""
        if not self._is_measuring:
            self._is_measuring = True
            loop = asyncio.get_running_loop()
            # readers are woken in the next turn of the loop, and have finished by the one after that
            loop.call_soon(loop.call_soon, self._observe_event, occurrence.at)

    def _observe_event(self, at: float) -> None:
        self._is_measuring = False
        self._event_lag.observe(max(0.0, asyncio.get_running_loop().time() - at))

    async def run(self) -> None:
        """Measure the loop until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + MEASURE_EVERY_S
            await asyncio.sleep(MEASURE_EVERY_S)
            self._loop_lag.observe(max(0.0, loop.time() - due))
