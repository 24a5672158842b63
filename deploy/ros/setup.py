"""Builds the ROS package. What it needs of the lift manager goes from the repository into the build, never into this folder."""  # noqa: INP001  setuptools runs it as a program

from __future__ import annotations

import ast
import shutil
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

from setuptools import setup  # type: ignore[import-untyped]  # setuptools ships no types
from setuptools.command.build_py import build_py  # type: ignore[import-untyped]  # nor does this

NAME = "modbus_lift_adapter"
HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent
FIRST = "lift_manager.rmf.ros_node"


def file_of(module: str) -> Path | None:
    """Return where a module of the lift manager is in the repository."""
    path = REPOSITORY.joinpath(*module.split("."))
    found = (one for one in (path.with_suffix(".py"), path / "__init__.py") if one.is_file())
    return next(found, None)


def imported(file: Path) -> set[str]:
    """Return what may be a module of the lift manager in the import statements of a file."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in names if name.split(".")[0] == FIRST.split(".", maxsplit=1)[0]}


def needed() -> list[Path]:
    """Return the files of the node's module and of all that it imports, packages included."""
    found: set[Path] = set()
    waiting = [FIRST]
    while waiting:
        module = waiting.pop()
        file = file_of(module)
        if file is None or file in found:
            continue
        found.add(file)
        parent = module.rpartition(".")[0]
        waiting += [*imported(file), *([parent] if parent else [])]
    return sorted(found)


class WithTheLiftManager(build_py):  # type: ignore[misc]  # without types its base is Any
    """Adds the needed modules under a folder of this package: a whole lift manager in the same environment stays whole."""

    def targets(self) -> dict[Path, Path]:
        """Return which file of the repository goes where."""
        vendored = Path(self.build_lib) / NAME / "vendored"
        return {file: vendored / file.relative_to(REPOSITORY) for file in needed()}

    def run(self) -> None:
        """Build, unless the modules are used where they are."""
        super().run()
        if getattr(self, "editable_mode", False):
            return
        shutil.rmtree(Path(self.build_lib) / NAME / "vendored", ignore_errors=True)
        for file, target in self.targets().items():
            target.parent.mkdir(parents=True, exist_ok=True)
            self.copy_file(str(file), str(target))

    def get_outputs(self, include_bytecode: int = 1) -> list[str]:
        """Return what is built, for the record of what is installed."""
        return [*super().get_outputs(include_bytecode), *(str(target) for target in self.targets().values())]


def text_of(tag: str) -> str:
    """Return what package.xml says; the version and the licence are written there alone."""
    found = ET.parse(HERE / "package.xml").findtext(tag)  # noqa: S314  our own file
    if not found:
        sys.exit(f"package.xml has no <{tag}>")
    return found


if file_of(FIRST) is None:
    sys.exit(
        f"{NAME}: {REPOSITORY} holds no {FIRST}. This package is built out of the lift manager's whole repository: clone that"
        " into the workspace, or link its folder deploy/ros into it, and do not copy the folder alone."
    )

setup(
    name=NAME,
    version=text_of("version"),
    description=text_of("description"),
    license=text_of("license"),
    maintainer=text_of("maintainer"),
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/lift_adapter.launch.xml"]),
    ],
    python_requires=">=3.10",
    install_requires=["setuptools"],
    zip_safe=False,
    cmdclass={"build_py": WithTheLiftManager},
    entry_points={"console_scripts": [f"lift_adapter = {NAME}.start:main"]},
)
