"""Rides that wait for each other, for other faces, for people, and for a lift that can take them."""

import asyncio
from dataclasses import replace

from lift_manager.lift.hours import RobotHours, read_hours
from lift_manager.lift.refusals import Accepted, Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Guidance, Phase, Ride, RideLimits, RidePlan, RideWord
from lift_manager.rides.rides import MOST, MOST_ENDED, MOST_OF_ONE
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode
from tests.lift_manager.runtime.ride_building import RMF, Building, building, in_building
from tests.support.refusals import refusal
from tests.support.virtual_time import elapse, run_virtual

SHORT = RideLimits(queued_s=20.0, called_s=20.0, boarding_s=20.0, riding_s=20.0, alighting_s=20.0)


async def boarded(made: Building, ride: Ride, lift: str = "A") -> None:
    """Bring the car to the robot, and let it say that it is inside."""
    await made.car(lift, "L1", Door.OPEN)
    made.report(ride, RideWord.ENTERED)


async def ridden(made: Building, ride: Ride, lift: str = "A") -> None:
    """Bring a ride to its end."""
    await boarded(made, ride, lift)
    await made.car(lift, None)
    await made.car(lift, "L3", Door.OPEN)
    made.report(ride, RideWord.LEFT)
    await made.car(lift, "L3")


async def asked_by_rmf(made: Building) -> None:
    """Ask every second, as RMF does, until the lift is RMF's."""
    while isinstance(made.ask("A"), RequestRefused):
        await elapse(1)


def test_rides_and_rmf_stand_in_one_line() -> None:
    async def check(made: Building) -> None:
        first = made.begin("A", robot="amr-1")
        second = made.begin("A", robot="amr-2")
        rmf = asyncio.ensure_future(asked_by_rmf(made))
        await elapse(0)
        third = made.begin("A", robot="amr-3")
        assert (first.phase, second.phase, third.phase) == (Phase.CALLED, Phase.QUEUED, Phase.QUEUED)
        assert (second.ahead, third.ahead) == (1, 3)
        assert second.reason == "A is held by ride:fleet/amr-1"
        await ridden(made, first)
        await elapse(1)
        assert (made.look(second).phase, rmf.done()) == (Phase.CALLED, False)
        await ridden(made, second)
        await rmf
        await elapse(1)
        assert (made.look(third).phase, made.look(third).reason) == (Phase.QUEUED, "A is held by rmf:tiny/robot1")
        await made.car("A", "L1", Door.OPEN)
        assert made.ask("A", hold=False) == Accepted()
        await elapse(2)
        assert made.look(third).phase in (Phase.CALLED, Phase.BOARDING)

    in_building(check, "A")


def test_the_rides_of_one_robot_take_turns_with_those_of_others() -> None:
    async def check(made: Building) -> None:
        first, second, third = made.begin("A"), made.begin("A"), made.begin("A")
        other = made.begin("A", robot="amr-9")
        assert made.look(second).phase is Phase.QUEUED
        for ride, waits in ((first, second), (second, other), (other, third)):
            assert (made.look(ride).phase, made.look(waits).phase) == (Phase.CALLED, Phase.QUEUED)
            await ridden(made, ride)
            await elapse(1)
        assert made.look(third).phase is Phase.CALLED

    in_building(check, "A")


def test_any_takes_the_lift_that_is_free_and_moves_to_another_when_its_own_is_lost() -> None:
    async def check(made: Building) -> None:
        assert made.ask("A") == Accepted()
        ride = made.begin("any")
        assert (ride.lift, ride.phase) == ("B", Phase.CALLED)
        waiting = made.begin("any", robot="amr-2")
        assert (waiting.lift, waiting.phase) == ("A", Phase.QUEUED)
        made.drivers["A"].silent = True
        await elapse(10)
        assert made.look(waiting).lift == "B"
        await ridden(made, ride, "B")
        await elapse(2)
        assert (made.look(waiting).lift, made.look(waiting).phase) == ("B", Phase.CALLED)

    in_building(check, "A", "B")


