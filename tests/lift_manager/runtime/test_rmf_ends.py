"""RMF's END_SESSION: always taken, never a move, and for a grace everything stays as it is, should the session go on after all."""

from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from drivers.model import Command, CommandKind, OutputState
from lift_manager.lift.events import CommandEnded, ForceReleased, Restriction, SessionEnded, SessionOpened
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import EndReason
from lift_manager.runtime.site import Site
from register_maps.words import Door, Mode
from simulator.state import Parameters
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.rmf_words import (
    HOLD,
    NEXT,
    RMF,
    WITH_MODE,
    arrived,
    coming,
    ends,
    idle,
    is_refused,
    just_asked,
    open_for_it,
    riding,
    stands_open,
    wants,
)
from tests.lift_manager.runtime.scripted import OTHER, PERMITTING, PLAIN, Bench, on_bench
from tests.lift_manager.runtime.test_session_restart import held_by
from tests.support.refusals import refusal
from tests.support.rows import each_row
from tests.support.spine import Spine, asked_of, spine
from tests.support.virtual_time import elapse, run_virtual

Phase = Callable[[Bench], Awaitable[None]]
HOLDING = [coming, open_for_it, riding, arrived]


async def the_end_of(made: Bench) -> EndReason:
    """Why the session ended; exactly one did."""
    (ended,) = only(await heard(made.heard), SessionEnded)
    assert ended.holder == RMF
    return ended.reason


async def silent(made: Bench) -> None:
    made.driver.silent = True
    await elapse(2)


async def moving(made: Bench) -> None:
    await made.car(None, Door.CLOSED)


@each_row("grace_s", [0.0, 3.0])
@each_row("then", [idle, silent, moving])
@each_row("phase", [just_asked, *HOLDING])
def test_end_is_taken_wherever_the_car_is_and_presses_nothing(phase: Phase, then: Phase, grace_s: float) -> None:
    async def check(made: Bench) -> None:
        await phase(made)
        await then(made)
        pressed = len(made.presses)
        ends(made, grace_s)
        await elapse(4)
        assert held_by(made) is None
        assert len(made.presses) == pressed
        assert made.driver.on == set()
        assert await the_end_of(made) is EndReason.RELEASED

    on_bench(check, PLAIN)


@each_row("mode", [Mode.FIRE, Mode.INSPECTION, Mode.INDEPENDENT, Mode.OUT_OF_SERVICE])
def test_end_is_taken_in_every_mode(mode: Mode) -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await made.mode(mode)
        ends(made)
        ends(made, 0)
        assert held_by(made) is None
        assert made.driver.on == set()

    on_bench(check, PLAIN)


def test_end_in_the_delay_of_a_fire_does_not_wait_for_it() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await made.mode(Mode.FIRE)
        assert held_by(made) == RMF
        ends(made, 1)
        await elapse(1.1)
        assert held_by(made) is None
        assert made.driver.on == set()
        await elapse(10)
        assert await the_end_of(made) is EndReason.RELEASED
        assert is_refused(made, "L1").code is Refusal.FIRE_LATCHED

    on_bench(check, PLAIN, fire_release_delay_s=5)


def test_end_of_nobodys_session_is_yes_and_of_another_holders_is_no() -> None:
    async def check(made: Bench) -> None:
        ends(made)
        wants(made, "L1")
        said = refusal(ends, made, 0, holder=NEXT)
        assert said.code is Refusal.HELD
        assert held_by(made) == RMF
        ends(made, 0)
        made.accept("L1", holder=OTHER)
        said = refusal(ends, made)
        assert said.blocking is not None
        assert said.blocking.holder == OTHER
        await elapse(5)
        assert held_by(made) == OTHER

    on_bench(check, PLAIN)


