"""A whole site on the loop's own time: simulated lifts, wires without a network, and the manager.

On a virtual loop (`lift_manager.lab.virtual_time`) an hour takes seconds, and every run of a seed is the same.
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

LOOK_S = 0.25
"""How often somebody asks for the state of every lift. Chosen: more often than any client does."""

JOURNAL_ROWS = 500
"""The newest rows of the journal that are kept. Nothing reads them here; the usual number is 10 MB. Chosen."""

BEGAN_AT = datetime(2026, 1, 5, 12, tzinfo=UTC)
"""A Monday noon: robots may begin at any hour that a site is likely to allow. Chosen."""


class WorldError(Exception):
    """This site cannot be simulated, with the reason."""


class Passengers(Protocol):
    """People who use a lift, such as `simulator.people.People`."""

    @property
    def next_at(self) -> float:
        """When they next want to do something."""

    def act(self, now: float, picture: ShownState, inputs: Inputs) -> Inputs:
        """Return what they press, hold and block from now on."""


@dataclass(slots=True)
class SimulatedLift:
    """One lift of the world, from its shaft to its registers."""

    name: str
    codec: Codec
    floors: tuple[FloorName, ...]
    face: RegisterFace
    outputs: Outputs
    controllers: tuple[str, ...]
    """Where it can be reached: its own controller first, then those of its endpoints."""
    inputs: Inputs
    """What people and keys do."""
    people: Passengers | None = None
    _seen: tuple[ShownState, tuple[Raw, dict[str, int]], Truth] | None = None

    @property
    def truth(self) -> Truth:
        """What it really does, at its own time; a lift in which nothing has changed has the same truth still.

        Raises WorldError where the simulator obeys what the judge does not read in its registers, but for holds that its program has
        taken out of them, as their map says.
        """
        face, raw = self.face, self.outputs.raw(self.face.cells)
        taken = dict.fromkeys(face.cleared_holds, 1)
        picture = face.picture
        if self._seen is not None and self._seen[0] is picture and self._seen[1] == (raw, taken):
            return self._seen[2]
        given = {**taken, **self.outputs.asked(raw)}
        if any(given.get(name) != value for name, value in face.commands.items()):
            raise WorldError(f"{self.name} obeys {dict(face.commands)}, and its registers ask for {dict(given)}")
        truth = truth_of(face, self.floors, given)
        if self._seen is not None and self._seen[2] == truth:
            truth = self._seen[2]
        self._seen = picture, (raw, taken), truth
        return truth


class World:
    """Simulated lifts, the weather on their wires, and the manager that drives them."""

    def __init__(  # noqa: PLR0913  every argument after the site and its judges is a setting with a default
        self,
        loaded: LoadedSite,
        witnesses: Sequence[Witness],
        *,
        seed: int = 0,
        settings: Mapping[str, Parameters] | None = None,
        look_s: float = LOOK_S,
        clock: Clock | None = None,
        disk: SimulatedDisk | None = None,
        wired: Mapping[str, RegisterMap] | None = None,
    ) -> None:
        """Put everything together; raises WorldError for two lifts behind one unit.

        `settings` are those of a lift's controller, by lift; `look_s` is how often somebody asks for states; `disk` holds state
        and journal, without one commits take no time. `wired` says by which map a lift is really wired, where that of the site
        is wrong.
        """
        self.loaded = loaded
        self._wired = wired or {}
        self.lifts: dict[str, SimulatedLift] = {}
        self.weather: dict[str, WireFaults] = {}
        """The faults on the wire to each controller."""
        self._witnesses = tuple(witnesses)
        self._look_s = look_s
        self._units: dict[str, dict[int, Device]] = {name: {} for name in loaded.controllers}
        for name in loaded.site.lifts:
            self.lifts[name] = self._lift(name, (settings or {}).get(name))
        self._given: dict[str, tuple[tuple[str, int], ...]] = dict.fromkeys(self.lifts, ())
        """What each lift was asked for at the last look, with the floor of a call: another floor is another press."""
        self._controllers: dict[str, MemoryController] = {}
        for number, name in enumerate(loaded.controllers):
            self.weather[name] = WireFaults(seed=seed * 1000 + number)
            self.weather[name].on_exchange = partial(self._exchanged, name)
            behind = [lift.name for lift in self.lifts.values() if name in lift.controllers]
            self._controllers[name] = MemoryController(self._units[name], partial(self._served, behind))
        self._names = {(spec.host, spec.port): name for name, spec in loaded.controllers.items()}
        self.released = False
        """Whether every output was seen to be let go at the end."""
        self.disk = disk or SimulatedDisk(keep=JOURNAL_ROWS)
        """It outlives every manager."""
        self._clock = clock or office_hours
        self._program: list[asyncio.Task[None]] = []
        """The manager, task by task."""
        self._hearing = ExitStack()
        """What it publishes is told at once for as long as this lasts."""
        self.site: Site
        """As every face sees it; another one after a restart."""
        self.actors: Mapping[str, LiftActor]
        """What carries out each lift; others after a restart."""
        self.links: tuple[Link, ...]
        self._life: SiteLife
        self._recorder: DiskRecorder
        self._tasks: asyncio.TaskGroup
        self._build()

    # -- what a scenario does

    def request(self, request: FloorRequest) -> RequestRefused | None:
        """Request something of the manager, as a face does; return why it was refused, None where it was taken."""
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
            witness.requested(now, request, refused)
        return refused

    def begin(self, lift: str, fault: Fault) -> None:
        """Let something go wrong with a lift or its controller."""
        self.lifts[lift].face.begin(fault, _now())
        self._switch(lift, fault, on=False)
        self._struck(FaultChange(lift, fault, began=True), (lift,))

    def end(self, lift: str, fault: Fault) -> None:
        """Let it be well again."""
        self.lifts[lift].face.end(fault, _now())
        self._switch(lift, fault, on=True)
        self._struck(FaultChange(lift, fault, began=False), (lift,))

    def spoil(self, controller: str, fault: WireFault) -> None:
        """Put a fault on the wire to a controller."""
        self.weather[controller].add(fault)
        self._struck(FaultChange(controller, fault, began=True), ())

    def mend(self, controller: str, fault: WireFault) -> None:
        """Take a fault off the wire again."""
        self.weather[controller].remove(fault)
        self._struck(FaultChange(controller, fault, began=False), ())

    def spoil_disk(self, fault: DiskFault) -> None:
        """Let the disk fail."""
        self.disk.begin(fault)
        self._struck(FaultChange("disk", fault, began=True), ())

    def mend_disk(self, fault: DiskFault) -> None:
        """Let it work again."""
        self.disk.end(fault)
        self._struck(FaultChange("disk", fault, began=False), ())

    def set_inputs(self, lift: str, inputs: Inputs) -> None:
        """Change what people press, hold and turn."""
        self.lifts[lift].inputs = inputs
        self.lifts[lift].face.people(_now(), inputs)
        self._look((lift,))

    def populate(self, lift: str, people: Passengers) -> None:
        """Let passengers use a lift from now on."""
        self.lifts[lift].people = people

    def controller(self, name: str) -> MemoryController:
        """The devices behind one address: what is written to them here is taken for a write of the manager."""
        return self._controllers[name]

    # -- how it runs

    @asynccontextmanager
    async def running(self) -> AsyncIterator[World]:
        """Run everything for as long as the context lasts; then let go of everything, as at the end of the program.

        Raises whatever a part of the manager raised.
        """
        async with asyncio.TaskGroup() as tasks:
            self._tasks = tasks
            others = [tasks.create_task(part) for part in (self._watch(), self._inhabit())]
            self._start()
            self._look(self.lifts)
            try:
                yield self
                self._struck(FaultChange("manager", STOP, began=True), ())
                await self._life.clear_doors()
                with suppress(TimeoutError):
                    async with asyncio.timeout(app.RELEASE_WITHIN_S):
                        await self._life.stop()
                        self.released = True
                self._look(self.lifts)
            finally:
                self._hearing.close()
                for task in (*self._program, *others):
                    task.cancel()

    async def restart(self) -> None:
        """Kill the manager as `kill -9` does, letting go of nothing, and start it again with what it had written down."""
        program, self._program = self._program, []
        for task in program:
            task.cancel()
        await asyncio.gather(*program, return_exceptions=True)
        for controller in self._controllers.values():
            controller.hang_up()
        self._hearing.close()
        self._struck(FaultChange("manager", RESTART, began=True), ())
        if forgotten := tuple(self._recorder.unwritten):
            self._struck(FaultChange("disk", ForgottenRecords(forgotten), began=True), ())
        self._recorder.drop()
        self._build()
        self._start()

    def forget(self) -> None:
        """Drop the record of what faults did to the wires: it grows for as long as a world lasts."""
        for faults in self.weather.values():
            faults.strikes.clear()

    def _build(self) -> None:
        # a recorder of its own: what a killed manager still learns of its presses changes nothing on the disk
        self._recorder = DiskRecorder(self.disk)
        building = app.build(self.loaded, self._wire, recorder=self._recorder, clock=self._clock)
        self.site, self._life, self.links = building.site, building.life, building.links
        self.actors = {actor.config.name: actor for actor in building.actors}

    def _start(self) -> None:
        # nothing is missed between one manager and the next: a word of a person that is not heard is missed for the rest of the day
        self._hearing.enter_context(self.site.tap(self._heard))
        self._ask_for_states()
        parts = [*(link.run() for link in self.links), *self._life.drives(), self._life.run()]
        if not self.disk.instant:
            parts.append(self._recorder.run(self.site.report_disk))
        self._program = [self._tasks.create_task(part) for part in parts]

    def _heard(self, said: Occurrence) -> None:
        if isinstance(said.event, StateChanged):
            self._told(said.at, said.event.lift, said.event.state)
            return
        for witness in self._witnesses:
            witness.heard(said.at, said.event)

    def _ask_for_states(self) -> None:
        now = _now()
        for name in self.lifts:
            self._told(now, name, self.site.state(name))

    def _told(self, now: float, lift: str, state: LiftState) -> None:
        for witness in self._witnesses:
            witness.published(now, lift, state)

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(self._look_s)
            self._look(self.lifts)
            self._ask_for_states()

    async def _inhabit(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            now = _now()
            for lift in self.lifts.values():
                if lift.people is not None and now >= lift.people.next_at:
                    lift.face.advance(now)
                    inputs = lift.people.act(now, lift.face.picture, lift.inputs)
                    if inputs != lift.inputs:
                        self.set_inputs(lift.name, inputs)

    def _look(self, lifts: Sequence[str] | Mapping[str, SimulatedLift]) -> None:
        now = _now()
        for name in lifts:
            lift = self.lifts[name]
            lift.face.advance(now)
            truth = lift.truth
            self._given[name] = truth.given
            for witness in self._witnesses:
                witness.looked(now, name, truth)

    def _served(self, lifts: Sequence[str], wrote: bool) -> None:  # noqa: FBT001 - it is the one question
        before = {name: self._given[name] for name in lifts} if wrote else {}
        self._look(lifts)
        for name, given in before.items():
            if new := frozenset(command for command, _ in {*self._given[name]} - {*given}):
                for witness in self._witnesses:
                    witness.pressed(_now(), name, new)

    def _exchanged(self, controller: str, exchange: Exchange) -> None:
        now = _now()
        for witness in self._witnesses:
            witness.exchanged(now, controller, exchange)

    def _struck(self, struck: FaultChange, lifts: Sequence[str]) -> None:
        now = _now()
        for witness in self._witnesses:
            witness.struck(now, struck)
        self._look(lifts)

    def _switch(self, lift: str, fault: Fault, *, on: bool) -> None:
        """Take the devices of a lift off the network, or put them on it, where that is what a fault does."""
        own = self._controllers[self.lifts[lift].controllers[0]]
        if isinstance(fault, Reboot | PowerLoss):
            own.switch(on=on)
        elif isinstance(fault, SlotKept):
            own.keeps_slot = not on

    def _wire(self, controller: Controller) -> Wire:
        name = self._names[controller.host, controller.port]
        return FaultyWire(self._controllers[name], self.weather[name], peer=name)

    def _lift(self, name: str, like: Parameters | None) -> SimulatedLift:
        spec = self.loaded.site.lifts[name]
        source = self._wired.get(name, self.loaded.maps[name].map)
        codec = compile_map(source, offset=spec.offset)
        floors = {floor: entry.code for floor, entry in spec.floors.items()}
        face = simulated_lift(codec, floors, like=like, speed=like.speed if like is not None else 1.0)
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
    """Return the time of day in a building where the world began at noon on a Monday."""
    return BEGAN_AT + timedelta(seconds=_now())


def _now() -> float:
    return asyncio.get_running_loop().time()
