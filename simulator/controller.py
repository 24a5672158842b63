"""A lift controller: it scans its inputs, registers calls, times doors, and moves the car. Pure.

Like the real thing it works in scans. At each scan instant the car and doors have moved on, the inputs are sampled
once, and the outputs follow; between two scans nothing changes. So what `picture` shows is that of the last scan,
a pulse that falls between two scans is missed, and how time is cut into steps makes no difference at all.

Faults come in from outside: a stuck button, or one that is dropped, is a change of `Inputs`; a wrong floor or a stuck
door is a change of what `_orders` returns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum, unique
from math import ceil

from register_maps.words import Door, Mode, Motion, Side
from simulator import dispatch, modes, shaft
from simulator.modes import SERVICE, Key, RobotGrant
from simulator.shaft import NEGLIGIBLE_S

TICK_S = 0.05
"""Longest stretch of mechanical time without a look at car and doors, however fast time is made to run. Chosen: the
default scan, so that at normal speed there is one look per scan."""


@unique
class SameFloorCall(StrEnum):
    """What a call does for the floor at which the car already stands level."""

    OPENS = "opens"
    """The doors open (again); the lamp never lights, because the call is served at once."""
    SILENT = "silent"
    """Nothing happens: no lamp, no door."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """How this controller is set. Seconds are real unless called mechanical."""

    shaft: shaft.Parameters = field(default_factory=shaft.Parameters)
    speed: float = 1.0
    """Mechanical seconds in one real second: car, doors and dwell; never the scan or a communication timer."""
    scan_s: float = 0.05
    """Time between two looks at the inputs. Chosen: a slow PLC or a panel polled over a field bus."""
    dwell_s: float = 3.0
    """Mechanical seconds for which a fully open door waits. Chosen: typical of a passenger lift."""
    hold_watchdog_s: float | None = None
    """Door holds and the robot mode request count as absent when no write came for so long; None: they last."""
    robot_mode_delay_s: float = 0.2
    """From the moment nothing stands against robot mode to its grant. Chosen: a few scans, so that a grant is never seen
    in the answer to its own request."""
    same_floor_call: SameFloorCall = SameFloorCall.OPENS
    fire_floor: int = 0
    """Floor to which fire recalls the car."""

    def __post_init__(self) -> None:
        for name, value in {"speed": self.speed, "scan_s": self.scan_s}.items():
            if value <= 0:
                raise ValueError(f"{name} must be above 0, not {value}")
        if self.fire_floor not in self.shaft.floors:
            raise ValueError(f"fire_floor {self.fire_floor} is not one of the floors 0 to {self.shaft.floors[-1]}")

    @property
    def doors_at(self) -> tuple[frozenset[Side], ...]:
        """Which doors exist at each floor."""
        return self.shaft.doors_at

    @property
    def ticks_per_scan(self) -> int:
        return max(1, ceil(self.scan_s * self.speed / TICK_S - NEGLIGIBLE_S))


@dataclass(frozen=True, slots=True)
class Inputs:
    """What is present at the controller's inputs: levels, not events. Floors are indices."""

    car_buttons: frozenset[int] = frozenset()
    landing_buttons: frozenset[int] = frozenset()
    hold_door: frozenset[Side] = frozenset()
    """Open button pressed, or a door hold requested."""
    close_door: frozenset[Side] = frozenset()
    obstruction: frozenset[Side] = frozenset()
    """Light curtain broken."""
    robot_mode_request: bool = False
    key: Key = Key.NORMAL
    fire: bool = False
    emergency: bool = False
    writes: int = 0
    """A number that changes with every write from the network: each change renews the hold watchdog."""


@dataclass(frozen=True, slots=True)
class State:
    """All that the controller and its lift remember; read it through `picture`."""

    shaft: shaft.State
    mode: Mode = Mode.NORMAL
    robot: RobotGrant = field(default_factory=RobotGrant)
    car_calls: frozenset[int] = frozenset()
    landing_calls: frozenset[int] = frozenset()
    destination: int | None = None
    direction: Motion = Motion.STOPPED
    """Direction in which calls are being served; stopped: idle."""
    dwell_s: Mapping[Side, float] = field(default_factory=dict)
    """Doors that are told to open or stay open, and the mechanical seconds for which they still do once fully open."""
    image: Inputs = Inputs()
    """The inputs as the last scan saw them."""
    silent_s: float = 0.0
    """Real seconds since the last write from the network, as far as the watchdog needs to know."""
    since_scan_s: float = 0.0
    """Real seconds since the last scan."""


