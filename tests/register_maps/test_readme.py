"""The pages of register_maps: their map, their snippets, their tables and their command are executed."""

import copy
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

import register_maps
from drivers.modbus.reading import lift_mode
from register_maps.codec import Point, compile_map
from register_maps.load import MapChanges, json_schema, load
from register_maps.schema import COMMANDS, SIGNALS
from register_maps.words import Door, Mode, Motion, Table
from tests.support.rows import each_row

ROOT = Path(register_maps.__file__).parents[1]
GRAMMAR, INTERFACES, TUTORIAL = (
    (ROOT / "register_maps" / f"{name}.md").read_text() for name in ("GRAMMAR", "INTERFACES", "TUTORIAL")
)
BLOCKS = re.findall(r"^```yaml\n(.*?)^```$", INTERFACES, re.MULTILINE | re.DOTALL)

# What the snippets leave out. Its own points lie high, out of their way.
BASE = """\
schema: 1
name: snippet
title: A snippet of a page
provenance: {trust: template, sources: [INTERFACES.md]}
addressing: {base: 0}
served: {coil: [[0, 65535]], discrete: [[0, 65535]], holding: [[0, 65535]], input: [[0, 65535]]}
signals:
  car_floor: {at: "holding:60000", as: floor, unknown: [0]}
  motion: {at: "holding:60001", values: {1: stopped, 2: up, 3: down}}
  door.front: {at: "discrete:60000"}
  level: {at: "discrete:60001"}
  fire: {at: "discrete:60002", active: low}
  robot_mode_on: {at: "discrete:60003"}
at_floor_evidence: {kind: level}
at_same_floor: call
"""


def snippets() -> list[Any]:
    sections = re.split(r"^## ", INTERFACES, flags=re.MULTILINE)
    return [
        pytest.param(block, id=section.partition("\n")[0])
        for section in sections
        for block in re.findall(r"^```yaml\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
        if not block.startswith("# of a site file")
    ]


def completed(block: str) -> str:
    whole = copy.deepcopy(yaml.safe_load(BASE))
    said = yaml.safe_load(block)
    own = "notation" in said.get("addressing", {})
    for key, value in said.items():
        merges = isinstance(value, dict) and key in ("signals", "link") and not own
        whole[key] = {**whole.get(key, {}), **value} if merges else value
    if "positions" in said.get("signals", {}).get("car_position", {}):
        del whole["signals"]["car_floor"]  # the position shows the floor
    return yaml.safe_dump(whole)


def test_every_block_is_a_snippet_or_of_a_site_file() -> None:
    others = [block for block in BLOCKS if block.startswith("# of a site file")]
    assert len(BLOCKS) == len(snippets()) + len(others)
    assert len(snippets()) > 40


def test_all_features_of_the_survey_are_there() -> None:
    numbers = [int(number) for number in re.findall(r"^## (\d+)\. ", INTERFACES, re.MULTILINE)]
    assert numbers == list(range(1, 27))


@each_row("block", snippets())
def test_every_snippet_is_accepted(tmp_path: Path, block: str) -> None:
    path = tmp_path / "snippet.yaml"
    path.write_text(completed(block))
    assert compile_map(load(path).map).signals


def test_the_changes_of_a_site_can_be_laid_over_the_map_they_are_meant_for(tmp_path: Path) -> None:
    (block,) = (block for block in BLOCKS if block.startswith("# of a site file"))
    lift = yaml.safe_load(block)["lifts"]["goods"]
    (template,) = (param.values[0] for param in snippets() if param.id.startswith("Across all"))
    path = tmp_path / "template.yaml"
    path.write_text(completed(template) + 'commands: {close_door.front: {at: "coil:5", action: pulse, width_s: 1}}\n')
    loaded = load(path, changes=MapChanges(lift["parameters"], lift["override"]))
    assert loaded.map.signals["door.front"].addresses == ("discrete:100", "discrete:101")
    assert loaded.map.signals["overload"].at == "discrete:7"
    assert loaded.map.commands == {}


def test_the_map_of_the_tutorial_is_checked_and_reads_as_its_table_says(tmp_path: Path) -> None:
    (block,) = re.findall(r"^```yaml\n(# acme-lc3.yaml.*?)^```$", TUTORIAL, re.MULTILINE | re.DOTALL)
    (tmp_path / "acme-lc3.yaml").write_text(block)
    loaded = load("./acme-lc3.yaml", near=tmp_path)
    assert loaded.warnings == ()
    codec = compile_map(loaded.map)
    image: dict[str, list[int]] = {
        Table.DISCRETE: [1, 0, 1, 0],
        Table.INPUT: [2, 1],
        Table.COIL: [0, 0],
        Table.HOLDING: [0],
    }
    assert {name: signal.decode(signal.extract(image)) for name, signal in codec.signals.items()} == {
        "door.front": Door.OPEN,
        "fire": False,
        "robot_mode_on": False,
        "car_floor": 2,
        "motion": Motion.STOPPED,
    }
    assert codec.commands["go_to"].encode(3) == {Point(Table.HOLDING, 0, 0, 16): 3}


def test_every_name_of_the_vocabulary_is_in_its_tables() -> None:
    cells = {cell for row in re.findall(r"^\|.*\|$", GRAMMAR, re.MULTILINE) for cell in re.findall(r"`([^`]+)`", row)}
    words = {*Door, *Motion, *Mode} - {"unknown"}
    assert {*SIGNALS, *COMMANDS, *words} <= cells


def test_the_table_of_modes_is_what_the_driver_does() -> None:
    rows = re.findall(r"^\| (\d) \| `(\w+)` \| (.*) \|$", GRAMMAR, re.MULTILINE)
    order = [(mode, re.findall(r"`(\w+)`", flags)) for _, mode, flags in rows]
    assert [int(rank) for rank, _, _ in rows] == list(range(1, 9))
    for rank, (mode, flags) in enumerate(order):
        for flag in flags:
            assert lift_mode({flag: True}) == mode
            assert all(lift_mode({flag: True, "mode": Mode(lower)}) == mode for lower, _ in order[rank:])
            assert all(lift_mode({flag: True, "mode": Mode(higher)}) == higher for higher, _ in order[:rank])
    assert lift_mode({}) == order[-1][0]


def test_the_command_that_writes_the_json_schema_works_as_printed() -> None:
    (line,) = re.findall(r"^    (python -c .*)$", GRAMMAR, re.MULTILINE)
    words = shlex.split(line)
    assert words[3:] == [">", "register_maps/register_map.schema.json"]
    command = [sys.executable, *words[1:3]]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240, check=True)
    assert result.stdout == json_schema()
