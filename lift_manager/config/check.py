"""Checks a site file across its keys and the maps that it names, and returns every problem at once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from lift_manager.config.check_cluster import check_cluster
from lift_manager.config.check_devices import check_devices
from lift_manager.config.check_floors import check_floors
from lift_manager.config.check_outputs import check_outputs
from lift_manager.config.check_rmf import check_rmf
from lift_manager.config.check_use import check_unset, check_use
from lift_manager.config.devices import POLL_S, devices, least_poll_s, links
from lift_manager.config.maps import compile_maps
from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift, Site
from lift_manager.lift.config import CLEARS_IN_A_LIMIT, LIFT_NAME
from register_maps.load import LoadedMap
from register_maps.schema import LinkDefaults, RegisterMap


def check_site(
    site: Site,
    maps: Mapping[str, LoadedMap],
    unchanged: Mapping[str, LoadedMap],
    spare: Mapping[str, LoadedMap],
    *,
    for_rmf: bool = False,
) -> list[Problem]:
    """Return every problem. `maps` are by lift, as far as they could be read; `for_rmf` assumes use with RMF, whatever the file says.

    `unchanged` has the maps of lifts whose changes have mistakes, without the changes; `spare` has the maps of controllers without a
    lift. Lifts on an unknown controller are skipped: `check_references` finds them in the raw file.
    """
    problems = [*_check_controllers(site), *_check_names(site), *check_rmf(site)]
    plain_maps = {name: loaded.map for name, loaded in maps.items()}
    needs = links(site, plain_maps, {name: loaded.map for name, loaded in spare.items()})
    known = {name: lift for name, lift in site.lifts.items() if lift.controller in site.controllers}
    codecs = compile_maps(site, {name: plain_maps[name] for name in known if name in plain_maps})
    for name, lift in known.items():
        key: Key = ("lifts", name)
        if (loaded := maps.get(name) or unchanged.get(name)) is not None:
            problems += check_unset(key, lift, loaded)
        if name in plain_maps:
            problems += check_devices(key, lift, codecs[name])
            problems += check_floors(key, lift, codecs[name])
            problems += check_use(key, lift, plain_maps[name])
            problems += _check_timing(key, site, lift, plain_maps[name], needs)
        problems += _check_clear_times(key, site, lift, plain_maps.get(name), for_rmf=for_rmf)
    problems += _check_silence(site, {name: plain_maps[name] for name in known if name in plain_maps}, needs)
    problems += check_outputs(site, {name: maps[name] for name in known if name in maps})
    problems += check_cluster(site, {name: plain_maps[name] for name in known if name in plain_maps})
    return problems


def canonical_host(host: str) -> str:
    """Return the canonical spelling of a host, so that one controller is not counted as two."""
    host = host.lower().strip("[]")
    return "127.0.0.1" if host == "localhost" else host


def _check_controllers(site: Site) -> Iterator[Problem]:
    taken: dict[tuple[str, int], str] = {}
    for name, controller in site.controllers.items():
        address = (canonical_host(controller.host), controller.port)
        if address in taken:
            message = (
                f"{controller.host}:{controller.port} is controller {taken[address]!r} already; lifts share one entry"
            )
            yield Problem(("controllers", name, "port"), message)
        taken.setdefault(address, name)


def _check_names(site: Site) -> Iterator[Problem]:
    for name in site.lifts:
        if not re.fullmatch(LIFT_NAME, name):
            message = (
                "the name of a lift has 1 to 64 characters: letters from A to Z and a to z, digits, `-`, `_` and `.`, and begins with a"
                " letter, a digit or `_`; give it such a name, and write what people call it as its `display_name`"
            )
            yield Problem(("lifts", name), message)


def _check_clear_times(
    key: Key, site: Site, lift: Lift, source: RegisterMap | None, *, for_rmf: bool
) -> Iterator[Problem]:
    """Yield time limits, of the site or of the controller, that leave robots too little time before OPEN is withdrawn."""
    uses_rmf = for_rmf or bool(site.rmf.model_fields_set or lift.rmf.model_fields_set)
    of_rmf = ("rmf.clear_s", site.rmf.clear_s if uses_rmf else 0.0)
    longest = max(("clear_s", lift.clear_s), of_rmf, key=lambda one: one[1])
    limits = {"lease_s": ("clear_s", lift.clear_s), "max_session_hold_s": longest, "max_session_s": longest}
    for name, (clearing, clear_s) in limits.items():
        value, least_s = getattr(lift, name), CLEARS_IN_A_LIMIT * clear_s
        if value < least_s:
            message = (
                f"{value:g} s is less than {CLEARS_IN_A_LIMIT} times `{clearing}` ({clear_s:g} s), so robots would hardly see the"
                f" door open before it is announced to be released; set `{name}` to {least_s:g} or more, or lower `{clearing}`"
            )
            yield Problem((*key, name), message)
    if source is not None and lift.access == "control":
        yield from _check_released_holds(key, source, *longest)


def _check_released_holds(key: Key, source: RegisterMap, clearing: str, clear_s: float) -> Iterator[Problem]:
    """Yield door holds that the controller releases too soon for robots."""
    for name, command in source.commands.items():
        released_after_s = command.released_after_s
        if released_after_s is not None and released_after_s < CLEARS_IN_A_LIMIT * clear_s:
            message = (
                f"the controller releases {name} after {released_after_s:g} s (`released_after_s` in {source.name}), which is less than"
                f" {CLEARS_IN_A_LIMIT} times `{clearing}` ({clear_s:g} s), so robots would hardly see the door open before it is announced"
                f" to be released; lower `{clearing}` to {released_after_s / CLEARS_IN_A_LIMIT:.3g} or less, or have the controller hold"
                " the door longer"
            )
            yield Problem((*key, "map"), message)


def _check_timing(
    key: Key, site: Site, lift: Lift, source: RegisterMap, needs: Mapping[str, LinkDefaults]
) -> Iterator[Problem]:
    used = devices(site, lift, source)
    max_age_s = lift.max_age_s or source.link.max_age_s
    least_s = least_poll_s(used.values(), needs)
    poll_s = _poll_s(lift, least_s)
    if poll_s < least_s:
        message = f"a poll every {poll_s:g} s is faster than the controller takes it: {least_s:g} s is the least (min_poll_s); leave `poll_s` out"
        yield Problem((*key, "poll_s"), message)
    ridden_s = poll_s if lift.poll_ridden_s is None else lift.poll_ridden_s
    if ridden_s < least_s <= poll_s:
        message = f"a poll every {ridden_s:g} s is faster than the controller takes it: {least_s:g} s is the least (min_poll_s); leave `poll_ridden_s` out"
        yield Problem((*key, "poll_ridden_s"), message)
    if ridden_s > poll_s:
        message = f"a lift that a session has is polled every {ridden_s:g} s, less often than at rest (poll_s {poll_s:g}): leave `poll_ridden_s` out"
        yield Problem((*key, "poll_ridden_s"), message)
    if poll_s * 2 > max_age_s:
        message = f"a poll every {poll_s:g} s is too slow for max_age_s {max_age_s:g}: one lost poll would take the lift offline"
        yield Problem((*key, "max_age_s" if lift.poll_s is None and lift.max_age_s is not None else "poll_s"), message)
    for endpoint, device in used.items():
        timeout_s = needs[device.controller].timeout_s
        if timeout_s > max_age_s:
            message = f"timeout_s {timeout_s:g} of its controller is above max_age_s {max_age_s:g}: one late answer would take the lift offline"
            yield Problem((*key, *(("endpoints", endpoint) if endpoint else ()), "controller"), message)


def _check_silence(site: Site, maps: Mapping[str, RegisterMap], needs: Mapping[str, LinkDefaults]) -> Iterator[Problem]:
    """Yield controllers that would close a connection between two polls, however many lifts are polled over it."""
    polls: dict[str, list[tuple[float, str]]] = {}
    for name, source in maps.items():
        used = devices(site, site.lifts[name], source).values()
        poll_s = _poll_s(site.lifts[name], least_poll_s(used, needs))
        for controller in {device.controller for device in used}:
            polls.setdefault(controller, []).append((poll_s, name))
    for controller, found in polls.items():
        (poll_s, name), link = min(found), needs[controller]
        silence_s, limit_s = link.silence_s(poll_s), link.idle_timeout_s
        if limit_s is None or silence_s < limit_s:
            continue
        most_s = limit_s - link.timeout_s
        cure = (
            f"set `poll_s` below {most_s:g}"
            if most_s > link.min_poll_s
            else "give the controller a shorter `timeout_s`"
        )
        message = (
            f"a poll every {poll_s:g} s leaves the connection to {controller} silent for {silence_s:g} s when an answer is missing"
            f" (timeout_s {link.timeout_s:g}), and the controller closes it, or forgets its client, after {limit_s:g} s (idle_timeout_s);"
            f" {cure}, or raise that limit in the controller's own settings"
        )
        yield Problem(("lifts", name, "poll_s"), message)


def _poll_s(lift: Lift, least_s: float) -> float:
    return max(POLL_S, least_s) if lift.poll_s is None else lift.poll_s
