"""Run an adapter on an asyncio loop: RMF on one side, a way to the manager on the other, everything of the adapter in the loop's thread."""

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
from lift_manager.rmf.messages import LiftRequest, LiftState
from lift_manager.rmf.port import Answer, Deliver, Manager, ManagerListener
from lift_manager.rmf.publishing import NO_CLOCK_S

_log = logging.getLogger(__name__)

AGAIN_S = 5.0
"""Chosen: so long after a bug everything begins anew; until then nothing is published, and robots wait."""
LEAST_S = 0.001
"""From one look at the adapter to the next where nothing happened; the clock of uvloop counts milliseconds."""


class Rmf(Protocol):
    """RMF's side, as `dds.Dds`."""

    @property
    def alarm(self) -> AlarmPublisher:
        """Where a fire is told."""
        ...

    def publish(self, state: LiftState) -> None:
        """Publish the state of one lift."""
        ...

    def close(self) -> None:
        """End it; nothing is delivered afterwards."""
        ...


class ManagerLink(Manager, Protocol):
    """A way to the manager, as `beside.Beside`."""

    def start(self, listener: ManagerListener, deliver: Deliver) -> None:
        """Begin to hear the manager."""
        ...

    def close(self) -> None:
        """End it, whether the manager answers or not."""
        ...


@dataclass
class RosClock:
    """RMF's clock in seconds: the wall clock, or what /clock said last, and 0 before it said anything."""

    use_sim_time: bool
    simulated: float | None = None

    def __call__(self) -> float:
        """Return what it shows."""
        return (self.simulated or 0.0) if self.use_sim_time else time.time()


class RunningAdapter:
    """An adapter and both its neighbours. A bug in any of them is logged, and all three begin anew: to the others that is a restart."""

    def __init__(
        self,
        make_rmf: Callable[[DdsListener, Deliver], Rmf],
        make_way: Callable[[], ManagerLink],
        *,
        use_sim_time: bool = False,
        counts: Counts | None = None,
        adapter_id: str = "",
    ) -> None:
        self._adapter_id = adapter_id
        self.counts = counts or Counts()
        self._make_rmf = make_rmf
        self._make_way = make_way
        self._use_sim_time = use_sim_time
        self._shell: _Shell | None = None

    def open(self) -> None:
        """Join RMF, on a running loop; raises what the making of its side raises. Then nothing is heard or said before `run`."""
        shell = _Shell(RosClock(self._use_sim_time), self.counts)
        shell.open(self._make_rmf, self._make_way, self._adapter_id)
        self._shell = shell

    async def run(self) -> None:
        """Run until cancelled, then tell RMF that the lifts are offline, and leave it."""
        try:
            while True:
                try:
                    if self._shell is None:
                        self.open()
                    await self._once()
                except Exception:  # noqa: BLE001  whatever it is, the lifts go on being driven, and RMF gets an adapter that is whole
                    _log.exception("the Open-RMF adapter ended because of a bug; it begins anew in %g s", AGAIN_S)
                await asyncio.sleep(AGAIN_S)
        finally:
            self.close()

    def hush(self) -> None:
        """Tell RMF at once that the lifts are offline, and nothing more; leaving it, which waits for the network, is left to the end of `run`."""
        if self._shell is not None:
            _ended(self._shell.hush)

    def close(self) -> None:
        """Leave RMF where `run` was never called; idempotent."""
        shell, self._shell = self._shell, None
        if shell is not None:
            shell.close()

    async def _once(self) -> None:
        shell = self._shell
        if shell is not None:
            try:
                await shell.run()
            finally:
                self.close()


