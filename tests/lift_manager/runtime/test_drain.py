"""A drain: sessions that go on end by themselves, and no new one begins until a person says so."""

from datetime import UTC, datetime

from lift_manager.lift.events import Restriction, RestrictionBegun, RestrictionEnded, RestrictionKind, SessionEnded
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Guidance, Phase
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.phases import door_held
from tests.lift_manager.runtime.ride_building import Building, in_building
from tests.support.refusals import refusal
from tests.support.spine import Spine, on_spine, spine
from tests.support.virtual_time import elapse, run_virtual

AT = datetime(2026, 3, 2, 21, 30, tzinfo=UTC)
TEXT = "drain by M. Weber since 2026-03-02 21:30: new ropes"
OTHER = Holder("api", "amr-8")


def drained(made: Spine) -> Restriction:
    return made.site.begin_drain("lift", "M. Weber", "new ropes")


def test_a_drain_leaves_the_session_that_goes_on_alone_and_refuses_every_new_one() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        with made.bus.listen() as listener:
            drain = drained(made)
            assert made.state.robot_door is RobotDoor.OPEN
            assert made.state.restrictions.drain == TEXT.removeprefix("drain ")
            made.accept("L3")
            await made.until(lambda state: state.floor == "L3" and state.robot_door is RobotDoor.OPEN)
            events = await heard(listener)
        assert only(events, RestrictionBegun) == [RestrictionBegun("lift", drain)]
        assert only(events, SessionEnded) == []
        made.accept("L3", hold=False)
        assert made.state.holder is None
        refused = made.refuse("L2")
        assert refused.code is Refusal.DRAINING
        assert TEXT in refused.message
        assert "`lift-manager drain lift --by NAME --end`" in refused.message
        made.site.end_drain("lift", "A. Beck")
        made.accept("L2")

    on_spine(check, clock=lambda: AT)


def test_a_drain_survives_a_restart_as_a_lockout_does() -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory, clock=lambda: AT) as made:
            drain = drained(made)
        async with spine(recorder=memory, clock=lambda: AT) as made:
            assert made.refuse("L2").code is Refusal.DRAINING
            with made.bus.listen() as listener:
                ended = made.site.end_drain("lift", "A. Beck")
                assert only(await heard(listener), RestrictionEnded) == [RestrictionEnded("lift", "A. Beck", AT, drain)]
            assert ended == RestrictionEnded("lift", "A. Beck", AT, drain)
            made.accept("L2")

    run_virtual(main)


def test_a_second_drain_does_not_replace_the_first_and_none_cannot_be_ended() -> None:
    async def check(made: Spine) -> None:
        nothing = refusal(made.site.end_drain, "lift", "A. Beck")
        assert nothing.code is Refusal.NOT_DRAINING
        drain = drained(made)
        second = refusal(made.site.begin_drain, "lift", "A. Beck", "cleaning")
        assert second.code is Refusal.DRAINING
        assert made.site.durable("lift").restriction(RestrictionKind.DRAIN) == drain

    on_spine(check, clock=lambda: AT)


def test_a_ride_waits_in_its_queue_for_the_end_of_a_drain() -> None:
    async def check(made: Building) -> None:
        made.site.begin_drain("A", "M. Weber", "new ropes")
        ride = made.begin("A")
        await elapse(5)
        waiting = made.look(ride)
        assert (waiting.phase, waiting.guidance) == (Phase.QUEUED, Guidance.WAIT)
        assert "no new session begins on A" in waiting.reason
        made.site.end_drain("A", "M. Weber")
        await elapse(3)
        assert made.look(ride).phase is Phase.CALLED

    in_building(check, "A")


def test_a_ride_says_before_its_door_is_released_that_nobody_sets_out() -> None:
    async def check(made: Building) -> None:
        ride = made.begin("A")
        await made.car("A", "L1", Door.OPEN)
        assert made.look(ride).guidance is Guidance.ENTER
        made.site.force_release("A", "M. Weber", "it blocks the lift")
        told = made.look(ride)
        assert told.guidance is Guidance.WAIT
        assert told.reason == "the door at L1 is released in 10 s: do not set out; on the sill, finish crossing"
        await elapse(9.5)
        assert made.look(ride).phase is Phase.BOARDING
        await elapse(1)
        assert made.look(ride).phase is Phase.GAVE_UP

    in_building(check, "A")