@dataclass(frozen=True, slots=True)
class Picture:
    """What the lift shows to the outside, as of the last scan."""

    floor: int
    """Floor whose door zone the car was in last: never the destination before the car is there."""
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
    destination: int | None
    """The stop travelled to, or to be travelled to once the doors have closed; None: nothing to do."""
    obstruction: frozenset[Side]
    nudging: bool
    position_m: float
    speed_m_s: float


def initial(parameters: Parameters, *, floor_index: int = 0, key: Key = Key.NORMAL) -> State:
    """The car standing level at a floor with its doors closed, in the mode that the key says."""
    if floor_index not in parameters.shaft.floors:
        raise ValueError(f"floor {floor_index} is not one of the floors 0 to {parameters.shaft.floors[-1]}")
    mode = modes.overriding_mode(key, fire=False, emergency=False)
    robot = RobotGrant(granted=key is Key.ROBOT)
    return State(
        shaft=shaft.at_floor(floor_index, parameters.shaft),
        mode=mode or (Mode.ROBOT if robot.granted else Mode.NORMAL),
        robot=robot,
        image=Inputs(key=key),
    )


def step(state: State, inputs: Inputs, dt: float, parameters: Parameters) -> State:
    """What `dt` real seconds make of the lift while the inputs stay as they are.

    A scan that falls on the end of the step belongs to it: it sees these inputs, not those of the next step.
    """
    if dt < 0:
        raise ValueError(f"time does not run backwards: dt is {dt}")
    since_scan_s = state.since_scan_s + dt
    while since_scan_s >= parameters.scan_s - NEGLIGIBLE_S:
        since_scan_s -= parameters.scan_s
        after = _scan(state, inputs, parameters)
        if after == state:  # and so it will be after each further scan: an idle night costs nothing
            since_scan_s -= int((since_scan_s + NEGLIGIBLE_S) / parameters.scan_s) * parameters.scan_s
        state = after
    return replace(state, since_scan_s=since_scan_s)


def until_scan_s(state: State, parameters: Parameters) -> float:
    """Return the seconds to the next look at the inputs."""
    return parameters.scan_s - state.since_scan_s


def picture(state: State, parameters: Parameters) -> Picture:
    level = shaft.level_floor(state.shaft, parameters.shaft)
    doors = {side: leaf.word for side, leaf in state.shaft.doors.items()}
    all_open = level is not None and all(doors[side] is Door.OPEN for side in parameters.doors_at[level])
    return Picture(
        floor=state.shaft.floor,
        level_floor=level,
        in_door_zone=shaft.zone_floor(state.shaft, parameters.shaft) is not None,
        motion=state.shaft.motion,
        doors=doors,
        door_open_floor=level if all_open else None,
        mode=state.mode,
        robot_mode_on=state.mode is Mode.ROBOT,
        car_calls=state.car_calls,
        landing_calls=state.landing_calls,
        destination=state.destination,
        obstruction=state.image.obstruction,
        nudging=False,
        position_m=state.shaft.position_m,
        speed_m_s=state.shaft.speed_m_s,
    )


# -- one scan


def _scan(state: State, inputs: Inputs, parameters: Parameters) -> State:
    ticks = parameters.ticks_per_scan
    dt = parameters.scan_s * parameters.speed / ticks
    for tick in range(1, ticks + 1):
        moved = shaft.step(state.shaft, _orders(state, parameters), dt, parameters.shaft)
        state = state if moved is state.shaft else replace(state, shaft=moved)
        if tick == ticks:
            state = _sample(state, inputs, parameters)
        state = _serve(state, parameters)
        state = _dispatch(state, parameters)
        state = _time_doors(state, dt, parameters)
    return state


def _orders(state: State, parameters: Parameters) -> shaft.Orders:
    target_m = None if state.destination is None else parameters.shaft.heights_m[state.destination]
    return shaft.Orders(target_m=target_m, open_doors=frozenset(state.dwell_s))


# -- inputs


def _sample(state: State, inputs: Inputs, parameters: Parameters) -> State:
    previous = state.image
    silent_s = 0.0
    if parameters.hold_watchdog_s is not None and inputs.writes == previous.writes:
        silent_s = min(state.silent_s + parameters.scan_s, parameters.hold_watchdog_s)
    if inputs != previous or silent_s != state.silent_s:
        state = replace(state, image=inputs, silent_s=silent_s)
    state = _change_mode(state, parameters)
    return _register(state, previous, parameters)


def _network_alive(state: State, parameters: Parameters) -> bool:
    return parameters.hold_watchdog_s is None or state.silent_s < parameters.hold_watchdog_s - NEGLIGIBLE_S


