"""A lift controller: it scans its inputs, registers calls, times doors, and moves the car. Pure.

Like the real thing it works in scans. At each scan instant the car and doors have moved on, the inputs are sampled
once, and the outputs follow; between two scans nothing changes. So what `picture` shows is that of the last scan,
a pulse that falls between two scans is missed, and how time is cut into steps makes no difference at all.

Faults of the machine are inputs too. A stuck button, or one that is dropped, is a change of the other inputs.
"""

from __future__ import annotations

from dataclasses import replace

from register_maps.schema import CALLS
from register_maps.words import Door, Mode, Motion, Side
from simulator import dispatch, handshake, levelling, machine_faults, modes, network, shaft
from simulator.doors import JAMMED_AT
from simulator.levelling import NOT_SINKING
from simulator.machine_faults import NOTHING
from simulator.modes import NO_GRANT, SERVICE, Key, RobotGrant
from simulator.shaft import NEGLIGIBLE_S
from simulator.state import Inputs, Parameters, SameFloorCall, ShownState, State

__all__ = [
    "Inputs",
    "Parameters",
    "SameFloorCall",
    "ShownState",
    "State",
    "initial",
    "picture",
    "step",
]


def initial(parameters: Parameters, *, floor_index: int = 0, key: Key = Key.NORMAL) -> State:
    """The car standing level at a floor with its doors closed, in the mode of the key."""
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
    since_scan_s, ticks = state.since_scan_s + dt, parameters.ticks_per_scan
    while since_scan_s >= parameters.scan_s - NEGLIGIBLE_S:
        since_scan_s -= parameters.scan_s
        after = _scan(state, inputs, ticks, parameters)
        if after is state or after == state:  # and so it will be after each further scan: an idle night costs nothing
            since_scan_s -= int((since_scan_s + NEGLIGIBLE_S) / parameters.scan_s) * parameters.scan_s
        state = after
    return state._replace(since_scan_s=since_scan_s)


def picture(state: State, parameters: Parameters) -> ShownState:
    level = shaft.level_floor(state.shaft, parameters.shaft)
    doors = {side: leaf.word for side, leaf in state.shaft.doors.items()}
    all_open = level is not None and all(doors[side] is Door.OPEN for side in parameters.doors_at[level])
    awaited = all_open and level == _awaits_at(state, parameters)
    return ShownState(
        floor=state.shaft.floor,
        floor_known=state.homes_from is None,
        last_known_floor=state.shaft.floor if state.homes_from is None else state.homes_from,
        level_floor=level,
        in_door_zone=level is not None or shaft.zone_floor(state.shaft, parameters.shaft) is not None,
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
        robots_allowed=state.image.robots_allowed,
        nudging=state.active_faults.trouble.nudging,
        occupied=state.handshake.occupied,
        may_enter=awaited and not state.handshake.occupied,
        may_leave=awaited and state.handshake.occupied,
        watchdog_tripped=state.network_memory.tripped,
        position_m=state.shaft.position_m,
        speed_m_s=state.shaft.speed_m_s,
    )


# -- one scan


def _scan(state: State, inputs: Inputs, ticks: int, parameters: Parameters) -> State:
    dt = parameters.scan_s * parameters.speed / ticks
    tick, rests = 0, False
    while tick < ticks:
        # a tick that changed nothing: what the next ones would do is the same, until the inputs are looked at
        tick = ticks if rests else tick + 1
        before = state
        moved = shaft.step(state.shaft, _orders(state, parameters), dt, parameters.shaft)
        memory = _listen(state, inputs, parameters) if tick == ticks else before.network_memory
        if moved is not state.shaft or memory is not state.network_memory:
            # in one copy: where a car moves and a watchdog runs, both change in every scan
            state = state._replace(shaft=moved, network_memory=memory)
        landing = levelling.landing(moved, parameters.shaft)
        if tick == ticks:
            state = _sample(state, inputs, before.network_memory.given, landing, parameters)
            if rests and state is before:
                break
        state = _serve(state, landing, parameters)
        state = _dispatch(state, landing, parameters)
        state = _time_doors(state, landing, dt, parameters)
        if state.levelling is not NOT_SINKING or state.active_faults.relevelling is not None:
            state = state._replace(
                levelling=levelling.step(
                    state.levelling, state.active_faults.relevelling, state.shaft, dt, parameters.shaft
                )
            )
        rests = state is before
    return state


def _orders(state: State, parameters: Parameters) -> shaft.Orders:
    target_m = None if state.destination is None else parameters.shaft.heights_m[state.destination]
    open_doors = frozenset(state.dwell_s)
    if state.active_faults is NOTHING and state.levelling is NOT_SINKING:
        return shaft.Orders(target_m, open_doors)
    return shaft.Orders(
        target_m,
        open_doors,
        levels=state.levelling.drives and state.mode is not Mode.INSPECTION,
        sinks_m=levelling.sinks_m(state.levelling, state.active_faults.relevelling),
        trouble=state.active_faults.trouble,
    )


