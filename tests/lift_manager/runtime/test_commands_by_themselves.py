"""Each command of a map has its own requirements and its own end: what `go` needs does not keep `call` from being pressed."""

from dataclasses import replace

import pytest

from drivers.modbus.capabilities import LiftSettings, capabilities
from drivers.model import Capabilities
from lift_manager.lift.events import SessionEnded
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import EndReason
from register_maps.words import Door, Side
from tests.lift_manager.runtime.scripted import FRONT, PERMITTING, PLAIN, ROBOT, Bench, on_bench
from tests.support.virtual_time import elapse
from tests.support.written_maps import written_map

REAR_HOLDS = replace(
    PLAIN,
    commands=frozenset({"go_to.front", "go_to.rear"}),
    signals=frozenset({"car_floor", "door.front", "door.rear"}),
    held_commands=frozenset({"go_to.rear"}),
    until={"go_to.rear": "arrived"},
    doors=(Side.FRONT, Side.REAR),
)
DOORS: dict[str, tuple[Side, ...]] = {"L1": (Side.FRONT,), "L2": (Side.FRONT,), "L3": (Side.REAR,)}
SIGNALS = """\
signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, door.front: {at: "discrete:1"}, door.rear: {at: "discrete:2"},
  level: {at: "discrete:4"}, robot_mode_on: {at: "discrete:5"}}
"""


def able(commands: str) -> Capabilities:
    """What a lift with these commands can be told."""
    settings = LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, control=True)
    return capabilities(written_map(f"{SIGNALS}commands:\n{commands}"), (), settings)


def go_needs(*flags: str, **others: frozenset[str]) -> Capabilities:
    return replace(PERMITTING, requires={"go": frozenset(flags), **others})


def test_a_lift_knows_the_requirements_of_each_command() -> None:
    pulse = "as: floor, action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 5}"
    made = able(
        f'  call: {{at: "holding:30", {pulse}, requires: [robot_mode_on]}}\n'
        f'  go: {{at: "holding:31", {pulse}, requires: [robot_mode_on, level]}}\n'
        '  robot_in_place: {at: "coil:1", action: pulse, width_s: 1, confirm: {any_of: [readback], within_s: 5}}\n'
    )
    assert made.requires == {"call": {"robot_mode_on"}, "go": {"robot_mode_on", "level"}}
    assert made.until == {}


def test_a_lift_knows_what_ends_each_of_its_calls() -> None:
    level = "as: floor, action: hold, max_hold_s: 60, on_link_loss: latches, confirm: {any_of: [effect], within_s: 5}"
    pulse = "action: pulse, width_s: 1, confirm: {any_of: [readback], within_s: 5}"
    made = able(
        f'  call: {{at: "holding:30", {level}, until: robot_in_place}}\n'
        f'  go: {{at: "holding:31", {level}, until: robot_left}}\n'
        f'  robot_in_place: {{at: "coil:1", {pulse}}}\n'
        f'  robot_left: {{at: "coil:2", {pulse}}}\n'
    )
    assert made.until == {"call": "robot_in_place", "go": "robot_left"}


def test_what_only_the_occupied_car_needs_does_not_keep_the_empty_one_from_being_called() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(1)
        assert made.presses == ["call L1"]

    on_bench(check, go_needs("level"))


def test_the_occupied_car_is_sent_on_only_with_what_its_own_call_needs() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place"]
        made.driver.values = replace(made.driver.values, flags={"level": True})
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]

    on_bench(check, go_needs("level"))


def test_the_door_stays_held_until_the_robot_aboard_is_announced_whatever_the_next_call_needs() -> None:
    needs = replace(
        go_needs("level"),
        commands=PERMITTING.commands | {"hold_door.front"},
        held_commands=frozenset({"hold_door.front"}),
    )

    async def check(made: Bench) -> None:
        made.driver.delay_s = 0.5
        await made.called_to("L1")
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(0.4)
        assert "hold_door.front" in made.driver.on

    on_bench(check, needs, poll_s=0.2)


def test_a_word_that_waits_for_a_grant_lets_go_of_the_door_and_the_lease_stands_still() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.driver.grants = False
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(60)
        assert made.state.holder == ROBOT

    on_bench(check, go_needs(robot_in_place=frozenset({"robot_mode_on"})), lease_s=30)


def test_a_grant_that_never_comes_ends_the_session_with_its_name() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(19)
        before = made.state.holder
        await elapse(2)
        assert (before, made.state.holder) == (ROBOT, None)
        assert made.presses == []
        while not isinstance(event := await made.heard.next(), SessionEnded):
            pass
        assert event.reason is EndReason.NOT_GRANTED
        assert event.text == "level, robot_mode_on for call was not granted within 20 s"

    needs = go_needs("level", call=frozenset({"level", "robot_mode_on"}))
    on_bench(check, replace(needs, granted_within_s=20.0))


def test_a_pulse_is_not_taken_for_forgotten_because_another_call_is_a_level() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(1)
        await made.car(None, Door.CLOSED)
        for _ in range(10):
            made.accept("L1")
            await elapse(2)
        assert made.presses == ["go_to.front L1"]

    on_bench(check, REAR_HOLDS, doors_at=DOORS)


def test_a_level_ends_on_arrival_though_another_call_is_a_pulse() -> None:
    async def check(made: Bench) -> None:
        made.accept("L3")
        await elapse(1)
        await made.car(None, Door.CLOSED)
        assert made.driver.on == {"go_to.rear"}
        made.driver.on.clear()
        await elapse(3)
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["go_to.rear L3", "go_to.rear L3"]
        made.driver.values = replace(made.driver.values, floor="L3", doors={FRONT: Door.CLOSED, Side.REAR: Door.OPEN})
        await elapse(0.5)
        assert made.driver.on == set()

    on_bench(check, REAR_HOLDS, doors_at=DOORS)


@pytest.mark.parametrize(("floor", "pressed_again"), [("L1", True), ("L3", False)])
def test_after_a_spent_hold_only_a_call_that_keeps_the_door_open_is_not_pressed_again(
    floor: str, *, pressed_again: bool
) -> None:
    opens = replace(REAR_HOLDS, until={"go_to.rear": "robot_left"}, same_floor_call=True)
    side = DOORS[floor][0]

    async def check(made: Bench) -> None:
        made.accept(floor)
        await elapse(1)
        shut = {Side.FRONT: Door.CLOSED, Side.REAR: Door.CLOSED}
        made.driver.values = replace(made.driver.values, floor=floor, doors=shut | {side: Door.OPEN})
        await elapse(15)
        made.driver.values = replace(made.driver.values, doors=shut)
        await elapse(15)
        made.accept(floor)
        await elapse(3)
        assert len(made.presses) == (2 if pressed_again else 1)

    on_bench(check, opens, doors_at=DOORS, max_session_hold_s=10)


def test_a_spent_hold_counts_against_the_call_of_the_occupied_car_where_that_one_keeps_the_door_open() -> None:
    opens = replace(PERMITTING, until={"go": "robot_left"}, held_commands=frozenset({"go"}), same_floor_call=True)

    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(1)
        await made.ridden_to("L3")
        await elapse(15)
        await made.car("L3", Door.CLOSED)
        await elapse(15)
        made.driver.delay_s = 0.01
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(3)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]

    on_bench(check, opens, max_session_hold_s=10)