class _Shell:
    """One adapter from its begin to its end. Implements `DdsListener` and `port.Hears`."""

    def __init__(self, clock: RosClock, counts: Counts) -> None:
        self._loop = asyncio.get_running_loop()
        self._clock = clock
        self._counts = counts
        self._failure: asyncio.Future[None] = self._loop.create_future()
        self._timers: list[asyncio.Handle] = []
        self._next: asyncio.Handle | None = None
        self._is_soon = False
        self._is_over = False
        self._names: tuple[str, ...] = ()

    def open(
        self, make_rmf: Callable[[DdsListener, Deliver], Rmf], make_way: Callable[[], ManagerLink], adapter_id: str
    ) -> None:
        """Join RMF. What it says waits until the loop has its turn."""
        self._rmf = make_rmf(self, self._deliver)
        self._way = make_way()
        out = RmfOutput(self._rmf.publish, self._rmf.alarm)
        self._adapter = Adapter(self._way, out, self._clock, self._counts, adapter_id=adapter_id)

    async def run(self) -> None:
        """Listen to the manager, too; raises what went wrong in any part."""
        if self._clock.use_sim_time:
            self._timers.append(self._loop.call_later(NO_CLOCK_S, self._look_at_clock))
        self._way.start(self, self._deliver)
        self._soon()
        await self._failure

    def close(self) -> None:
        """End everything; the last word to RMF is that the lifts are offline."""
        self._failure.cancel()
        _ended(self.hush)
        _ended(self._way.close)
        _ended(self._rmf.close)

    def on_request(self, request: LiftRequest) -> None:
        self._adapter.on_request(request, self._loop.time())
        self._soon()

    def on_fleet_request(self, request: LiftRequest) -> None:
        self._adapter.on_fleet_request(request, self._loop.time())
        self._soon()

    def on_unreadable(self, text: str) -> None:
        self._adapter.on_unreadable(text, self._loop.time())

    def on_request_writer(self) -> None:
        self._adapter.on_request_writer(self._loop.time())
        self._soon()

    def on_rival(self, lift_name: str) -> None:
        self._adapter.on_rival(lift_name, self._loop.time())

    def on_clock(self, seconds: float) -> None:
        self._clock.simulated = seconds

    def on_site(self, site: SiteView, sent_at: float, now: float) -> None:
        self._adapter.on_site(site, sent_at, now)
        self._soon()
        names = tuple(_names(site))
        if names != self._names:
            self._names = names
            for line in names:
                _log.info("%s", line)

    def on_answer(self, answer: Answer, now: float) -> None:
        self._adapter.on_answer(answer, now)
        self._soon()

    def on_manager_lost(self, reason: str, now: float) -> None:
        self._adapter.on_manager_lost(reason, now)
        self._soon()

    def hush(self) -> None:
        """Publish the lifts as offline; nothing is heard afterwards."""
        if self._is_over:
            return
        self._is_over = True
        for timer in filter(None, (*self._timers, self._next)):
            timer.cancel()
        self._adapter.stop(self._loop.time())

    def _deliver(self, what: Callable[[], None]) -> None:
        self._loop.call_soon_threadsafe(self._guarded, what)

    def _guarded(self, what: Callable[[], None]) -> None:
        if self._is_over or self._failure.done():
            return
        try:
            what()
        except Exception as error:  # noqa: BLE001  raised again in `run`
            self._failure.set_exception(error)

    def _soon(self) -> None:
        """Look at the adapter once what waits already has been taken: a burst of requests is one look."""
        if not self._is_soon:
            self._is_soon = True
            self._look_at(self._loop.call_soon(self._guarded, self._look))

    def _look(self) -> None:
        self._is_soon = False
        now = self._loop.time()
        due = max(self._adapter.tick(now), now + LEAST_S)
        if not self._is_soon:
            self._look_at(self._loop.call_at(due, self._guarded, self._look))

    def _look_at(self, handle: asyncio.Handle) -> None:
        if self._next is not None:
            self._next.cancel()
        self._next = handle

    def _look_at_clock(self) -> None:
        if self._clock.simulated is None:
            _log.warning(
                "use_sim_time is on, and nobody publishes /clock: lift_time is 0 until somebody does; start the simulation, or leave use_sim_time out"
            )


def _ended(end: Callable[[], None]) -> None:
    try:
        end()
    except Exception:  # noqa: BLE001  the rest has to end all the same, and so does whoever wants it to end
        _log.exception("a part of the Open-RMF adapter did not end as it should")


def _names(site: SiteView) -> list[str]:
    """Say which lift is which for RMF, a line each."""
    lines = []
    for lift in site.lifts:
        floors = ", ".join(own if own == rmf else f"{rmf} (here {own})" for own, rmf in lift.floors.items())
        called = lift.name if lift.name == lift.lift else f"{lift.name} (here {lift.lift})"
        lines.append(f"for RMF: lift {called} with the floors {floors}")
    return lines
