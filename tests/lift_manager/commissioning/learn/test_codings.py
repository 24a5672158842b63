"""`learn` finds position, door and motion however a controller codes them, or says that it is not sure."""

import random
from itertools import cycle
from pathlib import Path

import pytest

from lift_manager.commissioning.learn.analyse import analyse
from lift_manager.commissioning.learn.tracks import Confidence
from register_maps.codec import Codec
from register_maps.words import Table
from tests.lift_manager.commissioning.learn.compared import confident, disagreements
from tests.lift_manager.commissioning.learn.riding import Extra, ridden
from tests.support.rows import each_row
from tests.support.written_maps import written_map

HEAD = """\
schema: 1
name: written
title: A map written down in a test
provenance: {trust: template, sources: [this test]}
addressing: {base: 0}
served: {coil: [[0, 7]], discrete: [[0, 31]], holding: [[0, 39]], input: [[0, 9]]}
at_floor_evidence: {kind: position_stable, for_s: 1.0}
at_same_floor: call
not_visible: {fire: nothing burns in a test}
"""
LAST = 39
"""The last address of these lifts."""
FLOOR = 'car_floor: {at: "holding:3", as: floor}'
DOOR = 'door.front: {at: "holding:4", values: {0: closed, 1: opening, 2: open, 3: closing}}'
MOTION = 'motion: {at: "holding:5", values: {0: stopped, 1: up, 2: down}}'
FOUR = {"L1": 1, "L2": 2, "L3": 3, "L4": 4}
TENS = {"8": 8, "9": 9, "10": 10, "11": 11}


def lift(*signals: str) -> Codec:
    return written_map("signals:\n" + "".join(f"  {signal}\n" for signal in signals), HEAD)


FLOORS: list[tuple[str, dict[str, int], dict[str, object]]] = [
    (FLOOR, FOUR, {}),
    (FLOOR, {"L1": 0, "L2": 1, "L3": 2}, {}),
    (FLOOR, {"G": 100, "M5": 205, "7": 9}, {}),
    ('car_floor: {at: "holding:3", type: int16, as: floor}', {"B2": -2, "B1": -1, "G": 0, "L1": 1}, {"type": "int16"}),
    ('car_floor: {at: "holding:3", as: floor, code: bcd}', TENS, {"code": "bcd"}),
    ('car_floor: {at: "holding:3", as: floor, byte_order: low_first}', FOUR, {"byte_order": "low_first"}),
    ('car_floor: {at: "holding:3", as: floor, code: gray}', FOUR, {}),
    ('car_floor: {one_of: ["holding:7.3", "holding:7.4", "holding:7.8"]}', {"L1": 0, "L2": 1, "L3": 2}, {}),
    ('car_floor: {code_of: ["discrete:4", "discrete:5", "discrete:6"]}', FOUR | {"L5": 5}, {}),
    ('car_floor: {code_of: ["discrete:4", "discrete:5", "discrete:6"], code: gray, active: low}', FOUR | {"L5": 5}, {}),
    ('car_floor: {one_of: ["discrete:9", "discrete:8", "discrete:7"]}', {"L1": 0, "L2": 1, "L3": 2}, {}),
    ('car_floor: {one_of: ["discrete:9", "discrete:11", "discrete:13"], active: low}', {"L1": 0, "L2": 1, "L3": 2}, {"active": "low"}),
    ('car_floor: {one_of: ["holding:20.0", "holding:21.0", "holding:22.0"]}', {"L1": 0, "L2": 1, "L3": 2}, {}),
]  # fmt: skip
"""The signal, the floors of the lift, and what the draft is to say of it besides."""
DOORS: list[tuple[str, dict[str, object]]] = [
    ('door.front: {at: "discrete:3"}', {"at": "discrete:3"}),
    ('door.front: {at: "discrete:3", active: low}', {"at": "discrete:3", "active": "low"}),
    ('door.front: {at: "discrete:3", values: {0: moving, 1: closed}}', {"values": {0: "moving", 1: "closed"}}),
    ('door.front: {at: "discrete:3", values: {1: moving, 0: closed}}', {"values": {1: "moving", 0: "closed"}}),
    ('door.front: {open_limit: "discrete:9", closed_limit: "discrete:3"}', {"open_limit": "discrete:9"}),
    ('door.front: {open_limit: "discrete:9", closed_limit: "discrete:3", active: low}', {"active": "low"}),
    ('door.front: {open_limit: "holding:9.7", closed_limit: "holding:9.12"}', {"at": "holding:9"}),
    (DOOR, {"values": {0: "closed", 1: "opening", 2: "open", 3: "closing"}}),
    ('door.front: {at: "holding:4", values: {7: closed, 9: moving, 255: open}}', {"values": {7: "closed", 9: "moving", 255: "open"}}),
    ('door.front: {at: "holding:4", bits: [9, 11], values: {1: closed, 2: opening, 3: open, 4: closing}}', {"at": "holding:4"}),
    ('door.front: {at: "holding:4", values: {0: closed, 1: open}}', {"values": {0: "closed", 1: "open"}}),
    ('door.front: {at: "holding:4", values: {1: closed, 2: open}}', {"values": {1: "closed", 2: "open"}}),
]  # fmt: skip
MOTIONS: list[tuple[str, dict[str, object]]] = [
    (MOTION, {"at": "holding:5"}),
    ('motion: {at: "holding:5", values: {1: stopped, 4: up, 2: down}}', {"at": "holding:5"}),
    ('motion: {at: "holding:5", bits: [2, 4], values: {1: stopped, 2: up, 5: down}}', {"at": "holding:5"}),
    ('motion: {up: "discrete:6", down: "discrete:2"}', {"up": "discrete:6", "down": "discrete:2"}),
    ('motion: {up: "holding:5.6", down: "holding:5.2"}', {}),
    ('motion: {up: "discrete:6", down: "discrete:2", active: low}', {"active": "low"}),
    ('motion: {at: "discrete:6", values: {0: stopped, 1: moving}}', {"values": {0: "stopped", 1: "moving"}}),
    ('motion: {at: "discrete:6", values: {1: stopped, 0: moving}}', {"values": {1: "stopped", 0: "moving"}}),
]