def test_end_said_again_neither_prolongs_the_grace_nor_ends_anything_twice() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        for _ in range(5):
            ends(made)
            await elapse(0.5)
        assert held_by(made) == RMF
        await elapse(0.6)
        assert held_by(made) is None
        ends(made)
        await elapse(5)
        assert made.driver.log == ["press go_to L1", f"hold {HOLD}", f"let go {HOLD}"]
        assert await the_end_of(made) is EndReason.RELEASED

    on_bench(check, PLAIN)


def test_end_without_a_grace_ends_one_with_a_grace_at_once() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        ends(made)
        await elapse(1)
        ends(made, 0)
        assert held_by(made) is None

    on_bench(check, PLAIN)


def test_within_the_grace_door_hold_robot_mode_and_holder_stay_and_then_all_is_let_go() -> None:
    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        await arrived(made)
        before = list(made.driver.log)
        ends(made)
        await elapse(2.9)
        assert held_by(made) == RMF
        assert made.driver.log == before
        assert made.driver.on == {HOLD, "robot_mode"}
        assert made.robot_door() is RobotDoor.MOVING
        await elapse(0.2)
        assert held_by(made) is None
        assert made.driver.on == set()
        assert await the_end_of(made) is EndReason.RELEASED

    on_bench(check, WITH_MODE, poll_s=0.2)


def test_the_grace_ends_in_time_though_the_lift_answers_slowly() -> None:
    async def check(made: Bench) -> None:
        await arrived(made)
        made.driver.takes_s = 20
        await elapse(1)
        ends(made)
        await elapse(3.01)
        assert held_by(made) is None
        assert made.driver.on == set()

    on_bench(check, PLAIN)


@pytest.mark.parametrize("phase", HOLDING)
def test_the_same_session_goes_on_within_the_grace_as_if_nothing_had_been(phase: Phase) -> None:
    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        await phase(made)
        before, floor, since_s = list(made.driver.log), made.state.destination, made.state.held_since_s
        ends(made)
        await elapse(2)
        wants(made, str(floor))
        await elapse(20)
        assert held_by(made) == RMF
        assert made.driver.log == before
        assert (made.state.held_since_s or 0) > 21.9 + (since_s or 0)
        events = await heard(made.heard)
        assert len(only(events, SessionOpened)) == 1
        assert only(events, SessionEnded) == []

    on_bench(check, WITH_MODE)


def test_the_same_session_may_want_another_floor_within_the_grace() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        ends(made)
        await elapse(1)
        wants(made, "L3")
        await elapse(20)
        assert made.presses == ["go_to L1", "go_to L3"]
        assert held_by(made) == RMF

    on_bench(check, PLAIN)


def test_a_session_may_go_on_within_its_grace_while_the_lift_cannot_be_read() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        ends(made)
        await silent(made)
        wants(made, "L1")
        await elapse(10)
        assert held_by(made) == RMF
        assert made.presses == ["go_to L1"]
        assert is_refused(made, "L3").code is Refusal.OFFLINE

    on_bench(check, PLAIN)


def test_a_request_that_is_refused_within_the_grace_leaves_the_end_as_it_was_said() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        ends(made)
        await elapse(2)
        assert is_refused(made, "L9").code is Refusal.UNKNOWN_FLOOR
        await elapse(1.1)
        assert held_by(made) is None
        assert made.driver.on == set()

    on_bench(check, PLAIN)


def test_another_session_has_to_wait_until_the_grace_is_over() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        ends(made)
        await elapse(2.5)
        assert is_refused(made, "L3", holder=NEXT).code is Refusal.HELD
        await elapse(0.6)
        wants(made, "L3", holder=NEXT)
        await elapse(0.5)
        assert made.presses == ["go_to L1", "go_to L3"]

    on_bench(check, PLAIN)