def test_any_leaves_a_lift_that_refuses_it_for_one_that_does_not() -> None:
    async def check(made: Building) -> None:
        assert made.begin("any").lift == "B"
        named = made.begin("A", robot="amr-2")
        assert (named.phase, named.lift) == (Phase.QUEUED, "A")
        assert "takes robots Sun 00:00-24:00" in named.reason

    in_building(check, "A", "B", hours={"A": RobotHours((read_hours("Sun 00:00-24:00"),))})


def test_a_ride_that_no_lift_can_ever_take_is_refused() -> None:
    async def check(made: Building) -> None:
        refused = made.refuse(made.request("any", destination="L9"))
        assert refused.code is Refusal.UNKNOWN_FLOOR
        assert "A has no floor 'L9'" in refused.message
        unknown = made.refuse(made.request("C"))
        assert (unknown.code, unknown.message) == (Refusal.UNKNOWN_LIFT, "no lift 'C'; the lifts are A, B")
        assert made.site.rides.all() == ()

    in_building(check, "A", "B", floors={"B": ("L1", "L2")})


def test_refusals_are_counted_by_lift_and_looking_for_a_ride_is_no_request() -> None:
    async def check(made: Building) -> None:
        ride, rides = made.begin("A"), made.site.rides
        made.refuse(made.request("B", destination="L9"))
        made.refuse(made.request("C"))
        made.refuse(made.request("any", destination="L9"))
        refusal(lambda: made.report(ride, RideWord.LEFT))
        refusal(lambda: rides.cancel(ride.id, RMF, "mine"))
        refusal(lambda: rides.cancel("none", None, "drill"))
        assert made.site.refusals.counts == {
            ("B", "unknown_floor"): 1,
            ("", "unknown_lift"): 1,
            ("", "unknown_floor"): 1,
            ("A", "not_now"): 1,
            ("A", "not_your_ride"): 1,
            ("", "unknown_ride"): 1,
        }
        refusal(lambda: rides.ride("none"))
        assert made.site.refusals.counts["", "unknown_ride"] == 1

    in_building(check, "A", "B")


def test_what_its_lift_refuses_a_ride_is_counted() -> None:
    async def check(made: Building) -> None:
        assert made.begin("A").phase is Phase.QUEUED
        assert made.site.refusals.counts == {("A", "outside_hours"): 1}

    in_building(check, "A", hours={"A": RobotHours((read_hours("Sun 00:00-24:00"),))})


def test_a_named_lift_that_cannot_take_robots_is_waited_for_until_the_limit() -> None:
    async def check(made: Building) -> None:
        made.drivers["A"].values = replace(made.drivers["A"].values, mode=Mode.INSPECTION)
        await elapse(1)
        ride = made.begin("A", limits=SHORT)
        assert (ride.phase, ride.reason) == (Phase.QUEUED, "the mode of A is inspection")
        await elapse(21)
        over = made.look(ride)
        assert (over.phase, over.guidance) == (Phase.GAVE_UP, Guidance.GAVE_UP)
        assert over.reason == "it waited for 20 s: the mode of A is inspection"

    in_building(check, "A")


def test_a_plan_says_what_a_ride_would_come_to_and_begins_nothing() -> None:
    async def check(made: Building) -> None:
        assert made.site.rides.plan(made.request("A")) == RidePlan("A", 0, "")
        made.begin("A")
        made.begin("A", robot="amr-2")
        told = len(made.changes)
        plan = made.site.rides.plan(made.request("A", robot="amr-3"))
        assert plan == RidePlan("A", 2, "A is held by ride:fleet/amr-1")
        refused = refusal(lambda: made.site.rides.plan(made.request("A", destination="L9")))
        assert refused.code is Refusal.UNKNOWN_FLOOR
        await elapse(5)
        assert len(made.site.rides.all()) == 2
        assert len(made.changes) == told

    in_building(check, "A")


