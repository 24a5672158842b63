"""A small part of `python -m tests.campaigns.rmf`, and the proof that its judge finds what it is there to find."""

from dataclasses import replace
from datetime import UTC, datetime
from random import Random

import pytest

from lift_manager.lab.world.truth import Truth
from lift_manager.lift.events import Restriction, RestrictionBegun, RestrictionEnded, RestrictionKind
from lift_manager.lift.session import Holder
from lift_manager.rmf.messages import (
    AGV_MODE,
    DOOR_CLOSED,
    DOOR_OPEN,
    END_SESSION,
    MODE_AGV,
    MODE_HUMAN,
    MOTION_STOPPED,
    LiftRequest,
    LiftState,
    Time,
)
from register_maps.words import Mode
from tests.campaigns.rmf import play_one, quiet, run
from tests.support.rmf.careless import CARELESS
from tests.support.rmf.events import (
    Ends,
    Event,
    Fire,
    OtherFace,
    OtherRmf,
    Outage,
    Panel,
    Ride,
    SupervisorRestarts,
    UnheardEnd,
    Unplugged,
    WayCut,
    WebEnd,
)
from tests.support.rmf.judge import RULES, Judge
from tests.support.rmf.network import Channel
from tests.support.rmf.playing import play
from tests.support.rmf.schedules import Schedule, draw, shrink
from tests.support.rmf.timeline import Timeline
from tests.support.rmf.world import Setting
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual

A, B = "fleet_1/robot_1", "fleet_2/robot_2"
RIDE = Ride(0.0, A, pickup=1, destination=3, drives_s=2.0)
NEXT = Ride(0.5, B, pickup=3, destination=1, drives_s=1.0)
OFTEN = tuple(SupervisorRestarts(at, 0.05) for at in (10.3, 16.6, 22.9, 28.1, 33.3, 36.0))

FOUND_BY: dict[str, tuple[str, tuple[Event, ...]]] = {
    "executes stale floors": ("stale floor", (replace(RIDE, trips=3), *OFTEN)),
    "clears the session on arrival": ("stolen", (RIDE,)),
    "publishes per request": ("storm", (RIDE,)),
    "says open while another face holds the lift": ("open for another", (OtherFace(0.0, 0, 10.0),)),
    "says open to the next one while the last one has it": ("open for another", (RIDE, NEXT)),
    "says open while the door moves": ("open", (RIDE,)),
    "says open in a fire": ("open in fire", (replace(RIDE, pickup=0, drives_s=6.0), Fire(4.0, 10.0))),
    "repeats the last state of an offline lift": ("ended", (RIDE, WayCut(8.0, 20.0))),
    "forgets the session of an offline lift": ("stolen", (RIDE, Unplugged(3.0, 5.0))),
    "drops an END before another request": ("ended", (RIDE, NEXT)),
    "ignores an END without a floor": ("ended", (replace(RIDE, trips=3), NEXT)),
    "moves the car on END": ("stale floor", (RIDE, Ends(6.0, A, "level 1", 1, 0.1))),
    "shows an ended session once more": ("ended", (RIDE,)),
    "takes an END for the session of another": ("stolen", (RIDE, Ends(3.0, "nobody", "", 1, 0.1))),
    "does not hear who comes next": ("lost", (RIDE, NEXT)),
    "has no grace": ("door fell", (replace(RIDE, drives_s=6.0), WebEnd(3.0, A, 0))),
    "lets go of the door after a while": ("open too long", (replace(RIDE, drives_s=20.0),)),
    "publishes changes only": ("silent", (RIDE,)),
    "gives the lift to whoever asks": ("stolen", (RIDE, Panel(3.0, 0, 3.0))),
    "does not read what fleets say": ("not ended", (RIDE, NEXT, Outage(9.0, 8.0))),
    "does what fleets want of their supervisor": ("past the supervisor", (RIDE, SupervisorRestarts(0.0, 3.0))),
    "ends a session that its fleet goes on with": ("stolen", (RIDE, UnheardEnd(5.0, A, 6.0))),
    "clears a session before the manager knows of its END": ("never done", (RIDE, Outage(9.0, 8.0))),
    "takes the session of another RMF": ("open for another", (OtherRmf(0.0, A, 0, 10.0),)),
}
"""What finds each fault, in which story."""
WHERE = {"clears a session before the manager knows of its END": "humble"}
"""In which distribution; kilted where it is not said."""
BY_HAND = {"open and not held", "robot mode", "locked out", "never done"}
"""Rules that no adapter above breaks first; their judge is tried with what it would see."""
MODES = (MODE_HUMAN, MODE_AGV)


