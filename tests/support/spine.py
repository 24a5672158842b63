"""The whole spine on virtual time: simulated lift, in-memory wire, link, driver, lift task."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryWire, Reply
from lift_manager.core.bus import Bus
from lift_manager.core.lift import LiftTask
from lift_manager.core.options import LiftOptions
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.events import Event
from lift_manager.domain.state import Holder, LiftState
from register_maps import frames
from register_maps.codec import Codec, compile_map
from register_maps.frames import Request
from register_maps.schema import RegisterMap
from register_maps.words import BIT_TABLES
from simulator import shaft
from simulator.controller import Inputs, Parameters
from simulator.modes import Key
from simulator.registers import Objection, RegisterFace
from tests.support.virtual_time import elapse, run_virtual

MAPS = Path(__file__).parents[2] / "register_maps" / "maps"
CALL = 16
"""The call register of generic-registers."""
WORKSHOP = Holder("workshop", "workshop")
OTHER = Holder("rmf", "fleet/robot1")


def compiled(name: str) -> Codec:
    """A shipped map, compiled."""
    return compile_map(RegisterMap.model_validate(yaml.safe_load((MAPS / f"{name}.yaml").read_text("utf-8"))))


@dataclass
class SimulatedDevice:
    """A register face at the end of memory wires."""

    face: RegisterFace
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
        request, now = frames.parse_request(frame), asyncio.get_running_loop().time()
        if self.refuses and any(request.values):
            self.refused += 1
            return [(self.delay_s, frames.exception_answer(frame, 4))]
        try:
            if request.is_write:
                if not (self.ignores_calls and request.address == CALL):
                    self.face.write(request.table, request.address, request.values, now)
                self.writes.append((now, request))
                payload = b""
            else:
                cells = self.face.read(request.table, request.address, request.count, now)
                payload = (
                    frames.pack_bits(cells)
                    if request.table in BIT_TABLES
                    else b"".join(c.to_bytes(2, "big") for c in cells)
                )
        except Objection as objection:
            return [(self.delay_s, frames.exception_answer(frame, objection.code))]
        return [(self.delay_s, frames.answer(request, frames.tid_of(frame), payload))]


@dataclass
class Spine:
    """One lift from its shaft to its task."""

    device: SimulatedDevice
    task: LiftTask
    bus: Bus[Event]
    driver: ModbusLift
    link: Link

    @property
    def face(self) -> RegisterFace:
        return self.device.face

    @property
    def state(self) -> LiftState:
        return self.task.state()

    def ask(self, floor: str, *, hold: bool = True, holder: Holder = WORKSHOP) -> Accepted | Refused:
        return self.task.request(Ask(self.task.options.name, holder, floor, hold))

    def accept(self, floor: str, *, hold: bool = True, holder: Holder = WORKSHOP) -> None:
        answer = self.ask(floor, hold=hold, holder=holder)
        assert answer == Accepted(), answer

    def refuse(self, floor: str, *, hold: bool = True, holder: Holder = WORKSHOP) -> Refused:
        answer = self.ask(floor, hold=hold, holder=holder)
        assert isinstance(answer, Refused), answer
        return answer

    def people(self, inputs: Inputs) -> None:
        self.face.people(asyncio.get_running_loop().time(), inputs)

    def presses(self, address: int = CALL) -> list[tuple[float, int]]:
        """Times and values of the writes to one cell that ask for something."""
        return [
            (at, request.values[0])
            for at, request in self.device.writes
            if request.address == address and any(request.values)
        ]

    async def until(self, true: Callable[[LiftState], bool], within_s: float = 60.0) -> float:
        """Wait until the published state fulfils this; return how long it took."""
        loop = asyncio.get_running_loop()
        start = loop.time()
        async with asyncio.timeout(within_s):
            while not true(self.state):
                await elapse(0.02)
        return loop.time() - start


@asynccontextmanager
async def spine(
    map_name: str = "generic-registers",
    floors: Mapping[str, int] | None = None,
    *,
    control: bool = True,
    lease_s: float = 300.0,
    max_session_hold_s: float = 900.0,
    poll_s: float = 0.1,
) -> AsyncIterator[Spine]:
    codec = compiled(map_name)
    two_stop = map_name == "two-stop-agv"
    named = dict(floors) if floors else ({"L1": 0, "L2": 1} if two_stop else {"L1": 1, "L2": 2, "L3": 3})
    building = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(len(named))))
    face = RegisterFace(codec, tuple(named.values()), building, key=Key.ROBOT if two_stop else Key.NORMAL)
    device = SimulatedDevice(face)
    link = Link(device.wire, LinkSettings(), name="plc")
    driver = ModbusLift(codec, link, LiftSettings(name="lift", floors=named, control=control))
    bus: Bus[Event] = Bus()
    options = LiftOptions(
        name="lift",
        floors=tuple(named),
        doors_at=dict.fromkeys(named, driver.capabilities.doors),
        control=control,
        lease_s=lease_s,
        max_session_hold_s=max_session_hold_s,
        poll_s=poll_s,
    )
    task = LiftTask(driver, options, bus)
    running = [asyncio.ensure_future(work) for work in (link.run(), task.drive(), task.run())]
    made = Spine(device, task, bus, driver, link)
    await elapse(1.5)
    try:
        yield made
    finally:
        for work in running:
            work.cancel()
        await asyncio.gather(*running, return_exceptions=True)


def on_spine(
    check: Callable[[Spine], Awaitable[None]], map_name: str = "generic-registers", **settings: object
) -> None:
    """Run a check against a fresh spine on virtual time."""

    async def main() -> None:
        async with spine(map_name, **settings) as made:  # type: ignore[arg-type]  # keywords of spine
            await check(made)

    run_virtual(main, limit_s=7200)
