"""A call that only the car itself can confirm: a car that goes for somebody else confirms nothing."""

import asyncio

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from register_maps.words import Table
from tests.drivers.rig import Rig, allowed, on_rig
from tests.support.virtual_time import elapse
from tests.support.written_maps import HEAD

MAP = """
signals:
  car_floor: {at: "input:1", as: floor, unknown: [0]}
  door.front: {at: "discrete:1"}
commands:
  go_to: {at: "holding:1", as: floor, action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 30}}
"""
CALL = Command(CommandKind.GO_TO, "L3")
PASSED = HEAD.replace("{kind: position_stable, for_s: 1.0}", "{kind: door_open}")
"""The floor that is told may be the one last passed."""
FLOORS = {"L1": 1, "L2": 2, "L3": 3}


def press(made: Rig) -> asyncio.Future[Outcome]:
    return made.lift.press(CALL, allowed)


def car(made: Rig, floor: int, *, door_open: bool) -> None:
    made.device.values[Table.INPUT][1] = floor
    made.device.values[Table.DISCRETE][1] = int(door_open)


def test_a_car_that_people_sent_up_before_the_press_does_not_confirm_it_by_going_on() -> None:
    async def check(made: Rig) -> None:
        car(made, 1, door_open=True)
        await elapse(1.0)
        car(made, 1, door_open=False)
        await elapse(3.0)
        outcome = press(made)
        await elapse(0.3)
        car(made, 2, door_open=False)
        await elapse(10.0)
        assert not outcome.done()
        car(made, 2, door_open=True)
        await elapse(3.0)
        assert not outcome.done()
        car(made, 2, door_open=False)
        await elapse(3.0)
        car(made, 3, door_open=False)
        await elapse(1.0)
        assert (outcome.result().result, outcome.result().proof) == (Result.CONFIRMED, Proof.EFFECT)

    on_rig(check, MAP, head=PASSED, floors=FLOORS)


def test_a_car_that_never_stood_again_leaves_the_press_unconfirmed() -> None:
    async def check(made: Rig) -> None:
        car(made, 1, door_open=False)
        await elapse(3.0)
        outcome = press(made)
        await elapse(0.3)
        car(made, 2, door_open=False)
        await elapse(31.0)
        assert outcome.result().result is Result.UNCONFIRMED

    on_rig(check, MAP, head=PASSED, floors=FLOORS)


def test_a_shut_car_that_has_told_one_floor_for_long_confirms_by_going_to_the_next() -> None:
    async def check(made: Rig) -> None:
        car(made, 1, door_open=False)
        await elapse(12.0)
        outcome = press(made)
        await elapse(4.0)
        assert not outcome.done()
        car(made, 2, door_open=False)
        await elapse(1.0)
        assert outcome.result().proof is Proof.EFFECT

    on_rig(check, MAP, head=PASSED, floors=FLOORS)