# -- inputs


def _listen(state: State, inputs: Inputs, parameters: Parameters) -> network.NetworkMemory:
    """Return what the controller knows of its network after this scan; the same object if nothing has changed."""
    before, in_robot_mode = state.network_memory, state.mode is Mode.ROBOT
    memory = network.listen(before, inputs.commands, inputs.signs_of_life, parameters, robot_mode=in_robot_mode)
    return before if memory == before else memory


def _sample(
    state: State, inputs: Inputs, given_before: network.Given, landing: int | None, parameters: Parameters
) -> State:
    """Look at the inputs; what is heard of the network is in the state, `given_before` are the commands of the last scan."""
    previous, memory = state.image, state.network_memory
    forgets = False
    changed = inputs is not state.inputs and inputs != state.inputs
    if changed and inputs.faults != state.inputs.faults:
        state, forgets = _suffer(state, inputs)
    if changed or (memory.given is not given_before and memory.given != given_before):
        image = _image(inputs, memory.given, parameters)
        if state.active_faults is not NOTHING:
            image = machine_faults.apply_to_inputs(image, state.active_faults)
        called = next((memory.given[name] for name in CALLS if name in memory.given), state.called)
        state = state._replace(inputs=inputs, image=image, called=called)
    state = _change_mode(state, parameters)
    forgets = forgets or state.homes_from is not None
    sent: frozenset[int] = frozenset()
    if parameters.handshake is not None:
        state, sent = _shake_hands(state, parameters.handshake, len(parameters.shaft.floors), forgets=forgets)
    if forgets:
        return state._replace(car_calls=frozenset(), landing_calls=frozenset())
    return _register(state, previous, sent, landing, parameters)


def _suffer(state: State, inputs: Inputs) -> tuple[State, bool]:
    """Apply a change of faults; returns also whether it drops all calls."""
    before, active = state.active_faults, machine_faults.combine_faults(inputs.faults)
    homes_from = state.homes_from
    if active.homes and not before.homes:
        homes_from = state.shaft.floor
    elif before.homes and not active.homes:
        homes_from = None
    forgets = active.cancels_calls and not before.cancels_calls
    return state._replace(active_faults=active, homes_from=homes_from), forgets


def _image(inputs: Inputs, given: network.Given, parameters: Parameters) -> Inputs:
    """Combine the presses of the network with those of people."""
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
    image, standing = state.image, state.shaft.speed_m_s == 0.0
    overriding = modes.overriding_mode(image.key, fire=image.fire, emergency=image.emergency, fault=image.fault)
    if overriding is not None:
        return state._replace(mode=overriding, robot=NO_GRANT)
    if state.active_faults.withdraws_robot_mode:
        robot = NO_GRANT
    elif image.key is Key.ROBOT or image.robot_mode_request:
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
    if mode is state.mode and (robot is state.robot or robot == state.robot):
        return state
    return state._replace(mode=mode, robot=robot)


def _shake_hands(state: State, rules: handshake.Rules, floors: int, *, forgets: bool) -> tuple[State, frozenset[int]]:
    """Step the handshake; returns the floors to which it sends the car."""
    shaken, sent = handshake.step(state.handshake, state.network_memory.given, state.shaft.floor, floors, rules)
    if forgets or not SERVICE[state.mode].car_calls:
        shaken = replace(shaken, enter_at=None, leave_at=None)
    return (state if shaken == state.handshake else state._replace(handshake=shaken)), sent


def _register(
    state: State, previous: Inputs, sent: frozenset[int], landing: int | None, parameters: Parameters
) -> State:
    """Calls are registered when a button goes down, and dropped where the mode does not serve them."""
    service, image = SERVICE[state.mode], state.image
    drops = (state.car_calls and not service.car_calls) or (state.landing_calls and not service.landing_calls)
    if image is previous and not sent and not drops:
        return state  # no button has gone down
    silent = landing if parameters.same_floor_call is SameFloorCall.SILENT else None
    pressed = _new_calls(image.car_buttons, previous.car_buttons, silent, parameters) | (sent - {silent})
    called = _new_calls(image.landing_buttons, previous.landing_buttons, silent, parameters)
    car_calls = state.car_calls | pressed if service.car_calls else frozenset()
    landing_calls = state.landing_calls | called if service.landing_calls else frozenset()
    if car_calls != state.car_calls or landing_calls != state.landing_calls:
        state = state._replace(car_calls=car_calls, landing_calls=landing_calls)
    if pressed and state.mode is Mode.INDEPENDENT and pressed - {landing}:
        state = state._replace(dwell_s=dict.fromkeys(state.dwell_s, 0.0))  # the car call is the word to go
    return state


