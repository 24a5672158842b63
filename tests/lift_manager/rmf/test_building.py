"""What of a site does not match RMF's building map and navigation graph: every kind of difference, and the block that mends names."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from lift_manager.rmf.building import Comparison, SiteLift, compare
from lift_manager.rmf.building_file import MAX_BYTES, read_building, read_graph
from register_maps.errors import MapFileError
from tests.support.rows import each_row

BUILDING = """\
coordinate_system: reference_image
levels:
  L1:
    elevation: 0
    vertices:
      - [10, 20, 0, lobby]
      - [355, 340, 0, "", {lift_cabin: [1, Lift1]}]
    walls:
      - [40, 39, {alpha: [3, 1], texture_name: [1, white]}]
  L2:
    elevation: 8
    vertices:
      - [355, 340, 0, "", {lift_cabin: [1, Lift1]}]
  L3:
    elevation: 16
lifts:
  Lift1:
    depth: 2.7
    doors:
      front_door: {door_type: 2, motion_axis_orientation: 0, width: 1.7, x: 0, y: -1.5}
      rear_door: {door_type: 2, motion_axis_orientation: 0, width: 1.7, x: 0, y: 1.5}
    highest_floor: L3
    initial_floor_name: L1
    level_doors:
      L1: [front_door]
      L2: [front_door, rear_door]
    lowest_floor: L1
    reference_floor_name: L1
    x: 355
    y: 340
    yaw: 0
name: hospital
"""

GRAPH = """\
building_name: hospital
doors: {}
levels:
  L1:
    lanes:
      - [0, 1, {speed_limit: 0}]
    vertices:
      - [1.0, -2.0, {name: lobby}]
      - [4.00, -5.0, {name: '', lift: Lift1}]
  L2:
    lanes: []
    vertices:
      - [4.06, -5.0, {name: '', lift: Lift1}]
lifts:
  Lift1: {dims: [2.7, 2.7], position: [4.0, -5.0, 0.0]}
"""

SITE = SiteLift("main", "Lift1", {"L1": "L1", "L2": "L2"}, {"L1": ("front",), "L2": ("front", "rear")})

Compare = Callable[..., Comparison]


@pytest.fixture
def compared(tmp_path: Path) -> Compare:
    def call(*site: SiteLift, building: str = BUILDING, graph: str | None = None) -> Comparison:
        (tmp_path / "map.building.yaml").write_text(building, "utf-8")
        (tmp_path / "0.yaml").write_text(graph or "", "utf-8")
        return compare(
            site or (SITE,),
            read_building(tmp_path / "map.building.yaml"),
            [] if graph is None else [read_graph(tmp_path / "0.yaml")],
        )

    return call


def told(found: Comparison) -> list[str]:
    """Line, key and the rest of each mistake, with the file's name and not its path."""
    return [f"{Path(each.file).name}:{each.line}: {each.key}: {each.message}" for each in found.mistakes]


def only(found: Comparison) -> str:
    (line,) = told(found)
    return line


def test_a_site_with_the_names_of_the_map_has_nothing_to_mend(compared: Compare) -> None:
    found = compared(graph=GRAPH)
    assert (found.mistakes, found.notes, list(found.site_file_lines())) == ([], [], [])


def test_a_lift_whose_name_differs_in_case_and_spaces_is_named_with_what_to_write(compared: Compare) -> None:
    found = compared(replace(SITE, name="lift 1"))
    assert only(found) == (
        "map.building.yaml:17: lifts.Lift1: is called 'lift 1' by the site, and RMF compares exactly;"
        " write `rmf: {name: Lift1}` for lift main"
    )
    assert list(found.site_file_lines()) == ["lifts:", "  main:", "    rmf:", "      name: Lift1"]


def test_floors_that_differ_in_case_are_suggested_together_with_the_lift(compared: Compare) -> None:
    site = SiteLift("main", "lift1", {"l1": "l1", "l2 ": "l2 "}, {"l1": ("front",), "l2 ": ("front", "rear")})
    found = compared(site)
    assert [line.split(": ")[1] for line in told(found)] == [
        "lifts.Lift1",
        "lifts.Lift1.level_doors.L1",
        "lifts.Lift1.level_doors.L2",
    ]
    assert list(found.site_file_lines())[3:] == ["      name: Lift1", "      floors: {l1: L1, 'l2 ': L2}"]


def test_floors_of_other_names_are_paired_by_height_and_the_suggestion_says_that_it_is_a_guess(
    compared: Compare,
) -> None:
    site = SiteLift("main", "Lift1", {"G": "G", "First": "First"}, {"G": ("front",), "First": ("front", "rear")})
    found = compared(site)
    assert "is perhaps 'G' by the site" in told(found)[0]
    assert "write `rmf: {floors: {First: L2}}` for lift main" in told(found)[1]
    assert "lowest floor upwards" in list(found.site_file_lines())[4]
    assert list(found.site_file_lines())[5] == "      floors: {G: L1, First: L2}"


