"""A simulated lift with its controllers on the network, the controls of a panel, and what the panel shows of it."""

from __future__ import annotations

import asyncio
from bisect import bisect_right
from collections import Counter
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial

from pydantic import BaseModel, ConfigDict, Field

from drivers.model import FloorName
from lift_manager.lab.bench.controls import Controls, InputChanges
from lift_manager.lab.bench.errors import BenchError
from lift_manager.lab.panel.faults import PresentFault, present_fault
from lift_manager.lab.panel.registers import Register, RegisterTable
from lift_manager.lab.plant import listening, simulated_lift
from register_maps.codec import Codec
from register_maps.words import Door, Mode, Motion, Side
from simulator.faults import Fault
from simulator.proxy import FaultProxy
from simulator.wire_faults import WireFault, WireFaults

HOST = "127.0.0.1"


class Car(BaseModel):
    """Where the car and its doors really are, whatever the registers show."""

    model_config = ConfigDict(frozen=True)

    floor: FloorName | None = Field(description="the floor in whose door zone the car is")
    last_floor: FloorName = Field(description="the floor in whose door zone the car was last")
    position: float = Field(
        description="floors above the lowest one, such as 1.5 halfway between the second and the third"
    )
    is_level: bool
    motion: Motion
    speed_m_s: float
    doors: dict[Side, Door]
    mode: Mode
    is_robot_mode: bool
    destination: FloorName | None
    car_calls: tuple[FloorName, ...] = Field(description="lamps of the buttons in the car, lowest floor first")
    landing_calls: tuple[FloorName, ...] = Field(description="lamps of the landing buttons, lowest floor first")
    is_nudging: bool
    is_watchdog_tripped: bool


class Address(BaseModel):
    """Where a Modbus/TCP client reaches one of the devices of a lift."""

    model_config = ConfigDict(frozen=True)

    host: str
    port: int
    unit: int


class SimulatedLift(BaseModel):
    """A lift of the panel."""

    model_config = ConfigDict(frozen=True)

    name: str
    map: str
    floors: tuple[FloorName, ...] = Field(description="lowest first")
    sides: tuple[Side, ...] = Field(description="its doors")
    controllers: dict[str, Address] = Field(
        description="by endpoint of the map; the controller itself has the empty name"
    )
    is_on_network: bool = Field(description="whether its controller answers at all")
    car: Car
    inputs: InputChanges = Field(description="what people press, hold and turn")
    faults: tuple[PresentFault, ...]
    registers: tuple[Register, ...]


class PanelLift:
    """One lift of a panel; call its methods on its loop."""

    def __init__(self, name: str, codec: Codec, floors: Mapping[FloorName, int], *, speed: float) -> None:
        """Raises ValueError for a floor that the map cannot express."""
        self.name = name
        self.floors = tuple(floors)
        self.face = simulated_lift(codec, floors, speed=speed)
        self.controls = Controls(name, self.face, self.floors)
        self._codec = codec
        self._registers = RegisterTable(codec, self.face, floors)
        self._wires = {endpoint: WireFaults(seed=number) for number, endpoint in enumerate(("", *codec.map.endpoints))}
        self._struck: Counter[WireFault] = Counter()
        self._addresses: dict[str, Address] = {}

    @asynccontextmanager
    async def running(self, *, host: str = HOST, port: int = 0) -> AsyncIterator[dict[str, int]]:
        """Serve the controllers, behind wires that can have faults; yields their ports by endpoint. Raises OSError for a port in use."""
        async with AsyncExitStack() as stack:
            stack.callback(self.controls.close)
            ports = await stack.enter_async_context(listening(self._codec.map, self.face))
            proxies: dict[str, FaultProxy] = {}
            for number, (endpoint, hidden) in enumerate(ports.items()):
                proxies[endpoint] = FaultProxy(
                    HOST,
                    hidden,
                    self._wires[endpoint],
                    listen_host=host,
                    listen_port=port + number if port else 0,
                    on_request=partial(self._take_request, endpoint),
                )
                await stack.enter_async_context(proxies[endpoint])
            self._addresses = {
                endpoint: Address(host=host, port=proxy.port, unit=self._codec.map.unit_of(endpoint))
                for endpoint, proxy in proxies.items()
            }
            yield {endpoint: proxy.port for endpoint, proxy in proxies.items()}

    def begin(self, fault: Fault | WireFault) -> None:
        """Begin a fault of the lift, or of the wires to all its devices. Raises BenchError."""
        if not isinstance(fault, WireFault):
            self.controls.begin(fault)
        elif fault not in self._wire_faults:
            for wire in self._wires.values():
                wire.add(fault)

    def end(self, fault: Fault | WireFault) -> None:
        """End a fault. Raises BenchError if it has not begun."""
        if not isinstance(fault, WireFault):
            self.controls.end(fault)
            return
        if fault not in self._wire_faults:
            raise BenchError(f"{self.name}: {fault!r} is not on the wire")
        for wire in self._wires.values():
            wire.remove(fault)
        del self._struck[fault]

    def reset(self) -> None:
        """End every fault and release everything; the key returns to where it was at the start."""
        self.controls.reset()
        for wire in self._wires.values():
            wire.clear()
        self._struck.clear()

    def state(self) -> SimulatedLift:
        """Return everything that the panel shows, as of now."""
        now = asyncio.get_running_loop().time()
        self.face.advance(now)
        self._count_strikes()
        device_faults = sorted((present_fault(fault, self.floors) for fault in self.face.faults), key=str)
        wire_faults = [present_fault(fault, self.floors, self._struck[fault]) for fault in self._wire_faults]
        return SimulatedLift(
            name=self.name,
            map=self._codec.map.name,
            floors=self.floors,
            sides=tuple(side for side in Side if side in self.face.picture.doors),
            controllers=self._addresses,
            is_on_network=self.face.on_network,
            car=self._car(),
            inputs=self.controls.held,
            faults=(*device_faults, *wire_faults),
            registers=tuple(self._registers.rows(now)),
        )

    def _car(self) -> Car:
        picture, floors = self.face.picture, self.floors
        return Car(
            floor=floors[picture.floor] if picture.in_door_zone else None,
            last_floor=floors[picture.floor],
            position=self._position(picture.position_m),
            is_level=picture.level_floor is not None,
            motion=picture.motion,
            speed_m_s=round(picture.speed_m_s, 2),
            doors=dict(picture.doors),
            mode=picture.mode,
            is_robot_mode=picture.robot_mode_on,
            destination=None if picture.destination is None else floors[picture.destination],
            car_calls=tuple(floors[index] for index in sorted(picture.car_calls)),
            landing_calls=tuple(floors[index] for index in sorted(picture.landing_calls)),
            is_nudging=picture.nudging,
            is_watchdog_tripped=picture.watchdog_tripped,
        )

    def _position(self, height_m: float) -> float:
        heights = self.face.parameters.shaft.heights_m
        below = min(max(bisect_right(heights, height_m) - 1, 0), len(heights) - 2)
        share = (height_m - heights[below]) / (heights[below + 1] - heights[below])
        return round(below + share, 3)

    @property
    def _wire_faults(self) -> tuple[WireFault, ...]:
        """The same on each wire."""
        return self._wires[""].faults

    def _take_request(self, endpoint: str, client: str, frame: bytes) -> None:
        self._registers.writers.take(endpoint, client, frame, asyncio.get_running_loop().time())
        self._count_strikes()

    def _count_strikes(self) -> None:
        """Count what the wires recorded, which would grow without limit."""
        for wire in self._wires.values():
            self._struck.update(strike.fault for strike in wire.strikes)
            wire.strikes.clear()
