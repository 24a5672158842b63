"""The bench of one test: a thread with the lifts, the wires and the manager, each started at its first use."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, Self

from lift_manager.lab.bench.errors import BenchError
from lift_manager.lab.bench.plan import plan_lifts
from lift_manager.lab.bench.simulator import LiftSimulator, Plant
from lift_manager.lab.bench.site import LiftSite, RunningSite
from lift_manager.lab.bench.thread import LoopThread
from lift_manager.lab.bench.wire import ModbusFaults, Wires


class Bench:
    """Owns the thread, tasks and sockets of one test. Its end closes them all and raises the errors that they met."""

    def __init__(self, markers: Sequence[Mapping[str, Any]], *, near: Path, folder: Path) -> None:
        """`markers` describe the lifts, `near` is the folder of their maps, and `folder` is for files. Raises BenchError."""
        self._plans = plan_lifts(markers, near)
        self._plants = {plan.name: Plant(plan) for plan in self._plans}
        self._folder = folder
        self._wires: Wires | None = None
        self._site: LiftSite | None = None
        with ExitStack() as stack:
            self._thread = stack.enter_context(LoopThread())
            self._simulators = {name: LiftSimulator(plant, self._thread) for name, plant in self._plants.items()}
            stack.enter_context(self._thread.hosting(_all_of(self._plants.values())))
            self._open = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def simulator(self) -> LiftSimulator:
        """Return the only lift of the test. Raises BenchError if there are several."""
        if len(self._simulators) > 1:
            lifts = ", ".join(self._simulators)
            first = next(iter(self._simulators))
            raise BenchError(
                f"lift_simulator is the only lift of a test, and this one has {lifts}; use lift_site.simulator({first!r})"
            )
        return next(iter(self._simulators.values()))

    def modbus_faults(self) -> ModbusFaults:
        """Return the wires of all lifts."""
        return ModbusFaults(self._started_wires(), self._thread, *self._plants)

    def site(self) -> LiftSite:
        """Return the manager, which reaches its lifts over the wires. Raises BenchError for an invalid site file."""
        if self._site is None:
            site = RunningSite(self._plans, self._started_wires(), self._plants, self._folder)
            self._open.enter_context(self._thread.hosting(site.running()))
            self._site = LiftSite(site, self._simulators, self.modbus_faults(), self._thread)
        return self._site

    def _started_wires(self) -> Wires:
        if self._wires is None:
            wires = Wires(self._plants)
            self._open.enter_context(self._thread.hosting(wires.running()))
            self._wires = wires
        return self._wires


@asynccontextmanager
async def _all_of(plants: Iterable[Plant]) -> AsyncIterator[None]:
    async with AsyncExitStack() as stack:
        for plant in plants:
            await stack.enter_async_context(plant.running())
        yield
