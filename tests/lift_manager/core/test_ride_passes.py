"""For which rides an event is looked at, and what many rides cost."""

import asyncio
from contextlib import AsyncExitStack
from dataclasses import replace

from lift_manager.core.rides.book import RideBook
from lift_manager.core.rides.due import Due
from lift_manager.core.rides.places import Places
from lift_manager.core.rides.seeing import Seeing
from lift_manager.core.waiting import WaitingLine
from lift_manager.domain.ride import Phase, RideBegun
from lift_manager.domain.state import Holder
from register_maps.words import Door
from tests.lift_manager.core.ride_building import FLEET, Building, in_building
from tests.lift_manager.domain.ride_sights import HOLDER, WISH, ride
from tests.support.ride_faults import Story
from tests.support.ride_rig import clock
from tests.support.trip_sites import site_of
from tests.support.virtual_time import elapse, run_virtual

WORKSHOP = Holder("workshop", "")
ROBOTS = 60


def test_a_place_in_the_line_that_one_ride_leaves_is_at_its_end_for_the_other_of_the_same_holder() -> None:
    line = WaitingLine("A")
    places = Places(lambda _: line)
    one, two = ride(), replace(ride(), id="r2")
    places.see_to(one, 0.0)
    places.see_to(two, 0.0)
    line.join(WORKSHOP, 0.0)
    assert places.at("A", HOLDER) == ("r1", "r2")
    places.see_to(replace(one, phase=Phase.CALLED), 0.0)
    assert (line.length(0.0), line.ahead(HOLDER, 0.0), places.at("A", HOLDER)) == (2, 1, ("r2",))
    places.see_to(replace(two, phase=Phase.CANCELLED), 0.0)
    assert (line.length(0.0), places.at("A", HOLDER)) == (1, ())


def test_any_does_not_move_to_a_lift_that_is_no_better_though_its_car_is_nearer() -> None:
    async def check(made: Building) -> None:
        for lift in ("A", "B"):
            made.ask(lift, WORKSHOP)
        waiting = made.begin("any")
        assert waiting.lift == "A"
        await made.car("B", "L1")
        await elapse(10)
        assert made.look(waiting).lift == "A"
        assert {told.lift for told in made.told} == {"A"}

    in_building(check, "A", "B")


def test_any_takes_a_lift_at_the_moment_it_becomes_free() -> None:
    async def check(made: Building) -> None:
        for lift in ("A", "B"):
            made.ask(lift, WORKSHOP)
        waiting = made.begin("any")
        assert waiting.lift == "A"
        await elapse(1.5)
        made.manager.force_release("B", "Ana", "needed", at_once=True)
        await elapse(0.1)
        assert (made.look(waiting).lift, made.look(waiting).phase) == ("B", Phase.CALLED)

    in_building(check, "A", "B")


def test_whoever_waits_is_told_when_the_line_before_it_moves_up() -> None:
    async def check(made: Building) -> None:
        rides = [made.begin("A", robot=f"amr-{n}") for n in range(4)]
        await elapse(1.1)
        told = len(made.told)
        made.manager.cancel_ride(rides[1].id, FLEET, "no order")
        await elapse(0.1)
        moved = {one.id: one.ahead for one in made.told[told:] if one.phase is Phase.QUEUED}
        assert moved == {rides[2].id: 1, rides[3].id: 2}

    in_building(check, "A")


def test_an_event_is_looked_at_for_rides_with_a_session_and_the_next_and_for_all_where_the_line_moves_up() -> None:
    async def check(made: Building) -> None:
        book = RideBook()
        seeing, places = Seeing(made.manager, made.manager.line, book, clock), Places(made.manager.line)
        waiting = [
            replace(ride(), id=f"r{n}", wish=replace(WISH, robot=f"amr-{n}", any_lift=n == 4, lifts=("A", "B")))
            for n in (2, 3, 4)
        ]
        for record in (ride(Phase.CALLED), *waiting, replace(ride(Phase.DONE), id="over")):
            book.put(record)
            places.see_to(record, 0.0)
        due, nothing = Due(seeing, book, places), frozenset[str]()
        assert due.rides(["A"], nothing) == ["r1", "r2", "r3", "r4"], "nothing is known of its line yet"
        assert due.rides(["A"], nothing) == ["r1", "r2"]
        made.manager.line("A").leave(waiting[0].holder)
        assert due.rides(["A"], nothing) == ["r1", "r2", "r3", "r4"]
        assert due.rides(["A"], nothing) == ["r1", "r3"]
        assert due.rides(["B"], frozenset({"B"})) == ["r4"]

    in_building(check, "A", "B")


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
            answer = made.manager.begin_ride(replace(made.wish("A"), caller=caller))
            assert isinstance(answer, RideBegun)
            rides.append(answer.ride)
        await elapse(1.1)
        made.manager.cancel_ride(rides[1].id, None, "no order")
        counting = asyncio.ensure_future(count())
        with made.manager.tap(lambda _: turns.add(turn)):
            for _ in range(ROBOTS):
                await asyncio.sleep(0)
        counting.cancel()
        assert len(turns) >= ROBOTS // 10

    in_building(check, "A")


def test_where_a_robot_may_be_inside_an_event_is_looked_at_for_its_ride_and_not_for_the_head_of_the_line() -> None:
    async def check(made: Building) -> None:
        made.begin("A", robot="amr-9")
        await made.car("A", "L1", Door.OPEN)
        made.manager.force_release("A", "Ana", "needed", at_once=True)
        await elapse(1)
        book = RideBook()
        seeing, places = Seeing(made.manager, made.manager.line, book, clock), Places(made.manager.line)
        for number in (2, 9):
            record = replace(ride(), id=f"r{number}", wish=replace(WISH, robot=f"amr-{number}"))
            book.put(record)
            places.see_to(record, 0.0)
        due = Due(seeing, book, places)
        assert due.rides(["A"], frozenset()) == ["r2", "r9"]
        assert due.rides(["A"], frozenset()) == ["r9"]

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
