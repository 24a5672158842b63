"""`lift-manager init`: write the site file of a first lift, and look at once whether its controller answers."""

from __future__ import annotations

import asyncio
import os
import re
import sys
import textwrap
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Annotated, TypeVar

import typer

from drivers.errors import ControllerTaken, LockUnusable
from lift_manager.cli.common import (
    Floors,
    err,
    fail,
    print_lines,
    print_stderr,
    read_floors,
    report_mistakes,
)
from lift_manager.cli.doctor import host_and_port
from lift_manager.commissioning import maps_list
from lift_manager.commissioning.doctor.collect import collect
from lift_manager.commissioning.doctor.finding import Severity
from lift_manager.commissioning.doctor.report import finding_line, looks, make_report
from lift_manager.commissioning.doctor.subjects import subjects_of_site
from lift_manager.commissioning.output import OutputRefused, save
from lift_manager.commissioning.site_file import FirstLift, site_file
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.lift.config import LIFT_NAME
from lift_manager.plain.version import running_version
from register_maps.codec import compile_map
from register_maps.errors import MapFileError
from register_maps.expand import ParameterValue
from register_maps.load import MAPS, LoadedMap, load, shipped
from register_maps.schema import Parameter
from register_maps.signal_codec import listed_codes

LOOK_S = 1.0
"""How long it reads. Chosen: enough to see where the car is; doctor reads for longer."""
MOST_ERRORS = 3
Answer = TypeVar("Answer")


def init(  # noqa: PLR0913  a parameter per option
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The site file to write.")] = Path("site.yaml"),
    *,
    host: Annotated[
        str, typer.Option(metavar="HOST[:PORT]", help="Address of the controller; port 502 by default.")
    ] = "",
    map_name: Annotated[
        str, typer.Option("--map", metavar="MAP", help="Its map: a shipped one by name, or the path of a file.")
    ] = "",
    lift: Annotated[str, typer.Option(help="Name of the lift, as robots use it.")] = "",
    floors: Floors = "",
    unit: Annotated[int | None, typer.Option(min=0, max=255, help="Unit id, if it is not that of the map.")] = None,
    site_name: Annotated[str, typer.Option("--name", help="Name of the building.")] = "",
    settings: Annotated[
        list[str], typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the map. Can be repeated.")
    ] = [],  # noqa: B006 - typer makes a new list of it
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")] = False,
    offline: Annotated[bool, typer.Option("--offline", help="Do not connect.")] = False,
) -> None:
    """Write the site file of a first lift.

    It asks for what is not given as an option, connects at once to see whether the controller answers, and writes nothing to the lift.

    Example: lift-manager init site.yaml --host 192.0.2.10 --map generic-registers --lift main --floors B1=-1,G=0,L1=1
    """
    if file.exists() and not force:
        raise fail(f"{file} is there already; give another name, or --force to replace it")
    address, port = _option_or_prompt("--host", host, "Address of the controller (HOST or HOST:PORT)", host_and_port)
    if not map_name:
        print_lines(_map_choice())
    loaded = _option_or_prompt("--map", map_name, "Map", _usable_map)
    parameters = dict(_parameters(loaded, settings))
    name = _option_or_prompt("--lift", lift, "Name of the lift", _lift_name, default="main")
    building = site_name or (_prompt("Name of the building", str, default="My site") if _is_terminal() else "My site")
    codes = _codes(loaded)
    question = "Floors with the controller's codes, lowest first (such as G=0,L1=1"
    question += f"; this map has the codes {listed_codes(codes)})" if codes else ")"

    def draft(floors_text: str) -> tuple[str, LoadedSite]:
        named = _floors(floors_text, codes)
        title = maps_list.summarize_map(loaded).title
        first = FirstLift(building, address, port, _as_written(loaded, file), title, name, named, unit, parameters)
        text = site_file(first, day=f"{datetime.now().astimezone():%Y-%m-%d}")
        return text, _checked(text, file, ("lifts", name, "floors"))

    text, site = _option_or_prompt("--floors", floors, question, draft)
    if not offline:
        _look(site)
    try:
        save({file: text.encode()}, force=force)
    except OutputRefused as error:
        raise fail(str(error)) from error
    print_lines(
        [
            f"{file}: written, with `access: monitor`: the manager will not write to the lift. Next:",
            f"  lift-manager check {file}     finds mistakes of the file",
            f"  lift-manager doctor {file}    finds what is wrong between map and controller",
            f"  lift-manager serve {file}     watches the lift",
        ]
    )


def _is_terminal() -> bool:
    return sys.stdin.isatty()


def _option_or_prompt(
    option: str, given: str, question: str, read: Callable[[str], Answer], *, default: str | None = None
) -> Answer:
    """Return what an option says; without one ask at a terminal. Raises typer.BadParameter where there is no terminal."""
    if given:
        return read(given)
    if _is_terminal():
        return _prompt(question, read, default=default)
    if default is not None:
        return read(default)
    raise typer.BadParameter("is needed: without a terminal, init cannot ask for it", param_hint=option)


def _prompt(question: str, read: Callable[[str], Answer], *, default: str | None = None) -> Answer:
    """Ask until the answer can be used."""
    while True:
        try:
            return read(typer.prompt(question, default=default).strip())
        except typer.BadParameter as error:
            print_stderr(error.message)


