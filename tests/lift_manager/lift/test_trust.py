"""What a row of readings proves of a door signal, what it contradicts, and what never is an alarm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import pytest

from drivers.model import Capabilities, LiftReading, LiftValues, Outcome, Result
from lift_manager.lift import call as calls
from lift_manager.lift.call import Call
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import Observation, RobotDoor, door_by_signals, observe
from lift_manager.lift.trust import (
    ENDED_AFTER_S,
    OPEN_FOR_S,
    TRIPS,
    Contradiction,
    OwnCommands,
    Track,
    Trust,
    judge,
)
from register_maps.words import Door, Mode, Motion, Side
from tests.lift_manager.lift.test_call import ABLE, CONFIRMED
from tests.support.rows import each_row

AT = datetime(2026, 3, 2, 21, 30, tzinfo=UTC)
POLL_S = 0.2
FLOORS = ("L1", "L2", "L3", "L4")
FRONT: Mapping[str, tuple[Side, ...]] = dict.fromkeys(FLOORS, (Side.FRONT,))
PRINTED = {
    "door.front": ("holding:3",),
    "car_floor": ("holding:1",),
    "motion": ("holding:2",),
    "go_to": ("holding:16",),
}

MOTION = replace(ABLE, printed=PRINTED)
"""A floor that is the last one passed, and a motion signal."""
LEVEL = replace(MOTION, evidence="level", signals=ABLE.signals | {"level"})
CONTACTS = replace(ABLE, evidence="position_stable", evidence_for_s=1.0, printed=PRINTED)
"""A contact at each floor, none between them, and no motion signal."""
PASSED = replace(ABLE, evidence="door_open", printed=PRINTED, open_contacts=frozenset({Side.FRONT}))
"""A floor that is the last one passed, an open contact, and no motion signal."""
LIMITS = replace(ABLE, evidence="door_limit", printed=PRINTED, open_contacts=frozenset({Side.FRONT}))
"""One open limit at each floor, and nothing else."""

C, O, M, F = Door.CLOSED, Door.OPEN, Door.MOVING, Door.FAULT  # noqa: E741 - a table of doors
OPENING, CLOSING = Door.OPENING, Door.CLOSING
S, UP, DOWN = Motion.STOPPED, Motion.UP, Motion.DOWN


def at(
    floor: str | None,
    door: Door,
    motion: Motion | None = None,
    *,
    rear: Door | None = None,
    mode: Mode = Mode.NORMAL,
    **flags: bool,
) -> LiftValues:
    doors = {Side.FRONT: door} | ({} if rear is None else {Side.REAR: rear})
    return LiftValues(floor=floor, motion=motion, mode=mode, doors=doors, flags=flags)


@dataclass
class Lift:
    """A lift that is read by hand, and what was made of it."""

    able: Capabilities
    trust: Trust = field(default_factory=Trust)
    doors_at: Mapping[str, tuple[Side, ...]] = field(default_factory=lambda: FRONT)
    now: float = 0.0
    epoch: int = 1
    observation: Observation | None = None
    track: Track = field(default_factory=Track)
    news: list[str] = field(default_factory=list)

    def read(self, *rows: LiftValues, given: OwnCommands = OwnCommands(), times: int = 1) -> "Lift":  # noqa: B008 - a value
        for values in (row for row in rows for _ in range(times)):
            self.now += POLL_S
            seen = observe(
                self.observation, LiftReading(self.now, self.epoch, values), self.able, gap_s=POLL_S, apart_s=POLL_S / 2
            )
            config = LiftConfig(
                name="lift",
                source="by hand",
                floors=FLOORS,
                doors_at=self.doors_at,
                control=True,
                capabilities=self.able,
            )
            judged = judge(config, self.track, self.trust, seen, given, self.now, AT)
            self.track, self.trust = judged.track, judged.trust
            self.news += judged.alarms
            self.observation = replace(seen, doubt=judged.doubt)
        return self

    @property
    def proven(self) -> bool:
        return self.trust.door_proven


def door(lift: Lift) -> RobotDoor:
    assert lift.observation is not None
    here = lift.doors_at.get(lift.observation.floor or "", ())
    return door_by_signals(lift.observation, here, frozenset())


def proven(able: Capabilities) -> Trust:
    return Trust(able.map_hash, door_proven=True)


GOOD: dict[str, tuple[Capabilities, Sequence[LiftValues]]] = {
    "motion": (MOTION, (at("L1", C, S), at("L1", C, UP), at("L2", C, UP), at("L2", C, S), at("L2", O, S))),
    "contacts": (CONTACTS, (at("L1", O), at("L1", C), at(None, C), at(None, C), at("L2", C), at("L2", M), at("L2", O))),
    "last floor passed": (PASSED, (at("L1", O), at("L1", C), at("L1", C), at("L2", C), at("L2", C), at("L2", O))),
    "door limits": (LIMITS, (at("L1", O), at(None, C), at(None, C), at("L2", O))),
    "a late floor, and a door that opens as it changes": (
        MOTION,
        (at("L1", C, S), at("L1", C, UP), at("L1", C, UP), at("L2", OPENING, S), at("L2", O, S)),
    ),
}


@each_row("name", GOOD)
def test_a_trip_with_the_door_closed_proves_the_signal_and_the_door_opens_at_its_end(name: str) -> None:
    able, rows = GOOD[name]
    lift = Lift(able).read(*rows)
    assert lift.proven
    lift.read(rows[-1], times=10)
    assert (door(lift), lift.news) == (RobotDoor.OPEN, [])


BAD: dict[str, tuple[Capabilities, Sequence[LiftValues]]] = {
    "motion": (
        MOTION,
        (at("L1", C, S), at("L1", O, S), at("L1", O, UP), at("L2", O, UP), at("L2", O, S), at("L2", C, S)),
    ),
    "level": (
        LEVEL,
        (
            at("L1", C, S, level=True),
            at("L1", O, S, level=True),
            at("L1", O, UP, level=False),
            at("L2", O, UP, level=False),
            at("L2", O, S, level=True),
            at("L2", C, S, level=True),
        ),
    ),
    "contacts": (CONTACTS, (at("L1", C), at("L1", O), at(None, O), at(None, O), at("L2", O), at("L2", O), at("L2", C))),
    "last floor passed": (
        PASSED,
        (at("L1", C), at("L1", O), at("L2", O), at("L2", O), at("L3", O), at("L3", O), at("L3", C)),
    ),
}
"""What an inverted contact reads on a trip: open whenever the door is not."""


@each_row("trust", [False, True])
@each_row("name", BAD)
def test_a_door_that_reads_open_from_rest_to_rest_over_a_change_of_floor_is_an_alarm_and_never_open(
    name: str, trust: bool
) -> None:
    able, rows = BAD[name]
    lift = Lift(able, proven(able) if trust else Trust())
    for row in rows:
        lift.read(row, times=3)
        moved = lift.track.runs and any(run.elsewhere for run in lift.track.runs.values())
        assert not (moved and door(lift) is RobotDoor.OPEN), row
        assert trust or door(lift) is not RobotDoor.OPEN, row
    assert len(lift.news) == 1
    assert "door.front (holding:3)" in lift.news[0]
    assert "car_floor (holding:1)" in lift.news[0]
    assert lift.news[0].endswith("door contact inverted?")
    assert not lift.proven
    assert [one.kind for one in lift.trust.distrust] == [Contradiction.DOOR]


@each_row("name", BAD)
def test_an_inverted_signal_opens_no_door_on_its_later_trips_either(name: str) -> None:
    able, rows = BAD[name]
    lift = Lift(able)
    for row in (*rows, *rows):
        lift.read(row, times=3)
        assert door(lift) is not RobotDoor.OPEN, row
    assert len(lift.news) == 1, "one contradiction is told once"


REAR = {"L1": (Side.FRONT,), "L2": (Side.REAR,), "L3": (Side.FRONT,), "L4": (Side.FRONT,)}
NEVER: dict[str, tuple[Capabilities, Sequence[LiftValues]]] = {
    "a level flag in passing": (
        LEVEL,
        (
            at("L1", C, S, level=True),
            at("L1", C, UP, level=False),
            at("L2", C, UP, level=True),
            at("L3", C, UP, level=False),
        ),
    ),
    "a door-zone flag in passing": (
        MOTION,
        (at("L1", C, S, door_zone=True), at("L2", C, UP, door_zone=True), at("L3", C, UP, door_zone=False)),
    ),
    "re-levelling": (
        LEVEL,
        (
            at("L2", O, S, level=True),
            at("L2", O, UP, level=False),
            at("L2", O, UP, level=False),
            at("L2", O, S, level=True),
        ),
    ),
    "re-levelling that loses its floor contact": (CONTACTS, (at("L2", O), at(None, O), at(None, O), at("L2", O))),
    "sinking": (
        MOTION,
        (at("L2", O, S), at("L2", O, DOWN), at("L2", O, DOWN), at("L2", O, S), at("L2", O, DOWN), at("L2", O, S)),
    ),
    "advance opening in the door zone": (
        MOTION,
        (
            at("L1", C, S),
            at("L1", C, UP),
            at("L2", C, UP),
            at("L2", OPENING, UP),
            at("L2", O, UP),
            at("L2", O, UP),
            at("L2", O, S),
        ),
    ),
    "advance opening with a late floor": (
        MOTION,
        (at("L1", C, S), at("L1", C, UP), at("L1", O, UP), at("L1", O, UP), at("L2", O, UP), at("L2", O, S)),
    ),
    "a direction arrow that is lit while the car stands": (
        MOTION,
        (
            at("L1", O, S),
            at("L1", O, UP),
            at("L1", O, UP),
            at("L1", CLOSING, UP),
            at("L1", C, UP),
            at("L2", C, UP),
            at("L2", O, S),
        ),
    ),
    "a late brake or drive bit": (
        MOTION,
        (
            at("L1", C, S),
            at("L1", C, UP),
            at("L2", C, UP),
            at("L2", OPENING, UP),
            at("L2", O, UP),
            at("L2", O, UP),
            at("L2", O, S),
        ),
    ),
    "an early drive bit": (MOTION, (at("L1", O, S), at("L1", O, UP), at("L1", C, UP), at("L2", C, UP), at("L2", C, S))),
    "an early position switch": (
        MOTION,
        (at("L1", O, S), at("L2", O, S), at("L2", CLOSING, S), at("L2", C, UP), at("L2", C, S), at("L2", O, S)),
    ),
    "an early position switch under a lit arrow": (
        MOTION,
        (
            at("L1", O, S),
            at("L1", O, UP),
            at("L2", O, UP),
            at("L2", O, UP),
            at("L2", CLOSING, UP),
            at("L2", C, UP),
            at("L2", C, S),
        ),
    ),
    "an early position switch, and no motion signal": (
        PASSED,
        (at("L1", C), at("L1", O), at("L2", O), at("L2", C), at("L2", C), at("L2", O)),
    ),
    "reads of different age: an old door with a new floor": (
        replace(MOTION, one_block=False),
        (at("L1", O, S), at("L1", O, UP), at("L1", C, UP), at("L2", C, UP), at("L2", C, S)),
    ),
    "reads of different age: a whole trip within one poll": (MOTION, (at("L1", O, S), at("L2", O, S), at("L2", O, S))),
    "the other door": (
        MOTION,
        (
            at("L1", O, S, rear=C),
            at("L1", C, UP, rear=C),
            at("L2", C, UP, rear=C),
            at("L2", C, UP, rear=O),
            at("L2", C, S, rear=O),
            at("L2", C, S, rear=C),
            at("L1", C, DOWN, rear=C),
            at("L1", O, S, rear=C),
        ),
    ),
    "inspection": (
        MOTION,
        (
            at("L1", O, S),
            *(
                at(floor, O, motion, mode=Mode.INSPECTION)
                for floor, motion in (("L1", S), ("L1", UP), ("L2", UP), ("L2", UP), ("L2", S))
            ),
            at("L2", O, S),
        ),
    ),
    "rescue": (
        MOTION,
        (
            at("L2", C, S),
            *(at(floor, C, DOWN, mode=Mode.EMERGENCY) for floor in ("L2", "L1")),
            at("L1", O, S, mode=Mode.EMERGENCY),
            at("L1", O, S),
        ),
    ),
    "homing": (MOTION, (at(None, C, S), at(None, C, DOWN), at(None, C, DOWN), at("L1", C, S), at("L1", O, S))),
    "homing past the contacts": (
        CONTACTS,
        (at("L3", C), at(None, C), at("L2", C), at(None, C), at("L1", C), at("L1", O)),
    ),
    "hydraulic return": (
        MOTION,
        (at("L4", O, S), at("L4", C, S), *(at(floor, C, DOWN) for floor in ("L4", "L3", "L2", "L1")), at("L1", C, S)),
    ),
}


@each_row("trust", [False, True])
@each_row("name", NEVER)
def test_what_never_is_an_alarm(name: str, trust: bool) -> None:
    able, rows = NEVER[name]
    lift = Lift(
        able,
        proven(able) if trust else Trust(),
        doors_at=REAR if name == "the other door" else FRONT,
    )
    for _ in range(3):
        for row in rows:
            lift.read(row, times=1 if "poll" in name or "old door" in name else 2)
        lift.epoch += 1  # the next round begins elsewhere
    assert lift.news == []
    assert lift.trust.distrust == ()
    assert lift.proven or not trust


def given(call: Call | None, *, pressed: bool = True) -> OwnCommands:
    return OwnCommands(call, pressed=pressed)


HERE = calls.press_call(calls.request_call(None, "L1", 0.0), 1, 0.0)


def test_a_car_that_was_under_way_behind_its_closed_door_may_have_opened_it_by_the_next_reading() -> None:
    lift = Lift(MOTION).read(at("L1", C, S), at("L1", C, UP), at("L2", O, S))
    assert lift.trust.door_proven
    standing = Lift(MOTION).read(at("L1", C, S), at("L2", O, S))
    assert not standing.trust.door_proven


def test_a_door_that_stands_open_from_the_first_reading_is_not_believed_before_a_trip() -> None:
    lift = Lift(MOTION).read(at("L1", O, S), times=50)
    assert door(lift) is RobotDoor.MOVING
    lift.read(at("L1", O, S), given=given(HERE), times=50)
    assert door(lift) is RobotDoor.MOVING
    assert lift.observation is not None
    assert "door.front (holding:3)" in lift.observation.doubt
    assert "has to be sent to another floor once" in lift.observation.doubt


def test_a_door_that_opens_after_our_own_press_is_believed_once_it_has_stayed_open() -> None:
    lift = (
        Lift(MOTION).read(at("L1", C, S)).read(at("L1", C, S), at("L1", OPENING, S), at("L1", O, S), given=given(HERE))
    )
    assert door(lift) is RobotDoor.MOVING
    lift.read(at("L1", O, S), given=given(HERE), times=round(OPEN_FOR_S / POLL_S) + 1)
    assert door(lift) is RobotDoor.OPEN
    lift.read(at("L1", O, S), times=5)
    assert door(lift) is RobotDoor.OPEN, "while the car stays there"
    assert not lift.proven


@each_row(
    ("rows", "pressed_for"),
    [
        pytest.param((at("L1", C, S), at("L1", O, S)), "L2", id="a press for another floor"),
        pytest.param((at("L1", C, S), at("L1", O, S)), None, id="people opened it"),
        pytest.param((at("L1", O, S), at("L1", OPENING, S), at("L1", O, S)), "L1", id="it was never closed"),
        pytest.param((at("L1", F, S), at("L1", O, S)), "L1", id="its limits contradicted each other"),
    ],
)
def test_no_other_open_door_is_believed(rows: Sequence[LiftValues], pressed_for: str | None) -> None:
    call = None if pressed_for is None else calls.press_call(calls.request_call(None, pressed_for, 0.0), 1, 0.0)
    lift = Lift(MOTION)
    for row in rows:
        lift.read(row, given=given(call, pressed=call is not None), times=20)
    assert door(lift) is RobotDoor.MOVING


def test_what_was_learned_holds_for_its_map_alone_and_a_distrust_for_every_map() -> None:
    able, rows = GOOD["motion"]
    lift = Lift(able).read(*rows)
    other = replace(able, map_hash="another")
    assert not Lift(other, lift.trust).read(at("L2", O, S)).proven
    able, rows = BAD["motion"]
    lift = Lift(able).read(*rows)
    assert (
        Lift(replace(able, map_hash="another"), lift.trust).read(at("L2", C, S)).trust.distrust == lift.trust.distrust
    )


def test_a_gap_and_a_new_connection_prove_nothing_and_contradict_nothing() -> None:
    lift = Lift(MOTION).read(at("L1", C, S))
    lift.epoch = 2
    assert not lift.read(at("L2", C, S), at("L2", O, S)).proven
    lift = Lift(MOTION).read(at("L1", O, S), at("L1", O, UP), times=3)
    lift.epoch = 2
    assert lift.read(at("L2", O, UP), at("L2", O, S), times=3).news == []


def test_three_trips_in_a_row_end_the_distrust_of_a_door_and_one_against_it_begins_anew() -> None:
    able, bad = BAD["motion"]
    _, good = GOOD["motion"]
    back = (at("L2", C, S), at("L2", C, DOWN), at("L1", C, DOWN), at("L1", C, S))
    lift = Lift(able).read(*bad)
    lift.read(*back, *good)
    assert lift.trust.distrust[0].trips == 2
    assert door(lift) is RobotDoor.MOVING
    lift.read(at("L2", O, S), at("L2", O, DOWN), at("L1", O, DOWN), at("L1", O, S), at("L1", C, S))
    assert lift.trust.distrust[0].trips == 0
    for _ in range(TRIPS):
        lift.read(*good, *back)
    assert lift.trust.distrust == ()
    assert "no longer distrusted" in lift.news[-1]
    assert door(lift.read(*good)) is RobotDoor.OPEN


# -- calls that end elsewhere


def confirmed(floor: str) -> Call:
    return calls.call_answered(calls.press_call(calls.request_call(None, floor, 0.0), 1, 0.0), CONFIRMED, 0.0)


def lost(call: Call) -> Call:
    return calls.call_failed(call, "the call disappeared", 0.0)


def sent(lift: Lift, start: str, called: str, ends: str, *, lit: str | None = None) -> Lift:
    """Call the car, and let it go to a floor and lose the call there, or keep its lamp lit."""
    call = confirmed(called)
    up = UP if FLOORS.index(ends) > FLOORS.index(start) else DOWN
    lift.read(at(start, C, S), at(start, C, up), at(ends, C, up), at(ends, C, S), given=given(call))
    there = replace(at(ends, O, S), call_accepted=lit)
    lift.read(there, given=given(call))
    return lift.read(there, given=given(lost(call))).read(at(ends, C, S))


def test_a_confirmed_call_that_ends_elsewhere_with_the_same_offset_twice_is_an_alarm() -> None:
    lift = sent(Lift(MOTION), "L1", "L2", "L3")
    assert lift.news == []
    sent(lift, "L3", "L1", "L2")
    assert len(lift.news) == 1
    assert "go_to (holding:16)" in lift.news[0]
    assert "car_floor (holding:1)" in lift.news[0]
    assert "(L3 for L2, then L2 for L1)" in lift.news[0]
    assert lift.news[0].endswith("floor codes shifted by one?")
    assert [one.kind for one in lift.trust.distrust] == [Contradiction.CALL]
    assert door(lift.read(at("L2", O, S), times=30)) is RobotDoor.MOVING


def test_a_call_counts_as_ended_elsewhere_once_the_car_has_stood_there_for_long() -> None:
    lift = Lift(MOTION)
    for start, called, ends in (("L1", "L2", "L3"), ("L3", "L1", "L2")):
        call = given(confirmed(called))
        lift.read(at(start, C, S), at(start, C, UP), at(ends, C, UP), at(ends, C, S), given=call)
        lift.read(at(ends, C, S), given=call, times=round(ENDED_AFTER_S / POLL_S) + 2).read(at(ends, C, S))
    assert len(lift.news) == 1


def test_calls_that_are_no_sign_of_a_shift() -> None:
    stops = Lift(MOTION)
    for _ in range(3):  # people stop it on its way, every time
        call = given(confirmed("L3"))
        stops.read(at("L1", C, S), at("L2", C, UP), given=call).read(at("L2", O, S), given=call, times=25)
        stops.read(at("L2", C, S), at("L3", C, UP), at("L3", O, S), given=call).read(at("L3", C, S), at("L1", C, S))
    shown = sent(sent(Lift(MOTION), "L1", "L2", "L3", lit="L2"), "L3", "L1", "L2", lit="L1")
    other = sent(sent(Lift(MOTION), "L1", "L2", "L3"), "L3", "L2", "L1")
    between = sent(sent(sent(Lift(MOTION), "L1", "L2", "L3"), "L3", "L1", "L1"), "L1", "L2", "L3")
    stays = Lift(MOTION)
    for _ in range(3):  # a lift that does nothing for us
        stays.read(at("L1", C, S), given=given(confirmed("L2")), times=10)
        stays.read(at("L1", C, S), given=given(lost(confirmed("L2"))))
    for lift in (stops, shown, other, between, stays):
        assert lift.news == []


def test_a_call_that_was_not_confirmed_contradicts_nothing() -> None:
    unconfirmed = Outcome(CONFIRMED.command, Result.UNCONFIRMED, "nothing showed")
    lift = Lift(MOTION)
    for start, called, ends in (("L1", "L2", "L3"), ("L3", "L1", "L2")):
        pressed = calls.press_call(calls.request_call(None, called, 0.0), 1, 0.0)
        lift.read(at(start, C, S), at(start, C, UP), at(ends, C, UP), at(ends, O, S), given=given(pressed))
        lift.read(at(ends, O, S), given=given(calls.call_answered(pressed, unconfirmed, 0.0))).read(at(ends, C, S))
    assert lift.news == []


def test_three_calls_that_end_where_they_should_end_the_distrust_of_calls() -> None:
    lift = sent(sent(Lift(MOTION), "L1", "L2", "L3"), "L3", "L1", "L2")
    for start, floor in (("L2", "L3"), ("L3", "L1"), ("L1", "L4")):
        assert lift.trust.distrust
        sent(lift, start, floor, floor)
    assert lift.trust.distrust == ()
