"""The files in constraints/: what is installed is what was tested, whatever the index says by then."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.rows import each_row

ROOT = Path(__file__).resolve().parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
BUILD: list[str] = PROJECT["build-system"]["requires"]
RUN: list[str] = PROJECT["project"]["dependencies"]
EXTRAS: dict[str, list[str]] = PROJECT["project"]["optional-dependencies"]
NEEDED = {
    "run": [*BUILD, *RUN],
    "rmf": [*BUILD, *RUN, *EXTRAS["rmf"], *EXTRAS["hub"]],
    "hub": [*BUILD, *RUN, *EXTRAS["hub"]],
    "package": [*BUILD, *RUN, *EXTRAS["package"]],
    "dev": [*BUILD, *RUN, *EXTRAS["rmf"], *EXTRAS["hub"], *EXTRAS["dev"]],
    **PROJECT["dependency-groups"],
}
PYTHONS = ("3.11", "3.12", "3.13")
MACHINES = ("x86_64", "aarch64")


def blocks(name: str) -> list[str]:
    """Every requirement of a file, on one line, with its hashes."""
    text = (ROOT / "constraints" / f"{name}.txt").read_text("utf-8").replace("\\\n", " ")
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def pinned(name: str) -> list[tuple[Requirement, frozenset[str]]]:
    found = []
    for line in blocks(name):
        requirement, *hashes = line.split("--hash=sha256:")
        found.append((Requirement(requirement.strip()), frozenset(hash_.strip() for hash_ in hashes)))
    return found


def on(python: str, machine: str) -> dict[str, str]:
    """What markers are about, on Linux."""
    return {
        "python_version": python,
        "python_full_version": f"{python}.0",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
        "platform_machine": machine,
        "platform_system": "Linux",
        "sys_platform": "linux",
        "os_name": "posix",
    }


@pytest.mark.parametrize("name", NEEDED)
def test_every_requirement_has_one_version_and_the_hashes_of_its_files_and_no_place_to_get_it_from(name: str) -> None:
    for requirement, hashes in pinned(name):
        assert re.fullmatch(r"==[^,*]+", str(requirement.specifier)), requirement
        assert requirement.url is None
        assert hashes
        assert all(re.fullmatch(r"[0-9a-f]{64}", hash_) for hash_ in hashes)
    text = (ROOT / "constraints" / f"{name}.txt").read_text("utf-8")
    assert not re.search(r"://|--(?!hash=|require-hashes)|@", text)


@each_row("machine", MACHINES)
@each_row("python", PYTHONS)
@each_row("name", NEEDED)
def test_what_the_project_asks_for_is_in_it_once_and_in_a_version_that_it_takes(
    name: str, python: str, machine: str
) -> None:
    environment = on(python, machine)
    versions: dict[str, str] = {}
    for requirement, _ in pinned(name):
        if requirement.marker is None or requirement.marker.evaluate(environment):
            key = canonicalize_name(requirement.name)
            assert key not in versions
            versions[key] = next(iter(requirement.specifier)).version
    for needed in map(Requirement, NEEDED[name]):
        version = versions[canonicalize_name(needed.name)]
        assert needed.specifier.contains(version), f"{needed}: {version}; ./scripts/pin writes the files anew"


@each_row("name", ["rmf", "hub", "package", "dev"])
def test_every_file_has_the_same_versions_of_what_the_program_needs(name: str) -> None:
    others = pinned(name)
    for requirement, hashes in pinned("run"):
        same = [(other, found) for other, found in others if other.name == requirement.name]
        assert [(other.specifier, found) for other, found in same] == [(requirement.specifier, hashes)]


@each_row("name", ["fastapi", "starlette", "uvicorn", "pydantic", "pymodbus"])
def test_what_is_subclassed_has_an_upper_bound(name: str) -> None:
    (needed,) = (needed for needed in map(Requirement, RUN) if needed.name == name)
    assert "<" in {specifier.operator for specifier in needed.specifier}
