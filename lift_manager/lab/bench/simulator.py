"""A simulated lift and its controllers on the loop of the bench, and the handle for a test."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass

from drivers.model import FloorName
from lift_manager.lab.bench.controls import Button, Controls, InputChanges, input_changes
from lift_manager.lab.bench.errors import BenchError, ConditionNotMet
from lift_manager.lab.bench.naming import device_fault
from lift_manager.lab.bench.plan import LiftPlan
from lift_manager.lab.bench.thread import LoopThread
from lift_manager.lab.plant import client_limits, simulated_lift
from lift_manager.lab.world.truth import History, Truth, truth_of
from lift_manager.runtime.bus import Bus
from register_maps.words import Side, Table
from simulator.faults import Fault
from simulator.registers import Endpoint, RegisterFace
from simulator.server import SimulatedController
from simulator.state import ShownState

HOST = "127.0.0.1"
WITHIN_S = 30.0
"""The default time limit of a wait. Chosen: a ride takes a second at the usual speed, and many times that on a very busy machine."""

TruthCondition = Callable[[Truth], bool]


@dataclass(frozen=True, slots=True)
class Write:
    """A command that a write over the network gave to the controller or released."""

    at_s: float
    """By `time.monotonic`."""
    command: str
    """As in the map, such as `go_to` or `hold_door.front`."""
    floor: FloorName | None
    """The floor of a call."""
    on: bool
    """False for a release, by any writer."""


class Plant:
    """One lift on the loop of the bench; call its methods on that loop."""

    def __init__(self, plan: LiftPlan) -> None:
        """Raises BenchError for floors that the map cannot express."""
        try:
            self.face = simulated_lift(plan.codec, plan.floors, doors=plan.doors, speed=plan.speed)
        except ValueError as error:
            raise BenchError(f"{plan.name}: {error}") from error
        self.name = plan.name
        self.floors = tuple(plan.floors)
        self.history = History()
        self.writes: list[Write] = []
        self.changes: Bus[Truth] = Bus()
        self.ports: dict[str, int] = {}
        """The address of each device by endpoint; the controller itself has the empty name."""
        self._plan = plan
        self.controls = Controls(plan.name, self.face, self.floors, self.look)
        self._given: frozenset[tuple[str, int]] = frozenset()
        self._next_scan: asyncio.TimerHandle | None = None

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Listen and advance time."""
        source = self._plan.codec.map
        async with AsyncExitStack() as stack:
            for endpoint in ("", *source.endpoints):
                device = _Recorded(self.face.endpoint(endpoint) if endpoint else self.face, self.look)
                limits = None if endpoint else client_limits(source)
                server = SimulatedController({source.unit_of(endpoint): device}, host=HOST, limits=limits)
                await server.start()
                stack.push_async_callback(server.stop)
                self.ports[endpoint] = server.port
            for fault in self._plan.faults:
                self.controls.begin(fault)
            self._scan()
            try:
                yield
            finally:
                self.controls.close()
                if self._next_scan is not None:
                    self._next_scan.cancel()

    def look(self) -> Truth:
        """Advance the lift to now, record changes, and return its physical state."""
        now = _now()
        self.face.advance(now)
        before, truth = self.history.last, truth_of(self.face, self.floors, self.face.commands)
        self._note(now)
        if truth != before:
            self.history.add(now, truth)
            self.changes.publish(truth)
        return truth

    async def wait_for(self, condition: TruthCondition, within_s: float) -> Truth:
        """Return the first truth that meets the condition. Raises ConditionNotMet."""
        with self.changes.listen() as changes:
            truth = self.look()
            try:
                async with asyncio.timeout(within_s):
                    while not condition(truth):
                        truth = await changes.next()
            except TimeoutError:
                raise ConditionNotMet(
                    f"{self.name}: the condition was not met within {within_s:g} s; the lift is {truth}"
                ) from None
        return truth

    def _scan(self) -> None:
        """Observe at the scan time of the controller, so that changes are found even without requests."""
        self.look()
        self._next_scan = asyncio.get_running_loop().call_later(self.face.parameters.scan_s, self._scan)

    def _note(self, now: float) -> None:
        given = frozenset(self.face.commands.items())
        if given == self._given:
            return
        for on, changed in ((False, self._given - given), (True, given - self._given)):
            for command, value in sorted(changed):
                is_call = self._plan.codec.commands[command].is_call
                self.writes.append(Write(now, command, self.floors[value] if is_call else None, on))
        self._given = given


class _Recorded:
    """A device that records writes one by one, so that two within one scan count as two."""

    def __init__(self, device: RegisterFace | Endpoint, look: Callable[[], object]) -> None:
        self._device = device
        self._look = look

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Read cells."""
        return self._device.read(table, address, count, now)

    def stored(self, table: Table, address: int, now: float) -> int:
        """Return what was last written to a cell."""
        return self._device.stored(table, address, now)

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        """Write cells."""
        self._look()
        self._device.write(table, address, values, now)
        self._look()

    def pulse(self, address: int, counts: int, now: float) -> None:
        """Set a coil for so many counts."""
        self._look()
        self._device.pulse(address, counts, now)
        self._look()

    @property
    def on_network(self) -> bool:
        """Whether it answers."""
        return self._device.on_network

    @property
    def faults(self) -> frozenset[Fault]:
        """Its current faults."""
        return self._device.faults

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call `watcher` whenever `on_network` or `faults` has changed."""
        self._device.watch(watcher)