def test_the_same_key_of_the_same_caller_gives_the_same_ride_for_as_long_as_it_is_remembered() -> None:
    async def check(made: Building) -> None:
        first = made.begin("A", key="k1")
        again = made.site.rides.begin(made.request("A", key="k1"))
        assert (again.ride.id, again.is_new) == (first.id, False)
        await ridden(made, first)
        over = made.site.rides.begin(made.request("A", key="k1"))
        assert (over.ride.id, over.ride.phase, over.is_new) == (first.id, Phase.DONE, False)
        other = made.site.rides.begin(made.request("A", key="k2"))
        assert other.is_new

    in_building(check, "A")


def test_rides_and_their_order_outlive_the_manager() -> None:
    recorder = MemoryRecorder()

    async def main() -> None:
        async with building("A", recorder=recorder) as made:
            first, second, third = (made.begin("A", robot=f"amr-{n}", key=f"k{n}") for n in (1, 2, 3))
            await elapse(1)
        async with building("A", recorder=recorder) as made:
            await elapse(1)
            assert [ride.id for ride in made.site.rides.all()] == [first.id, second.id, third.id]
            assert made.look(first).phase is Phase.CALLED
            assert "waits for a report of the robot" in made.look(first).reason
            assert not any(line.startswith("press") for line in made.drivers["A"].log)
            for n in (3, 2, 1):
                answer = made.site.rides.begin(made.request("A", robot=f"amr-{n}", key=f"k{n}"))
                assert not answer.is_new
            assert (made.look(second).ahead, made.look(third).ahead) == (1, 2)
            await ridden(made, first)
            await elapse(1)
            assert (made.look(second).phase, made.look(third).phase) == (Phase.CALLED, Phase.QUEUED)

    run_virtual(main)


def test_a_queued_ride_whose_robot_is_not_heard_after_a_restart_keeps_nobody_waiting_for_long() -> None:
    recorder = MemoryRecorder()

    async def main() -> None:
        async with building("A", recorder=recorder) as made:
            made.ask("A")
            silent = made.begin("A", robot="amr-1")
            await elapse(1)
        async with building("A", recorder=recorder) as made:
            assert made.ask("A", hold=False) == Accepted()
            other = made.begin("A", robot="amr-2")
            assert made.look(other).phase is Phase.QUEUED
            await elapse(32)
            assert made.look(other).phase in (Phase.CALLED, Phase.BOARDING)
            assert made.look(silent).phase is Phase.QUEUED

    run_virtual(main)


def test_the_limits_of_a_ride_go_on_over_a_restart() -> None:
    recorder = MemoryRecorder()

    async def main() -> None:
        async with building("A", recorder=recorder) as made:
            ride = made.begin("A", limits=SHORT)
        await elapse(30)
        async with building("A", recorder=recorder) as made:
            over = made.look(ride)
            assert over.phase is Phase.GAVE_UP

    run_virtual(main)


def test_a_robot_that_may_go_in_after_a_restart_may_while_the_door_that_stayed_open_is_written_down_for_it() -> None:
    recorder = MemoryRecorder()

    async def main() -> None:
        async with building("A", recorder=recorder) as made:
            ride = made.begin("A")
            await made.car("A", "L1", Door.OPEN)
            found, left_on = made.drivers["A"].values, frozenset(made.drivers["A"].on)
        async with building("A", recorder=recorder, found=found, left_on=left_on) as made:
            await elapse(1)
            made.report(ride, RideWord.HERE)
            assert made.look(ride).guidance is Guidance.ENTER
            reported = len(made.changes)
            await elapse(20)
            assert made.changes[reported:] == []
            assert "hold_door.front" in made.drivers["A"].begun, "it is only kept, and for nobody"

    run_virtual(main)


def test_words_and_cancels_are_the_callers_or_an_operators() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        stranger = Holder("ride", "stranger")
        rides = made.site.rides
        for refused in (
            refusal(lambda: rides.report(ride.id, RideWord.HERE, stranger)),
            refusal(lambda: rides.cancel(ride.id, stranger, "mine")),
        ):
            assert refused.code is Refusal.NOT_YOUR_RIDE
        assert refusal(lambda: rides.report("none", RideWord.HERE, None)).code is Refusal.UNKNOWN_RIDE
        assert refusal(lambda: rides.ride("none")).code is Refusal.UNKNOWN_RIDE
        over = rides.cancel(ride.id, None, "drill")
        assert (over.phase, over.reason) == (Phase.CANCELLED, "withdrawn by an operator: drill")
        assert made.site.state("A").holder is None

    in_building(check, "A")


