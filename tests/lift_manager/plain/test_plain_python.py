"""What a ROS installation loads runs on Python 3.10 with the standard library, rclpy and the message packages alone.

Debian 12 has no Python 3.10 to try it with, so it is read: its grammar, what it imports, and the names that came with 3.11; ruff checks
the same files for 3.10. That nothing of the index is needed is tried with the Python that there is.
"""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.rows import each_row

ROOT = Path(__file__).resolve().parents[3]
ROS_NODE = "lift_manager.rmf.ros_node"


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def held_to_310() -> Iterator[Path]:
    """Yield the files that ruff holds to Python 3.10."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    for pattern, version in settings["tool"]["ruff"]["per-file-target-version"].items():
        assert version == "py310"
        before, names, after = re.fullmatch(r"([^{}]*)(?:\{(.*)\})?([^{}]*)", pattern).groups()  # type: ignore[union-attr]
        for name in (names or "").split(","):
            yield from sorted(ROOT.glob(f"{before}{name}{after}"))


PATHS = tuple(held_to_310())
FILES = {module_of(path): path for path in PATHS if path.is_relative_to(ROOT / "lift_manager")}
"""What a ROS installation loads, by module. The rest are its own files, such as launch and setup files."""
MESSAGES = {"rmf_lift_msgs", "rmf_fleet_msgs", "std_msgs", "builtin_interfaces", "rosgraph_msgs"}
OF_ROS = {
    ROS_NODE: MESSAGES | {"rclpy"},
    "lift_manager.rmf.ros_alarms": MESSAGES,
    "lift_manager.rmf.ros_messages": MESSAGES,
}
"""What comes with ROS, by who imports it; nobody else does."""
SINCE_311 = {
    "asyncio": {"TaskGroup", "timeout", "timeout_at", "Runner", "Barrier"},
    "contextlib": {"chdir"},
    "datetime": {"UTC"},
    "enum": {"StrEnum", "ReprEnum", "EnumCheck", "FlagBoundary", "verify", "member", "nonmember", "property", "global_enum"},
    "hashlib": {"file_digest"},
    "http": {"HTTPMethod"},
    "logging": {"getLevelNamesMapping"},
    "math": {"cbrt", "exp2"},
    "operator": {"call"},
    "typing": {
        "Self", "LiteralString", "Never", "NotRequired", "Required", "TypeVarTuple", "Unpack", "assert_never", "assert_type",
        "reveal_type", "dataclass_transform", "get_overloads", "clear_overloads",
    },
}  # fmt: skip
"""Names of the standard library by module, from "What's New In Python 3.11"."""
MODULES_SINCE_311 = {"tomllib", "wsgiref.types"}
BUILTINS_SINCE_311 = {"ExceptionGroup", "BaseExceptionGroup", "EncodingWarning311"}


def imported(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Yield module and name of each import; the name is empty for a module as a whole."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)


def too_new(tree: ast.AST) -> set[str]:
    """Return what of the standard library came with 3.11: names imported or taken of a module, modules, built-in names."""
    found = {f"{module}.{name}" for module, name in imported(tree) if name in SINCE_311.get(module, ())}
    found |= {module for module, _ in imported(tree) if module in MODULES_SINCE_311}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.attr in SINCE_311.get(node.value.id, ()):
                found.add(f"{node.value.id}.{node.attr}")
            elif node.attr == "add_note":
                found.add("add_note")
        elif isinstance(node, ast.Name) and node.id in BUILTINS_SINCE_311:
            found.add(node.id)
    return found


def foreign(module: str, tree: ast.AST) -> set[str]:
    """Return what a module imports that a ROS installation does not have."""
    found = set()
    for name, part in imported(tree):
        first = name.partition(".")[0]
        own = name in FILES or f"{name}.{part}" in FILES
        if not own and first not in sys.stdlib_module_names and first not in OF_ROS.get(module, ()):
            found.add(f"{name}.{part}".rstrip("."))
    return found


def read_as_310(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"), str(path), feature_version=(3, 10))


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    return {module: read_as_310(path) for module, path in FILES.items()}


def test_the_adapter_is_among_the_files_that_ruff_holds_to_310() -> None:
    assert {ROS_NODE, "lift_manager.rmf.adapter", "lift_manager.rmf.remote_manager", "lift_manager.plain.http"} <= set(
        FILES
    )


@each_row("path", PATHS)
def test_each_of_them_is_python_310_by_its_grammar_and_names(path: Path) -> None:
    assert too_new(read_as_310(path)) == set()


def test_they_import_the_standard_library_each_other_and_ros_in_its_places(trees: dict[str, ast.Module]) -> None:
    assert {module: names for module, tree in trees.items() if (names := foreign(module, tree))} == {}


@each_row(
    ("text", "found"),
    [
        ("from typing import Self", {"typing.Self"}),
        ("from datetime import UTC, datetime", {"datetime.UTC"}),
        ("import asyncio\nasync def f():\n    async with asyncio.timeout(1): pass", {"asyncio.timeout"}),
        ("import enum\nclass A(enum.StrEnum): pass", {"enum.StrEnum"}),
        ("import tomllib", {"tomllib"}),
        ("raise ExceptionGroup('a', [])", {"ExceptionGroup"}),
        ("from dataclasses import dataclass", set()),
    ],
)
def test_what_came_with_311_is_found(text: str, found: set[str]) -> None:
    assert too_new(ast.parse(text)) == found


@each_row(
    ("module", "text", "found"),
    [
        ("lift_manager.rmf.remote_manager", "import httpx", {"httpx"}),
        (
            "lift_manager.rmf.remote_manager",
            "from lift_manager.api.keys import Secret",
            {"lift_manager.api.keys.Secret"},
        ),
        ("lift_manager.rmf.remote_manager", "from lift_manager.plain import http", set()),
        ("lift_manager.rmf.remote_manager", "from rclpy.node import Node", {"rclpy.node.Node"}),
        ("lift_manager.rmf.ros_messages", "import rclpy", {"rclpy"}),
        (ROS_NODE, "from rclpy.node import Node", set()),
    ],
)
def test_what_a_ros_installation_does_not_have_is_found(module: str, text: str, found: set[str]) -> None:
    assert foreign(module, ast.parse(text)) == found


def test_a_grammar_newer_than_310_is_found() -> None:
    with pytest.raises(SyntaxError):
        ast.parse("try: pass\nexcept* OSError: pass", feature_version=(3, 10))


def test_they_are_imported_without_any_package_of_the_index(tmp_path: Path) -> None:
    modules = [module for module in FILES if module not in OF_ROS]
    program = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); before = set(sys.modules)\n"
        + "".join(f"import {module}\n" for module in modules)
        + "print(*(name for name in set(sys.modules) - before if name.partition('.')[0] not in sys.stdlib_module_names))"
    )
    # without site-packages
    ran = subprocess.run(
        [sys.executable, "-S", "-I", "-B", "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.stderr == ""
    assert set(ran.stdout.split()) == set(modules)
