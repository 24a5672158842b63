"""The robot handshake when it goes wrong: nobody is stranded, and a robot left aboard is not forgotten."""

from dataclasses import replace

import pytest

from drivers.model import Result
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from register_maps.words import Door, Mode, Motion
from tests.lift_manager.runtime.scripted import OTHER, PERMITTING, PLAIN, TWO_STOP, Bench, abandoned, boarded, on_bench
from tests.support.virtual_time import elapse

IN_PLACE, LEFT = RobotWord.IN_PLACE, RobotWord.LEFT


def test_a_fire_with_a_robot_aboard_lets_everything_go_and_raises_the_alarm() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.mode(Mode.FIRE)
        await abandoned(made)
        await made.mode(Mode.NORMAL)
        assert made.refuse("L3", LEFT).code is Refusal.FIRE_LATCHED
        made.accept("L2", LEFT, hold=False)
        await elapse(10)
        assert "robot_left" not in made.presses
        assert made.driver.on == set()

    on_bench(check)


@pytest.mark.parametrize("mode", [Mode.INSPECTION, Mode.OUT_OF_SERVICE, Mode.EMERGENCY])
def test_a_mode_without_robots_ends_the_ride_and_raises_the_alarm(mode: Mode) -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.mode(mode)
        await abandoned(made)

    on_bench(check)


def test_a_lease_that_ends_with_a_robot_aboard_raises_the_alarm() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await elapse(31)
        await abandoned(made)

    on_bench(check, lease_s=30)


def test_stopping_with_a_robot_aboard_lets_go_and_raises_an_alarm() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.life.stop()
        await elapse(5)
        assert made.state.holder is None
        assert made.driver.on == set()
        assert "robot_left" not in made.presses
        (alarm,) = await made.alarms()
        assert alarm.startswith("stopping: the manager ends while a robot of api:fleet/robot1 may be in the car")

    on_bench(check)


def test_a_level_that_says_occupied_is_let_go_like_every_other_output() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        assert made.driver.on == {"robot_in_place"}
        await elapse(30)
        await abandoned(made)

    on_bench(check, TWO_STOP, lease_s=30)


def test_a_release_on_the_way_abandons_the_robot_and_does_not_say_that_it_left() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.car("L2", Door.CLOSED)
        made.accept("L2", hold=False)
        await elapse(1)
        await abandoned(made)

    on_bench(check, infer=True)


def test_a_release_without_the_word_abandons_the_robot_where_nothing_may_be_inferred() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.accept("L3", hold=False)
        await elapse(1)
        await abandoned(made)

    on_bench(check)


def test_permission_withdrawn_while_the_door_is_open_shows_at_once() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        assert made.robot_door() is RobotDoor.OPEN
        made.driver.values = replace(made.driver.values, flags={"may_enter": False, "may_leave": True})
        await elapse(0.11)
        assert made.robot_door() is RobotDoor.MOVING

    on_bench(check, poll_s=0.1)


def test_nothing_is_inferred_from_a_car_that_stands_open_at_another_floor() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(10)
        await made.car("L2", Door.OPEN, enter=True)
        assert made.refuse("L3").code is Refusal.OCCUPANCY_UNKNOWN

    on_bench(check, infer=True)


def test_nothing_is_inferred_while_the_permission_is_withdrawn() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(10)
        await made.car("L1", Door.OPEN)
        assert made.refuse("L3").code is Refusal.OCCUPANCY_UNKNOWN
        await made.car("L1", Door.OPEN, enter=True)
        made.accept("L3")

    on_bench(check, infer=True)


@pytest.mark.parametrize("result", [Result.REJECTED, Result.UNCONFIRMED])
def test_a_word_in_place_that_failed_is_given_again_only_on_a_repeat_and_after_a_pause(result: Result) -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.answers["robot_in_place"] = result
        made.accept("L3", IN_PLACE)
        await elapse(5)
        assert made.presses == ["call L1", "robot_in_place"]
        assert "call" in made.driver.on
        for _ in range(14):
            made.accept("L3")
            await elapse(1)
        assert made.presses.count("robot_in_place") == pytest.approx(4, abs=1)
        assert not [line for line in made.presses if line.startswith("go")]
        made.driver.answers.clear()
        await elapse(17)
        made.accept("L3")
        await elapse(1)
        assert made.presses[-1] == "go L3"
        assert "call" not in made.driver.on

    on_bench(check)


