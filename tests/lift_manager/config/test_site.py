"""Site files: what a good one gives, and what is said about every mistake in a bad one."""

from pathlib import Path

import pytest

from register_maps.words import Side
from tests.lift_manager.config.site_files import (
    GENERIC,
    SECOND_LIFT,
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


def test_a_good_site_file_gives_its_lifts_floors_and_maps(tmp_path: Path) -> None:
    loaded = load(tmp_path, GENERIC)
    lift = loaded.site.lifts["main"]
    assert {floor: entry.code for floor, entry in lift.floors.items()} == {"B1": -1, "L1": 1, "L2": 2}
    assert list(lift.floors) == ["B1", "L1", "L2"]
    assert loaded.maps["main"].map.name == "generic-registers"
    assert (loaded.site.api.host, loaded.site.api.port) == ("127.0.0.1", 5003)


def test_the_names_and_the_proxies_of_the_api_are_listed(tmp_path: Path) -> None:
    api = "api: {host_names: [lift-pc.example], trusted_proxies: [192.0.2.5, 192.0.2.16/28, '2001:db8::/64']}\n"
    found = load(tmp_path, GENERIC + api).site.api
    assert found.host_names == ("lift-pc.example",)
    assert [str(network) for network in found.trusted_proxies] == ["192.0.2.5/32", "192.0.2.16/28", "2001:db8::/64"]


@each_row("proxy", ["proxy.example", "192.0.2.300", "192.0.2.5/28", "192.0.2.5:80"])
def test_a_proxy_that_is_no_address_is_a_mistake(tmp_path: Path, proxy: str) -> None:
    (found,) = findings(tmp_path, GENERIC + f"api: {{trusted_proxies: ['{proxy}']}}\n")
    assert f"'{proxy}' is no address and no network, such as 192.0.2.5 or 192.0.2.0/28" in str(found)


def test_what_an_unlocked_trial_may_write_is_listed(tmp_path: Path) -> None:
    ranges = "map: generic-registers, writable_ranges: [coil 16 to 31, holding 40]"
    found = load(tmp_path, GENERIC, ("map: generic-registers", ranges)).site.controllers["plc"].writable_ranges
    assert [(str(one.table), one.first, one.last) for one in found] == [("coil", 16, 31), ("holding", 40, 40)]
    cautions = list(load(tmp_path, GENERIC, ("map: generic-registers", ranges)).cautions())
    assert "plc: `lift-manager poke --unlock` may write coil 16 to 31, holding 40, on the wire" in cautions
    assert load(tmp_path, GENERIC).site.controllers["plc"].writable_ranges == ()


@each_row("text", ["discrete 1", "coil", "coil 5 to 4", "holding 65536", "holding:40", "coil 1-5"])
def test_a_range_that_cannot_be_written_is_a_mistake(tmp_path: Path, text: str) -> None:
    ranges = f"map: generic-registers, writable_ranges: ['{text}']"
    (found,) = findings(tmp_path, GENERIC, ("map: generic-registers", ranges))
    assert found.key.startswith("controllers.plc.writable_ranges")
    assert "such as `coil 16 to 31` or `holding 40`" in found.message


def test_a_lift_is_only_monitored_unless_the_file_says_control(tmp_path: Path) -> None:
    assert load(tmp_path, GENERIC, ("    access: control\n", "")).site.lifts["main"].access == "monitor"
    assert load(tmp_path, GENERIC).site.lifts["main"].access == "control"


def test_a_map_is_found_beside_the_site_file_whatever_the_working_folder_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    my_map(tmp_path, ("name: generic-registers", "name: mine"))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load(tmp_path, GENERIC, ("map: generic-registers", "map: ./mine.yaml")).maps["main"].map.name == "mine"


@pytest.mark.parametrize("short", ["L2: 2", "L2: {code: 2}"])
def test_a_floor_may_be_written_short_or_long(tmp_path: Path, short: str) -> None:
    assert load(tmp_path, GENERIC, ("L2: 2", short)).site.lifts["main"].floors["L2"].code == 2


def test_a_floor_may_say_which_doors_serve_it(tmp_path: Path) -> None:
    loaded = load(tmp_path, GENERIC, ("L2: 2", "L2: {code: 2, doors: [front]}"))
    assert loaded.site.lifts["main"].floors["L2"].doors == (Side.FRONT,)


@pytest.mark.parametrize("apart", ["offset: {holding: 100}", "unit_id: 2"])
def test_two_lifts_share_a_controller_when_offset_or_unit_keeps_them_apart(tmp_path: Path, apart: str) -> None:
    second = edited(SECOND_LIFT, ("    access: control", f"    access: control\n    {apart}"))
    assert list(load(tmp_path, GENERIC + second).site.lifts) == ["main", "second"]


def test_a_floor_name_that_yaml_would_misread_is_fine_in_quotes(tmp_path: Path) -> None:
    loaded = load(tmp_path, GENERIC, ("L1: 1, L2: 2", '"1": 1, "on": 2, "NO": 3, "2024-01-01": 4'))
    assert list(loaded.site.lifts["main"].floors) == ["B1", "1", "on", "NO", "2024-01-01"]


@each_row("name", ["east", "B-2_goods.1", "_", "7", "x" * 64])
def test_a_lift_may_be_named_by_letters_digits_and_three_signs(tmp_path: Path, name: str) -> None:
    assert list(load(tmp_path, GENERIC, ("  main:", f'  "{name}":')).site.lifts) == [name]


@each_row(
    "name", ["", "east wing", "east/wing", "Güter", "電梯", ".", "..", "-x", ".x", "x" * 65, "a:b", "x\\n", "\\u202ex"]
)
def test_another_name_of_a_lift_is_refused_with_the_rule_and_the_way_to_keep_it_for_people(
    tmp_path: Path, name: str
) -> None:
    found = findings(tmp_path, GENERIC, ("  main:", f'  "{name}":'), ("L2: 2", "L2: 1"))
    named, floor = found
    assert named.key.startswith("lifts.")
    for words in ("1 to 64 characters", "letters", "digits", "`-`, `_` and `.`", "begins with", "`display_name`"):
        assert words in named.message
    assert str(named).isprintable()
    assert "floor L1 already" in floor.message, "it hides no other mistake"


@each_row("text", ["Güteraufzug Süd / 2", "電梯 1", "x", "x" * 64, "\u0645\u06cc\u200c\u062e a\u00a0b"])
def test_people_may_call_a_lift_by_any_printable_text(tmp_path: Path, text: str) -> None:
    lift = load(tmp_path, GENERIC, ("access: control", f'access: control\n    display_name: "{text}"')).site.lifts[
        "main"
    ]
    assert lift.display_name == text


@each_row("text", ["", " ", "x" * 65, "a\\nb", "a\\u2028b", "a\\u202eb", "a\\u0085b"])
def test_what_is_not_one_printable_line_is_no_display_name(tmp_path: Path, text: str) -> None:
    (found,) = findings(tmp_path, GENERIC, ("access: control", f'access: control\n    display_name: "{text}"'))
    assert (found.line, found.key) == (9, "lifts.main.display_name")


# What is wrong, the edits that make it so, and everything that is said about it.
Mistake = tuple[str, list[tuple[str, str]], list[Said]]

KEYS: list[Mistake] = [
    (
        "a typo in a key that is needed",
        [("floors:", "flors:")],
        [said(9, "lifts.main.flors", "no such key", "did you mean `floors`"), said(6, "lifts.main.floors", "missing")],
    ),
    (
        "a typo in a key that may be left out",
        [("access:", "acess:")],
        [said(8, "lifts.main.acess", "no such key", "did you mean `access`")],
    ),
    (
        "a key nobody knows",
        [("name: A building", "name: A building\npaint: red")],
        [
            said(
                3,
                "paint",
                "no such key",
                "api, cluster, controllers, hub, journal, lifts, name, require_checkout, rmf, schema",
            )
        ],
    ),
    ("a key that is missing", [("host: 10.0.0.5, ", "")], [said(4, "controllers.plc.host", "is missing")]),
    ("another schema", [("schema: 1", "schema: 2")], [said(1, "schema", "must be 1", "not 2")]),
    (
        "a lift name given twice",
        [("lifts:\n", "lifts:\n  main: {controller: plc, floors: {a: 1, b: 2}}\n")],
        [said(7, "lifts.main", "given twice", "line 6")],
    ),
    (
        "a key given twice",
        [("    access: control\n", "    access: control\n    access: monitor\n")],
        [said(9, "lifts.main.access", "given twice", "line 8")],
    ),
    (
        "a controller name given twice",
        [("lifts:\n", "  plc: {host: 10.0.0.6, map: generic-registers}\nlifts:\n")],
        [said(5, "controllers.plc", "given twice", "line 4")],
    ),
    ("a tab before a key", [("    access", "\taccess")], [said(8, "", "tab", "use spaces")]),
    ("a tab after a key", [("controller: plc", "controller:\tplc")], [said(7, "", "tab", "use spaces")]),
    ("no lift at all", [(GENERIC[GENERIC.index("lifts:") :], "lifts: {}\n")], [said(5, "lifts", "at least 1 entry")]),
    (
        "an access that does not exist",
        [("access: control", "access: kontrol")],
        [said(8, "lifts.main.access", "monitor, control", "did you mean `control`")],
    ),
    ("a bracket that is not closed", [("L2: 2}", "L2: 2")], [said(10, "", "closing bracket is missing", "line 9")]),
    ("an anchor", [("main:", "main: &lift")], [said(6, "lifts.main", "anchors and aliases are not allowed")]),
]

CONTROLLERS: list[Mistake] = [
    (
        "an address that is none",
        [("10.0.0.5", "10.0.0.500")],
        [said(4, "controllers.plc.host", "10.0.0.500 is no IPv4 address", "0 to 255")],
    ),
    (
        "an address with three numbers",
        [("10.0.0.5", "10.0.5")],
        [said(4, "controllers.plc.host", "10.0.5 is no IPv4 address", "four numbers")],
    ),
    (
        "an address with its port",
        [("10.0.0.5", '"10.0.0.5:502"')],
        [said(4, "controllers.plc.host", "alone", "`host: 10.0.0.5` and `port: 502`")],
    ),
    (
        "an address as a browser has it",
        [("10.0.0.5", '"http://10.0.0.5"')],
        [said(4, "controllers.plc.host", "alone", "192.0.2.5")],
    ),
    (
        "a controller that is not there",
        [("controller: plc", "controller: plk")],
        [said(7, "lifts.main.controller", "no controller 'plk'", "there is plc")],
    ),
    (
        "a map that is not there",
        [("map: generic-registers", "map: generic-register")],
        [
            said(
                4,
                "controllers.plc.map",
                "generic-register: no map has this name",
                "`generic-registers`",
                "two-stop-agv",
                "./",
            )
        ],
    ),
    (
        "a map file that is not there",
        [("map: generic-registers", "map: ./nowhere.yaml")],
        [said(4, "controllers.plc.map", "/nowhere.yaml: there is no such file")],
    ),
    (
        "access as a boolean of YAML",
        [("access: control", "access: yes")],
        [said(8, "lifts.main.access", "must be one of monitor, control, not yes")],
    ),
    (
        "a port that does not exist",
        [("port: 502", "port: 70000")],
        [said(4, "controllers.plc.port", "at most 65535", "70000")],
    ),
    (
        "a port in quotes",
        [("port: 502", 'port: "502"')],
        [said(4, "controllers.plc.port", "must be a whole number", "text")],
    ),
    (
        "a host that YAML reads as a number",
        [("host: 10.0.0.5", "host: 10")],
        [said(4, "controllers.plc.host", "a number", 'quote it: "10"')],
    ),
    (
        "a second controller at the address of the first",
        [("lifts:\n", "  same: {host: 10.0.0.5, map: two-stop-agv}\nlifts:\n")],
        [said(5, "controllers.same.port", "10.0.0.5:502 is controller 'plc' already")],
    ),
]

LIFTS: list[Mistake] = [
    (
        "an offset for a table that the map does not use",
        [("access: control", "access: control\n    offset: {coil: 1}")],
        [said(9, "lifts.main.offset.coil", "uses no coil addresses")],
    ),
    (
        "a floor without a door",
        [("L2: 2", "L2: {code: 2, doors: []}")],
        [said(9, "lifts.main.floors.L2", "lists no door")],
    ),
    (
        "a time-out beyond the age limit",
        [("port: 502,", "port: 502, timeout_s: 2,")],
        [said(7, "lifts.main.controller", "timeout_s 2", "above max_age_s 1")],
    ),
    (
        "an age limit of a day",
        [("access: control", "access: control\n    max_age_s: 86400")],
        [said(9, "lifts.main.max_age_s", "at most 10")],
    ),
    (
        "an offset that leaves the address space at the top",
        [("access: control", "access: control\n    offset: {holding: 65530}")],
        [said(9, "lifts.main.offset.holding", "0 to 65535 on the wire")],
    ),
    (
        "an offset that leaves the address space at the bottom",
        [("access: control", "access: control\n    offset: {holding: -1}")],
        [said(9, "lifts.main.offset.holding", "0 to 65535 on the wire")],
    ),
    (
        "an offset beyond everything",
        [("access: control", "access: control\n    offset: {holding: 70000}")],
        [said(9, "lifts.main.offset.holding", "at most 65535", "70000")],
    ),
    (
        "an offset of a table that does not exist",
        [("access: control", "access: control\n    offset: {holdings: 7}")],
        [said(9, "lifts.main.offset.holdings", "coil, discrete, holding, input", "did you mean `holding`")],
    ),
    (
        "a poll that is slower than half the age limit of the map",
        [("access: control", "access: control\n    poll_s: 0.6")],
        [said(9, "lifts.main.poll_s", "every 0.6 s is too slow", "max_age_s 1")],
    ),
    (
        "a poll that is slower than half the lift's own age limit",
        [("access: control", "access: control\n    poll_s: 0.3\n    max_age_s: 0.5")],
        [said(9, "lifts.main.poll_s", "every 0.3 s is too slow", "max_age_s 0.5")],
    ),
    (
        "a reason for latching that is no reason",
        [("access: control", "access: control\n    accept_latching: true")],
        [said(9, "lifts.main.accept_latching", "must be text", "boolean")],
    ),
    (
        "a side that the map has no door for",
        [("L2: 2", "L2: {code: 2, doors: [rear]}")],
        [said(9, "lifts.main.floors.L2", "no rear door", "front")],
    ),
    (
        "a side that no lift has",
        [("L2: 2", "L2: {code: 2, doors: [reer]}")],
        [said(9, "lifts.main.floors.L2.doors[0]", "front", "rear", "not 'reer'")],
    ),
]

FLOORS: list[Mistake] = [
    (
        "a code that two floors share",
        [("L2: 2", "L2: 1")],
        [said(9, "lifts.main.floors.L2", "code 1 is floor L1 already")],
    ),
    (
        "a code at which the call register rests",
        [("L2: 2", "L2: 0")],
        [said(9, "lifts.main.floors.L2", "rests at 0", "a release would call a floor")],
    ),
    (
        "a code that means no floor, on a lift that is only watched",
        [("L2: 2", "L2: 0"), ("    access: control\n", "")],
        [said(8, "lifts.main.floors.L2", "code 0", "means that there is no floor")],
    ),
    (
        "a code that does not fit the register's type",
        [("L2: 2", "L2: 40000")],
        [said(9, "lifts.main.floors.L2", "int16", "40000 does not fit")],
    ),
    (
        "a code that would read back as another, on a lift that is only watched",
        [("L2: 2", "L2: 40000"), ("    access: control\n", "")],
        [said(8, "lifts.main.floors.L2", "code 40000", "read back as -25536")],
    ),
    (
        "a code that no register holds",
        [("L2: 2", "L2: 99999")],
        [said(9, "lifts.main.floors.L2", "at most 65535", "99999")],
    ),
    (
        "a code in quotes",
        [("L2: 2", 'L2: "2"')],
        [said(9, "lifts.main.floors.L2", "must be a whole number", "text '2'")],
    ),
    ("a code that is true", [("L2: 2", "L2: true")], [said(9, "lifts.main.floors.L2", "must be a whole number")]),
    ("half a code", [("L2: 2", "L2: 2.5")], [said(9, "lifts.main.floors.L2", "must be a whole number", "2.5")]),
    ("a code with a leading zero", [("L2: 2", "L2: 010")], [said(9, "lifts.main.floors.L2", "010", "quote it")]),
    ("a floor given twice", [("L2: 2", "L1: 2")], [said(9, "lifts.main.floors.L1", "given twice")]),
    ("a single floor", [("B1: -1, L1: 1, L2: 2", "L1: 1")], [said(9, "lifts.main.floors", "at least 2 entries")]),
    (
        "a typo in the long form",
        [("L2: 2", "L2: {cod: 2}")],
        [
            said(9, "lifts.main.floors.L2.cod", "no such key", "`code`"),
            said(9, "lifts.main.floors.L2.code", "is missing"),
        ],
    ),
    *(
        (
            f"a floor called {name}",
            [("L2: 2", f"{name}: 2")],
            [said(9, f"lifts.main.floors.{name}", f"YAML reads {name} as {sort}", f'quote it: "{name}"')],
        )
        for name, sort in [
            ("2", "a number"),
            ("-2", "a number"),
            ("1.5", "a number"),
            ("on", "a boolean"),
            ("NO", "a boolean"),
            ("~", "nothing"),
            ("2024-01-01", "a date"),
        ]
    ),
]


@each_row(
    ("edits", "expected"),
    [pytest.param(edits, expected, id=name) for name, edits, expected in [*KEYS, *CONTROLLERS, *LIFTS, *FLOORS]],
)
def test_a_mistake_is_named_with_its_line_its_key_and_the_way_out(
    tmp_path: Path, edits: list[tuple[str, str]], expected: list[Said]
) -> None:
    assert_says_exactly(findings(tmp_path, GENERIC, *edits), *expected)


@each_row(
    ("edits", "expected"),
    [
        pytest.param(
            [("    accept_latching: a person stands beside it\n", "")],
            said(8, "lifts.goods.access", "go_to, hold_door.front, close_door.front", "stay on", "accept_latching"),
            id="outputs that latch and nobody accepted",
        ),
        pytest.param(
            [("L2: 1", "L2: 2")],
            said(10, "lifts.goods.floors.L2", "2 floors, with codes 0 to 1", "2 is none"),
            id="a code for which there is no coil",
        ),
        pytest.param(
            [("L2: 1", "L2: 2"), ("    access: control\n", "")],
            said(9, "lifts.goods.floors.L2", "2 floors, with codes 0 to 1", "2 is none"),
            id="a code for which there is no switch",
        ),
    ],
)
def test_a_mistake_against_the_two_stop_map_is_named_too(
    tmp_path: Path, edits: list[tuple[str, str]], expected: Said
) -> None:
    assert_says_exactly(findings(tmp_path, TWO_STOP, *edits), expected)


def test_outputs_that_latch_need_no_word_where_nothing_is_written(tmp_path: Path) -> None:
    watched = edited(TWO_STOP, ("    access: control\n    accept_latching: a person stands beside it\n", ""))
    assert load(tmp_path, watched).site.lifts["goods"].access == "monitor"


def test_a_line_break_in_a_name_is_refused_in_one_printable_line(tmp_path: Path) -> None:
    (finding,) = findings(tmp_path, GENERIC, ("L2: 2", '"L\\n2": 2'))
    assert finding.line == 9
    assert "control character" in finding.message
    assert str(finding).isprintable()


def test_the_mistakes_of_a_map_are_reported_in_the_maps_own_file_at_its_own_lines(tmp_path: Path) -> None:
    bad = my_map(
        tmp_path, ("  car_floor:", "  car_flor:"), ('motion: {at: "holding:2"', 'motion: {at: "holding:70000"')
    )
    found = findings(tmp_path, GENERIC, ("map: generic-registers", "map: ./mine.yaml"))
    assert {finding.file for finding in found} == {str(bad)}
    assert_says_exactly(
        found,
        said(line_of(bad, "car_flor:"), "signals.car_flor", "did you mean `car_floor`"),
        said(line_of(bad, "motion:"), "signals.motion.at", "70000", "65535"),
    )


def test_several_mistakes_are_all_reported_in_the_order_of_their_lines(tmp_path: Path) -> None:
    main = edited(
        GENERIC,
        ("name: A building", "name: A building\ncolour: red"),
        ("access: control\n", "access: control\n    poll_s: 5\n"),
        ("L2: 2", "L2: 1, L3: 0, 4: 4"),
    )
    found = findings(tmp_path, main + edited(SECOND_LIFT, ("controller: plc", "controller: plk")))
    assert_says_exactly(
        found,
        said(3, "colour", "no such key"),
        said(10, "lifts.main.poll_s", "too slow"),
        said(11, "lifts.main.floors.L2", "floor L1 already"),
        said(11, "lifts.main.floors.L3", "rests at 0"),
        said(11, "lifts.main.floors.4", 'quote it: "4"'),
        said(13, "lifts.second.controller", "no controller 'plk'"),
    )
    lines = [finding.line or 0 for finding in found]
    assert lines == sorted(lines)


def test_a_typo_in_a_needed_key_hides_none_of_the_other_mistakes(tmp_path: Path) -> None:
    found = findings(
        tmp_path,
        GENERIC + edited(SECOND_LIFT, ("controller: plc", "controller: plk")),
        ("name: A building", "nmae: A building"),
        ("map: generic-registers", "map: generic-register"),
    )
    assert_says_exactly(
        found,
        said(1, "name", "is missing"),
        said(2, "nmae", "did you mean `name`"),
        said(4, "controllers.plc.map", "no map has this name"),
        said(11, "lifts.second.controller", "no controller 'plk'"),
    )


def test_every_finding_begins_with_file_line_and_key(tmp_path: Path) -> None:
    (finding,) = findings(tmp_path, GENERIC, ("L2: 2", "L2: 1"))
    assert str(finding) == f"{tmp_path / 'site.yaml'}:9: lifts.main.floors.L2: code 1 is floor L1 already"


@each_row(
    ("key", "of_rmf", "least_s", "clearing"),
    [
        ("lease_s", "", 30, "clear_s"),
        ("max_session_hold_s", "", 30, "clear_s"),
        ("max_session_s", "", 30, "clear_s"),
        ("max_session_hold_s", "rmf: {end_grace_s: 3}\n", 90, "rmf.clear_s"),
        ("max_session_s", "rmf: {end_grace_s: 3}\n", 90, "rmf.clear_s"),
    ],
)
def test_a_limit_that_leaves_robots_no_time_before_open_is_withdrawn_is_refused_with_its_cure(
    tmp_path: Path, key: str, of_rmf: str, least_s: int, clearing: str
) -> None:
    site = of_rmf + GENERIC
    line = f"    access: control\n    {key}: {least_s - 1}\n"
    found = findings(tmp_path, site, ("    access: control\n", line))
    (one,) = found
    for text in (
        f"lifts.main.{key}",
        f"3 times `{clearing}`",
        f"set `{key}` to {least_s} or more, or lower `{clearing}`",
    ):
        assert text in str(one)
    load(tmp_path, site, ("    access: control\n", line.replace(str(least_s - 1), str(least_s))))


@each_row(
    ("keys", "idle_s", "cure"),
    [
        ("", 0.7, "set `poll_s` below 0.2"),
        ("    poll_s: 0.4\n", 0.9, "set `poll_s` below 0.4"),
        ("", 0.5, "give the controller a shorter `timeout_s`"),
    ],
)
def test_a_controller_that_closes_a_connection_between_two_polls_is_refused_with_its_cure(
    tmp_path: Path, keys: str, idle_s: float, cure: str
) -> None:
    polled = ("    access: control\n", f"    access: control\n{keys}")
    (one,) = findings(tmp_path, GENERIC, polled, ("port: 502,", f"port: 502, idle_timeout_s: {idle_s:g},"))
    for text in ("lifts.main", "poll_s", f"after {idle_s:g} s (idle_timeout_s)", cure):
        assert text in str(one)
    load(tmp_path, GENERIC, polled, ("port: 502,", f"port: 502, idle_timeout_s: {idle_s + 0.3:g},"))


def test_one_lift_that_is_polled_often_enough_keeps_a_shared_connection(tmp_path: Path) -> None:
    silent = ("port: 502,", "port: 502, idle_timeout_s: 0.9,")
    slow = edited(SECOND_LIFT, ("controller: plc", "controller: plc\n    offset: {holding: 100}\n    poll_s: 0.45"))
    load(tmp_path, GENERIC + slow, silent)


LETS_GO = "    override: {commands: {hold_door.front: {released_after_s: 29}}}\n"


@each_row(
    ("of_rmf", "least_s", "clearing"),
    [("", 30, "`clear_s` (10 s)"), ("rmf: {end_grace_s: 3}\n", 90, "`rmf.clear_s` (30 s)")],
)
def test_a_controller_that_lets_the_door_go_too_soon_for_robots_is_refused_with_both_times(
    tmp_path: Path, of_rmf: str, least_s: int, clearing: str
) -> None:
    site, seconds = of_rmf + GENERIC, str(least_s - 1)
    lets_go = LETS_GO.replace("29", seconds)
    (one,) = findings(tmp_path, site, ("    access: control\n", "    access: control\n" + lets_go))
    for text in (
        "lifts.main.map",
        f"releases hold_door.front after {seconds} s",
        "released_after_s",
        f"3 times {clearing}",
    ):
        assert text in str(one)
    load(tmp_path, site, ("    access: control\n", "    access: control\n" + lets_go.replace(seconds, str(least_s))))
    load(tmp_path, site, ("    access: control\n", lets_go))


def test_a_shorter_clear_s_allows_shorter_limits(tmp_path: Path) -> None:
    more = "    access: control\n    clear_s: 2\n    lease_s: 6\n    max_session_hold_s: 6\n"
    lift = load(tmp_path, GENERIC, ("    access: control\n", more)).site.lifts["main"]
    assert (lift.clear_s, lift.lease_s) == (2.0, 6.0)


@each_row(
    ("edit", "key"),
    [
        (("port: 502", "port: 70000"), "controllers.plc.port"),
        (("port: 502", "timeout_s: never"), "controllers.plc.timeout_s"),
        (("name: A building\n", ""), "name"),
        (("schema: 1\n", "schema: 1\napi: {port: 0}\n"), "api.port"),
        (("schema: 1\n", "schema: 1\ntimezone: Mars\n"), "timezone"),
    ],
)
def test_a_mistake_elsewhere_does_not_hide_those_of_the_floors(tmp_path: Path, edit: tuple[str, str], key: str) -> None:
    found = findings(tmp_path, edited(GENERIC, edit, ("L2: 2", "L2: 1")))
    assert sorted(finding.key for finding in found) == sorted([key, "lifts.main.floors.L2"])


def test_what_stands_in_for_a_mistake_causes_none(tmp_path: Path) -> None:
    second = "  other: {host: 192.0.2.99, port: 99999, map: two-stop-agv}\n"
    found = findings(tmp_path, edited(GENERIC, ("lifts:\n", f"{second}lifts:\n")))
    assert [finding.key for finding in found] == ["controllers.other.port"]
