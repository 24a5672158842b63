"""Decides which outputs the requests of a holder justify. Pure."""

from __future__ import annotations

from lift_manager.lab.world.lift_under_test import LiftUnderTest
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lift.occupancy import RobotWord

CLOSES_WITHIN_S = 10.0
"""How long a close button may be held: the longest `max_hold_s` in the shipped maps."""


def is_output_requested(
    about: LiftUnderTest,
    name: str,
    floor: int,
    truth: Truth,
    requests: tuple[FloorRequest, FloorRequest],
    *,
    on_s: float,
    report_due: bool,
) -> bool:
    """Whether the last request of the holder needs this output, which has been on for `on_s`.

    `floor` is the index of the floor of a call. `requests` are the last request and the last one for another floor. `report_due` means
    that the robot is inside and the lift does not know it yet.
    """
    last, before = requests
    kind = name.partition(".")[0]
    at_stop = truth.at == last.floor
    match kind:
        case "hold_door":
            # between floors a hold does no harm; a hold that is on may stay on for a robot inside
            needs_hold = last.hold_door or last.robot is RobotWord.IN_PLACE
            return needs_hold and (at_stop or truth.at is None) and on_s <= about.max_session_hold_s
        case "close_door":
            return not (last.hold_door and at_stop) and on_s <= CLOSES_WITHIN_S
        case "go_to" | "call" | "go":
            # the call that brought the car stays on until the lift knows that the robot is inside, however long that takes
            stays = about.handshake and (report_due or about.floors[floor] == before.floor)
            return about.floors[floor] == last.floor or stays
        case _:
            return True
