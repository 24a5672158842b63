"""The ROS package: what is built, that it runs on nothing but the standard library and ROS, its manifest and its launch file."""

from __future__ import annotations

import ast
import fnmatch
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import zipfile
from configparser import ConfigParser
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.support.fake_rclpy_loader import FOLDER

HOME = Path(__file__).resolve().parents[3]
ROS = HOME / "deploy" / "ros"
NAME = "modbus_lift_adapter"
VENDORED = f"{NAME}/vendored/"
PROJECT = tomllib.loads((HOME / "pyproject.toml").read_text())

# REP 149 (package manifest format three): these once, and these as often as wanted.
ONCE = {"name", "version", "description"}
OFTEN = {
    *("maintainer", "license", "url", "author", "export"),
    *("build_depend", "build_export_depend", "buildtool_depend", "buildtool_export_depend"),
    *("exec_depend", "depend", "doc_depend", "test_depend", "conflict", "replace"),
    *("group_depend", "member_of_group"),
}
# What the XML front end of launch knows on humble (launch 1.0, launch_ros 0.19), as far as it is used here.
TAGS = {
    "launch": set(),
    "arg": {"name", "default", "description"},
    "executable": {"cmd", "output", "if"},
    "env": {"name", "value"},
    "node": {"pkg", "exec", "name", "output", "respawn", "respawn_delay"},
    "param": {"name", "value"},
}
VARIABLE = re.compile(r"\$\(var ([a-z_]+)\)")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """Built in a copy, so that nothing is left in the repository."""
    tree = tmp_path_factory.mktemp("repository")
    leave_out = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    shutil.copytree(HOME / "lift_manager", tree / "lift_manager", ignore=leave_out)
    shutil.copytree(ROS, tree / "deploy" / "ros", ignore=leave_out)
    command = [sys.executable, "setup.py", "-q", "bdist_wheel", "-d", str(tree)]
    subprocess.run(command, cwd=tree / "deploy" / "ros", check=True, capture_output=True)
    (built,) = tree.glob("*.whl")
    return zipfile.ZipFile(built)