def _new_calls(
    buttons: frozenset[int], before: frozenset[int], silent: int | None, parameters: Parameters
) -> frozenset[int]:
    down = buttons - before
    return frozenset(call for call in down if call in parameters.shaft.floors and call != silent) if down else down


# -- car


def _serve(state: State, landing: int | None, parameters: Parameters) -> State:
    """A call for the floor at which the car stands is answered by opening the doors."""
    if landing is None or not (state.car_calls or state.landing_calls):
        return state
    served = frozenset(
        call for call in state.car_calls | state.landing_calls if _sent_to(call, state, parameters) == landing
    )
    if not served or (state.active_faults.trouble.nudging and not state.shaft.doors_closed):
        return state
    return state._replace(
        car_calls=state.car_calls - served,
        landing_calls=state.landing_calls - served,
        dwell_s={side: parameters.dwell_s for side in Side if side in parameters.doors_at[landing]},
    )


def _sent_to(call: int, state: State, parameters: Parameters) -> int:
    off = state.active_faults.floors_off
    return machine_faults.sent_to(call, off, len(parameters.shaft.heights_m)) if off else call


def _awaits_at(state: State, parameters: Parameters) -> int | None:
    """Floor at which the car stands open until a robot gets in, or out, by the handshake."""
    floor = state.handshake.awaits_at
    return None if floor is None else _sent_to(floor, state, parameters)


def _dispatch(state: State, landing: int | None, parameters: Parameters) -> State:
    if state.mode is Mode.INSPECTION:
        if state.destination is None and state.direction is Motion.STOPPED:
            return state
        return state._replace(destination=None, direction=Motion.STOPPED)  # stops where it is
    if state.levelling is not NOT_SINKING and shaft.level_floor(state.shaft, parameters.shaft) != landing:
        return state  # open, and a little out of level: it has not left
    homes_from = state.homes_from
    if homes_from is not None:
        calls = frozenset({0})
        if landing == 0 and state.shaft.doors_closed:
            homes_from = None
    elif state.mode is Mode.FIRE:
        calls = frozenset({parameters.fire_floor})
    else:
        calls = state.car_calls | state.landing_calls
        if state.active_faults.floors_off:
            calls = frozenset(_sent_to(call, state, parameters) for call in calls)
    destination, direction = dispatch.next_stop(state.shaft, calls, state.direction, parameters.shaft)
    if (destination, direction, homes_from) == (state.destination, state.direction, state.homes_from):
        return state
    return state._replace(destination=destination, direction=direction, homes_from=homes_from)


# -- doors


def _time_doors(state: State, landing: int | None, dt: float, parameters: Parameters) -> State:
    """Which doors are to be open, and for how long still."""
    if landing is None:
        return state._replace(dwell_s={}) if state.dwell_s else state
    dwell_s: dict[Side, float] = {}
    for side in state.shaft.doors:
        if side in parameters.doors_at[landing]:
            remaining_s = _dwell(state, side, landing, dt, parameters)
            if remaining_s is not None:
                dwell_s[side] = remaining_s
    return state if dwell_s == state.dwell_s else state._replace(dwell_s=dwell_s)


def _dwell(state: State, side: Side, landing: int, dt: float, parameters: Parameters) -> float | None:
    """Mechanical seconds for which one door of this floor stays open still; None: it is to close or stay closed."""
    image, mode, leaf = state.image, state.mode, state.shaft.doors[side]
    if _is_kept_open(state, side, landing, parameters):
        return parameters.dwell_s
    remaining_s = state.dwell_s.get(side)
    if remaining_s is None or state.homes_from is not None or mode is Mode.FIRE:
        return None  # on the way home or to the fire floor doors close at once
    if leaf.fraction < 1 or mode is Mode.INSPECTION:
        return remaining_s
    if f"hold_door.{side}" in state.network_memory.expired:
        return None
    if side in image.close_door and SERVICE[mode].door_buttons:
        return None
    if mode is Mode.INDEPENDENT and state.destination is None:
        return remaining_s
    remaining_s -= dt
    return remaining_s if remaining_s > NEGLIGIBLE_S else None


def _is_kept_open(state: State, side: Side, landing: int, parameters: Parameters) -> bool:
    """Whether a door is to open, or to stay open, regardless of its timer."""
    image, mode, fraction = state.image, state.mode, state.shaft.doors[side].fraction
    trouble, knows_floor = state.active_faults.trouble, state.homes_from is None
    if image.overload and mode is not Mode.INSPECTION:
        return True
    if knows_floor and (mode is Mode.EMERGENCY or (mode is Mode.FIRE and state.destination is None)):
        return True
    if trouble.nudging:
        return False
    if fraction > 0 and (side in image.obstruction or (fraction <= JAMMED_AT and side in trouble.jammed)):
        return True
    held = side in image.hold_door and SERVICE[mode].door_buttons
    return knows_floor and (held or landing == _awaits_at(state, parameters))
