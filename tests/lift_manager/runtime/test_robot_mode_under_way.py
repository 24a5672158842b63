"""Robot mode is not dropped while the car moves, whether or not the lift tells that it is on."""

import asyncio
from asyncio import Future
from collections.abc import Awaitable, Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from lift_manager.lift.journal import Row
from lift_manager.lift.state import Quality
from lift_manager.runtime.recorder import MemoryRecorder, SavedLift
from register_maps.codec import compile_map
from register_maps.load import MapChanges, load
from register_maps.words import Motion
from simulator.controller import Inputs
from simulator.faults import PowerLoss
from tests.lift_manager.runtime.scripted import AT_L2, PLAIN, Bench, on_bench
from tests.support.session_calls import saved
from tests.support.shipped_maps import compiled
from tests.support.spine import Spine, on_spine, spine
from tests.support.virtual_time import elapse, run_virtual

AT = datetime(2026, 3, 2, 12, tzinfo=UTC)
WITH_MODE = replace(
    PLAIN,
    commands=PLAIN.commands | {"robot_mode"},
    signals=PLAIN.signals | {"robot_mode_on", "motion"},
    held_commands=PLAIN.held_commands | {"robot_mode"},
    evidence="motion_stopped",
    max_hold_s={"robot_mode": 5.0},
)
UNDER_WAY = replace(AT_L2, floor=None, flags={"robot_mode_on": True}, motion=Motion.UP)
MODE = frozenset({"robot_mode"})


@pytest.mark.parametrize("name", ["generic-registers", "robotnik-il-eth"])
def test_a_robot_that_lets_go_under_way_leaves_robot_mode_on_until_the_car_stands(name: str) -> None:
    async def check(made: Spine) -> None:
        last = made.actor.config.floors[-1]
        made.accept(last)
        await made.until(lambda _: made.face.picture.motion is not Motion.STOPPED)
        await elapse(1)
        made.accept(last, hold=False)
        made.accept(made.state.floor or last, hold=False)
        while made.face.picture.motion is not Motion.STOPPED:
            assert "robot_mode" in made.face.commands
            await elapse(0.1)
        await elapse(4)
        assert "robot_mode" not in made.face.commands

    on_spine(check, name, poll_s=0.2)


@pytest.mark.parametrize("map_says_so", [True, False])
def test_a_controller_that_consumes_each_request_keeps_robot_mode_under_way_if_its_map_says_so(
    *, map_says_so: bool
) -> None:
    plain = compiled("generic-registers")
    override = {"commands": {"robot_mode": {"self_clearing": True}}}
    consuming = compile_map(load("generic-registers", changes=MapChanges({}, override)).map)

    async def check(made: Spine) -> None:
        made.accept(made.actor.config.floors[-1])
        await made.until(lambda _: made.face.picture.motion is not Motion.STOPPED)
        await elapse(1)
        made.site.force_release("lift", "M. Weber", "ropes")
        asked = []
        while made.face.picture.motion is not Motion.STOPPED:
            asked.append("robot_mode" in made.face.commands)
            await elapse(0.1)
        assert all(asked) is map_says_so
        await elapse(8)
        assert "robot_mode" not in made.face.commands

    on_spine(check, codec=consuming if map_says_so else plain, really=consuming, poll_s=0.2)


@pytest.mark.parametrize("in_session", [True, False])
def test_a_key_switch_that_keeps_robots_off_drops_robot_mode_under_way(*, in_session: bool) -> None:
    async def check(made: Spine) -> None:
        made.accept(made.actor.config.floors[-1])
        await made.until(lambda _: made.face.picture.motion is not Motion.STOPPED)
        await elapse(1)
        if not in_session:
            made.site.force_release("lift", "M. Weber", "ropes")
            await elapse(1)
        assert "robot_mode" in made.face.commands
        made.people(Inputs(robots_allowed=False))
        await elapse(1)
        assert made.face.picture.motion is not Motion.STOPPED
        assert "robot_mode" not in made.face.commands

    on_spine(check, "generic-coils")


@pytest.mark.parametrize("outputs_held", [False, True])
def test_robot_mode_that_fell_while_the_lift_was_unreadable_is_not_pressed_once_its_session_is_over(
    *, outputs_held: bool
) -> None:
    lost = PowerLoss(outputs_held=outputs_held)

    async def check(made: Spine) -> None:
        made.accept(made.actor.config.floors[-1])
        await made.until(lambda _: made.face.picture.motion is not Motion.STOPPED)
        await elapse(1)
        made.face.begin(lost, asyncio.get_running_loop().time())
        made.device.silent = True
        await made.until(lambda state: state.holder is None)
        made.face.end(lost, asyncio.get_running_loop().time())
        made.device.silent = False
        seen = 0
        while made.face.picture.motion is not Motion.STOPPED:
            assert ("robot_mode" in made.face.commands) is outputs_held
            seen += made.state.quality is Quality.LIVE
            await elapse(0.1)
        assert seen > 10, "the car was read under way"
        await elapse(4)
        assert "robot_mode" not in made.face.commands

    on_spine(check, "robotnik-il-eth", lease_s=3.0, poll_s=0.2)


