"""The robot handshake, as it should go: called empty, boarded, sent on occupied, left."""

from dataclasses import replace

import pytest

from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from register_maps.words import Door, Side
from tests.lift_manager.lift.test_call import ABLE
from tests.lift_manager.runtime.scripted import FRONT, PERMITTING, PLAIN, TWO_STOP, Bench, on_bench
from tests.support.virtual_time import elapse

IN_PLACE, LEFT = RobotWord.IN_PLACE, RobotWord.LEFT
WHOLE_RIDE = [
    "press call L1",
    "press robot_in_place",
    "let go call",
    "press go L3",
    "press robot_left",
    "let go go",
]


def test_a_ride_in_words_presses_each_command_once_and_in_order() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        assert made.driver.on == {"call"}
        made.accept("L3", IN_PLACE)
        await elapse(1)
        await made.ridden_to("L3")
        assert made.driver.on == {"go"}
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.driver.log == WHOLE_RIDE
        assert made.driver.on == set()
        assert made.state.holder is None
        assert await made.alarms() == []

    on_bench(check)


def test_a_ride_is_inferred_from_what_is_asked_where_the_site_allows_it() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(5)
        made.accept("L3")
        await elapse(1)
        await made.ridden_to("L3")
        made.accept("L3", hold=False)
        await elapse(1)
        assert made.driver.log == WHOLE_RIDE
        assert await made.alarms() == []

    on_bench(check, infer=True)


def test_a_new_floor_right_after_the_door_opened_is_not_taken_for_boarding_yet() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(1)
        refused = made.refuse("L3")
        assert refused.code is Refusal.OCCUPANCY_UNKNOWN
        assert "counts as aboard after 5 s" in refused.message
        await elapse(5)
        made.accept("L3")

    on_bench(check, infer=True)


def test_without_word_and_without_inference_a_new_floor_is_refused_and_says_what_to_do() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(10)
        refused = made.refuse("L3")
        assert refused.code is Refusal.OCCUPANCY_UNKNOWN
        assert "report that the robot is in place" in refused.message
        assert "infer_occupancy" in refused.message
        assert made.presses == ["call L1"]
        assert made.state.destination == "L1"

    on_bench(check)


def test_a_new_floor_while_the_empty_car_is_under_way_is_another_call() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(0.5)
        await made.car(None, Door.CLOSED)
        made.accept("L3")
        await elapse(0.5)
        assert made.driver.log == ["press call L1", "let go call", "press call L3"]

    on_bench(check)


def test_the_call_stays_on_until_the_lift_has_taken_the_word_in_place() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.delay_s = 1.0
        made.accept("L3", IN_PLACE)
        await elapse(1.9)
        assert made.presses[-1] == "robot_in_place"
        assert "call" in made.driver.on
        await elapse(0.3)
        assert "call" not in made.driver.on

    on_bench(check, poll_s=0.2)


def test_a_call_that_keeps_the_door_open_is_renewed_while_the_robot_takes_its_time() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        for _ in range(30):
            await elapse(1)
            made.accept("L1")
        assert made.driver.renewed["call"] == pytest.approx(32, abs=3)
        assert made.presses == ["call L1"]

    on_bench(check)


def test_in_place_without_a_new_floor_is_told_to_the_lift_and_the_floor_follows_later() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L1", IN_PLACE)
        await elapse(1)
        assert made.driver.log == ["press call L1", "press robot_in_place", "let go call"]
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]

    on_bench(check)


def test_a_robot_aboard_may_change_its_mind_on_the_way() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        await made.car(None, Door.CLOSED)
        made.accept("L2")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3", "go L2"]

    on_bench(check)


def test_a_robot_that_left_and_keeps_the_lift_has_it_called_as_empty() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        await made.ridden_to("L3")
        made.accept("L1", LEFT)
        await elapse(1)
        assert made.driver.log == [*WHOLE_RIDE, "press call L1"]

    on_bench(check)


