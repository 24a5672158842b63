"""The call under way and its outcome: pressed once, followed until the car is there, and pressed again only after a pause.

A caller that only ever repeats itself must neither press twice for one call nor be stranded by one lost pulse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum, unique
from functools import lru_cache

from drivers.model import Capabilities, Command, CommandKind, FloorName, Outcome, PressId, Result
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import Observation, has_no_open_door
from register_maps.words import Motion, Side

BACKOFF_S = (2.0, 30.0)
"""First and longest pause before a failed call may be pressed again (DESIGN section 6)."""

SETTLES_WITHIN_S = 3.0
"""How long a car that stops may take to show that it stands. Chosen: levelling takes a second or two."""

LOST_AFTER_READINGS = 3
"""A call counts as lost when this many readings in a row show neither it nor the car at its floor. Chosen: one or two may fall
between the end of a trip and the evidence that the car stands."""

ACKNOWLEDGEMENTS = frozenset({"robot_in_place", "robot_left"})
"""Ends of a held call: until then it keeps the door open."""


@unique
class CallPhase(StrEnum):
    """Phase of a call, or of a word to the controller that follows the same rules."""

    REQUESTED = "wanted"
    """To be pressed as soon as what it requires is granted."""
    PRESSED = "pressed"
    CONFIRMED = "confirmed"
    ARRIVED = "arrived"
    FAILED = "failed"
    """Rejected, unconfirmed, lost or too late; the next repeat of the request may press again."""


@dataclass(frozen=True, slots=True)
class Call:
    """The call that belongs to a session's floor."""

    floor: FloorName
    phase: CallPhase
    since: float
    """When it entered this phase."""
    failures: int = 0
    not_before: float = 0.0
    """The time before which it is not pressed again."""
    missing: int = 0
    """Readings in a row that showed no trace of it."""
    reason: str = ""
    """Why it failed last; empty again once the lift has taken it."""
    reached: bool = False
    """The car stood there for it, and was not seen to leave since."""
    shut_since: float | None = None
    """Since when an arrived car has shown only shut doors, where an open door is the evidence that it stands."""
    press: PressId | None = None
    """Its newest press; None if this process has not pressed."""
    outcome: Outcome | None = None
    """The outcome of that press; None while there is none."""

    @property
    def has_arrived(self) -> bool:
        """Whether it is fulfilled, or was and the car has not left since."""
        return self.phase is CallPhase.ARRIVED or self.reached

    @property
    def was_pressed(self) -> bool:
        """Whether it was given to the lift, or may have been, and has not failed."""
        return self.phase not in (CallPhase.REQUESTED, CallPhase.FAILED)

    @property
    def is_answered(self) -> bool:
        """Whether its newest press has its outcome; True if this process has not pressed."""
        return self.press is None or self.outcome is not None


# -- what a request, a press and an outcome do to a call


def request_call(call: Call | None, floor: FloorName, now: float) -> Call:
    """Take a request for a floor: a new call, or the same one, pressed again only if it failed and its pause is over."""
    if call is None or call.floor != floor:
        return Call(floor, CallPhase.REQUESTED, now)
    if call.phase is CallPhase.FAILED and now >= call.not_before:
        return replace(call, phase=CallPhase.REQUESTED, since=now, missing=0, shut_since=None)
    return call


def request_call_again(call: Call, now: float) -> Call:
    """Press a fulfilled call once more: it holds the door, and was released."""
    if call.phase is not CallPhase.ARRIVED:
        return call
    return replace(call, phase=CallPhase.REQUESTED, since=now, missing=0, shut_since=None)


def call_after_restart(floor: FloorName, now: float, *, pressed: bool) -> Call:
    """Return the call of a session from before a restart.

    Nothing is pressed for it before the next request. One that was pressed is followed as if it had just been confirmed: it
    arrives, or is lost.
    """
    if pressed:
        return Call(floor, CallPhase.CONFIRMED, now)
    return Call(floor, CallPhase.FAILED, now, reason="not pressed before the restart")


def postpone(call: Call, now: float) -> Call:
    """Start the time of a call that is not pressed yet: what it waited for does not count against it."""
    return replace(call, since=now) if call.phase is CallPhase.REQUESTED else call


def press_call(call: Call, press: PressId, now: float) -> Call:
    """Record that it is pressed."""
    return replace(call, phase=CallPhase.PRESSED, since=now, missing=0, press=press, outcome=None)


def call_without_press(call: Call, now: float) -> Call:
    """Record that the lift sets out for this floor without a press for it."""
    return replace(call, phase=CallPhase.CONFIRMED, since=now, missing=0, reason="")


