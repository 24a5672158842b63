"""Where the session's robot is, as far as its reports show: outside, maybe boarding, aboard, or out of the car again.

A lift that distinguishes the empty car from the occupied one must learn the truth about it. A robot's own report settles it. From
a caller that cannot report, its robot's place is inferred from its requests, and only if the site allows that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum, unique

from drivers.model import Capabilities, FloorName
from lift_manager.lift.config import LiftConfig
from register_maps.vocabulary import HANDSHAKE


@unique
class RobotWord(StrEnum):
    """What a robot reports of itself; faces that cannot report it leave it out."""

    IN_PLACE = "in_place"
    """It is in the car and may be taken along."""
    LEFT = "left"
    """It is out of the car and clear of the door."""


@unique
class Occupancy(StrEnum):
    """Where the session's robot is."""

    OUTSIDE = "empty"
    """Not aboard: the car has not stood open for it yet."""
    MAY_BOARD = "may_board"
    """The car stood open for it: it may be outside, inside, or in between."""
    ABOARD = "aboard"
    EXITED = "left"
    """It got out, and the car has not been called for another one."""


@dataclass(frozen=True, slots=True)
class BoardingProgress:
    """What is known of the session's robot."""

    occupancy: Occupancy = Occupancy.OUTSIDE
    open_since: float | None = None
    """When the door first stood open for it to enter."""
    may_leave_at: FloorName | None = None
    """Where the door last stood open for it to leave; None once the car has moved on."""
    sent_on: bool = False
    """Since it was last known outside, the car was sent on from a stop where it may have entered, without a report whether it did."""

    @property
    def may_be_in_car(self) -> bool:
        """Whether the robot may be in the car."""
        return self.sent_on or self.occupancy in (Occupancy.MAY_BOARD, Occupancy.ABOARD)

    @property
    def reported(self) -> Occupancy:
        """Where the robot is, as far as it is known: one that was sent on without a report may be inside."""
        unsure = self.occupancy is Occupancy.OUTSIDE and self.sent_on
        return Occupancy.MAY_BOARD if unsure else self.occupancy


@dataclass(frozen=True, slots=True)
class SavedBoarding:
    """What of a session's robot outlives the manager; how long its door had stood open does not."""

    occupancy: Occupancy = Occupancy.OUTSIDE
    sent_on: bool = False
    may_leave_at: FloorName | None = None
    in_place_taken: bool = False
    """The lift has taken that the robot is in place."""


@dataclass(frozen=True, slots=True)
class Stop:
    """The session's stop, at the moment of a request."""

    floor: FloorName
    has_arrived: bool
    """The session's call is fulfilled."""
    is_open: bool
    """The car stands there with its door open, and a robot may enter."""


@unique
class OccupancyAtEnd(StrEnum):
    """How the robot of a session and the lift part when the session ends."""

    DONE = "done"
    EXITED = "exited"
    """It got out, and the lift has to know."""
    DOUBT = "doubt"
    """It is, or may be, in the car."""


def occupancy_matters(capabilities: Capabilities) -> bool:
    """Whether this lift distinguishes an occupied car from an empty one."""
    return capabilities.needs_occupancy or bool(capabilities.commands & HANDSHAKE)


def is_aboard(boarding: BoardingProgress, capabilities: Capabilities) -> bool | None:
    """Whether the robot counts as aboard; None if that is not reported, and the lift does not need to know."""
    if boarding.occupancy is Occupancy.ABOARD:
        return True
    return False if occupancy_matters(capabilities) or boarding.occupancy is Occupancy.EXITED else None


def boarding_without_session(*, aboard: bool) -> BoardingProgress:
    """Return what is known of a robot whose session ended before a report that it was outside."""
    return BoardingProgress(Occupancy.ABOARD if aboard else Occupancy.MAY_BOARD)


# -- what readings show


def stands_open_to_enter(boarding: BoardingProgress, now: float) -> BoardingProgress:
    """Note that the session's stop stands open for a robot outside."""
    if boarding.occupancy is Occupancy.OUTSIDE:
        return BoardingProgress(Occupancy.MAY_BOARD, open_since=now, sent_on=boarding.sent_on)
    if boarding.occupancy is Occupancy.MAY_BOARD and boarding.open_since is None:
        return replace(boarding, open_since=now)
    return boarding


def stands_open_to_leave(boarding: BoardingProgress, floor: FloorName) -> BoardingProgress:
    """Note that the door stands open for the robot aboard."""
    return replace(boarding, may_leave_at=floor) if boarding.occupancy is Occupancy.ABOARD else boarding


