"""What is declared to be on, until when, when a lift is looked at again, and what a reading without news costs."""

from dataclasses import replace

from drivers.model import LiftReading, OutputState
from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.inputs import Cancel, OutputChanged, Reading, Restrict, Tick
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.record import DurableRecord
from lift_manager.lift.state import same_but_for_time
from lift_manager.lift.step import PAST_S
from register_maps.words import Door, Mode, Motion
from tests.lift_manager.lift.paper import HANDSHAKE, PLAIN, PaperLift


def test_holds_fall_by_themselves_when_no_reading_comes() -> None:
    lift = PaperLift(replace(PLAIN, max_hold_s={"hold_door.front": 30.0}))
    lift.called_to("L2")
    lift.now += 5.0
    assert lift.read_at + 29.0 <= lift.holds["hold_door.front"].until <= lift.read_at + 30.0


def test_a_held_call_is_renewed_only_while_its_door_is_held() -> None:
    lift = PaperLift(replace(HANDSHAKE, max_hold_s={"call": 300.0}))
    lift.called_to("L2")
    lift.wait(60.0)
    assert lift.read_at + 299.0 <= lift.holds["call"].until <= lift.read_at + 300.0


def test_a_call_that_the_controller_lost_is_not_pressed_again_by_itself() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.called_to("L2")
    lift.status["call"] = OutputState.AT_REST
    lift.take(OutputChanged(dict(lift.status)))
    lift.wait(1.0)
    assert lift.log == ["call L2"]
    assert "to send another request" in lift.state.restrictions.waiting_for
    assert lift.door is RobotDoor.MOVING
    lift.wait(2.0)
    lift.accept("L2")
    lift.wait(0.5)
    assert lift.log == ["call L2", "call L2"]


def test_a_door_hold_that_is_lost_withdraws_open() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    lift.take(OutputChanged({**lift.status, "hold_door.front": OutputState.ON}))
    assert lift.door is RobotDoor.MOVING


def test_a_door_that_has_to_be_seen_shut_is_not_put_on_hold() -> None:
    lift = PaperLift(durable=DurableRecord())
    lift.read("L2", Door.OPEN)
    lift.accept("L2")
    lift.wait(1.0)
    assert "hold_door.front" not in {name for name, hold in lift.holds.items() if hold.begin}
    assert "proof" in lift.state.restrictions.waiting_for


def test_an_unchanged_reading_of_an_idle_lift_is_no_news() -> None:
    lift = PaperLift()
    lift.read()
    assert lift.repeats(LiftReading(lift.now + 0.2, 1, lift.values))
    assert not lift.repeats(LiftReading(lift.now + 0.2, 2, lift.values))
    assert not lift.repeats(LiftReading(lift.now + 5.0, 1, lift.values))
    assert not lift.repeats(LiftReading(lift.now + 0.2, 1, lift.values, ("a notice",)))


def test_a_restart_keeps_a_call_until_the_car_has_arrived_and_the_door_hold_from_then_on() -> None:
    able = replace(PLAIN, until={"go_to": "arrived"}, held_commands=PLAIN.held_commands | {"go_to"})
    called = PaperLift(able)
    called.read()
    called.accept("L2")
    called.wait(0.5)
    called.status["go_to"] = OutputState.ON
    called.answer()
    assert called.restarted().holds.keys() == {"go_to", "robot_mode"}
    arrived = PaperLift(able)
    arrived.called_to("L2")
    after = arrived.restarted()
    # the two may exclude each other: a call that is declared for nothing would be released first, and the hold with it
    assert after.holds.keys() == {"hold_door.front", "robot_mode"}


def test_a_lift_that_is_not_read_is_looked_at_when_its_reading_gets_too_old() -> None:
    lift = PaperLift()
    lift.read()
    assert lift.newest.wake_at == lift.now + 1.0 + PAST_S
    lift.now = lift.newest.wake_at
    lift.take(Tick())
    assert lift.state.quality == "offline"
    assert lift.state.floor is None
    assert lift.state.mode is Mode.UNKNOWN


