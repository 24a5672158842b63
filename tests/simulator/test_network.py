"""What the controller believes of its network: watchdog, robot mode, stuck buttons, presses without an edge."""

from dataclasses import replace

from register_maps.words import Door, Side
from tests.simulator.bench import FRONT, PLAIN, SCAN_S, Lift, all_closed, floors, opened
from tests.support.rows import each_row

HOLD = {"hold_door.front": 1}
CALLED, IN_ROBOT_MODE = {"go_to": 3}, {"robot_mode": 1}
NOTHING: dict[str, int] = {}
WATCHED = replace(PLAIN, hold_watchdog_s=2.0, watched=frozenset({"hold_door.front", "robot_mode"}))
STUCK = replace(PLAIN, drops_stuck_button_s=5.0)
LIMITED = replace(PLAIN, released_after_s={"hold_door.front": 5.0})
EDGE = replace(PLAIN, needs_edge_s=0.5)


# -- the watchdog


def test_a_watched_hold_falls_without_a_sign_of_life() -> None:
    lift = Lift(WATCHED)
    lift.run(1.9, commands=HOLD, signs_of_life=1)
    assert lift.see().doors[Side.FRONT] is Door.OPENING
    lift.run(3.4)
    assert lift.see().doors[Side.FRONT] is Door.CLOSING
    assert all_closed(lift.run(60))


def test_a_watched_hold_renewed_in_time_lasts() -> None:
    lift = Lift(WATCHED)
    for sign in range(20):
        lift.run(1.8, commands=HOLD, signs_of_life=sign)
    assert opened(lift, Side.FRONT)


def test_a_sign_of_life_after_the_watchdog_has_let_go_brings_the_hold_back() -> None:
    lift = Lift(WATCHED)
    assert all_closed(lift.run(60, commands=HOLD, signs_of_life=1))
    assert lift.run(2 * SCAN_S, signs_of_life=2).doors[Side.FRONT] is Door.OPENING


def test_the_watchdog_runs_on_real_time_however_fast_the_lift_is() -> None:
    lift = Lift(replace(WATCHED, speed=20.0))
    assert lift.run(1.9, commands=HOLD, signs_of_life=1).doors[Side.FRONT] is Door.OPEN
    assert all_closed(lift.run(0.5))


def test_the_watchdog_ends_robot_mode_of_the_network_but_not_that_of_the_key() -> None:
    by_request, by_key = Lift(WATCHED), Lift(replace(WATCHED, robot_mode_delay_s=0.0))
    assert by_request.run(1, commands=IN_ROBOT_MODE, signs_of_life=1).robot_mode_on
    assert not by_request.run(1.2).robot_mode_on
    assert by_key.run(60, robot_mode_request=True).robot_mode_on


def test_what_is_not_watched_lasts_and_neither_does_a_finger_tire() -> None:
    latching, finger = Lift(replace(WATCHED, watched=frozenset())), Lift(WATCHED)
    assert latching.run(600, commands=HOLD).door_open_floor == 0
    assert finger.run(600, hold_door=FRONT).door_open_floor == 0


def test_the_watchdog_has_tripped_once_it_has_let_go_of_something_until_a_sign_of_life() -> None:
    lift = Lift(WATCHED)
    assert not lift.run(60).watchdog_tripped, "nobody asks for anything"
    assert not lift.run(1.9, commands=HOLD, signs_of_life=1).watchdog_tripped
    assert lift.run(0.2).watchdog_tripped
    assert lift.run(60).watchdog_tripped
    assert not lift.run(SCAN_S, signs_of_life=2).watchdog_tripped


# -- robot mode


def test_a_command_for_robot_mode_only_counts_from_its_grant() -> None:
    lift = Lift(replace(PLAIN, robot_mode_only=frozenset({"go_to"})))
    assert lift.run(5, commands=CALLED).destination is None
    assert lift.run(1, commands=CALLED | IN_ROBOT_MODE).destination == 3


# -- a controller that drops a stuck button


def test_a_hold_that_stays_on_too_long_counts_as_let_go() -> None:
    lift = Lift(STUCK)
    assert lift.run(4.9, commands=HOLD).doors[Side.FRONT] is Door.OPEN
    assert lift.run(3.0).doors[Side.FRONT] is Door.OPEN, "dwell"
    assert all_closed(lift.run(3.0))
    assert all_closed(lift.run(600))


