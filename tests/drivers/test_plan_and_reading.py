"""From points to block reads, and from decoded signals to one lift's words."""

from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.modbus.capabilities import LiftSettings, capabilities
from drivers.modbus.read_plan import PlanError, plan_poll, plan_reads, polled_points
from drivers.modbus.reading import lift_mode, lift_values
from register_maps.codec import Block, Point, compile_map
from register_maps.load import MapChanges, load
from register_maps.schema import RegisterMap
from register_maps.words import Door, Mode, Motion, Side, Table
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled

SERVED: dict[str, tuple[range, ...]] = {Table.HOLDING: (range(40), range(100, 140)), Table.DISCRETE: (range(16),)}


class LaterMap(RegisterMap):
    """A map as a later version of the language knows it."""

    new_key: float = 5.0


def map_hash(changes: Mapping[str, Any], form: type[RegisterMap] = RegisterMap) -> str:
    loaded = load("generic-registers", changes=MapChanges({}, changes)).map
    codec = compile_map(form.model_construct(**{name: getattr(loaded, name) for name in RegisterMap.model_fields}))
    return capabilities(codec, (), LiftSettings(name="lift", floors={"L1": 1, "L2": 2})).map_hash


def test_the_hash_of_a_map_changes_with_what_it_says_and_not_with_a_key_of_a_later_version() -> None:
    said = map_hash({})
    assert map_hash({}, LaterMap) == said
    assert map_hash({"commands": {"hold_door.front": {"press": 2}}}) != said
    assert map_hash({"signals": {"level": {"at": "holding:5.7"}}}) != said


def points(*addresses: int, table: Table = Table.HOLDING) -> list[Point]:
    return [Point(table, address) for address in addresses]


def test_a_gap_inside_a_served_range_is_read_along() -> None:
    assert plan_reads(points(3, 20), SERVED, max_registers=125, max_bits=2000) == (Block(Table.HOLDING, 3, 18),)


def test_a_read_never_crosses_the_edge_of_what_is_served() -> None:
    plan = plan_reads(points(39, 100), SERVED, max_registers=125, max_bits=2000)
    assert plan == (Block(Table.HOLDING, 39, 1), Block(Table.HOLDING, 100, 1))


def test_a_read_asks_for_no_more_than_the_device_gives_at_once() -> None:
    plan = plan_reads(points(0, 9, 10, 19), SERVED, max_registers=10, max_bits=2000)
    assert plan == (Block(Table.HOLDING, 0, 10), Block(Table.HOLDING, 10, 10))


def test_each_table_is_read_by_itself() -> None:
    both = points(1) + points(1, 2, table=Table.DISCRETE)
    plan = plan_reads(both, SERVED, max_registers=125, max_bits=2000)
    assert plan == (Block(Table.DISCRETE, 1, 2), Block(Table.HOLDING, 1, 1))


def test_a_point_that_is_not_served_is_refused() -> None:
    with pytest.raises(PlanError, match="holding 50"):
        plan_reads(points(50), SERVED, max_registers=125, max_bits=2000)


@given(st.sets(st.sampled_from([*range(40), *range(100, 140)]), min_size=1), st.integers(1, 125))
def test_every_point_is_read_once_and_nothing_outside_what_is_served(addresses: set[int], limit: int) -> None:
    wanted = points(*addresses)
    plan = plan_reads(wanted, SERVED, max_registers=limit, max_bits=2000)
    assert all(sum(block.holds(point) for block in plan) == 1 for point in wanted)
    for block in plan:
        assert block.count <= limit
        assert any(block.start in span and block.start + block.count <= span.stop for span in SERVED[Table.HOLDING])


@each_row(
    ("signals", "mode"),
    [
        ({}, Mode.NORMAL),
        ({"robot_mode_on": True}, Mode.ROBOT),
        ({"mode": Mode.NORMAL, "fire": True}, Mode.FIRE),
        ({"mode": Mode.FIRE, "inspection": True}, Mode.INSPECTION),
        ({"mode": Mode.OUT_OF_SERVICE, "robot_mode_on": True}, Mode.OUT_OF_SERVICE),
        ({"fault": True}, Mode.OUT_OF_SERVICE),
        ({"passenger_alarm": True, "fault": True}, Mode.EMERGENCY),
        ({"mode": None}, Mode.UNKNOWN),
        ({"mode": None, "robot_mode_on": True}, Mode.UNKNOWN),
        ({"mode": None, "fireman": True}, Mode.FIRE),
        ({"mode": Mode.NORMAL, "attendant": True, "independent": False}, Mode.ATTENDANT),
    ],
)
def test_the_highest_mode_that_anything_tells_is_the_mode(signals: dict[str, bool | Mode | None], mode: Mode) -> None:
    assert lift_mode(signals) is mode


def test_floors_get_their_names_and_unlisted_codes_none() -> None:
    values = lift_values({"car_floor": -1, "destination": 7, "call_accepted": None}, {}, {-1: "B1", 1: "G"})
    assert (values.floor, values.destination, values.call_accepted) == ("B1", None, None)
    assert values.unknown == {"destination": 7}


def test_what_cannot_be_read_is_unknown_and_what_the_map_lacks_is_none() -> None:
    values = lift_values({"door.rear": None, "motion": None}, {"door.rear": 9, "motion": 9}, {})
    assert values.doors == {Side.REAR: Door.UNKNOWN}
    assert values.motion is Motion.UNKNOWN
    assert lift_values({}, {}, {}).motion is None


def test_a_door_is_read_before_the_floor_where_they_take_two_reads() -> None:
    codec = compiled("generic-registers")
    plan = plan_poll(codec, max_registers=2, max_bits=2000)
    door, floor = (
        next(number for number, block in enumerate(plan) if block.holds(codec.signals[name].points[0]))
        for name in ("door.front", "car_floor")
    )
    assert door < floor
    assert sorted(plan, key=str) == sorted(
        plan_reads(polled_points(codec), codec.served, max_registers=2, max_bits=2000), key=str
    )


def test_a_poll_whose_door_and_floor_come_together_is_read_in_the_order_of_addresses() -> None:
    codec = compiled("wago-750")
    plan = plan_poll(codec, max_registers=125, max_bits=2000)
    assert plan == plan_reads(polled_points(codec), codec.served, max_registers=125, max_bits=2000)
    assert len(plan) > 1
