"""What a lift publishes while its door signal is not proven, or its signals contradict each other."""

from dataclasses import replace
from datetime import UTC, datetime

from drivers.model import Command, CommandKind
from lift_manager.lift.events import Cause
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Motion
from tests.lift_manager.runtime.scripted import AT_L2, FRONT, PLAIN, Bench, on_bench
from tests.support.refusals import refusal
from tests.support.session_calls import saved
from tests.support.virtual_time import elapse

AT = datetime(2026, 3, 2, 21, 30, tzinfo=UTC)
CONTACTS = replace(PLAIN, signals=frozenset({"car_floor", "door.front"}), evidence_for_s=0.2)
"""A contact at each floor, and neither motion nor permissions."""
HOLD = Command(CommandKind.HOLD_DOOR, side=FRONT)
CLEAR_S = 10.0
"""Of a bench."""
PARKED_OPEN = replace(AT_L2, doors={FRONT: Door.OPEN})


async def inverted_trip(made: Bench, start: str, end: str) -> None:
    """Let an inverted contact tell of a trip: closed where the door is open, and open everywhere else."""
    for floor, door in (
        (start, Door.CLOSED),
        (start, Door.OPEN),
        (None, Door.OPEN),
        (end, Door.OPEN),
        (end, Door.CLOSED),
    ):
        await made.car(floor, door)


async def trip(made: Bench, start: str, end: str) -> None:
    for floor, door in (
        (start, Door.OPEN),
        (start, Door.CLOSED),
        (None, Door.CLOSED),
        (end, Door.CLOSED),
        (end, Door.OPEN),
    ):
        await made.car(floor, door)


def test_a_lift_that_is_parked_open_says_that_it_has_to_make_a_trip_and_is_open_after_it() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        await elapse(20)
        assert made.robot_door() is RobotDoor.MOVING
        assert "has to be sent to another floor once" in made.state.restrictions.waiting_for
        assert made.state.doors == {FRONT: Door.OPEN}
        made.accept("L1")
        await trip(made, "L2", "L1")
        await elapse(1)
        assert (made.robot_door(), made.state.restrictions.waiting_for) == (RobotDoor.OPEN, "")

    on_bench(check, CONTACTS, found=PARKED_OPEN, door_proven=False)


def test_a_door_that_people_opened_is_held_only_once_it_has_closed_and_opens_for_us() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        await elapse(20)
        assert HOLD.name not in made.driver.on, "it would keep the car from people, and nobody would be invited"
        await made.car("L2", Door.CLOSED)
        assert HOLD.name in made.driver.on
        await made.car("L2", Door.OPEN)
        assert made.robot_door() is RobotDoor.MOVING
        await elapse(4)
        assert (made.robot_door(), made.state.restrictions.waiting_for) == (RobotDoor.OPEN, "")

    on_bench(check, CONTACTS, found=PARKED_OPEN, door_proven=False)


def test_a_proven_door_is_believed_after_a_restart_and_not_with_another_map() -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        await trip(made, "L2", "L1")
        assert made.robot_door() is RobotDoor.OPEN

    async def after(made: Bench) -> None:
        await elapse(1)
        assert made.robot_door() is RobotDoor.OPEN

    async def with_another_map(made: Bench) -> None:
        await elapse(1)
        assert made.robot_door() is RobotDoor.MOVING

    on_bench(before, CONTACTS, recorder=memory, door_proven=False)
    on_bench(after, CONTACTS, recorder=memory, found=PARKED_OPEN, door_proven=False)
    on_bench(with_another_map, replace(CONTACTS, map_hash="2e"), recorder=memory, found=PARKED_OPEN, door_proven=False)


def test_a_door_that_opened_for_us_is_believed_after_a_crash_and_not_with_another_map() -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        made.accept("L2")
        await made.car("L2", Door.OPEN)
        await elapse(4)
        assert made.robot_door() is RobotDoor.OPEN

    async def after(made: Bench) -> None:
        assert made.robot_door() is RobotDoor.MOVING
        await elapse(4)
        assert made.robot_door() is RobotDoor.OPEN
        assert made.driver.log == []

    async def with_another_map(made: Bench) -> None:
        await elapse(CLEAR_S + 1)
        assert made.robot_door() is RobotDoor.MOVING
        assert made.driver.log == ["let go hold_door.front"]

    left_on = frozenset({"hold_door.front"})
    on_bench(before, CONTACTS, recorder=memory, door_proven=False)
    on_bench(after, CONTACTS, recorder=memory, door_proven=False, found=PARKED_OPEN, left_on=left_on)
    other = replace(CONTACTS, map_hash="2e")
    on_bench(with_another_map, other, recorder=memory, door_proven=False, found=PARKED_OPEN, left_on=left_on)