def test_the_lift_is_looked_at_when_open_is_withdrawn_and_when_the_door_is_released() -> None:
    lift = PaperLift(site={"max_session_hold_s": 20.0, "clear_s": 5.0, "lease_s": 300.0})
    lift.called_to("L2")
    assert lift.record.session is not None
    assert lift.record.session.holding_since is not None
    lift.now = lift.record.session.holding_since + 14.9
    lift.poll()
    lift.take(Tick())
    assert lift.newest.wake_at == lift.record.session.holding_since + 15.0


def test_a_reading_that_took_too_long_counts_as_none() -> None:
    lift = PaperLift()
    reading = LiftReading(lift.now, 1, lift.values)
    lift.now += 1.5
    lift.take(Reading(reading, {}))
    assert lift.state.quality == "offline"
    assert "answers too late" in lift.state.reason


def test_states_that_differ_only_in_time_are_the_same() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    before = lift.state
    lift.wait(1.0)
    assert same_but_for_time(before, lift.state)
    lift.read(None, Door.CLOSED, motion=Motion.UP)
    assert not same_but_for_time(before, lift.state)


def test_a_restored_hold_lasts_before_the_first_reading() -> None:
    lift = PaperLift(replace(PLAIN, max_hold_s={"hold_door.front": 30.0, "robot_mode": 20.0}))
    lift.called_to("L2")
    after = lift.restarted()
    assert {name: hold.until - after.now for name, hold in after.holds.items()} == {
        "hold_door.front": 30.0,
        "robot_mode": 20.0,
    }


def test_a_hold_is_not_renewed_in_the_time_that_a_fire_gives_a_robot() -> None:
    lift = PaperLift(replace(PLAIN, max_hold_s={"hold_door.front": 30.0}), site={"fire_release_delay_s": 3.0})
    lift.called_to("L2")
    until = lift.holds["hold_door.front"].until
    lift.read(mode=Mode.FIRE)
    lift.wait(2.0)
    assert lift.holds["hold_door.front"].until == until


def test_what_the_map_requires_and_the_lift_no_longer_gives_ends_a_hold() -> None:
    lift = PaperLift(replace(PLAIN, requires={"hold_door.front": frozenset({"robot_mode_on"})}))
    lift.called_to("L2")
    assert "hold_door.front" in lift.holds
    lift.read(robot_mode_on=False)
    assert "hold_door.front" not in lift.holds


def test_a_pulse_that_is_still_on_is_taken_back_with_its_session() -> None:
    lift = PaperLift()
    lift.read()
    lift.accept("L2")
    (press,) = lift.pressed
    lift.answer()
    lift.status["go_to"] = OutputState.ON
    lift.take(OutputChanged(dict(lift.status)))
    lift.take(Restrict(RestrictionKind.LOCKOUT, "ann", "new ropes", at_once=True))
    assert Cancel(press.id) in lift.cancelled


def test_a_held_call_is_released_before_the_call_to_another_floor() -> None:
    lift = PaperLift(HANDSHAKE)
    lift.read()
    lift.accept("L2")
    (press,) = lift.pressed
    lift.answer()
    lift.accept("L3")
    assert lift.cancelled == [Cancel(press.id)]
    assert lift.log == ["call L2", "call L3"]


def test_a_robot_in_the_door_has_its_time_though_the_hold_is_in_doubt() -> None:
    lift = PaperLift()
    lift.called_to("L2")
    lift.obeys = False
    lift.status["hold_door.front"] = OutputState.ON
    lift.take(OutputChanged(dict(lift.status)))
    assert lift.door is RobotDoor.MOVING
    lift.take(Restrict(RestrictionKind.LOCKOUT, "ann", "new ropes"))
    lift.wait(9.0)
    assert "hold_door.front" in lift.holds
    lift.wait(2.0)
    assert "hold_door.front" not in lift.holds
