"""For which rides an event is looked at, and what many rides cost."""

import asyncio
from contextlib import AsyncExitStack
from dataclasses import replace

from lift_manager.lift.refusals import Accepted
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Phase
from tests.lift_manager.runtime.ride_building import Building, in_building
from tests.support.ride_faults import Story
from tests.support.trip_sites import site_of
from tests.support.virtual_time import elapse, run_virtual

WORKSHOP = Holder("workshop", "")
ROBOTS = 60


def test_a_place_in_the_line_that_one_ride_leaves_is_at_its_end_for_the_other_of_the_same_holder() -> None:
    async def check(made: Building) -> None:
        assert made.ask("A") == Accepted()
        one, two, other = made.begin("A"), made.begin("A"), made.begin("A", robot="amr-9")
        assert (one.ahead, two.ahead, other.ahead) == (1, 1, 2)
        made.cancel(one)
        assert (made.look(two).ahead, made.look(other).ahead) == (2, 1)
        made.cancel(two)
        last = made.begin("A", robot="amr-10")
        assert (made.look(other).ahead, last.ahead) == (1, 2)

    in_building(check, "A")


def test_any_does_not_move_to_a_lift_that_is_no_better_though_its_car_is_nearer() -> None:
    async def check(made: Building) -> None:
        for lift in ("A", "B"):
            made.ask(lift, WORKSHOP)
        waiting = made.begin("any")
        assert waiting.lift == "A"
        await made.car("B", "L1")
        await elapse(10)
        assert made.look(waiting).lift == "A"
        assert {told.lift for told in made.changes} == {"A"}

    in_building(check, "A", "B")


def test_any_takes_a_lift_at_the_moment_it_becomes_free() -> None:
    async def check(made: Building) -> None:
        for lift in ("A", "B"):
            made.ask(lift, WORKSHOP)
        waiting = made.begin("any")
        assert waiting.lift == "A"
        await elapse(1.5)
        made.site.force_release("B", "Ana", "needed", at_once=True)
        await elapse(0.1)
        assert (made.look(waiting).lift, made.look(waiting).phase) == ("B", Phase.CALLED)

    in_building(check, "A", "B")


def test_whoever_waits_is_told_when_the_line_before_it_moves_up() -> None:
    async def check(made: Building) -> None:
        rides = [made.begin("A", robot=f"amr-{n}") for n in range(4)]
        await elapse(1.1)
        told = len(made.changes)
        made.cancel(rides[1])
        await elapse(0.1)
        moved = {one.id: one.ahead for one in made.changes[told:] if one.phase is Phase.QUEUED}
        assert moved == {rides[2].id: 1, rides[3].id: 2}

    in_building(check, "A")


def test_others_have_their_turn_while_many_rides_are_gone_on_with() -> None:
    async def check(made: Building) -> None:
        turn, turns = 0, set[int]()

        async def count() -> None:
            nonlocal turn
            while True:
                turn += 1
                await asyncio.sleep(0)

        rides = []
        for number in range(ROBOTS):
            caller = Holder("ride", f"fleet-{number}")
            rides.append(made.site.rides.begin(replace(made.request("A"), caller=caller)).ride)
        await elapse(1.1)
        made.site.rides.cancel(rides[1].id, None, "no order")
        counting = asyncio.ensure_future(count())
        with made.site.tap(lambda _: turns.add(turn)):
            for _ in range(ROBOTS):
                await asyncio.sleep(0)
        counting.cancel()
        assert len(turns) >= ROBOTS // 10

    in_building(check, "A")


def test_the_rides_own_newer_wish_for_a_floor_is_no_trouble() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            story = Story(site_of("two-stop-agv"), stack)
            await story.begin()
            await story.until(lambda one: one.phase is Phase.RIDING)
            await story.go_on(3.0)
            story.rig.cancel(story.robot.ride)
            over = await story.end()
            assert over.phase is Phase.CANCELLED
            assert [one.reason for one in story.rig.told if "took its place" in one.reason] == []

    run_virtual(main, limit_s=3000)
