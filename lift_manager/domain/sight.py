"""What the readings so far establish about car and doors. Pure.

Opening is believed slowly, closing at once: a robot drives on one message that says "open at L2".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.model import Capabilities, FloorName, LiftReading, LiftValues
from lift_manager.domain.state import RobotDoor
from register_maps.words import ROBOT_FORBIDDEN_MODES, Door, Mode, Motion, Side

_MUST_READ = (
    ("robots_allowed", True, "its key switch does not allow robots"),
    ("ready", True, "it is not ready"),
    ("watchdog_tripped", False, "its module watchdog has tripped, so its outputs are not ours"),
)
"""Flags that decide whether robots may command the lift: the value that lets them, and what to say of the other one."""

MOVING = frozenset({Motion.UP, Motion.DOWN, Motion.MOVING})
"""Motions of a car that does not stand."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The newest news of a lift, with what only several readings can tell.

    A reading that brings no news leaves it as it is, so it does not say how old it is.
    """

    values: LiftValues
    epoch: int
    floor_since: float
    """Since when the car has been reported at the same floor without a break."""
    standing: bool
    """By the map's evidence the car stands at `values.floor`."""
    agreed: bool
    """The evidence for an open door came in one piece, or two readings in a row agree on it."""
    settled: bool
    """Another reading with the same values would tell nothing new."""
    follows: bool = False
    """It continues the reading before it: on the same connection, and without a gap longer than a reading counts."""
    not_open_since: Mapping[Side, float] = field(default_factory=dict)
    """Since when each door that is told by its open contact alone has read "not open"."""
    closing: frozenset[Side] = frozenset()
    """Of these, the doors that may still be closing."""
    doubt: str = ""
    """Why a door that reads open is not believed; empty while it is."""
    must_close: bool = False
    """Its door has to be read closed before anything is believed of it: holding it open would keep it from that, and invites nobody."""

    @property
    def floor(self) -> FloorName | None:
        """The floor the car reports."""
        return self.values.floor

    @property
    def doors(self) -> Mapping[Side, Door]:
        """The doors; one that is told by its open contact alone counts as closed only after it has had time to close."""
        doors = self.values.doors
        if not self.closing:
            return doors
        return {side: Door.MOVING if side in self.closing else door for side, door in doors.items()}


def see(before: Sight | None, reading: LiftReading, able: Capabilities, *, gap_s: float) -> Sight:
    """Add one reading to what was known before it, `gap_s` seconds earlier."""
    values = reading.values
    follows = before if before is not None and before.epoch == reading.epoch and gap_s <= able.max_age_s else None
    same_floor = follows is not None and follows.values.floor == values.floor
    floor_since = follows.floor_since if follows is not None and same_floor else reading.at
    agreed = able.one_block or (follows is not None and _evidence(follows.values) == _evidence(values))
    standing = values.floor is not None and _stands(values, able, reading.at - floor_since)
    waits = able.evidence == "position_stable" and values.floor is not None and not standing
    not_open_since = _not_open_since(follows, values, able, reading.at) if able.open_contacts else {}
    closing = {side for side, since in not_open_since.items() if reading.at - since < able.door_closes_within_s}
    return Sight(
        values,
        reading.epoch,
        floor_since,
        standing,
        agreed,
        settled=agreed and not waits and not closing,
        follows=follows is not None,
        not_open_since=not_open_since,
        closing=frozenset(closing),
    )


def permissions(able: Capabilities, *, aboard: bool | None) -> frozenset[str]:
    """Return the flags of this map of which one must be given before the robot drives; `aboard` is None where nobody knows."""
    wanted = {True: {"may_leave"}, False: {"may_enter"}, None: {"may_enter", "may_leave"}}
    return able.signals & wanted[aboard]


def robot_door(sight: Sight, doors_here: tuple[Side, ...], needs: frozenset[str]) -> RobotDoor:
    """Return the door word for robots as far as the lift's own signals go; sessions may only weaken it.

    `needs` are the permissions of which one must be given; none where the map has none.
    """
    doors = sight.doors
    if doors and all(door is Door.CLOSED for door in doors.values()):
        return RobotDoor.CLOSED
    is_open = bool(doors_here) and all(doors.get(side) is Door.OPEN for side in doors_here)
    allowed = sight.values.mode not in ROBOT_FORBIDDEN_MODES
    permitted = not needs or any(sight.values.flags.get(flag, False) for flag in needs)
    safe = sight.standing and sight.agreed and not sight.doubt and allowed and permitted
    return RobotDoor.OPEN if is_open and safe else RobotDoor.MOVING


