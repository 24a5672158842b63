"""What becomes of a request within a session. Pure.

A request is judged again whenever there is news, until it has its end; it never ends better than the lift shows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from drivers.model import FloorName, Outcome, Proof, Result
from lift_manager.domain.call import Call, CallPhase
from lift_manager.domain.session_requests import Do, Status

DOOR_WITHIN_S = 10.0
"""How long the hold of a door may take to be seen on, or off. Chosen: three times what a map may take to confirm a write, and less than
a robot waits before it asks again."""

TAKEN = "another request took its place"


@dataclass(frozen=True, slots=True)
class Told:
    """How far something is that the lift is told: the call, a word about the robot, the close button."""

    phase: CallPhase | None = None
    """None where the lift need not be told: its map has no signal for it, or it is so already."""
    reason: str = ""
    """Why it failed."""
    again_in_s: float = 0.0
    """Until it may be pressed again after a failure."""
    outcome: Outcome | None = None
    """Of its newest press; None where it was not pressed, or has none yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What a session has on its lift at one moment."""

    floor: FloorName | None
    call: Told
    door_held: bool
    """Whatever holds the doors of the session's floor is on and verified."""
    door_given: bool
    """Something is on, or asked for, to hold a door."""
    door_free: bool
    """Nothing of ours holds a door, and that is verified."""
    hold_spent: bool
    in_place: Told
    left: Told
    close: Told
    waits: str
    """What the session waits for."""


@dataclass(frozen=True, slots=True)
class Pending:
    """A request that has not ended."""

    do: Do
    floor: FloorName | None
    """The floor of the session that it was asked for."""
    waits: str = ""
    pressed: bool = False
    """Something was given to the lift for it, or was on already."""
    due_since: float | None = None
    """Since when nothing but the door itself is waited for."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The end of a request."""

    status: Status
    reason: str = ""
    proof: Proof = Proof.NONE


def how_far(call: Call | None, outcome: Outcome | None, now: float) -> Told:
    """Return how far a call is, or a word that follows its rules. `outcome` is that of its newest press."""
    if call is None:
        return Told()
    return Told(call.phase, call.reason, max(0.0, call.not_before - now), outcome)


def judge(pending: Pending, view: View, now: float) -> Pending | Verdict:
    """Return how a request goes on, or has ended."""
    return _JUDGES[pending.do](pending, view, now)


def broken_off(pending: Pending, why: str) -> Verdict:
    """Return the end of a request that nobody follows any more."""
    return Verdict(Status.UNCONFIRMED if pending.pressed else Status.REJECTED, why)


def takes_place_of(do: Do, floor: FloorName | None, pending: Pending, *, hold_door: bool) -> bool:
    """Whether a request ends one that is pending; the same one again does not. `floor` and `hold_door` are the session's with it."""
    if pending.do is Do.GO_TO:
        return do is Do.GO_TO and floor != pending.floor
    if pending.do in _WORDS:
        return do in _WORDS and do is not pending.do
    if do is not Do.GO_TO:
        return do in _DOOR and do is not pending.do
    elsewhere = floor != pending.floor
    if pending.do is Do.HOLD_DOOR:
        return elsewhere or not hold_door
    # a car that goes elsewhere has its door let go first
    return pending.do is Do.CLOSE_DOOR or (hold_door and not elsewhere)


_WORDS = (Do.ROBOT_IN_PLACE, Do.ROBOT_LEFT)
_DOOR = (Do.HOLD_DOOR, Do.LET_GO_DOOR, Do.CLOSE_DOOR)


def _go_to(pending: Pending, view: View, _: float) -> Pending | Verdict:
    call = view.call
    if view.floor != pending.floor:
        return broken_off(pending, TAKEN)
    if call.phase is CallPhase.ARRIVED:
        return Verdict(Status.CONFIRMED, proof=_proof(call.outcome, Proof.EFFECT))
    if call.phase is CallPhase.CONFIRMED:
        # where no call moves the occupied car, the word that the robot is in place has sent it on
        return Verdict(Status.CONFIRMED, proof=_proof(call.outcome, _proof(view.in_place.outcome, Proof.NONE)))
    return _told(pending, call, view, f"the call to {pending.floor}")


