"""A session outlives the manager: it is taken up with its holder, and nothing is pressed because of that."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from drivers.model import Capabilities, LiftValues
from lift_manager.lift.events import Alarm, SessionEnded, SessionOpened, SessionRestored
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Advice, EndReason, Holder
from lift_manager.runtime.recorder import Clock, MemoryRecorder, SavedLift
from register_maps.words import Door, Mode, Motion
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.scripted import (
    AT_L2,
    FRONT,
    OTHER,
    PERMITTING,
    PLAIN,
    ROBOT,
    TWO_STOP,
    Bench,
    CountingRecorder,
    boarded,
    on_bench,
)
from tests.support.refusals import refusal
from tests.support.session_calls import saved
from tests.support.virtual_time import elapse

AT = datetime(2026, 3, 2, 12, tzinfo=UTC)
HOLD, CALL = "hold_door.front", "call"
WITH_MODE = replace(
    PLAIN,
    commands=PLAIN.commands | {"robot_mode"},
    signals=PLAIN.signals | {"robot_mode_on", "motion"},
    held_commands=PLAIN.held_commands | {"robot_mode"},
    evidence="motion_stopped",
)
LEVEL_CALL = replace(PLAIN, until={"go_to": "arrived"}, held_commands=PLAIN.held_commands | {"go_to"})
OPEN_AT_L1 = LiftValues(floor="L1", mode=Mode.NORMAL, doors={FRONT: Door.OPEN}, flags={"may_enter": True})
UNDER_WAY = LiftValues(floor=None, mode=Mode.NORMAL, doors={FRONT: Door.CLOSED})


def fixed(at: datetime) -> Clock:
    return lambda: at


def restarted(
    before: Callable[[Bench], Awaitable[None]],
    after: Callable[[Bench], Awaitable[None]],
    able: Capabilities = PLAIN,
    *,
    found: LiftValues = OPEN_AT_L1,
    left_on: frozenset[str] = frozenset(),
    off_s: float = 2.0,
    **more: object,
) -> MemoryRecorder:
    """Kill the manager after `before`, and start it again `off_s` later by the clock on the wall."""
    memory = MemoryRecorder()
    on_bench(before, able, recorder=memory, clock=fixed(AT), poll_s=0.2)
    on_bench(
        after,
        able,
        recorder=memory,
        clock=fixed(AT + timedelta(seconds=off_s)),
        found=found,
        left_on=left_on,
        **more,  # type: ignore[arg-type]  # keywords of on_bench
        poll_s=0.2,
    )
    return memory


async def open_at_l1(made: Bench) -> None:
    await made.called_to("L1")
    assert made.robot_door() is RobotDoor.OPEN


async def asked(made: Bench) -> None:
    made.accept("L3")
    await elapse(0.5)
    assert made.presses == ["go_to L3"]


def held_by(made: Bench) -> Holder | None:
    return made.state.holder


def test_the_holder_keeps_the_lift_and_its_door_stays_held_without_a_press() -> None:
    async def after(made: Bench) -> None:
        assert held_by(made) == ROBOT
        assert made.driver.adopted == {HOLD}
        await elapse(10)
        assert made.robot_door() is RobotDoor.OPEN
        assert made.driver.log == []
        assert made.driver.renewed[HOLD] > 9
        assert made.driver.begun == set()
        (restored,) = only(await heard(made.heard), SessionRestored)
        assert (restored.holder, restored.floor) == (ROBOT, "L1")
        assert made.refuse("L3", hold=False, holder=OTHER).code is Refusal.HELD
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["go_to L3"]

    restarted(open_at_l1, after, left_on=frozenset({HOLD}))


def test_a_hold_that_is_found_off_waits_for_its_holder() -> None:
    async def after(made: Bench) -> None:
        await elapse(20)
        assert made.driver.log == []
        assert made.robot_door() is RobotDoor.MOVING
        made.accept("L1")
        await elapse(0.5)
        assert made.driver.log == [f"hold {HOLD}"]
        assert made.robot_door() is RobotDoor.OPEN

    restarted(open_at_l1, after)


@pytest.mark.parametrize("left_on", [frozenset(), frozenset({"robot_mode"})])
def test_robot_mode_is_kept_if_it_is_found_on_and_asked_for_again_only_by_the_holder(left_on: frozenset[str]) -> None:
    async def after(made: Bench) -> None:
        await elapse(20)
        assert made.driver.log == []
        assert ("robot_mode" in made.driver.renewed) == bool(left_on)
        assert made.driver.begun == set()
        made.accept("L3")
        await elapse(0.5)
        assert "robot_mode" in made.driver.on & made.driver.begun

    restarted(asked, after, WITH_MODE, left_on=left_on, found=UNDER_WAY)


def test_a_call_that_was_pressed_is_followed_until_it_arrives() -> None:
    async def after(made: Bench) -> None:
        await elapse(3)
        assert made.state.destination == "L3"
        await made.car("L3", Door.OPEN, enter=True)
        made.accept("L3")
        await elapse(2)
        assert made.driver.log == [f"hold {HOLD}"]

    restarted(asked, after, found=UNDER_WAY)


def test_a_call_that_was_lost_is_pressed_by_the_next_request_and_only_by_that() -> None:
    able = replace(PLAIN, signals=PLAIN.signals | {"call_accepted"})

    async def after(made: Bench) -> None:
        await elapse(30)
        assert made.driver.log == []
        assert "to send another request after a restart of the manager" in made.state.restrictions.waiting_for
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["go_to L3"]
        assert made.state.restrictions.waiting_for == ""

    restarted(asked, after, able, found=replace(OPEN_AT_L1, doors={FRONT: Door.CLOSED}))


def test_a_call_that_was_not_pressed_waits_for_the_next_request() -> None:
    needs = replace(PLAIN, requires={"go_to": frozenset({"robot_mode_on"})})

    async def before(made: Bench) -> None:
        made.accept("L3")
        await elapse(1)
        assert made.presses == []

    async def after(made: Bench) -> None:
        await elapse(30)
        assert made.driver.log == []
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["go_to L3"]

    granted = replace(OPEN_AT_L1, flags={"robot_mode_on": True}, doors={FRONT: Door.CLOSED})
    restarted(before, after, needs, found=granted)


def test_a_call_that_is_a_level_stays_on_until_it_has_arrived() -> None:
    async def after(made: Bench) -> None:
        assert made.driver.adopted == {"go_to"}
        await elapse(3)
        assert made.driver.on == {"go_to"}
        await made.car("L3", Door.OPEN, enter=True)
        assert made.driver.log == ["let go go_to"]

    restarted(asked, after, LEVEL_CALL, found=UNDER_WAY, left_on=frozenset({"go_to"}))


def test_a_call_that_keeps_the_door_open_is_kept_on_and_not_begun() -> None:
    async def after(made: Bench) -> None:
        await elapse(5)
        assert made.driver.renewed["call"] > 4
        assert made.driver.begun == set()
        assert made.driver.log == []

    restarted(open_at_l1, after, PERMITTING, left_on=frozenset({"call"}))


def test_a_level_call_that_the_controller_has_dropped_is_pressed_again_only_by_a_request() -> None:
    async def after(made: Bench) -> None:
        await elapse(10)
        assert made.driver.log == []
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["go_to L3"]

    restarted(asked, after, LEVEL_CALL, found=replace(OPEN_AT_L1, doors={FRONT: Door.CLOSED}))


def test_a_lift_that_knows_of_the_robot_aboard_is_not_told_again() -> None:
    async def after(made: Bench) -> None:
        assert made.site.durable("lift").occupied is not None
        made.accept("L3")
        await made.ridden_to("L3")
        made.accept("L3", RobotWord.LEFT, hold=False)
        await elapse(1)
        assert made.presses == ["robot_left"]
        assert made.driver.on == set()
        made.accept("L1", holder=OTHER)

    restarted(boarded, after, PERMITTING, found=UNDER_WAY, left_on=frozenset({"go"}))


def test_the_word_that_a_robot_is_in_place_stays_on_where_it_is_a_level() -> None:
    async def before(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(1)
        assert made.driver.on == {"robot_in_place"}

    async def after(made: Bench) -> None:
        assert "robot_in_place" in made.driver.adopted
        await elapse(5)
        assert made.driver.log == []
        assert made.driver.renewed["robot_in_place"] > 4
        assert made.driver.begun == set()

    restarted(before, after, TWO_STOP, found=UNDER_WAY, left_on=frozenset({"robot_in_place"}))


def test_that_word_is_put_on_again_only_once_the_holder_is_heard() -> None:
    async def before(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(1)

    async def after(made: Bench) -> None:
        await elapse(5)
        assert made.driver.log == []
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(1)
        assert "robot_in_place" in made.driver.on

    restarted(before, after, TWO_STOP, found=UNDER_WAY)


def test_a_robot_that_got_out_unheard_by_the_lift_is_told_of_with_its_next_word() -> None:
    async def before(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.grants = False
        made.accept("L3", RobotWord.LEFT)
        await elapse(0.5)
        assert "robot_left" not in made.presses

    async def after(made: Bench) -> None:
        await elapse(10)
        assert made.presses == []
        made.accept("L3", RobotWord.LEFT)
        await elapse(1)
        assert made.presses[0] == "robot_left"
        assert made.presses.count("robot_left") == 1

    at_l3 = replace(OPEN_AT_L1, floor="L3", flags={"may_leave": True})
    restarted(before, after, PERMITTING, found=at_l3)


def test_another_caller_that_is_heard_first_gets_a_car_in_which_no_robot_can_be() -> None:
    async def after(made: Bench) -> None:
        made.accept("L2", holder=OTHER)
        assert held_by(made) == OTHER
        events = await heard(made.heard)
        (ended,) = only(events, SessionEnded)
        assert (ended.holder, ended.reason) == (ROBOT, EndReason.UNCLAIMED)
        assert ended.advice is Advice.CLEAR_DOORWAY
        assert [type(event) for event in events if isinstance(event, SessionEnded | SessionOpened)][-1] is SessionOpened
        assert made.refuse("L3").code is Refusal.HELD

    restarted(asked, after, found=UNDER_WAY)


def test_another_caller_that_is_heard_first_takes_nothing_from_a_car_that_may_hold_a_robot() -> None:
    async def after(made: Bench) -> None:
        for _ in range(32):
            refused = made.refuse("L3", holder=OTHER)
            assert refused.code is Refusal.HELD
            assert "its robot may be in the car" in refused.message
            assert "`lift-manager release lift --by NAME --reason TEXT`" in refused.message
            await elapse(1)
        assert held_by(made) == ROBOT
        assert made.driver.log == []
        assert made.robot_door() is RobotDoor.OPEN
        (alarm,) = await made.alarms()
        assert alarm.startswith("silent_holder: api:fleet/robot1 holds the lift and has sent nothing for 3")
        made.accept("L1")
        assert "since a restart" not in made.refuse("L3", holder=OTHER).message

    restarted(open_at_l1, after, left_on=frozenset({HOLD}), takeover_after_s=10.0)


def test_a_caller_whose_floor_no_command_reaches_ends_no_session() -> None:
    able = replace(PERMITTING, commands=PERMITTING.commands - {"go", "robot_in_place"})

    async def after(made: Bench) -> None:
        made.refuse("L2", RobotWord.IN_PLACE, holder=OTHER)
        assert held_by(made) == ROBOT

    async def calls(made: Bench) -> None:
        made.accept("L3")
        await elapse(0.5)

    restarted(calls, after, able, found=UNDER_WAY)


def test_a_holder_that_was_heard_keeps_the_lift_against_others() -> None:
    async def after(made: Bench) -> None:
        made.accept("L3")
        assert made.refuse("L1", holder=OTHER).code is Refusal.HELD
        assert held_by(made) == ROBOT

    restarted(asked, after, found=UNDER_WAY)


def test_a_holder_that_was_refused_was_heard_all_the_same() -> None:
    async def after(made: Bench) -> None:
        made.driver.silent = True
        await elapse(3)
        assert made.refuse("L3").code is Refusal.OFFLINE
        made.driver.silent = False
        await elapse(1)
        assert made.refuse("L1", holder=OTHER).code is Refusal.HELD
        await elapse(20)
        assert made.driver.log == []

    restarted(asked, after, found=UNDER_WAY)


def test_what_idle_clients_post_and_what_would_be_refused_anyway_ends_no_session() -> None:
    async def after(made: Bench) -> None:
        for floor in ("L1", "L2", "L3"):
            assert made.refuse(floor, hold=False, holder=OTHER).code is Refusal.HELD
            assert made.refuse(floor, RobotWord.LEFT, hold=False, holder=OTHER).code is Refusal.HELD
        assert made.refuse("attic", holder=OTHER).code is Refusal.UNKNOWN_FLOOR
        made.driver.silent = True
        await elapse(3)
        made.refuse("L2", holder=OTHER)
        assert held_by(made) == ROBOT

    restarted(open_at_l1, after, left_on=frozenset({HOLD}))


@pytest.mark.parametrize(
    ("off_s", "more", "reason"),
    [
        (38.0, {"lease_s": 30.0}, EndReason.LEASE),
        (2.0, {"floors": ("L2", "L3")}, EndReason.NOT_RESTORED),
        (2.0, {"control": False}, EndReason.NOT_RESTORED),
    ],
)
def test_a_session_that_cannot_go_on_is_over_with_its_reason(
    off_s: float, more: dict[str, object], reason: EndReason
) -> None:
    async def after(made: Bench) -> None:
        assert held_by(made) is None
        assert made.driver.adopted == set()
        events = await heard(made.heard)
        (ended,) = only(events, SessionEnded)
        assert (ended.holder, ended.reason) == (ROBOT, reason)
        assert ended.advice is Advice.CLEAR_DOORWAY
        assert [alarm for alarm in only(events, Alarm) if alarm.text.startswith("maybe_occupied")]
        assert made.state.restrictions.maybe_aboard == ROBOT

    memory = restarted(open_at_l1, after, off_s=off_s, left_on=frozenset({HOLD}), **more)  # type: ignore[arg-type]  # keywords of on_bench
    assert saved(memory).session is None


@pytest.mark.parametrize("word", ["fire", "lockout"])
def test_a_fire_or_a_lockout_from_before_the_start_ends_it(word: str) -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        await open_at_l1(made)
        session = saved(memory).session
        if word == "lockout":
            made.site.lock_out("lift", "M. Weber", "ropes")
        else:
            await made.mode(Mode.FIRE)
        # as if the manager had been killed before the end of the session was on the disk
        memory.keep("lift", SavedLift(replace(saved(memory), session=session)))

    async def after(made: Bench) -> None:
        (ended,) = only(await heard(made.heard), SessionEnded)
        assert ended.reason == word
        assert held_by(made) is None
        await elapse(5)
        assert made.driver.log == []

    on_bench(before, PLAIN, recorder=memory, clock=fixed(AT), poll_s=0.2)
    on_bench(after, PLAIN, recorder=memory, clock=fixed(AT), left_on=frozenset({HOLD}), poll_s=0.2)


@pytest.mark.parametrize(("off_s", "rest_s"), [(-86400.0, 30), (0.0, 30), (20.0, 10)])
def test_a_clock_that_went_back_counts_as_no_time_and_one_that_went_on_shortens_the_lease(
    off_s: float, rest_s: float
) -> None:
    async def after(made: Bench) -> None:
        await elapse(rest_s - 2)
        assert held_by(made) == ROBOT
        await elapse(3)
        assert held_by(made) is None

    restarted(asked, after, off_s=off_s, lease_s=30.0, found=UNDER_WAY)


@pytest.mark.parametrize("was_used", [True, False])
def test_after_a_session_that_is_found_over_people_have_their_turn_if_the_lift_was_used(*, was_used: bool) -> None:
    async def before(made: Bench) -> None:
        if was_used:
            made.accept("L1")
        else:
            made.opened()
        await elapse(1)

    async def after(made: Bench) -> None:
        await elapse(1)
        made.accept("L3", holder=OTHER)
        await elapse(3.5)
        assert (made.presses == []) == was_used
        await elapse(2)
        assert made.presses == ["go_to L3"]

    restarted(before, after, found=AT_L2, off_s=3600, between_sessions_s=5)


@pytest.mark.parametrize(("off_s", "ends_after_s"), [(2.0, 28.0), (25.0, 10.0), (29.0, 10.0), (36.0, 10.0)])
def test_a_robot_that_was_invited_until_a_restart_has_clear_s_before_its_lease_may_end(
    off_s: float, ends_after_s: float
) -> None:
    async def after(made: Bench) -> None:
        await elapse(ends_after_s - 1.0)
        assert held_by(made) == ROBOT
        await elapse(1.0)
        assert held_by(made) is None

    restarted(open_at_l1, after, off_s=off_s, lease_s=30.0, left_on=frozenset({HOLD}))


def test_the_limits_of_hold_and_session_go_on_where_they_were() -> None:
    async def before(made: Bench) -> None:
        await open_at_l1(made)
        await elapse(20)
        made.accept("L1")

    async def spent(made: Bench) -> None:
        await elapse(5)
        assert [text for text in await made.alarms() if "the door was held for 30 s" in text]
        assert held_by(made) == ROBOT
        assert made.driver.on == set()

    async def over(made: Bench) -> None:
        await elapse(5)
        (ended,) = only(await heard(made.heard), SessionEnded)
        assert ended.reason is EndReason.MAX_SESSION

    restarted(before, spent, off_s=8, left_on=frozenset({HOLD}), max_session_hold_s=30.0)
    restarted(before, over, off_s=8, left_on=frozenset({HOLD}), max_session_s=30.0)


def test_an_orderly_end_lets_go_of_everything_and_the_session_goes_on_after_it() -> None:
    async def before(made: Bench) -> None:
        await open_at_l1(made)
        await made.life.stop()
        assert made.driver.on == set()
        events = await heard(made.heard)
        (ended,) = only(events, SessionEnded)
        assert ended.reason is EndReason.STOPPING
        (alarm,) = only(events, Alarm)
        for text in (ended.text, alarm.text):
            assert "session is kept" in text
            assert "continues at the next start" in text
            assert "ack" not in text
        assert made.refuse("L1").code is Refusal.STOPPING
        assert refusal(made.site.hand_over, "lift", ROBOT, OTHER).code is Refusal.STOPPING

    async def after(made: Bench) -> None:
        assert held_by(made) == ROBOT
        await elapse(5)
        assert made.driver.log == []
        made.accept("L1")
        await elapse(0.5)
        assert made.robot_door() is RobotDoor.OPEN

    restarted(before, after)


@pytest.mark.parametrize(("lease_s", "most"), [(300.0, 6), (8.0, 18)])
def test_a_lease_that_is_merely_renewed_is_written_down_every_few_seconds(lease_s: float, most: int) -> None:
    memory = CountingRecorder()

    async def check(made: Bench) -> None:
        for _ in range(60):
            made.accept("L2")
            await elapse(0.5)
        session = saved(memory).session
        assert session is not None
        assert clock() - session.lease_from <= timedelta(seconds=min(10, lease_s / 4) + 1)
        assert memory.kept <= most

    def clock() -> datetime:
        return AT + timedelta(seconds=asyncio.get_running_loop().time())

    on_bench(check, PLAIN, recorder=memory, clock=clock, lease_s=lease_s)


def test_a_restored_session_survives_a_second_restart() -> None:
    memory = MemoryRecorder()

    async def nothing(made: Bench) -> None:
        await elapse(1)

    async def after(made: Bench) -> None:
        assert held_by(made) == ROBOT
        assert made.driver.adopted == {HOLD}

    on_bench(open_at_l1, PLAIN, recorder=memory, clock=fixed(AT), poll_s=0.2)
    for check in (nothing, nothing, after):
        on_bench(
            check, PLAIN, recorder=memory, clock=fixed(AT), found=OPEN_AT_L1, left_on=frozenset({HOLD}), poll_s=0.2
        )


def test_a_release_before_the_first_reading_drops_robot_mode_only_once_the_car_stands() -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        made.grants_robot_mode()
        await asked(made)

    async def after(made: Bench) -> None:
        assert "let go robot_mode" not in made.driver.log
        await elapse(3)
        assert "let go robot_mode" not in made.driver.log
        made.driver.values = replace(made.driver.values, motion=Motion.STOPPED, floor="L3")
        await elapse(1)
        assert "let go robot_mode" in made.driver.log

    on_bench(before, WITH_MODE, recorder=memory, clock=fixed(AT))
    found = replace(UNDER_WAY, flags={"robot_mode_on": True}, motion=Motion.UP)
    on_bench(
        after,
        WITH_MODE,
        recorder=memory,
        clock=fixed(AT),
        found=found,
        left_on=frozenset({"robot_mode"}),
        at_once=lambda made: made.accept("L3", RobotWord.LEFT, hold=False),
    )


def test_a_person_may_end_it_before_its_holder_is_heard() -> None:
    async def after(made: Bench) -> None:
        made.site.force_release("lift", "M. Weber", "nobody comes", at_once=True)
        assert held_by(made) is None
        assert made.driver.log == [f"let go {HOLD}"]

    memory = restarted(open_at_l1, after, left_on=frozenset({HOLD}))
    assert saved(memory).session is None