class SlowJournal(MemoryRecorder):
    """Every row takes two seconds."""

    def commit_now(self, row: Row) -> Future[str | None]:
        done: Future[str | None] = asyncio.get_running_loop().create_future()
        asyncio.get_running_loop().call_later(2.0, done.set_result, None)
        return done


@pytest.mark.parametrize("ends", ["force_release", "lock_out"])
def test_robot_mode_that_waits_for_its_row_is_not_pressed_after_its_session(ends: str) -> None:
    async def main() -> None:
        async with spine("robotnik-il-eth", recorder=SlowJournal(), poll_s=0.2) as made:
            made.people(Inputs(car_buttons=frozenset({len(made.actor.config.floors) - 1})))
            await elapse(3)
            assert made.face.picture.motion is not Motion.STOPPED
            made.accept(made.actor.config.floors[0])
            await elapse(1)
            end = made.site.force_release if ends == "force_release" else made.site.lock_out
            end("lift", "M. Weber", "ropes")
            for _ in range(100):
                assert made.face.commands == {}
                await elapse(0.1)

    run_virtual(main)


async def riding(made: Bench) -> None:
    made.grants_robot_mode()
    made.accept("L3")
    await elapse(0.5)
    made.driver.values = UNDER_WAY
    await elapse(0.5)
    assert "robot_mode" in made.driver.on


async def forced(made: Bench) -> None:
    await riding(made)
    made.site.force_release("lift", "M. Weber", "ropes")
    await elapse(1)
    assert "robot_mode" in made.driver.on


async def locked_out(made: Bench) -> None:
    await riding(made)
    made.site.lock_out("lift", "M. Weber", "ropes")


async def released(made: Bench) -> None:
    await riding(made)
    made.accept("L3", hold=False)
    made.site.force_release("lift", "M. Weber", "ropes")


@pytest.mark.parametrize(
    ("before", "off_s"),
    [(forced, 2), (locked_out, 2), (released, 2), (riding, 400)],
    ids=["forced", "locked out", "released", "lease over"],
)
def test_robot_mode_that_outlived_its_session_is_kept_over_a_restart_until_the_car_stands(
    before: Callable[[Bench], Awaitable[None]], off_s: float
) -> None:
    memory = MemoryRecorder()

    async def after(made: Bench) -> None:
        assert made.state.holder is None
        await elapse(10)
        assert made.driver.log == []
        assert made.driver.renewed["robot_mode"] > 9
        made.driver.values = replace(UNDER_WAY, floor="L3", motion=Motion.STOPPED)
        await elapse(1)
        assert made.driver.log == ["let go robot_mode"]
        assert saved(memory).robot_mode_until is None

    on_bench(before, WITH_MODE, recorder=memory, clock=lambda: AT)
    on_bench(
        after,
        WITH_MODE,
        recorder=memory,
        clock=lambda: AT + timedelta(seconds=off_s),
        found=UNDER_WAY,
        left_on=MODE,
    )


def test_it_is_dropped_when_its_time_is_over_and_not_kept_by_a_start_after_that() -> None:
    memory = MemoryRecorder()

    async def after(made: Bench) -> None:
        await elapse(WITH_MODE.arrive_within_s - 62)
        assert made.driver.log == []
        await elapse(5)
        assert made.driver.log == ["let go robot_mode"]
        assert [text for text in await made.alarms() if "nobody has seen the car come to rest" in text]

    async def much_later(made: Bench) -> None:
        assert made.driver.adopted == set()

    on_bench(forced, WITH_MODE, recorder=memory, clock=lambda: AT)
    kept = memory.records["lift"]
    assert kept.record.robot_mode_until == AT + timedelta(seconds=WITH_MODE.arrive_within_s)
    again = AT + timedelta(seconds=60)
    on_bench(after, WITH_MODE, recorder=memory, clock=lambda: again, found=UNDER_WAY, left_on=MODE)
    memory.keep("lift", kept)
    on_bench(much_later, WITH_MODE, recorder=memory, clock=lambda: AT + timedelta(hours=1), left_on=MODE)


def test_it_is_not_kept_after_a_fire() -> None:
    memory = MemoryRecorder()

    async def after(made: Bench) -> None:
        assert made.driver.adopted == set()

    on_bench(forced, WITH_MODE, recorder=memory, clock=lambda: AT)
    memory.keep("lift", SavedLift(replace(saved(memory), fire_since=AT)))
    on_bench(after, WITH_MODE, recorder=memory, clock=lambda: AT, found=UNDER_WAY, left_on=MODE)
