"""Reads a site file and the maps that it names, and reports every mistake at once, with file, line and key."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from ipaddress import ip_address
from pathlib import Path

from lift_manager.config.announcements import announcement_cautions, find_announcements
from lift_manager.config.check import check_site
from lift_manager.config.check_cluster import cluster_cautions, fence_lines
from lift_manager.config.check_floors import unused_codes
from lift_manager.config.check_rmf import unheld_doors, uses_rmf_names
from lift_manager.config.devices import POLL_RIDDEN_S, POLL_S, Device, devices, least_poll_s, links
from lift_manager.config.hub import hub_problems
from lift_manager.config.maps import compile_maps, is_value_table, load_maps, tables
from lift_manager.config.problem import Problem
from lift_manager.config.site import Api, Controller, Lift, Site
from lift_manager.config.tls import path_of, tls_cautions, tls_lines, tls_problems
from lift_manager.lift.config import Checkout
from register_maps.assumptions import assumptions
from register_maps.codec import Codec
from register_maps.errors import Finding, MapFileError
from register_maps.load import LoadedMap, MapChanges, load
from register_maps.schema import CALLS, LinkDefaults, RegisterMap
from register_maps.source import LEFT_OUT, KeyPath, Source, StandIns, read, try_validate

_MAP_KEYS = {"provenance", "addressing", "served", "signals", "commands"}
_IS_MAP = "this is a register map and not a site file; a controller of a site file names it, as its `map`"
_NOT_A_LIFT = {
    "template": "is a template and was not taken from a real lift",
    "simulation": "describes a simulation",
}


_STAND_INS: StandIns = {
    ("name",): "unnamed",
    ("controllers", "*", "host"): "127.0.0.1",
    **dict.fromkeys(
        [
            ("controllers", "*", "*"),
            ("api",),
            ("api", "*"),
            ("announcements",),
            ("rmf",),
            ("rmf", "*"),
            ("journal",),
            ("hub",),
            ("timezone",),
            ("cluster",),
            ("state",),
        ],
        LEFT_OUT,
    ),
}
"""Substitutes for wrong values that do not concern lifts, so that the lifts are checked as well."""
_LINK_KEYS = frozenset({"poll_s", "poll_ridden_s", "max_age_s", "controller"})
"""Keys of a lift that are checked against the needs of its controller."""


@dataclass(frozen=True)
class LoadedSite:
    """A checked site with the map of each of its lifts, by lift name."""

    site: Site
    maps: Mapping[str, LoadedMap]
    """With the parameters and overrides of each lift."""
    path: Path
    spare_maps: Mapping[str, LoadedMap] = field(default_factory=dict)
    """The maps of controllers without a lift, which define the needs of their links."""
    unusable: tuple[Finding, ...] = ()
    """Certificates and keys that cannot be used on this computer; planning a site elsewhere does not need them."""
    checkouts: Mapping[str, Checkout] = field(default_factory=dict)
    """The acceptance tests that let robots use its lifts, as far as they were looked for."""

    @cached_property
    def controllers(self) -> dict[str, Controller]:
        """The controllers that a lift, or an endpoint of one, uses."""
        used = {device.controller for name in self.site.lifts for device in self._devices(name)}
        return {name: controller for name, controller in self.site.controllers.items() if name in used}

    @cached_property
    def simulated(self) -> frozenset[str]:
        """The lifts of which a controller, or that of an endpoint, is a simulator."""
        controllers = self.site.controllers
        return frozenset(
            name
            for name in self.site.lifts
            if any(controllers[device.controller].simulated for device in self._devices(name))
        )

    @cached_property
    def links(self) -> dict[str, LinkDefaults]:
        """The limits of the link to each controller, including settings of the site."""
        maps = {name: loaded.map for name, loaded in self.maps.items()}
        return links(self.site, maps, {name: loaded.map for name, loaded in self.spare_maps.items()})

    @cached_property
    def codecs(self) -> dict[str, Codec]:
        """The compiled map of each lift, in the order of the site file."""
        return compile_maps(self.site, {name: self.maps[name].map for name in self.site.lifts})

    def poll_s(self, lift: str) -> float:
        """Seconds from one poll of a lift to the next."""
        configured = self.site.lifts[lift].poll_s
        return max(POLL_S, least_poll_s(self._devices(lift), self.links)) if configured is None else configured

    def poll_ridden_s(self, lift: str) -> float:
        """Seconds from one poll of a lift to the next while a session has it."""
        configured, poll_s = self.site.lifts[lift].poll_ridden_s, self.poll_s(lift)
        least_s = max(POLL_RIDDEN_S, least_poll_s(self._devices(lift), self.links))
        return min(poll_s, least_s) if configured is None else configured

    def cautions(self) -> Iterator[str]:
        """Cautions for people at every start, a line each."""
        if not _is_loopback(self.site.api.host):
            yield _api_caution(self.site.api)
        yield from tls_cautions(self.site, self.path.parent)
        if self._announcements_folder is not None:
            yield from announcement_cautions(self._announcements_folder)
        yield from cluster_cautions(self.site, self._plain_maps, self.path.parent)
        for unused in self.site.controllers.keys() - self.controllers.keys():
            yield f"{unused}: no lift is on this controller; it is left alone"
        for name, controller in self.site.controllers.items():
            if controller.writable_ranges:
                ranges = ", ".join(map(str, controller.writable_ranges))
                yield f"{name}: `lift-manager poke --unlock` may write {ranges}, on the wire"
        warned = dict.fromkeys(warning for loaded in self.maps.values() for warning in loaded.warnings)
        for warning in warned:
            lifts = ", ".join(name for name, loaded in self.maps.items() if warning in loaded.warnings)
            yield f"{lifts}: {warning}"
        for name, lift in self.site.lifts.items():
            yield from _lift_cautions(name, lift, self.maps[name].map)

    def announcements(self) -> Mapping[str, Path]:
        """Return the recorded announcements that there are; a folder that cannot be read has none, and a caution says so."""
        if self._announcements_folder is None:
            return {}
        try:
            return find_announcements(self._announcements_folder)
        except OSError:
            return {}

    @property
    def _plain_maps(self) -> dict[str, RegisterMap]:
        return {name: loaded.map for name, loaded in self.maps.items()}

    def fence_lines(self) -> Iterator[str]:
        """Yield what keeps late writes from each lift of a cluster."""
        yield from fence_lines(self.site, self._plain_maps)

    @property
    def _announcements_folder(self) -> Path | None:
        folder = self.site.announcements
        return None if folder is None else path_of(self.path.parent, folder)

    def _devices(self, lift: str) -> Iterable[Device]:
        return devices(self.site, self.site.lifts[lift], self.maps[lift].map).values()


def load_site(path: Path, *, for_rmf: bool = False) -> LoadedSite:
    """Read and check a site file; `for_rmf` assumes use with RMF, whatever it says. Raises MapFileError with every finding."""
    source = read(path, number_keys=is_value_table)
    if _is_map(source.data):
        raise MapFileError([Finding(str(path), None, "", _IS_MAP)])
    attempt = try_validate(source, Site, stand_ins=_STAND_INS)
    site = attempt.model
    maps = load_maps(source, path.parent)
    findings = [*attempt.findings, *check_references(source), *maps.findings]
    unusable: tuple[Finding, ...] = ()
    if site is not None:
        problems = check_site(site, maps.lifts, maps.unchanged, maps.spare, for_rmf=for_rmf)
        remaining = (problem for problem in problems if not _is_consequence(problem, attempt.replaced))
        findings += [source.finding(problem.key, problem.message) for problem in remaining]
        unusable = tuple(
            source.finding(fault.key, fault.message)
            for fault in (*tls_problems(site, path.parent), *hub_problems(site, path.parent))
        )
    if findings or site is None:
        raise MapFileError([*findings, *unusable])
    return LoadedSite(site, maps.lifts, path, maps.spare, unusable)


def _is_map(data: object) -> bool:
    """Whether a file is a register map, and no site file."""
    return isinstance(data, dict) and not data.keys().isdisjoint(_MAP_KEYS) and "lifts" not in data


def _is_consequence(problem: Problem, replaced: Collection[KeyPath]) -> bool:
    """Whether a problem may come from a substitute for a missing or wrong value, and not from the file."""
    of_controllers = problem.key[0] == "controllers" or problem.key[-1] in _LINK_KEYS
    return any(path[0] == problem.key[0] or (path[0] == "controllers" and of_controllers) for path in replaced)


def check_references(source: Source) -> Iterator[Finding]:
    """Yield lifts and endpoints on unknown controllers, and lifts on one without a map; works on the raw file."""
    listed = source.data.get("controllers") if isinstance(source.data, dict) else None
    known = listed if isinstance(listed, dict) else {}
    without_map: dict[str, list[str]] = {}
    for key, controller_name in _named_controllers(source.data):
        if not isinstance(controller_name, str):
            continue
        if known and controller_name not in known:
            yield source.finding(key, f"no controller {controller_name!r}; there is {', '.join(known)}")
        remaining = known.get(controller_name)
        if len(key) == 3 and isinstance(remaining, dict) and remaining.get("map") is None:
            without_map.setdefault(controller_name, []).append(str(key[1]))
    for controller, lifts in without_map.items():
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
    cautions: Callable[[LoadedSite], Iterable[str]] = LoadedSite.cautions,
    *,
    for_rmf: bool = False,
    verbose: bool = False,
) -> list[str]:
    """Check a site file or a map; returns the cautions, what is assumed, and a summary. Raises MapFileError.

    `obstacles` finds what prevents the use of a correct site file, `cautions` what people should know of it; `for_rmf` is as for
    `load_site`. What a site assumes is returned only if `verbose`.
    """
    if _is_map(read(path, number_keys=lambda _: True).data):
        return map_report(load(path))
    loaded_site = load_site(path, for_rmf=for_rmf)
    if blocking := tuple(obstacles(loaded_site)):
        raise MapFileError(blocking)
    lines = [f"caution: {line}" for line in cautions(loaded_site)]
    lines += tls_lines(loaded_site.site, path.parent)
    lines += loaded_site.fence_lines()
    if verbose:
        lines += _assumed_of_lifts(loaded_site)
    for name, lift in loaded_site.site.lifts.items():
        lines.append(f"{name}: {lift.access}, floors {', '.join(lift.floors)}, {_map_text(loaded_site.maps[name].map)}")
    return [*lines, f"{path}: no mistakes"]


def map_report(loaded: LoadedMap) -> list[str]:
    """Return the cautions about a correct map, what it leaves to its defaults, and its summary."""
    return [
        *(f"caution: {warning}" for warning in loaded.warnings),
        *_assumed("the map does not say", assumptions(loaded.map)),
        f"{loaded.path}: {_map_text(loaded.map)}: no mistakes",
    ]


def _assumed(of: str, lines: Collection[str]) -> Iterator[str]:
    if lines:
        yield f"assumed, because {of} otherwise; compare it with the vendor's table:"
        yield from (f"  {line}" for line in lines)


def _assumed_of_lifts(loaded: LoadedSite) -> Iterator[str]:
    """Yield what is assumed of the lifts of a site, once for those of which it is the same."""
    lifts: dict[tuple[str, ...], list[str]] = {}
    for name, lift in loaded.site.lifts.items():
        controller = loaded.site.controllers[lift.controller]
        given = {key for key, value in controller if value is not None}
        given |= {"unit_id"} if lift.unit_id is not None else set()
        lifts.setdefault(assumptions(loaded.maps[name].map, given), []).append(name)
    for lines, names in lifts.items():
        yield from _assumed(f"neither the site nor the map of {', '.join(names)} says", lines)


def _lift_cautions(name: str, lift: Lift, source: RegisterMap) -> Iterator[str]:
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
    if uses_rmf_names(lift):
        yield from unheld_doors(name, lift, source)
    if lift.accept_latching is not None and any(c.on_link_loss == "latches" for c in source.commands.values()):
        yield f"{name}: outputs stay on when this manager is lost; accepted: {lift.accept_latching}"


def _api_caution(api: Api) -> str:
    if api.without_keys is not None:
        return (
            f"the API listens on {api.host}, and while this site has no keys anybody who reaches it can command the lifts;"
            f" accepted: {api.without_keys}"
        )
    clear = "" if api.tls is not None else ", and keys cross the network as they are, because `api` has no `tls`"
    return f"the API listens on {api.host}: every request needs a key (`lift-manager keys make`){clear}"


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def _map_text(source: RegisterMap) -> str:
    return f"map {source.name} ({source.provenance.trust})"