@pytest.mark.parametrize("first", [1])
def test_no_interleaving_breaks_a_rule(first: int) -> None:
    tally = run(range(first, first + 4))
    assert tally.failed == []
    assert tally.schedules == 4


@each_row("fault", CARELESS)
def test_an_adapter_with_a_fault_is_found(fault: str) -> None:
    rule, events = FOUND_BY[fault]
    with quiet():
        setting = Setting(WHERE.get(fault, "kilted"), seed=5, speed=6.0)
        played = play(setting, events, make=CARELESS[fault], to_first=True)
    assert rule in {found.rule for found in played.findings}


def test_every_rule_is_tried() -> None:
    assert {rule for rule, _ in FOUND_BY.values()} | BY_HAND == set(RULES)


def judge() -> Judge:
    floors = {"L1": "level 1", "L2": "level 2"}
    return Judge("lift", floors, grace_s=3.0, max_age_s=1.0, holds=frozenset({"hold_door.front"}))


def truth(*, open_at: str | None = "L1", robot_mode: bool = True, given: tuple[tuple[str, int], ...] = ()) -> Truth:
    mode = Mode.ROBOT if robot_mode else Mode.NORMAL
    standing = open_at is not None
    return Truth(open_at, open_at, standing, not standing, mode, robot_mode, frozenset(), given)


def said(at: float) -> LiftState:
    floors = ("level 1", "level 2")
    return LiftState(Time.of(at), "lift", floors, "level 1", "level 1", DOOR_OPEN, MOTION_STOPPED, MODES, MODE_AGV, A)


@pytest.mark.parametrize(("given", "rules"), [((), ["open and not held"]), ((("hold_door.front", 1),), [])])
def test_an_open_door_that_nothing_of_ours_holds_is_found(given: tuple[tuple[str, int], ...], rules: list[str]) -> None:
    one = judge()
    one.arrived(0.5, LiftRequest("lift", Time(), A, AGV_MODE, "level 1", DOOR_OPEN))
    one.holder.add(0.5, Holder("rmf", A))
    one.on_truth(0.9, "lift", truth(given=given))
    one.state_sent(1.0, said(1.0))
    assert [found.rule for found in one.findings] == rules


@pytest.mark.parametrize(
    ("since_s", "otherwise", "rules"),
    [
        (29.9, "", ["open too long"]),
        (30.1, "", []),
        (5.0, "ended", []),
        (5.0, "another floor", []),
        (5.0, "fire", []),
        (5.0, "locked out", []),
    ],
)
def test_a_door_that_falls_within_30_s_of_open_is_found_unless_something_else_is_the_reason(
    since_s: float, otherwise: str, rules: list[str]
) -> None:
    one, at = judge(), 1.0 + since_s
    one.arrived(0.5, LiftRequest("lift", Time(), A, AGV_MODE, "level 1", DOOR_OPEN))
    one.holder.add(0.5, Holder("rmf", A))
    one.on_truth(0.9, "lift", truth(given=(("hold_door.front", 1),)))
    one.state_sent(1.0, said(1.0))
    match otherwise:
        case "ended":
            one.arrived(at - 1, LiftRequest("lift", Time(), A, END_SESSION, "level 1", DOOR_OPEN))
        case "another floor":
            one.arrived(at - 1, LiftRequest("lift", Time(), A, AGV_MODE, "level 2", DOOR_OPEN))
        case "fire":
            one.excuse(at - 1, "fire", on=True)
        case "locked out":
            one.excuse(at - 1, "kept off", on=True)
        case _:
            pass
    one.on_truth(at, "lift", truth(open_at=None))
    assert [found.rule for found in one.findings] == rules


