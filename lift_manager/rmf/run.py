"""Runs an adapter on an asyncio loop, between RMF and the manager. The adapter itself runs in the loop's thread only."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from lift_manager.plain.rmf import SiteView
from lift_manager.rmf.adapter import Adapter, RmfOutput
from lift_manager.rmf.alarms import AlarmPublisher
from lift_manager.rmf.counts import Counts
from lift_manager.rmf.dds import DdsListener
from lift_manager.rmf.lift_state import NO_CLOCK_S
from lift_manager.rmf.messages import LiftRequest, LiftState
from lift_manager.rmf.port import Answer, Deliver, Manager, ManagerListener

_log = logging.getLogger(__name__)

RESTART_PAUSE_S = 5.0
"""How long after a bug the adapter restarts; until then nothing is published, and robots wait. Chosen."""
MIN_TICK_S = 0.001
"""The shortest time between two ticks without an event; the clock of uvloop counts milliseconds."""


class Rmf(Protocol):
    """The connection to RMF, such as `dds.Dds`."""

    @property
    def alarm(self) -> AlarmPublisher:
        """Where a fire is announced."""
        ...

    def publish(self, state: LiftState) -> None:
        """Publish the state of one lift."""
        ...

    def close(self) -> None:
        """Close it; nothing is delivered afterwards."""
        ...


class ManagerLink(Manager, Protocol):
    """The connection to the manager, such as `remote_manager.RemoteManager`."""

    def start(self, listener: ManagerListener, deliver: Deliver) -> None:
        """Begin to report to `listener`."""
        ...

    def close(self) -> None:
        """Close it, whether the manager answers or not."""
        ...


@dataclass
class RosClock:
    """RMF's clock in seconds: the wall clock, or the latest time on /clock and 0 before the first."""

    use_sim_time: bool
    simulated: float | None = None

    def __call__(self) -> float:
        """Return the time."""
        return (self.simulated or 0.0) if self.use_sim_time else time.time()


class RunningAdapter:
    """An adapter with its connections to RMF and the manager. A bug in any of them is logged, and all three are restarted."""

    def __init__(
        self,
        make_rmf: Callable[[DdsListener, Deliver], Rmf],
        make_manager: Callable[[], ManagerLink],
        *,
        use_sim_time: bool = False,
        counts: Counts | None = None,
        adapter_id: str = "",
        first_reading_s: float = 0.0,
    ) -> None:
        """`adapter_id` and `first_reading_s` are those of `Adapter`."""
        self._adapter_id = adapter_id
        self._first_reading_s = first_reading_s
        self.counts = counts or Counts()
        self._make_rmf = make_rmf
        self._make_manager = make_manager
        self._use_sim_time = use_sim_time
        self._adapter_loop: _AdapterLoop | None = None

    def open(self) -> None:
        """Join RMF, on a running loop; raises what `make_rmf` raises. Nothing is received or published before `run`."""
        adapter_loop = _AdapterLoop(RosClock(self._use_sim_time), self.counts)
        adapter_loop.open(self._make_rmf, self._make_manager, self._adapter_id, self._first_reading_s)
        self._adapter_loop = adapter_loop

    async def run(self) -> None:
        """Run until cancelled, then publish the lifts as offline and leave RMF."""
        try:
            while True:
                try:
                    if self._adapter_loop is None:
                        self.open()
                    await self._run_once()
                except Exception:  # noqa: BLE001  after any bug the manager keeps driving the lifts, and RMF gets a new adapter
                    _log.exception("the Open-RMF adapter ended because of a bug; it restarts in %g s", RESTART_PAUSE_S)
                await asyncio.sleep(RESTART_PAUSE_S)
        finally:
            self.close()

    def go_offline(self) -> None:
        """Publish the lifts as offline at once, and nothing more. The end of `run` leaves RMF, which waits for the network."""
        if self._adapter_loop is not None:
            _run_and_log(self._adapter_loop.go_offline)

    def close(self) -> None:
        """Leave RMF if `run` was never called; idempotent."""
        adapter_loop, self._adapter_loop = self._adapter_loop, None
        if adapter_loop is not None:
            adapter_loop.close()

    async def _run_once(self) -> None:
        adapter_loop = self._adapter_loop
        if adapter_loop is not None:
            try:
                await adapter_loop.run()
            finally:
                self.close()