def disbelieved(sight: Sight, floor: FloorName | None) -> str:
    """Say what a robot waits for at a floor whose door reads open and is not believed; empty where that is not so."""
    reads_open = sight.floor == floor and Door.OPEN in sight.values.doors.values()
    return sight.doubt if reads_open else ""


def barred(values: LiftValues, able: Capabilities) -> str | None:
    """Say why no robot may command the lift now, by its own signals; None when one may."""
    if values.mode in ROBOT_FORBIDDEN_MODES:
        return f"its mode is {values.mode}"
    for flag, lets, otherwise in _MUST_READ:
        told = values.flags.get(flag)
        if told is not None and told is not lets:
            return otherwise
        if told is None and flag in able.signals:
            raw = f" reads {values.unknown[flag]}, which its map does not list" if flag in values.unknown else ""
            return f"its signal {flag}{raw or ' cannot be read'}; check its wiring and its entry in the map"
    if able.watched and values.watchdog_s == 0:
        return "the module watchdog is switched off: nothing would let go of the door if this manager were lost"
    return None


def on_fire(values: LiftValues) -> bool:
    """Whether any signal tells of fire, whatever else the mode is."""
    flags = values.flags
    return values.mode is Mode.FIRE or values.fire_word or flags.get("fire", False) or flags.get("fireman", False)


def fire_unread(values: LiftValues, able: Capabilities) -> str | None:
    """Name the signal without which nobody knows whether there is a fire; None when all that would tell of one can be read."""
    for flag in ("fire", "fireman"):
        if flag in able.signals and flag not in values.flags:
            return flag
    return "mode" if values.mode is Mode.UNKNOWN or "mode" in values.unknown else None


def shut(values: LiftValues) -> bool:
    """Whether every door of the car reads closed; not for a car without doors."""
    return bool(values.doors) and all(door is Door.CLOSED for door in values.doors.values())


def moving(sight: Sight) -> bool:
    """Whether the car moves or may be moving: anything but a clear "stopped", or not seen to stand where motion is not told."""
    motion = sight.values.motion
    return not sight.standing if motion is None else motion is not Motion.STOPPED


def under_way(sight: Sight) -> bool:
    """Whether the lift says that the car moves, and every door is shut."""
    return shut(sight.values) and sight.values.motion in MOVING


def shuts(sight: Sight, sides: tuple[Side, ...]) -> bool:
    """Whether any of these doors is seen shut or closing: whatever holds it has no effect."""
    return any(sight.values.doors.get(side) in (Door.CLOSED, Door.CLOSING) for side in sides)


def left(sight: Sight, floor: FloorName) -> bool:
    """Whether the car is seen elsewhere, or moving; re-levelling at the floor with the door open is neither."""
    here, motion = sight.floor == floor, sight.values.motion
    if sight.floor is not None and not here:
        return True
    levels = here and any(door is not Door.CLOSED for door in sight.values.doors.values())
    return motion in MOVING and not levels


def _stands(values: LiftValues, able: Capabilities, floor_for_s: float) -> bool:
    if values.motion not in (None, Motion.STOPPED):
        return False
    match able.evidence:
        case "level":
            return values.flags.get("level", False)
        case "motion_stopped":
            return values.motion is Motion.STOPPED
        case "door_open":
            return Door.OPEN in values.doors.values()
        case "door_limit":
            return True
        case _:
            return floor_for_s >= able.evidence_for_s


def _not_open_since(before: Sight | None, values: LiftValues, able: Capabilities, at: float) -> dict[Side, float]:
    known = {} if before is None else before.not_open_since
    return {side: known.get(side, at) for side in able.open_contacts if values.doors.get(side) is Door.CLOSED}


def _evidence(values: LiftValues) -> tuple[FloorName | None, Mapping[Side, Door], Motion | None, bool]:
    return values.floor, values.doors, values.motion, values.flags.get("level", False)