def test_the_next_ride_starts_with_an_empty_car() -> None:
    async def check(made: Bench) -> None:
        for _ in range(3):
            await made.called_to("L1")
            made.accept("L3", IN_PLACE)
            await elapse(1)
            await made.ridden_to("L3")
            made.accept("L3", LEFT, hold=False)
            await elapse(1)
        assert made.driver.log == WHOLE_RIDE * 3

    on_bench(check)


def test_a_session_that_wants_no_hold_does_not_end_on_arrival_with_a_robot_aboard() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE, hold=False)
        await elapse(1)
        await made.ridden_to("L3")
        await elapse(10)
        assert made.state.holder is not None
        assert made.driver.on == set()
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.presses[-1] == "robot_left"

    on_bench(check, replace(PLAIN, commands=PLAIN.commands | {"robot_in_place", "robot_left"}))


@pytest.mark.parametrize("infer", [False, True])
def test_a_two_stop_lift_is_sent_on_by_the_robot_being_in_place(*, infer: bool) -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(0.5)
        await made.car("L1", Door.OPEN)
        await elapse(6)
        made.accept("L3", None if infer else IN_PLACE)
        await elapse(1)
        assert made.driver.log == ["press call L1", "press robot_in_place", "let go call"]
        assert made.driver.on == {"robot_in_place"}
        await made.car(None, Door.CLOSED)
        await elapse(20)
        assert made.driver.renewed["robot_in_place"] > 20
        await made.car("L3", Door.OPEN)
        assert made.robot_door() is RobotDoor.OPEN
        made.accept("L3", None if infer else LEFT, hold=False)
        await elapse(1)
        assert made.driver.log[3:] == ["let go robot_in_place"]
        assert made.driver.on == set()
        assert await made.alarms() == []

    on_bench(check, TWO_STOP, infer=infer, poll_s=0.2)


def test_a_release_after_the_door_shut_is_one_where_only_the_open_door_tells_the_floor() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(0.5)
        await made.car("L1", Door.OPEN)
        made.accept("L3", IN_PLACE)
        await elapse(1)
        await made.car(None, Door.CLOSED)
        await made.car("L3", Door.OPEN)
        await made.car(None, Door.CLOSED)
        assert made.state.floor is None
        made.accept("L3", hold=False)
        await elapse(1)
        assert made.state.holder is None
        assert made.driver.on == set()

    on_bench(check, TWO_STOP, infer=True)


def test_acknowledgements_go_with_a_call_that_does_not_tell_empty_from_occupied() -> None:
    able = replace(PLAIN, commands=frozenset({"go_to", "robot_in_place", "robot_left"}))

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        await made.ridden_to("L3")
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.presses == ["go_to L1", "robot_in_place", "go_to L3", "robot_left"]

    on_bench(check, able)


def test_a_call_that_waits_for_robots_in_place_ends_on_arrival_with_the_robot_aboard() -> None:
    able = replace(
        PLAIN,
        commands=frozenset({"go_to", "robot_in_place", "robot_left"}),
        until={"go_to": "robot_in_place"},
        held_commands=frozenset({"go_to"}),
    )

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        await made.car(None, Door.CLOSED)
        assert made.driver.on == {"go_to"}
        await made.car("L3", Door.OPEN)
        assert made.driver.on == set()

    on_bench(check, able)


def test_a_call_that_stays_on_until_the_robot_left_gives_way_to_the_one_that_takes_it_along() -> None:
    able = replace(PERMITTING, until={"call": "robot_left"}, held_commands=frozenset({"call"}))

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        assert made.driver.log == ["press call L1", "press robot_in_place", "let go call", "press go L3"]

    on_bench(check, able)


def test_robot_mode_stays_until_the_lift_has_been_told_that_the_robot_left() -> None:
    able = replace(
        PERMITTING,
        commands=PERMITTING.commands | {"robot_mode"},
        held_commands=PERMITTING.held_commands | {"robot_mode"},
    )

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        await made.ridden_to("L3")
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.driver.log[-3:] == ["press robot_left", "let go go", "let go robot_mode"]

    on_bench(check, able)


