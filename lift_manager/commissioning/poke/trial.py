"""Plans the trial of one command: what a session is asked for, in order, and which presses and releases follow from it. Pure.

A trial presses nothing by itself. Each command of the map belongs to a request of a session, and the rules of sessions decide:

- `robot_mode` is on while a session holds the lift, so every trial presses it first, and its own trial is a session alone.
- `go_to`, `call` and `hold_door` are a session's `go_to` and `hold_door`; `close_door` is tried on a door that is open.
- `robot_in_place`, `go` and `robot_left` belong to a robot in the car. A trial of any of them is a ride of the empty car to the next
  floor: `robot_in_place`, then `go`, then `robot_left`, so that the lift does not count a robot aboard afterwards.
- A heartbeat is written all the time, and is nothing to press.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from lift_manager.api.lifts import Lift, LiftCapabilities, LiftCommand, LiftCommands
from lift_manager.lift.call import ACKNOWLEDGEMENTS, calls_in_order
from lift_manager.lift.commands import CommandType
from lift_manager.lift.state import Quality
from register_maps.error_texts import closest
from register_maps.words import Door, Side

ROBOT_MODE = "robot_mode"


class NotPossible(Exception):
    """A command that cannot be tried here; the text says why, and what to do."""


@dataclass(frozen=True, slots=True)
class KnownLift:
    """What a manager says about a lift."""

    commands: LiftCommands
    capabilities: LiftCapabilities
    lift: Lift

    @property
    def is_standing(self) -> bool:
        """Whether the car is known to stand at a floor."""
        return self.lift.standing and self.lift.floor is not None

    @property
    def stands_open_only(self) -> bool:
        """Whether only an open door shows that the car stands: one with its door shut has to be called first."""
        return self.capabilities.evidence.startswith("door_")

    @property
    def is_shut(self) -> bool:
        """Whether every door of the car reads closed."""
        return all(door is Door.CLOSED for door in self.lift.doors.values())

    def command(self, name: str) -> LiftCommand | None:
        """Return a command of the map by its name."""
        return next((command for command in self.commands.commands if command.name == name), None)

    def call_to(self, floor: str, *, aboard: bool) -> LiftCommand | None:
        """Return the command with which a session brings the car to a floor."""
        calls = calls_in_order(floor, self.doors_at(floor), aboard=aboard)
        found = (self.command(call.name) for call in calls)
        return next((command for command in found if command is not None), None)

    def doors_at(self, floor: str) -> tuple[Side, ...]:
        """Return the doors that open at a floor."""
        return self.capabilities.doors_at.get(floor, ())

    def door_holds(self, floor: str) -> tuple[str, ...]:
        """Return the holds that a session presses at a floor: those of all its doors."""
        holds = (f"hold_door.{side}" for side in self.doors_at(floor))
        return tuple(hold for hold in holds if self.command(hold) is not None)


@dataclass(frozen=True, slots=True)
class SessionRequest:
    """What a session is asked for."""

    kind: CommandType
    floor: str | None = None
    hold_door: bool = False
    door: Side | None = None


@dataclass(frozen=True, slots=True)
class Trial:
    """The trial of one command."""

    lift: str
    command: LiftCommand
    floor: str
    """Where the command calls the car; empty for other commands."""
    here: str
    """Where the car has to stand for it; empty where that does not matter."""
    requests: tuple[SessionRequest, ...]
    """In order; none where the session alone does it."""
    tried: int | None
    """Which of them is the command; None for the session alone."""
    steps: tuple[str, ...]
    """The presses and releases that follow from it, as `LiftManagerClient.planned_writes` takes them."""
    pressed: tuple[LiftCommand, ...]
    """Every command that is pressed on the way, itself included."""

    def __str__(self) -> str:
        return f"{self.command.name} {self.floor}" if self.floor else self.command.name

    @property
    def latching(self) -> tuple[LiftCommand, ...]:
        """Commands that stay on, with nothing to release them, if this computer or its cable fails meanwhile."""
        return tuple(command for command in self.pressed if command.on_link_loss == "latches")

    @property
    def is_held(self) -> bool:
        """Whether it stays on until the session ends."""
        return self.command.name.partition(".")[0] in (ROBOT_MODE, "hold_door") and self.command.action == "hold"


def plan_trial(known: KnownLift, name: str, floor: str = "") -> Trial:
    """Return the trial of a command of the map. Raises NotPossible."""
    lift, command = known.lift, _named_command(known, name)
    if lift.quality is Quality.OFFLINE:
        raise NotPossible(
            f"{lift.name} cannot be read, and nothing is pressed without a current reading: {lift.reason}"
        )
    _check_floor(lift, command, floor)
    course = _Course(known)
    course.press(ROBOT_MODE)
    tried = None if command.name == ROBOT_MODE else _plan_command(course, command, floor)
    return Trial(
        lift=lift.name,
        command=command,
        floor=floor,
        here=course.here,
        requests=tuple(course.requests),
        tried=tried,
        steps=tuple(course.steps),
        pressed=tuple(course.pressed),
    )


def _named_command(known: KnownLift, name: str) -> LiftCommand:
    lift, names = known.lift.name, [command.name for command in known.commands.commands]
    command = known.command(name)
    if command is None:
        text = f"the map {known.capabilities.map} of {lift} has no command {name!r}{closest(name, names)}"
        raise NotPossible(f"{text}; `lift-manager poke {lift}` lists them: {', '.join(names)}")
    if command.action not in ("pulse", "hold"):
        raise NotPossible(
            f"{lift}: {name} is written all the time while a manager may write; there is nothing to press"
        )
    return command


def _check_floor(lift: Lift, command: LiftCommand, floor: str) -> None:
    name, floors = command.name, lift.floors
    if not command.takes_floor and not (floor and name in ACKNOWLEDGEMENTS):
        if floor:
            raise NotPossible(f"{lift.name}: {name} takes no floor; leave {floor!r} out")
        return
    example = f"such as `lift-manager poke {lift.name} {name} {floors[-1]}`"
    if not floor:
        raise NotPossible(f"{lift.name}: {name} needs a floor, {example}")
    if floor not in floors:
        raise NotPossible(f"{lift.name} has no floor {floor!r}; its floors are {', '.join(floors)}, {example}")


@dataclass
class _Course:
    """What a session is asked for, and the presses and releases that follow, in order."""

    known: KnownLift
    here: str = ""
    requests: list[SessionRequest] = field(default_factory=list)
    steps: list[str] = field(default_factory=list)
    pressed: list[LiftCommand] = field(default_factory=list)

    def request(self, request: SessionRequest) -> int:
        """Add a request, and return which one it is."""
        self.requests.append(request)
        return len(self.requests) - 1

    def press(self, name: str, floor: str = "") -> None:
        """Press a command, if the map has it."""
        command = self.known.command(name)
        if command is None:
            return
        self.steps.append(_step("press", name, floor))
        if command not in self.pressed:
            self.pressed.append(command)

    def release(self, name: str, floor: str = "") -> None:
        """Release a command."""
        self.steps.append(_step("release", name, floor))

    def release_hold(self, name: str, floor: str = "") -> None:
        """Release what stays on; a pulse ends by itself."""
        command = self.known.command(name)
        if command is not None and command.action == "hold":
            self.release(name, floor)

    def has_pressed(self, name: str, floor: str) -> bool:
        """Whether a command was pressed for a floor."""
        return _step("press", name, floor) in self.steps


def _step(verb: str, name: str, floor: str) -> str:
    return f"{verb} {name} {floor}" if floor else f"{verb} {name}"


def _plan_command(course: _Course, command: LiftCommand, floor: str) -> int:
    """Return which request is the command."""
    kind, _, side = command.name.partition(".")
    match kind:
        case "go" | "robot_in_place" | "robot_left":
            return _plan_ride(course, command, floor)
        case "hold_door":
            return _plan_hold(course, Side(side))
        case "close_door":
            return _plan_close(course, command, Side(side))
        case _:
            return _plan_call(course, command, floor)


# -- calls


def _plan_call(course: _Course, command: LiftCommand, floor: str) -> int:
    known, lift = course.known, course.known.lift
    _check_call(known, command, floor, aboard=False)
    if lift.standing and lift.floor == floor and not (known.commands.same_floor_call and known.is_shut):
        raise NotPossible(f"{lift.name}: the car stands at {floor} already, so no call is pressed; name another floor")
    tried = course.request(SessionRequest(CommandType.GO_TO, floor))
    course.press(command.name, floor)
    course.release_hold(command.name, floor)
    return tried


def _plan_ride(course: _Course, command: LiftCommand, floor: str) -> int:
    """Take an empty car along as if a robot were in it: what concerns a robot aboard cannot be tried without a ride."""
    known = course.known
    _stand_here(course, hold=True)
    here = course.here
    destination = floor or _next_floor(known.lift.floors, here)
    if destination == here:
        raise NotPossible(f"{known.lift.name}: the trial begins at {here}, where the car is; name another floor")
    go = known.call_to(destination, aboard=True)
    if command.takes_floor:
        _check_call(known, command, destination, aboard=True)
    in_place = course.request(SessionRequest(CommandType.ROBOT_IN_PLACE))
    course.press("robot_in_place")
    call = known.call_to(here, aboard=False)
    if call is not None and call.until == "robot_in_place" and course.has_pressed(call.name, here):
        course.release(call.name, here)
    for hold in known.door_holds(here):
        course.release(hold)
    away = course.request(SessionRequest(CommandType.GO_TO, destination, hold_door=True))
    if go is not None:
        course.press(go.name, destination)
        if go.until not in ACKNOWLEDGEMENTS:
            course.release_hold(go.name, destination)
    for hold in known.door_holds(destination):
        course.press(hold)
    left = course.request(SessionRequest(CommandType.ROBOT_LEFT))
    course.press("robot_left")
    if go is not None and go.until in ACKNOWLEDGEMENTS:
        course.release(go.name, destination)
    return {"robot_in_place": in_place, "robot_left": left}.get(command.name, away)


def _next_floor(floors: Sequence[str], here: str) -> str:
    """Return the floor above, or below the highest."""
    index = floors.index(here)
    return floors[index + 1] if index + 1 < len(floors) else floors[index - 1]


def _check_call(known: KnownLift, command: LiftCommand, floor: str, *, aboard: bool) -> None:
    """Refuse a call that no session presses for this floor."""
    chosen = known.call_to(floor, aboard=aboard)
    if chosen is not None and chosen.name != command.name:
        raise NotPossible(
            f"{known.lift.name}: a session brings the car to {floor} with {chosen.name}, never with {command.name};"
            f" try `lift-manager poke {known.lift.name} {chosen.name} {floor}`"
        )


# -- doors


def _plan_hold(course: _Course, side: Side) -> int:
    _stand_here(course, hold=True)
    _check_side(course, side)
    return course.request(SessionRequest(CommandType.HOLD_DOOR))


def _plan_close(course: _Course, command: LiftCommand, side: Side) -> int:
    known = course.known
    has_hold = known.command(f"hold_door.{side}") is not None
    _stand_here(course, hold=has_hold)
    _check_side(course, side)
    call_opens = any(step.startswith("press ") and step != f"press {ROBOT_MODE}" for step in course.steps)
    if not has_hold and known.is_shut and not call_opens:
        raise NotPossible(
            f"{known.lift.name}: the {side} door is shut, and the map has nothing to open it; open it with the button at the"
            " landing, then repeat this at once"
        )
    if has_hold:
        course.request(SessionRequest(CommandType.HOLD_DOOR))
    # the car has stood open for the session: a person says that no robot is in the doorway
    course.request(SessionRequest(CommandType.ROBOT_LEFT))
    tried = course.request(SessionRequest(CommandType.CLOSE_DOOR, door=side))
    for hold in known.door_holds(course.here):
        course.release(hold)
    course.press(command.name)
    course.release_hold(command.name)
    return tried


def _check_side(course: _Course, side: Side) -> None:
    if side in course.known.doors_at(course.here):
        return
    floors = [floor for floor, sides in course.known.capabilities.doors_at.items() if side in sides]
    where = f"bring the car to {' or '.join(floors)} first" if floors else f"no floor of it has a {side} door"
    raise NotPossible(f"{course.known.lift.name}: the car stands at {course.here}, which has no {side} door; {where}")


# -- the car at its floor


def _stand_here(course: _Course, *, hold: bool) -> None:
    """Make the floor where the car stands that of the session."""
    known, lift = course.known, course.known.lift
    is_unseen = not known.is_standing
    if is_unseen and not known.stands_open_only:
        raise NotPossible(
            f"{lift.name}: nobody knows at which floor the car stands; wait until it does, or send it to a floor first"
        )
    here = course.here = lift.floor or lift.floors[0]
    course.request(SessionRequest(CommandType.GO_TO, here, hold_door=hold))
    call, holds = known.call_to(here, aboard=False), known.door_holds(here)
    if call is not None:
        keeps_door = hold and len(holds) < len(known.doors_at(here)) and call.until in ACKNOWLEDGEMENTS
        if keeps_door or is_unseen or (known.commands.same_floor_call and known.is_shut):
            course.press(call.name, here)
            if not keeps_door:
                course.release_hold(call.name, here)
    if hold:
        for name in holds:
            course.press(name)
