"""A robot that gets out: when the lift is told, when it must not be, and what waits for it."""

from dataclasses import replace

import pytest

from drivers.model import Command, CommandKind, Result
from lift_manager.lift.occupancy import RobotWord
from register_maps.words import Door, Mode
from tests.lift_manager.runtime.scripted import OTHER, PERMITTING, PLAIN, Bench, abandoned, boarded, on_bench
from tests.support.virtual_time import elapse

IN_PLACE, LEFT = RobotWord.IN_PLACE, RobotWord.LEFT


async def boarded_plainly(made: Bench) -> None:
    """The robot rode to L3 on a lift with one call for both, and stands there with the door open."""
    await made.called_to("L1")
    made.accept("L3", IN_PLACE)
    await elapse(1)
    await made.ridden_to("L3")


def test_a_robot_that_had_no_leave_to_go_has_not_left() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.car(None, Door.CLOSED)
        await made.car("L3", Door.OPEN)
        assert "has not stood open" in made.refuse("L3", LEFT).message
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        await abandoned(made)

    on_bench(check, infer=True)


def test_a_release_before_boarding_tells_the_lift_nothing() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(10)
        made.accept("L1", hold=False)
        await elapse(1)
        assert made.driver.log == ["press call L1", "let go call"]
        assert made.driver.on == set()
        assert await made.alarms() == []

    on_bench(check, infer=True)


def test_a_robot_that_drove_out_again_tells_the_lift_nothing_and_may_call_it_elsewhere() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", LEFT)
        await elapse(1)
        assert made.presses == ["call L1", "call L3"]

    on_bench(check)


def test_a_robot_that_turns_round_before_the_lift_leaves_says_so_and_the_lift_is_told() -> None:
    able = replace(PERMITTING, signals=PERMITTING.signals - {"may_enter", "may_leave"})

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.answers["go"] = Result.REJECTED
        made.accept("L3", IN_PLACE)
        await elapse(1)
        made.accept("L1", LEFT, hold=False)
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3", "robot_left"]
        assert made.driver.on == set()
        assert await made.alarms() == []

    on_bench(check, able)


@pytest.mark.parametrize("result", [Result.REJECTED, Result.UNCONFIRMED])
def test_a_word_left_that_failed_is_an_alarm_and_is_given_again_by_itself_until_it_is_taken(result: Result) -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.answers["robot_left"] = result
        made.accept("L3", LEFT, hold=False)
        await elapse(5)
        assert made.presses[3:] == ["robot_left", "robot_left"]
        await elapse(100)
        assert made.presses[3:] == ["robot_left"] * 7, "after 2, 4, 8, 16, 30 and 30 s"
        assert made.driver.on == set()
        (alarm,) = [text for text in await made.alarms() if "robot_left was not taken" in text]
        assert "until a person has seen to the lift: `lift-manager ack lift --by NAME`" in alarm
        made.driver.answers.clear()
        await elapse(31)
        assert len(made.presses[3:]) == 8
        made.accept("L3", hold=False)
        await elapse(31)
        assert len(made.presses[3:]) == 8

    on_bench(check, poll_s=0.4)  # three minutes


def test_one_alarm_is_enough_for_a_word_left_that_keeps_failing() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.answers["robot_left"] = Result.UNCONFIRMED
        for _ in range(40):
            made.accept("L3", LEFT, hold=False)
            await elapse(1)
        assert made.presses.count("robot_left") > 3
        assert len(await made.alarms()) == 1

    on_bench(check)


def test_the_next_call_waits_until_the_lift_has_been_told_that_the_robot_left() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.delay_s = 1.0
        made.accept("L3", LEFT, hold=False)
        made.accept("L1", holder=OTHER)
        await elapse(1.9)
        assert made.presses[3:] == ["robot_left"]
        await elapse(3)
        assert made.driver.log[-3:] == ["press robot_left", "let go go", "press call L1"]

    on_bench(check)


def test_a_door_is_not_held_for_somebody_who_waits_until_the_lift_has_been_told() -> None:
    able = replace(PLAIN, commands=PLAIN.commands | {"robot_in_place", "robot_left"})

    async def check(made: Bench) -> None:
        await boarded_plainly(made)
        made.driver.delay_s = 1.0
        made.accept("L3", LEFT, hold=False)
        made.accept("L1", holder=OTHER)
        await elapse(0.5)
        assert "hold_door.front" not in made.driver.on
        await elapse(3)
        assert made.presses[-2:] == ["robot_left", "go_to L1"]

    on_bench(check, able)


