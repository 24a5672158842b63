"""How late the program itself is: its loop, and its events."""

from __future__ import annotations

import asyncio

from prometheus_client import CollectorRegistry, Histogram, ProcessCollector

from lift_manager.runtime.bus import Occurrence

LOOK_EVERY_S = 0.25
"""How often the loop is looked at. Chosen: a hang of a second is seen four times, and 4 turns a second cost nothing."""
_BOUNDS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)


class Lags:
    """What is measured of the process, in a registry of its own: several managers may live in one process."""

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
        self._handing = False

    def hear(self, occurrence: Occurrence) -> None:
        """Measure how long an event waits; of those of one turn of the loop the first, which waits longest."""
        if not self._handing:
            self._handing = True
            loop = asyncio.get_running_loop()
            # they are woken in the next turn of the loop, and are done with it at the one after that
            loop.call_soon(loop.call_soon, self._handed, occurrence.at)

    def _handed(self, at: float) -> None:
        self._handing = False
        self._event_lag.observe(max(0.0, asyncio.get_running_loop().time() - at))

    async def run(self) -> None:
        """Look at the loop until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + LOOK_EVERY_S
            await asyncio.sleep(LOOK_EVERY_S)
            self._loop_lag.observe(max(0.0, loop.time() - due))
