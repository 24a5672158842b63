"""The items of a checkout: their numbers, and what they depend on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from lift_manager.commissioning.checkout.plan import lift_digest, make_plan
from lift_manager.commissioning.checkout.record import Item, Stage
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.lab.plant import default_floors
from register_maps.load import MAPS, MapChanges, load, shipped
from tests.support.checkout_rig import LIFT, site_of
from tests.support.trip_sites import COMPLETIONS, Completion


def changed_site(folder: Path, section: str, name: str, **change: Any) -> LoadedSite:
    data = yaml.safe_load((MAPS / "generic-coils.yaml").read_text("utf-8"))
    data[section][name] = {**data[section].get(name, {}), **change}
    folder.mkdir()
    (folder / "changed.yaml").write_text(yaml.safe_dump(data))
    return site_of(folder, "./changed.yaml")


def digests(loaded: LoadedSite) -> dict[str, str]:
    return {item.id: item.digest for item in make_plan(loaded, LIFT, Stage.SAT)}


def differing(one: dict[str, str], other: dict[str, str]) -> set[str]:
    return {number for number in one.keys() | other.keys() if one.get(number) != other.get(number)}


def test_the_factory_test_has_the_numbers_of_the_site_test_and_the_proof_test_a_part_of_them(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)
    fat, sat, proof = (make_plan(loaded, LIFT, stage) for stage in Stage)
    assert fat == sat
    assert [item.id for item in proof] == ["A-04", "A-05", "T-01"]


def test_numbers_stay_when_a_map_gets_another_signal(tmp_path: Path) -> None:
    before = {item.id: item.subject for item in make_plan(site_of(tmp_path), LIFT, Stage.SAT)}
    more = changed_site(tmp_path / "more", "signals", "robots_allowed", note="a new note")
    assert {item.id: item.subject for item in make_plan(more, LIFT, Stage.SAT)} == before
    assert before["S-29"] == "overload"


@pytest.mark.parametrize(
    ("section", "name", "change", "affected"),
    [
        ("signals", "overload", {"note": "another word"}, {"T-01"}),
        ("signals", "overload", {"active": "low"}, {"S-29", "T-01"}),
        ("signals", "fire", {"active": "high"}, {"S-23", "A-05", "T-01"}),
        (
            "signals",
            "robot_mode_on",
            {"active": "low"},
            {"S-19", "C-01", "C-06", "F-01", "F-02", "F-03", "A-01", "A-06", "T-01"},
        ),
    ],
)
def test_a_change_of_the_map_affects_the_items_that_depend_on_it(
    tmp_path: Path, section: str, name: str, change: dict[str, Any], affected: set[str]
) -> None:
    before = digests(changed_site(tmp_path / "before", section, name))
    after = digests(changed_site(tmp_path / "after", section, name, **change))
    assert affected <= differing(before, after)
    assert {number for number in differing(before, after) if number[0] in "SC"} <= affected


def test_another_code_of_a_floor_affects_what_carries_floors(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    before, after = site_of(tmp_path / "a"), site_of(tmp_path / "b", floors={"L1": 0, "L2": 1, "L3": 3})
    affected = differing(digests(before), digests(after))
    assert {"S-01", "S-03", "C-01", "F-03", "T-01"} <= affected
    assert not {"S-23", "C-10", "R-01"} & affected
    assert lift_digest(before, LIFT) != lift_digest(after, LIFT)


def test_an_item_has_the_printed_address_and_the_one_on_the_wire(tmp_path: Path) -> None:
    items: dict[str, Item] = {item.id: item for item in make_plan(site_of(tmp_path), LIFT, Stage.SAT)}
    assert [(point.printed, point.wire) for point in items["S-13"].points] == [
        ("discrete:16", "discrete 16"),
        ("discrete:17", "discrete 17"),
    ]
    assert [point.printed for point in items["F-02"].points] == ["coil:1"]


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_map_has_an_item_for_each_signal_and_command(tmp_path: Path, name: str) -> None:
    added = COMPLETIONS.get(name, Completion())
    source = load(name, changes=MapChanges(added.parameters, added.override)).map
    controllers: dict[str, Any] = {"plc": {"host": "192.0.2.5", "map": name}}
    controllers |= {endpoint: {"host": "192.0.2.6", "port": 503 + i} for i, endpoint in enumerate(source.endpoints)}
    lift = {
        "controller": "plc",
        "floors": default_floors(source),
        "parameters": dict(added.parameters),
        "override": dict(added.override),
        "endpoints": {endpoint: {"controller": endpoint} for endpoint in source.endpoints},
    }
    path = tmp_path / "site.yaml"
    path.write_text(yaml.safe_dump({"schema": 1, "name": "x", "controllers": controllers, "lifts": {LIFT: lift}}))
    items = make_plan(load_site(path), LIFT, Stage.SAT)
    assert len({item.id for item in items}) == len(items)
    for kind, names in (("signal", source.signals.keys() - source.derived), ("command", source.commands.keys())):
        assert {item.subject for item in items if item.kind == kind} == names


@pytest.mark.parametrize(
    ("number", "action", "expected"),
    [
        ("S-01", "Send the car to two floors", "It follows. "),
        ("S-02", "Send the car to another floor", "It follows. "),
        ("S-03", "The manager takes the empty car to another floor", "It follows. "),
        ("S-06", "Put the lift into another service with its key", "It follows, and nothing else changes."),
        ("S-07", "Read it for some seconds", "It changes by itself."),
        (
            "S-17",
            "Send the car to another floor with its own buttons. Then the lift technician disconnects",
            "It follows. ",
        ),
        ("S-19", "The manager takes the empty car to another floor", "It follows. "),
        ("S-23", "Make it true, then false again", "It follows, and nothing else changes."),
    ],
)
def test_an_item_announces_what_its_procedure_asks_for(tmp_path: Path, number: str, action: str, expected: str) -> None:
    loaded = site_of(tmp_path, "generic-registers", {"L1": 1, "L2": 2, "L3": 3})
    items = {item.id: item for item in make_plan(loaded, LIFT, Stage.SAT)}
    assert items[number].action.startswith(action)
    assert items[number].expected.startswith(expected)
