"""Read a site file and the maps it names; every mistake with file, line and key, all at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

from lift_manager.config.check import check_site, no_controller
from lift_manager.config.site import Controller, Site
from register_maps.errors import Finding, MapFileError
from register_maps.load import LoadedMap, load
from register_maps.schema import RegisterMap
from register_maps.source import Source, read, try_validate

_MAP_KEYS = {"provenance", "addressing", "served", "signals", "commands"}


@dataclass(frozen=True, slots=True)
class LoadedSite:
    """A checked site with the map of each of its controllers, by controller name."""

    site: Site
    maps: Mapping[str, LoadedMap]
    path: Path

    @property
    def controllers(self) -> dict[str, Controller]:
        """The controllers that some lift is on."""
        used = {lift.controller for lift in self.site.lifts.values()}
        return {name: controller for name, controller in self.site.controllers.items() if name in used}

    def cautions(self) -> Iterator[str]:
        """What a person should know at every start, a line each."""
        api = self.site.api
        if not _loopback(api.host):
            yield f"the API listens on {api.host}: whoever reaches it can command the lifts; keep that network closed"
        for controller in self.site.controllers.keys() - self.controllers.keys():
            yield f"{controller}: no lift is on this controller; it is left alone"
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
    maps: dict[str, LoadedMap] = {}
    findings = list(found)
    for name, named in _named_maps(source.data):
        try:
            maps[name] = load(named, near=path.parent)
        except MapFileError as error:
            findings += _at(source, ("controllers", name, "map"), error)
    if site is None:
        findings += _lost_lifts(source)
        raise MapFileError(findings)
    plain = {name: loaded.map for name, loaded in maps.items()}
    findings += [source.finding(problem.key, problem.message) for problem in check_site(site, plain)]
    if findings:
        raise MapFileError(findings)
    return LoadedSite(site, maps, path)


def check_file(path: Path) -> list[str]:
    """Check a site file or a map; returns what there is to say about a good one. Raises MapFileError."""
    data = read(path, number_keys=lambda _: True).data
    if isinstance(data, dict) and data.keys() & _MAP_KEYS and "lifts" not in data:
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


def _tables(data: object, key: str) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the named tables under a key, as far as the file has them: it may not be a site yet."""
    table = data.get(key) if isinstance(data, dict) else None
    for name, item in table.items() if isinstance(table, dict) else ():
        if isinstance(item, dict):
            yield name, item


def _named_maps(data: object) -> Iterator[tuple[str, str]]:
    for name, controller in _tables(data, "controllers"):
        if isinstance(named := controller.get("map"), str) and named:
            yield name, named


def _lost_lifts(source: Source) -> Iterator[Finding]:
    known = [name for name, _ in _tables(source.data, "controllers")]
    for name, lift in _tables(source.data, "lifts"):
        wanted = lift.get("controller")
        if known and isinstance(wanted, str) and wanted not in known:
            yield source.finding(("lifts", name, "controller"), no_controller(wanted, known))


def _loopback(host: str) -> bool:
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def _map_line(source: RegisterMap) -> str:
    return f"map {source.name} ({source.provenance.trust})"


def _at(source: Source, key: tuple[str | int, ...], error: MapFileError) -> list[Finding]:
    """Findings of a map stay where they are in its file; a map that cannot be found is a mistake of the site file."""
    return [source.finding(key, finding.message) if finding.line is None else finding for finding in error.findings]