@pytest.mark.parametrize(("mode", "rules"), [(False, ["robot mode"]), (True, [])])
def test_robot_mode_that_falls_under_way_is_found(mode: bool, rules: list[str]) -> None:
    one = judge()
    one.on_truth(0.9, "lift", truth(open_at=None))
    one.on_truth(1.0, "lift", truth(open_at=None, robot_mode=mode))
    assert [found.rule for found in one.findings] == rules


@pytest.mark.parametrize(("pressed_at", "rules"), [(1.9, []), (2.1, ["locked out"])])
def test_a_press_in_a_lockout_is_found(pressed_at: float, rules: list[str]) -> None:
    one = judge()
    one.on_event(
        1.0,
        RestrictionBegun(
            "lift", Restriction(RestrictionKind.LOCKOUT, "the guard", "moving", datetime(2026, 11, 22, tzinfo=UTC))
        ),
    )
    one.on_press(pressed_at, "lift", frozenset({"robot_mode"}))
    assert [found.rule for found in one.findings] == rules


@pytest.mark.parametrize(("locked_at", "rules"), [(0.8, []), (None, ["stolen"])])
def test_a_session_may_go_a_while_after_a_lockout_that_is_over_by_then(
    locked_at: float | None, rules: list[str]
) -> None:
    one = judge()
    one.arrived(0.5, LiftRequest("lift", Time(), A, AGV_MODE, "level 1", DOOR_OPEN))
    one.state_sent(0.6, replace(said(0.6), door_state=DOOR_CLOSED))
    restriction = Restriction(RestrictionKind.LOCKOUT, "the guard", "moving", datetime(2026, 11, 22, tzinfo=UTC))
    if locked_at is not None:
        one.on_event(locked_at, RestrictionBegun("lift", restriction))
        one.on_event(locked_at + 1.0, RestrictionEnded("lift", "the guard", restriction.since, restriction))
    one.state_sent(30.0, replace(said(30.0), door_state=DOOR_CLOSED, session_id=""))
    assert [found.rule for found in one.findings if found.rule == "stolen"] == rules


def test_a_robot_that_is_left_behind_and_a_lift_that_is_not_free_are_found() -> None:
    one = judge()
    one.finish(100.0, waiting=f"{A}: outside", held=True)
    assert [found.rule for found in one.findings] == ["never done", "never done"]


def test_a_seed_is_the_same_schedule_every_time_and_a_failing_one_is_made_smaller() -> None:
    assert draw(17) == draw(17)
    schedule = next(one for one in map(draw, range(1, 50)) if len(one.events) > 3)
    ride = schedule.events[0]
    assert isinstance(ride, Ride)

    def fails(one: Schedule) -> bool:
        return any(isinstance(event, Ride) and event.session == ride.session for event in one.events)

    assert len(shrink(schedule, fails).events) == 1


def test_a_schedule_comes_to_the_same_every_time() -> None:
    with quiet():
        first, second = (play_one(draw(3)) for _ in range(2))
    assert (first.states, first.requests, first.lasted_s) == (second.states, second.requests, second.lasted_s)


def test_messages_of_one_writer_arrive_in_order_and_within_their_time() -> None:
    came: list[int] = []

    async def main() -> None:
        channel: Channel[int] = Channel(Random(1), 0.02, came.append)
        for number in range(100):
            channel.send(number)
        await elapse(0.021)
        channel.send(100)
        channel.cut()
        await elapse(1.0)

    run_virtual(main)
    assert came == list(range(100))


def test_a_value_lasts_until_the_next() -> None:
    line: Timeline[str | None] = Timeline(None)
    line.add(1.0, "a")
    line.add(2.0, "a")
    line.add(3.0, "b")
    assert [line.at(at) for at in (0.0, 1.0, 2.9, 3.0)] == [None, "a", "a", "b"]
    assert list(line.during(0.5, 3.0)) == ["b", "a", None]