def test_the_door_is_held_for_a_robot_aboard_until_the_lift_takes_its_word() -> None:
    able = replace(PLAIN, commands=PLAIN.commands | {"robot_in_place", "robot_left"})

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.answers["robot_in_place"] = Result.REJECTED
        made.accept("L3", IN_PLACE)
        await elapse(25)
        assert "hold_door.front" in made.driver.on
        assert made.driver.renewed["hold_door.front"] > 25
        made.driver.answers.clear()
        made.accept("L3")
        await elapse(1)
        assert made.presses[-1] == "go_to L3"
        assert "hold_door.front" not in made.driver.on

    on_bench(check, able)


def test_no_door_is_held_while_the_car_moves_with_a_robot_that_it_was_not_told_of() -> None:
    able = replace(
        PLAIN, commands=PLAIN.commands | {"robot_in_place", "robot_left"}, signals=PLAIN.signals | {"motion"}
    )

    async def check(made: Bench) -> None:
        made.driver.values = replace(made.driver.values, motion=Motion.UP)
        await elapse(0.5)
        made.driver.answers["robot_in_place"] = Result.REJECTED
        made.accept("L3", IN_PLACE)
        await elapse(5)
        assert made.driver.log == ["press robot_in_place"]

    on_bench(check, able)


def test_twenty_repeats_of_every_request_press_nothing_twice() -> None:
    async def check(made: Bench) -> None:
        async def repeat(floor: str, robot: RobotWord | None = None) -> None:
            for _ in range(20):
                made.accept(floor, robot)
                await elapse(0.2)

        await made.called_to("L1")
        await repeat("L1")
        await repeat("L3", IN_PLACE)
        await made.car(None, Door.CLOSED)
        await repeat("L3", IN_PLACE)
        await made.car("L3", Door.OPEN, leave=True)
        await repeat("L3", IN_PLACE)
        for _ in range(20):
            made.accept("L3", LEFT, hold=False)
            await elapse(0.2)
        assert made.presses == ["call L1", "robot_in_place", "go L3", "robot_left"]

    on_bench(check, poll_s=0.2)


def test_a_session_that_ends_while_the_word_in_place_is_on_its_way_sends_nothing_on() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.delay_s = 1.0
        made.accept("L3", IN_PLACE)
        await elapse(1.5)
        assert made.presses[-1] == "robot_in_place"
        made.accept("L1", hold=False)
        await elapse(10)
        assert made.presses == ["call L1", "robot_in_place"]
        await abandoned(made)

    on_bench(check)


def test_a_word_in_place_that_has_not_left_yet_is_not_given_once_the_session_is_over() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.delay_s = 1.0
        made.accept("L3", IN_PLACE)
        await elapse(0.5)
        made.accept("L1", hold=False)
        await elapse(10)
        assert made.presses == ["call L1"]
        await abandoned(made)

    on_bench(check)


def test_a_word_that_the_lift_does_not_grant_is_not_given_at_the_pace_of_the_polls() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.grants = False
        made.accept("L3", IN_PLACE)
        await elapse(1)
        made.driver.grants = True
        await elapse(10)
        assert made.presses == ["call L1"]
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]

    on_bench(check)


def test_an_occupied_level_is_not_renewed_while_the_lift_takes_no_robots() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        made.driver.values = replace(made.driver.values, flags={"robots_allowed": False})
        await elapse(20)
        assert made.driver.renewed["robot_in_place"] < 5

    on_bench(check, TWO_STOP)


def test_a_call_that_the_controller_forgot_is_not_pressed_again_by_keeping_it_on() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.on.clear()
        await elapse(5)
        assert made.driver.log == ["press call L1"]
        assert made.driver.on == set()

    on_bench(check)


