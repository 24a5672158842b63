"""Read a site file and the maps it names; every mistake with file, line and key, all at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from ipaddress import ip_address
from pathlib import Path

from lift_manager.config.check import check_site
from lift_manager.config.check_floors import unused_codes
from lift_manager.config.check_rmf import is_in_rmf, unheld_doors
from lift_manager.config.devices import POLL_S, Device, devices, least_poll_s, links
from lift_manager.config.maps import is_value_table, load_maps, tables
from lift_manager.config.problem import Problem
from lift_manager.config.site import Api, Controller, Lift, Site
from lift_manager.config.tls import tls_cautions, tls_lines, tls_problems
from register_maps.errors import Finding, MapFileError
from register_maps.load import LoadedMap, MapChanges, load
from register_maps.schema import CALLS, LinkDefaults, RegisterMap
from register_maps.source import LEFT_OUT, KeyPath, Source, StandIns, read, try_validate

_MAP_KEYS = {"provenance", "addressing", "served", "signals", "commands"}
_NOT_A_LIFT = {
    "template": "is a template and was taken from no lift",
    "simulation": "is that of a simulation",
}


_STAND_INS: StandIns = {
    ("name",): "unnamed",
    ("controllers", "*", "host"): "127.0.0.1",
    **dict.fromkeys(
        [
            ("controllers", "*", "*"),
            ("api",),
            ("api", "*"),
            ("rmf",),
            ("rmf", "*"),
            ("journal",),
            ("timezone",),
            ("state",),
        ],
        LEFT_OUT,
    ),
}
"""Stands in for what says nothing of a lift, so that the lifts are checked as well."""
_OF_ITS_LINK = frozenset({"poll_s", "max_age_s", "controller"})
"""Keys of a lift that are judged by what its controller needs."""


@dataclass(frozen=True)
class LoadedSite:
    """A checked site with the map of each of its lifts, by lift name."""

    site: Site
    maps: Mapping[str, LoadedMap]
    """With the parameters and overrides of each lift."""
    path: Path
    spare_maps: Mapping[str, LoadedMap] = field(default_factory=dict)
    """By controller, for those that no lift is on: what such a device needs of its link."""
    unusable: tuple[Finding, ...] = ()
    """Certificates and keys that cannot be used on this computer: whoever makes a plan of the site elsewhere needs none of them."""

    @cached_property
    def controllers(self) -> dict[str, Controller]:
        """The controllers that some lift, or an endpoint of one, is on."""
        used = {device.controller for name in self.site.lifts for device in self._devices(name)}
        return {name: controller for name, controller in self.site.controllers.items() if name in used}

    @cached_property
    def links(self) -> dict[str, LinkDefaults]:
        """What each controller's link has to respect, the site's own words included."""
        maps = {name: loaded.map for name, loaded in self.maps.items()}
        return links(self.site, maps, {name: loaded.map for name, loaded in self.spare_maps.items()})

    def poll_s(self, lift: str) -> float:
        """From one poll of a lift to its next."""
        said = self.site.lifts[lift].poll_s
        return max(POLL_S, least_poll_s(self._devices(lift), self.links)) if said is None else said

    def cautions(self) -> Iterator[str]:
        """What a person should know at every start, a line each."""
        if not _loopback(self.site.api.host):
            yield _reachable(self.site.api)
        yield from tls_cautions(self.site, self.path.parent)
        for controller in self.site.controllers.keys() - self.controllers.keys():
            yield f"{controller}: no lift is on this controller; it is left alone"
        warned = dict.fromkeys(warning for loaded in self.maps.values() for warning in loaded.warnings)
        for warning in warned:
            lifts = ", ".join(name for name, loaded in self.maps.items() if warning in loaded.warnings)
            yield f"{lifts}: {warning}"
        for name, lift in self.site.lifts.items():
            yield from _about(name, lift, self.maps[name].map)

    def _devices(self, lift: str) -> Iterable[Device]:
        return devices(self.site, self.site.lifts[lift], self.maps[lift].map).values()


def load_site(path: Path, *, for_rmf: bool = False) -> LoadedSite:
    """Read and check a site file; `for_rmf`: one that is used with RMF, whatever it says of it. Raises MapFileError with every finding."""
    source = read(path, number_keys=is_value_table)
    tried = try_validate(source, Site, stand_ins=_STAND_INS)
    site = tried.model
    maps = load_maps(source, path.parent)
    findings = [*tried.findings, *references(source), *maps.findings]
    unusable: tuple[Finding, ...] = ()
    if site is not None:
        problems = check_site(site, maps.lifts, maps.unchanged, maps.spare, for_rmf=for_rmf)
        own = (problem for problem in problems if not _follows(problem, tried.replaced))
        findings += [source.finding(problem.key, problem.message) for problem in own]
        unusable = tuple(source.finding(fault.key, fault.message) for fault in tls_problems(site, path.parent))
    if findings or site is None:
        raise MapFileError([*findings, *unusable])
    return LoadedSite(site, maps.lifts, path, maps.spare, unusable)


def _follows(problem: Problem, replaced: Collection[KeyPath]) -> bool:
    """Whether a problem may come from what stands in for something that is missing or wrong, and not from the file."""
    of_controllers = problem.key[0] == "controllers" or problem.key[-1] in _OF_ITS_LINK
    return any(path[0] == problem.key[0] or (path[0] == "controllers" and of_controllers) for path in replaced)


def references(source: Source) -> Iterator[Finding]:
    """Yield lifts and endpoints on controllers that are not there, and lifts on one without a map; the file may not be a site yet."""
    listed = source.data.get("controllers") if isinstance(source.data, dict) else None
    known = listed if isinstance(listed, dict) else {}
    without: dict[str, list[str]] = {}
    for key, wanted in _named_controllers(source.data):
        if not isinstance(wanted, str):
            continue
        if known and wanted not in known:
            yield source.finding(key, f"no controller {wanted!r}; there is {', '.join(known)}")
        own = known.get(wanted)
        if len(key) == 3 and isinstance(own, dict) and own.get("map") is None:
            without.setdefault(wanted, []).append(str(key[1]))
    for controller, lifts in without.items():
        message = f"is missing, and {', '.join(lifts)} is read by it; only a controller that serves nothing but endpoints needs no map"
        yield source.finding(("controllers", controller, "map"), message)


def _named_controllers(data: object) -> Iterator[tuple[KeyPath, object]]:
    for name, lift in tables(data, "lifts"):
        yield ("lifts", name, "controller"), lift.get("controller")
        for endpoint, place in tables(lift, "endpoints"):
            yield ("lifts", name, "endpoints", endpoint, "controller"), place.get("controller")


def check_file(
    path: Path,
    obstacles: Callable[[LoadedSite], Iterable[Finding]] = lambda loaded: loaded.unusable,
    *,
    for_rmf: bool = False,
) -> list[str]:
    """Check a site file or a map; returns what there is to say about a good one. Raises MapFileError.

    `obstacles` finds what keeps a good site file from being used, `for_rmf` is as for `load_site`.
    """
    data = read(path, number_keys=lambda _: True).data
    if isinstance(data, dict) and data.keys() & _MAP_KEYS and "lifts" not in data:
        loaded = load(path)
        return [
            *(f"caution: {warning}" for warning in loaded.warnings),
            f"{path}: {_map_line(loaded.map)}: no mistakes",
        ]
    loaded_site = load_site(path, for_rmf=for_rmf)
    if in_the_way := tuple(obstacles(loaded_site)):
        raise MapFileError(in_the_way)
    lines = [f"caution: {line}" for line in loaded_site.cautions()]
    lines += tls_lines(loaded_site.site, path.parent)
    for name, lift in loaded_site.site.lifts.items():
        lines.append(f"{name}: {lift.access}, floors {', '.join(lift.floors)}, {_map_line(loaded_site.maps[name].map)}")
    return [*lines, f"{path}: no mistakes"]


def _about(name: str, lift: Lift, source: RegisterMap) -> Iterator[str]:
    for signal, reason in source.not_visible.items():
        yield f"{name}: {signal} is not visible on this interface: {reason}"
    if keys := MapChanges(override=lift.override).keys:
        yield f"{name}: map {source.name} is changed at this site: {', '.join(keys)}"
    for text in unused_codes(lift, source):
        yield f"{name}: {text}"
    if source.provenance.trust in _NOT_A_LIFT:
        yield f"{name}: map {source.name} {_NOT_A_LIFT[source.provenance.trust]}; compare every signal with the real lift"
    if lift.access == "monitor":
        yield f"{name}: is only watched, and requests for it are refused; `access: control` would command it"
        return
    if not source.commands.keys() & set(CALLS):
        yield f"{name}: map {source.name} has no command that calls the car; nothing here can send for it"
    if is_in_rmf(lift):
        yield from unheld_doors(name, lift, source)
    if lift.accept_latching is not None and any(c.on_link_loss == "latches" for c in source.commands.values()):
        yield f"{name}: outputs stay on when this manager is lost; accepted: {lift.accept_latching}"


def _reachable(api: Api) -> str:
    if api.without_keys is not None:
        return (
            f"the API listens on {api.host}, and while this site has no keys whoever reaches it can command the lifts;"
            f" accepted: {api.without_keys}"
        )
    clear = "" if api.tls is not None else ", and keys cross the network as they are, because `api` has no `tls`"
    return f"the API listens on {api.host}: every request needs a key (`lift-manager keys make`){clear}"


def _loopback(host: str) -> bool:
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def _map_line(source: RegisterMap) -> str:
    return f"map {source.name} ({source.provenance.trust})"
