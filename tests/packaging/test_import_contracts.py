"""The direction of imports: held by the code as it is, and caught where it is broken."""

import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

ALLOWED = {
    "lift_manager/__main__.py": "import lift_manager.cli.main",
    "lift_manager/cli/main.py": "import lift_manager.cli.maps, lift_manager.lab.demo, lift_manager.app, drivers.errors",
    "lift_manager/cli/maps.py": "import lift_manager.commissioning.doctor",
    "lift_manager/lab/demo.py": "import simulator.server, lift_manager.app, drivers.modbus.wire",
    "lift_manager/lab/pytest_plugin.py": "import lift_manager.__main__, lift_manager.app",
    "lift_manager/app.py": "import drivers.modbus.link, lift_manager.web.server, lift_manager.rmf.dds, lift_manager.store",
    "lift_manager/commissioning/doctor.py": "import drivers.modbus.lift, lift_manager.runtime.site, lift_manager.config",
    "lift_manager/web/server.py": "import lift_manager.runtime.site, lift_manager.api, lift_manager.rides, lift_manager.lift",
    "lift_manager/rmf/dds.py": "import lift_manager.runtime.site",
    "lift_manager/rmf/dds_link.py": "import cyclonedds",
    "lift_manager/metrics/__init__.py": "import lift_manager.runtime.site",
    "lift_manager/store/__init__.py": "import lift_manager.runtime.site",
    "lift_manager/runtime/site.py": "import drivers.driver, lift_manager.rides, lift_manager.config, lift_manager.lift",
    "lift_manager/client/__init__.py": "import lift_manager.api, lift_manager.plain",
    "lift_manager/plain/__init__.py": "",
    "lift_manager/api/__init__.py": "import lift_manager.rides, lift_manager.lift",
    "lift_manager/rides/__init__.py": "import drivers.model, lift_manager.lift",
    "lift_manager/config/__init__.py": "import register_maps.load, lift_manager.lift",
    "lift_manager/lift/__init__.py": "import drivers.model, register_maps.load, lift_manager.plain",
    "drivers/driver.py": "import register_maps.load",
    "drivers/errors.py": "",
    "drivers/model.py": "import register_maps.load",
    "drivers/modbus/link.py": "import drivers.modbus.wire, drivers.driver",
    "drivers/modbus/lift.py": "import drivers.modbus.link",
    "drivers/modbus/wire.py": "import pymodbus",
    "simulator/server.py": "import pymodbus, simulator.shaft, register_maps.load",
    "simulator/shaft.py": "",
    "register_maps/load.py": "",
}

FORBIDDEN = {
    "lift_manager/metrics/__init__.py": "cyclonedds",
    "lift_manager/plain/__init__.py": "lift_manager.lift",
    "lift_manager/cli/main.py": "simulator.server",
    "lift_manager/cli/maps.py": "drivers.modbus.lift",
    "lift_manager/app.py": "simulator.shaft",
    "lift_manager/commissioning/doctor.py": "lift_manager.lab.demo",
    "lift_manager/web/server.py": "drivers.driver",
    "lift_manager/rmf/dds.py": "lift_manager.web.server",
    "lift_manager/runtime/site.py": "drivers.modbus.link",
    "lift_manager/client/__init__.py": "lift_manager.runtime.site",
    "lift_manager/config/__init__.py": "lift_manager.api",
    "lift_manager/rides/__init__.py": "lift_manager.runtime.site",
    "lift_manager/lift/__init__.py": "lift_manager.config",
    "drivers/driver.py": "lift_manager.lift",
    "drivers/modbus/link.py": "pymodbus",
    "drivers/modbus/lift.py": "simulator.shaft",
    "simulator/server.py": "lift_manager.lift",
    "simulator/shaft.py": "drivers.driver",
    "register_maps/load.py": "pymodbus",
}


def lint(tree: Path) -> subprocess.CompletedProcess[str]:
    command = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    return subprocess.run(
        [sys.executable, "-c", command, "--no-cache"], cwd=tree, capture_output=True, text=True, check=False
    )


def write_tree(tree: Path, sources: Mapping[str, str]) -> None:
    shutil.copy(ROOT / "pyproject.toml", tree)
    for name, source in sources.items():
        path = tree / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source + "\n")
        for folder in path.relative_to(tree).parents[:-1]:
            (tree / folder / "__init__.py").touch()


def test_the_code_keeps_every_contract() -> None:
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout


def test_the_contracts_allow_the_whole_intended_design(tmp_path: Path) -> None:
    write_tree(tmp_path, ALLOWED)
    done = lint(tmp_path)
    assert done.returncode == 0, done.stdout


def test_the_contracts_allow_a_tree_in_which_most_modules_do_not_exist_yet(tmp_path: Path) -> None:
    present = (
        "lift_manager/lift/__init__.py",
        "drivers/modbus/wire.py",
        "simulator/shaft.py",
        "register_maps/load.py",
    )
    write_tree(tmp_path, {**{name: ALLOWED[name] for name in present}, "drivers/model.py": ""})
    done = lint(tmp_path)
    assert done.returncode == 0, done.stdout


def test_every_import_against_the_direction_is_reported(tmp_path: Path) -> None:
    write_tree(tmp_path, {name: f"{ALLOWED[name]}\nimport {FORBIDDEN.get(name, 'sys')}" for name in ALLOWED})
    done = lint(tmp_path)
    reported = set(re.findall(r"([\w.]+) -> ([\w.]+) \(l\.", done.stdout))
    expected = {(module_name(name), imported) for name, imported in FORBIDDEN.items()}
    assert done.returncode == 1
    assert expected - reported == set()


def test_a_new_module_of_the_manager_must_be_given_its_layer_first(tmp_path: Path) -> None:
    write_tree(tmp_path, {**ALLOWED, "lift_manager/helpers.py": ""})
    done = lint(tmp_path)
    assert done.returncode == 1
    assert "helpers" in done.stdout


def module_name(path: str) -> str:
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
