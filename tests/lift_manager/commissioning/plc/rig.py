"""A PLC on a bench: the program in 50 ms cycles, contacts worked by hand, and addresses typed by hand from the maps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from lift_manager.commissioning.plc.program import PlcProgram, render
from register_maps.codec import Codec
from register_maps.load import load
from tests.lift_manager.commissioning.plc.structured_text import Machine
from tests.support.shipped_maps import compiled

CYCLE_S = 0.05
ALL_WELL = (
    "NoFire",
    "NoInspection",
    "NoIndependent",
    "InService",
    "MainsOn",
    "DoorwayClear",
    "LoadOk",
    "RobotsAllowed",
)
"""Contacts that are closed in a healthy lift at rest."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Where one map has its commands, as a person reads them in its file."""

    map_name: str
    floors: Mapping[str, int]
    array: str
    calls: Mapping[str, tuple[int, int | bool]]
    """Cell and value of the call of each floor."""
    hold: int
    close: int
    mode: int
    on: int | bool
    rest: int | bool
    commands: range
    claim: Mapping[int, int | bool] = field(default_factory=dict)
    """What each write carries besides: epoch 1 of machine 1."""
    falls_s: float = 3.0

    @property
    def in_bits(self) -> bool:
        return self.array == "Coils"


REGISTERS = Layout(
    map_name="generic-registers",
    floors={"B1": -1, "L1": 1, "L2": 2},
    array="HoldingRegisters",
    calls={"B1": (16, 0xFFFF), "L1": (16, 1), "L2": (16, 2)},
    hold=17,
    close=19,
    mode=18,
    on=1,
    rest=0,
    commands=range(16, 20),
)
COILS = Layout(
    map_name="generic-coils",
    floors={"B1": 0, "L1": 1, "L2": 2},
    array="Coils",
    calls={"B1": (0, True), "L1": (1, True), "L2": (2, True)},
    hold=8,
    close=9,
    mode=10,
    on=True,
    rest=False,
    commands=range(11),
)
REGISTERS_CLUSTER = Layout(
    map_name="generic-registers-cluster",
    floors={"B1": -1, "L1": 1, "L2": 2},
    array="HoldingRegisters",
    calls={"B1": (19, 0xFFFF), "L1": (19, 1), "L2": (19, 2)},
    hold=20,
    close=22,
    mode=21,
    on=1,
    rest=0,
    commands=range(19, 23),
    claim={16: 1, 17: 0, 18: 1},
    falls_s=8.0,
)
COILS_CLUSTER = Layout(
    map_name="generic-coils-cluster",
    floors={"B1": 0, "L1": 1, "L2": 2},
    array="Coils",
    calls={"B1": (0, True), "L1": (1, True), "L2": (2, True)},
    hold=8,
    close=9,
    mode=10,
    on=True,
    rest=False,
    commands=range(11),
    claim={11: True, 19: True},
    falls_s=8.0,
)
ALONE = (REGISTERS, COILS)
CLUSTER = (REGISTERS_CLUSTER, COILS_CLUSTER)
LAYOUTS = (*ALONE, *CLUSTER)


def program(layout: Layout) -> PlcProgram:
    return render(load(layout.map_name).map, layout.floors)


@dataclass
class Rig:
    """One running program; `manager` is what the manager writes again every second."""

    layout: Layout
    machine: Machine = field(init=False)
    manager: dict[int, int | bool] = field(default_factory=dict)
    now: float = 0.0
    pressed: dict[str, list[float]] = field(default_factory=dict)
    """When each output came on."""
    released: dict[str, list[float]] = field(default_factory=dict)
    grants: bool = True
    """The lift answers the request for robot mode by granting it."""
    _cycles: int = 0

    def __post_init__(self) -> None:
        self.machine = Machine(program(self.layout).st)
        self.contacts(**dict.fromkeys(ALL_WELL, True))

    @property
    def codec(self) -> Codec:
        return compiled(self.layout.map_name)

    def contacts(self, **states: bool) -> None:
        for name, state in states.items():
            assert self.machine.sections[name] == "var_input"
            self.machine.values[name] = state

    def write(self, cell: int, value: int | bool) -> None:
        self.machine.values[self.layout.array].update({**self.layout.claim, cell: value})

    def cells(self) -> list[int | bool]:
        """What stands in the command cells."""
        return [self.machine.values[self.layout.array][cell] for cell in self.layout.commands]

    def call(self, floor: str) -> None:
        self.write(*self.layout.calls[floor])

    def let_go(self, floor: str) -> None:
        self.write(self.layout.calls[floor][0], self.layout.rest)

    def on(self, output: str) -> bool:
        assert self.machine.sections[output] == "var_output"
        return bool(self.machine.values[output])

    def outputs_on(self) -> list[str]:
        return [name for name, section in self.machine.sections.items() if section == "var_output" and self.on(name)]

    def cycle(self) -> None:
        before = set(self.outputs_on())
        if self.grants:
            self.contacts(RobotModeGranted=self.on("RobotMode"))
        self.machine.scan(self.now)
        after = set(self.outputs_on())
        for name in after - before:
            self.pressed.setdefault(name, []).append(self.now)
        for name in before - after:
            self.released.setdefault(name, []).append(self.now)

    def run(self, seconds: float, then: Callable[[], object] = lambda: None) -> None:
        """Run so long; `then` is asked after every cycle."""
        for _ in range(round(seconds / CYCLE_S)):
            if self._cycles % round(1 / CYCLE_S) == 0:
                for cell, value in self.manager.items():
                    self.write(cell, value)
            self._cycles += 1
            self.now = round(self.now + CYCLE_S, 6)
            self.cycle()
            then()

    def robot_mode(self) -> None:
        """Bring the lift into robot mode, and keep it there as the manager does."""
        self.manager[self.layout.mode] = self.layout.on
        self.run(1.0)
        assert self.on("RobotMode")

    def says(self, name: str) -> object:
        """What the manager reads of a signal."""
        signal = self.codec.signals[name]
        tables = {"coil": "Coils", "discrete": "DiscreteInputs", "holding": "HoldingRegisters"}
        image = {
            table: [int(value) for value in self.machine.values[array].values()]
            for table, array in tables.items()
            if array in self.machine.values
        }
        return signal.decode(signal.extract(image))