def call_answered(call: Call, outcome: Outcome, now: float) -> Call:
    """Take the outcome of its newest press."""
    call = replace(call, outcome=outcome)
    if call.phase is not CallPhase.PRESSED:
        return call
    if outcome.grant_missing:
        return replace(call, phase=CallPhase.REQUESTED, since=now)
    if outcome.result is Result.CONFIRMED:
        return replace(call, phase=CallPhase.CONFIRMED, since=now, reason="")
    return call_failed(call, f"{outcome.result}: {outcome.reason}", now)


def call_failed(call: Call, reason: str, now: float) -> Call:
    """Give the call up until it is requested again, with a pause that doubles."""
    first, longest = BACKOFF_S
    pause = min(longest, first * 2**call.failures)
    return replace(
        call, phase=CallPhase.FAILED, since=now, failures=call.failures + 1, not_before=now + pause, reason=reason
    )


def call_found_off(call: Call, reason: str, now: float) -> Call:
    """Record that a call from before a restart is off: that is no failed press, so the next repeat presses at once."""
    return replace(call, phase=CallPhase.FAILED, since=now, not_before=now, reason=reason)


# -- what a reading does to a call


def follow_call(
    call: Call, observation: Observation, capabilities: Capabilities, now: float, *, is_hold: bool = False
) -> Call:
    """Take a fresh reading: arrival, a call that disappeared, a car that was taken away.

    `is_hold` says that nothing but this call keeps the door open: until it is pressed, an open door does not fulfil it.
    """
    is_here = observation.floor == call.floor
    if call.reached and _is_gone(call, observation):
        call = replace(call, reached=False)
    unpressed = is_hold and call.phase in (CallPhase.REQUESTED, CallPhase.FAILED)
    if is_here and observation.is_standing and not unpressed and not _must_open(call, observation, capabilities, now):
        return _arrived(call, now, is_hold=is_hold)
    if call.phase is CallPhase.ARRIVED:
        return _still_arrived(call, observation, capabilities, now, is_hold=is_hold)
    if call.phase is not CallPhase.CONFIRMED:
        return call
    if now - call.since > capabilities.arrive_within_s:
        return call_failed(call, f"the car did not arrive within {capabilities.arrive_within_s:g} s", now)
    if is_here or _is_shown(call, observation, capabilities):
        return call if call.missing == 0 else replace(call, missing=0)
    if call.missing + 1 >= LOST_AFTER_READINGS:
        return call_failed(call, "the call disappeared", now)
    return replace(call, missing=call.missing + 1)


def changes_of_call(call: Call, capabilities: Capabilities) -> list[float]:
    """Return after which times `follow_call` takes the same reading otherwise, beside `arrive_within_s`."""
    times = [call.since + capabilities.door_opens_within_s]
    if call.failures:
        times.append(call.since + BACKOFF_S[1])
    if call.shut_since is not None:
        times.append(call.shut_since + capabilities.max_age_s)
    return times


def may_press_call(
    call: Call, observation: Observation, capabilities: Capabilities, now: float, *, is_hold: bool = False
) -> bool:
    """Whether a requested call needs a press now.

    Not while the car stops at its floor, unless a call opens or holds the door there. A car that stopped there, but not level, is
    called after a while.
    """
    stopping = observation.floor == call.floor and observation.values.motion in (None, Motion.STOPPED)
    settling = stopping and now - call.since < SETTLES_WITHIN_S + capabilities.evidence_for_s
    opens = (capabilities.same_floor_call or is_hold) and observation.is_standing
    return call.phase is CallPhase.REQUESTED and (opens or not settling)


def flags_missing(observation: Observation, capabilities: Capabilities, command: str) -> frozenset[str]:
    """Return the flags that a command requires and the lift does not show, such as robot mode."""
    needs = capabilities.requires.get(command, frozenset())
    return frozenset(flag for flag in needs if not observation.values.flags.get(flag, False))


def _arrived(call: Call, now: float, *, is_hold: bool) -> Call:
    """Record that the car stands there. Failures of a call that holds the door are forgiven once it has held for a while."""
    if call.phase is not CallPhase.ARRIVED:
        failures = call.failures if is_hold else 0
        return replace(
            call,
            phase=CallPhase.ARRIVED,
            since=now,
            failures=failures,
            missing=0,
            reason="",
            reached=True,
            shut_since=None,
        )
    failures = 0 if now - call.since > BACKOFF_S[1] else call.failures
    if (failures, call.shut_since) == (call.failures, None):
        return call
    return replace(call, failures=failures, shut_since=None)


