"""The settings, inputs, state and outputs of a simulated controller, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum, unique
from math import ceil
from types import MappingProxyType
from typing import NamedTuple

from register_maps.words import Door, Mode, Motion, Side
from simulator import handshake, network, shaft
from simulator.faults import MachineFault
from simulator.levelling import NOT_SINKING, Levelling
from simulator.machine_faults import NOTHING, ActiveFaults
from simulator.modes import NO_GRANT, Key, RobotGrant
from simulator.quick_replace import quick_replace
from simulator.shaft import NEGLIGIBLE_S

TICK_S = 0.1
"""Longest stretch of mechanical time without a look at car and doors, however fast time is made to run. Chosen: two default
scans, in which a car at 1 m/s goes half as far as the zone of a floor reaches. At normal speed there is one look per scan."""


@unique
class SameFloorCall(StrEnum):
    """What a call does for the floor at which the car already stands level."""

    OPENS = "opens"
    """The doors open (again); the lamp never lights, because the call is served at once."""
    SILENT = "silent"
    """Nothing happens: no lamp, no door."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """The settings of a controller. Seconds are real unless called mechanical."""

    shaft: shaft.Parameters = field(default_factory=shaft.Parameters)
    speed: float = 1.0
    """Mechanical seconds in one real second: car, doors and dwell; never the scan or a communication timer."""
    scan_s: float = 0.05
    """Time between two looks at the inputs. Chosen: a slow PLC or a panel polled over a field bus."""
    dwell_s: float = 3.0
    """Mechanical seconds for which a fully open door waits. Chosen: typical of a passenger lift."""
    hold_watchdog_s: float | None = None
    """Commands that are `watched` count as absent when no sign of life came for so long; None: they last."""
    watched: frozenset[str] = frozenset()
    """Network commands under the watchdog, by name."""
    robot_mode_only: frozenset[str] = frozenset()
    """Network commands that do nothing unless robot mode is on, by name."""
    drops_stuck_button_s: float | None = None
    """A door hold from the network that stays on longer counts as released until it is released and given again; None: it lasts."""
    released_after_s: Mapping[str, float] = field(default_factory=dict)
    """Door holds from the network, by name, and how long after its press each counts as released, whatever is written; it counts
    again once it was absent. The door closes then without waiting."""
    pauses_s: Mapping[str, float] = field(default_factory=dict)
    """Of these, the holds made of pulses, with the longest absence that still belongs to a hold."""
    needs_edge_s: float | None = None
    """A network command counts only if its point was at rest for so long before; None: every change counts."""
    handshake: handshake.Rules | None = None
    """None: there is none, and `call` and `go` are car calls like any other."""
    robot_mode_delay_s: float = 0.2
    """From the moment nothing stands against robot mode to its grant. Chosen: a few scans, so that a grant is never seen
    in the answer to its own request."""
    same_floor_call: SameFloorCall = SameFloorCall.OPENS
    fire_floor: int = 0
    """Floor to which fire recalls the car."""
    ticks_per_scan: int = field(init=False)
    """Into how many equal parts a scan cuts the mechanics."""

    def __post_init__(self) -> None:
        for name, value in {"speed": self.speed, "scan_s": self.scan_s}.items():
            if value <= 0:
                raise ValueError(f"{name} must be above 0, not {value}")
        if self.fire_floor not in self.shaft.floors:
            raise ValueError(f"fire_floor {self.fire_floor} is not one of the floors 0 to {self.shaft.floors[-1]}")
        ticks = max(1, ceil(self.scan_s * self.speed / TICK_S - NEGLIGIBLE_S))
        object.__setattr__(self, "ticks_per_scan", ticks)

    @property
    def doors_at(self) -> tuple[frozenset[Side], ...]:
        """Which doors exist at each floor."""
        return self.shaft.doors_at

    @property
    def times_commands(self) -> bool:
        """Whether it depends on the past of a network command whether it counts, apart from the watchdog."""
        return not (self.drops_stuck_button_s is None and self.needs_edge_s is None and not self.released_after_s)


@dataclass(frozen=True, slots=True)
class Inputs:
    """The levels at the controller's inputs. Floors are indices."""

    car_buttons: frozenset[int] = frozenset()
    landing_buttons: frozenset[int] = frozenset()
    hold_door: frozenset[Side] = frozenset()
    """Open button pressed."""
    close_door: frozenset[Side] = frozenset()
    obstruction: frozenset[Side] = frozenset()
    """Light curtain broken."""
    robot_mode_request: bool = False
    key: Key = Key.NORMAL
    fire: bool = False
    emergency: bool = False
    overload: bool = False
    """Too much load: the door stays open and the car does not start."""
    fault: bool = False
    """The lift has failed, and is out of service."""
    robots_allowed: bool = True
    """The key switch that keeps robots off the lift is not turned."""
    commands: network.Given = field(default_factory=dict)
    """The commands present on the network."""
    signs_of_life: int = 0
    """A number that changes with every sign of life from the network: each change renews the watchdog."""
    faults: frozenset[MachineFault] = frozenset()
    """What goes wrong with the machine while these inputs are present."""


