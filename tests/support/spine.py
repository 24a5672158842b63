"""The whole spine on virtual time: simulated lift, in-memory wire, link, driver, actor, site."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryWire, Reply
from drivers.modbus.units import Unit
from lift_manager.lab.plant import default_floors, simulated_lift
from lift_manager.lab.world.device import carry_out
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.hours import RobotHours
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.recorder import Clock, MemoryRecorder, Recorder
from lift_manager.runtime.site import Site
from register_maps import frames
from register_maps.codec import Codec
from register_maps.frames import Request
from simulator.controller import Inputs, Parameters
from simulator.registers import Endpoint, ExceptionReply, RegisterFace
from tests.support.session_calls import SessionCalls
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import cancel_all, elapse, run_virtual

CALL = 16
"""The call register of generic-registers."""
FLOORS = {"generic-registers": {"L1": 1, "L2": 2, "L3": 3}}
"""Floors of maps that could have others; the rest get those of a simulation."""
WORKSHOP = Holder("workshop", "workshop")
OTHER = Holder("rmf", "fleet/robot1")


def asked_of(request: Request) -> tuple[int, ...]:
    """What a write puts there; of a mask write the bits it sets."""
    if request.function != frames.MASK_WRITE:
        return request.values
    keep, put = request.values
    return (put & ~keep,)


@dataclass
class SimulatedDevice:
    """A register face, or one of its endpoints, at the end of memory wires."""

    face: RegisterFace | Endpoint
    writes: list[tuple[float, Request]] = field(default_factory=list)
    silent: bool = False
    """Hears nothing and answers nothing."""
    ignores_calls: bool = False
    """Answers a write of the call register with OK and does nothing."""
    refuses: bool = False
    """Answers a press with an exception."""
    refused: int = 0
    delay_s: float = 0.004
    wires: list[MemoryWire] = field(default_factory=list)

    def wire(self) -> MemoryWire:
        wire = MemoryWire(self.answer)
        self.wires.append(wire)
        return wire

    def answer(self, frame: bytes) -> list[Reply]:
        if self.silent:
            return []
        request, now = frames.parse_request(frame, timed_coils=True), asyncio.get_running_loop().time()
        if self.refuses and any(asked_of(request)):
            self.refused += 1
            return [(self.delay_s, frames.exception_answer(frame, 4))]
        try:
            ignored = request.is_write and self.ignores_calls and request.address == CALL
            payload = b"" if ignored else carry_out(self.face, request, now)
            if request.is_write:
                self.writes.append((now, request))
        except ExceptionReply as objection:
            return [(self.delay_s, frames.exception_answer(frame, objection.code))]
        return [(self.delay_s, frames.answer(request, frames.tid_of(frame), payload))]


@dataclass
class Spine(SessionCalls):
    """One lift from its shaft to its site."""

    device: SimulatedDevice
    actor: LiftActor
    site: Site
    life: SiteLife
    recorder: Recorder
    bus: Bus[Event]
    driver: ModbusLift
    link: Link
    face: RegisterFace
    endpoints: Mapping[str, SimulatedDevice]
    """Further devices of the map, by name."""
    caller: Holder = WORKSHOP

    def people(self, inputs: Inputs) -> None:
        self.face.people(asyncio.get_running_loop().time(), inputs)

    def presses(self, address: int = CALL) -> list[tuple[float, int]]:
        """Times and values of the writes to one cell that ask for something."""
        return [
            (at, asked_of(request)[0])
            for at, request in self.device.writes
            if request.address == address and any(asked_of(request))
        ]

    async def until(self, true: Callable[[LiftState], bool], within_s: float = 60.0) -> float:
        """Wait until the published state fulfils this; return how long it took."""
        loop = asyncio.get_running_loop()
        start = loop.time()
        async with asyncio.timeout(within_s):
            while not true(self.state):
                await elapse(0.05)
        return loop.time() - start


@asynccontextmanager
async def spine(
    map_name: str = "generic-registers",
    floors: Mapping[str, int] | None = None,
    *,
    control: bool = True,
    lease_s: float = 300.0,
    max_session_hold_s: float = 900.0,
    clear_s: float = 10.0,
    poll_s: float = 0.4,
    infer_occupancy: bool = False,
    between_sessions_s: float = 0.0,
    fire_release_delay_s: float = 0.0,
    robot_hours: RobotHours | None = None,
    recorder: Recorder | None = None,
    clock: Clock | None = None,
    codec: Codec | None = None,
    really: Codec | None = None,
    like: Parameters | None = None,
) -> AsyncIterator[Spine]:
    """One lift of a shipped map, or of `codec`, standing at its lowest floor above ground; `like` are settings of its controller, which is as `really` says.

    A second one on the same `recorder` is the lift after a restart of the manager. Sessions follow each other without a rest
    unless a test wants one.
    """
    codec = codec or compiled(map_name)
    source = codec.map
    named = dict(floors or FLOORS.get(source.name) or default_floors(source))
    face = simulated_lift(really or codec, named, like=like)
    devices = {"": SimulatedDevice(face)} | {name: SimulatedDevice(face.endpoint(name)) for name in source.endpoints}
    settings = LinkSettings(
        timeout_s=source.link.timeout_s, min_gap_s=source.link.min_gap_s, reconnect_min_s=source.link.reconnect_min_s
    )
    lines = {
        name: Unit(Link(device.wire, settings, name=name or "plc"), source.unit_of(name))
        for name, device in devices.items()
    }
    device, link = devices.pop(""), lines[""].link
    links = [line.link for line in lines.values()]
    lift_settings = LiftSettings(
        name="lift",
        floors=named,
        unit_id=lines.pop("").unit_id,
        control=control,
        max_age_s=source.link.max_age_s,
        max_registers_per_read=source.link.max_registers_per_read,
        max_bits_per_read=source.link.max_bits_per_read,
    )
    recorder = recorder or MemoryRecorder()
    driver = ModbusLift(codec, link, lift_settings, lines)
    bus: Bus[Event] = Bus()
    config = LiftConfig(
        name="lift",
        source=driver.source,
        floors=tuple(named),
        doors_at=dict.fromkeys(named, driver.capabilities.doors),
        control=control,
        capabilities=driver.capabilities,
        lease_s=lease_s,
        max_session_hold_s=max_session_hold_s,
        clear_s=clear_s,
        poll_s=max(poll_s, source.link.min_poll_s),
        infer_occupancy=infer_occupancy,
        between_sessions_s=between_sessions_s,
        fire_release_delay_s=fire_release_delay_s,
        robot_hours=robot_hours,
    )
    actor = LiftActor(driver, config, bus, recorder, clock=clock)
    site = Site([actor], bus, recorder, clock=clock)
    life = SiteLife(site, [actor])
    works = (*(one.run() for one in links), *life.drives(), life.run())
    running = [asyncio.create_task(work) for work in works]
    made = Spine(device, actor, site, life, recorder, bus, driver, link, face, devices)
    await elapse(1.5)
    try:
        yield made
    finally:
        await cancel_all(running)


def on_spine(
    check: Callable[[Spine], Awaitable[None]], map_name: str = "generic-registers", **settings: object
) -> None:
    """Run a check against a fresh spine on virtual time."""

    async def main() -> None:
        async with spine(map_name, **settings) as made:  # type: ignore[arg-type]  # keywords of spine
            await check(made)

    run_virtual(main, limit_s=7200)