def test_an_occupied_level_is_given_again_when_the_ride_of_an_abandoned_robot_is_taken_up() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(31)
        await abandoned(made)
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "robot_in_place"]

    on_bench(check, TWO_STOP, lease_s=30)


def test_an_abandoned_robot_keeps_others_out_and_its_own_caller_takes_up_the_ride() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await elapse(31)
        await abandoned(made)
        refused = made.refuse("L1", holder=OTHER)
        assert refused.code is Refusal.OCCUPANCY_UNKNOWN
        assert "api:fleet/robot1 may still be aboard" in refused.message
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3", "go L3"]
        await made.ridden_to("L3")
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.presses[-1] == "robot_left"
        made.accept("L1", holder=OTHER)

    on_bench(check, lease_s=30)


def test_an_abandoned_robot_that_got_out_by_itself_frees_the_lift_with_its_word() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await elapse(31)
        await made.ridden_to("L3")
        made.accept("L3", hold=False)
        await elapse(1)
        assert "robot_left" not in made.presses
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.presses[-1] == "robot_left"
        made.accept("L1", holder=OTHER)

    on_bench(check, lease_s=30)


def test_a_robot_aboard_when_the_manager_starts_is_told_to_the_lift_anew() -> None:
    async def check(made: Bench) -> None:
        made.accept("L3", IN_PLACE)
        await elapse(1)
        assert made.presses == ["robot_in_place", "go L3"]

    on_bench(check)


def test_a_robot_in_place_before_the_car_came_is_refused() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(1)
        refused = made.refuse("L3", IN_PLACE)
        assert refused.code is Refusal.OCCUPANCY_UNKNOWN
        assert "has not arrived at L1" in refused.message
        assert made.presses == ["call L1"]

    on_bench(check)


def test_an_occupied_car_that_the_map_cannot_send_on_is_refused_with_that_reason() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        refused = made.refuse("L3", IN_PLACE)
        assert refused.code is Refusal.NOT_POSSIBLE
        assert "no command that brings the occupied car to L3" in refused.message

    on_bench(check, replace(PERMITTING, commands=frozenset({"call"})))


def test_a_lost_go_is_pressed_again_on_a_repeat_and_the_robot_stays_aboard() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.answers["go"] = Result.UNCONFIRMED
        made.accept("L3", IN_PLACE)
        await elapse(10)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]
        assert made.driver.on == set()
        made.driver.answers.clear()
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3", "go L3"]

    on_bench(check)


def test_a_call_that_keeps_the_door_open_is_bounded_by_the_site_and_not_taken_up_again() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        for _ in range(20):
            made.accept("L1")
            await elapse(1)
        assert made.driver.on == set()
        await made.car(None, Door.CLOSED)
        for _ in range(20):
            made.accept("L1")
            await elapse(1)
        assert made.presses == ["call L1"]
        assert made.state.holder is not None

    on_bench(check, max_session_hold_s=15)


def test_a_session_that_names_its_robot_aboard_on_a_plain_lift_is_not_lost_in_silence() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(31)
        assert [text for text in await made.alarms() if "aboard_abandoned" in text]
        assert made.refuse("L1", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN
        made.accept("L3")

    on_bench(check, PLAIN, lease_s=30)


def test_a_tripped_watchdog_ends_the_pressing_but_not_the_session() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.values = replace(made.driver.values, flags={"may_enter": True, "watchdog_tripped": True})
        await elapse(0.5)
        refused = made.refuse("L3", IN_PLACE)
        assert refused.code is Refusal.MODE
        assert "watchdog has tripped" in refused.message
        assert made.presses == ["call L1"]
        assert made.driver.on == set()

    on_bench(check)


def test_a_watchdog_that_is_switched_off_refuses_every_press() -> None:
    async def check(made: Bench) -> None:
        made.driver.values = replace(made.driver.values, watchdog_s=0.0)
        await elapse(0.5)
        assert "watchdog is switched off" in made.refuse("L1").message
        made.driver.values = replace(made.driver.values, watchdog_s=3.0)
        await elapse(0.5)
        made.accept("L1")

    on_bench(check, replace(PERMITTING, watched=True))
