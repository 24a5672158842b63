"""Shared by all commands: printing, failing, and reading arguments."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from lift_manager.config.load import LoadedSite, load_site
from lift_manager.config.site import MODBUS_PORT
from lift_manager.store.committer import Committer
from lift_manager.store.errors import StoreError, StoreUnusable
from lift_manager.store.place import store_path
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_store
from register_maps.errors import MapFileError
from register_maps.load import LoadedMap, load

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

# no emoji: an address such as x:door:1 is not an emoji code
out = Console(emoji=False)
err = Console(stderr=True, emoji=False)

SiteFile = Annotated[Path, typer.Argument(metavar="SITE", help="The site file.")]
Machine = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="In a cluster: which machine this is, instead of the host name."),
]
MapName = Annotated[str, typer.Argument(metavar="MAP", help="A shipped map by name, or the path of a map file.")]
Floors = Annotated[str, typer.Option(help="Floors with their codes, lowest first, such as B1=-1,L1=1,L2=2.")]

_NUMBER = re.compile(r"-?[0-9]+")
_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*([a-z]?)")
_UNIT_S = {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}
_CONTROLLER = re.compile(r"(?P<host>[^\s:/\[\]]+|\[[0-9a-fA-F:.%]+\])(?::(?P<port>[0-9]{1,5}))?")


def print_lines(lines: Iterable[str]) -> None:
    """Print lines unchanged: without colour or wrapping."""
    for line in lines:
        out.print(line, markup=False, highlight=False, soft_wrap=True)


def print_json(found: DataclassInstance | Sequence[DataclassInstance]) -> None:
    """Print data as JSON, for other programs."""
    data = [asdict(item) for item in found] if isinstance(found, Sequence) else asdict(found)
    print_lines([json.dumps(data, indent=2)])


def print_stderr(text: str) -> None:
    """Print a line to stderr unchanged: messages that are not part of the result."""
    err.print(text, markup=False, highlight=False, soft_wrap=True)


def fail(text: str) -> typer.Exit:
    """Print one sentence to stderr; raise what this returns."""
    print_stderr(text)
    return typer.Exit(1)


def report_mistakes(error: MapFileError) -> typer.Exit:
    """Print every mistake of a file to stderr, and their number; raise what this returns."""
    for finding in error.findings:
        print_stderr(str(finding))
    count = len(error.findings)
    err.print(f"{count} mistake{'' if count == 1 else 's'}", highlight=False)
    return typer.Exit(2)


def load_map_or_exit(name: str) -> LoadedMap:
    """Load a map, or report its mistakes and exit with 2."""
    try:
        return load(name, near=Path.cwd())
    except MapFileError as error:
        raise report_mistakes(error) from error


def load_site_or_exit(path: Path, *, for_rmf: bool = False) -> LoadedSite:
    """Load a site, checked for use with RMF if `for_rmf`, or report its mistakes and exit with 2."""
    try:
        return load_site(path, for_rmf=for_rmf)
    except MapFileError as error:
        raise report_mistakes(error) from error


def on_machine(loaded: LoadedSite, name: str | None) -> LoadedSite:
    """Return the site as of the machine of this name, if there is one and a cluster; the site file or the host name says it otherwise."""
    cluster = loaded.site.cluster
    if name is None or cluster is None:
        return loaded
    site = loaded.site.model_copy(update={"cluster": cluster.model_copy(update={"machine": name})})
    return replace(loaded, site=site)


def store_path_of(loaded: LoadedSite) -> Path:
    """Return the path of a site's store, or report why there is none and exit with 1."""
    try:
        return store_path(loaded.site.name, loaded.site.state, loaded.path, os.environ)
    except StoreUnusable as error:
        raise fail(str(error)) from error


def open_store_or_exit(loaded: LoadedSite) -> Committer:
    """Open the store of a site for one manager, or report why it cannot be used and exit with 1."""
    limits = Limits(loaded.site.journal.keep_days, loaded.site.journal.max_mb)
    try:
        return open_store(store_path_of(loaded), loaded.site.name, loaded.site.lifts.keys(), limits)
    except StoreError as error:
        raise fail(str(error)) from error


def controller_address(text: str) -> tuple[str, int] | None:
    """Parse HOST or HOST:PORT of a controller, an IPv6 address in brackets; None for anything else."""
    match = _CONTROLLER.fullmatch(text)
    port = int(match["port"] or MODBUS_PORT) if match else 0
    return (match["host"].strip("[]"), port) if match and 1 <= port <= 65535 else None


def duration_s(text: str, units: Collection[str]) -> float | None:
    """Parse a time such as 10m, in one of these units, into seconds; an empty unit means seconds. None for anything else."""
    match = _DURATION.fullmatch(text)
    return float(match[1]) * _UNIT_S[match[2]] if match and match[2] in units else None


def read_floors(text: str) -> dict[str, int] | None:
    """Parse floors with their codes; None for an empty text. Raises typer.BadParameter."""
    if not text:
        return None
    floors: dict[str, int] = {}
    named: dict[int, str] = {}
    for part in text.split(","):
        name, _, number = part.partition("=")
        name = name.strip()
        if not name or not _NUMBER.fullmatch(number.strip()):
            raise _bad_floors(f"{part!r}: write NAME=CODE, such as L1=1")
        code = int(number)
        if name in floors:
            raise _bad_floors(f"floor {name} is given twice")
        if code in named:
            raise _bad_floors(f"code {code} is floor {named[code]} already")
        floors[name], named[code] = code, name
    if len(floors) < 2:
        raise _bad_floors("a lift has two floors or more")
    return floors


def _bad_floors(text: str) -> typer.BadParameter:
    return typer.BadParameter(text, param_hint="--floors")
