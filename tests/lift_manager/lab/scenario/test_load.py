"""Mistakes in scenario files: all of them at once, each at its line, with what would be right."""

from pathlib import Path

import pytest

from lift_manager.lab.scenario.load import load_scenario
from register_maps.errors import MapFileError
from register_maps.load import MAPS, shipped
from tests.lift_manager.lab.scenario.scenario_files import ANYTHING, HEAD, NOTHING, loaded, text_of
from tests.support.programs import ROOT
from tests.support.rows import each_row
from tests.support.trip_sites import COMPLETIONS


def findings(folder: Path, text: str) -> list[str]:
    with pytest.raises(MapFileError) as refused:
        loaded(folder, text)
    return [str(finding).removeprefix(f"{folder / 'scenario.yaml'}:") for finding in refused.value.findings]


def only(folder: Path, text: str) -> str:
    (one,) = findings(folder, text)
    return one


@each_row(
    ("step", "said"),
    [
        ("{at: 1}", "do[0]: must have one of request, robot, fault"),
        ("{fault: overload}", "do[0]: needs `at`, a time in seconds, or `when`, a match"),
        ("{at: 60, fault: overload}", "do[0].at: is after the end: the scenario lasts 60 s"),
        ("{at: 1, fault: overload, wire: half_open}", "do[0].wire: cannot go with `fault`"),
        ("{at: 1, fault: overload, within_s: 3}", "do[0].within_s: belongs to `when`"),
        ("{at: 1, request: {floor: L1}, for_s: 3}", "do[0].for_s: belongs to `every_s`"),
        ("{at: 1, request: {floor: L9}}", "do[0].request.floor: no floor 'L9'; there is L1, L2, L3, L4"),
        ("{at: 1, request: {floor: L1, door: ajar}}", "must be one of open, closed, not 'ajar'"),
        ("{at: 1, robot: {from: L1, to: L1}}", "do[0].robot.to: is where the robot starts"),
        ("{at: 1, inputs: {landing_buttons: [L1, L9]}}", "do[0].inputs.landing_buttons[1]: no floor 'L9'"),
        ("{at: 1, inputs: {}}", "do[0].inputs: is empty"),
        ("{at: 1, inputs: {hold_door: [left]}}", "do[0].inputs.hold_door[0]: must be one of front, rear"),
        ("{at: 1, lift: north, fault: overload}", "do[0].lift: no lift 'north'; there is lift"),
        ("{at: 1, fault: stuk_door}", "do[0].fault: no fault has this name; did you mean `stuck_door`?"),
        ("{at: 1, fault: in_mode}", "do[0].fault.mode: is missing"),
        ("{at: 1, fault: {in_mode: normal}}", "fire, emergency, inspection, independent, out_of_service"),
        ("{at: 1, fault: {in_mode.fire: {}}}", "name it by itself, as text"),
        ("{at: 1, fault: {wrong_floor: {by: 0}}}", "by must not be 0"),
        ("{at: 1, fault: {stuck_door: {side: left}}}", "do[0].fault.stuck_door.side: must be one of front, rear"),
        ("{at: 1, fault: {foreign_writer: {command: goto}}}", "no command 'goto'; the map has close_door.front"),
        ("{at: 1, fault: {foreign_writer: {command: go_to}}}", "must name the `floor` for which go_to is written"),
        ("{at: 1, fault: {foreign_writer: {command: go_to, floor: X}}}", "no floor 'X'; there is L1, L2, L3, L4"),
        ("{at: 1, fault: {foreign_cell: {table: input, address: 0, value: 1}}}", "input:0 cannot be written"),
        ("{at: 1, fault: {foreign_cell: {table: holding, address: 99, value: 1}}}", "answers a write of 1"),
        ("{at: 1, fault: {disconnected_signal: {signal: smoke}}}", "no wire for a signal smoke"),
        ("{at: 1, wire: {delay: -1}}", "seconds -1.0, allowed 0 s or more"),
        ("{at: 1, wire: {delay: soon}}", "do[0].wire.delay.seconds: must be a number, not the text 'soon'"),
        ("{at: 1, wire: {delay: 1, on: {access: reads}}}", "do[0].wire.on: is `only` in a scenario"),
        ("{at: 1, wire: {delay: 1, only: {access: red}}}", "did you mean `reads`?"),
        ("{at: 1, wire: {delay: 1, controller: east}}", "no controller 'east'; there is controller"),
        ("{at: 1, wire: {delay: 1, half_open: {}}}", "a step has one fault, and this one has delay already"),
        ("{at: 1, wire: {refuse_connections: {}, only: {}}}", "affects connections, not requests"),
        ("{at: 1, wire: {half_open: {}, times: 0}}", "times 0, allowed 1 or more"),
        ("{at: 1, wire: {half_open: 3}}", "do[0].wire.half_open: has no values; write half_open: {}"),
        ("{at: 1, people: 3}", "do[0].people: must be a table of keys"),
        ("{at: 1, people: {per_minut: 3}}", "did you mean `per_minute`?"),
        ("{at: 1, people: {per_minute: 0}}", "traffic needs somebody who comes"),
        ("{at: 1, lock_out: {by: Dana}}", "do[0].lock_out.reason: is missing"),
        ("{when: {state: open}, fault: overload}", "do[0].when: must name a `kind` of entry; there is state"),
        ("{when: {kind: stat}, fault: overload}", "do[0].when.kind: must be a kind of entry, not 'stat'; did you"),
        ("{when: {kind: state, robot_doors: open}, fault: overload}", "state has no such field; did you mean"),
        ("{when: {kind: state, robot_door: opened}, fault: overload}", "must be one of closed, moving, open"),
        ("{when: {kind: state, floor: L9}, fault: overload}", "do[0].when.floor: no floor 'L9'"),
        ("{when: {kind: state, standing: 1}, fault: overload}", "must be true or false, not 1"),
        ("{when: {kind: state, floor: []}, fault: overload}", "an empty list matches nothing"),
        ("{when: {kind: state, floor: {above: 1}}, fault: overload}", "only numbers are above or below"),
        ("{when: {kind: state, floor: {contains: L}}, fault: overload}", "only text contains something"),
        ("{when: {kind: state, floor: {under: 1}}, fault: overload}", "there is above, below, contains, not"),
    ],
)
def test_a_step_with_a_mistake_is_refused(tmp_path: Path, step: str, said: str) -> None:
    line = only(tmp_path, text_of(do=f"  - {step}\n"))
    assert said in line
    assert line.startswith("6: do[0]")