def test_a_dropped_hold_counts_again_once_it_was_let_go() -> None:
    lift = Lift(STUCK)
    assert all_closed(lift.run(60, commands=HOLD))
    lift.run(2 * SCAN_S, commands=NOTHING)
    assert lift.run(3, commands=HOLD).doors[Side.FRONT] is Door.OPEN


def test_a_hold_pressed_anew_in_time_is_never_dropped() -> None:
    lift = Lift(STUCK)
    for _ in range(20):
        lift.run(0.5, commands=HOLD)
        lift.run(2.5, commands=NOTHING)
    assert lift.see().doors[Side.FRONT] is Door.OPEN


def test_a_finger_on_the_button_and_a_call_that_stays_on_are_not_dropped() -> None:
    lift = Lift(STUCK)
    assert lift.run(60, hold_door=FRONT, commands=CALLED).door_open_floor == 0
    assert lift.see().car_calls == floors(3)


# -- a controller that lets a held door go by itself


def test_a_hold_falls_when_its_time_is_over_however_long_it_stays_on_and_the_door_does_not_wait() -> None:
    lift = Lift(LIMITED)
    assert lift.run(4.9, commands=HOLD).doors[Side.FRONT] is Door.OPEN
    assert lift.run(0.3).doors[Side.FRONT] is Door.CLOSING
    assert all_closed(lift.run(600))


def test_a_hold_that_was_let_go_has_its_whole_time_again() -> None:
    lift = Lift(LIMITED)
    lift.run(4.0, commands=HOLD)
    lift.run(2 * SCAN_S, commands=NOTHING)
    assert lift.run(4.9, commands=HOLD).doors[Side.FRONT] is Door.OPEN
    assert all_closed(lift.run(5.0))


def test_pulses_of_one_hold_share_its_time() -> None:
    pulsed = Lift(replace(LIMITED, pauses_s={"hold_door.front": 2.0}))
    for _ in range(4):
        pulsed.run(0.5, commands=HOLD)
        pulsed.run(1.0, commands=NOTHING)
    assert pulsed.run(0.2, commands=HOLD).doors[Side.FRONT] is not Door.OPEN
    pulsed.run(2.5, commands=NOTHING)
    assert pulsed.run(4.9, commands=HOLD).doors[Side.FRONT] is Door.OPEN


def test_a_call_from_a_landing_opens_the_door_behind_a_hold_whose_time_is_over() -> None:
    lift = Lift(LIMITED)
    assert all_closed(lift.run(60, commands=HOLD))
    assert lift.run(2, landing_buttons=floors(0)).doors[Side.FRONT] is Door.OPENING


# -- a controller that needs an edge


@each_row(("rest_s", "counts"), [(0.1, False), (0.35, False), (0.5, True), (2.0, True)])
def test_a_press_counts_only_after_rest(rest_s: float, *, counts: bool) -> None:
    lift = Lift(EDGE)
    lift.run(1, commands=HOLD)
    lift.run(rest_s, commands=NOTHING)
    # what opened the door before is over: dwell and closing
    after = lift.run(20, commands=HOLD)
    assert (after.doors[Side.FRONT] is Door.OPEN) is counts


def test_the_first_press_of_all_counts_and_lasts() -> None:
    lift = Lift(EDGE)
    assert lift.run(60, commands=HOLD).doors[Side.FRONT] is Door.OPEN


def test_a_change_from_one_floor_to_another_without_rest_is_no_call() -> None:
    lift = Lift(EDGE)
    lift.run(1, commands={"go_to": 2})
    assert lift.run(1, commands={"go_to": 4}).car_calls == floors(2)
    lift.run(0.5, commands=NOTHING)
    assert lift.run(1, commands={"go_to": 4}).car_calls == floors(2, 4)


def test_without_these_settings_every_change_counts() -> None:
    lift = Lift()
    lift.run(1, commands={"go_to": 2})
    assert lift.run(1, commands={"go_to": 4}).car_calls == floors(2, 4)
    assert lift.see().accepted == 4
