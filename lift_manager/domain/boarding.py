"""Who is aboard, as far as the life of a session tells. Pure.

A lift that tells the empty car from the occupied one must hear the truth about it. A robot's word settles it. A caller that
has no such word is believed by what it does, and only where the site allows that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum, unique

from drivers.model import Capabilities, FloorName
from lift_manager.domain.asking import Ask, RobotWord
from register_maps.vocabulary import HANDSHAKE


@unique
class Who(StrEnum):
    """Where the session's robot is."""

    EMPTY = "empty"
    """Not aboard: the car has not stood open for it yet."""
    MAY_BOARD = "may_board"
    """The car stood open for it: it may be outside, inside, or in between."""
    ABOARD = "aboard"
    LEFT = "left"
    """It got out; nobody else has been called for."""


@dataclass(frozen=True, slots=True)
class Boarding:
    """What is known of the session's robot."""

    who: Who = Who.EMPTY
    open_since: float | None = None
    """When the door first stood open for it to enter."""
    may_leave_at: FloorName | None = None
    """Where the door last stood open for it to leave; None once the car has moved on."""
    sent_on: bool = False
    """Since it was last known outside, the car was sent on from a stop where it may have entered, and nobody said whether it did."""


@dataclass(frozen=True, slots=True)
class KeptBoarding:
    """What of a session's robot outlives the manager; how long its door had stood open does not."""

    who: Who = Who.EMPTY
    sent_on: bool = False
    may_leave_at: FloorName | None = None
    in_place_told: bool = False
    """The lift has taken the word that the robot is in place."""


@dataclass(frozen=True, slots=True)
class Stop:
    """The session's stop, at the moment of a request."""

    floor: FloorName
    arrived: bool
    """The session's call is fulfilled."""
    open: bool
    """The car stands there with its door open, and a robot may enter."""


@dataclass(frozen=True, slots=True)
class Rules:
    """How a lift and its site want to know who is aboard."""

    matters: bool
    """Something else is pressed for an occupied car than for an empty one."""
    infer: bool
    """The site lets boarding and leaving be inferred."""
    board_min_s: float


def matters(able: Capabilities) -> bool:
    """Whether this lift is told something else for an occupied car than for an empty one."""
    return able.needs_occupancy or bool(able.commands & HANDSHAKE)


def aboard(boarding: Boarding, rules: Rules) -> bool | None:
    """Whether the robot counts as aboard; None where nobody says, and the lift does not ask."""
    if boarding.who is Who.ABOARD:
        return True
    return False if rules.matters or boarding.who is Who.LEFT else None


def possible(boarding: Boarding) -> bool:
    """Whether the robot may be in the car."""
    return boarding.sent_on or boarding.who in (Who.MAY_BOARD, Who.ABOARD)


def rode(boarding: Boarding) -> bool:
    """Whether the robot may have come along from an earlier stop."""
    return boarding.sent_on or boarding.who is Who.ABOARD


def leaves_doubt(
    boarding: Boarding, release: Ask | None, *, arrived: bool, has_words: bool, let_out: bool = True
) -> bool:
    """Whether the end of a session leaves it open whether its robot is in the car. `release` is its holder's own word.

    A holder that lets go, or wanted no more than to arrive, is done, unless its robot was aboard on the way, or may have been
    sent on and the door has not stood open for it since (`let_out`). One that `has_words` for it has to say that its robot left.
    """
    if release is not None:
        if has_words and release.robot is not RobotWord.LEFT:
            return possible(boarding)
        return boarding.who is Who.ABOARD or (boarding.sent_on and not let_out)
    return rode(boarding) if arrived else possible(boarding)


def taken_up(*, aboard: bool) -> Boarding:
    """Return what is known of a robot whose session ended before anybody said that it was outside."""
    return Boarding(Who.ABOARD if aboard else Who.MAY_BOARD)


