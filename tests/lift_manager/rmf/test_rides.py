"""Whole rides with each distribution's supervisor and fleet adapter, through everything that open-rmf.md section 6 lists."""

from dataclasses import replace

from lift_manager.lab.world.truth import Truth
from tests.support.rmf.events import (
    AdapterRestarts,
    Ends,
    Event,
    Fire,
    LockedOut,
    ManagerRestarts,
    OtherFace,
    Panel,
    Repeats,
    Ride,
    Script,
    SupervisorRestarts,
    Unplugged,
    WayCut,
    WebEnd,
    WebRequest,
)
from tests.support.rmf.playing import STARTS_S, Played, play
from tests.support.rmf.supervisors import SUPERVISORS
from tests.support.rmf.world import Setting
from tests.support.rows import each_row

ALL = tuple(SUPERVISORS)
A, B = "fleet_1/robot_1", "fleet_2/robot_2"
RIDE = Ride(0.0, A, pickup=1, destination=3, drives_s=2.0)
IN_THE_DOOR, UNDER_WAY = 3.0, 7.0
"""When the robot of that ride is there, with every distribution."""


def played(distribution: str, *events: Event, way_s: float = 0.0) -> Played:
    """What became of it; nothing may have gone wrong, and nobody had to help."""
    found = play(Setting(distribution=distribution, seed=7, speed=5.0, way_s=way_s, poll_s=0.4), events)
    assert [str(one) for one in found.findings] == []
    assert found.helped == 0
    return found


def truth(found: Played, at: float) -> Truth:
    assert found.judge is not None
    one = found.judge.truth.at(STARTS_S + at)
    assert one is not None
    return one


@each_row("distribution", ALL)
def test_two_robots_of_two_fleets_ride_in_turn_and_each_calls_twice(distribution: str) -> None:
    found = played(distribution, RIDE, Ride(0.5, B, pickup=2, destination=1, drives_s=1.0))
    assert found.rides == 2
    assert found.presses == 4
    assert truth(found, IN_THE_DOOR).open_at == "L2"
    assert not truth(found, UNDER_WAY).standing


@each_row("distribution", ALL)
def test_a_crowded_lift_is_asked_for_again_and_a_new_plan_under_way_changes_the_floor(distribution: str) -> None:
    found = played(distribution, replace(RIDE, crowded=1, replans_after_s=1.2), way_s=0.02)
    assert found.rides == 1
    assert found.presses >= 3


@each_row("distribution", ALL)
def test_supervisor_and_adapter_restart_in_the_door_and_under_way_and_nothing_physical_changes(
    distribution: str,
) -> None:
    found = played(
        distribution,
        RIDE,
        SupervisorRestarts(IN_THE_DOOR, 0.3),
        SupervisorRestarts(UNDER_WAY, 0.1),
        AdapterRestarts(IN_THE_DOOR + 1.0, 0.3),
        AdapterRestarts(UNDER_WAY + 0.2, 0.3),
    )
    assert found.rides == 1
    assert found.presses == 2


@each_row("distribution", ALL)
def test_old_floors_and_ends_are_replayed_and_none_of_them_reaches_the_lift(distribution: str) -> None:
    before = [replace(RIDE, destination=2), Ride(0.0, B, pickup=1, destination=3, drives_s=1.0)]
    last = Ride(30.0, "fleet_1/robot_3", pickup=1, destination=0, drives_s=1.0)
    found = played(distribution, *before, last, SupervisorRestarts(31.0, 0.1))
    assert found.rides == 3
    assert found.presses == 6


TROUBLES: dict[str, tuple[Event, ...]] = {
    "END of its own for an unknown floor": (Ends(UNDER_WAY, A, "the moon", 1, 0.01),),
    "END of its own again and again": (Ends(UNDER_WAY, A, "", 20, 0.1),),
    "an END in rmf-web": (WebEnd(UNDER_WAY, A, 0),),
    "a request of rmf-web": (WebRequest(20.0, 0, 3.0),),
    "the demo script": (Script(UNDER_WAY, 0),),
    "a panel": (Panel(20.0, 0, 3.0),),
    "requests at 50 Hz": (Repeats(0.0, 500, 0.02),),
    "a manager that restarts": (ManagerRestarts(UNDER_WAY, 0.5),),
    "a manager that restarts with the robot in the door": (ManagerRestarts(IN_THE_DOOR, 0.5),),
    "a cut way": (WayCut(UNDER_WAY, 2.0),),
    "a lift that is offline": (Unplugged(UNDER_WAY, 4.0),),
    "a fire": (Fire(UNDER_WAY, 4.0),),
    "a lockout before": (LockedOut(0.5, 4.0),),
    "another face before": (OtherFace(0.0, 0, 5.0),),
    "another face that waits": (OtherFace(3.0, 0, 20.0),),
}


@each_row("trouble", TROUBLES)
def test_a_robot_gets_where_it_wants_through(trouble: str) -> None:
    later = Ride(6.0, A, pickup=1, destination=2) if trouble == "another face before" else RIDE
    found = played("kilted", later, *TROUBLES[trouble], way_s=0.01)
    assert found.rides == 1