@quick_replace
class State(NamedTuple):
    """The whole state of the controller and its lift; read it through `picture`.

    A tuple, because each scan of a moving car replaces one field of many, which takes a tenth of the time: `_replace`.
    """

    shaft: shaft.State
    mode: Mode = Mode.NORMAL
    robot: RobotGrant = NO_GRANT
    car_calls: frozenset[int] = frozenset()
    landing_calls: frozenset[int] = frozenset()
    called: int | None = None
    """Floor that the network called last."""
    destination: int | None = None
    direction: Motion = Motion.STOPPED
    """Direction in which calls are being served; stopped: idle."""
    dwell_s: Mapping[Side, float] = MappingProxyType({})
    """Doors that are to open or stay open, with the remaining mechanical seconds once fully open."""
    inputs: Inputs = Inputs()
    """The inputs as the last scan saw them."""
    network_memory: network.NetworkMemory = network.NetworkMemory()
    image: Inputs = Inputs()
    """The inputs with the accepted network commands applied."""
    handshake: handshake.State = handshake.State()
    active_faults: ActiveFaults = NOTHING
    """The machine's faults as of the last scan."""
    homes_from: int | None = None
    """Floor that was known last, while the car drives home; None: it knows where it is."""
    levelling: Levelling = NOT_SINKING
    """How level the open car is, where it is to sink."""
    since_scan_s: float = 0.0
    """Real seconds since the last scan."""


class ShownState(NamedTuple):
    """What the lift shows to the outside, as of the last scan. A tuple: a moving car shows another one after each scan."""

    floor: int
    """Floor whose door zone the car was in last: never the destination before the car is there."""
    floor_known: bool
    """Whether the controller knows its floor; it does not before it has come home."""
    last_known_floor: int
    """Floor that the controller knew last: `floor`, unless it drives home."""
    level_floor: int | None
    """Floor at which the car stands level."""
    in_door_zone: bool
    motion: Motion
    doors: Mapping[Side, Door]
    door_open_floor: int | None
    """Floor at which the car stands level with every door of that floor fully open."""
    mode: Mode
    robot_mode_on: bool
    car_calls: frozenset[int]
    landing_calls: frozenset[int]
    accepted: int | None
    """Floor of the last call from the network, while it is still to be served."""
    destination: int | None
    """The stop travelled to, or to be travelled to once the doors have closed; None: nothing to do."""
    obstruction: frozenset[Side]
    overload: bool
    fault: bool
    robots_allowed: bool
    nudging: bool
    occupied: bool
    """A robot is aboard, according to the handshake."""
    may_enter: bool
    """The car stands open for the robot that called it."""
    may_leave: bool
    """The car stands open for the robot aboard."""
    watchdog_tripped: bool
    position_m: float
    speed_m_s: float
