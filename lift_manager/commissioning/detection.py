"""Derives which faults of a lift, its controller and its wire the manager can detect with a map. Pure.

A fault that no register shows cannot be detected through registers. This states it for each map, before somebody relies on the
opposite. The classes are verified by experiment: `python -m tests.campaigns.matrix`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum, unique

from register_maps.codec import Codec, CommandCodec
from register_maps.schema import CALLS
from register_maps.vocabulary import FLAG_MODES
from register_maps.words import Door, Mode

READINGS_S = 1.0
"""How long two polls in a row may take, with the answers of a slow controller. Chosen: the usual poll takes 0.2 s."""

FOREIGN_WRITER_S = 6.0
"""Time limit for reporting a foreign write: outputs are compared every 2 s, and two reads must agree on a press; a refreshed hold is
read back before each refresh (`drivers.modbus`)."""


@unique
class FaultEffect(StrEnum):
    """What may be wrong because of a fault, until it is detected."""

    OPEN = "open"
    """A door is published as open for a robot, and is not."""
    MODE = "mode"
    """A robot is let in, or something is pressed, in a mode without robots."""
    EFFECT = "effect"
    """A command counts as confirmed, and had no effect."""
    OUTPUT = "output"
    """An output is on that counts as released, or holds a door at another floor than the requested one."""


@dataclass(frozen=True, slots=True)
class Detection:
    """How one fault shows on lifts of one map."""

    fault: str
    """As in a scenario file."""
    within_s: float | None
    """How long it may stay undetected from its beginning; None if it is undetectable."""
    lies: tuple[FaultEffect, ...]
    """What may be wrong meanwhile; empty if nothing is."""
    how: str
    """What shows it, or why nothing does."""
    goes_on: bool = False
    """Whether the errors continue although the fault is reported, for as long as it lasts."""


MODES = (Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.OUT_OF_SERVICE)
"""The modes without robots that a controller changes to by itself."""

_HARMLESS_REASONS = {
    "stuck_door": "the door limits show where it is",
    "reopening_door": "the door limits show what it does",
    "nudging_door": "the door limits show what it does",
    "relevelling": "the car stays in the door zone, which is no fault",
    "robot_mode_withdrawn": "robot mode is read, or the call is not answered",
    "overload": "the door stays open, and the car does not come in time",
    "floor_ahead": "a car that moves has its doors shut",
    "frozen_heartbeat": "what is read stays true",
}


def detections(codec: Codec, *, max_age_s: float) -> tuple[Detection, ...]:
    """Return the detection of every fault that can be simulated, in a fixed order."""
    return (*_machine(codec, max_age_s), *_registers(codec, max_age_s), *_network(codec, max_age_s))


def _machine(codec: Codec, max_age_s: float) -> Iterator[Detection]:
    for fault in ("stuck_door", "reopening_door", "nudging_door"):
        yield _harmless(fault)
    yield _late_arrival(
        codec, "wrong_floor", f"the floor that the car shows is where it is; {_ALARMED}", f"{_STARTS_RIGHT}; {_ALARMED}"
    )
    yield _harmless("relevelling")
    yield _late_arrival(codec, "homing", "the car shows no floor, or one with its doors shut", _HOMING)
    yield _late_arrival(codec, "calls_cancelled", "the call disappears, or the car does not come in time", _ELSEWHERE)
    for fault in ("robot_mode_withdrawn", "overload"):
        yield _harmless(fault)
    for mode in MODES:
        if _shows_mode(codec, mode):
            yield Detection(f"in_mode.{mode}", max_age_s, (FaultEffect.MODE,), "the mode is read with every poll")
        else:
            why = "no signal of this map shows this mode"
            if "robot_mode_on" in codec.signals:
                why += "; a withdrawn robot mode may be all there is to see of it, and bars robots that hold the lift"
            yield Detection(f"in_mode.{mode}", None, (FaultEffect.MODE, FaultEffect.EFFECT), why)


def _registers(codec: Codec, max_age_s: float) -> Iterator[Detection]:
    yield _wrong_floor_shown(codec)
    yield _harmless("floor_ahead")
    yield _contradiction(codec, max_age_s)
    alive = codec.map.signals.get("alive")
    beat_s = alive.must_change_within_s if alive is not None else None
    everything = tuple(FaultEffect)
    if beat_s is not None:
        within_s = beat_s + max_age_s
        yield Detection("frozen_registers", within_s, everything, f"the heartbeat stands still for {beat_s:g} s")
        yield Detection("frozen_heartbeat", within_s, (), f"the heartbeat stands still for {beat_s:g} s")
        yield Detection("stopped", within_s, everything, f"the heartbeat stands still for {beat_s:g} s")
    else:
        why = "the map has no heartbeat: registers that stand still look like a lift that does"
        yield Detection("frozen_registers", None, everything, why)
        yield _harmless("frozen_heartbeat")
        yield Detection("stopped", None, everything, why)
    yield _lost_writes("lost_press", codec)
    yield _lost_writes("ignored_writes", codec)
    yield Detection(
        "ignored_writes.stored", None, (FaultEffect.EFFECT, FaultEffect.OUTPUT), "what is read back is right"
    )
    yield _foreign_writer(codec)


def _network(codec: Codec, max_age_s: float) -> Iterator[Detection]:
    reboot = _late_arrival(
        codec, "reboot", "no answer comes, and the lift is offline", f"offline meanwhile; then {_HOMING}"
    )
    yield reboot if reboot.lies else replace(reboot, within_s=max_age_s)
    for fault in ("power_loss", "power_loss.outputs_held", "slot_kept"):
        yield Detection(fault, max_age_s, (), "no answer comes, and the lift is offline")


def _harmless(fault: str) -> Detection:
    return Detection(fault, 0.0, (), _HARMLESS_REASONS[fault])


def _shows_mode(codec: Codec, mode: Mode) -> bool:
    flags = dict(FLAG_MODES).get(mode, ())
    if any(flag in codec.signals and flag in _SIMULATED_FLAGS for flag in flags):
        return True
    words = codec.map.signals["mode"].values if "mode" in codec.signals else None
    return words is not None and mode in words.values()


_SIMULATED_FLAGS = frozenset({"fire", "emergency_power", "inspection", "independent", "out_of_service"})


_STARTS_RIGHT = "a car that sets out the right way has taken the call; where it stops is the floor that it shows"
_ALARMED = "confirmed calls that end at rest elsewhere, twice in a row with the same offset, are an alarm"
_ELSEWHERE = (
    "a car that moves for somebody else looks like the answer to a call that was forgotten; it does not come in time"
)
_HOMING = "a call that is read back counts as taken, and a lift that homes takes none; the car does not come in time"


def _late_arrival(codec: Codec, fault: str, harmless: str, how: str) -> Detection:
    """Return the detection of a fault that shows only when the car does not come, unless the controller itself confirms calls."""
    calls = [codec.commands[name] for name in CALLS if name in codec.commands]
    if not any(_is_confirmed_loosely(call) for call in calls):
        return Detection(fault, 0.0, (), harmless)
    return Detection(fault, max(call.spec.arrive_within_s for call in calls), (FaultEffect.EFFECT,), how)


def _wrong_floor_shown(codec: Codec) -> Detection:
    floor = codec.signals.get("car_floor")
    limits = {signal.points for name, signal in codec.signals.items() if name.startswith("door.") and signal.per_floor}
    lies = (FaultEffect.OPEN, FaultEffect.EFFECT, FaultEffect.OUTPUT)
    is_limit = floor is not None and floor.points in limits
    how = "another door limit is made" if is_limit else "nothing else shows the floor"
    return Detection("says_wrong_floor", None, lies, how)


def _contradiction(codec: Codec, max_age_s: float) -> Detection:
    doors = [name for name in codec.signals if name.startswith("door.")]
    if all(_contradicts(codec, name) for name in doors):
        return Detection("contradicting_limits", max_age_s, (FaultEffect.OPEN,), "the door is in fault")
    why = "the door is known by its open contact alone"
    return Detection("contradicting_limits", None, (FaultEffect.OPEN, FaultEffect.EFFECT), why)


def _contradicts(codec: Codec, name: str) -> bool:
    """Whether the registers of this door can hold an invalid value."""
    image = codec.empty_image()
    signal = codec.signals[name]
    if signal.per_floor:
        return False
    if signal.points and len(signal.points) == 2:
        return True
    spec = codec.map.signals[name]
    try:
        signal.insert(image, Door.OPEN)
    except ValueError:
        return True
    if spec.thresholds:
        return spec.range is not None
    return spec.values is not None and len(spec.values) < 2 ** min(16, signal.points[0].width)


def _lost_writes(fault: str, codec: Codec) -> Detection:
    calls = [codec.commands[name] for name in CALLS if name in codec.commands]
    loosely_confirmed = [command.name for command in calls if _is_confirmed_loosely(command)]
    unreadable = [command.name for command in codec.commands.values() if not command.read_points]
    lies = (
        *((FaultEffect.EFFECT,) if loosely_confirmed else ()),
        *((FaultEffect.OUTPUT,) if unreadable and fault != "lost_press" else ()),
    )
    if not lies:
        within_s = max((command.spec.confirm.within_s for command in calls if command.spec.confirm), default=0.0)
        return Detection(fault, within_s, (), "the lamp does not light, and the command is unconfirmed")
    why = []
    if FaultEffect.EFFECT in lies:
        why.append(f"{', '.join(loosely_confirmed)}: a car that moves for somebody else looks like the answer")
    if FaultEffect.OUTPUT in lies:
        why.append(f"{', '.join(unreadable)}: cannot be read back")
    return Detection(fault, None, lies, "; ".join(why))


def _foreign_writer(codec: Codec) -> Detection:
    lies = (FaultEffect.EFFECT, FaultEffect.OUTPUT)
    unreadable = [command.name for command in codec.commands.values() if not command.read_points or command.shows_lamp]
    if len(unreadable) == len(codec.commands):
        return Detection("foreign_writer", None, lies, "no output of this map can be read back")
    how = "an alarm names the output and what was written; the lift obeys both writers meanwhile"
    if unreadable:
        how += f". Not for {', '.join(unreadable)}, which cannot be read back"
    return Detection("foreign_writer", FOREIGN_WRITER_S, lies, how, goes_on=True)


def _is_confirmed_loosely(command: CommandCodec) -> bool:
    """Whether a call is confirmed by anything but the acceptance of the controller."""
    confirm = command.spec.confirm
    return confirm is None or bool({"readback", "effect", "car_floor", "destination"} & set(confirm.any_of))
