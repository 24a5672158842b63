"""Where the devices of a lift are, and what the links to them have to respect. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lift_manager.config.site import Controller, Lift, Site
from register_maps.schema import LinkDefaults, RegisterMap

POLL_S = 0.2
"""From one poll to the next where nothing asks for more. Chosen: five readings in the second after which a reading counts no more."""

POLL_RIDDEN_S = 0.05
"""The same while a session has the lift. Chosen: two scans of a slow controller, and four times its usual round trip."""

_SITE_SETTINGS = (
    "timeout_s",
    "min_gap_s",
    "reconnect_min_s",
    "idle_timeout_s",
    "max_registers_per_read",
    "max_bits_per_read",
    "tid_echo",
)


@dataclass(frozen=True, slots=True)
class Device:
    """One device: the name of its controller entry and its unit id there."""

    controller: str
    unit_id: int


def devices(site: Site, lift: Lift, source: RegisterMap) -> dict[str, Device]:
    """Return each device of a lift by endpoint; its own controller goes by the empty name.

    Endpoints that the site has not placed, or on no controller of its own, are left out.
    """
    placed = {
        "": Device(lift.controller, _unit_id(lift.unit_id, site.controllers[lift.controller], source.unit_of("")))
    }
    for name in source.endpoints:
        place = lift.endpoints.get(name)
        if place is not None and place.controller in site.controllers:
            unit = _unit_id(place.unit_id, site.controllers[place.controller], source.unit_of(name))
            placed[name] = Device(place.controller, unit)
    return placed


def links(site: Site, maps: Mapping[str, RegisterMap], spare: Mapping[str, RegisterMap]) -> dict[str, LinkDefaults]:
    """Return what each controller's link has to respect: the strictest of its lifts' maps, under what the site says.

    `maps` are by lift; `spare` by controller, for those that only serve endpoints.
    """
    needs: dict[str, list[LinkDefaults]] = {}
    for lift, spec in site.lifts.items():
        if lift in maps:
            needs.setdefault(spec.controller, []).append(maps[lift].link)
    found: dict[str, LinkDefaults] = {}
    shared: dict[LinkDefaults, LinkDefaults] = {}
    for name, controller in site.controllers.items():
        here = needs.get(name) or ([spare[name].link] if name in spare else [])
        said = {key: getattr(controller, key) for key in _SITE_SETTINGS if getattr(controller, key) is not None}
        limits = strictest_needs(here).model_copy(update=said)
        found[name] = shared.setdefault(limits, limits)  # one for all controllers that are alike: it takes a KB
    return found


def strictest_needs(needs: Iterable[LinkDefaults]) -> LinkDefaults:
    """Return what satisfies all of these devices at once; the defaults where there is none. Unit ids are the first one's."""
    every = list(needs) or [LinkDefaults()]
    slots = [link.max_connections for link in every if link.max_connections is not None]
    silences_s = [link.idle_timeout_s for link in every if link.idle_timeout_s is not None]
    return every[0].model_copy(
        update={
            **{key: max(getattr(link, key) for link in every) for key in _MOST},
            **{key: min(getattr(link, key) for link in every) for key in _LEAST},
            "tid_echo": all(link.tid_echo for link in every),
            "max_connections": min(slots, default=None),
            "idle_timeout_s": min(silences_s, default=None),
        }
    )


def least_poll_s(used: Iterable[Device], needs: Mapping[str, LinkDefaults]) -> float:
    """Return the shortest time between polls that all devices of a lift allow."""
    return max(needs[device.controller].min_poll_s for device in used)


_MOST = ("timeout_s", "min_gap_s", "min_poll_s", "reconnect_min_s")
_LEAST = (
    *("max_registers_per_read", "max_bits_per_read", "max_registers_per_write", "max_bits_per_write"),
    "max_age_s",
)


def _unit_id(unit_id: int | None, controller: Controller, default: int) -> int:
    return next(unit for unit in (unit_id, controller.unit_id, default) if unit is not None)