def _hold_door(pending: Pending, view: View, now: float) -> Pending | Verdict:
    if view.floor != pending.floor:
        return broken_off(pending, TAKEN)
    if view.hold_spent:
        return broken_off(pending, "the door was held for as long as the site allows in one stop, and is let go")
    call = view.call
    if call.phase is CallPhase.FAILED:
        return broken_off(pending, f"the call to {pending.floor} failed: {call.reason}")
    if call.phase is not CallPhase.ARRIVED:
        waits = view.waits or f"the car to stand at {pending.floor}"
        return replace(pending, waits=waits, due_since=None)
    if view.door_held:
        return Verdict(Status.CONFIRMED, proof=Proof.READBACK)
    after = replace(pending, pressed=pending.pressed or view.door_given, due_since=_since(pending, now))
    if now - _since(pending, now) <= DOOR_WITHIN_S:
        return replace(after, waits=view.waits or "the lift to show that the door is held")
    why = f": the session waits for {view.waits}" if view.waits else ""
    return broken_off(after, f"the lift did not show within {DOOR_WITHIN_S:g} s that the door is held{why}")


def _let_go_door(pending: Pending, view: View, now: float) -> Pending | Verdict:
    if view.door_free:
        return Verdict(Status.CONFIRMED, proof=Proof.READBACK if pending.pressed else Proof.NONE)
    since = _since(pending, now)
    if now - since <= DOOR_WITHIN_S:
        return replace(pending, waits="the lift to show that the door is let go", pressed=True, due_since=since)
    why = f"the lift did not show within {DOOR_WITHIN_S:g} s that the door is let go; letting go is repeated until it does"
    return Verdict(Status.UNCONFIRMED, why)


def _close_door(pending: Pending, view: View, _: float) -> Pending | Verdict:
    if view.close.phase is CallPhase.CONFIRMED:
        return Verdict(Status.CONFIRMED, proof=_proof(view.close.outcome, Proof.NONE))
    return _told(pending, view.close, view, "the close button")


def _in_place(pending: Pending, view: View, _: float) -> Pending | Verdict:
    return _word(pending, view.in_place, view)


def _left(pending: Pending, view: View, _: float) -> Pending | Verdict:
    return _word(pending, view.left, view)


def _word(pending: Pending, word: Told, view: View) -> Pending | Verdict:
    if word.phase is None:
        return Verdict(Status.CONFIRMED)
    if word.phase is CallPhase.CONFIRMED:
        return Verdict(Status.CONFIRMED, proof=_proof(word.outcome, Proof.NONE))
    return _told(pending, word, view, pending.do)


def _told(pending: Pending, told: Told, view: View, what: str) -> Pending | Verdict:
    """Judge what is neither taken by the lift nor needless."""
    if told.phase is CallPhase.PRESSED:
        return replace(pending, pressed=True, waits="the lift to show that it has taken it")
    if told.phase is CallPhase.WANTED:
        not_sent = told.outcome is not None and told.outcome.not_granted
        return replace(
            pending, waits=view.waits or "its button to be pressed", pressed=pending.pressed and not not_sent
        )
    if told.phase is None:
        return broken_off(pending, f"{what} is no longer wanted")
    if not pending.pressed:
        pause = f"; it may be pressed again in {told.again_in_s:.1f} s" if told.again_in_s > 0 else ""
        return Verdict(Status.REJECTED, f"{what} is not pressed: {told.reason}{pause}")
    if told.outcome is not None and told.outcome.result is Result.REJECTED:
        return Verdict(Status.REJECTED, told.outcome.reason)
    return Verdict(Status.UNCONFIRMED, told.outcome.reason if told.outcome is not None else told.reason)


def _since(pending: Pending, now: float) -> float:
    return now if pending.due_since is None else pending.due_since


def _proof(outcome: Outcome | None, otherwise: Proof) -> Proof:
    return outcome.proof if outcome is not None and outcome.result is Result.CONFIRMED else otherwise


_JUDGES: Mapping[Do, Callable[[Pending, View, float], Pending | Verdict]] = {
    Do.GO_TO: _go_to,
    Do.HOLD_DOOR: _hold_door,
    Do.LET_GO_DOOR: _let_go_door,
    Do.CLOSE_DOOR: _close_door,
    Do.ROBOT_IN_PLACE: _in_place,
    Do.ROBOT_LEFT: _left,
}