def test_a_person_who_looked_ends_the_doubt_of_a_ride_that_gave_up() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await boarded(made, ride)
        await made.car("A", None)
        await made.taken_away()
        assert (made.look(ride).phase, made.look(ride).maybe_aboard) == (Phase.GAVE_UP, True)
        waiting = made.begin("A", robot="amr-2")
        assert made.look(waiting).reason.startswith("a robot of ride:fleet/amr-1 may be in the car")
        await made.car("A", "L2")
        made.site.acknowledge("A", "Ana")
        await elapse(1)
        assert not made.look(ride).maybe_aboard
        assert made.look(waiting).phase is Phase.CALLED

    in_building(check, "A")


def test_a_robot_that_says_later_that_it_left_frees_the_lift() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        assert made.look(ride).guidance is Guidance.ENTER
        await made.taken_away()
        assert made.look(ride).maybe_aboard
        left = made.report(ride, RideWord.LEFT)
        assert (left.phase, left.maybe_aboard) == (Phase.GAVE_UP, False)
        assert made.site.state("A").restrictions.maybe_aboard is None

    in_building(check, "A")


def test_the_next_ride_of_a_robot_that_may_be_in_the_car_ends_the_doubt_once_it_left() -> None:
    async def check(made: Building) -> None:
        first = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        await made.taken_away()
        assert made.look(first).maybe_aboard
        second = made.begin("A")
        await elapse(1)
        assert made.look(second).phase is not Phase.QUEUED
        left = made.report(second, RideWord.LEFT)
        assert (left.phase, left.maybe_aboard) == (Phase.CANCELLED, False)
        assert not made.look(first).maybe_aboard

    in_building(check, "A")


def test_more_rides_than_the_book_holds_are_refused_and_of_those_that_ended_the_newest_are_known() -> None:
    async def check(made: Building) -> None:
        rides = []
        for n in range(MOST):
            request = replace(made.request("A", robot=f"amr-{n}"), caller=Holder("ride", f"fleet/{n // MOST_OF_ONE}"))
            rides.append(made.site.rides.begin(request).ride)
        refused = made.refuse(made.request("A", robot="one-more"))
        assert (refused.code, refused.message.startswith(f"{MOST} rides of all callers")) == (Refusal.TOO_MANY, True)
        for ride in rides:
            made.site.rides.cancel(ride.id, ride.caller, "no order")
        made.begin("A", robot="one-more")
        await elapse(2)
        assert len(made.site.rides.all()) == MOST_ENDED + 1

    in_building(check, "A")


def test_the_journal_has_each_phase_of_a_ride_once() -> None:
    recorder = MemoryRecorder()

    async def check(made: Building) -> None:
        ride = made.begin("A")
        await ridden(made, ride)
        rows = [row for row in recorder.rows if row.data.get("ride") == ride.id]
        assert [row.data["phase"] for row in rows] == ["queued", "called", "boarding", "riding", "alighting", "done"]
        assert {row.caller for row in rows} == {"ride:fleet"}
        assert rows[0].text == f"ride {ride.id} of amr-1 from L1 to L3 is queued"

    in_building(check, "A", recorder=recorder)


def test_a_manager_that_stops_begins_no_ride_and_keeps_those_that_go_on() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await boarded(made, ride)
        await made.life.stop()
        await elapse(1)
        told = made.look(ride)
        assert (told.phase, told.guidance) == (Phase.RIDING, Guidance.STAY)
        assert "continues at the next start" in told.reason
        refused = made.refuse(made.request("A", robot="amr-2"))
        assert refused.code is Refusal.STOPPING
        assert refusal(lambda: made.site.rides.plan(made.request("A", robot="amr-2"))).code is Refusal.STOPPING

    in_building(check, "A")
