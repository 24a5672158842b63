"""The judge's own table and its own decoder, against what is typed from each map's source."""

from dataclasses import replace

from lift_manager.lab.world.decoding import Outputs
from lift_manager.lab.world.lift_under_test import MODES_WITHOUT_ROBOTS
from lift_manager.lab.world.reviewed import REVIEWED, described, evidence_of
from register_maps.codec import compile_map
from register_maps.words import ROBOT_FORBIDDEN_MODES, Table
from tests.campaigns.playing import loaded_map
from tests.campaigns.truth import maps
from tests.support.rows import each_row
from tests.support.trip_sites import NO_TRIP

RIDDEN = [name for name in maps() if name not in NO_TRIP]

VECTORS = {
    "adam-io": [("coil", 16, 1, ("go_to", 0)), ("coil", 17, 1, ("go_to", 1)), ("coil", 18, 1, ("hold_door.front", 1))],
    "adam-pushbutton": [("coil", 18, 1, ("go_to", 2)), ("coil", 19, 1, ("hold_door.front", 1))],
    "generic-coils": [
        ("coil", 7, 1, ("go_to", 7)),
        ("coil", 8, 1, ("hold_door.front", 1)),
        ("coil", 10, 1, ("robot_mode", 1)),
    ],
    "generic-coils-cluster": [
        ("coil", 7, 1, ("go_to", 7)),
        ("coil", 8, 1, ("hold_door.front", 1)),
        ("coil", 10, 1, ("robot_mode", 1)),
    ],
    "generic-registers-cluster": [("holding", 19, 4, ("go_to", 3)), ("holding", 20, 1, ("hold_door.front", 1))],
    "generic-registers": [("holding", 16, 4, ("go_to", 3)), ("holding", 17, 1, ("hold_door.front", 1))],
    "moxa-e1211": [("coil", 1, 1, ("go_to", 1)), ("coil", 2, 1, ("hold_door.front", 1))],
    "moxa-e1212": [("coil", 1, 1, ("go_to", 1)), ("coil", 2, 1, ("hold_door.front", 1))],
    "moxa-e1214": [("coil", 1, 1, ("go_to", 1)), ("coil", 2, 1, ("hold_door.front", 1))],
    "robotnik-il-eth": [
        ("holding", 384, 4, ("go_to", 2)),
        ("holding", 385, 8, ("robot_mode", 1)),
        ("holding", 385, 1, ("hold_door.front", 1)),
    ],
    "seer-generic": [("holding", 10, 2, ("go_to", 1)), ("holding", 11, 5, ("hold_door.front", 1))],
    "seer-lps3-two-stop": [
        ("coil", 17, 1, ("call", 0)),
        ("coil", 19, 1, ("call", 1)),
        ("coil", 18, 1, ("robot_in_place", 1)),
    ],
    "seer-siemens-chengdu": [
        ("holding", 1, 3, ("call", 2)),
        ("holding", 2, 1, ("go", 0)),
        ("coil", 2, 1, ("robot_left", 1)),
    ],
    "seer-siemens-chengdu-block": [("holding", 100, 3, ("call", 2)), ("holding", 102, 1, ("robot_in_place", 1))],
    "two-stop-agv": [
        ("coil", 1, 1, ("go_to", 1)),
        ("coil", 2, 1, ("hold_door.front", 1)),
        ("coil", 3, 1, ("close_door.front", 1)),
    ],
    "wago-750": [("coil", 0, 1, ("go_to", 0)), ("coil", 2, 1, ("hold_door.front", 1))],
    "waveshare-relay": [("coil", 513, 1, ("go_to", 1)), ("coil", 2, 1, ("hold_door.front", 1))],
}
"""Table, address on the wire, contents, and what that asks for."""


@each_row("name", RIDDEN)
def test_what_a_controller_is_asked_for_is_read_from_its_cells(name: str) -> None:
    loaded, floors = loaded_map(name)
    outputs = Outputs(loaded.map, tuple(floors.values()), {})
    for space, address, value, command in VECTORS[name]:
        cells = compile_map(loaded.map).empty_image()
        assert outputs.decode(outputs.raw(cells)) == {}
        cells[space][address] = value
        assert outputs.decode(outputs.raw(cells)) == dict([command])


def test_two_floors_at_once_and_a_floor_that_nobody_has_ask_for_nothing() -> None:
    coils, registers = loaded_map("generic-coils"), loaded_map("generic-registers")
    outputs = Outputs(coils[0].map, tuple(coils[1].values()), {})
    cells = compile_map(coils[0].map).empty_image()
    cells["coil"][0] = cells["coil"][1] = 1
    assert outputs.decode(outputs.raw(cells)) == {}
    outputs = Outputs(registers[0].map, tuple(registers[1].values()), {})
    cells = compile_map(registers[0].map).empty_image()
    cells["holding"][16] = 0xFFFF
    assert outputs.decode(outputs.raw(cells)) == {}


def test_a_lift_of_several_on_one_controller_has_its_tables_moved() -> None:
    loaded, floors = loaded_map("generic-registers")
    outputs = Outputs(loaded.map, tuple(floors.values()), {Table.HOLDING: 100})
    cells = {"holding": [0] * 200}
    cells["holding"][117] = 1
    assert outputs.decode(outputs.raw(cells)) == {"hold_door.front": 1}


@each_row("name", RIDDEN)
def test_every_map_of_the_campaigns_was_reviewed_and_its_text_says_the_same(name: str) -> None:
    source = loaded_map(name)[0].map
    shows, was_reviewed = evidence_of(source)
    assert was_reviewed
    assert shows is REVIEWED[name].shows
    assert described(source) == replace(shows, proofs={})


def test_a_map_that_its_site_has_changed_is_described_from_its_text() -> None:
    source = loaded_map("moxa-e1212")[0].map
    changed = source.model_copy(update={"signals": {name: it for name, it in source.signals.items() if name != "fire"}})
    shows, was_reviewed = evidence_of(changed)
    assert (was_reviewed, shows.modes) == (False, frozenset())


def test_the_manager_and_the_judge_agree_on_the_modes_without_robots() -> None:
    assert MODES_WITHOUT_ROBOTS == ROBOT_FORBIDDEN_MODES
