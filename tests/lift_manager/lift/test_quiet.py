"""What counts as under way on a lift, so that another configuration has to wait."""

from dataclasses import replace

from lift_manager.lift.inputs import Acknowledge, EndSession
from lift_manager.lift.quiet import under_way
from register_maps.words import Door
from tests.lift_manager.lift.paper import OTHER, PaperLift


def shown(lift: PaperLift) -> str:
    return under_way(lift.config, lift.record, lift.moment)


def test_nothing_is_under_way_on_a_lift_that_stands_or_cannot_be_read() -> None:
    lift = PaperLift()
    assert shown(lift) == ""
    lift.read("L1", Door.CLOSED)
    assert shown(lift) == ""


def test_a_session_is_under_way_until_it_is_over_and_everything_is_released() -> None:
    lift = PaperLift()
    lift.read("L1", Door.CLOSED)
    lift.open()
    assert shown(lift) == "a session"
    lift.take(EndSession(OTHER, 0.0))
    lift.wait(2.0)
    assert shown(lift) == ""


def test_a_robot_that_may_be_in_the_car_is_under_way_until_a_person_has_looked() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    assert shown(lift) == "a robot may be in the car"
    lift.wait(400.0)
    assert lift.record.session is None
    assert shown(lift) == "a robot may be in the car"
    lift.take(Acknowledge("Anna Berg"))
    lift.read("L2", Door.CLOSED)
    lift.wait(10.0)
    assert shown(lift) == ""


def test_a_fire_is_under_way_until_a_person_has_acknowledged_it() -> None:
    lift = PaperLift()
    lift.read("L1", Door.CLOSED, fire=True)
    assert shown(lift) == "a fire"
    lift.read(fire=False)
    assert shown(lift) == "a fire"
    lift.take(Acknowledge("Anna Berg"))
    assert shown(lift) == ""


def test_a_session_that_is_saved_is_under_way_although_no_manager_has_it_yet() -> None:
    lift = PaperLift()
    lift.read("L1", Door.CLOSED)
    lift.open()
    saved = replace(lift.record.durable)
    assert shown(lift) == "a session"
    lift.record = lift.record.having(session=None, durable=saved)
    assert shown(lift) == "a session"
