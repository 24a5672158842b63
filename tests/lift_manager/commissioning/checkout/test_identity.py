"""What a record is bound to."""

from pathlib import Path

import pytest

from lift_manager.commissioning.checkout.identity import identify_map
from lift_manager.commissioning.checkout.record import MapIdentity
from tests.lift_manager.config.site_files import GENERIC, edited, load
from tests.support.rows import each_row


def identity(folder: Path, *edits: tuple[str, str]) -> MapIdentity:
    return identify_map(load(folder, edited(GENERIC, *edits)), "main")


@pytest.fixture
def tested(tmp_path: Path) -> MapIdentity:
    return identity(tmp_path)


def test_a_record_names_the_map_of_its_lift(tested: MapIdentity) -> None:
    assert (tested.name, tested.title) == (
        "generic-registers",
        "Generic lift controller, everything in holding registers",
    )
    assert tested.sha256 != tested.lift_sha256


@each_row(
    "edit",
    [
        ("L2: 2}", "L2: 3}"),
        ("L2: 2}", "L3: 2}"),
        ("{B1: -1, L1: 1, L2: 2}", "{B1: -1, L1: 1, L2: {code: 2, doors: [front]}}"),
        ("access: control", "access: control\n    offset: {holding: 100}"),
        ("access: control", "access: control\n    unit_id: 7"),
        ("port: 502,", "port: 502, unit_id: 7,"),
    ],
)
def test_floors_offset_and_unit_are_part_of_what_was_tested(
    tested: MapIdentity, tmp_path: Path, edit: tuple[str, str]
) -> None:
    now = identity(tmp_path, edit)
    assert (now.sha256, now.lift_sha256 != tested.lift_sha256) == (tested.sha256, True)


def test_a_change_of_the_map_is_one_of_the_map(tested: MapIdentity, tmp_path: Path) -> None:
    changed = "access: control\n    override: {signals: {overload: {active: low}}}"
    now = identity(tmp_path, ("access: control", changed))
    assert (now.sha256 != tested.sha256, now.lift_sha256) == (True, tested.lift_sha256)


@each_row(
    "edit",
    [
        ("access: control", "access: monitor"),
        ("access: control", "access: control\n    lease_s: 200"),
        ("access: control", "access: control\n    display_name: Lift 1"),
        ("host: 10.0.0.5", "host: 10.0.0.6"),
    ],
)
def test_what_robots_may_do_and_where_the_controller_is_are_not(
    tested: MapIdentity, tmp_path: Path, edit: tuple[str, str]
) -> None:
    assert identity(tmp_path, edit) == tested
