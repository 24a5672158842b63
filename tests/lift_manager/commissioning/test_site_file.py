"""The site file of a first lift: YAML reads what a person said, and the manager accepts it."""

from dataclasses import replace
from pathlib import Path

import yaml

from lift_manager.commissioning.site_file import FirstLift, site_file
from lift_manager.config.load import load_site
from tests.support.rows import each_row

FIRST = FirstLift("My site", "192.0.2.10", 502, "generic-registers", "Generic", "main", {"G": 1, "L1": 2})


def written(first: FirstLift) -> str:
    return site_file(first, day="2026-11-23")


@each_row(
    "name",
    ["on", "NO", "null", "1", "1.5", "0x10", "a: b", "# x", "Ostflügel", '"', "- x", "a  b", "%a", "1e3", "y", "B1"],
)
def test_every_name_is_read_as_it_was_given(name: str) -> None:
    data = yaml.safe_load(written(replace(FIRST, site=name, host="plc", lift=name, floors={name: -1, "L1": 2})))
    assert data["name"] == name
    assert list(data["lifts"]) == [name]
    assert data["lifts"][name]["floors"] == {name: -1, "L1": 2}


@each_row("host", ["192.0.2.10", "plc.example", "2001:db8::1", "plc-1"])
def test_an_address_is_read_as_it_was_given(host: str) -> None:
    assert yaml.safe_load(written(replace(FIRST, host=host)))["controllers"]["plc"]["host"] == host


def test_port_unit_and_parameters_are_written_where_they_differ_from_the_usual() -> None:
    controller = yaml.safe_load(written(FIRST))["controllers"]["plc"]
    assert controller == {"host": "192.0.2.10", "map": "generic-registers"}
    data = yaml.safe_load(written(replace(FIRST, port=5020, unit=3, parameters={"first": 7, "word": "on"})))
    assert (data["controllers"]["plc"]["port"], data["controllers"]["plc"]["unit_id"]) == (5020, 3)
    assert data["lifts"]["main"]["parameters"] == {"first": 7, "word": "on"}


def test_the_manager_accepts_the_file_and_only_watches(tmp_path: Path) -> None:
    file = tmp_path / "site.yaml"
    file.write_text(written(FIRST))
    assert load_site(file).site.lifts["main"].access == "monitor"
