"""A robot that may be in a car nobody holds: which ride takes the lift then, and whose word ends the doubt."""

from dataclasses import replace

import pytest

from lift_manager.lift.commands import CommandRequest, CommandType
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Guidance, Phase, Ride, RideLimits, RideWord
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Motion, Side
from tests.lift_manager.runtime.ride_building import Building, building, in_building
from tests.support.refusals import refusal, reply
from tests.support.virtual_time import elapse, run_virtual

SHORT = RideLimits(queued_s=600.0, called_s=60.0, boarding_s=20.0, riding_s=20.0, alighting_s=20.0)


async def left_inside(made: Building, robot: str = "amr-1", lift: str = "A") -> Ride:
    """Let a person take the lift away from a robot inside."""
    ride = made.begin(lift, robot=robot)
    await made.car(lift, "L1", Door.OPEN)
    made.report(ride, RideWord.ENTERED)
    await made.car(lift, None)
    await made.taken_away(lift)
    return ride


@pytest.mark.parametrize("forced", [False, True], ids=["late", "taken away by a person"])
def test_a_ride_begun_beforehand_does_not_send_the_car_away_with_a_robot_half_in(*, forced: bool) -> None:
    async def check(made: Building) -> None:
        one = made.begin("A", limits=SHORT)
        back = made.begin("A", start="L3", destination="L1")
        await made.car("A", "L1", Door.OPEN)
        assert made.look(one).guidance is Guidance.ENTER
        if forced:
            await made.taken_away()
        else:
            await elapse(60)
        assert (made.look(one).phase, made.look(one).maybe_aboard) == (Phase.GAVE_UP, True)
        pressed = list(made.drivers["A"].log)
        await elapse(60)
        waiting = made.look(back)
        assert (waiting.phase, made.drivers["A"].log) == (Phase.QUEUED, pressed)
        assert waiting.reason.startswith(f"your robot may be in the car of A: send `left` for ride {one.id}")
        made.report(back, RideWord.HERE)
        assert made.look(back).phase is Phase.CALLED

    in_building(check, "A")


def test_a_ride_begun_beforehand_goes_on_once_the_robot_says_that_it_left() -> None:
    async def check(made: Building) -> None:
        one = made.begin("A")
        back = made.begin("A", start="L3", destination="L1")
        await made.car("A", "L1", Door.OPEN)
        await made.taken_away()
        assert made.report(one, RideWord.LEFT).maybe_aboard is False
        await elapse(1)
        assert made.look(back).phase is Phase.CALLED

    in_building(check, "A")


def test_a_ride_begun_at_the_moment_the_lift_was_taken_away_is_the_word_of_the_robot_inside() -> None:
    async def check(made: Building) -> None:
        one = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        made.site.force_release("A", "Ana", "needed", at_once=True)
        again = made.begin("A", start="L2")
        assert (made.look(one).phase, again.phase) == (Phase.GAVE_UP, Phase.CALLED)

    in_building(check, "A")


def test_a_ride_begun_from_afar_says_nothing_about_the_robot_that_may_be_inside() -> None:
    async def check(made: Building) -> None:
        inside = await left_inside(made)
        pressed = list(made.drivers["A"].log)
        request = made.request("A", start="L3", destination="L1", key="k1")
        ride = made.site.rides.begin(request, is_remote=True).ride
        assert made.site.rides.begin(request, is_remote=True).ride.id == ride.id
        await elapse(20)
        assert (made.look(ride).phase, made.look(inside).maybe_aboard) == (Phase.QUEUED, True)
        made.site.rides.cancel(inside.id, None, "not needed")
        assert made.site.rides.begin(request).ride.id == ride.id, "the robot may send the request of its ride itself"
        await elapse(2)
        assert made.look(ride).reason.startswith(f"your robot may be in the car of A: send `left` for ride {inside.id}")
        assert made.drivers["A"].log == pressed
        made.report(ride, RideWord.HERE)
        assert made.look(ride).phase is Phase.CALLED

    in_building(check, "A")


def test_the_ride_of_a_robot_inside_passes_the_line() -> None:
    async def check(made: Building) -> None:
        await left_inside(made)
        head = made.begin("A", robot="amr-2")
        again = made.begin("A", start="L2", destination="L4")
        await elapse(1)
        assert (made.look(again).phase, made.look(head).phase) == (Phase.CALLED, Phase.QUEUED)

    in_building(check, "A")


def test_a_robot_without_a_name_is_not_taken_for_the_one_inside() -> None:
    async def check(made: Building) -> None:
        inside = made.begin("A", robot="")
        await made.car("A", "L1", Door.OPEN)
        made.report(inside, RideWord.ENTERED)
        other = made.begin("B", robot="")
        await elapse(3)
        assert made.look(other).phase is Phase.QUEUED
        assert "waits until that ride is over" in made.look(other).reason
        await made.car("A", None)
        await made.taken_away()
        later = made.begin("A", robot="", start="L2", destination="L4")
        await made.car("A", "L2", Door.OPEN)
        assert made.look(later).phase is Phase.QUEUED
        assert "give each its name with `robot`" in made.look(later).reason
        assert made.report(later, RideWord.HERE).phase is not Phase.QUEUED

    in_building(check, "A", "B")