class _AdapterLoop:
    """One adapter on the loop, from start to end. Implements `DdsListener` and `port.ManagerListener`."""

    def __init__(self, clock: RosClock, counts: Counts) -> None:
        self._loop = asyncio.get_running_loop()
        self._clock = clock
        self._counts = counts
        self._failure: asyncio.Future[None] = self._loop.create_future()
        self._timers: list[asyncio.Handle] = []
        self._timer: asyncio.Handle | None = None
        self._is_scheduled = False
        self._is_offline = False
        self._names: tuple[str, ...] = ()

    def open(
        self,
        make_rmf: Callable[[DdsListener, Deliver], Rmf],
        make_manager: Callable[[], ManagerLink],
        adapter_id: str,
        first_reading_s: float,
    ) -> None:
        """Join RMF. Its messages wait for the next turn of the loop."""
        self._rmf = make_rmf(self, self._deliver)
        self._manager = make_manager()
        out = RmfOutput(self._rmf.publish, self._rmf.alarm)
        self._adapter = Adapter(
            self._manager, out, self._clock, self._counts, adapter_id=adapter_id, first_reading_s=first_reading_s
        )

    async def run(self) -> None:
        """Start the connection to the manager, too; raises the error of any part."""
        if self._clock.use_sim_time:
            self._timers.append(self._loop.call_later(NO_CLOCK_S, self._check_clock))
        self._manager.start(self, self._deliver)
        self._schedule_tick()
        await self._failure

    def close(self) -> None:
        """Close everything; the last state that RMF gets is that the lifts are offline."""
        self._failure.cancel()
        _run_and_log(self.go_offline)
        _run_and_log(self._manager.close)
        _run_and_log(self._rmf.close)

    def on_request(self, request: LiftRequest) -> None:
        self._adapter.on_request(request, self._loop.time())
        self._schedule_tick()

    def on_fleet_request(self, request: LiftRequest) -> None:
        self._adapter.on_fleet_request(request, self._loop.time())
        self._schedule_tick()

    def on_unreadable(self, text: str) -> None:
        self._adapter.on_unreadable(text, self._loop.time())

    def on_request_writer(self) -> None:
        self._adapter.on_request_writer(self._loop.time())
        self._schedule_tick()

    def on_rival(self, lift_name: str) -> None:
        self._adapter.on_rival(lift_name, self._loop.time())

    def on_clock(self, seconds: float) -> None:
        self._clock.simulated = seconds

    def on_site(self, site: SiteView, sent_at: float, now: float) -> None:
        self._adapter.on_site(site, sent_at, now)
        self._schedule_tick()
        names = tuple(_describe_names(site))
        if names != self._names:
            self._names = names
            for line in names:
                _log.info("%s", line)

    def on_answer(self, answer: Answer, now: float) -> None:
        self._adapter.on_answer(answer, now)
        self._schedule_tick()

    def on_manager_lost(self, reason: str, now: float) -> None:
        self._adapter.on_manager_lost(reason, now)
        self._schedule_tick()

    def go_offline(self) -> None:
        """Publish the lifts as offline; nothing is received afterwards."""
        if self._is_offline:
            return
        self._is_offline = True
        for timer in filter(None, (*self._timers, self._timer)):
            timer.cancel()
        self._adapter.stop(self._loop.time())

    def _deliver(self, call: Callable[[], None]) -> None:
        self._loop.call_soon_threadsafe(self._run_guarded, call)

    def _run_guarded(self, call: Callable[[], None]) -> None:
        if self._is_offline or self._failure.done():
            return
        try:
            call()
        except Exception as error:  # noqa: BLE001  raised again in `run`
            self._failure.set_exception(error)

    def _schedule_tick(self) -> None:
        """Schedule one tick after everything that is already waiting: a burst of requests needs one tick."""
        if not self._is_scheduled:
            self._is_scheduled = True
            self._set_timer(self._loop.call_soon(self._run_guarded, self._tick))

    def _tick(self) -> None:
        self._is_scheduled = False
        now = self._loop.time()
        due = max(self._adapter.tick(now), now + MIN_TICK_S)
        if not self._is_scheduled:
            self._set_timer(self._loop.call_at(due, self._run_guarded, self._tick))

    def _set_timer(self, handle: asyncio.Handle) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = handle

    def _check_clock(self) -> None:
        if self._clock.simulated is None:
            _log.warning(
                "use_sim_time is on, but nothing publishes /clock: lift_time is 0 until it arrives; start the simulation, or leave use_sim_time out"
            )


def _run_and_log(end: Callable[[], None]) -> None:
    try:
        end()
    except Exception:  # noqa: BLE001  the other parts have to close all the same
        _log.exception("a part of the Open-RMF adapter did not close properly")


def _describe_names(site: SiteView) -> list[str]:
    """Return a line for each lift with its names in RMF."""
    lines = []
    for lift in site.lifts:
        floors = ", ".join(own if own == rmf else f"{rmf} (here {own})" for own, rmf in lift.floors.items())
        called = lift.name if lift.name == lift.lift else f"{lift.name} (here {lift.lift})"
        lines.append(f"for RMF: lift {called} with the floors {floors}")
    return lines
