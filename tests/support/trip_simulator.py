"""The simulated lift of a site as the far end of a trip, with a log of what it showed at every request."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache

from lift_manager.lab.plant import simulated_lift
from register_maps import frames
from register_maps.address import space
from register_maps.arbitration import NO_CLAIM, claim_alone
from register_maps.codec import Cell, Point
from register_maps.command_codec import payload_counts
from register_maps.errors import BadRequest
from register_maps.frames import Request
from simulator import network_commands
from simulator.registers import RegisterFace
from simulator.state import ShownState
from tests.support.spine import SimulatedDevice
from tests.support.trip import Exchange, Trip, Truth, on_trip
from tests.support.trip_sites import Site, site_of, stops


@dataclass
class SimulatedPlant:
    """A simulated lift and its devices."""

    site: Site
    face: RegisterFace = field(init=False)
    shown: list[ShownState] = field(default_factory=list)
    """What the lift really did, at each exchange."""
    speed: float = 1.0
    """Seconds of its machine in a second."""

    def __post_init__(self) -> None:
        self.face = simulated_lift(self.site.codec, self.site.floors, speed=self.speed)
        self._mirror = Mirror(self.site)
        self._asked: frozenset[str] = frozenset()
        self._devices = {"": SimulatedDevice(self.face)} | {
            name: SimulatedDevice(self.face.endpoint(name)) for name in self.site.codec.map.endpoints
        }

    def answer(self, device: str, frame: bytes, now: float) -> bytes | None:
        try:
            replies = self._devices[device].answer(frame)
        except BadRequest as refusal:
            replies = [(0.0, frames.exception_answer(frame, refusal.code))]
        else:
            self._asked = frozenset(self._mirror.take(now, device, frames.parse_request(frame, timed_coils=True)))
        self.shown.append(self.face.picture)
        return replies[0][1]

    def truth(self, now: float) -> Truth:
        self.face.advance(now)
        picture = self.face.picture
        near = picture.floor if picture.in_door_zone else None
        return Truth(
            near, picture.level_floor, picture.door_open_floor, picture.may_enter, picture.may_leave, self._asked
        )


@cache
def simulated_trip(name: str, *, in_words: bool) -> tuple[SimulatedPlant, Trip]:
    """Make a whole trip on the lift that is simulated from a shipped map, once for everybody who asks; fails as it fails."""
    site = site_of(name)
    plant = SimulatedPlant(site)
    pickup, destination = stops(site)

    async def check(made: Trip) -> None:
        await made.make(pickup=pickup, destination=destination)

    return plant, on_trip(check, site, plant, in_words=in_words)


def requests(exchanges: Iterable[Exchange]) -> list[tuple[float, str, Request]]:
    """Take the requests apart: when, to which device, what."""
    return [(one.at, one.device, frames.parse_request(one.request, timed_coils=True)) for one in exchanges]


class Mirror:
    """What a device holds after each write, and which commands are present by that: what the simulated lift acts on."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._image = site.codec.empty_image()
        self._ends: dict[Point, float] = {}
        """When the device itself lets go of a point."""
        for command in site.codec.commands.values():
            for point, value in command.encode(None).items():
                self._put(point, value)

    def take(self, at: float, device: str, request: Request) -> dict[str, int]:
        """Take one request at its time and return the commands that are present after it."""
        self._end(at)
        for address, value in self._written(device, request).items():
            self._image[space(device, request.table)][address] = value
            for command in self._site.codec.commands.values():
                for point in command.points if command.spec.ends_itself and value else ():
                    if point.cell == (device, request.table, address):
                        self._ends[point] = at + (command.spec.width_s or 0.0)
        return network_commands.present_commands(self._site.codec, self._image, tuple(self._site.floors.values()))

    def _written(self, device: str, request: Request) -> dict[int, int]:
        if request.function == frames.MASK_WRITE:
            keep, put = request.values
            held = self._image[space(device, request.table)][request.address]
            return {request.address: held & keep | put & ~keep}
        return dict(enumerate(request.values if request.is_write else (), start=request.address))

    def not_at_rest(self, at: float) -> list[str]:
        """Name the commands with a point that does not hold its rest value at this time."""
        self._end(at)
        return [
            name
            for name, command in self._site.codec.commands.items()
            for point, value in command.encode(None).items()
            if point.within(self._image[point.space][point.address]) != value
        ]

    def _end(self, at: float) -> None:
        for command in self._site.codec.commands.values():
            for point, value in command.encode(None).items():
                if at >= self._ends.get(point, math.inf):
                    self._put(point, value)
                    del self._ends[point]

    def _put(self, point: Point, value: int) -> None:
        cells = self._image[point.space]
        cells[point.address] = point.into(cells[point.address], value)


def foreign_writes(site: Site, exchanges: Iterable[Exchange]) -> list[str]:
    """List the writes that are none of the map's commands: another address, or contents that no command has."""
    known: dict[Cell, list[tuple[Point, set[int]]]] = {
        cell: [] for block, _, _ in site.codec.written for cell in block.cells
    }
    if (arbitration := site.codec.arbitration) is not None:
        for point, value in arbitration.encode(claim_alone(NO_CLAIM)).items():
            known[point.cell].append((point, {value}))
    durations: set[int | None] = {None}
    for command in site.codec.commands.values():
        codes = tuple(site.floors.values()) if command.is_call else (1,)
        contents = [command.encode(code) for code in (None, *codes)]
        for point in command.points:
            known.setdefault(point.cell, []).append((point, {said[point] for said in contents}))
        if command.is_timed_coil:
            durations.add(payload_counts(command.spec))
    found = []
    for at, device, request in requests(exchanges):
        values = request.values if request.is_write else ()
        if request.function == frames.MASK_WRITE:
            keep, put = request.values
            values = (put & ~keep,)
        cells = {(device, request.table, address): value for address, value in enumerate(values, request.address)}
        if request.duration not in durations or not all(_is_known(known, cell, cells[cell]) for cell in cells):
            found.append(f"{at:.2f} s: {request}")
    return found


def _is_known(known: Mapping[Cell, list[tuple[Point, set[int]]]], cell: Cell, value: int) -> bool:
    points = known.get(cell)
    if points is None or any(point.within(value) not in allowed for point, allowed in points):
        return False
    return value == sum(point.within(value) << point.low for point, _ in points)