def test_the_next_call_waits_until_a_word_left_that_failed_was_taken() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        await made.car("L3", Door.CLOSED)
        made.driver.answers["robot_left"] = Result.UNCONFIRMED
        made.accept("L3", LEFT, hold=False)
        await elapse(20)
        for _ in range(15):
            made.accept("L1", holder=OTHER)
            await elapse(1)
        assert set(made.presses[3:]) == {"robot_left"}
        assert "the lift to take robot_left for the robot before" in made.state.restrictions.waiting_for
        made.driver.answers.clear()
        await elapse(31)
        assert made.presses[-2:] == ["robot_left", "call L1"]
        assert made.state.restrictions.waiting_for == ""

    on_bench(check)


def test_nothing_is_told_of_an_earlier_robot_while_the_next_one_may_be_going_in() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.answers["robot_left"] = Result.REJECTED
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        made.accept("L3", IN_PLACE, holder=OTHER)
        made.driver.answers.clear()
        await elapse(10)
        assert "robot_left" not in made.presses[4:]
        assert made.site.durable("lift").robot_left_pending_since is None

    on_bench(check)


def test_the_next_robot_in_place_is_told_only_after_the_one_before_it_has_left() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.delay_s = 1.0
        made.accept("L3", LEFT)
        made.accept("L3", IN_PLACE)
        await elapse(1.5)
        assert made.presses[3:] == ["robot_left"]
        await elapse(2)
        assert made.presses[3:] == ["robot_left", "robot_in_place"]

    on_bench(check)


def test_a_car_that_people_took_away_with_the_robot_inside_says_nothing_of_it_leaving() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        await made.car("L2", Door.CLOSED)
        assert "has not stood open" in made.refuse("L3", LEFT).message
        made.accept("L2", LEFT, hold=False)
        await elapse(1)
        await abandoned(made)

    on_bench(check)


def test_a_word_in_place_on_its_way_is_taken_back_when_the_robot_turns_round() -> None:
    able = replace(PERMITTING, signals=PERMITTING.signals - {"may_enter", "may_leave"})

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.delay_s = 1.0
        made.accept("L3", IN_PLACE)
        await elapse(0.5)
        made.accept("L1", LEFT)
        await elapse(5)
        assert made.presses[:2] == ["call L1", "robot_left"]
        assert "robot_in_place" not in made.presses
        assert made.driver.on <= {"call"}, "the call may keep the door open for the holder"

    on_bench(check, able)


def test_a_lift_that_comes_back_and_takes_no_robots_is_let_go_before_it_is_told() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.silent = True
        await elapse(2)
        made.accept("L3", LEFT, hold=False)
        made.driver.values = replace(made.driver.values, flags={"robots_allowed": False})
        made.driver.silent = False
        await elapse(1)
        assert made.presses[-1] == "go L3"
        assert made.driver.on == set()

    on_bench(check)


def test_a_fire_while_the_lift_is_being_told_that_the_robot_left_lets_go_at_once() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.delay_s = 5.0
        made.accept("L3", LEFT, hold=False)
        await elapse(0.5)
        assert "go" in made.driver.on
        await made.mode(Mode.FIRE)
        assert made.driver.on == set()
        await elapse(20)
        assert "robot_left" not in made.presses
        assert made.driver.on == set()

    on_bench(check)


def test_nobody_else_can_say_that_an_abandoned_robot_left() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await elapse(31)
        await made.ridden_to("L3")
        made.accept("L3", LEFT, hold=False, holder=OTHER)
        await elapse(1)
        await abandoned(made)

    on_bench(check, lease_s=30)


def test_a_lift_that_cannot_be_told_now_is_told_that_the_robot_left_once_it_answers_again() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.silent = True
        await elapse(2)
        made.accept("L3", LEFT, hold=False)
        await elapse(20)
        assert made.presses[-1] == "go L3"
        made.driver.silent = False
        await elapse(1)
        assert made.presses[-1] == "robot_left"
        assert made.driver.on == set()

    on_bench(check)


