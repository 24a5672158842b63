"""`lift-manager check`: find the mistakes of a file, and compare the names of a site with RMF's building map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli import serve_checks
from lift_manager.cli.common import print_lines, report_mistakes
from lift_manager.config.check_rmf import unheld_doors, uses_rmf_names
from lift_manager.config.load import LoadedSite, check_file, load_site
from lift_manager.rmf.building import SiteLift, compare
from lift_manager.rmf.building_file import read_building, read_graph
from register_maps.errors import MapFileError
from register_maps.source import read
from register_maps.words import Side


def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A site file or a register map.")],
    building_map: Annotated[
        Path | None,
        typer.Option(
            "--building-map",
            metavar="FILE",
            help="Open-RMF's .building.yaml, to compare its lifts and levels with the names of the site.",
            show_default=False,
        ),
    ] = None,
    nav_graph: Annotated[
        list[Path],
        typer.Option(
            "--nav-graph",
            metavar="FILE",
            help="With --building-map: a navigation graph made from it; can be repeated.",
            show_default=False,
        ),
    ] = [],  # noqa: B006 - typer makes a new list of it
    *,
    verbose: Annotated[
        bool,
        typer.Option("--verbose", help="Also list what is assumed of each lift, because neither map nor site says it."),
    ] = False,
) -> None:
    """Find every mistake in a site file or a register map.

    It connects to no controller. Exits 2 if there is a mistake.

    Example: lift-manager check site.yaml --verbose
    """
    if nav_graph and building_map is None:
        raise typer.BadParameter(
            "also give the building map that it was made from, with --building-map", param_hint="--nav-graph"
        )
    try:
        for_rmf = building_map is not None
        lines = check_file(file, serve_checks.obstacles, serve_checks.cautions, for_rmf=for_rmf, verbose=verbose)
        print_lines(lines)
        if building_map is not None:
            _check_names(file, building_map, nav_graph)
    except MapFileError as error:
        raise report_mistakes(error) from error


def _check_names(site: Path, building_map: Path, nav_graphs: Sequence[Path]) -> None:
    """Print cautions, notes and the lines to write in the site file. Raises MapFileError with every mistake."""
    data = read(site, number_keys=lambda _: True).data
    if isinstance(data, dict) and "lifts" not in data:
        raise typer.BadParameter(f"{site} is no site file, and has no names to compare", param_hint="--building-map")
    loaded = load_site(site)
    found = compare(tuple(_lifts(loaded)), read_building(building_map), [read_graph(graph) for graph in nav_graphs])
    print_lines(f"caution: {caution}" for caution in _cautions(loaded))
    print_lines(f"note: {note}" for note in found.notes)
    block = list(found.site_file_lines())
    if block:
        print_lines(["", f"# to be written in {site}, lift by lift; look at each name first", *block, ""])
    if found.mistakes:
        raise MapFileError(found.mistakes)
    lifts = ", ".join(f"{own} is {name}" if own != name else name for name, own in found.pairs.items())
    print_lines([f"{building_map}: the names match: {lifts or 'no lift of the map is on this site'}"])


def _cautions(loaded: LoadedSite) -> Iterator[str]:
    """Yield cautions about lifts without a part `rmf`; `serve` warns about the others at every start."""
    for lift, spec in loaded.site.lifts.items():
        if not uses_rmf_names(spec):
            yield from unheld_doors(lift, spec, loaded.maps[lift].map)


def _lifts(loaded: LoadedSite) -> Iterator[SiteLift]:
    for lift, spec in loaded.site.lifts.items():
        signals = loaded.codecs[lift].signals
        all_doors = tuple(side.value for side in Side if f"door.{side}" in signals)
        yield SiteLift(
            lift,
            spec.rmf.name or lift,
            {floor: spec.rmf.floors.get(floor, floor) for floor in spec.floors},
            {
                floor: all_doors if entry.doors is None else tuple(side.value for side in entry.doors)
                for floor, entry in spec.floors.items()
            },
        )