def test_a_name_that_is_alike_to_two_is_paired_with_none_of_them(compared: Compare) -> None:
    twice = BUILDING.replace("name: hospital", "  LIFT1: {level_doors: {L1: [a]}, doors: {a: {}}}")
    found = compared(replace(SITE, name="lift1"), building=twice)
    assert list(found.site_file_lines()) == []
    assert len(found.mistakes) == 2


def test_a_level_that_is_listed_without_a_door_is_not_served(compared: Compare) -> None:
    found = compared(
        building=BUILDING.replace("L1: [front_door]", "L1: []").replace(
            "[1, Lift1]}]\n    walls", "[1, '']}]\n    walls"
        )
    )
    assert found.mistakes == []
    assert found.notes == [
        "main: in the map this is lift Lift1, without a door there, so no robot of RMF will request floor L1"
    ]


def test_a_suggestion_keeps_what_is_right_already(compared: Compare) -> None:
    found = compared(replace(SITE, floors={"L1": "L1", "L2": "l2"}))
    assert list(found.site_file_lines())[3:] == ["      name: Lift1"]
    found = compared(SiteLift("Lift1", "Lift1", {"L1": "L1", "L2": "l2"}, SITE.doors))
    assert list(found.site_file_lines()) == ["lifts:", "  Lift1:", "    rmf: {}"]
    found = compared(SiteLift("main", "lift1", {"G": "L1", "L2": "l2"}, {"G": ("a",), "L2": ("a", "b")}))
    assert list(found.site_file_lines())[3:] == ["      name: Lift1", "      floors: {G: L1}"]


def test_nothing_is_guessed_where_the_map_says_of_no_level_how_high_it_is(compared: Compare) -> None:
    site = SiteLift("main", "Lift1", {"G": "G", "First": "First"}, {"G": ("front",), "First": ("front", "rear")})
    found = compared(site, building=BUILDING.replace("elevation: 8", "elevation: 0"))
    assert list(found.site_file_lines()) == []
    assert "no floor of lift main is called 'L1'; it has 'G', 'First'" in told(found)[0]


def test_a_lift_of_the_map_that_the_site_has_not_is_a_note_because_another_adapter_may_have_it(
    compared: Compare,
) -> None:
    other = BUILDING.replace("name: hospital", "  Goods: {level_doors: {L1: [a]}, doors: {a: {}}}")
    found = compared(building=other)
    assert found.mistakes == []
    assert found.notes == [
        "Goods: is on the map and not on this site; a robot that requests it waits for another adapter"
    ]
    assert compared(building=other.replace("[a]", "[]")).notes == []


def test_a_lift_of_the_map_is_a_mistake_where_a_lift_of_the_site_may_be_the_same(compared: Compare) -> None:
    other = BUILDING.replace("name: hospital", "  Goods: {level_doors: {L1: [a]}, doors: {a: {}}}")
    found = compared(replace(SITE, name="main"), building=other)
    assert [line.partition(": ")[2] for line in told(found)] == [
        "lifts.Lift1: no lift of the site is called 'Lift1'; should main be that lift, write `rmf: {name: Lift1}` for it",
        "lifts.Goods: no lift of the site is called 'Goods'; should main be that lift, write `rmf: {name: Goods}` for it",
    ]


def test_the_last_lift_on_either_side_is_suggested_whatever_it_is_called(compared: Compare) -> None:
    found = compared(replace(SITE, name="A"))
    assert list(found.site_file_lines())[-1] == "      name: Lift1"


def test_a_lift_of_the_site_that_the_map_has_not_is_only_noted(compared: Compare) -> None:
    found = compared(SITE, SiteLift("goods", "goods", {"L1": "L1"}, {"L1": ("front",)}))
    assert found.mistakes == []
    assert found.notes == ["goods: no robot of RMF will request it, because the map has no lift 'goods'"]


def test_a_floor_that_the_site_has_not_is_a_mistake_and_one_that_the_map_has_not_a_note(compared: Compare) -> None:
    lacks = compared(SiteLift("main", "Lift1", {"L1": "L1"}, {"L1": ("front",)}))
    assert "level_doors.L2: no floor of lift main is called 'L2'; it has 'L1'" in only(lacks)
    more = replace(SITE, floors={**SITE.floors, "L3": "L3"}, doors={**SITE.doors, "L3": ("front",)})
    found = compared(more)
    assert found.mistakes == []
    assert found.notes == [
        "main: in the map this is lift Lift1, that does not serve 'L3', so no robot of RMF will request floor L3"
    ]


def test_as_many_doors_as_the_map_opens_at_a_level_are_the_doors_of_that_floor(compared: Compare) -> None:
    found = compared(replace(SITE, doors={"L1": ("front", "rear"), "L2": ("front", "rear")}))
    assert "map.building.yaml:25: lifts.Lift1.level_doors.L1: the map opens 1 door (front_door) here" in only(found)
    assert "lift main 2 doors (front, rear) at floor L1" in only(found)


