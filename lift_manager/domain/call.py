"""One call of the car to one floor, from the wish to the arrival. Pure.

A caller that only ever repeats itself must neither press twice for one call nor strand on one lost pulse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum, unique

from drivers.model import Capabilities, FloorName, Outcome, Result
from lift_manager.domain.sight import Sight
from register_maps.words import Door, Motion

BACKOFF_S = (2.0, 30.0)
"""First and longest pause before a failed call may be pressed again (DESIGN section 7)."""

SETTLES_WITHIN_S = 3.0
"""How long a car that stops may take to show that it stands. Chosen: levelling takes a second or two."""

LOST_AFTER_READINGS = 3
"""A call counts as lost when this many readings in a row show neither it nor the car at its floor. Chosen: one or two may fall
between the end of a trip and the evidence that the car stands."""


@unique
class CallPhase(StrEnum):
    """Where a call is."""

    WANTED = "wanted"
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
    """Not pressed again before this time."""
    missing: int = 0
    """Readings in a row that showed no trace of it."""
    reason: str = ""
    """Why it failed last; empty again once the lift has taken it."""
    reached: bool = False
    """The car stood there for it, and has not been seen to leave."""
    shut_since: float | None = None
    """Since when an arrived car has shown nothing but shut doors, where an open one is the evidence that it stands."""


def want(call: Call | None, floor: FloorName, now: float) -> Call:
    """Take a request for a floor: a new call, or the same one, pressed again only if it failed and has waited."""
    if call is None or call.floor != floor:
        return Call(floor, CallPhase.WANTED, now)
    if call.phase is CallPhase.FAILED and now >= call.not_before:
        return replace(call, phase=CallPhase.WANTED, since=now, missing=0, shut_since=None)
    return call


def restored(floor: FloorName, *, pressed: bool, now: float) -> Call:
    """Return the call of a session from before a restart. Nothing is pressed by it before the next request.

    One that was pressed is followed as if it had been confirmed by now: it arrives, or is lost.
    """
    if pressed:
        return Call(floor, CallPhase.CONFIRMED, now)
    return Call(floor, CallPhase.FAILED, now, reason="not pressed before the restart")


def waited(call: Call, now: float) -> Call:
    """Let a call that is not pressed yet begin now: what it waited for is not counted against it."""
    return replace(call, since=now) if call.phase is CallPhase.WANTED else call


def pressed(call: Call, now: float) -> Call:
    """Note that the press was handed to the driver."""
    return replace(call, phase=CallPhase.PRESSED, since=now, missing=0)


def ended(call: Call, outcome: Outcome, now: float) -> Call:
    """Take the outcome of the press."""
    if call.phase is not CallPhase.PRESSED:
        return call
    if outcome.not_granted:
        return replace(call, phase=CallPhase.WANTED, since=now)
    if outcome.result is Result.CONFIRMED:
        return replace(call, phase=CallPhase.CONFIRMED, since=now, reason="")
    return failed(call, f"{outcome.result}: {outcome.reason}", now)


def unpressed(call: Call, now: float) -> Call:
    """Note that the lift sets out for this floor without a press of its own."""
    return replace(call, phase=CallPhase.CONFIRMED, since=now, missing=0, reason="")


def failed(call: Call, reason: str, now: float) -> Call:
    """Give the call up until it is asked for again, with a pause that doubles."""
    first, longest = BACKOFF_S
    pause = min(longest, first * 2**call.failures)
    return replace(
        call, phase=CallPhase.FAILED, since=now, failures=call.failures + 1, not_before=now + pause, reason=reason
    )


def off(call: Call, reason: str, now: float) -> Call:
    """Note that a call from before a restart is not on: that is no failed press, so the next repeat presses at once."""
    return replace(call, phase=CallPhase.FAILED, since=now, not_before=now, reason=reason)


def seen(call: Call, sight: Sight, able: Capabilities, now: float, *, is_hold: bool = False) -> Call:
    """Take a fresh reading: arrival, a call that disappeared, a car that was taken away.

    `is_hold` says that nothing but this call keeps the door open: until it is pressed, an open door does not fulfil it.
    """
    here = sight.floor == call.floor
    if call.reached and _gone(call, sight):
        call = replace(call, reached=False)
    unpressed = is_hold and call.phase in (CallPhase.WANTED, CallPhase.FAILED)
    if here and sight.standing and not unpressed and not _must_open(call, sight, able, now):
        return _arrived(call, now, is_hold=is_hold)
    if call.phase is CallPhase.ARRIVED:
        return _still_arrived(call, sight, able, now, is_hold=is_hold)
    if call.phase is not CallPhase.CONFIRMED:
        return call
    if now - call.since > able.arrive_within_s:
        return failed(call, f"the car did not arrive within {able.arrive_within_s:g} s", now)
    if here or _shown(call, sight, able):
        return call if call.missing == 0 else replace(call, missing=0)
    if call.missing + 1 >= LOST_AFTER_READINGS:
        return failed(call, "the call disappeared", now)
    return replace(call, missing=call.missing + 1)


def may_press(call: Call, sight: Sight, able: Capabilities, now: float, *, is_hold: bool = False) -> bool:
    """Whether a wanted call needs a press now: not while the car stops at its floor, unless a call opens or holds the door there.

    A car that stopped there, but not level, is called after a while.
    """
    stopping = sight.floor == call.floor and sight.values.motion in (None, Motion.STOPPED)
    settling = stopping and now - call.since < SETTLES_WITHIN_S + able.evidence_for_s
    opens = (able.same_floor_call or is_hold) and sight.standing
    return call.phase is CallPhase.WANTED and (opens or not settling)


def missing(sight: Sight, able: Capabilities, command: str) -> frozenset[str]:
    """Return the flags that a command requires and the lift does not give, such as robot mode."""
    needs = able.requires.get(command, frozenset())
    return frozenset(flag for flag in needs if not sight.values.flags.get(flag, False))


def _arrived(call: Call, now: float, *, is_hold: bool) -> Call:
    """Note that the car stands there. Failures of a call that holds the door are forgiven once it has held for a while."""
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


def _still_arrived(call: Call, sight: Sight, able: Capabilities, now: float, *, is_hold: bool) -> Call:
    """Find out whether the door shut, or the car left, for a car that is not seen to stand open at its floor any more.

    Where an open door is the evidence, a shut one has to be read for longer than one reading counts: a call that is let go for
    one wrong reading shuts the door.
    """
    here = sight.floor == call.floor
    if here and sight.standing:
        return failed(call, "the door shut", now)
    if _gone(call, sight):
        return failed(call, "the car was taken away", now)
    opens = able.same_floor_call or is_hold
    if not (here and opens and able.evidence == "door_open" and _shut(sight)):
        return call if call.shut_since is None else replace(call, shut_since=None)
    if call.shut_since is None:
        return replace(call, shut_since=now)
    return failed(call, "the door shut", now) if now - call.shut_since > able.max_age_s else call


def _shut(sight: Sight) -> bool:
    return all(door is Door.CLOSED for door in sight.values.doors.values())


def _must_open(call: Call, sight: Sight, able: Capabilities, now: float) -> bool:
    """Whether the door is shut where the car stands, on a lift that opens it for a call: before the press, or after it closed again.

    A failed call waits for the next repeat or an open door: a car that merely stands there has not answered it.
    """
    if not able.same_floor_call or not _shut(sight):
        return False
    return call.phase in (CallPhase.WANTED, CallPhase.FAILED) or (
        call.phase is CallPhase.ARRIVED and now - call.since > able.door_opens_within_s
    )


def _gone(call: Call, sight: Sight) -> bool:
    """Whether the car left; re-levelling with the door open is not leaving."""
    if sight.floor is not None:
        return sight.floor != call.floor
    return _shut(sight)


def _shown(call: Call, sight: Sight, able: Capabilities) -> bool:
    """Whether the lift still shows the call. Without a lamp for it, it counts as lost only when the lift has nothing to do."""
    values = sight.values
    if "call_accepted" in able.signals or "calls_registered" in able.signals:
        return call.floor in (values.call_accepted, values.destination) or call.floor in values.calls
    return "destination" not in able.signals or values.destination is not None