@pytest.fixture(scope="module")
def unpacked(wheel: zipfile.ZipFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of packages that holds this one alone."""
    folder = tmp_path_factory.mktemp("site")
    wheel.extractall(folder)
    return folder


def test_nothing_is_installed_under_another_name_than_the_packages_own(wheel: zipfile.ZipFile) -> None:
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert tops == {NAME, f"{NAME}-0.1.0.dist-info", f"{NAME}-0.1.0.data"}
    own = {name for name in wheel.namelist() if name.startswith(f"{NAME}/") and not name.startswith(VENDORED)}
    assert own == {f"{NAME}/__init__.py", f"{NAME}/start.py"}


def test_ros_finds_the_package_its_launch_file_and_its_program(wheel: zipfile.ZipFile) -> None:
    share = f"{NAME}-0.1.0.data/data/share/"
    shared = {name.removeprefix(share) for name in wheel.namelist() if name.startswith(share)}
    assert shared == {
        f"ament_index/resource_index/packages/{NAME}",
        f"{NAME}/package.xml",
        f"{NAME}/launch/lift_adapter.launch.xml",
    }
    entries = ConfigParser()
    entries.read_string(wheel.read(f"{NAME}-0.1.0.dist-info/entry_points.txt").decode())
    assert dict(entries["console_scripts"]) == {"lift_adapter": f"{NAME}.start:main"}
    places = ConfigParser(interpolation=None)
    places.read(ROS / "setup.cfg")
    # `ros2 run` looks for programs there
    assert places["install"]["install_scripts"] == places["develop"]["script_dir"] == f"$base/lib/{NAME}"


def test_what_is_installed_is_what_the_node_imports_with_nothing_else_there(unpacked: Path) -> None:
    code = (
        "import sys; from modbus_lift_adapter import start; sys.stderr.write(str(start.main()));"
        "print(*(m.__file__ for n, m in sys.modules.items() if n.split('.')[0] == 'lift_manager'), sep='\\n')"
    )
    # without `site`: the packages of this environment are out of reach; and a port that does not exist ends it at once
    command = [sys.executable, "-S", "-B", "-c", code, "--ros-args", "-p", "manager_port:=70000"]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(unpacked), str(FOLDER)]),
        "FAKE_ROS_DISTRO": "humble",
    }
    done = subprocess.run(command, cwd=unpacked, env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == "2"
    assert {Path(line) for line in done.stdout.splitlines()} == set((unpacked / VENDORED).rglob("*.py"))


def test_the_installed_modules_win_over_a_lift_manager_on_the_path(unpacked: Path, tmp_path: Path) -> None:
    (tmp_path / "lift_manager").mkdir()
    (tmp_path / "lift_manager" / "__init__.py").write_text("raise ImportError('the wrong one')\n")
    code = "from modbus_lift_adapter import start; raise SystemExit(start.main())"
    command = [sys.executable, "-S", "-B", "-c", code, "--ros-args", "-p", "manager_port:=70000"]
    path = os.pathsep.join([str(tmp_path), str(unpacked), str(FOLDER)])
    done = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": path}, capture_output=True, check=False
    )
    assert done.returncode == 2, done.stderr


def test_what_is_installed_is_written_for_python_3_10(wheel: zipfile.ZipFile) -> None:
    files = [name for name in wheel.namelist() if name.startswith(VENDORED)]
    assert len(files) > 10
    patterns = _py310_patterns()
    for name in files:
        ast.parse(wheel.read(name), name, feature_version=(3, 10))
        path = name.removeprefix(VENDORED)
        assert any(fnmatch.fnmatchcase(path, one) for one in patterns), f"pyproject.toml does not lint {path} for 3.10"


def _py310_patterns() -> list[str]:
    said: dict[str, str] = PROJECT["tool"]["ruff"]["per-file-target-version"]
    patterns = []
    for pattern in (one for one, target in said.items() if target == "py310"):
        before, brace, rest = pattern.partition("{")
        words, _, after = rest.partition("}")
        patterns += [f"{before}{word}{after}" for word in words.split(",")] if brace else [pattern]
    return patterns


def test_the_folder_alone_says_that_it_needs_the_repository(tmp_path: Path) -> None:
    shutil.copytree(ROS, tmp_path / "ws" / "src" / "ros")
    command = [sys.executable, "setup.py", "--name"]
    done = subprocess.run(command, cwd=tmp_path / "ws" / "src" / "ros", capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "whole repository" in done.stderr


def test_the_manifest_follows_the_rules_of_format_three() -> None:
    root = ET.parse(ROS / "package.xml").getroot()
    assert (root.tag, root.attrib) == ("package", {"format": "3"})
    tags = [child.tag for child in root]
    assert set(tags) <= ONCE | OFTEN
    assert all(tags.count(tag) == 1 for tag in ONCE)
    assert {"maintainer", "license"} <= set(tags)
    assert all((child.text or "").strip() for child in root if child.tag != "export")
    assert re.fullmatch("[a-z][a-z0-9_-]*", root.findtext("name", ""))
    assert re.fullmatch(r"(0|[1-9]\d*)(\.(0|[1-9]\d*)){2}", root.findtext("version", ""))
    emails = [child.get("email", "") for child in root.iter("maintainer")]
    assert all(re.fullmatch(r"[\w.+-]+@[\w-]+(\.[\w-]+)+", email) for email in emails)
    # REP 149: <export> says how to build it, and each package that is depended on is there once
    assert [child.text for child in root.findall("export/build_type")] == ["ament_python"]
    needs = [child.text for child in root if child.tag.endswith("depend")]
    assert len(needs) == len(set(needs))
    assert NAME not in needs


def test_the_manifest_says_what_the_project_says() -> None:
    root = ET.parse(ROS / "package.xml").getroot()
    assert root.findtext("name") == NAME
    assert root.findtext("version") == PROJECT["project"]["version"]
    assert root.findtext("license") == PROJECT["project"]["license"]


def test_every_ros_package_that_is_imported_is_depended_on() -> None:
    trees = [ast.parse(path.read_text()) for path in (HOME / "lift_manager" / "rmf").glob("ros_*.py")]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    names += [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    foreign = {name.split(".")[0] for name in names if name} - sys.stdlib_module_names - {"lift_manager"}
    root = ET.parse(ROS / "package.xml").getroot()
    needs = {child.text for child in root if child.tag in ("depend", "exec_depend")}
    assert foreign == {"rclpy", "rmf_lift_msgs", "rmf_fleet_msgs", "std_msgs"}
    assert foreign <= needs


def test_the_launch_file_uses_only_what_humble_knows() -> None:
    for element in _launch().iter():
        assert element.tag in TAGS
        assert set(element.attrib) <= TAGS[element.tag]
        for value in element.attrib.values():
            assert set(re.findall(r"\$\(([a-z-]+)", value)) <= {"var", "eval"}


def test_the_launch_file_takes_the_arguments_of_the_workshop_and_two_more() -> None:
    arguments = {element.get("name"): element.get("default") for element in _launch().findall("arg")}
    assert arguments == {
        "use_sim_time": "true",
        "manager_address": "localhost",
        "manager_port": "5003",
        "output": "screen",
        "site": "",
        "manager": "lift-manager",
    }
    used = {
        name for element in _launch().iter() for value in element.attrib.values() for name in VARIABLE.findall(value)
    }
    assert used == set(arguments)


def test_the_launch_file_starts_the_node_with_its_parameters_and_again_after_a_fault() -> None:
    (node,) = _launch().findall("node")
    assert (node.get("pkg"), node.get("exec"), node.get("name")) == (NAME, "lift_adapter", "lift_adapter")
    assert (node.get("respawn"), node.get("output")) == ("true", "$(var output)")
    parameters = {element.get("name"): element.get("value") for element in node.findall("param")}
    assert parameters == {name: f"$(var {name})" for name in ("use_sim_time", "manager_address", "manager_port")}


@pytest.mark.parametrize(("site", "starts"), [("", False), ("/etc/lift-manager/site.yaml", True)])
def test_the_launch_file_starts_the_manager_where_a_site_is_given(site: str, starts: bool) -> None:
    (program,) = _launch().findall("executable")
    expression = re.fullmatch(r'\$\(eval "(.*)"\)', program.get("if", ""))
    assert expression is not None
    # `eval` of launch is Python's, on the text after the substitutions within
    assert ast.unparse(ast.parse(expression[1].replace("$(var site)", site))) == f"'{site}' != ''"
    assert (site != "") is starts
    assert shlex.split(VARIABLE.sub(r"<\1>", program.get("cmd", ""))) == [
        "<manager>",
        "serve",
        "<site>",
        "--port",
        "<manager_port>",
    ]
    # the manager's Python must not read the packages of ROS
    assert [element.attrib for element in program.findall("env")] == [{"name": "PYTHONPATH", "value": ""}]


def _launch() -> ET.Element:
    return ET.parse(ROS / "launch" / "lift_adapter.launch.xml").getroot()
