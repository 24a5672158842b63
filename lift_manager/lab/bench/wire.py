"""The faulty wires between the manager and the controllers, on the loop of the bench, and the handle for a test."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from operator import attrgetter

from lift_manager.lab.bench.errors import BenchError
from lift_manager.lab.bench.naming import wire_fault
from lift_manager.lab.bench.simulator import HOST, Plant
from lift_manager.lab.bench.thread import LoopThread
from simulator.proxy import FaultProxy
from simulator.wire_faults import (
    DropRequest,
    HalfOpen,
    ResetConnection,
    StruckFault,
    WireFault,
    WireFaults,
)


class Wires:
    """A proxy in front of every device of every lift; call its methods on the loop of the bench."""

    def __init__(self, plants: Mapping[str, Plant]) -> None:
        self.faults: dict[str, tuple[WireFaults, ...]] = {}
        """By lift, one for each of its devices."""
        self.ports: dict[str, dict[str, int]] = {}
        """By lift and endpoint."""
        self._plants = plants

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Listen on a free port for each device."""
        async with AsyncExitStack() as stack:
            for name, plant in self._plants.items():
                proxies = {
                    endpoint: FaultProxy(HOST, port, WireFaults(seed=number))
                    for number, (endpoint, port) in enumerate(plant.ports.items())
                }
                for proxy in proxies.values():
                    await stack.enter_async_context(proxy)
                self.faults[name] = tuple(proxy.faults for proxy in proxies.values())
                self.ports[name] = {endpoint: proxy.port for endpoint, proxy in proxies.items()}
            yield


class ModbusFaults:
    """The faults between the manager and its controllers, for use from any thread: on every wire, or on those of one lift.

    Faults are values of `simulator.wire_faults`, or names such as `"late_answer"` with the values of their fields as keywords.
    """

    def __init__(self, wires: Wires, thread: LoopThread, *lifts: str) -> None:
        """Applies to the wires of `lifts`."""
        self._wires = wires
        self._thread = thread
        self._lifts = lifts

    def of(self, lift: str) -> ModbusFaults:
        """Return the same for the wires of one lift. Raises BenchError for an unknown lift."""
        if lift not in self._wires.faults:
            raise BenchError(f"no lift {lift!r}; there is {', '.join(self._wires.faults)}")
        return ModbusFaults(self._wires, self._thread, lift)

    @property
    def host(self) -> str:
        """The host on which the proxies listen."""
        return HOST

    @property
    def port(self) -> int:
        """The port in front of the controller of the one lift."""
        if len(self._lifts) != 1:
            raise BenchError(
                f"there are {len(self._lifts)} lifts; name one, such as modbus_faults.of({self._lifts[0]!r}).port"
            )
        return self._wires.ports[self._lifts[0]][""]

    def add(self, fault: WireFault | str, **values: object) -> WireFault:
        """Put a fault on the wires; returns it as a value. `times=1` applies it once on each of them."""
        value = wire_fault(fault, values)

        def add() -> None:
            for wire in self._mine():
                wire.add(value)

        self._thread.call(add)
        return value

    def remove(self, fault: WireFault | str, **values: object) -> None:
        """Remove a fault from the wires. Raises BenchError if it is not set."""
        value = wire_fault(fault, values)

        def remove() -> None:
            if not all(value in wire.faults for wire in self._mine()):
                raise BenchError(
                    f"{value!r} is not on the wire; there is {', '.join(map(repr, self._present())) or 'none'}"
                )
            for wire in self._mine():
                wire.remove(value)

        self._thread.call(remove)

    def clear(self) -> None:
        """Remove all faults. A dead connection stays dead, as after a pulled cable; the next one works."""

        def clear() -> None:
            for wire in self._mine():
                wire.clear()

        self._thread.call(clear)

    @contextmanager
    def fault(self, fault: WireFault | str, **values: object) -> Iterator[WireFault]:
        """Apply a fault within the context."""
        value = self.add(fault, **values)
        try:
            yield value
        finally:
            self.remove(value)

    def silence(self) -> WireFault:
        """Drop every request, while connections stay open."""
        return self.add(DropRequest())

    def cut(self) -> WireFault:
        """Pull the cable: every connection, also later ones, is dead from its next request on, without being closed."""
        return self.add(HalfOpen())

    def reset(self) -> WireFault:
        """Reset the connection at its next request, once; that request is lost."""
        return self.add(ResetConnection(times=1))

    @property
    def present(self) -> tuple[WireFault, ...]:
        """The faults that are set, including those used up."""
        return self._thread.call(self._present)

    @property
    def struck(self) -> tuple[StruckFault, ...]:
        """Every effect of a fault, oldest first: the fault, the request, and the time by `time.monotonic`."""
        return self._thread.call(
            lambda: tuple(sorted((one for wire in self._mine() for one in wire.strikes), key=attrgetter("at")))
        )

    def _mine(self) -> list[WireFaults]:
        return [wire for lift in self._lifts for wire in self._wires.faults[lift]]

    def _present(self) -> tuple[WireFault, ...]:
        return tuple(dict.fromkeys(fault for wire in self._mine() for fault in wire.faults))