def open_to_enter(boarding: Boarding, now: float) -> Boarding:
    """Note that the session's stop stands open for a robot outside."""
    if boarding.who is Who.EMPTY:
        return Boarding(Who.MAY_BOARD, open_since=now, sent_on=boarding.sent_on)
    if boarding.who is Who.MAY_BOARD and boarding.open_since is None:
        return replace(boarding, open_since=now)
    return boarding


def open_to_leave(boarding: Boarding, floor: FloorName) -> Boarding:
    """Note that the door stands open for the robot aboard."""
    return replace(boarding, may_leave_at=floor) if boarding.who is Who.ABOARD else boarding


def car_seen_at(boarding: Boarding, floor: FloorName | None, *, under_way: bool = False) -> Boarding:
    """Forget that the robot could leave once the car is seen elsewhere, or `under_way` with its doors shut.

    A car that reports no floor may still stand there.
    """
    if not under_way and (floor is None or boarding.may_leave_at in (None, floor)):
        return boarding
    return replace(boarding, may_leave_at=None)


def hear(boarding: Boarding, ask: Ask, stop: Stop | None, rules: Rules, now: float) -> Boarding | str:
    """Take a request of the holder, or say why it cannot be taken. `stop` is None where there is no session yet."""
    heard: Boarding | str = boarding
    if ask.robot is RobotWord.IN_PLACE:
        heard = _in_place(boarding, stop)
    elif ask.robot is RobotWord.LEFT:
        heard = _left(boarding)
    if isinstance(heard, str):
        return heard
    if stop is None:
        return _taken_along(heard)
    return heard if ask.floor == stop.floor else _sent_on(heard, stop, rules, now)


def has_left(boarding: Boarding, ask: Ask, destination: FloorName | None, rules: Rules) -> bool:
    """Whether a release says that the robot got out: in words, or by being given at the destination."""
    if boarding.who is not Who.ABOARD or boarding.may_leave_at is None:
        return False
    inferred = rules.infer and ask.floor == destination == boarding.may_leave_at
    return ask.robot is RobotWord.LEFT or inferred


def _in_place(boarding: Boarding, stop: Stop | None) -> Boarding | str:
    if boarding.who is Who.ABOARD:
        return boarding
    if boarding.who is Who.EMPTY and stop is not None and not stop.arrived:
        return f"no robot can be in place, because the car has not arrived at {stop.floor}; say it once the robot is inside"
    return Boarding(Who.ABOARD)


def _left(boarding: Boarding) -> Boarding | str:
    if boarding.who is Who.ABOARD and boarding.may_leave_at is None:
        return "no robot can have left, because the door has not stood open for it; say it once the robot is outside"
    return Boarding() if boarding.who is Who.EMPTY else Boarding(Who.LEFT)


def _taken_along(boarding: Boarding) -> Boarding:
    """Carry a doubt into a session of its own: the robot may have entered before it, so every floor asked for is a ride."""
    return Boarding(Who.MAY_BOARD, sent_on=True) if boarding.who is Who.MAY_BOARD else boarding


def _sent_on(boarding: Boarding, stop: Stop, rules: Rules, now: float) -> Boarding | str:
    """Take another floor than the session's stop."""
    if boarding.who is Who.ABOARD:
        return replace(boarding, may_leave_at=None)
    if boarding.who is not Who.MAY_BOARD or not rules.matters:
        return Boarding(sent_on=possible(boarding))
    unknown = f"a robot may have entered the car at {stop.floor}"
    if not rules.infer:
        return f"{unknown}; say that the robot is in place, or set `infer_occupancy: true` in the site file"
    if not stop.open:
        return (
            f"{unknown}, but the car does not stand open for it there now; say that the robot is in place, or ask again"
        )
    open_for_s = now - (boarding.open_since if boarding.open_since is not None else now)
    if open_for_s < rules.board_min_s:
        return (
            f"{unknown}: its door has stood open for {open_for_s:.1f} s, and a robot counts as aboard after"
            f" {rules.board_min_s:g} s; say that the robot is in place, or ask again"
        )
    return Boarding(Who.ABOARD)