def test_a_level_that_says_left_ends_when_the_next_robot_is_in_place() -> None:
    able = replace(PERMITTING, held_commands=PERMITTING.held_commands | {"robot_left"})

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        await made.ridden_to("L3")
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.driver.on == {"robot_left"}
        await made.called_to("L1")
        made.accept("L3", IN_PLACE)
        await elapse(1)
        assert made.driver.on == {"go"}

    on_bench(check, able)


def test_a_lift_without_the_handshake_presses_what_it_always_did() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3")
        await elapse(1)
        await made.ridden_to("L3")
        made.accept("L3", hold=False)
        await elapse(1)
        assert made.driver.log == [
            "press go_to L1",
            "hold hold_door.front",
            "let go hold_door.front",
            "press go_to L3",
            "hold hold_door.front",
            "let go hold_door.front",
        ]
        assert await made.alarms() == []

    on_bench(check, PLAIN)


@pytest.mark.parametrize(
    ("doors", "command"),
    [((FRONT,), "go_to.front L1"), ((Side.REAR,), "go_to.rear L1"), ((Side.REAR, FRONT), "go_to.front L1")],
)
def test_where_the_door_is_part_of_the_call_the_floor_says_which(doors: tuple[Side, ...], command: str) -> None:
    able = replace(ABLE, commands=frozenset({"go_to.front", "go_to.rear"}), doors=(FRONT, Side.REAR))

    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(1)
        assert made.presses == [command]

    on_bench(check, able, doors_at={"L1": doors, "L2": (FRONT,), "L3": (FRONT,)})


def test_a_floor_whose_door_has_no_call_is_refused_with_that_reason() -> None:
    able = replace(ABLE, commands=frozenset({"go_to.front"}), doors=(FRONT, Side.REAR))

    async def check(made: Bench) -> None:
        refused = made.refuse("L1")
        assert refused.code is Refusal.NOT_POSSIBLE
        assert refused.message == "lift: its map by-hand has no command that brings the car to L1"

    on_bench(check, able, doors_at={"L1": (Side.REAR,), "L2": (FRONT,), "L3": (FRONT,)})


def test_a_map_that_can_move_only_the_occupied_car_cannot_be_called() -> None:
    async def check(made: Bench) -> None:
        refused = made.refuse("L1")
        assert refused.code is Refusal.NOT_POSSIBLE
        assert "neither go_to nor call" in refused.message

    on_bench(check, replace(PERMITTING, commands=frozenset({"go", "robot_in_place", "robot_left"})))


def test_the_door_is_open_for_a_robot_only_with_the_permission_for_where_it_is() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(0.5)
        await made.car("L1", Door.OPEN, leave=True)
        assert made.robot_door() is RobotDoor.MOVING
        await made.car("L1", Door.OPEN, enter=True)
        assert made.robot_door() is RobotDoor.OPEN
        made.accept("L3", IN_PLACE)
        await made.car("L1", Door.CLOSED)
        await made.car("L3", Door.OPEN, enter=True)
        assert made.robot_door() is RobotDoor.MOVING
        await made.car("L3", Door.OPEN, leave=True)
        assert made.robot_door() is RobotDoor.OPEN
        assert made.state.doors == {FRONT: Door.OPEN}

    on_bench(check)


@pytest.mark.parametrize(("enter", "leave"), [(True, False), (False, True), (False, False)])
def test_with_nobody_holding_the_lift_an_open_door_needs_some_permission(*, enter: bool, leave: bool) -> None:
    async def check(made: Bench) -> None:
        await made.car("L2", Door.OPEN, enter=enter, leave=leave)
        assert made.robot_door() is (RobotDoor.OPEN if enter or leave else RobotDoor.MOVING)
        assert made.state.doors == {FRONT: Door.OPEN}

    on_bench(check)
