"""A ride by the requests of a session, on lifts of every kind, and whose word counts in it."""

import asyncio
from dataclasses import replace

import pytest

from drivers.model import Proof
from lift_manager.lift.commands import COMMANDS, SESSIONS, SESSIONS_FOR_S, CommandState, CommandType, SessionInfo
from lift_manager.lift.events import CommandEnded, CommandFollowed, HandedOver
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.refusals import Blocking, Refusal
from lift_manager.lift.session import Holder
from lift_manager.runtime.errors import NotFound, RequestRefused
from register_maps.words import Door, Mode, Side
from simulator.controller import Inputs
from simulator.state import Parameters
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.support.refusals import refusal, reply
from tests.support.session_calls import ROBOT, SECOND
from tests.support.spine import OTHER, Spine, on_spine
from tests.support.virtual_time import elapse

WITH_WORDS = "seer-siemens-chengdu"
"""The call holds the door, and the lift hears where the robot is."""


def in_car(made: Spine) -> Holder | None:
    return made.state.restrictions.maybe_aboard


async def stands_open(made: Spine, floor: str) -> None:
    await made.until(lambda state: (state.floor, state.robot_door) == (floor, RobotDoor.OPEN))


async def whole_ride(made: Spine) -> None:
    """Called, boarded, ridden, left, closed: everything is confirmed, and nothing is left on."""
    start, destination = made.actor.config.floors[1], made.actor.config.floors[0]
    session = made.opened()
    await made.done(session, CommandType.GO_TO, start)
    await stands_open(made, start)
    info = made.read(session)
    assert (info.arrived, info.door_held, info.floor) == (True, True, start)
    await made.done(session, CommandType.ROBOT_IN_PLACE)
    assert made.read(session).robot is Occupancy.ABOARD
    await made.done(session, CommandType.GO_TO, destination)
    await stands_open(made, destination)
    await made.done(session, CommandType.ROBOT_LEFT)
    assert made.read(session).over is None
    over = made.closed(session, RobotWord.LEFT)
    assert over.robot is Occupancy.EXITED
    await elapse(15)
    assert made.state.holder is None
    assert in_car(made) is None


@pytest.mark.parametrize(
    "name",
    [
        "generic-registers",
        "generic-coils",
        "seer-generic",
        "two-stop-agv",
        WITH_WORDS,
        "seer-lps3-two-stop",
    ],
)
def test_a_ride_by_the_requests_of_a_session_ends_with_a_free_lift(name: str) -> None:
    on_spine(whole_ride, name)


def test_a_session_presses_nothing_but_robot_mode_before_a_floor_is_asked_for() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        await elapse(30)
        assert made.presses() == []
        info = made.read(session)
        assert (info.floor, info.arrived, info.door_held, info.hold_ends_in_s) == (None, False, False, None)
        assert made.state.destination == made.state.floor
        assert made.state.robot_door is not RobotDoor.OPEN
        assert made.state.permissions["robot_mode_on"]

    on_spine(check)


def test_neither_arrival_nor_letting_go_of_the_door_ends_a_session() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        done = await made.done(session, CommandType.GO_TO, "L2", hold=False)
        assert done.proof is not Proof.NONE
        await made.until(lambda state: state.floor == "L2")
        await elapse(5)
        info = made.read(session)
        assert (info.over, info.arrived, info.door_held) == (None, True, False)
        await made.done(session, CommandType.HOLD_DOOR)
        await stands_open(made, "L2")
        assert made.read(session).hold_ends_in_s is not None
        assert (await made.done(session, CommandType.RELEASE_DOOR)).proof is Proof.READBACK
        assert made.read(session).hold_ends_in_s is None
        assert (await made.done(session, CommandType.RELEASE_DOOR)).proof is Proof.NONE
        await elapse(20)
        assert made.state.holder == ROBOT
        assert made.state.robot_door is not RobotDoor.OPEN

    on_spine(check)


def test_a_door_that_a_call_held_is_held_again_by_another_press_of_it() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        await made.done(session, CommandType.GO_TO, "L2")
        await stands_open(made, "L2")
        assert (await made.done(session, CommandType.RELEASE_DOOR)).proof is Proof.READBACK
        await elapse(15)
        assert made.state.robot_door is not RobotDoor.OPEN
        await made.done(session, CommandType.HOLD_DOOR)
        await stands_open(made, "L2")

    on_spine(check, WITH_WORDS)