@each_row(
    ("expectation", "said"),
    [
        ("{because: I like it}", "must have one of never, eventually, ordered, count"),
        ("{never: {kind: press}, count: {kind: press}, exactly: 1}", "cannot go with `never`"),
        ("{never: {kind: press}, while: {kind: press}}", "a press is over in a moment; `while` takes what lasts"),
        ("{never: {kind: press}, settled_s: 1}", "expect[0].settled_s: belongs to `while`"),
        ("{never: {kind: press}, within_s: 1}", "expect[0].within_s: belongs to `eventually`"),
        ("{never: {kind: press}, after: {kind: press}}", "expect[0].after: belongs to `eventually`"),
        ("{count: {kind: press}}", "needs at_least, at_most or exactly"),
        ("{count: {kind: press}, at_least: 0}", "of 0 is always met"),
        ("{count: {kind: press}, exactly: 1, at_most: 2}", "cannot go with at_least or at_most"),
        ("{ordered: [{kind: press}]}", "expect[0].ordered: must have at least 2 matches, not 1"),
        ("{ordered: [{kind: press}, {kind: alrm}]}", "expect[0].ordered[1].kind: must be a kind of entry"),
        ("{eventually: {kind: press}, within_s: 61}", "is longer than the scenario lasts: 60 s"),
        ("{eventually: {kind: press}, after_s: 9, before_s: 8}", "must be more than after_s, which is 9"),
        ("{eventually: {kind: press}, lift: north}", "no lift 'north'; there is lift"),
        ("{eventually: press}", "expect[0].eventually: must be a match, such as"),
    ],
)
def test_an_expectation_with_a_mistake_is_refused(tmp_path: Path, expectation: str, said: str) -> None:
    line = only(tmp_path, text_of(expect=f"  - {expectation}\n"))
    assert said in line
    assert line.startswith("8: expect[0]")


@each_row(
    ("head", "said"),
    [
        (HEAD.replace("map: generic-registers\n", ""), "must name either a `map`, for one lift, or a `site`"),
        (HEAD + "site: here.yaml\n", "must name either a `map`, for one lift, or a `site`"),
        (
            HEAD.replace("generic-registers", "generic-register"),
            "map: generic-register: no map has this name; did you mean",
        ),
        (HEAD.replace("generic-registers", "./my.yaml"), "/my.yaml: there is no such file"),
        (HEAD.replace("map: generic-registers", "site: my.yaml"), "/my.yaml: there is no such file"),
        (HEAD + "floors: {L1: 1}\n", "floors: must have at least 2 entries, not 1"),
        (HEAD + "parameters: {speed: 1}\n", "parameters.speed: generic-registers has no parameter speed"),
        (HEAD + "override: {signals: {car_floor: {at: 'holding:99'}}}\n", "override"),
        (HEAD + "options: {poll_s: 3}\n", "options.poll_s: a poll every 3 s is too slow"),
        (HEAD + "options: {infer_occupancy: true}\n", "options.infer_occupancy: generic-registers takes no report"),
        (HEAD + "simulator: {speed: 1000}\n", "simulator.speed: must be at most 100, not 1000"),
        (HEAD.replace("lasts_s: 60", "lasts_s: 0"), "lasts_s: must be more than 0, not 0"),
    ],
)
def test_a_mistake_in_the_lift_of_a_scenario_is_told_at_its_key(tmp_path: Path, head: str, said: str) -> None:
    assert any(said in line for line in findings(tmp_path, text_of(head=head)))