def test_a_robot_that_may_be_in_one_car_is_given_no_other() -> None:
    async def check(made: Building) -> None:
        one = await left_inside(made)
        await made.car("A", "L4")
        refused = made.refuse(made.request("B"))
        assert refused.code is Refusal.NOT_NOW
        assert f"your robot may be in the car of A: send `left` for ride {one.id}" in refused.message
        assert made.begin("B", robot="amr-2").phase is Phase.CALLED
        assert made.begin("any").lift == "A"

    in_building(check, "A", "B")


def test_the_word_on_the_old_ride_is_heard_where_the_robot_has_a_ride_that_took_its_car_up() -> None:
    async def check(made: Building) -> None:
        one = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        await made.taken_away()
        await made.car("A", "L1")
        two = made.begin("A")
        await elapse(1)
        assert (made.look(two).phase, made.look(two).maybe_aboard) == (Phase.CALLED, True)
        assert not made.report(one, RideWord.LEFT).maybe_aboard
        assert (made.look(two).phase, made.look(two).maybe_aboard) == (Phase.CANCELLED, False)
        assert made.maybe_aboard() is None

    in_building(check, "A")


def test_a_robot_that_entered_its_second_ride_does_not_leave_a_shut_car_by_a_word_on_the_first() -> None:
    async def check(made: Building) -> None:
        one = await left_inside(made)
        two = made.begin("A", start="L2", destination="L4")
        await elapse(1)
        made.report(two, RideWord.ENTERED)
        refused = refusal(lambda: made.report(one, RideWord.LEFT))
        assert "has not stood open" in refused.message
        assert made.maybe_aboard() == Holder("ride", "fleet/amr-1")

    in_building(check, "A")


@pytest.mark.parametrize("motion", [Motion.STOPPED, Motion.UP])
def test_in_a_session_no_robot_left_a_car_that_moves_with_its_door_shut(motion: Motion) -> None:
    robot = Holder("api", "amr-7")

    async def check(made: Building) -> None:
        opened = made.site.open_session("A", robot)
        request = CommandRequest(session=opened.session.id, holder=robot, kind=CommandType.GO_TO, floor="L1")
        made.site.command("A", request)
        await made.car("A", "L1", Door.OPEN)
        in_place = replace(request, kind=CommandType.ROBOT_IN_PLACE, floor=None)
        made.site.command("A", in_place)
        await made.car("A", "L1", Door.OPEN)
        driver = made.drivers["A"]
        driver.values = replace(driver.values, doors={Side.FRONT: Door.CLOSED}, motion=motion)
        await elapse(1)
        left = reply(lambda: made.site.command("A", replace(in_place, kind=CommandType.ROBOT_LEFT)))
        assert isinstance(left, RequestRefused) is (motion is Motion.UP), left

    in_building(check, "A")


def test_a_ride_that_ended_without_a_key_and_with_its_robot_inside_outlives_the_manager() -> None:
    recorder = MemoryRecorder()

    async def main() -> None:
        async with building("A", recorder=recorder) as made:
            one = await left_inside(made)
        async with building("A", recorder=recorder) as made:
            await made.car("A", "L2", Door.OPEN)
            assert (made.look(one).phase, made.look(one).maybe_aboard) == (Phase.GAVE_UP, True)
            assert not made.report(one, RideWord.LEFT).maybe_aboard
            assert made.maybe_aboard() is None

    run_virtual(main)


def test_that_a_robot_is_inside_is_written_down_though_its_ride_is_being_cancelled() -> None:
    recorder = MemoryRecorder()

    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        made.cancel(ride)
        await made.car("A", None)
        assert made.look(ride).phase is Phase.CLEARING
        made.report(ride, RideWord.ENTERED)
        saved = recorder.recall("A")
        assert saved is not None
        assert [one.has_entered for one in saved.rides] == [True]

    in_building(check, "A", recorder=recorder)


def test_a_robot_that_waits_after_a_restart_is_told_the_word_and_the_time_it_has() -> None:
    recorder = MemoryRecorder()

    async def main() -> None:
        async with building("A", recorder=recorder) as made:
            made.ask("A")
            ride = made.begin("A")
            await elapse(1)
        async with building("A", recorder=recorder) as made:
            reasons = []
            for _ in range(2):
                reasons.append(made.look(ride).reason)
                await elapse(5)
            assert [" s to keep its place" in reason and "`here` within" in reason for reason in reasons] == [
                True,
                True,
            ]
            assert reasons[0] != reasons[1]
            await elapse(25)
            assert "it has lost its place" in made.look(ride).reason

    run_virtual(main)