def test_a_hold_that_is_asked_for_under_way_waits_for_the_car() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        await made.done(session, CommandType.GO_TO, "L3", hold=False)
        hold = made.taken(session, CommandType.HOLD_DOOR)
        assert (hold.state, "stand at L3" in hold.reason) == (CommandState.PENDING, True)
        assert (await made.ended(session, hold)).proof is Proof.READBACK
        assert made.read(session).door_held

    on_spine(check)


def test_close_is_pressed_only_for_a_clear_threshold_and_once_the_hold_is_off() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        assert made.refused_within(session, CommandType.CLOSE_DOOR).code is Refusal.NOT_NOW
        await made.done(session, CommandType.GO_TO, "L2")
        assert made.refused_within(session, CommandType.CLOSE_DOOR).code is Refusal.NOT_NOW
        await stands_open(made, "L2")
        refused = made.refused_within(session, CommandType.CLOSE_DOOR)
        assert (refused.code, "robot_in_place or robot_left" in refused.message) == (Refusal.NOT_NOW, True)
        await made.done(session, CommandType.ROBOT_LEFT)
        began = asyncio.get_running_loop().time()
        done = await made.done(session, CommandType.CLOSE_DOOR)
        assert done.proof is Proof.EFFECT
        closes = [at for at, value in made.presses(19) if value]
        assert len(closes) == 1
        holds = [(at, request.values[0]) for at, request in made.device.writes if request.address == 17]
        assert [value for at, value in holds if began <= at <= closes[0]][-1] == 0
        await elapse(20)
        assert not made.read(session).hold_door
        assert [value for at, value in holds if at > closes[0]] == []

    on_spine(check)


def test_close_is_refused_where_the_map_has_no_button_for_it() -> None:
    async def check(made: Spine) -> None:
        assert made.refused_within(made.opened(), CommandType.CLOSE_DOOR).code is Refusal.NOT_POSSIBLE

    on_spine(check, WITH_WORDS)


def test_a_close_that_waits_is_given_up_for_a_hold() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        await made.done(session, CommandType.GO_TO, "L2")
        await stands_open(made, "L2")
        await made.done(session, CommandType.ROBOT_LEFT)
        close = made.taken(session, CommandType.CLOSE_DOOR)
        hold = made.taken(session, CommandType.HOLD_DOOR)
        assert (await made.ended(session, close)).reason == "another request took its place"
        assert (await made.ended(session, hold)).state is CommandState.CONFIRMED
        assert made.presses(19) == []

    on_spine(check)


# -- who


def test_nobody_but_the_holder_who_opened_it_commands_a_session_and_strangers_learn_nothing() -> None:
    async def check(made: Spine) -> None:
        session, site = made.opened(), made.site
        wrong = (replace(session, holder=SECOND), replace(session, id="guessed"))
        words = set()
        for mine in wrong:
            with pytest.raises(NotFound) as waits:
                await site.until_ended("lift", mine.id, mine.holder, "1", 1)
            refusals = (
                made.refused_within(mine, CommandType.GO_TO, "L2"),
                refusal(site.session, "lift", mine.id, mine.holder),
                refusal(site.renew_session, "lift", mine.id, mine.holder, None),
                refusal(site.close_session, "lift", mine.id, mine.holder, RobotWord.LEFT),
                refusal(site.hand_session_over, "lift", mine.id, mine.holder, SECOND),
                refusal(site.command_status, "lift", mine.id, mine.holder, "1"),
                waits.value,
            )
            for refused in refusals:
                assert refused.code is Refusal.NO_SUCH_SESSION
                words.add(refused.message)
        assert len(words) == 1
        assert made.read(session).over is None
        assert site.session("lift", session.id, None) == made.read(session)

    on_spine(check)


def test_a_lift_that_another_holds_is_refused_with_who_and_since_when() -> None:
    async def check(made: Spine) -> None:
        made.opened()
        await elapse(3)
        for holder in (SECOND, OTHER, ROBOT):
            refused = made.open_refused(holder)
            assert (refused.code, refused.blocking and refused.blocking.holder) == (Refusal.HELD, ROBOT)
            assert refused.blocking is not None
            assert refused.blocking.since_s == pytest.approx(3.0)
        assert made.refuse("L2").code is Refusal.HELD

    on_spine(check)


