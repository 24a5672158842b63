"""A simulated lift in memory with one commissioning mistake between it and its map, for tools that are to find the mistake."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path

from drivers.errors import ConnectProblem
from drivers.modbus.memory import MemoryWire, Reply
from lift_manager.commissioning.doctor.collect import collect
from lift_manager.commissioning.doctor.evidence import Evidence, Probe
from lift_manager.commissioning.doctor.report import Report, make_report
from lift_manager.commissioning.doctor.subjects import ExaminedController, Subjects, subjects_at
from lift_manager.lab.plant import simulated_lift
from register_maps import frames, identification
from register_maps.codec import Codec, compile_map
from register_maps.frames import Request
from register_maps.load import LoadedMap, load
from register_maps.signal_codec import swap_bytes
from register_maps.words import BIT_TABLES, Table
from simulator.cells import ExceptionReply
from simulator.registers import RegisterFace
from simulator.state import Inputs
from tests.support.virtual_time import run_virtual

Edit = Callable[[Table, int, int], int]
"""(table, address, value) -> the value that the controller answers instead."""
FLOORS = {"L1": 1, "L2": 2, "L3": 3, "L4": 4}


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """What is wrong between a map and its controller; by default nothing is."""

    map: str = "generic-registers"
    """Of the tool; the controller has `controller_map`, by default the same."""
    controller_map: str = ""
    floors: Mapping[str, int] = field(default_factory=lambda: FLOORS)
    """As the tool has them; the controller has `controller_floors`, by default the same."""
    controller_floors: Mapping[str, int] | None = None
    start: int = 0
    """The floor at which the car stands, by its place."""
    unit: int | None = None
    """Of the controller; by default that of its map."""
    other_units: str = "silent"
    """How the controller treats requests to other units: silent, as its own, or as a gateway does for a unit that is not there."""
    shift: int = 0
    """The controller has everything so many addresses higher."""
    tables: Mapping[Table, Table] = field(default_factory=dict)
    """Where the controller has what the map has in these tables."""
    crossed: tuple[tuple[Table, int], ...] = ()
    """Two wires that are exchanged."""
    edit: Edit = lambda _table, _address, value: value
    delay_s: float = 0.004
    clients: int = 8
    """Connections that the controller serves at once."""
    taken: bool = False
    """Somebody else has its only slot."""
    refused: tuple[tuple[Table, int], ...] = ()
    """Addresses that are answered with exception 02."""
    longest: int = 125
    answers: Callable[[bytes, bytes], bytes] = lambda _request, answer: answer
    idle_s: float = float("inf")
    """The controller ends a connection without requests after so long."""
    problem: ConnectProblem | None = None
    people: tuple[tuple[float, Inputs], ...] = ()
    """What people press, and when."""
    writes: tuple[tuple[float, Table, int, int], ...] = ()
    """What another client writes: time, table, address, value."""
    identity: str = ""
    """What follows `2B 0E` in the answer to the question what it is, in hex; empty: exception 01."""
    probes: tuple[Probe, ...] = ()
    seconds: float = 8.0


@cache
def loaded(name: str) -> LoadedMap:
    return load(name)


class PlantedController:
    """The controller of a mistake, on virtual time."""

    def __init__(self, mistake: Mistake) -> None:
        self.mistake = mistake
        codec = compile_map(loaded(mistake.controller_map or mistake.map).map)
        self._unit = codec.map.link.unit_id if mistake.unit is None else mistake.unit
        self.face = _lift(codec, mistake.controller_floors or mistake.floors, mistake.start)
        self.received: list[Request] = []
        self._open: list[MemoryWire] = []
        self._read_at = 0.0

    def wire(self, _controller: ExaminedController | None = None) -> MemoryWire:
        """Make a wire; its connections count against the clients that the controller serves."""
        wire = MemoryWire(lambda frame: self._answer(wire, frame), admit=lambda: self._admit(wire), peer="plc:502")
        return wire

    def people(self, inputs: Inputs) -> None:
        """Change what people press."""
        self.face.people(asyncio.get_running_loop().time(), inputs)

    def written(self, table: Table, address: int, value: int) -> None:
        """Write as another client does."""
        self.face.write(table, address, [value], asyncio.get_running_loop().time())

    def _admit(self, wire: MemoryWire) -> ConnectProblem | None:
        if self.mistake.problem is not None:
            return self.mistake.problem
        self._open = [one for one in self._open if one.is_open]
        if len(self._open) >= self.mistake.clients:
            return ConnectProblem.REFUSED
        self._open.append(wire)
        return None

    def _answer(self, wire: MemoryWire, frame: bytes) -> list[Reply]:
        mistake, now = self.mistake, asyncio.get_running_loop().time()
        self._read_at, idle_s = now, now - self._read_at
        if mistake.taken or idle_s > mistake.idle_s:
            return [(0.0, None)]
        if frame[7] == identification.FUNCTION:
            return [(mistake.delay_s, _identity(frame, mistake.identity))]
        request = frames.parse_request(frame)
        self.received.append(request)
        if request.unit != self._unit and mistake.other_units != "as its own":
            if mistake.other_units == "gateway":
                return [(mistake.delay_s, frames.exception_answer(frame, 0x0B))]
            return []
        try:
            right = frames.answer(request, frames.tid_of(frame), self._payload(request, now))
        except ExceptionReply as refusal:
            right = frames.exception_answer(frame, refusal.code)
        return [(mistake.delay_s, mistake.answers(frame, right))]

    def _payload(self, request: Request, now: float) -> bytes:
        mistake = self.mistake
        if request.count > mistake.longest:
            raise ExceptionReply(3)
        tables = {there: here for here, there in mistake.tables.items()}
        if request.table in mistake.tables and request.table not in tables:
            raise ExceptionReply(2)
        table = tables.get(request.table, request.table)
        values = []
        for address in range(request.address, request.address + request.count):
            if (request.table, address) in mistake.refused:
                raise ExceptionReply(2)
            place = (table, address - mistake.shift)
            if place in mistake.crossed:
                place = mistake.crossed[1 - mistake.crossed.index(place)]
            values.append(mistake.edit(table, address - mistake.shift, self._cell(*place, now)))
        if table in BIT_TABLES:
            return frames.pack_bits(values)
        return b"".join(value.to_bytes(2, "big") for value in values)

    def _cell(self, table: Table, address: int, now: float) -> int:
        """Read one address of the simulated lift; around what it has, a shifted controller has zeros."""
        try:
            return self.face.read(table, address, 1, now)[0]
        except (ExceptionReply, IndexError):
            if self.mistake.shift and -2 <= address <= 60:
                return 0
            raise


def _identity(frame: bytes, says: str) -> bytes:
    if not says:
        return frames.exception_answer(frame, 1)
    pdu = frame[7:9] + bytes.fromhex(says)
    return frame[:4] + (1 + len(pdu)).to_bytes(2, "big") + frame[6:7] + pdu


def _lift(codec: Codec, floors: Mapping[str, int], start: int) -> RegisterFace:
    lift = simulated_lift(codec, floors)
    return RegisterFace(codec, tuple(floors.values()), lift.parameters, start=start, key=lift.inputs.key)


def subjects_of(mistake: Mistake) -> Subjects:
    """Return what a tool examines that knows nothing of the mistake."""
    return subjects_at("plc", 502, loaded(mistake.map), floors=mistake.floors)


def examine(mistake: Mistake, folder: Path, subjects: Subjects | None = None) -> tuple[Report, Evidence]:
    """Run doctor against a mistake, on virtual time; whatever is wrong, nothing may be written."""
    subjects = subjects or subjects_of(mistake)

    async def main() -> Evidence:
        planted, loop = PlantedController(mistake), asyncio.get_running_loop()
        for at_s, inputs in mistake.people:
            loop.call_at(at_s, partial(planted.people, inputs))
        for at_s, table, address, value in mistake.writes:
            loop.call_at(at_s, partial(planted.written, table, address, value))
        found = await collect(
            subjects, seconds=mistake.seconds, probes=mistake.probes, make_wire=planted.wire, temporary=folder
        )
        assert not any(request.is_write for request in planted.received)
        return found

    evidence = run_virtual(main)
    return make_report(subjects, evidence, version="1", time="2026-11-23T12:00:00+00:00"), evidence


# -- edits


def swapped_bytes(table: Table, _address: int, value: int) -> int:
    return value if table in BIT_TABLES else swap_bytes(value)


def inverted(*bits: tuple[Table, int, int]) -> Edit:
    """Invert bits: table, address and place in a register."""

    def edit(table: Table, address: int, value: int) -> int:
        for where, at, place in bits:
            if (where, at) == (table, address):
                value ^= 1 << place
        return value

    return edit


def constant(table: Table, address: int, value: int) -> Edit:
    """Let one address stand at a value."""
    return lambda where, at, now: value if (where, at) == (table, address) else now


def with_floors(mistake: Mistake, **floors: int) -> Mistake:
    return replace(mistake, floors=floors)
