"""A map under a site's parameters and overrides: what comes of it, and where a mistake is said."""

from pathlib import Path

import pytest

from lift_manager.config.load import load_site
from register_maps.errors import MapFileError
from register_maps.words import Door
from tests.lift_manager.config.site_files import (
    GENERIC,
    TWO_STOP,
    Said,
    assert_says_exactly,
    edited,
    findings,
    line_of,
    load,
    my_map,
    said,
)
from tests.support.rows import each_row

SEER = """\
schema: 1
name: A building
controllers:
  plc: {host: 10.0.0.5, map: seer-generic}
lifts:
  main:
    controller: plc
    parameters:
      dest_floor: 10
      open_door: 11
      close_door: 12
      lift_floor: 13
      door_status: 14
      move_status: 15
      emergency: 16
      first_register: 10
      last_register: 16
    floors: {L1: 1, L2: 2}
"""


def with_lines(text: str, lines: str) -> str:
    """The site with more lines in its lift, before its floors."""
    return edited(text, ("    floors:", f"{lines}    floors:"))


def test_parameters_move_the_points_of_one_lift(tmp_path: Path) -> None:
    second = "  second:\n    controller: plc\n    floors: {L1: 0, L2: 1}\n"
    loaded = load(tmp_path, with_lines(TWO_STOP, "    parameters: {first_input: 100}\n") + second)
    assert loaded.maps["goods"].map.signals["fault"].at == "discrete:105"
    assert loaded.maps["goods"].parameters["first_input"] == 100
    assert loaded.maps["second"].map.signals["fault"].at == "discrete:5"


def test_a_parameter_may_be_a_word(tmp_path: Path) -> None:
    moxa = edited(GENERIC, ("generic-registers", "moxa-e1212"), ("{B1: -1, L1: 1, L2: 2}", "{L1: 0, L2: 1}"))
    loaded = load(tmp_path, with_lines(moxa, "    parameters: {on_link_loss: device_watchdog}\n"))
    assert loaded.maps["main"].map.commands["hold_door.front"].on_link_loss == "device_watchdog"


def test_a_site_may_set_every_address_of_a_template(tmp_path: Path) -> None:
    assert load(tmp_path, SEER).maps["main"].map.served == {"holding": ((10, 16),)}


def test_an_override_is_laid_over_the_map_key_by_key(tmp_path: Path) -> None:
    override = "    override: {commands: {hold_door.front: {max_hold_s: 12}}, signals: {overload: {active: low}}}\n"
    changed = load(tmp_path, with_lines(GENERIC, override)).maps["main"].map
    assert (changed.commands["hold_door.front"].max_hold_s, changed.commands["hold_door.front"].at) == (
        12,
        "holding:17",
    )
    assert (changed.signals["overload"].active, changed.signals["overload"].at) == ("low", "holding:5.4")


def test_a_value_table_in_an_override_keeps_its_number_keys(tmp_path: Path) -> None:
    override = "    override: {signals: {door.front: {values: {10: closed, 20: moving, 0x1E: open}}}}\n"
    changed = load(tmp_path, with_lines(GENERIC, override)).maps["main"].map
    assert changed.signals["door.front"].values == {10: Door.CLOSED, 20: Door.MOVING, 30: Door.OPEN}


def test_a_map_that_is_changed_has_another_fingerprint_and_one_that_is_not_has_its_own(tmp_path: Path) -> None:
    as_shipped = load(tmp_path, TWO_STOP).maps["goods"]
    moved = load(tmp_path, with_lines(TWO_STOP, "    parameters: {first_input: 100}\n")).maps["goods"]
    assert as_shipped.sha256 != moved.sha256


