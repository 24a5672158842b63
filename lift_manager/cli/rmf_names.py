"""`lift-manager check SITE --building-map FILE`: whether the names of a site are those of RMF's building map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import typer

from lift_manager.cli.common import say
from lift_manager.config.check_rmf import unheld_doors, uses_rmf_names
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.rmf.building import SiteLift, compare
from lift_manager.rmf.building_file import read_building, read_graph
from register_maps.codec import compile_map
from register_maps.errors import MapFileError
from register_maps.source import read
from register_maps.words import Side


def check_names(site: Path, building_map: Path, nav_graphs: Sequence[Path]) -> None:
    """Print what of the names is fine, what is of no use, and the part to write in the site file. Raises MapFileError with every mistake."""
    data = read(site, number_keys=lambda _: True).data
    if isinstance(data, dict) and "lifts" not in data:
        raise typer.BadParameter(f"{site} is no site file, and has no names to compare", param_hint="--building-map")
    loaded = load_site(site)
    found = compare(tuple(_lifts(loaded)), read_building(building_map), [read_graph(graph) for graph in nav_graphs])
    say(f"caution: {caution}" for caution in _cautions(loaded))
    say(f"note: {note}" for note in found.notes)
    block = list(found.block())
    if block:
        say(["", f"# to be written in {site}, lift by lift; look at each name first", *block, ""])
    if found.mistakes:
        raise MapFileError(found.mistakes)
    lifts = ", ".join(f"{own} is {name}" if own != name else name for name, own in found.pairs.items())
    say([f"{building_map}: the names match: {lifts or 'no lift of the map is on this site'}"])


def _cautions(loaded: LoadedSite) -> Iterator[str]:
    """Yield those of lifts that RMF calls as the site does; the others are cautioned about at every start."""
    for lift, spec in loaded.site.lifts.items():
        if not uses_rmf_names(spec):
            yield from unheld_doors(lift, spec, loaded.maps[lift].map)


def _lifts(loaded: LoadedSite) -> Iterator[SiteLift]:
    for lift, spec in loaded.site.lifts.items():
        signals = compile_map(loaded.maps[lift].map).signals
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