def _still_arrived(
    call: Call, observation: Observation, capabilities: Capabilities, now: float, *, is_hold: bool
) -> Call:
    """Find out whether the door shut, or the car left, after the car no longer stands open at its floor.

    Where an open door is the evidence, a shut one has to be read for longer than one reading counts: a call that is released
    because of one wrong reading shuts the door.
    """
    is_here = observation.floor == call.floor
    if is_here and observation.is_standing:
        return call_failed(call, "the door shut", now)
    if _is_gone(call, observation):
        return call_failed(call, "the car was taken away", now)
    opens = capabilities.same_floor_call or is_hold
    shut = has_no_open_door(observation.values.doors)
    if not (is_here and opens and capabilities.evidence == "door_open" and shut):
        return call if call.shut_since is None else replace(call, shut_since=None)
    if call.shut_since is None:
        return replace(call, shut_since=now)
    return call_failed(call, "the door shut", now) if now - call.shut_since > capabilities.max_age_s else call


def _must_open(call: Call, observation: Observation, capabilities: Capabilities, now: float) -> bool:
    """Whether the door is shut where the car stands, on a lift that opens it for a call: before the press, or after it closed again.

    A failed call waits for the next repeat or an open door: a car that merely stands there has not responded to the call.
    """
    if not capabilities.same_floor_call or not has_no_open_door(observation.values.doors):
        return False
    return call.phase in (CallPhase.REQUESTED, CallPhase.FAILED) or (
        call.phase is CallPhase.ARRIVED and now - call.since > capabilities.door_opens_within_s
    )


def _is_gone(call: Call, observation: Observation) -> bool:
    """Whether the car left; re-levelling with the door open is not leaving."""
    if observation.floor is not None:
        return observation.floor != call.floor
    return has_no_open_door(observation.values.doors)


def _is_shown(call: Call, observation: Observation, capabilities: Capabilities) -> bool:
    """Whether the lift still shows the call. Without a lamp for it, it counts as lost only when the lift has nothing to do."""
    values = observation.values
    if "call_accepted" in capabilities.signals or "calls_registered" in capabilities.signals:
        return call.floor in (values.call_accepted, values.destination) or call.floor in values.calls
    return "destination" not in capabilities.signals or values.destination is not None


# -- the button of the call


@dataclass(frozen=True, slots=True)
class CallOutput:
    """The call that was pressed last, as an output. A pulse ends by itself; a held call stays on until its end."""

    command: Command
    until: str
    """What ends it: `arrived`, `robot_in_place` or `robot_left`; empty for a pulse."""
    press: PressId | None
    """None for one that was adopted from before a restart."""
    renewed_at: float
    interrupted: bool = False
    """It is being released although it should keep the door open; it counts as off."""

    @property
    def keeps_door(self) -> bool:
        """Whether it keeps the door open at its destination."""
        return self.until in ACKNOWLEDGEMENTS


def call_command(config: LiftConfig, floor: FloorName, *, aboard: bool) -> Command | None:
    """Return the command that brings the car to a floor; None if the map has none.

    Where the door is part of the call, it is the front one if the floor has it.
    """
    calls = calls_in_order(floor, config.doors_at.get(floor, ()), aboard=aboard)
    return next((call for call in calls if config.has(call)), None)


@lru_cache(1024)  # each request and each reading of a session has the same few
def calls_in_order(floor: FloorName, doors: tuple[Side, ...], *, aboard: bool) -> tuple[Command, ...]:
    """Return the calls that bring the car to a floor with these doors; the first one that the map has is pressed."""
    sides = (Command(CommandKind.GO_TO, floor, side) for side in Side if side in doors)
    plain = Command(CommandKind.GO if aboard else CommandKind.CALL, floor)
    return (Command(CommandKind.GO_TO, floor), *sides, plain)


def ends_call(config: LiftConfig, command: Command, *, aboard: bool) -> str:
    """Return what ends this call once it is on; empty for a pulse."""
    until = config.capabilities.until.get(command.name, "")
    # a robot aboard is in place already
    return "arrived" if aboard and until == "robot_in_place" else until


def call_holds_door(config: LiftConfig, floor: FloorName, *, aboard: bool) -> bool:
    """Whether the call to a floor keeps the door open there, because it stays on while the robot boards or leaves."""
    command = call_command(config, floor, aboard=aboard)
    return command is not None and ends_call(config, command, aboard=aboard) in ACKNOWLEDGEMENTS