def _change_mode(state: State, parameters: Parameters) -> State:
    image, standing = state.image, state.shaft.standing
    overriding = modes.overriding_mode(image.key, fire=image.fire, emergency=image.emergency)
    if overriding is not None:
        return replace(state, mode=overriding, robot=RobotGrant())
    if image.key is Key.ROBOT or (image.robot_mode_request and _network_alive(state, parameters)):
        robot = modes.next_grant(
            state.robot,
            standing=standing,
            car_calls=state.car_calls,
            landing_calls=state.landing_calls,
            since_s=parameters.scan_s,
            delay_s=parameters.robot_mode_delay_s,
        )
    else:
        robot = modes.after_request(state.robot, standing=standing)
    mode = Mode.ROBOT if robot.granted else Mode.NORMAL
    return state if (mode, robot) == (state.mode, state.robot) else replace(state, mode=mode, robot=robot)


def _register(state: State, previous: Inputs, parameters: Parameters) -> State:
    """Calls are registered when a button goes down, and dropped where the mode does not serve them."""
    service = SERVICE[state.mode]
    level = shaft.level_floor(state.shaft, parameters.shaft)
    silent = level if parameters.same_floor_call is SameFloorCall.SILENT else None
    pressed = _new_calls(state.image.car_buttons, previous.car_buttons, silent, parameters)
    called = _new_calls(state.image.landing_buttons, previous.landing_buttons, silent, parameters)
    car_calls = state.car_calls | pressed if service.car_calls else frozenset()
    landing_calls = state.landing_calls | called if service.landing_calls else frozenset()
    if car_calls != state.car_calls or landing_calls != state.landing_calls:
        state = replace(state, car_calls=car_calls, landing_calls=landing_calls)
    if state.mode is Mode.INDEPENDENT and pressed - {level}:
        state = replace(state, dwell_s=dict.fromkeys(state.dwell_s, 0.0))  # the car call is the word to go
    return state


def _new_calls(
    buttons: frozenset[int], before: frozenset[int], silent: int | None, parameters: Parameters
) -> frozenset[int]:
    return frozenset(call for call in buttons - before if call in parameters.shaft.floors and call != silent)


# -- car


def _serve(state: State, parameters: Parameters) -> State:
    """A call for the floor at which the car stands level is answered by opening the doors."""
    level = shaft.level_floor(state.shaft, parameters.shaft)
    if level is None or level not in state.car_calls | state.landing_calls:
        return state
    return replace(
        state,
        car_calls=state.car_calls - {level},
        landing_calls=state.landing_calls - {level},
        dwell_s={side: parameters.dwell_s for side in Side if side in parameters.doors_at[level]},
    )


def _dispatch(state: State, parameters: Parameters) -> State:
    if state.mode is Mode.INSPECTION:
        return replace(state, destination=None, direction=Motion.STOPPED)  # stops where it is
    calls = state.car_calls | state.landing_calls
    if state.mode is Mode.FIRE:
        calls = frozenset({parameters.fire_floor})
    destination, direction = dispatch.next_stop(state.shaft, calls, state.direction, parameters.shaft)
    if destination == state.destination and direction is state.direction:
        return state
    return replace(state, destination=destination, direction=direction)


# -- doors


def _time_doors(state: State, dt: float, parameters: Parameters) -> State:
    """Which doors are to be open, and for how long still."""
    level = shaft.level_floor(state.shaft, parameters.shaft)
    dwell_s: dict[Side, float] = {}
    if level is not None:
        for side, leaf in state.shaft.doors.items():
            if side in parameters.doors_at[level]:
                left_s = _dwell(state, side, leaf, dt, parameters)
                if left_s is not None:
                    dwell_s[side] = left_s
    return state if dwell_s == state.dwell_s else replace(state, dwell_s=dwell_s)


def _dwell(state: State, side: Side, leaf: shaft.Leaf, dt: float, parameters: Parameters) -> float | None:
    """Mechanical seconds for which one door of this floor stays open still; None: it is to close or stay closed."""
    image, mode = state.image, state.mode
    buttons = SERVICE[mode].door_buttons
    held = buttons and side in image.hold_door and _network_alive(state, parameters)
    blocked = side in image.obstruction and leaf.fraction > 0
    recalled = mode is Mode.EMERGENCY or (mode is Mode.FIRE and state.destination is None)
    if held or blocked or recalled:
        return parameters.dwell_s
    left_s = state.dwell_s.get(side)
    if left_s is None or mode is Mode.FIRE:
        return None  # on the way to the fire floor doors close at once
    if leaf.fraction < 1 or mode is Mode.INSPECTION:
        return left_s
    if buttons and side in image.close_door:
        return None
    if mode is Mode.INDEPENDENT and state.destination is None:
        return left_s
    left_s -= dt
    return left_s if left_s > NEGLIGIBLE_S else None