def car_observed_at(boarding: BoardingProgress, floor: FloorName | None, *, under_way: bool) -> BoardingProgress:
    """Forget that the robot could leave once the car is seen elsewhere, or under way with its doors shut.

    A car that reports no floor may still stand there.
    """
    if not under_way and (floor is None or boarding.may_leave_at in (None, floor)):
        return boarding
    return replace(boarding, may_leave_at=None)


# -- what requests show


def boarding_by_request(
    boarding: BoardingProgress,
    floor: FloorName,
    word: RobotWord | None,
    stop: Stop | None,
    config: LiftConfig,
    now: float,
) -> BoardingProgress | str:
    """Take a request of the holder, or return why it cannot be taken. `stop` is None if there is no session yet."""
    after: BoardingProgress | str = boarding
    if word is RobotWord.IN_PLACE:
        after = _robot_in_place(boarding, stop)
    elif word is RobotWord.LEFT:
        after = _robot_left(boarding)
    if isinstance(after, str):
        return after
    if stop is None:
        # a doubt continues in a session of its own: the robot may have entered before it, so every floor is a ride
        return BoardingProgress(Occupancy.MAY_BOARD, sent_on=True) if after.occupancy is Occupancy.MAY_BOARD else after
    return after if floor == stop.floor else _sent_on(after, stop, config, now)


def has_exited(
    boarding: BoardingProgress, floor: FloorName, word: RobotWord | None, target: FloorName | None, config: LiftConfig
) -> bool:
    """Whether a release means that the robot got out: by a report, or because it is made at the target."""
    if boarding.occupancy is not Occupancy.ABOARD or boarding.may_leave_at is None:
        return False
    is_inferred = config.infer_occupancy and floor == target == boarding.may_leave_at
    return word is RobotWord.LEFT or is_inferred


def leaves_doubt(
    boarding: BoardingProgress, *, released: bool, word: RobotWord | None, arrived: bool, has_words: bool, let_out: bool
) -> bool:
    """Whether the end of a session leaves it open whether its robot is in the car.

    `released` means that its holder ended it. A holder that releases, or only wanted to arrive, is done, unless its robot was
    aboard on the way, or may have been sent on and the door has not stood open for it since (`let_out`). One that `has_words` has
    to report that its robot left.
    """
    if released:
        if has_words and word is not RobotWord.LEFT:
            return boarding.may_be_in_car
        return boarding.occupancy is Occupancy.ABOARD or (boarding.sent_on and not let_out)
    if arrived:
        return boarding.sent_on or boarding.occupancy is Occupancy.ABOARD
    return boarding.may_be_in_car


def _robot_in_place(boarding: BoardingProgress, stop: Stop | None) -> BoardingProgress | str:
    if boarding.occupancy is Occupancy.ABOARD:
        return boarding
    if boarding.occupancy is Occupancy.OUTSIDE and stop is not None and not stop.has_arrived:
        return f"no robot can be in place, because the car has not arrived at {stop.floor}; report it once the robot is inside"
    return BoardingProgress(Occupancy.ABOARD)


def _robot_left(boarding: BoardingProgress) -> BoardingProgress | str:
    if boarding.occupancy is Occupancy.ABOARD and boarding.may_leave_at is None:
        return "no robot can have left, because the door has not stood open for it; report it once the robot is outside"
    return BoardingProgress() if boarding.occupancy is Occupancy.OUTSIDE else BoardingProgress(Occupancy.EXITED)


def _sent_on(boarding: BoardingProgress, stop: Stop, config: LiftConfig, now: float) -> BoardingProgress | str:
    """Take another floor than the session's stop."""
    if boarding.occupancy is Occupancy.ABOARD:
        return replace(boarding, may_leave_at=None)
    if boarding.occupancy is not Occupancy.MAY_BOARD or not occupancy_matters(config.capabilities):
        return BoardingProgress(sent_on=boarding.may_be_in_car)
    unknown = f"a robot may have entered the car at {stop.floor}"
    if not config.infer_occupancy:
        return f"{unknown}; report that the robot is in place, or set `infer_occupancy: true` in the site file"
    if not stop.is_open:
        return (
            f"{unknown}, but the car does not stand open for it there now;"
            " report that the robot is in place, or send another request"
        )
    open_for_s = now - (boarding.open_since if boarding.open_since is not None else now)
    if open_for_s < config.board_min_s:
        return (
            f"{unknown}: its door has stood open for {open_for_s:.1f} s, and a robot counts as aboard after"
            f" {config.board_min_s:g} s; report that the robot is in place, or send another request"
        )
    return BoardingProgress(Occupancy.ABOARD)
