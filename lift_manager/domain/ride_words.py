"""What a robot, its caller or an operator says about a ride. Pure."""

from __future__ import annotations

from dataclasses import replace

from lift_manager.domain import ride_sight as sight
from lift_manager.domain import ride_steps as steps
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.ride import Guidance, Phase, RideWord
from lift_manager.domain.ride_record import Clearing, Close, RideRecord, RideSight, Step, Warn
from lift_manager.domain.service import Advice


def take_word(record: RideRecord, word: RideWord, seen: RideSight) -> Step | Refused:
    """Take the robot's word, or say why it makes no sense now. Whatever it says, it was heard."""
    taken = _WORDS[word](heard(record), seen)
    return taken if isinstance(taken, Refused) else steps.dated(record, taken, seen)


def heard(record: RideRecord) -> RideRecord:
    """Take it that the robot goes on with its ride after a restart."""
    return replace(record, unheard_since=None)


def cancel(record: RideRecord, seen: RideSight, reason: str, *, by_operator: bool) -> Step:
    """End a ride at somebody's word. A robot that may be inside is let out first; a second word changes nothing."""
    return steps.dated(record, _cancel(record, seen, reason, by_operator=by_operator), seen)


def advised(record: RideRecord, seen: RideSight, advice: Advice, text: str) -> RideRecord:
    """Give the robot the advice that comes before its session ends."""
    return record if record.over else steps.dated(record, Step(steps.gave_up(record, seen, text, advice)), seen).record


def _cancel(record: RideRecord, seen: RideSight, reason: str, *, by_operator: bool) -> Step:
    if record.over or record.phase is Phase.CLEARING:
        return Step(record)
    why = f"withdrawn by {'an operator' if by_operator else 'its caller'}: {reason}"
    if not (record.maybe_aboard or sight.boarding_possible(seen)):
        actions = (Close(left=False),) if record.session else ()
        return Step(steps.ended(record, Phase.CANCELLED, seen, why), actions)
    clearing = steps.cleared(record, Clearing(Phase.CANCELLED, why), seen)
    if not (by_operator and record.entered):
        return clearing
    text = (
        f"ride_cancelled: a robot of {record.holder} is in the car of {record.lift}, and its ride was {why};"
        f" {steps.letting_out(record)}"
    )
    return Step(clearing.record, (Warn(text), *clearing.actions))


def _here(record: RideRecord, seen: RideSight) -> Step | Refused:
    return _over(record) if record.over else Step(replace(record, spoke_at=seen.now))


def _entered(record: RideRecord, seen: RideSight) -> Step | Refused:
    if record.over:
        return _over(record)
    if record.entered:
        return Step(record)
    inside = replace(
        record, entered=True, maybe_aboard=True, could_leave_at=None, guidance=Guidance.STAY, reason="", trouble=""
    )
    if record.phase is Phase.CLEARING:
        return Step(inside)
    if record.session and (record.maybe_aboard or sight.boarding_possible(seen)):
        return Step(replace(inside, phase=Phase.RIDING, phase_since=seen.now))
    start = record.wish.start
    text = f"the door has not stood open for the robot at {start} yet; say `entered` once it has gone in there"
    return Refused(Refusal.NOT_NOW, text)


def _left(record: RideRecord, seen: RideSight) -> Step | Refused:
    if record.over:
        return _left_late(record)
    if not record.maybe_aboard:
        text = f"the ride is {record.phase}, and the robot cannot have been inside; to end the ride, cancel it"
        return Refused(Refusal.NOT_NOW, text)
    where = record.could_leave_at
    if record.entered and where is None and sight.is_live(seen.state):
        text = "the door has not stood open since the robot said that it is inside; say `left` once it is outside"
        return Refused(Refusal.NOT_NOW, text)
    return Step(_outside(record, seen), (Close(left=True),))


def _outside(record: RideRecord, seen: RideSight) -> RideRecord:
    """Return the ride as it ends with its robot outside."""
    where, destination = record.could_leave_at, record.wish.destination
    if record.phase is Phase.CLEARING and record.clearing is not None:
        return steps.ended(record, record.clearing.ending, seen, record.clearing.cause)
    if not record.entered:
        return steps.ended(
            record, Phase.CANCELLED, seen, "the robot said that it is outside, before it said that it went in"
        )
    if where == destination:
        return steps.ended(record, Phase.DONE, seen)
    at = f"at {where}" if where is not None else "where nobody could see the lift"
    return steps.ended(record, Phase.GAVE_UP, seen, f"the robot left {at}, and not at {destination}")


def _left_late(record: RideRecord) -> Step | Refused:
    return Step(replace(record, maybe_aboard=False), (Close(left=True),)) if record.maybe_aboard else _over(record)


def _over(record: RideRecord) -> Refused:
    why = f": {record.reason}" if record.reason else ""
    return Refused(Refusal.NOT_NOW, f"the ride is over, it is {record.phase}{why}")


_WORDS = {RideWord.HERE: _here, RideWord.ENTERED: _entered, RideWord.LEFT: _left}
