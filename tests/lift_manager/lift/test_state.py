"""What is published about a lift, and when it counts as news."""

from dataclasses import replace

import pytest

from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality, same_but_for_time
from register_maps.words import Mode, Motion

OFFLINE = LiftState(
    lift="lift",
    floors=("L1", "L2"),
    quality=Quality.OFFLINE,
    reason="nothing newer within 1 s: plc: waits for the first change of its alive counter, 0.4 s so far (limit 3 s)",
    age_s=None,
    floor=None,
    standing=False,
    destination=None,
    robot_door=RobotDoor.MOVING,
    doors={},
    motion=Motion.UNKNOWN,
    mode=Mode.UNKNOWN,
    holder=None,
    held_since_s=None,
    not_visible={},
)


@pytest.mark.parametrize(
    "later",
    [
        replace(OFFLINE, age_s=2.0, held_since_s=1.0, releases_in_s=3.0, releases_at=9.0),
        replace(OFFLINE, reason=OFFLINE.reason.replace("0.4 s", "12.5 s")),
    ],
)
def test_the_passing_of_time_alone_is_no_news(later: LiftState) -> None:
    assert same_but_for_time(OFFLINE, later)


@pytest.mark.parametrize(
    "other",
    [
        replace(OFFLINE, holder=Holder("rmf", "robot1")),
        replace(OFFLINE, reason=OFFLINE.reason.replace("plc", "plc2")),
        replace(OFFLINE, reason="nothing newer within 1 s: no connection"),
        replace(OFFLINE, ending=True),
    ],
)
def test_another_holder_or_another_reason_is_news(other: LiftState) -> None:
    assert not same_but_for_time(OFFLINE, other)
