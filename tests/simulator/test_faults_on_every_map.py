"""Every fault of the registers on every shipped map: it shows in what is read or done, or a table says why it cannot."""

from dataclasses import dataclass
from pathlib import Path

from lift_manager.lab.plant import default_floors, simulated_lift
from register_maps.arbitration import ArbitrationCodec, Claim
from register_maps.codec import CommandCodec, Point
from register_maps.command_codec import payload_counts
from simulator.faults import (
    ContradictingLimits,
    Fault,
    FloorAhead,
    ForeignCell,
    ForeignWriter,
    FrozenHeartbeat,
    FrozenRegisters,
    IgnoredWrites,
    LostPress,
    RegisterFault,
    SaysWrongFloor,
    Stopped,
)
from tests.simulator.faces import Faced
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled

MAPS = sorted(path.stem for path in (Path(__file__).parents[2] / "register_maps" / "maps").glob("*.yaml"))


@dataclass
class Rider:
    """A client that rides any map: it asks for robot mode, calls the second floor, and holds the door again and again."""

    name: str

    def __post_init__(self) -> None:
        self.codec = compiled(self.name)
        self.floors = default_floors(self.codec.map)
        self.lift = Faced(simulated_lift(self.codec, self.floors))
        self.call = next(command for command in self.codec.commands.values() if command.is_call)

    def give(self, command: CommandCodec | None, code: int | None) -> None:
        if command is not None and self.codec.arbitration is not None:
            self.claim(self.codec.arbitration, command.encode(code))
            return
        for point, value in command.encode(code).items() if command is not None else ():
            if value and command is not None and command.is_timed_coil:
                self.lift.pulse(point.address, payload_counts(command.spec))
            else:
                cell = self.lift.face.stored(point.table, point.address, self.lift.now)
                self.lift.write(point.table, point.address, point.into(cell, value))

    def claim(self, arbitration: ArbitrationCodec, values: dict[Point, int]) -> None:
        """Write the whole block, in the same epoch again and again."""
        block = self.codec.written[0][0]
        cells = {cell: self.lift.face.cells[cell[1]][cell[2]] for cell in block.cells}
        cells |= {point.cell: value for point, value in (arbitration.encode(Claim(1, 1)) | values).items()}
        self.lift.write(block.table, block.start, *cells.values())

    def shown(self) -> tuple[object, ...]:
        """Every cell of every signal and command."""
        points = [*self.codec.signal_points, *(p for command in self.codec.commands.values() for p in command.points)]
        cells = dict.fromkeys((point.table, point.address) for point in points)
        return tuple(self.lift.read(*cell)[0] for cell in cells)

    def ride(self, fault: Fault | None) -> tuple[list[object], list[object], list[object]]:
        """What is read, and what the lift does, every quarter of a second while the fault lasts; and what is read later."""
        hold, second = self.codec.commands.get("hold_door.front"), list(self.floors.values())[1]
        self.give(self.codec.commands.get("robot_mode"), 1)
        self.lift.after(1)
        read: list[object] = []
        done: list[object] = []
        if fault is not None:
            self.lift.face.begin(fault, self.lift.now)
        for quarter in range(60):
            if quarter % 4 == 0:
                self.give(hold, 1 if quarter < 30 else None)
                self.give(self.codec.commands.get("robot_mode"), 1)
            if quarter in (1, 3):
                self.give(self.call, second if quarter == 1 else None)
            done.append(self.lift.after(0.25))
            read.append(self.shown())
        if fault is not None:
            self.lift.face.end(fault, self.lift.now)
        return read, done, [self.shown(), self.lift.after(0.25), self.shown()]


TOLD_ONLY = (SaysWrongFloor(), FloorAhead(), ContradictingLimits(), FrozenRegisters(), FrozenHeartbeat())
"""Faults of which the lift itself knows nothing."""
HEARD = (Stopped(), LostPress(), IgnoredWrites(), IgnoredWrites(stored=True))
NO_POSITION = "it does not tell where the car is"
NO_DOOR = "it does not tell how its door is"
OBEYS_ONE = ("generic-registers-cluster", "generic-coils-cluster")
ONE_BIT = "its door is one bit, and both values are words"
OPEN_LIMITS = "its floor is the open limit of a door, and a moving car has none"
NO_SIGNALS = ("adam-pushbutton", "moxa-e1211", "waveshare-relay")
CANNOT_SHOW: dict[tuple[Fault, str], str] = {
    **{(SaysWrongFloor(), name): NO_POSITION for name in NO_SIGNALS},
    **{(FloorAhead(), name): NO_POSITION for name in NO_SIGNALS},
    (FloorAhead(), "seer-lps3-two-stop"): OPEN_LIMITS,
    **{(ContradictingLimits(), name): NO_DOOR for name in (*NO_SIGNALS, "thingweb-elevator")},
    **{(ContradictingLimits(), name): ONE_BIT for name in ("robotnik-il-eth", "seer-siemens-chengdu")},
    **{
        (FrozenHeartbeat(), name): "it has no alive counter"
        for name in MAPS
        if not name.startswith("generic-registers")
    },
}
"""Why a fault makes no difference to what is read or done."""


def foreigners(name: str) -> tuple[RegisterFault, RegisterFault]:
    """Somebody else who calls the lowest floor of this map, and somebody else who presses its open button, or its lowest floor."""
    rider = Rider(name)
    hold = rider.codec.commands.get("hold_door.front", rider.call)
    point, value = next(iter(hold.encode(min(rider.floors.values())).items()))
    cell = ForeignCell(point.table, point.address, point.into(0, value), every_s=0.7)
    return ForeignWriter(rider.call.name, floor=0, every_s=0.7), cell


CANNOT_SHOW |= {(fault, name): "it obeys no write without an epoch" for name in OBEYS_ONE for fault in foreigners(name)}


@each_row("name", MAPS)
def test_every_fault_on_every_map_shows_or_has_a_reason_why_it_cannot(name: str) -> None:
    read, done, after = Rider(name).ride(None)
    assert len(set(map(str, done))) > 10, "the lift moved"
    for fault in (*TOLD_ONLY, *HEARD, *foreigners(name)):
        rider = Rider(name)
        wrong, did, later = rider.ride(fault)
        assert ((wrong, did) != (read, done)) is ((fault, name) not in CANNOT_SHOW), f"{fault} on {name}"
        assert rider.lift.face.faults == frozenset()
        if fault in TOLD_ONLY:
            assert did == done, f"{fault} on {name} changes what the lift does"
            assert later == after, f"{fault} on {name} lasts after its end"


def test_every_reason_is_for_a_shipped_map() -> None:
    assert {name for _, name in CANNOT_SHOW} <= set(MAPS)
