"""Fire, two doors, and what a ride does to a lift on which nothing may be pressed."""

from dataclasses import replace

from drivers.model import OutputChanged, OutputState
from lift_manager.lift.events import Advised
from lift_manager.lift.session import Advice
from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import Guidance, Phase, RideWord
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode, Side
from tests.lift_manager.runtime.ride_building import Building, in_building
from tests.lift_manager.runtime.scripted import PLAIN
from tests.support.virtual_time import elapse


def test_the_advice_of_a_fire_reaches_the_ride_at_the_moment_it_is_given() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        made.report(ride, RideWord.ENTERED)
        await made.car("A", None)
        made.drivers["A"].values = replace(made.drivers["A"].values, mode=Mode.FIRE)
        await elapse(1)
        advised = next(one for one in made.heard if isinstance(one.event, Advised))
        told = next(
            one
            for one in made.heard
            if isinstance(one.event, RideChanged) and one.event.ride.guidance is Guidance.GAVE_UP
        )
        assert told.at == advised.at
        assert made.site.state("A").holder is not None, "everything is released only later"
        over = made.look(ride)
        assert (over.phase, over.advice, over.maybe_aboard) == (Phase.GAVE_UP, Advice.STAY_ABOARD, True)
        await elapse(10)
        assert made.look(ride) == over

    in_building(check, "A", fire_release_delay_s=5.0)


def test_a_robot_goes_in_only_once_every_door_of_the_floor_stands_open() -> None:
    both = (Side.FRONT, Side.REAR)
    commands = frozenset({"go_to", "hold_door.front", "hold_door.rear"})
    holds = frozenset({"hold_door.front", "hold_door.rear"})
    able = replace(PLAIN, commands=commands, held_commands=holds, doors=both)

    async def check(made: Building) -> None:
        ride = made.begin("A")
        for rear, guidance in (
            (Door.OPENING, Guidance.WAIT),
            (Door.OPEN, Guidance.ENTER),
            (Door.CLOSING, Guidance.WAIT),
        ):
            await made.car("A", "L1", Door.OPEN)
            driver = made.drivers["A"]
            driver.values = replace(driver.values, doors={Side.FRONT: Door.OPEN, Side.REAR: rear})
            await elapse(1)
            told = made.look(ride)
            assert told.guidance is guidance
            assert rear is Door.OPEN or "rear" in told.reason

    in_building(check, "A", able=able)


def test_a_robot_that_looks_at_the_moment_its_door_is_lost_is_told_so() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        assert made.look(ride).guidance is Guidance.ENTER
        made.drivers["A"].above.report(OutputChanged("hold_door.front", OutputState.LOST))
        seen = made.look(ride)
        assert seen.guidance is Guidance.WAIT
        assert seen.reason == "the door at L1 is open, and is not held yet: waits for the hold"

    in_building(check, "A")


def test_nothing_is_pressed_for_a_ride_while_it_cannot_be_written_down() -> None:
    recorder = MemoryRecorder()

    async def check(made: Building) -> None:
        recorder.trouble = "state: the disk is full"
        ride = made.begin("A")
        await elapse(20)
        told = made.look(ride)
        assert told.phase is Phase.QUEUED
        assert "the disk is full" in told.reason
        assert made.drivers["A"].log == []
        recorder.trouble = ""
        await elapse(10)
        assert made.look(ride).phase is Phase.CALLED

    in_building(check, "A", recorder=recorder)


def test_a_cancelled_ride_lets_its_robot_out_at_the_next_stop_and_leaves_the_car_there() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        made.report(ride, RideWord.ENTERED)
        await made.car("A", None)
        cancelled = made.cancel(ride)
        assert (cancelled.phase, cancelled.guidance) == (Phase.CLEARING, Guidance.STAY)
        await made.car("A", "L2")
        await elapse(2)
        assert made.site.state("A").destination == "L2"
        assert made.drivers["A"].log[-1] == "hold hold_door.front"
        await made.car("A", "L2", Door.OPEN)
        assert made.look(ride).guidance is Guidance.LEAVE
        over = made.report(ride, RideWord.LEFT)
        assert (over.phase, over.maybe_aboard) == (Phase.CANCELLED, False)
        state = made.site.state("A")
        assert (state.holder, state.restrictions.maybe_aboard) == (None, None)

    in_building(check, "A")
