"""What the text and the wiring sheet say, and which maps are refused."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from lift_manager.commissioning.plc.errors import ProgramError
from lift_manager.commissioning.plc.program import PlcProgram, render
from register_maps.load import MAPS, load
from register_maps.schema import RegisterMap
from tests.lift_manager.commissioning.plc.rig import LAYOUTS, REGISTERS, Layout, program
from tests.lift_manager.commissioning.plc.structured_text import Machine
from tests.support.rows import each_row

each_map = pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.map_name)
FLOORS = {"B1": -1, "L1": 1, "L2": 2}
FLOORS_OF_COILS = {"B1": 0, "L1": 1}
TWO_FLOORS = {"B1": -1, "L1": 1}
"""Every kind of statement is in a program for two floors; a third one repeats some of them."""


def changed(change: Callable[[dict[str, Any]], object], name: str = "generic-registers") -> RegisterMap:
    given = yaml.safe_load((MAPS / f"{name}.yaml").read_text())
    change(given)
    return RegisterMap.model_validate(given)


def without_doors(given: dict[str, Any]) -> None:
    for name in ("alive", "door.front", "obstruction.front", "overload", "destination", "call_accepted"):
        given["signals"].pop(name, None)
    for name in ("hold_door.front", "close_door.front"):
        del given["commands"][name]


@each_map
def test_the_text_is_plain_ascii_and_a_strict_plc_takes_it(layout: Layout) -> None:
    text = program(layout).st
    assert text.isascii()
    assert "\t" not in text
    assert Machine(text).sections.keys()


@each_map
def test_a_caller_declares_its_arrays_with_the_types_of_the_program(layout: Layout) -> None:
    text = program(layout).st
    types = re.findall(r"^  (RobotLift\w+) : ARRAY \[\d+\.\.\d+\] OF (?:BOOL|WORD);$", text, re.MULTILINE)
    assert text.index("TYPE\n") < text.index("END_TYPE\n") < text.index("FUNCTION_BLOCK RobotLift\n")
    passed_in = text.partition("VAR_IN_OUT\n")[2].partition("END_VAR")[0]
    assert [re.split(r" : |;", line.strip())[1] for line in passed_in.splitlines() if ": RobotLift" in line] == types
    assert all(
        f"`{name.removeprefix('RobotLift')} : {name};`, `{name} : ARRAY [" in program(layout).wiring for name in types
    )


def twincat_takes(text: str, folder: Path) -> bool:
    """Whether a parser that knows nothing of ours reads a program to its end. Each run takes seconds."""
    source = folder / "program.st"
    source.write_text(text)
    return (
        subprocess.run([sys.executable, "-m", "blark", "parse", source], check=False, capture_output=True).returncode
        == 0
    )


def test_a_parser_for_twincat_takes_it_in_words_and_in_bits(tmp_path: Path) -> None:
    of_coils = render(changed(without_doors, "generic-coils"), FLOORS_OF_COILS)
    # one by one: the parser takes the longer for each statement, the more of them there are
    assert twincat_takes(render(load("generic-registers").map, TWO_FLOORS).st, tmp_path)
    assert twincat_takes(of_coils.st, tmp_path)


def test_a_parser_for_twincat_refuses_a_broken_program(tmp_path: Path) -> None:
    # without an END_IF it would read on for seconds to the end
    text = render(load("generic-registers").map, TWO_FLOORS).st
    assert not twincat_takes(text.replace(" THEN", "", 1), tmp_path)


@each_map
def test_only_the_standard_blocks_and_types_are_used(layout: Layout) -> None:
    machine = Machine(program(layout).st)
    assert set(machine.types.values()) <= {"BOOL", "INT", "UINT", "WORD", "TON", "TOF", "TP", "R_TRIG"}


@each_map
def test_every_name_of_the_interface_is_in_the_sheet_once_with_its_contact_and_address(layout: Layout) -> None:
    made = program(layout)
    rows = [line.split(" | ") for line in made.wiring.splitlines() if line.startswith("| ")]
    contacts = {row[0].removeprefix("| "): row[2] for row in rows if len(row) == 6 and row[2] in ("NO", "NC")}
    machine = Machine(made.st)
    terminals = [name for name, section in machine.sections.items() if section in ("var_input", "var_output")]
    assert list(contacts) == terminals
    assert contacts["NoFire"] == "NC"
    assert contacts["RobotsAllowed"] == "NO"


@each_row(
    ("map_name", "row"),
    [
        ("generic-registers", "| fire | holding:5.0 | 5 bit 0 | FC03 | 0 = fire |"),
        (
            "generic-registers",
            "| go_to | holding:16 | 16 | FC06, FC03 | the code of a floor; a press of 0.5 s, then 0 |",
        ),
        ("generic-coils", "| fire | discrete:25 | 25 | FC02 | 0 = fire |"),
        ("generic-coils", "| car_floor | discrete:0 to discrete:7 | 0 to 7 | FC02 | one bit per floor |"),
        (
            "generic-coils",
            "| go_to | coil:0 to coil:7 | 0 to 7 | FC15, FC01 | one bit per floor; a press of 0.5 s, then 0 |",
        ),
    ],
)
def test_the_sheet_gives_printed_and_wire_addresses(map_name: str, row: str) -> None:
    layout = next(layout for layout in LAYOUTS if layout.map_name == map_name)
    assert row in program(layout).wiring.splitlines()


def test_addresses_counted_from_one_are_moved_to_the_wire() -> None:
    def from_one(given: dict[str, Any]) -> None:
        given["addressing"] = {"base": 1}
        given["served"] = {"holding": [[1, 7], [16, 19]]}
        del given["signals"]["alive"]

    made = render(changed(from_one), FLOORS)
    assert "RobotLiftHoldingRegisters : ARRAY [0..18] OF WORD;" in made.st
    assert "Requested := (HoldingRegisters[17] = 16#0001);" in made.st
    assert "| robot_mode | holding:18 | 17 | FC06, FC03 |" in made.wiring


def test_times_and_values_come_from_the_map() -> None:
    def slower(given: dict[str, Any]) -> None:
        given["commands"]["robot_mode"] |= {"refresh_s": 2, "press": 7, "rest": 3}
        given["commands"]["go_to"]["width_s"] = 1.5
        given["commands"]["hold_door.front"] |= {"max_hold_s": 20, "cleared_after_s": 14}

    made = render(changed(slower), FLOORS)
    assert "Kept(IN := Requested, PT := T#6s);" in made.st
    assert "Requested := (HoldingRegisters[18] = 16#0007);" in made.st
    assert "  HoldingRegisters[18] := 16#0003;" in made.st
    assert "PT := T#1500ms" in made.st
    assert "HoldAge(IN := HoldRequested, PT := T#14s);" in made.st


def test_a_map_without_doors_commands_and_counters_gives_a_smaller_program() -> None:
    machine = Machine(render(changed(without_doors), FLOORS).st)
    assert not {"DoorOpenButton", "DoorOpenLimit", "DoorwayClear", "CallLamp1", "Beats"} & machine.types.keys()
    machine.scan(0.0)


@each_row("name", ["x *) y", "(* x", "a | b", "Größe", "two\nlines"])
def test_no_floor_name_breaks_out_of_a_comment_or_a_table(name: str) -> None:
    made = render(load("generic-registers").map, {"B1": -1, name: 1})
    assert made.st.isascii()
    machine = Machine(made.st)
    assert [n for n, section in machine.sections.items() if section == "var_output"][:2] == [
        "CallButton1",
        "CallButton2",
    ]
    tables = [line for line in made.wiring.splitlines() if line.startswith("|")]
    assert {line.count("|") for line in tables} == {7, 6, 4}


def test_the_same_map_and_floors_give_the_same_text() -> None:
    assert program(REGISTERS) == program(REGISTERS)
    assert isinstance(program(REGISTERS), PlcProgram)


def test_a_map_of_somebody_elses_program_is_refused() -> None:
    with pytest.raises(ProgramError, match="two-stop-agv describes what a lift company has programmed already"):
        render(load("two-stop-agv").map, {"4F": 0, "5F": 1})
    with pytest.raises(ProgramError, match="name starts with generic-, which leave it to the lift company"):
        render(changed(lambda given: given.update(name="acme-lc3")), FLOORS)


def drop(part: str, name: str) -> Callable[[dict[str, Any]], object]:
    return lambda given: given[part].pop(name)


def put(part: str, name: str, **keys: object) -> Callable[[dict[str, Any]], object]:
    def change(given: dict[str, Any]) -> None:
        given[part][name] = given[part].get(name, {}) | keys

    return change


@each_row(
    ("change", "reason"),
    [
        (drop("commands", "robot_mode"), "needs the command robot_mode"),
        (drop("commands", "go_to"), "needs the command go_to"),
        (
            put("commands", "close_door.rear", at="holding:19", action="pulse", width_s=1),
            "no output for close_door.rear",
        ),
        (put("signals", "door_zone", at="holding:5.6"), "no input for door_zone"),
        (put("commands", "go_to", action="hold", max_hold_s=60, on_link_loss="latches"), "go_to must be a pulse"),
        (put("commands", "robot_mode", on_link_loss="latches"), "lives by the refreshes of robot_mode"),
        (put("commands", "robot_mode", refresh_s=None), "lives by the refreshes of robot_mode"),
        (
            put("commands", "robot_mode", confirm={"any_of": ["readback"], "within_s": 2}),
            "`readback` cannot confirm it",
        ),
        (put("commands", "hold_door.front", max_hold_s=3), "max_hold_s above the 3 s of the watchdog"),
        (put("commands", "hold_door.front", cleared_after_s=None), "say `cleared_after_s: 27`, or less"),
        (put("commands", "hold_door.front", cleared_after_s=28), "say `cleared_after_s: 27`, or less"),
        (drop("signals", "fire"), "zeros must read as fire"),
        (put("signals", "fire", active="high"), "zeros must read as fire"),
        (put("signals", "motion", values={0: "stopped", 2: "up", 3: "down"}), "motion has no code for unknown"),
        (put("signals", "mode", values={0: "normal", 2: "robot"}), "mode has no code for unknown"),
    ],
)
def test_what_the_program_could_not_serve_is_refused_with_its_cure(
    change: Callable[[dict[str, Any]], object], reason: str
) -> None:
    with pytest.raises(ProgramError, match=re.escape(reason)):
        render(changed(change), FLOORS)


@each_row(
    ("map_name", "floors", "reason"),
    [
        ("generic-registers", {"L1": 1}, "at least two floors"),
        ("generic-registers", {"L1": 1, "L2": 1}, "code 1 stands for several floors"),
        ("generic-registers", {"L0": 0, "L1": 1}, "floor L0"),
        ("generic-registers", {"L1": 1, "L2": 40000}, "floor L2"),
        ("generic-coils", {"L1": 0, "L9": 8}, "floor L9"),
        ("generic-coils", {"B1": -1, "L1": 0}, "floor B1"),
    ],
)
def test_floors_that_the_map_cannot_say_are_refused(map_name: str, floors: dict[str, int], reason: str) -> None:
    with pytest.raises(ProgramError, match=reason):
        render(load(map_name).map, floors)