def test_a_call_that_has_not_left_yet_is_dropped_by_end_and_not_by_one_that_was_taken_back() -> None:
    async def check(made: Bench) -> None:
        wants(made, "L3")
        ends(made)
        await elapse(2)
        assert made.presses == []
        (dropped,) = only(await heard(made.heard), CommandEnded)
        assert "rmf:fleet/amr-7 has ended its session" in dropped.outcome.reason
        wants(made, "L3")
        await elapse(3)
        assert made.presses == ["go_to L3"]
        wants(made, "L1")
        ends(made)
        wants(made, "L1")
        await elapse(3)
        assert made.presses == ["go_to L3", "go_to L1"]

    on_bench(check, PLAIN)


def test_a_call_that_waits_for_robot_mode_is_not_pressed_within_the_grace() -> None:
    able = replace(WITH_MODE, requires={"go_to": frozenset({"robot_mode_on"})})

    async def check(made: Bench) -> None:
        wants(made, "L3")
        await elapse(1)
        ends(made, 10)
        made.grants_robot_mode()
        await elapse(9)
        assert made.presses == []
        assert held_by(made) == RMF
        wants(made, "L3")
        await elapse(1)
        assert made.presses == ["go_to L3"]

    on_bench(check, able)


def test_robot_mode_is_not_begun_within_the_grace() -> None:
    async def check(made: Bench) -> None:
        await arrived(made)
        ends(made, 0)
        await elapse(0.5)
        log = list(made.driver.log)
        wants(made, "L1", holder=NEXT)
        ends(made, 10, holder=NEXT)
        await elapse(9)
        assert made.driver.log == log, "the turn of people was over after 5 s"
        assert made.site.durable("lift").robot_mode_until is None
        wants(made, "L1", holder=NEXT)
        await elapse(0.5)
        assert made.driver.log == [*log, "hold robot_mode", "press go_to L1"]

    on_bench(check, WITH_MODE, between_sessions_s=5)


def test_a_car_that_arrives_within_the_grace_is_not_held_open() -> None:
    async def check(made: Bench) -> None:
        await coming(made)
        ends(made, 10)
        await stands_open(made, "L1")
        await elapse(5)
        assert made.driver.log == ["press go_to L1"]
        assert made.robot_door() is not RobotDoor.OPEN
        wants(made, "L1")
        await elapse(0.2)
        assert made.driver.log == ["press go_to L1", f"hold {HOLD}"]

    on_bench(check, PLAIN, poll_s=0.2)


def test_robot_mode_outlasts_the_grace_until_the_car_stands() -> None:
    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        await riding(made)
        ends(made)
        await elapse(20)
        assert held_by(made) is None
        assert made.driver.on == {"robot_mode"}
        await stands_open(made, "L3")
        assert made.driver.on == set()

    on_bench(check, WITH_MODE)


def test_a_fire_within_the_grace_lets_everything_go_at_once() -> None:
    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        await riding(made)
        ends(made, 20)
        await made.mode(Mode.FIRE)
        assert made.driver.on == set()
        assert await the_end_of(made) is EndReason.FIRE
        await elapse(30)
        assert made.presses == ["go_to L1", "go_to L3"]

    on_bench(check, WITH_MODE)


def lock(site: Site) -> object:
    return site.lock_out("lift", "M. Weber", "new ropes")


def force(site: Site) -> object:
    return site.force_release("lift", "M. Weber", "stuck")


@pytest.mark.parametrize(
    ("word", "kind", "reason"), [(lock, Restriction, EndReason.LOCKOUT), (force, ForceReleased, EndReason.FORCED)]
)
def test_a_persons_word_counts_within_the_grace(word: Callable[[Site], object], kind: type, reason: EndReason) -> None:
    async def check(made: Bench) -> None:
        await arrived(made)
        ends(made, 20)
        await elapse(1)
        assert isinstance(word(made.site), kind)
        assert made.driver.on == set()
        assert await the_end_of(made) is reason

    on_bench(check, PLAIN)


def test_the_longest_session_ends_within_the_grace() -> None:
    async def check(made: Bench) -> None:
        await coming(made)
        await elapse(7)
        ends(made, 20)
        await elapse(2.5)
        assert await the_end_of(made) is EndReason.MAX_SESSION

    on_bench(check, PLAIN, max_session_s=10)


