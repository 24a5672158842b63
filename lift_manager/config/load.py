"""Read a site file and the maps it names; every mistake with file, line and key, all at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from lift_manager.config.check import check_site
from lift_manager.config.site import Site
from register_maps.errors import Finding, MapFileError
from register_maps.load import LoadedMap, load
from register_maps.schema import RegisterMap
from register_maps.source import Source, read, try_validate


@dataclass(frozen=True, slots=True)
class LoadedSite:
    """A checked site with the map of each of its controllers, by controller name."""

    site: Site
    maps: Mapping[str, LoadedMap]
    path: Path

    def cautions(self) -> Iterator[str]:
        """What a person should know at every start, a line each."""
        for controller, loaded in self.maps.items():
            for warning in loaded.warnings:
                yield f"{controller}: {warning}"
        for name, lift in self.site.lifts.items():
            source = self.maps[lift.controller].map
            for signal, reason in source.not_visible.items():
                yield f"{name}: {signal} is not visible on this interface: {reason}"
            if lift.access == "control":
                yield f"{name}: is commanded without a checkout record for map {source.name} ({source.provenance.trust})"
                if lift.accept_latching is not None and any(
                    c.on_link_loss == "latches" for c in source.commands.values()
                ):
                    yield f"{name}: outputs stay on when this manager is lost; accepted: {lift.accept_latching}"


def load_site(path: Path) -> LoadedSite:
    """Read and check a site file. Raises MapFileError with every finding."""
    source = read(path)
    site, found = try_validate(source, Site)
    if site is None:
        raise MapFileError(found)
    maps: dict[str, LoadedMap] = {}
    findings = list(found)
    for name, controller in site.controllers.items():
        try:
            maps[name] = load(controller.map, near=path.parent)
        except MapFileError as error:
            findings += _at(source, ("controllers", name, "map"), error)
    plain = {name: loaded.map for name, loaded in maps.items()}
    findings += [source.finding(problem.key, problem.message) for problem in check_site(site, plain)]
    if findings:
        raise MapFileError(findings)
    return LoadedSite(site, maps, path)


def check_file(path: Path) -> list[str]:
    """Check a site file or a map; returns what there is to say about a good one. Raises MapFileError."""
    data = read(path, number_keys=lambda _: True).data
    if isinstance(data, dict) and "signals" in data and "lifts" not in data:
        loaded = load(path)
        return [
            *(f"caution: {warning}" for warning in loaded.warnings),
            f"{path}: {_map_line(loaded.map)}: no mistakes",
        ]
    loaded_site = load_site(path)
    lines = [f"caution: {line}" for line in loaded_site.cautions()]
    for name, lift in loaded_site.site.lifts.items():
        lines.append(
            f"{name}: {lift.access}, floors {', '.join(lift.floors)}, {_map_line(loaded_site.maps[lift.controller].map)}"
        )
    return [*lines, f"{path}: no mistakes"]


def _map_line(source: RegisterMap) -> str:
    return f"map {source.name} ({source.provenance.trust})"


def _at(source: Source, key: tuple[str | int, ...], error: MapFileError) -> list[Finding]:
    """Findings of a map stay where they are in its file; a map that cannot be found is a mistake of the site file."""
    return [source.finding(key, finding.message) if finding.line is None else finding for finding in error.findings]
