"""The site files that are shown to people: the examples, and the one in the reference."""

import re
from pathlib import Path

import pytest

from lift_manager.config.devices import Device, devices
from lift_manager.config.load import check_file, load_site
from lift_manager.config.site import (
    Api,
    ApiTls,
    Cluster,
    ClusterTls,
    Controller,
    ControllerTls,
    Endpoint,
    Fence,
    Floor,
    Lift,
    LiftRmf,
    Machine,
    Rmf,
    Site,
)
from tests.lift_manager.config.site_files import ROOT

PAGE = (ROOT / "docs" / "reference" / "site-file.md").read_text("utf-8")


EXAMPLES = ROOT / "examples"


@pytest.mark.parametrize(
    "path",
    sorted([*EXAMPLES.glob("*.yaml"), EXAMPLES / "rmf" / "site.yaml"]),
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_every_example_loads_and_is_called_free_of_mistakes(path: Path) -> None:
    load_site(path)
    assert check_file(path)[-1] == f"{path}: no mistakes"


def test_the_example_with_two_endpoints_presses_on_one_device_and_looks_at_the_other() -> None:
    loaded = load_site(ROOT / "examples" / "two-endpoints.yaml")
    source = loaded.maps["vip"].map
    assert devices(loaded.site, loaded.site.lifts["vip"], source) == {
        "": Device("buttons", 1),
        "sensor": Device("machine-room", 1),
    }
    read = {source.place(text).endpoint for signal in source.signals.values() for text in signal.addresses}
    written = {source.place(text).endpoint for command in source.commands.values() for text in command.addresses}
    assert (read, written) == ({"sensor"}, {""})


def test_the_example_of_the_reference_is_free_of_mistakes(tmp_path: Path) -> None:
    (example,) = re.findall(r"^```yaml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    path = tmp_path / "site.yaml"
    path.write_text(example, "utf-8")
    assert check_file(path)[-1] == f"{path}: no mistakes"
    lift = load_site(path).site.lifts["east"]
    assert lift.parameters
    assert lift.override
    assert lift.endpoints


def test_the_reference_has_every_key_of_a_site_file_and_no_other() -> None:
    models = (
        Api,
        ApiTls,
        Cluster,
        ClusterTls,
        Controller,
        ControllerTls,
        Endpoint,
        Fence,
        Floor,
        Lift,
        LiftRmf,
        Machine,
        Rmf,
        Site,
    )
    keys = {field.alias or name for model in models for name, field in model.model_fields.items()}
    rows = [line.split("|") for line in PAGE.splitlines() if line.startswith("| `")]
    listed = {key for row in rows for key in re.findall(r"`([a-z_]+)`", row[1])}
    explained = {key for row in rows for key in re.findall(r"`([a-z_]+)`", row[2])}
    assert keys <= listed | explained
    assert listed <= keys