def test_a_silent_session_is_taken_over_within_the_grace() -> None:
    async def check(made: Bench) -> None:
        await coming(made)
        ends(made, 20)
        await elapse(6)
        made.accept("L2", holder=OTHER)
        assert await the_end_of(made) is EndReason.TAKEN_OVER

    on_bench(check, PLAIN, takeover_after_s=5)


def test_a_session_that_is_handed_over_within_the_grace_goes_on() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        ends(made)
        made.site.hand_over("lift", RMF, OTHER)
        await elapse(10)
        assert held_by(made) == OTHER
        assert made.driver.on == {HOLD}

    on_bench(check, PLAIN)


def test_a_manager_that_stops_within_the_grace_lets_go_and_takes_no_more_ends() -> None:
    async def check(made: Bench) -> None:
        await arrived(made)
        ends(made, 20)
        await made.life.stop()
        assert made.driver.on == set()
        assert await the_end_of(made) is EndReason.RELEASED
        said = refusal(ends, made, 0)
        assert said.code is Refusal.STOPPING

    on_bench(check, PLAIN)


def test_the_word_that_an_earlier_robot_left_is_given_within_the_grace_of_the_next_session() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await elapse(6)
        wants(made, "L3")
        await elapse(1)
        await made.ridden_to("L3")
        made.driver.delay_s = 1
        ends(made, 0)
        wants(made, "L1", holder=NEXT)
        ends(made, 20, holder=NEXT)
        await elapse(5)
        assert made.presses == ["call L1", "robot_in_place", "go L3", "robot_left"]

    on_bench(check, PERMITTING, infer=True)


def test_people_get_their_turn_from_the_end_of_the_grace() -> None:
    async def check(made: Bench) -> None:
        await arrived(made)
        ends(made)
        await elapse(3.1)
        wants(made, "L1", holder=NEXT)
        pressed = len(made.presses)
        await elapse(4)
        assert len(made.presses) == pressed
        await elapse(2)
        assert len(made.presses) == pressed + 1

    on_bench(check, PLAIN, between_sessions_s=5)


def test_a_word_that_sends_the_occupied_car_on_is_not_given_within_the_grace() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await elapse(6)
        wants(made, "L3")
        ends(made, 20)
        await elapse(15)
        assert made.presses == ["call L1"]
        wants(made, "L3")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]

    on_bench(check, PERMITTING, infer=True)


def asking(made: Spine) -> list[float]:
    """When something was written that asks for something."""
    return [at for at, request in made.device.writes if any(asked_of(request))]


@pytest.mark.parametrize("name", ["seer-generic", "seer-lps3-two-stop", "seer-siemens-chengdu", "two-stop-agv"])
def test_a_call_that_stays_on_until_the_car_is_there_stays_on_in_the_grace(name: str) -> None:
    async def main() -> None:
        async with spine(name, infer_occupancy=True, like=Parameters(speed=0.5)) as made:
            floor = made.state.floors[1]
            made.site.request("lift", RMF, floor, hold_door=True, stays=True)
            await elapse(0.5)
            calls = [Command(kind, floor) for kind in (CommandKind.GO_TO, CommandKind.CALL)]
            (call,) = [call for call in calls if made.driver.capabilities.commands >= {call.name}]
            made.site.end_session("lift", RMF, 30)
            written = len(asking(made))
            await elapse(4.5)
            assert made.state.floor != floor
            assert (await made.driver.read()).outputs[call.name] in (OutputState.ON, OutputState.HELD)
            assert len(asking(made)) >= written + 2, "refreshed every 2 s"
            await made.until(lambda state: state.floor == floor)
            await elapse(30)
            assert (await made.driver.read()).outputs[call.name] is OutputState.AT_REST
            assert made.state.holder is None

    run_virtual(main)