@each_row(
    ("lines", "expected"),
    [
        pytest.param(
            "    parameters: {first_inptu: 100}\n",
            [said(10, "lifts.goods.parameters.first_inptu", "no parameter first_inptu", "did you mean `first_input`")],
            id="a parameter that the map does not have",
        ),
        pytest.param(
            "    parameters:\n      first_input: 100\n      first_output: 65533\n",
            [said(12, "lifts.goods.parameters.first_output", "0 to 65532, not 65533", "first of the four coils")],
            id="a parameter out of its range, without what follows from it",
        ),
        pytest.param(
            '    parameters: {first_input: "100"}\n',
            [said(10, "lifts.goods.parameters.first_input", "must be a number, not '100'")],
            id="a number in quotes",
        ),
        pytest.param(
            "    parameters: {first_input: true}\n",
            [said(10, "lifts.goods.parameters.first_input", "must be a number or text")],
            id="a parameter that is neither number nor text",
        ),
        pytest.param(
            "    parameters: [100]\n",
            [said(10, "lifts.goods.parameters", "must be a table of keys, not a list")],
            id="parameters in a list",
        ),
        pytest.param(
            "    override:\n      signals:\n        fault: {at: discrete:5x}\n",
            [said(12, "lifts.goods.override.signals.fault.at", "discrete:5x", "not an address")],
            id="an override with an address that cannot be read",
        ),
        pytest.param(
            "    override:\n      signals:\n        door.front: {values: {0: closd, 1: open}, at: 'discrete:0'}\n",
            [said(12, "lifts.goods.override.signals.door.front.values[0]", "'closd'", "did you mean `closed`")],
            id="an override with a word that does not exist, under a number key",
        ),
        pytest.param(
            "    override:\n      signals:\n        fault: {at: 'discrete:5', actve: low}\n",
            [said(12, "lifts.goods.override.signals.fault.actve", "no such key", "did you mean `active`")],
            id="an override with a typo",
        ),
        pytest.param(
            "    override:\n      link: {min_gap_s: 1}\n      signals: 5\n",
            [
                said(11, "lifts.goods.override.link", "a site cannot change 'link'", "signals, commands"),
                said(12, "lifts.goods.override.signals", "must be a table of keys, not 5"),
            ],
            id="an override of what a site cannot change",
        ),
        pytest.param(
            "    override: {commands: {hold_door.front: {1: 2}}}\n",
            [
                said(10, "lifts.goods.override.commands.hold_door.front.1", 'quote it: "1"'),
                said(10, "lifts.goods.override.commands.hold_door.front.1", "no such key"),
            ],
            id="a number key where it is no code",
        ),
        pytest.param(
            "    override:\n      signals:\n        overload: {at: 'discrete:5'}\n",
            [said(12, "lifts.goods.override.signals.overload.at", "discrete:5 is in fault already")],
            id="an override that takes a point of the map",
        ),
        pytest.param(
            "    override:\n      signals:\n        door.front: {open_limit: 'discrete:5', closed_limit: 'discrete:1'}\n",
            [
                said(
                    12,
                    "lifts.goods.override.signals.door.front",
                    "with this, signals.fault.at of two-stop-agv is wrong",
                )
            ],
            id="an override that takes a point of a later signal",
        ),
    ],
)
def test_a_mistake_of_a_change_is_said_in_the_site_file_at_its_line(
    tmp_path: Path, lines: str, expected: list[Said]
) -> None:
    found = findings(tmp_path, with_lines(TWO_STOP, lines))
    assert {finding.file for finding in found} == {str(tmp_path / "site.yaml")}
    assert_says_exactly(found, *expected)


def test_a_mistake_that_a_parameter_makes_elsewhere_in_the_map_is_said_at_the_parameter(tmp_path: Path) -> None:
    moxa = edited(GENERIC, ("generic-registers", "moxa-e1212"), ("{B1: -1, L1: 1, L2: 2}", "{L1: 0, L2: 1}"))
    watched = edited(moxa, ("    access: control\n", ""))
    found = findings(tmp_path, with_lines(watched, "    parameters:\n      door_is_open: 1\n"))
    words = ("signals.door.front.closed_limit of moxa-e1212", "discrete:1 is twice")
    assert_says_exactly(found, said(9, "lifts.main.parameters.door_is_open", *words))
    several = "    parameters:\n      door_is_open: 1\n      door_open: 3\n"
    assert_says_exactly(findings(tmp_path, with_lines(watched, several)), said(8, "lifts.main.parameters", *words))