def test_the_same_key_gives_the_same_session_and_the_same_request_as_long_as_they_are_remembered() -> None:
    async def check(made: Bench) -> None:
        session = made.opened(key="one")
        assert made.opened(key="one").id == session.id
        assert made.open_refused(SECOND, key="one").code is Refusal.HELD
        went = made.taken(session, CommandType.GO_TO, "L2", key="go")
        again = made.taken(session, CommandType.GO_TO, "L2", key="go")
        assert (again.id, again.floor) == (went.id, "L2")
        assert made.read(session).floor == "L2"
        made.closed(session)
        once_more = made.opened(key="one")
        assert (once_more.id, once_more.over is None) == (session.id, False)
        late = made.taken(session, CommandType.GO_TO, "L2", key="go")
        assert late.id == went.id
        await elapse(SESSIONS_FOR_S + 1)
        assert made.opened(key="one").id != session.id

    on_bench(check, replace(PLAIN, max_age_s=60.0), poll_s=20.0)  # an hour goes by


def test_a_key_that_was_used_for_another_wish_is_refused_and_nothing_is_done() -> None:
    async def check(made: Spine) -> None:
        session = made.opened(key="one", ttl_s=20.0)
        made.taken(session, CommandType.GO_TO, "L2", key="go")
        for other in (
            made.refused_within(session, CommandType.GO_TO, "L3", key="go"),
            made.refused_within(session, CommandType.GO_TO, "L2", hold=False, key="go"),
            made.refused_within(session, CommandType.ROBOT_LEFT, key="go"),
        ):
            text = "this idempotency key was used for go_to L2; another request needs another key"
            assert (other.code, other.message) == (Refusal.KEY_REUSED, text)
        assert made.read(session).floor == "L2"
        made.site.renew_session("lift", session.id, ROBOT, 30.0)
        assert made.opened(key="one", ttl_s=20.0).id == session.id
        for ttl_s in (None, 30.0):
            told = made.open_refused(key="one", ttl_s=ttl_s)
            assert (told.code, "with `ttl_s` 20;" in told.message) == (Refusal.KEY_REUSED, True)
        made.closed(session)
        assert made.open_refused(key="one").code is Refusal.KEY_REUSED
        assert made.opened(key="one", ttl_s=20.0).id == session.id

    on_spine(check)


def test_the_newest_requests_and_sessions_are_remembered() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        numbers = [made.taken(session, CommandType.RELEASE_DOOR).id for _ in range(COMMANDS + 1)]
        gone = refusal(made.site.command_status, "lift", session.id, ROBOT, numbers[0])
        assert gone.code is Refusal.NO_SUCH_COMMAND
        assert made.site.command_status("lift", session.id, ROBOT, numbers[1]).id == numbers[1]
        made.closed(session)
        ended = [session]
        for _ in range(SESSIONS):
            await elapse(4)
            ended.append(made.opened())
            made.closed(ended[-1])
        read = [reply(made.site.session, "lift", one.id, ROBOT) for one in ended]
        assert [isinstance(one, SessionInfo) for one in read] == [False] + [True] * SESSIONS

    on_spine(check)


def test_a_session_that_is_handed_over_goes_on_under_an_id_that_only_its_new_holder_has() -> None:
    async def check(made: Spine) -> None:
        session = made.opened(key="one")
        await made.done(session, CommandType.GO_TO, "L2")
        await stands_open(made, "L2")
        waits = made.taken(session, CommandType.GO_TO, "L3")
        with made.bus.listen() as listener:
            handed = made.site.hand_session_over("lift", session.id, ROBOT, SECOND)
            events = await heard(listener)
        assert (handed.holder, handed.opened_at, handed.id != session.id) == (SECOND, session.opened_at, True)
        assert only(events, HandedOver) == [HandedOver("lift", ROBOT, SECOND)]
        assert all(one not in str(events) for one in (session.id, handed.id))
        assert made.now(session, waits).state is not CommandState.PENDING
        over = made.read(session).over
        assert over is not None
        assert "handed over to api:amr-8" in over.text
        refused = made.refused_within(session, CommandType.GO_TO, "L1")
        assert refused.code is Refusal.SESSION_OVER
        await stands_open(made, "L3")
        await made.done(handed, CommandType.GO_TO, "L1")

    on_spine(check)