@each_row(("floor", "door", "motion"), zip(FLOORS, cycle(DOORS), cycle(MOTIONS), strict=False))
def test_floor_door_and_motion_are_found_in_any_coding(
    floor: tuple[str, dict[str, int], dict[str, object]],
    door: tuple[str, dict[str, object]],
    motion: tuple[str, dict[str, object]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    of_floor, floors, keys_of_floor = floor
    (of_door, keys_of_door), (of_motion, keys_of_motion) = door, motion
    truth = lift(of_floor, of_door, of_motion)
    got = ridden(truth, last=LAST, floors=floors)
    found = analyse(got.recording)
    wanted = {"car_floor": keys_of_floor, "door.front": keys_of_door, "motion": keys_of_motion}
    for signal, keys in wanted.items():
        proposal = found.of(signal)
        assert proposal is not None, signal
        assert proposal.confidence is not Confidence.NOT_SURE, proposal.reasons
        assert keys.items() <= proposal.spec.items()
    assert disagreements(got, found, truth, tmp_path_factory.mktemp("draft")) == set()


@each_row(
    ("position", "at"),
    [
        ('{at: "holding:10", positions: {1: 40, 2: 3240, 3: 6440, 4: 9640}, tolerance: 50}', 40),
        ('{at: "holding:10", type: int16, positions: {1: -3200, 2: 0, 3: 3200, 4: 6400}, tolerance: 50}', -3200),
        ('{at: "holding:10", type: uint32, word_order: high_first, positions: {1: 60000, 2: 90000, 3: 140000, 4: 170000}, tolerance: 50}', 60000),
        ('{at: "holding:10", type: int32, word_order: low_first, positions: {1: -90000, 2: 0, 3: 80000, 4: 160000}, tolerance: 50}', -90000),
    ],
)  # fmt: skip
def test_a_car_position_in_millimetres_is_found(
    position: str, at: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    truth = lift(f"car_position: {position}", DOOR, MOTION)
    got = ridden(truth, last=LAST, floors=FOUR)
    found = analyse(got.recording)
    proposal = found.of("car_position")
    assert proposal is not None
    assert proposal.confidence is Confidence.SURE
    assert proposal.spec["positions"][1] == at
    told_apart = disagreements(got, found, truth, tmp_path_factory.mktemp("draft"))
    # with another tolerance the car is between floors a little earlier or later, never at another floor
    assert {one for one in told_apart if "None" not in one} == set()


def test_a_position_that_drifts_from_stop_to_stop_is_found() -> None:
    truth = lift(
        'car_position: {at: "holding:10", positions: {1: 0, 2: 3200, 3: 6400, 4: 9600}, tolerance: 50}', DOOR, MOTION
    )
    chance = random.Random(7)
    slack = [chance.randint(0, 25) for _ in range(1000)]
    got = ridden(
        truth, last=LAST, floors=FOUR, extra={(Table.HOLDING, 10): lambda true, now: true + slack[int(now / 9)]}
    )
    proposal = analyse(got.recording).of("car_position")
    assert proposal is not None
    assert proposal.confidence is Confidence.SURE
    assert 25 <= proposal.spec["tolerance"] <= 200


def test_everything_in_one_register_is_taken_apart(tmp_path: Path) -> None:
    truth = lift(
        'car_floor: {at: "holding:3", bits: [4, 7], as: floor}',
        'door.front: {at: "holding:3", bits: [0, 2], values: {1: closed, 2: opening, 3: open, 4: closing}}',
        'motion: {up: "holding:3.8", down: "holding:3.9"}',
        'obstruction.front: {at: "holding:3.15", active: low}',
    )
    got = ridden(truth, last=LAST, floors=FOUR)
    found = analyse(got.recording)
    assert confident(found).keys() >= {"car_floor", "door.front", "motion"}
    assert found.of("car_floor").spec == {"at": "holding:3", "bits": [4, 7], "as": "floor"}  # type: ignore[union-attr]
    assert disagreements(got, found, truth, tmp_path) == set()


def test_noise_counters_and_clocks_are_neither_position_nor_door(tmp_path: Path) -> None:
    truth = lift(FLOOR, DOOR, MOTION, 'alive: {at: "holding:0", type: counter, must_change_within_s: 3}')
    chance = random.Random(5)
    noise: Extra = {
        (Table.HOLDING, 20): lambda _true, _now: chance.randint(200, 260),
        (Table.HOLDING, 21): lambda _true, _now: chance.randint(0, 1),
        (Table.HOLDING, 22): lambda _true, now: int(now / 60),
        (Table.DISCRETE, 20): lambda _true, _now: chance.randint(0, 1),
        (Table.DISCRETE, 21): lambda _true, now: int(now / 7) % 2,
        (Table.INPUT, 3): lambda _true, _now: chance.randint(0, 0xFFFF),
    }
    got = ridden(truth, last=LAST, floors=FOUR, extra=noise)
    found = analyse(got.recording)
    assert {name: found.of(name).spec["at"] for name in confident(found)} == {  # type: ignore[union-attr]
        "car_floor": "holding:3", "door.front": "holding:4", "motion": "holding:5", "alive": "holding:0",
    }  # fmt: skip
    assert disagreements(got, found, truth, tmp_path) == set()


def test_a_bit_that_changes_to_and_fro_is_a_likely_heartbeat() -> None:
    got = ridden(
        lift(FLOOR, DOOR), last=LAST, floors=FOUR, extra={(Table.DISCRETE, 30): lambda _true, now: int(now) % 2}
    )
    alive = analyse(got.recording).of("alive")
    assert alive is not None
    assert (alive.confidence, alive.spec["at"]) == (Confidence.LIKELY, "discrete:30")
