"""The example building: its commands, and a ride through both doors of its goods lift."""

import re
import shutil
from functools import partial
from pathlib import Path

import pytest
import yaml

from lift_manager.config.load import load_site
from lift_manager.lab.bench import LiftSite
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import LiftState
from register_maps.words import Door, Side
from tests.support.pages import commands
from tests.support.programs import ROOT, call

BUILDING = ROOT / "examples" / "building"
SITE = yaml.safe_load((BUILDING / "site.yaml").read_text("utf-8"))
FLOORS = SITE["lifts"]["goods"]["floors"]


def test_the_commands_of_its_page_check_it_and_make_its_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(BUILDING, tmp_path / "examples" / "building")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    check, *make = (line.removeprefix("lift-manager ").split() for line in commands(BUILDING / "README.md"))
    checked = call(*check)
    assert checked.stdout.splitlines()[-1] == "examples/building/site.yaml: no mistakes"
    assert [words[:2] for words in make] == [["keys", "make"]] * 3
    keys = [call(*words) for words in make]
    assert [re.findall(r"lm_\w+", key.stdout) != [] for key in keys] == [True] * 3, keys


def test_the_second_lift_is_read_where_the_first_one_is_100_registers_further() -> None:
    loaded = load_site(BUILDING / "site.yaml")
    goods, passengers = (loaded.codecs[name].commands["go_to"].points[0] for name in ("goods", "passengers"))
    assert (goods.address, passengers.address) == (16, 116)


def is_open_at(floor: str, state: LiftState) -> bool:
    return state.floor == floor and state.robot_door is RobotDoor.OPEN


@pytest.mark.lift("goods", map="../examples/building/duplex.yaml", floors=FLOORS)
def test_a_robot_of_the_kitchen_enters_by_the_rear_door_and_leaves_by_the_front_door(lift_site: LiftSite) -> None:
    lift = lift_site.simulator("goods")
    for floor, door in (("Basement", Side.REAR), ("First", Side.FRONT)):
        lift_site.request(floor)
        lift_site.wait_for(partial(is_open_at, floor))
        assert {side for side, state in lift.truth.doors if state is not Door.CLOSED} == {door}, floor
