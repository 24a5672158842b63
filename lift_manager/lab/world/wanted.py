"""Which outputs the holder of a lift has requested: of what kind, at which floor. Pure."""

from __future__ import annotations

from lift_manager.lab.world.judged import Judged
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lift.occupancy import RobotWord

CLOSES_WITHIN_S = 10.0
"""How long a door may be told to close: the longest `max_hold_s` of a close button in the shipped maps."""


def is_requested(
    about: Judged,
    name: str,
    floor: int,
    truth: Truth,
    requests: tuple[FloorRequest, FloorRequest],
    *,
    on_s: float,
    owes_word: bool,
) -> bool:
    """Whether what the holder requested last needs this output, which has been on for `on_s`.

    `floor` is the index of that of a call; `requests` are its last one and the last one for another floor. `owes_word` says that the
    robot is inside, and that the lift was not told of it.
    """
    last, before = requests
    kind = name.partition(".")[0]
    at_stop = truth.at == last.floor
    match kind:
        case "hold_door":
            # behind doors that are shut a hold cannot be in the way of anything; for a robot inside a hold that is on may stay
            wants = last.hold_door or last.robot is RobotWord.IN_PLACE
            return wants and (at_stop or truth.at is None) and on_s <= about.max_session_hold_s
        case "close_door":
            return not (last.hold_door and at_stop) and on_s <= CLOSES_WITHIN_S
        case "go_to" | "call" | "go":
            # the call that brought the car stays until the lift is told that the robot is inside, however long that takes
            stays = about.handshake and (owes_word or about.floors[floor] == before.floor)
            return about.floors[floor] == last.floor or stays
        case _:
            return True