def _codes(loaded: LoadedMap) -> tuple[int, ...]:
    """Return the floor codes of a map that lists them, such as one bit per floor; empty where any number may be one."""
    codec = compile_map(loaded.map)
    listed = [signal.floor_codes for signal in codec.signals.values() if signal.floor_codes]
    listed += [tuple(spec.positions) for spec in loaded.map.signals.values() if spec.positions is not None]
    return listed[0] if listed else ()


def _lift_name(text: str) -> str:
    if not re.fullmatch(LIFT_NAME, text):
        raise typer.BadParameter(
            "the name of a lift has letters, digits, `-`, `_` and `.`, and begins with a letter, a digit or `_`",
            param_hint="--lift",
        )
    return text


def _floors(text: str, codes: Collection[int]) -> dict[str, int]:
    named = read_floors(text)
    if named is None:
        raise typer.BadParameter("a lift has two floors or more", param_hint="--floors")
    for floor, code in named.items():
        if codes and code not in codes:
            raise typer.BadParameter(
                f"{floor}={code}: this map has the codes {listed_codes(codes)}", param_hint="--floors"
            )
    return named


def _map_choice() -> Iterator[str]:
    """Yield the shipped maps that one device is enough for, a line each."""
    yield "Maps (`lift-manager maps list` says more; for a controller that can be programmed freely take a generic one):"
    for name in shipped():
        source = load(name).map
        if not source.needs:
            yield from textwrap.wrap(f"{name}: {source.title}", 78, initial_indent="  ", subsequent_indent="      ")


def _usable_map(name: str) -> LoadedMap:
    """Load a map. Raises typer.BadParameter for one that a person can correct at the prompt."""
    try:
        loaded = load(name, near=Path.cwd())
    except MapFileError as error:
        if not _is_terminal():
            raise report_mistakes(error) from error
        raise typer.BadParameter("\n".join(map(str, error.findings)), param_hint="--map") from error
    if loaded.map.needs or loaded.map.endpoints:
        missing = ", ".join(loaded.map.needs) or ", ".join(loaded.map.endpoints)
        message = (
            f"{loaded.map.name} needs a second device, for {missing}: copy examples/two-endpoints.yaml and change it"
        )
        raise typer.BadParameter(message, param_hint="--map")
    return loaded


def _as_written(loaded: LoadedMap, file: Path) -> str:
    """Return how the file names a map: a shipped one by name, another one by its path from the file."""
    if loaded.path.parent == MAPS:
        return loaded.map.name
    path = os.path.relpath(loaded.path.resolve(), file.resolve().parent)
    return path if path.startswith("..") else f"./{path}"


def _parameters(loaded: LoadedMap, settings: list[str]) -> Iterator[tuple[str, ParameterValue]]:
    """Yield the parameters that are given, and those that a site has to set."""
    given = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals or name not in loaded.map.parameters:
            known = ", ".join(loaded.map.parameters) or "none"
            raise typer.BadParameter(
                f"{setting!r}: write NAME=VALUE; {loaded.map.name} has {known}", param_hint="--set"
            )
        given[name] = value
    for name, parameter in loaded.map.parameters.items():
        if name in given:
            yield name, _parameter(name, parameter, given[name])
        elif name in loaded.unset:
            if not _is_terminal():
                raise typer.BadParameter(f"{name} is needed: {parameter.help}", param_hint="--set")
            print_lines([f"{name}: {' '.join(parameter.help.split())}"])
            yield name, _prompt(f"  {name} (such as {parameter.value})", partial(_parameter, name, parameter))


def _parameter(name: str, parameter: Parameter, text: str) -> ParameterValue:
    value: ParameterValue = text
    if not isinstance(parameter.value, str):
        try:
            value = int(text) if text.lstrip("-").isdecimal() else float(text)
        except ValueError:
            value = text
    if (problem := parameter.find_problem(value)) is not None:
        raise typer.BadParameter(f"{name} {problem}", param_hint="--set")
    return value


def _checked(text: str, file: Path, floors: Sequence[str]) -> LoadedSite:
    """Load the text as the file that it will be, or report its mistakes and exit with 2.

    Raises typer.BadParameter for a mistake of the floors that a person at a terminal can correct.
    """
    try:
        with NamedTemporaryFile("w", dir=file.resolve().parent, suffix=file.suffix, encoding="utf-8") as draft:
            draft.write(text)
            draft.flush()
            return load_site(Path(draft.name))
    except OSError as error:
        raise fail(f"{file} cannot be written: {error.strerror or error}") from error
    except MapFileError as error:
        if _is_terminal() and all(found.key.startswith(".".join(floors)) for found in error.findings):
            texts = dict.fromkeys(found.message for found in error.findings)
            raise typer.BadParameter("\n".join(texts), param_hint="--floors") from error
        findings = [replace(found, file=str(file)) if found.file == draft.name else found for found in error.findings]
        raise report_mistakes(MapFileError(findings)) from error


def _look(site: LoadedSite) -> None:
    """Connect, and print where the car is and what the door does, or what prevents that."""
    subjects = subjects_of_site(site)
    try:
        with err.status("connecting"):
            evidence = asyncio.run(collect(subjects, seconds=LOOK_S))
    except (ControllerTaken, LockUnusable) as error:
        print_stderr(f"not connected: {error}")
        return
    report = make_report(subjects, evidence, version=running_version(), time="")
    errors = [finding for finding in report.findings if finding.severity is Severity.ERROR]
    print_lines(looks(report, subjects))
    print_lines(finding_line(finding) for finding in errors[:MOST_ERRORS])
    if not errors:
        print_lines(["Look at the lift: is that so?"])
