"""The view of the lifts: as old as it says, and offline by itself."""

import asyncio
from math import inf, nan

import pytest

from lift_manager.api.lifts import Held, Lift
from lift_manager.client import LiftManagerClient, NotAllowed, NotFound, States
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import Quality
from lift_manager.plain.client_aging import is_too_old
from register_maps.words import Mode, Motion
from tests.lift_manager.client.manager import IDLE, LIFT, OPEN, URL, Manager, no
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual


def client_of(manager: Manager) -> LiftManagerClient:
    return LiftManagerClient(URL, transport=manager)


def now() -> float:
    return asyncio.get_running_loop().time()


async def first(states: States, quality: Quality) -> Lift:
    async for lift in states:
        if lift.quality is quality:
            return lift
    raise AssertionError("it has no end")


def test_every_lift_is_shown_first_and_then_each_that_changes() -> None:
    async def main() -> None:
        goods = IDLE.model_copy(update={"name": "goods"})
        manager = Manager({LIFT: IDLE, "goods": goods})
        async with client_of(manager) as client, client.states() as states:
            assert [(await anext(states)).name for _ in range(2)] == [LIFT, "goods"]
            await elapse(10)
            manager.show(OPEN)
            told_at = now()
            assert (await anext(states)).robot_door is RobotDoor.OPEN
            assert now() - told_at < 0.05
            assert [lift.name for lift in states.lifts] == [LIFT, "goods"]

    run_virtual(main)


def test_a_lift_that_does_not_change_is_not_shown_again() -> None:
    async def main() -> None:
        held = IDLE.model_copy(update={"session": Held(face="api", name="amr-7", for_s=3.0)})
        manager = Manager({LIFT: held})
        async with client_of(manager) as client, client.states() as states:
            await anext(states)
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(60):
                    await anext(states)
            assert states[LIFT].quality is Quality.LIVE

    run_virtual(main)


@each_row("fails", ["up", "deaf"])
@each_row("which", [None, LIFT])
def test_a_lift_goes_offline_by_itself_once_nothing_was_heard_for_its_max_age(fails: str, which: str | None) -> None:
    async def main() -> None:
        manager = Manager({LIFT: OPEN})
        async with client_of(manager) as client, client.states(which) as states:
            assert (await first(states, Quality.LIVE)).robot_door is RobotDoor.OPEN
            await elapse(7)
            setattr(manager, fails, fails == "deaf")
            gone_at = now()
            unknown_reason = await first(states, Quality.OFFLINE)
            # 0.1 s of it had passed when the manager read the lift
            assert now() - gone_at <= 0.91
            assert (unknown_reason.floor, unknown_reason.standing, unknown_reason.robot_door) == (
                None,
                False,
                RobotDoor.MOVING,
            )
            assert (unknown_reason.doors, unknown_reason.motion, unknown_reason.mode) == (
                {},
                Motion.UNKNOWN,
                Mode.UNKNOWN,
            )
            assert "the manager has not replied for" in unknown_reason.reason
            await elapse(60)
            age_s = states[LIFT].age_s
            assert age_s is not None
            assert age_s > 60
            setattr(manager, fails, fails == "up")
            assert (await first(states, Quality.LIVE)).robot_door is RobotDoor.OPEN

    run_virtual(main)


@pytest.mark.parametrize("quality", list(Quality))
def test_a_silent_manager_is_told_from_a_lift_that_it_cannot_read(quality: Quality) -> None:
    async def main() -> None:
        manager = Manager({LIFT: IDLE.model_copy(update={"quality": quality, "age_s": 0.1})})
        async with client_of(manager) as client, client.states() as states:
            await anext(states)
            for _ in range(100):
                assert states.is_current(LIFT)
                await elapse(0.05)
            manager.up = False
            await elapse(1.1)
            assert not states.is_current(LIFT)
            manager.up = True
            await elapse(3)
            assert states.is_current(LIFT)
            manager.show(manager.lifts[LIFT].model_copy(update={"quality": Quality.OFFLINE, "age_s": 60.0}))
            await elapse(1)
            assert states.is_current(LIFT)

    run_virtual(main)


def test_a_reason_that_differs_in_its_seconds_is_the_same_and_another_reason_is_shown() -> None:
    async def main() -> None:
        unknown_reason = IDLE.model_copy(
            update={"quality": Quality.OFFLINE, "reason": "plc has not answered for 2.5 s"}
        )
        manager = Manager({LIFT: unknown_reason})
        async with client_of(manager) as client, client.states() as states:
            await anext(states)
            manager.show(unknown_reason.model_copy(update={"reason": "plc has not answered for 12 s"}))
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(10):
                    await anext(states)
            manager.show(unknown_reason.model_copy(update={"reason": "plc refuses connections"}))
            assert (await anext(states)).reason == "plc refuses connections"

    run_virtual(main)


@each_row("max_age_s", [1.0, nan])
@each_row("age", [None, nan, inf, 1.5])
def test_what_is_no_number_is_never_fresh(age: float | None, max_age_s: float) -> None:
    assert is_too_old(age, max_age_s)
    assert is_too_old(0.5, nan)
    assert not is_too_old(1.0, 1.0)


def test_answers_that_are_long_on_their_way_are_as_old_as_their_questions() -> None:
    async def main() -> None:
        manager = Manager({LIFT: OPEN}, late_s=0.95)
        async with client_of(manager) as client, client.states() as states:
            for _ in range(200):
                await elapse(0.05)
                assert all(lift.robot_door is RobotDoor.MOVING for lift in states.lifts)

    run_virtual(main)


def test_what_the_manager_will_not_tell_is_raised() -> None:
    async def main() -> None:
        manager = Manager(handlers={("GET", "/api/v1/lifts"): lambda _: no(401, "key_needed")})
        async with client_of(manager) as client:
            async with client.states() as states:
                with pytest.raises(NotAllowed):
                    await anext(states)
            async with client.states("attic") as states:
                with pytest.raises(NotFound):
                    await anext(states)
            async with client.states() as states:
                with pytest.raises(KeyError):
                    states["attic"]

    run_virtual(main)