def test_a_mistake_of_the_map_is_said_once_in_its_own_file_and_that_of_each_lift_at_its_own_line(
    tmp_path: Path,
) -> None:
    bad = my_map(tmp_path, ('motion: {at: "holding:2"', 'motion: {at: "holding:70000"'))
    changed = "    override: {signals: {overload: {actve: low}}}\n"
    second = edited(GENERIC[GENERIC.index("  main:") :], ("  main:", "  second:"))
    third = edited(second, ("  second:", "  third:"), ("    access: control\n", ""))
    site = with_lines(edited(GENERIC, ("map: generic-registers", "map: ./mine.yaml")), changed)
    found = findings(tmp_path, site + edited(second, ("    access: control\n", changed)) + third)
    assert_says_exactly(
        found,
        said(line_of(bad, "motion:"), "signals.motion.at", "70000", "65535"),
        said(9, "lifts.main.override.signals.overload.actve", "did you mean `active`"),
        said(13, "lifts.second.override.signals.overload.actve", "did you mean `active`"),
    )
    assert [finding.file for finding in found].count(str(bad)) == 1


def test_a_parameter_that_nobody_has_set_is_named_with_its_help_and_its_range(tmp_path: Path) -> None:
    found = findings(tmp_path, SEER, ("      lift_floor: 13\n", ""), ("      emergency: 16\n", ""))
    assert_says_exactly(
        found,
        said(8, "lifts.main.parameters.lift_floor", "is not set", "register with the floor of the car (0 to 65535)"),
        said(8, "lifts.main.parameters.emergency", "is not set", "0 no, 1 yes (0 to 65535)"),
    )


def test_parameters_that_nobody_has_set_are_named_beside_the_mistakes_of_the_changes(tmp_path: Path) -> None:
    override = "    override:\n      signals:\n        motion: {actve: low}\n"
    found = findings(tmp_path, with_lines(SEER, override), ("      lift_floor: 13\n", ""))
    assert_says_exactly(
        found,
        said(8, "lifts.main.parameters.lift_floor", "is not set"),
        said(19, "lifts.main.override.signals.motion.actve", "did you mean `active`"),
    )


def test_a_value_that_cannot_be_read_is_one_mistake_and_not_two(tmp_path: Path) -> None:
    for lines, key in [
        ("    parameters: {first_input: *here}\n", "parameters.first_input"),
        ("    override: {signals: {robot_mode_on: *here}}\n", "override.signals.robot_mode_on"),
    ]:
        found = findings(tmp_path, with_lines(TWO_STOP, lines))
        assert_says_exactly(found, said(10, f"lifts.goods.{key}", "anchors and aliases are not allowed"))


def test_a_map_is_loaded_even_where_no_lift_is_on_its_controller(tmp_path: Path) -> None:
    found = findings(tmp_path, GENERIC, ("lifts:\n", "  spare: {host: 10.0.0.9, map: nothing}\nlifts:\n"))
    assert_says_exactly(found, said(5, "controllers.spare.map", "no map has this name"))


def test_a_map_that_cannot_be_found_is_one_mistake_for_all_its_lifts(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    second = edited(GENERIC[GENERIC.index("  main:") :], ("  main:", "  second:"))
    text = with_lines(edited(GENERIC, ("map: generic-registers", "map: nothing")), "    parameters: {a: 1}\n")
    path.write_text(text + second, "utf-8")
    with pytest.raises(MapFileError) as caught:
        load_site(path)
    assert_says_exactly(caught.value.findings, said(4, "controllers.plc.map", "no map has this name"))