def test_the_id_of_a_session_is_in_no_event_and_no_state() -> None:
    async def check(made: Spine) -> None:
        with made.bus.listen(10_000) as listener:
            session = made.opened(key="secret-key")
            await made.done(session, CommandType.GO_TO, "L2")
            made.closed(session, RobotWord.LEFT)
            await elapse(5)
            events = await heard(listener)
        assert len(only(events, CommandFollowed)) == 2
        assert only(events, CommandEnded)
        told = f"{events}{made.state}{made.site.durable('lift')}"
        assert session.id not in told
        assert "secret-key" not in told

    on_spine(check)


# -- what stands in the way


def blocking(refused: RequestRefused) -> Blocking:
    assert refused.blocking is not None, refused
    return refused.blocking


def test_a_lift_that_is_not_read_is_refused_with_its_age() -> None:
    async def check(made: Spine) -> None:
        made.device.silent = True
        await elapse(5)
        refused = made.open_refused()
        assert refused.code is Refusal.OFFLINE
        age_s = blocking(refused).age_s
        assert age_s is not None
        assert age_s > 4

    on_spine(check)


def test_a_mode_without_robots_and_a_fire_are_named_with_since_when() -> None:
    async def check(made: Spine) -> None:
        made.people(Inputs(fire=True))
        await elapse(10)
        fire = made.open_refused()
        assert (fire.code, blocking(fire).mode) == (Refusal.FIRE_LATCHED, Mode.FIRE)
        assert blocking(fire).since_s is not None
        early = refusal(made.site.acknowledge, "lift", "M. Weber")
        assert (early.code, blocking(early).mode) == (Refusal.FIRE_ACTIVE, Mode.FIRE)
        assert blocking(early).since_s == pytest.approx(10, abs=1)

    on_spine(check)


def test_a_car_that_may_hold_the_robot_of_another_is_refused_with_whose() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        await made.done(session, CommandType.GO_TO, "L2")
        await stands_open(made, "L2")
        assert made.closed(session).robot is Occupancy.MAY_BOARD
        refused = made.open_refused(SECOND)
        assert (refused.code, blocking(refused).holder) == (Refusal.OCCUPANCY_UNKNOWN, ROBOT)
        assert made.read(session).robot is Occupancy.MAY_BOARD
        stranger = refusal(made.site.close_session, "lift", session.id, SECOND, RobotWord.LEFT)
        assert stranger.code is Refusal.NO_SUCH_SESSION
        assert in_car(made) == ROBOT
        made.closed(session, RobotWord.LEFT)
        assert in_car(made) is None
        made.opened(SECOND)

    on_spine(check)


def test_its_own_robot_that_may_be_in_the_car_keeps_nobody_from_opening_a_session_and_stays_remembered() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        await made.done(session, CommandType.GO_TO, "L2")
        await stands_open(made, "L2")
        made.closed(session)
        again = made.opened()
        assert made.read(again).robot is Occupancy.MAY_BOARD
        made.closed(again)
        assert in_car(made) == ROBOT
        third = made.opened()
        await made.done(third, CommandType.ROBOT_LEFT)
        made.closed(third)
        assert in_car(made) is None

    on_spine(check)


def test_a_lift_is_described_by_its_map_and_its_site() -> None:
    async def check(made: Spine) -> None:
        config = made.site.config("lift")
        assert (config.name, config.floors, config.control, config.robot_hours) == (
            "lift",
            ("L1", "L2", "L3"),
            True,
            None,
        )
        assert "close_door.front" in config.capabilities.commands
        signals = made.site.signals("lift")
        assert (signals.lift, signals.max_age_s) == ("lift", config.capabilities.max_age_s)
        assert {one.name for one in signals.signals} >= {"car_floor", "door.front"}

    on_spine(check)


def test_the_hold_of_a_door_that_is_shut_holds_nothing_although_its_point_reads_on() -> None:
    """So it is where the controller's own watchdog, or its stuck-button timer, let go of the door."""

    async def check(made: Spine) -> None:
        session = made.opened()
        await made.done(session, CommandType.GO_TO, "L2")
        await stands_open(made, "L2")
        assert made.read(session).door_held
        shut = 0
        for _ in range(200):
            await elapse(0.1)
            if made.state.doors[Side.FRONT] in (Door.CLOSING, Door.CLOSED):
                shut += 1
                assert not made.read(session).door_held
        assert shut > 20, "the lift has let go of its door"

    on_spine(check, like=Parameters(drops_stuck_button_s=5.0), poll_s=0.2)
