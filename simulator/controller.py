"""A lift controller: it scans its inputs, registers calls, times doors, and moves the car. Pure.

Like the real thing it works in scans. At each scan instant the car and doors have moved on, the inputs are sampled
once, and the outputs follow; between two scans nothing changes. So what `picture` shows is that of the last scan,
a pulse that falls between two scans is missed, and how time is cut into steps makes no difference at all.

Faults come in from outside: a stuck button, or one that is dropped, is a change of `Inputs`; a wrong floor or a stuck
door is a change of what `_orders` returns.
"""

from __future__ import annotations

from dataclasses import replace

from register_maps.schema import CALLS
from register_maps.words import Door, Mode, Motion, Side
from simulator import dispatch, handshake, modes, network, shaft
from simulator.modes import SERVICE, Key, RobotGrant
from simulator.shaft import NEGLIGIBLE_S
from simulator.state import Inputs, Parameters, Picture, SameFloorCall, State

__all__ = ["Inputs", "Parameters", "Picture", "SameFloorCall", "State", "initial", "picture", "step"]


def initial(parameters: Parameters, *, floor_index: int = 0, key: Key = Key.NORMAL) -> State:
    """The car standing level at a floor with its doors closed, in the mode that the key says."""
    if floor_index not in parameters.shaft.floors:
        raise ValueError(f"floor {floor_index} is not one of the floors 0 to {parameters.shaft.floors[-1]}")
    mode = modes.overriding_mode(key, fire=False, emergency=False, fault=False)
    robot = RobotGrant(granted=key is Key.ROBOT)
    return State(
        shaft=shaft.at_floor(floor_index, parameters.shaft),
        mode=mode or (Mode.ROBOT if robot.granted else Mode.NORMAL),
        robot=robot,
        inputs=Inputs(key=key),
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


def picture(state: State, parameters: Parameters) -> Picture:
    level = shaft.level_floor(state.shaft, parameters.shaft)
    doors = {side: leaf.word for side, leaf in state.shaft.doors.items()}
    all_open = level is not None and all(doors[side] is Door.OPEN for side in parameters.doors_at[level])
    awaited = all_open and level == state.handshake.awaits_at
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
        accepted=state.called if state.called in state.car_calls else None,
        destination=state.destination,
        obstruction=state.image.obstruction,
        overload=state.image.overload,
        fault=state.image.fault,
        nudging=False,
        occupied=state.handshake.occupied,
        may_enter=awaited and not state.handshake.occupied,
        may_leave=awaited and state.handshake.occupied,
        watchdog_tripped=state.heard.tripped,
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
    robot_mode = state.mode is Mode.ROBOT
    heard = network.listen(state.heard, inputs.asked, inputs.signs_of_life, parameters, robot_mode=robot_mode)
    if inputs != state.inputs or heard != state.heard:
        image = _image(inputs, heard.given, parameters)
        called = next((heard.given[name] for name in CALLS if name in heard.given), state.called)
        state = replace(state, inputs=inputs, heard=heard, image=image, called=called)
    state = _change_mode(state, parameters)
    state, sent = _shake_hands(state, parameters)
    return _register(state, previous, sent, parameters)


def _image(inputs: Inputs, given: network.Given, parameters: Parameters) -> Inputs:
    """Put what the network presses beside what people do."""
    buttons = {given[name] for name in CALLS if name in given}
    if parameters.handshake is not None:
        buttons = {given[name] for name in CALLS if name in given and name not in handshake.NAMES}
    return replace(
        inputs,
        car_buttons=inputs.car_buttons | buttons,
        hold_door=inputs.hold_door | _sides(given, "hold_door"),
        close_door=inputs.close_door | _sides(given, "close_door"),
        robot_mode_request=inputs.robot_mode_request or "robot_mode" in given,
    )


def _sides(given: network.Given, command: str) -> frozenset[Side]:
    return frozenset(side for side in Side if f"{command}.{side}" in given)


def _change_mode(state: State, parameters: Parameters) -> State:
    image, standing = state.image, state.shaft.standing
    overriding = modes.overriding_mode(image.key, fire=image.fire, emergency=image.emergency, fault=image.fault)
    if overriding is not None:
        return replace(state, mode=overriding, robot=RobotGrant())
    if image.key is Key.ROBOT or image.robot_mode_request:
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


def _shake_hands(state: State, parameters: Parameters) -> tuple[State, frozenset[int]]:
    """Take what is said about the robot; returns the floors to which the car is sent by it."""
    if parameters.handshake is None:
        return state, frozenset()
    floors = len(parameters.shaft.floors)
    shaken, sent = handshake.step(state.handshake, state.heard.given, state.shaft.floor, floors, parameters.handshake)
    if not SERVICE[state.mode].car_calls:
        shaken = replace(shaken, enter_at=None, leave_at=None)
    return (state if shaken == state.handshake else replace(state, handshake=shaken)), sent


def _register(state: State, previous: Inputs, sent: frozenset[int], parameters: Parameters) -> State:
    """Calls are registered when a button goes down, and dropped where the mode does not serve them."""
    service = SERVICE[state.mode]
    level = shaft.level_floor(state.shaft, parameters.shaft)
    silent = level if parameters.same_floor_call is SameFloorCall.SILENT else None
    pressed = _new_calls(state.image.car_buttons, previous.car_buttons, silent, parameters) | (sent - {silent})
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
        for side in state.shaft.doors:
            if side in parameters.doors_at[level]:
                left_s = _dwell(state, side, level, dt, parameters)
                if left_s is not None:
                    dwell_s[side] = left_s
    return state if dwell_s == state.dwell_s else replace(state, dwell_s=dwell_s)


def _dwell(state: State, side: Side, level: int, dt: float, parameters: Parameters) -> float | None:
    """Mechanical seconds for which one door of this floor stays open still; None: it is to close or stay closed."""
    image, mode, leaf = state.image, state.mode, state.shaft.doors[side]
    buttons = SERVICE[mode].door_buttons
    held = buttons and side in image.hold_door
    awaited = level == state.handshake.awaits_at
    blocked = side in image.obstruction and leaf.fraction > 0
    recalled = mode is Mode.EMERGENCY or (mode is Mode.FIRE and state.destination is None)
    overloaded = image.overload and mode is not Mode.INSPECTION
    if held or blocked or recalled or awaited or overloaded:
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