def test_nothing_is_said_to_a_lift_that_takes_no_robots_until_it_does_again() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.values = replace(
            made.driver.values, flags={"may_enter": False, "may_leave": True, "robots_allowed": False}
        )
        await elapse(0.5)
        made.accept("L3", LEFT, hold=False)
        await elapse(5)
        assert made.presses[-1] == "go L3"
        assert made.driver.on == set()
        await made.car("L3", Door.CLOSED)
        assert made.presses[-1] == "robot_left"

    on_bench(check)


def test_no_word_leaves_once_the_manager_is_stopping() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.delay_s = 1.0
        made.accept("L3", LEFT, hold=False)
        await elapse(0.5)
        await made.life.stop()
        await elapse(10)
        assert "robot_left" not in made.presses
        assert made.driver.on == set()

    on_bench(check)


def test_what_stays_on_until_the_leaving_is_told_stays_permitted_though_the_session_is_over() -> None:
    able = replace(PERMITTING, held_commands=PERMITTING.held_commands | {"robot_in_place"})

    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.accept("L3", LEFT, hold=False)
        assert made.state.holder is None
        assert made.driver.on == {"go", "robot_in_place"}
        on = (Command(CommandKind.GO, "L3"), Command(CommandKind.ROBOT_IN_PLACE))
        assert [made.driver.above.blocked_by(command, None) for command in on] == [None, None]
        await elapse(1)
        assert made.driver.on == set()
        assert made.presses[-1] == "robot_left"

    on_bench(check, able)


def test_nothing_is_held_anew_for_a_leaving_that_is_still_to_be_told() -> None:
    able = replace(PERMITTING, held_commands=PERMITTING.held_commands | {"robot_in_place"})

    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.on.clear()
        told = len(made.driver.log)
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.driver.log[told:] == ["press robot_left"]

    on_bench(check, able)


@pytest.mark.parametrize("mode", [Mode.INSPECTION, Mode.EMERGENCY, Mode.INDEPENDENT])
def test_a_mode_of_people_while_the_lift_is_being_told_that_the_robot_left_lets_go_at_once(mode: Mode) -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.delay_s = 5.0
        made.accept("L3", LEFT, hold=False)
        await elapse(0.5)
        assert "go" in made.driver.on
        await made.mode(mode)
        assert made.driver.on == set()

    on_bench(check)


KEPT = replace(PERMITTING, held_commands=PERMITTING.held_commands | {"robot_left"})
"""The word that the robot left stays on until the next one boards."""


async def told(made: Bench) -> None:
    await boarded(made)
    await made.ridden_to("L3")
    made.accept("L3", LEFT, hold=False)
    await elapse(2)
    assert made.driver.on == {"robot_left"}


@pytest.mark.parametrize("mode", [Mode.FIRE, Mode.INSPECTION, Mode.OUT_OF_SERVICE])
def test_a_word_that_stays_on_is_let_go_when_people_take_the_lift(mode: Mode) -> None:
    async def check(made: Bench) -> None:
        await told(made)
        await made.mode(mode)
        assert made.driver.on == set()

    on_bench(check, KEPT)


def test_a_word_that_stays_on_is_let_go_in_a_lockout() -> None:
    async def check(made: Bench) -> None:
        await told(made)
        made.site.lock_out("lift", "M. Weber", "new ropes")
        assert made.driver.on == set()

    on_bench(check, KEPT)


def test_a_word_that_stays_on_outlasts_the_session_of_the_next_robot_that_does_not_board() -> None:
    async def check(made: Bench) -> None:
        await told(made)
        made.accept("L1", holder=OTHER)
        await elapse(31)
        assert made.state.holder is None
        assert made.driver.on == {"robot_left"}

    on_bench(check, KEPT, lease_s=30)


def test_a_person_who_found_the_car_empty_tells_the_lift_that_the_abandoned_robot_left() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        await elapse(31)
        await abandoned(made)
        made.site.acknowledge("lift", "M. Weber")
        await elapse(1)
        assert made.presses[-1] == "robot_left"
        assert made.driver.on == set()
        made.accept("L1", holder=OTHER)
        await elapse(1)
        assert made.presses[-1] == "call L1"

    on_bench(check, lease_s=30)


def test_where_no_robot_was_known_to_be_aboard_a_person_tells_the_lift_nothing() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(31)
        made.site.acknowledge("lift", "M. Weber")
        await elapse(1)
        assert "robot_left" not in made.presses

    on_bench(check, lease_s=30)
