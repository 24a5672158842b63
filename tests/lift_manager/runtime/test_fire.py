"""Fire in every phase of a ride: robots are told, everything is released, and only a person ends it, over restarts too."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from lift_manager.lift.events import Acknowledged, Advised, Alarm, Cause, SessionEnded
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Advice, EndReason
from lift_manager.lift.state import Quality
from lift_manager.runtime.bus import Event
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode, Motion
from simulator.controller import Inputs
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.phases import PHASES, Phase, door_held, idle, outputs, travelling
from tests.lift_manager.runtime.scripted import FRONT, PERMITTING, PLAIN, Bench, boarded, on_bench
from tests.lift_manager.runtime.test_what_cannot_be_read import WITH_MODE
from tests.support.refusals import refusal
from tests.support.session_calls import saved
from tests.support.spine import OTHER, WORKSHOP, Spine, on_spine, spine
from tests.support.virtual_time import elapse, run_virtual

AT = datetime(2026, 3, 2, 21, 30, tzinfo=UTC)


async def fire_breaks_out(made: Spine) -> None:
    """Fire, and everything is released within a poll and the writes."""
    made.people(Inputs(fire=True))
    await made.until(lambda state: state.mode is Mode.FIRE, within_s=0.5)
    pressed = len(made.presses())
    await elapse(0.3)
    assert outputs(made) == [0, 0, 0, 0]
    assert made.state.holder is None
    for _ in range(100):
        assert made.state.robot_door is not RobotDoor.OPEN
        await elapse(0.1)
    assert len(made.presses()) == pressed
    assert outputs(made) == [0, 0, 0, 0]


@pytest.mark.parametrize("phase", PHASES)
def test_a_fire_latches_over_a_restart_until_a_person_acknowledges(phase: Phase) -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory, clock=lambda: AT) as made:
            await phase(made)
            await fire_breaks_out(made)
            assert made.state.restrictions.fire_latched
        async with spine(recorder=memory, clock=lambda: AT) as made:
            assert made.state.restrictions.fire_latched
            refused = made.refuse("L2", holder=OTHER)
            assert refused.code is Refusal.FIRE_LATCHED
            assert "(2026-03-02 21:30)" in refused.message
            assert "`lift-manager ack lift --by NAME`" in refused.message
            await elapse(10)
            assert made.device.writes == []
            said = made.site.acknowledge("lift", "M. Weber")
            assert (said.by, said.at, said.causes[0]) == ("M. Weber", AT, Cause.FIRE)
            assert made.site.durable("lift").acknowledged == said
        async with spine(recorder=memory) as made:
            assert saved(memory).acknowledged == said
            made.accept("L2", holder=OTHER)
            await made.until(lambda state: state.robot_door is RobotDoor.OPEN)

    run_virtual(main)


def test_a_fire_is_not_acknowledged_while_the_lift_tells_of_it_or_cannot_be_read() -> None:
    async def check(made: Spine) -> None:
        await fire_breaks_out(made)
        refused = refusal(made.site.acknowledge, "lift", "M. Weber")
        assert refused.code is Refusal.FIRE_ACTIVE
        made.people(Inputs())
        made.device.silent = True
        await made.until(lambda state: state.quality is Quality.OFFLINE)
        refused = refusal(made.site.acknowledge, "lift", "M. Weber")
        assert refused.code is Refusal.OFFLINE
        assert "nothing is acknowledged until its signal is read again" in refused.message
        made.device.silent = False
        await made.until(lambda state: state.quality is Quality.LIVE)
        assert made.refuse("L2").code is Refusal.FIRE_LATCHED
        made.site.acknowledge("lift", "M. Weber")
        made.accept("L2")

    on_spine(check)


def test_a_second_fire_latches_again() -> None:
    async def check(made: Spine) -> None:
        for _ in range(2):
            await fire_breaks_out(made)
            made.people(Inputs())
            await elapse(1)
            assert made.refuse("L2").code is Refusal.FIRE_LATCHED
            made.site.acknowledge("lift", "M. Weber")
        refused = refusal(made.site.acknowledge, "lift", "M. Weber")
        assert refused.code is Refusal.NOTHING_TO_ACKNOWLEDGE

    on_spine(check)


def test_a_watched_lift_latches_and_is_acknowledged_like_any_other() -> None:
    async def check(made: Spine) -> None:
        await fire_breaks_out(made)
        made.people(Inputs())
        await elapse(1)
        assert made.state.restrictions.fire_latched
        made.site.acknowledge("lift", "M. Weber")
        assert made.device.writes == []

    on_spine(check, control=False)


async def told_in_fire(made: Spine, phase: Phase) -> list[Event]:
    with made.bus.listen() as listener:
        await phase(made)
        await fire_breaks_out(made)
        return [event for event in await heard(listener) if isinstance(event, Advised | SessionEnded | Alarm)]


@pytest.mark.parametrize(("phase", "advice"), [(door_held, Advice.CLEAR_DOORWAY), (travelling, Advice.CLEAR_DOORWAY)])
def test_the_robot_is_told_before_its_session_ends(phase: Phase, advice: Advice) -> None:
    async def check(made: Spine) -> None:
        events = await told_in_fire(made, phase)
        advised, alarm = events[:2]
        assert advised == Advised("lift", WORKSHOP, advice, "there is a fire")
        assert isinstance(alarm, Alarm)
        assert (alarm.holder, alarm.text[:5]) == (WORKSHOP, "fire:")
        ended = events[-1]
        assert ended == SessionEnded("lift", WORKSHOP, EndReason.FIRE, "there is a fire", advice)

    on_spine(check)


def test_a_robot_that_rides_is_told_to_stay_aboard() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        made.accept("L3")
        await made.until(lambda state: state.motion is Motion.UP)
        events = await told_in_fire(made, idle)
        assert only(events, Advised) == [Advised("lift", WORKSHOP, Advice.STAY_ABOARD, "there is a fire")]
        assert made.state.restrictions.maybe_aboard == WORKSHOP

    on_spine(check)


def test_nobody_is_told_where_nobody_holds_the_lift() -> None:
    async def check(made: Spine) -> None:
        events = await told_in_fire(made, idle)
        assert not only(events, Advised)
        assert not only(events, SessionEnded)
        assert [alarm.holder for alarm in only(events, Alarm)] == [None]

    on_spine(check)


def test_where_the_site_wants_it_the_door_stays_held_for_a_while_after_the_robot_was_told() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        assert "hold_door.front" in made.driver.on
        await made.mode(Mode.FIRE)
        pressed = list(made.presses)
        assert [event.advice for event in only(await heard(made.heard), Advised)] == [Advice.CLEAR_DOORWAY]
        assert made.state.robot_door is RobotDoor.MOVING
        assert made.refuse("L3").code is Refusal.FIRE_LATCHED
        renewed = made.driver.renewed["hold_door.front"]
        await elapse(1.3)
        assert "hold_door.front" in made.driver.on
        assert made.driver.renewed["hold_door.front"] == renewed
        await elapse(0.5)
        assert made.driver.on == set()
        assert made.presses == pressed
        (ended,) = only(await heard(made.heard), SessionEnded)
        assert (ended.reason, ended.advice) == (EndReason.FIRE, Advice.CLEAR_DOORWAY)

    on_bench(check, PLAIN, fire_release_delay_s=2.0)


def test_the_delay_runs_on_when_the_alarm_ends_or_the_lift_falls_silent() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await made.mode(Mode.FIRE)
        made.driver.silent = True
        await elapse(2)
        assert made.driver.on == set()
        assert made.state.holder is None

    on_bench(check, PLAIN, fire_release_delay_s=2.0)


def test_a_holder_that_lets_go_during_the_delay_is_let_go_of_at_once() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await made.mode(Mode.FIRE)
        made.accept("L1", hold=False)
        assert made.driver.on == set()
        assert made.state.holder is None

    on_bench(check, PLAIN, fire_release_delay_s=2.0)


def test_a_fire_under_an_inspection_is_not_delayed() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await made.mode(Mode.FIRE)
        await made.mode(Mode.INSPECTION)
        assert made.driver.on == set()

    on_bench(check, PLAIN, fire_release_delay_s=5.0)


@pytest.mark.parametrize(
    "mode", [Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.OUT_OF_SERVICE, Mode.ATTENDANT]
)
def test_other_modes_of_people_end_the_session_at_once_with_reason_and_advice(mode: Mode) -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await made.mode(mode)
        assert made.driver.on == set()
        (ended,) = only(await heard(made.heard), SessionEnded)
        assert (ended.reason, ended.text, ended.advice) == (EndReason.MODE, f"the mode is {mode}", Advice.CLEAR_DOORWAY)
        await made.mode(Mode.NORMAL)
        made.accept("L1")

    on_bench(check, PLAIN, fire_release_delay_s=5.0)


def test_a_robot_known_to_be_aboard_behind_a_shut_door_is_told_to_stay() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.car(None, Door.CLOSED)
        await made.mode(Mode.FIRE)
        (ended,) = only(await heard(made.heard), SessionEnded)
        assert (ended.reason, ended.advice) == (EndReason.FIRE, Advice.STAY_ABOARD)
        await made.mode(Mode.NORMAL)
        said = made.site.acknowledge("lift", "M. Weber")
        assert said.causes == (Cause.FIRE, Cause.OCCUPIED)
        assert only(await heard(made.heard), Acknowledged) == [said]

    on_bench(check, PERMITTING)


def test_a_release_needs_no_advice() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L1", RobotWord.LEFT, hold=False)
        (ended,) = only(await heard(made.heard), SessionEnded)
        assert (ended.reason, ended.text, ended.advice) == (EndReason.RELEASED, "released", None)

    on_bench(check, PLAIN)


def test_robot_mode_of_a_car_under_way_is_dropped_in_a_fire_though_the_lift_still_grants_it() -> None:
    async def check(made: Bench) -> None:
        made.driver.values = replace(made.driver.values, flags={"robot_mode_on": True})
        made.accept("L1")
        await elapse(0.5)
        made.driver.values = replace(made.driver.values, floor=None, motion=Motion.UP)
        await elapse(0.5)
        made.accept("L2", RobotWord.LEFT, hold=False)
        await elapse(0.5)
        assert made.driver.on == {"robot_mode"}
        await made.mode(Mode.FIRE)
        assert made.driver.on == set()

    on_bench(check, WITH_MODE)


@pytest.mark.parametrize(
    ("signals", "after", "words"),
    [
        (
            {"fire"},
            {"flags": {}, "unknown": {"fire": 7}},
            "the signal fire of lift reads 7, which its map does not list",
        ),
        ({"fire", "fireman"}, {"flags": {"fire": False}}, "the signal fireman of lift cannot be read"),
        ({"mode"}, {"mode": Mode.UNKNOWN, "unknown": {"mode": 9}}, "the signal mode of lift reads 9"),
        ({"mode"}, {"mode": Mode.UNKNOWN}, "the signal mode of lift cannot be read"),
        ({"mode"}, {"mode": Mode.INSPECTION, "unknown": {"mode": 9}}, "the signal mode of lift reads 9"),
    ],
)
def test_a_fire_is_not_acknowledged_while_the_signal_that_tells_of_it_cannot_be_read(
    signals: set[str], after: dict[str, object], words: str
) -> None:
    async def check(made: Bench) -> None:
        healthy = replace(made.driver.values, flags=dict.fromkeys(signals - {"mode"}, False))
        made.driver.values = replace(healthy, mode=Mode.FIRE)
        await elapse(0.5)
        made.driver.values = replace(healthy, **after)  # type: ignore[arg-type]  # fields by name
        await elapse(0.5)
        refused = refusal(made.site.acknowledge, "lift", "M. Weber")
        assert refused.code is Refusal.FIRE_ACTIVE
        assert words in refused.message
        assert "nothing is acknowledged until its signal is read again" in refused.message
        made.driver.values = healthy
        await elapse(0.5)
        made.site.acknowledge("lift", "M. Weber")

    on_bench(check, replace(PLAIN, signals=PLAIN.signals | signals))


def test_a_car_is_found_empty_although_the_fire_signal_cannot_be_read_where_there_was_no_fire() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(31)
        said = made.site.acknowledge("lift", "M. Weber")
        assert said.causes == (Cause.OCCUPIED,)

    on_bench(check, replace(PLAIN, signals=PLAIN.signals | {"fire"}), lease_s=30)


@pytest.mark.parametrize("mode", [Mode.FIRE, Mode.INSPECTION])
def test_a_mode_that_is_read_in_a_poll_longer_than_a_reading_counts_still_lets_everything_go(mode: Mode) -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        assert made.driver.on == {"hold_door.front"}
        made.driver.takes_s = PLAIN.max_age_s + 0.2
        made.driver.values = replace(made.driver.values, mode=mode)
        await elapse(5)
        assert made.state.quality is Quality.OFFLINE
        assert made.driver.on == set()
        assert made.state.holder is None
        assert made.state.restrictions.fire_latched is (mode is Mode.FIRE)

    on_bench(check, PLAIN)


def test_after_a_fire_that_nobody_has_acknowledged_the_open_door_invites_nobody() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await made.mode(Mode.FIRE)
        await made.mode(Mode.NORMAL)
        assert made.state.doors == {FRONT: Door.OPEN}
        assert made.robot_door() is RobotDoor.MOVING
        made.site.acknowledge("lift", "M. Weber")
        # it was released, and has not been seen to close since
        assert made.robot_door() is RobotDoor.MOVING
        await made.car("L1", Door.CLOSED)
        await made.car("L1", Door.OPEN, enter=True)
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, PLAIN)


def test_nobody_has_checked_a_lift_in_which_not_everything_is_let_go_yet() -> None:
    async def check(made: Bench) -> None:
        made.driver.values = replace(made.driver.values, flags={"robot_mode_on": True})
        made.accept("L1")
        await elapse(0.5)
        made.driver.values = replace(made.driver.values, floor=None, motion=Motion.UP)
        await elapse(0.5)
        await made.mode(Mode.FIRE)
        await made.mode(Mode.NORMAL)
        refused = refusal(made.site.acknowledge, "lift", "M. Weber")
        assert refused.code is Refusal.FIRE_ACTIVE
        before = len(made.driver.log)
        await elapse(5)
        made.site.acknowledge("lift", "M. Weber")
        await elapse(5)
        assert "hold robot_mode" not in made.driver.log[before:]
        assert made.driver.on == set()

    on_bench(check, WITH_MODE, fire_release_delay_s=5.0)


def test_whoever_must_check_a_lift_after_a_fire_is_told_of_the_robot_that_may_be_in_its_car() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await made.mode(Mode.FIRE)
        await made.mode(Mode.NORMAL)
        assert (
            "a person must check it, and look for a robot of api:fleet/robot1 in its car" in made.refuse("L1").message
        )

    on_bench(check, PLAIN)
