"""What is done for rides at once, in which order, and what is written down and published of it."""

import pytest

from lift_manager.lift.events import Alarm
from lift_manager.lift.hours import RobotHours, read_hours
from lift_manager.lift.journal import RowKind
from lift_manager.lift.refusals import Accepted, Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import Phase, RideWord
from lift_manager.rides.rides import ENDED_FOR_S
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door
from tests.lift_manager.runtime.ride_building import Building, building, in_building
from tests.support.refusals import refusal
from tests.support.virtual_time import elapse, run_virtual

WORKSHOP = Holder("workshop", "")


@pytest.mark.parametrize(
    ("floor", "word"), [(None, RideWord.HERE), ("L1", RideWord.ENTERED)], ids=["called", "boarding"]
)
def test_what_happened_at_the_same_moment_comes_before_what_a_robot_reports(floor: str | None, word: RideWord) -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", floor, Door.OPEN if floor else Door.CLOSED)
        made.site.force_release("A", "Ana", "needed", at_once=True)
        refused = refusal(lambda: made.report(ride, word))
        assert (refused.code, "the ride is over" in refused.message) == (Refusal.NOT_NOW, True)

    in_building(check, "A")


def test_what_happened_at_the_same_moment_comes_before_a_cancellation() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        made.site.force_release("A", "Ana", "needed", at_once=True)
        assert made.cancel(ride).phase is Phase.GAVE_UP
        assert Phase.CLEARING not in {one.phase for one in made.changes}

    in_building(check, "A")


def test_a_repeated_request_gets_the_lift_at_once() -> None:
    recorder = MemoryRecorder()

    async def main() -> None:
        async with building("A", recorder=recorder) as made:
            assert made.ask("A") == Accepted()
            assert made.begin("A", key="k1").phase is Phase.QUEUED
        async with building("A", recorder=recorder) as made:
            assert made.ask("A", hold=False) == Accepted()
            assert made.begin("A", key="k1").phase is Phase.CALLED

    run_virtual(main)


def test_a_ride_that_is_turned_away_waits_for_another_lift_at_the_same_moment() -> None:
    async def check(made: Building) -> None:
        for lift in ("A", "B"):
            assert made.ask(lift, WORKSHOP) == Accepted()
        ride, other = made.begin("any"), made.begin("B", robot="amr-9")
        assert ride.lift == "A"
        await elapse(70.5)
        for lift in ("A", "B"):
            made.site.force_release(lift, "Ana", "needed", at_once=True)
        await elapse(0.1)
        assert (made.look(other).phase, made.look(ride).lift, made.look(ride).ahead) == (Phase.CALLED, "B", 1)

    in_building(check, "A", "B", hours={"A": RobotHours((read_hours("Sat 11:00-12:01"),))})


def test_rides_that_lose_their_lift_at_the_same_moment_do_not_all_take_the_same_other_one() -> None:
    async def check(made: Building) -> None:
        others = made.drivers["B"], made.drivers["C"]
        for driver in others:
            driver.silent = True
        await elapse(3)
        assert made.ask("A", WORKSHOP) == Accepted()
        rides = [made.begin("any", robot=f"amr-{n}") for n in (1, 2)]
        assert {ride.lift for ride in rides} == {"A"}
        made.drivers["A"].silent = True
        for driver in others:
            driver.silent = False
        await elapse(5)
        assert {made.look(ride).lift for ride in rides} == {"B", "C"}
        for ride in rides:
            moved = [one for one in made.changes if one.id == ride.id and one.lift != "A"]
            assert {one.lift for one in moved} == {made.look(ride).lift}, "it went there at once"
            assert not [one for one in moved if "A is" in one.reason], "what it waits for is that of its new lift"

    in_building(check, "A", "B", "C")


def test_lifts_are_listened_to_only_for_as_long_as_a_ride_matters() -> None:
    async def check(made: Building) -> None:
        received = [made.bus.received]
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        received.append(made.bus.received)
        await made.taken_away()
        await elapse(5)
        received.append(made.bus.received)  # its robot may be inside
        made.report(ride, RideWord.LEFT)
        await elapse(5)
        received.append(made.bus.received)
        assert received == [False, True, True, False]

    in_building(check, "A")


def test_a_row_of_a_ride_has_the_id_of_its_event() -> None:
    recorder = MemoryRecorder()

    async def check(made: Building) -> None:
        ride = made.begin("A")
        await elapse(1)
        made.cancel(ride)
        rows = [row for row in recorder.rows if "ride" in row.data]
        changes = {one.id: one.event.ride.phase for one in made.heard if isinstance(one.event, RideChanged)}
        assert [(row.data["phase"], changes[row.event]) for row in rows] == [
            (phase, phase) for phase in ("queued", "called", "cancelled")
        ]
        assert len({row.event for row in rows}) == len(rows)

    in_building(check, "A", recorder=recorder)


def test_an_alarm_of_a_ride_is_published_and_written_down_under_the_same_id() -> None:
    recorder = MemoryRecorder()

    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        made.report(ride, RideWord.ENTERED)
        await made.car("A", None)
        made.site.rides.cancel(ride.id, None, "drill")
        (alarm,) = (one for one in made.heard if isinstance(one.event, Alarm))
        assert isinstance(alarm.event, Alarm)
        assert alarm.event.text.startswith("ride_cancelled: a robot of ride:fleet/amr-1 is in the car of A")
        (row,) = (row for row in recorder.rows if row.kind is RowKind.ALARM)
        assert (row.event, row.text, row.lift) == (alarm.id, alarm.event.text, "A")

    in_building(check, "A", recorder=recorder)


def test_a_ride_that_is_forgotten_is_saved_no_more() -> None:
    recorder = MemoryRecorder()

    def saved() -> int:
        found = recorder.recall("A")
        return 0 if found is None else len(found.rides)

    async def check(made: Building) -> None:
        ride = made.begin("A", key="k1")
        made.cancel(ride)
        await elapse(ENDED_FOR_S - 10)
        assert saved() == 1
        await elapse(20)
        assert made.site.rides.all() == ()
        assert saved() == 0

    in_building(check, "A", recorder=recorder)


def test_rides_of_an_earlier_process_are_known_before_anything_runs() -> None:
    recorder = MemoryRecorder()

    async def main() -> None:
        async with building("A", "B", recorder=recorder) as made:
            first = made.begin("B")
            await elapse(1)
            called = made.begin("A", robot="amr-2")
            await elapse(1)
            made.begin("A", robot="amr-3")
        async with building("A", "B", recorder=recorder, runs=False) as made:
            assert [one.id for one in made.site.rides.all()][:2] == [first.id, called.id], "the oldest first"
            assert made.look(first).phase is made.look(called).phase is Phase.CALLED, "their lifts know their sessions"
            assert made.begin("A", robot="amr-4").ahead == 2, "those that waited keep their places"

    run_virtual(main)
