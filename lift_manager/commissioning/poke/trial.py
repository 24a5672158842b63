"""Plans the trial of one command: what a session is asked for, in order, and which presses and releases follow from it. Pure.

A trial presses nothing by itself. Each command of the map belongs to a request of a session, and the rules of sessions decide:

- `robot_mode` is on while a session holds the lift, so every trial presses it first, and its own trial is a session alone.
- `go_to`, `call` and `hold_door` are a session's `go_to` and `hold_door`; `close_door` is tried on a door that is open.
- `robot_in_place`, `go` and `robot_left` belong to a robot in the car. A trial of any of them is a ride of the empty car to the next
  floor: `robot_in_place`, then `go`, then `robot_left`, so that the lift does not count a robot aboard afterwards.
- A heartbeat is written all the time, and is nothing to press.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lift_manager.api.lifts import Lift, LiftCapabilities, LiftCommand, LiftCommands
from lift_manager.lift.call import ACKNOWLEDGEMENTS, calls_in_order
from lift_manager.lift.commands import CommandType
from lift_manager.lift.state import Quality
from register_maps.plain import closest
from register_maps.words import Door, Side

ROBOT_MODE = "robot_mode"
_ROBOT_WORDS = ("robot_in_place", "robot_left")


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

    def command(self, name: str) -> LiftCommand | None:
        """Return a command of the map by its name."""
        return next((command for command in self.commands.commands if command.name == name), None)


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
    return _Planner(known, _named_command(known, name), floor).plan()


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


class _Planner:
    """Collects requests and steps."""

    def __init__(self, known: KnownLift, command: LiftCommand, floor: str) -> None:
        self._known = known
        self._lift = known.lift
        self._command = command
        self._floor = floor
        self._here = ""
        self._requests: list[SessionRequest] = []
        self._steps: list[str] = []
        self._pressed: list[LiftCommand] = []

    def plan(self) -> Trial:
        lift, command = self._lift, self._command
        if lift.quality is Quality.OFFLINE:
            raise NotPossible(
                f"{lift.name} cannot be read, and nothing is pressed without a current reading: {lift.reason}"
            )
        self._check_floor()
        self._press(ROBOT_MODE)
        tried = None if command.name == ROBOT_MODE else self._plan_command()
        return Trial(
            lift=lift.name,
            command=command,
            floor=self._floor,
            here=self._here,
            requests=tuple(self._requests),
            tried=tried,
            steps=tuple(self._steps),
            pressed=tuple(self._pressed),
        )

    def _plan_command(self) -> int:
        """Return which request is the command."""
        kind, _, side = self._command.name.partition(".")
        match kind:
            case "go" | "robot_in_place" | "robot_left":
                return self._plan_ride()
            case "hold_door":
                return self._plan_hold(Side(side))
            case "close_door":
                return self._plan_close(Side(side))
            case _:
                return self._plan_call()

    def _check_floor(self) -> None:
        name, lift, floors = self._command.name, self._lift.name, self._lift.floors
        if not self._command.takes_floor and not (self._floor and name in _ROBOT_WORDS):
            if self._floor:
                raise NotPossible(f"{lift}: {name} takes no floor; leave {self._floor!r} out")
            return
        example = f"such as `lift-manager poke {lift} {name} {floors[-1]}`"
        if not self._floor:
            raise NotPossible(f"{lift}: {name} needs a floor, {example}")
        if self._floor not in floors:
            raise NotPossible(f"{lift} has no floor {self._floor!r}; its floors are {', '.join(floors)}, {example}")

    # -- calls

    def _plan_call(self) -> int:
        lift = self._lift
        self._check_call(self._floor, aboard=False)
        if lift.standing and lift.floor == self._floor and not (self._known.commands.same_floor_call and self._is_shut):
            raise NotPossible(
                f"{lift.name}: the car stands at {self._floor} already, so no call is pressed; name another floor"
            )
        tried = self._request(SessionRequest(CommandType.GO_TO, self._floor))
        self._press(self._command.name, self._floor)
        if self._command.action == "hold":
            self._release(self._command.name, self._floor)
        return tried

    def _plan_ride(self) -> int:
        """Take an empty car along as if a robot were in it: what concerns a robot aboard cannot be tried without a ride."""
        self._stand_here(hold=True)
        destination = self._floor or self._next_floor()
        if destination == self._here:
            raise NotPossible(
                f"{self._lift.name}: the trial begins at {self._here}, where the car is; name another floor"
            )
        go = self._call_to(destination, aboard=True)
        if self._command.takes_floor:
            self._check_call(destination, aboard=True)
        in_place = self._request(SessionRequest(CommandType.ROBOT_IN_PLACE))
        self._press("robot_in_place")
        call = self._call_to(self._here, aboard=False)
        if call is not None and call.until == "robot_in_place" and f"press {call.name} {self._here}" in self._steps:
            self._release(call.name, self._here)
        self._release_doors(self._here)
        away = self._request(SessionRequest(CommandType.GO_TO, destination, hold_door=True))
        if go is not None:
            self._press(go.name, destination)
            if go.until not in ACKNOWLEDGEMENTS:
                self._release_hold(go.name, destination)
        self._press_doors(destination)
        left = self._request(SessionRequest(CommandType.ROBOT_LEFT))
        self._press("robot_left")
        if go is not None and go.until in ACKNOWLEDGEMENTS:
            self._release(go.name, destination)
        return {"robot_in_place": in_place, "robot_left": left}.get(self._command.name, away)

    def _next_floor(self) -> str:
        """Return the floor above, or below the highest."""
        floors = self._lift.floors
        index = floors.index(self._here)
        return floors[index + 1] if index + 1 < len(floors) else floors[index - 1]

    def _check_call(self, floor: str, *, aboard: bool) -> None:
        """Refuse a call that no session presses for this floor."""
        chosen = self._call_to(floor, aboard=aboard)
        if chosen is not None and chosen.name != self._command.name:
            raise NotPossible(
                f"{self._lift.name}: a session brings the car to {floor} with {chosen.name}, never with {self._command.name};"
                f" try `lift-manager poke {self._lift.name} {chosen.name} {floor}`"
            )

    def _call_to(self, floor: str, *, aboard: bool) -> LiftCommand | None:
        calls = calls_in_order(floor, self._known.capabilities.doors_at.get(floor, ()), aboard=aboard)
        found = (self._known.command(call.name) for call in calls)
        return next((command for command in found if command is not None), None)

    # -- doors

    def _plan_hold(self, side: Side) -> int:
        self._stand_here(hold=True)
        self._check_side(side)
        return self._request(SessionRequest(CommandType.HOLD_DOOR))

    def _plan_close(self, side: Side) -> int:
        has_hold = self._known.command(f"hold_door.{side}") is not None
        self._stand_here(hold=has_hold)
        self._check_side(side)
        call_opens = any(step.startswith("press ") and step != f"press {ROBOT_MODE}" for step in self._steps)
        if not has_hold and self._is_shut and not call_opens:
            raise NotPossible(
                f"{self._lift.name}: the {side} door is shut, and the map has nothing to open it; open it with the button at the"
                " landing, then repeat this at once"
            )
        if has_hold:
            self._request(SessionRequest(CommandType.HOLD_DOOR))
        # the car has stood open for the session: a person says that no robot is in the doorway
        self._request(SessionRequest(CommandType.ROBOT_LEFT))
        tried = self._request(SessionRequest(CommandType.CLOSE_DOOR, door=side))
        self._release_doors(self._here)
        self._press(self._command.name)
        self._release_hold(self._command.name)
        return tried

    def _check_side(self, side: Side) -> None:
        doors_at = self._known.capabilities.doors_at
        if side in doors_at.get(self._here, ()):
            return
        floors = [floor for floor, sides in doors_at.items() if side in sides]
        where = f"bring the car to {' or '.join(floors)} first" if floors else f"no floor of it has a {side} door"
        raise NotPossible(f"{self._lift.name}: the car stands at {self._here}, which has no {side} door; {where}")

    def _press_doors(self, floor: str) -> None:
        for name in self._door_holds(floor):
            self._press(name)

    def _release_doors(self, floor: str) -> None:
        for name in self._door_holds(floor):
            self._release(name)

    def _door_holds(self, floor: str) -> Iterator[str]:
        """Yield the holds that a session presses at a floor: those of all its doors."""
        for side in self._known.capabilities.doors_at.get(floor, ()):
            if self._known.command(f"hold_door.{side}") is not None:
                yield f"hold_door.{side}"

    # -- the car at its floor

    def _stand_here(self, *, hold: bool) -> None:
        """Make the floor where the car stands that of the session."""
        lift, known = self._lift, self._known
        is_unseen = not known.is_standing
        if is_unseen and not known.stands_open_only:
            raise NotPossible(
                f"{lift.name}: nobody knows at which floor the car stands; wait until it does, or send it to a floor first"
            )
        self._here = lift.floor or lift.floors[0]
        self._request(SessionRequest(CommandType.GO_TO, self._here, hold_door=hold))
        call, doors = self._call_to(self._here, aboard=False), known.capabilities.doors_at.get(self._here, ())
        if call is not None:
            has_holds = all(known.command(f"hold_door.{side}") is not None for side in doors)
            keeps_door = hold and not has_holds and call.until in ACKNOWLEDGEMENTS
            if keeps_door or is_unseen or (known.commands.same_floor_call and self._is_shut):
                self._press(call.name, self._here)
                if not keeps_door:
                    self._release_hold(call.name, self._here)
        if hold:
            self._press_doors(self._here)

    @property
    def _is_shut(self) -> bool:
        return all(door is Door.CLOSED for door in self._lift.doors.values())

    # -- collecting

    def _request(self, request: SessionRequest) -> int:
        self._requests.append(request)
        return len(self._requests) - 1

    def _press(self, name: str, floor: str = "") -> None:
        command = self._known.command(name)
        if command is None:
            return
        self._steps.append(_step("press", name, floor))
        if command not in self._pressed:
            self._pressed.append(command)

    def _release(self, name: str, floor: str = "") -> None:
        self._steps.append(_step("release", name, floor))

    def _release_hold(self, name: str, floor: str = "") -> None:
        """Release what stays on; a pulse ends by itself."""
        command = self._known.command(name)
        if command is not None and command.action == "hold":
            self._release(name, floor)


def _step(verb: str, name: str, floor: str) -> str:
    return f"{verb} {name} {floor}" if floor else f"{verb} {name}"
