"""A whole site on the clock of the loop: simulated lifts, in-memory wires, and the manager.

On a virtual loop (`lift_manager.lab.virtual_time`) an hour takes seconds, and every run with the same seed is the same.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Protocol

from drivers.modbus.link import Link
from drivers.modbus.wire import Wire
from drivers.model import FloorName
from lift_manager import app
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Controller
from lift_manager.lab.plant import simulated_lift
from lift_manager.lab.world.decoding import Outputs, Raw
from lift_manager.lab.world.device import Device, MemoryController
from lift_manager.lab.world.disk import DiskFault, DiskRecorder, SimulatedDisk
from lift_manager.lab.world.truth import Truth, truth_of
from lift_manager.lab.world.wire import FaultyWire
from lift_manager.lab.world.witness import RESTART, STOP, FaultChange, FloorRequest, ForgottenRecords, Witness
from lift_manager.lift.state import LiftState
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Occurrence, StateChanged
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.recorder import Clock
from lift_manager.runtime.site import Site
from register_maps.codec import Codec, compile_map
from register_maps.schema import RegisterMap
from simulator.faults import Fault, PowerLoss, Reboot, SlotKept
from simulator.registers import RegisterFace
from simulator.state import Inputs, Parameters, ShownState
from simulator.wire_faults import Exchange, WireFault, WireFaults

OBSERVE_EVERY_S = 0.25
"""How often the state of every lift is requested. Chosen: more often than any client does."""

JOURNAL_ROWS = 500
"""How many journal rows are kept. Chosen: nothing reads them here, and the usual number takes 10 MB."""

START_TIME = datetime(2026, 1, 5, 12, tzinfo=UTC)
"""When a world begins. Chosen: Monday noon is within the robot hours of most sites."""


class WorldError(Exception):
    """This site cannot be simulated; the message says why."""


class Passengers(Protocol):
    """People who use a lift, such as `simulator.people.People`."""

    @property
    def next_at(self) -> float:
        """When they next act."""

    def act(self, now: float, picture: ShownState, inputs: Inputs) -> Inputs:
        """Return their new inputs: what they press, hold and block."""


@dataclass(slots=True)
class SimulatedLift:
    """One lift of the world, from its shaft to its registers."""

    name: str
    codec: Codec
    floors: tuple[FloorName, ...]
    face: RegisterFace
    outputs: Outputs
    controllers: tuple[str, ...]
    """Its own controller first, then those of its endpoints."""
    inputs: Inputs
    """Inputs of people and key switches."""
    people: Passengers | None = None
    _cached_truth: tuple[ShownState, tuple[Raw, dict[str, int]], Truth] | None = None

    @property
    def truth(self) -> Truth:
        """The physical state; the same object while nothing changes.

        Raises WorldError if the simulator obeys commands that the judge cannot find in its registers, except holds that its program
        clears, as its map says.
        """
        face, raw = self.face, self.outputs.raw(self.face.cells)
        held_by_program = dict.fromkeys(face.cleared_holds, 1)
        picture = face.picture
        if (
            self._cached_truth is not None
            and self._cached_truth[0] is picture
            and self._cached_truth[1] == (raw, held_by_program)
        ):
            return self._cached_truth[2]
        given = {**held_by_program, **self.outputs.decode(raw)}
        if any(given.get(name) != value for name, value in face.commands.items()):
            raise WorldError(f"{self.name} obeys {dict(face.commands)}, and its registers hold {dict(given)}")
        truth = truth_of(face, self.floors, given)
        if self._cached_truth is not None and self._cached_truth[2] == truth:
            truth = self._cached_truth[2]
        self._cached_truth = picture, (raw, held_by_program), truth
        return truth


class World:
    """Simulated lifts, the faults of their wires, and the manager that drives them."""

    def __init__(  # noqa: PLR0913  every argument after the site and its judges is a setting with a default
        self,
        loaded: LoadedSite,
        witnesses: Sequence[Witness],
        *,
        seed: int = 0,
        settings: Mapping[str, Parameters] | None = None,
        observe_every_s: float = OBSERVE_EVERY_S,
        clock: Clock | None = None,
        disk: SimulatedDisk | None = None,
        wired: Mapping[str, RegisterMap] | None = None,
    ) -> None:
        """Assemble the world. Raises WorldError for two lifts behind one unit.

        `settings` are the parameters of the simulated controllers, by lift; `observe_every_s` is how often states are requested; `disk`
        holds records and journal, and without it commits take no time. `wired` are the maps by which lifts are really wired, where the
        map of the site is wrong.
        """
        self.loaded = loaded
        self._wired = wired or {}
        self.lifts: dict[str, SimulatedLift] = {}
        self.wire_faults: dict[str, WireFaults] = {}
        """The faults on the wire to each controller."""
        self._witnesses = tuple(witnesses)
        self._observe_every_s = observe_every_s
        self._units: dict[str, dict[int, Device]] = {name: {} for name in loaded.controllers}
        for name in loaded.site.lifts:
            self.lifts[name] = self._lift(name, (settings or {}).get(name))
        self._given: dict[str, tuple[tuple[str, int], ...]] = dict.fromkeys(self.lifts, ())
        """The commands of each lift at the last observation, with the floor of a call: another floor is another press."""
        self._controllers: dict[str, MemoryController] = {}
        for number, name in enumerate(loaded.controllers):
            self.wire_faults[name] = WireFaults(seed=seed * 1000 + number)
            self.wire_faults[name].on_exchange = partial(self._exchanged, name)
            behind = [lift.name for lift in self.lifts.values() if name in lift.controllers]
            self._controllers[name] = MemoryController(self._units[name], partial(self._after_request, behind))
        self._names = {(spec.host, spec.port): name for name, spec in loaded.controllers.items()}
        self.released = False
        """Whether the release of every output was verified at the end of the run."""
        self.disk = disk or SimulatedDisk(keep=JOURNAL_ROWS)
        """Outlives every manager."""
        self._clock = clock or office_hours
        self._program: list[asyncio.Task[None]] = []
        """The tasks of the manager."""
        self._restarting = asyncio.Lock()
        """A manager that is killed may wait for its disk, and the next one starts after that."""
        self._subscriptions = ExitStack()
        """Subscriptions to everything that the manager publishes."""
        self.site: Site
        """The site as faces use it; a new one after each restart."""
        self.actors: Mapping[str, LiftActor]
        """The actor of each lift; new ones after each restart."""
        self.links: tuple[Link, ...]
        self._life: SiteLife
        self._recorder: DiskRecorder
        self._tasks: asyncio.TaskGroup
        self._build()

    # -- for scenarios

    def request(self, request: FloorRequest) -> RequestRefused | None:
        """Send a request to the manager, as a face does; return its refusal, or None."""
        refused = None
        try:
            self.site.request(
                request.lift,
                request.holder,
                request.floor,
                hold_door=request.hold_door,
                robot=request.robot,
                stays=request.stays,
            )
        except RequestRefused as error:
            refused = error
        now = _now()
        for witness in self._witnesses:
            witness.on_request(now, request, refused)
        return refused

    def begin(self, lift: str, fault: Fault) -> None:
        """Begin a fault of a lift or its controller."""
        self.lifts[lift].face.begin(fault, _now())
        self._switch(lift, fault, on=False)
        self._report_fault(FaultChange(lift, fault, began=True), (lift,))

    def end(self, lift: str, fault: Fault) -> None:
        """End a fault of a lift or its controller."""
        self.lifts[lift].face.end(fault, _now())
        self._switch(lift, fault, on=True)
        self._report_fault(FaultChange(lift, fault, began=False), (lift,))

    def begin_wire_fault(self, controller: str, fault: WireFault) -> None:
        """Put a fault on the wire to a controller."""
        self.wire_faults[controller].add(fault)
        self._report_fault(FaultChange(controller, fault, began=True), ())

    def end_wire_fault(self, controller: str, fault: WireFault) -> None:
        """Remove a fault from the wire to a controller."""
        self.wire_faults[controller].remove(fault)
        self._report_fault(FaultChange(controller, fault, began=False), ())

    def begin_disk_fault(self, fault: DiskFault) -> None:
        """Begin a fault of the disk."""
        self.disk.begin(fault)
        self._report_fault(FaultChange("disk", fault, began=True), ())

    def end_disk_fault(self, fault: DiskFault) -> None:
        """End a fault of the disk."""
        self.disk.end(fault)
        self._report_fault(FaultChange("disk", fault, began=False), ())

    def set_inputs(self, lift: str, inputs: Inputs) -> None:
        """Set what people press, hold and turn."""
        self.lifts[lift].inputs = inputs
        self.lifts[lift].face.people(_now(), inputs)
        self._observe((lift,))

    def populate(self, lift: str, people: Passengers) -> None:
        """Add passengers to a lift."""
        self.lifts[lift].people = people

    def controller(self, name: str) -> MemoryController:
        """The devices behind one address; direct writes to them count as writes of the manager."""
        return self._controllers[name]

    # -- the run

    @asynccontextmanager
    async def running(self) -> AsyncIterator[World]:
        """Run everything within the context; then release all outputs, as at the end of the program.

        Raises the error of any part of the manager.
        """
        async with asyncio.TaskGroup() as tasks:
            self._tasks = tasks
            others = [tasks.create_task(part) for part in (self._observe_forever(), self._run_people())]
            self._start()
            self._observe(self.lifts)
            try:
                yield self
                self._report_fault(FaultChange("manager", STOP, began=True), ())
                await self._life.clear_doors()
                with suppress(TimeoutError):
                    async with asyncio.timeout(app.RELEASE_WITHIN_S):
                        await self._life.stop()
                        self.released = True
                self._observe(self.lifts)
            finally:
                self._subscriptions.close()
                for task in (*self._program, *others):
                    task.cancel()

    async def restart(self) -> None:
        """Kill the manager as `kill -9` does, without releases, and restart it with what is on the disk."""
        async with self._restarting:
            await self._restart()

    async def _restart(self) -> None:
        for task in self._program:
            task.cancel()
        await asyncio.gather(*self._program, return_exceptions=True)
        for controller in self._controllers.values():
            controller.hang_up()
        self._subscriptions.close()
        self._report_fault(FaultChange("manager", RESTART, began=True), ())
        if forgotten := tuple(self._recorder.unwritten):
            self._report_fault(FaultChange("disk", ForgottenRecords(forgotten), began=True), ())
        self._recorder.drop()
        self._build()
        self._start()

    def forget(self) -> None:
        """Drop the history of wire faults, which grows while a world runs."""
        for faults in self.wire_faults.values():
            faults.strikes.clear()

    def _build(self) -> None:
        # a new recorder: what a killed manager still reports must not reach the disk
        self._recorder = DiskRecorder(self.disk)
        manager_parts = app.build(self.loaded, self._wire, recorder=self._recorder, clock=self._clock)
        self.site, self._life, self.links = manager_parts.site, manager_parts.life, manager_parts.links
        self.actors = {actor.config.name: actor for actor in manager_parts.actors}

    def _start(self) -> None:
        # subscribe before anything runs: a missed operator action would be missing for the rest of the run
        self._subscriptions.enter_context(self.site.tap(self._publish_event))
        self._publish_states()
        parts = [*(link.run() for link in self.links), *self._life.drives(), self._life.run()]
        if not self.disk.instant:
            parts.append(self._recorder.run(self.site.report_disk))
        self._program = [self._tasks.create_task(part) for part in parts]

    def _publish_event(self, occurrence: Occurrence) -> None:
        if isinstance(occurrence.event, StateChanged):
            self._publish_state(occurrence.at, occurrence.event.lift, occurrence.event.state)
            return
        for witness in self._witnesses:
            witness.on_event(occurrence.at, occurrence.event)

    def _publish_states(self) -> None:
        now = _now()
        for name in self.lifts:
            self._publish_state(now, name, self.site.state(name))

    def _publish_state(self, now: float, lift: str, state: LiftState) -> None:
        for witness in self._witnesses:
            witness.on_state(now, lift, state)

    async def _observe_forever(self) -> None:
        while True:
            await asyncio.sleep(self._observe_every_s)
            self._observe(self.lifts)
            self._publish_states()

    async def _run_people(self) -> None:
        while True:
            await asyncio.sleep(OBSERVE_EVERY_S)
            now = _now()
            for lift in self.lifts.values():
                if lift.people is not None and now >= lift.people.next_at:
                    lift.face.advance(now)
                    inputs = lift.people.act(now, lift.face.picture, lift.inputs)
                    if inputs != lift.inputs:
                        self.set_inputs(lift.name, inputs)

    def _observe(self, lifts: Sequence[str] | Mapping[str, SimulatedLift]) -> None:
        now = _now()
        for name in lifts:
            lift = self.lifts[name]
            lift.face.advance(now)
            truth = lift.truth
            self._given[name] = truth.given
            for witness in self._witnesses:
                witness.on_truth(now, name, truth)

    def _after_request(self, lifts: Sequence[str], wrote: bool) -> None:  # noqa: FBT001 - a callback with one flag
        before = {name: self._given[name] for name in lifts} if wrote else {}
        self._observe(lifts)
        for name, given in before.items():
            if new := frozenset(command for command, _ in {*self._given[name]} - {*given}):
                for witness in self._witnesses:
                    witness.on_press(_now(), name, new)

    def _exchanged(self, controller: str, exchange: Exchange) -> None:
        now = _now()
        for witness in self._witnesses:
            witness.on_exchange(now, controller, exchange)

    def _report_fault(self, change: FaultChange, lifts: Sequence[str]) -> None:
        now = _now()
        for witness in self._witnesses:
            witness.on_fault(now, change)
        self._observe(lifts)

    def _switch(self, lift: str, fault: Fault, *, on: bool) -> None:
        """Connect or disconnect the devices of a lift, if that is the effect of a fault."""
        controller = self._controllers[self.lifts[lift].controllers[0]]
        if isinstance(fault, Reboot | PowerLoss):
            controller.switch(on=on)
        elif isinstance(fault, SlotKept):
            controller.keeps_slot = not on

    def _wire(self, controller: Controller) -> Wire:
        name = self._names[controller.host, controller.port]
        return FaultyWire(self._controllers[name], self.wire_faults[name], peer=name)

    def _lift(self, name: str, parameters: Parameters | None) -> SimulatedLift:
        spec = self.loaded.site.lifts[name]
        source = self._wired.get(name, self.loaded.maps[name].map)
        codec = compile_map(source, offset=spec.offset)
        floors = {floor: entry.code for floor, entry in spec.floors.items()}
        face = simulated_lift(codec, floors, like=parameters, speed=parameters.speed if parameters is not None else 1.0)
        places = devices(self.loaded.site, spec, source)
        for endpoint, place in places.items():
            units = self._units[place.controller]
            if place.unit_id in units:
                text = f"{name}: unit {place.unit_id} of {place.controller} is another lift already; a simulated device is one lift"
                raise WorldError(text)
            units[place.unit_id] = face.endpoint(endpoint) if endpoint else face
        controllers = tuple(dict.fromkeys((places[""].controller, *(place.controller for place in places.values()))))
        outputs = Outputs(source, tuple(floors.values()), spec.offset)
        return SimulatedLift(name, codec, tuple(spec.floors), face, outputs, controllers, inputs=face.inputs)


def office_hours() -> datetime:
    """Return the time of day in the building: the world begins on a Monday at noon."""
    return START_TIME + timedelta(seconds=_now())


def _now() -> float:
    return asyncio.get_running_loop().time()