class LiftSimulator:
    """A simulated lift with a Modbus/TCP controller, for use from any thread.

    Faults are values of `simulator.faults`, or names such as `"stuck_door"` and `"in_mode.fire"` with the values of their fields
    as keywords. A request that cannot be carried out raises BenchError.
    """

    def __init__(self, plant: Plant, thread: LoopThread) -> None:
        self._plant = plant
        self._thread = thread

    @property
    def name(self) -> str:
        """Its name in the manager."""
        return self._plant.name

    @property
    def host(self) -> str:
        """The address of its controller, bypassing the faulty wire."""
        return HOST

    @property
    def port(self) -> int:
        """The Modbus/TCP port of its controller; `ports` has those of further devices."""
        return self.ports[""]

    @property
    def ports(self) -> Mapping[str, int]:
        """The ports of its devices by endpoint; the controller itself has the empty name."""
        return self._plant.ports

    @property
    def floors(self) -> tuple[FloorName, ...]:
        """Lowest first."""
        return self._plant.floors

    # -- what it does

    @property
    def truth(self) -> Truth:
        """The physical state of the lift now, whatever its registers show."""
        return self._thread.call(self._plant.look)

    @property
    def picture(self) -> ShownState:
        """The same as a value of the simulator: floors are indices, doors and speed are separate."""

        def look() -> ShownState:
            self._plant.look()
            return self._plant.face.picture

        return self._thread.call(look)

    @property
    def history(self) -> tuple[tuple[float, Truth], ...]:
        """Every change of the truth since the start, with its time by `time.monotonic`."""
        return self._thread.call(lambda: tuple(self._plant.history.items()))

    @property
    def writes(self) -> tuple[Write, ...]:
        """The commands given and released over the network, in order."""
        return self._thread.call(lambda: tuple(self._plant.writes))

    def wait_for(self, condition: TruthCondition, *, within_s: float = WITHIN_S) -> Truth:
        """Return the first truth from now on that meets the condition. Raises ConditionNotMet, which fails the test."""
        return self._thread.run(self._plant.wait_for(condition, within_s), within_s=within_s)

    async def when(self, condition: TruthCondition, *, within_s: float = WITHIN_S) -> Truth:
        """Like `wait_for`, for an asyncio test, without blocking its loop."""
        return await self._thread.run_async(self._plant.wait_for(condition, within_s))

    # -- what goes wrong

    def begin(self, fault: Fault | str, **values: object) -> Fault:
        """Begin a fault; returns it as a value."""
        value = device_fault(fault, values, self.floors)
        self._thread.call(lambda: self._plant.controls.begin(value))
        return value

    def end(self, fault: Fault | str, **values: object) -> None:
        """End a fault."""
        value = device_fault(fault, values, self.floors)
        self._thread.call(lambda: self._plant.controls.end(value))

    @contextmanager
    def fault(self, fault: Fault | str, **values: object) -> Iterator[Fault]:
        """Apply a fault within the context."""
        value = self.begin(fault, **values)
        try:
            yield value
        finally:
            self.end(value)

    @property
    def faults(self) -> frozenset[Fault]:
        """The current faults."""
        return self._thread.call(lambda: self._plant.face.faults)

    # -- what people do

    def press_landing(self, floor: FloorName) -> None:
        """Press and release the landing button of a floor."""
        self._thread.call(lambda: self._plant.controls.press(Button.LANDING, floor))

    def press_car(self, floor: FloorName) -> None:
        """Press and release the button of a floor in the car."""
        self._thread.call(lambda: self._plant.controls.press(Button.CAR, floor))

    def set_inputs(self, **changes: object) -> None:
        """Change what people press, hold and turn, by the names of `InputChanges`, such as `key="inspection"`."""
        given = input_changes(changes)
        self._thread.call(lambda: self._plant.controls.set_inputs(given))

    def set_fire(self, on: bool) -> None:  # noqa: FBT001 - clear from the name of the method
        """Switch the fire alarm of the building on or off."""
        self.set_inputs(fire=on)

    def block_doorway(self, *sides: Side) -> None:
        """Block the light curtains of exactly these doors; without a door, of none."""
        self.set_inputs(obstruction=sides)

    @property
    def inputs(self) -> InputChanges:
        """What people press, hold and turn now."""
        return self._thread.call(lambda: self._plant.controls.held)

    def reset(self) -> None:
        """End every fault and release everything; the key returns to where it was at the start."""
        self._thread.call(self._plant.controls.reset)


def _now() -> float:
    return asyncio.get_running_loop().time()