def test_our_hold_does_not_keep_a_door_open_that_has_to_close_before_it_is_believed() -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        made.accept("L2")
        await made.car("L2", Door.OPENING)
        assert made.driver.on == {"hold_door.front"}

    async def after(made: Bench) -> None:
        await elapse(CLEAR_S - 1)
        assert made.driver.on == {"hold_door.front"}, (
            "a robot may have been invited by a word that did not reach the disk"
        )
        await elapse(2)
        assert made.driver.on == set()
        made.accept("L2")
        await elapse(1)
        assert made.driver.on == set()
        await made.car("L2", Door.CLOSED)
        assert made.driver.on == {"hold_door.front"}
        await made.car("L2", Door.OPEN)
        await elapse(4)
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(before, CONTACTS, recorder=memory, door_proven=False)
    on_bench(
        after,
        CONTACTS,
        recorder=memory,
        found=PARKED_OPEN,
        left_on=frozenset({"hold_door.front"}),
        door_proven=False,
    )


def test_another_caller_that_is_first_after_a_crash_waits_while_a_robot_may_be_in_the_held_door() -> None:
    memory = MemoryRecorder()
    other = Holder("rmf", "fleet/robot2")

    async def before(made: Bench) -> None:
        made.accept("L2")
        await made.car("L2", Door.OPENING)

    async def after(made: Bench) -> None:
        for _ in range(9):
            refused = made.refuse("L1", holder=other)
            assert refused.code is Refusal.HELD
            assert "its robot may be in the door" in refused.message
            await elapse(1)
        assert made.driver.on == {"hold_door.front"}
        await elapse(1.5)
        made.accept("L1", holder=other)
        assert made.state.holder == other

    left_on = frozenset({"hold_door.front"})
    on_bench(before, CONTACTS, recorder=memory, door_proven=False)
    on_bench(after, CONTACTS, recorder=memory, found=PARKED_OPEN, left_on=left_on, door_proven=False)


def test_a_contradiction_outlives_the_manager_and_ends_with_a_persons_word() -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        await inverted_trip(made, "L2", "L1")
        assert [text for text in await made.alarms() if text.startswith("contradiction: ")]
        assert "door contact inverted?" in made.state.restrictions.distrusted

    async def after(made: Bench) -> None:
        assert "door contact inverted?" in made.state.restrictions.distrusted
        made.accept("L1")
        await trip(made, "L2", "L1")
        await elapse(1)
        assert made.robot_door() is RobotDoor.MOVING
        assert "its signals to be trusted again" in made.state.restrictions.waiting_for
        said = made.site.acknowledge("lift", "M. Weber")
        assert said.causes == (Cause.CONTRADICTION,)
        await elapse(1)
        assert made.robot_door() is RobotDoor.OPEN
        assert made.state.restrictions.distrusted == ""
        made.accept("L1", hold=False)
        await elapse(1)
        assert made.state.holder is None
        assert made.robot_door() is RobotDoor.MOVING  # it was released, and is about to close
        refused = refusal(made.site.acknowledge, "lift", "M. Weber")
        assert refused.code is Refusal.NOTHING_TO_ACKNOWLEDGE

    on_bench(before, CONTACTS, recorder=memory, door_proven=False, clock=lambda: AT)
    assert saved(memory).keeps_robots_out
    on_bench(after, CONTACTS, recorder=memory, door_proven=False, clock=lambda: AT)


def test_a_word_of_a_person_is_heeded_though_nothing_else_changes() -> None:
    async def check(made: Bench) -> None:
        await trip(made, "L2", "L1")
        await inverted_trip(made, "L1", "L2")
        await trip(made, "L2", "L1")
        assert made.robot_door() is RobotDoor.MOVING
        made.site.acknowledge("lift", "M. Weber")
        await elapse(1)
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, CONTACTS, door_proven=False, poll_s=0.2)


def test_a_car_behind_closed_doors_is_not_said_to_stand_where_nothing_tells_its_motion() -> None:
    async def check(made: Bench) -> None:
        assert (made.state.standing, made.state.motion) == (True, Motion.UNKNOWN)
        said = []
        for door in (Door.OPEN, Door.CLOSED):
            await made.car("L2", door)
            said.append(made.state.motion)
        assert said == [Motion.STOPPED, Motion.UNKNOWN]

    on_bench(check, CONTACTS)