def test_every_mistake_is_told_at_once(tmp_path: Path) -> None:
    text = text_of(
        do="  - {at: 1, fault: no}\n  - {at: 1, robots: 3}\n  - {when: {kind: x}, wire: {delay: {}}}\n",
        expect="  - {never: {kind: y}}\n  - {eventually: {kind: state, flor: L1}}\n",
        head=HEAD.replace("60", "a minute"),
    )
    told = findings(tmp_path, text)
    assert [line.split(":")[0] for line in told] == ["4", "6", "7", "8", "8", "10", "11"]


def test_something_has_to_happen_and_something_has_to_be_so(tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_text(f"{HEAD}do: []\nexpect: []\n")
    with pytest.raises(MapFileError) as refused:
        load_scenario(tmp_path / "scenario.yaml")
    assert [finding.key for finding in refused.value.findings] == ["do", "expect"]


def test_a_site_brings_its_own_lifts(tmp_path: Path) -> None:
    controllers = "  east: {host: 192.0.2.1, map: generic-registers}\n  west: {host: 192.0.2.2, map: generic-coils}\n"
    lifts = "  e: {controller: east, access: control, robot_hours: [Mon-Fri 06:00-07:00], floors: {G: 1, U: 2}}\n"
    lifts += "  w: {controller: west, floors: {G: 0, U: 1}}\n"
    (tmp_path / "site.yaml").write_text(f"schema: 1\nname: Two\ncontrollers:\n{controllers}lifts:\n{lifts}")
    head = HEAD.replace("map: generic-registers", "site: site.yaml")
    do = "  - {at: 1, lift: w, wire: {delay: 0.1, controller: west}}\n"
    scenario = loaded(tmp_path, text_of(head=head, do=do, expect="  - {never: {kind: alarm}}\n"))
    assert [step.lift for step in scenario.steps] == ["w"]
    assert scenario.expected[0].lifts == ("e", "w")
    assert scenario.site.site.lifts["e"].robot_hours is None
    said = findings(tmp_path, text_of(head=head, do="  - {at: 1, fault: overload}\n"))
    assert said == [
        "6: do[0]: must name the `lift`; there is e, w",
        "8: expect[0]: must name the `lift`; there is e, w",
    ]
    told = findings(
        tmp_path, text_of(head=head + "floors: {A: 1, B: 2}\n", do=do, expect="  - {never: {kind: alarm}}\n")
    )
    assert told == ["5: floors: is set by the site file; remove it here, or name a `map`"]


def test_a_map_may_be_a_file_beside_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text((MAPS / "generic-coils.yaml").read_text())
    scenario = loaded(tmp_path, text_of(head=HEAD.replace("generic-registers", "./mine.yaml")))
    assert scenario.lifts["lift"].floors == tuple(f"L{number}" for number in range(1, 9))


@each_row("name", [name for name in shipped() if name not in COMPLETIONS and name != "thingweb-elevator"])
def test_every_shipped_map_that_is_a_whole_lift_can_be_named(tmp_path: Path, name: str) -> None:
    scenario = loaded(tmp_path, text_of(head=HEAD.replace("generic-registers", name), do=NOTHING, expect=ANYTHING))
    assert len(scenario.lifts["lift"].floors) >= 2


def test_a_map_can_be_completed_in_the_scenario(tmp_path: Path) -> None:
    more = """\
override:
  endpoints: {sensor: {unit_id: 2, served: {discrete: [[0, 3]]}}}
  signals:
    door.front: {open_limit: "sensor/discrete:0", closed_limit: "sensor/discrete:1"}
    car_floor: {one_of: ["sensor/discrete:2", "sensor/discrete:3"]}
"""
    scenario = loaded(tmp_path, text_of(head=HEAD.replace("generic-registers", "moxa-e1211") + more))
    assert scenario.lifts["lift"].controllers == ("controller", "sensor")


def test_a_file_that_is_no_scenario_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="there is no such file"):
        load_scenario(tmp_path / "none.yaml")
    assert any("is missing" in line for line in findings(tmp_path, "schema: 1\n"))
    (found,) = findings(tmp_path, "- a\n")
    assert found.startswith("1: must be a table of keys, not a list; for example {schema: 1, title: ...")
    with pytest.raises(MapFileError, match="this is a site file and not a scenario"):
        load_scenario(ROOT / "examples" / "first-site.yaml")