@each_row(
    ("was", "becomes", "words"),
    [
        ("highest_floor: L3", "highest_floor: L4", "lifts.Lift1.highest_floor: the map has no level 'L4'"),
        ("L1: [front_door]", "L1: [front_dor]", "the lift has no door 'front_dor'; did you mean `front_door`?"),
        ("      L1: [front", "      L9: [front", "lifts.Lift1.level_doors.L9: the map has no level 'L9'"),
        ("[1, Lift1]}]\n    walls", "[1, Lift2]}]\n    walls", "in lift 'Lift2', which the map has not"),
        ("  L3:\n", "  L3:\n    vertices: [[1, 2, 0, '', {lift_cabin: [1, Lift1]}]]\n", "has no door at L3"),
    ],
)
def test_what_is_wrong_within_the_map_is_named_too(compared: Compare, was: str, becomes: str, words: str) -> None:
    assert was in BUILDING
    assert words in "\n".join(told(compared(building=BUILDING.replace(was, becomes))))


@each_row(
    ("was", "becomes", "words"),
    [
        (
            "  L2:\n    lanes",
            "  L22:\n    lanes",
            "0.yaml:10: levels.L22: the map has no level 'L22'; did you mean `L2`?",
        ),
        (
            "''" + ", lift: Lift1}]\n  L2",
            "'', lift: lift1}]\n  L2",
            "0.yaml:9: levels.L1.vertices: this vertex is in lift 'lift1'",
        ),
        ("  Lift1: {dims", "  Lift2: {dims", "the graph's `lifts` has no 'Lift1', so the fleet adapter refuses it"),
        ("  Lift1: {dims", "  Lift2: {dims", "lifts.Lift2: the map has no lift 'Lift2'"),
        ("  L2:\n    lanes", "  L3:\n    lanes", "by the map has no door at L3"),
        ("[4.06", "[4.16", "0.yaml:13: levels.L2.vertices: the vertices of lift Lift1 lie 0.16 m apart"),
    ],
)
def test_a_graph_that_does_not_fit_the_map_is_named(compared: Compare, was: str, becomes: str, words: str) -> None:
    assert was in GRAPH
    assert words in "\n".join(told(compared(graph=GRAPH.replace(was, becomes))))


def test_vertices_of_a_lift_as_far_apart_as_the_fleet_adapter_bears_are_no_mistake(compared: Compare) -> None:
    assert compared(graph=GRAPH.replace("[4.06", "[4.0999")).mistakes == []


def test_a_graph_without_lifts_and_a_level_without_a_vertex_are_noted(compared: Compare) -> None:
    graph = GRAPH.partition("lifts:")[0].replace("[4.06, -5.0, {name: '', lift: Lift1}]", "[9, 9, {name: x}]")
    found = compared(graph=graph)
    assert found.mistakes == []
    assert "has no `lifts`" in found.notes[0]
    assert found.notes[1].endswith("has no vertex in lift Lift1 at L2, so the robots of this graph do not ride there")


def test_names_are_the_text_in_the_file_even_where_yaml_reads_numbers_and_words_of_its_own(compared: Compare) -> None:
    numbers = BUILDING.replace("L1", "1").replace("L2", "02").replace("L3", "no")
    site = SiteLift("main", "Lift1", {"1": "1", "02": "02"}, SITE.doors)
    found = compared(replace(site, doors={"1": ("front",), "02": ("front", "rear")}), building=numbers)
    assert found.mistakes == []
    wrong = compared(
        SiteLift("main", "Lift1", {"no": "NO", "02": "02"}, {"no": ("a",), "02": ("a", "b")}), building=numbers
    )
    assert list(wrong.site_file_lines())[-1] == "      floors: {'no': '1'}"


@each_row(
    ("content", "words"),
    [
        ("", "no table of keys"),
        ("levels: [\n", "is not YAML"),
        ("name: hospital\n", "no levels: is this the .building.yaml of the traffic editor?"),
        ("a: " + "[" * 100_000, "nested more than 40 levels deep"),
        ("#" * (MAX_BYTES + 1), "was not read; the limit is"),
        ("levels: \x00", "is not YAML"),
    ],
)
def test_a_file_that_is_no_building_map_is_refused_in_one_sentence(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(content, "utf-8")
    with pytest.raises(MapFileError, match=words):
        read_building(path)


def test_aliases_are_followed_and_cost_nothing(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    names = [f"a{index}: &a{index} [{', '.join([f'*a{index - 1}'] * 9)}]" for index in range(1, 30)]
    doors = "level_doors: {L1: &doors [a], L2: *doors}"
    path.write_text(
        "\n".join(["a0: &a0 [x]", *names, "levels: {L1: {}, L2: {}}", f"lifts: {{A: {{{doors}}}}}"]), "utf-8"
    )
    assert read_building(path).lifts["A"].levels["L2"].doors == ("a",)


def test_a_file_that_is_not_there_or_is_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="no such file"):
        read_building(tmp_path / "none.yaml")
    with pytest.raises(MapFileError, match="not an ordinary file"):
        read_graph(tmp_path)
