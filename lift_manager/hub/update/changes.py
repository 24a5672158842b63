"""What an update changes at a site: what it must not, and which lifts are only watched until somebody has tested them again."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from lift_manager.commissioning.checkout.approval import find_approval
from lift_manager.commissioning.checkout.plan import lift_digest
from lift_manager.commissioning.checkout.record import Record
from lift_manager.config.check import canonical_host
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from lift_manager.hub.update.installed import Hold
from lift_manager.store.errors import StoreUnusable
from lift_manager.store.place import store_path


def own_files(loaded: LoadedSite) -> Iterator[tuple[str, str]]:
    """Yield key and path of each file that belongs to the computer of a site, and never comes with an update."""
    site = loaded.site
    if site.state is not None:
        yield "state", site.state
    if site.hub is not None:
        yield "hub.password", site.hub.password
    parts: dict[str, object] = {
        "api.tls": site.api.tls,
        **{f"controllers.{name}.tls": one.tls for name, one in site.controllers.items()},
    }
    if (cluster := site.cluster) is not None:
        parts["cluster.tls"] = cluster.tls
        programs = {controller: fence.command[0] for controller, fence in cluster.fence.items()}
        yield from ((f"cluster.fence.{name}.command", one) for name, one in programs.items() if os.sep in one)
    for place, part in parts.items():
        if part is not None:
            for key in ("certificate", "key", "ca", "client_ca"):
                if (file := getattr(part, key, None)) is not None:
                    yield f"{place}.{key}", file


def misplaced_files(loaded: LoadedSite) -> list[str]:
    """Return what keeps a site file from being part of an update: files of its computer that are not named by absolute paths."""
    return [
        f"{key}: {file!r} is a file of the site's own computer, and no update brings one: write its absolute path"
        for key, file in own_files(loaded)
        if not Path(file).expanduser().is_absolute()
    ]


def forbidden_changes(present: LoadedSite, other: LoadedSite) -> list[str]:
    """Return what no update may change: by which keys and at which hub the site takes updates, and where its state and journal are."""
    found = []
    if other.site.name != present.site.name:
        found.append(f"name: the journal and the state of the lifts belong to {present.site.name!r}")
    if other.site.hub != present.site.hub:
        found.append("hub: who may send updates is decided at the site")
    if other.site.cluster != present.site.cluster:
        found.append("cluster: it is decided at the site")
    if present.site.require_checkout and not other.site.require_checkout:
        found.append("require_checkout: only a person at the site may end it")
    if _store_of(other, present.path) != _store_of(present, present.path):
        found.append("state: the state of the lifts stays where it is")
    return [f"{text}; an update cannot change that" for text in found]


def changed_lifts(present: LoadedSite, other: LoadedSite) -> dict[str, str]:
    """Return the lifts of `other` whose map, floors, address or access are not those of `present`, with what is different."""
    found = {}
    for lift in other.site.lifts:
        if lift not in present.site.lifts:
            found[lift] = "the site: it is new"
        elif different := [what for what, of in _TESTED.items() if of(present, lift) != of(other, lift)]:
            found[lift] = f"its {' and its '.join(different)}"
    return found


def holds(present: LoadedSite, other: LoadedSite, number: int, held: Mapping[str, Hold]) -> dict[str, Hold]:
    """Return the lifts that are only watched under `other`; `held` are those under `present`."""
    store, commanded = _store_of(present, present.path), _commanded(other)
    kept = {lift: hold for lift, hold in still_held(present, held).items() if lift in commanded}
    return kept | {
        lift: Hold(why=f"update {number} changes {what}", number=number, tested=_tested(store, other, lift))
        for lift, what in changed_lifts(present, other).items()
        if lift in commanded
    }


def _commanded(loaded: LoadedSite) -> set[str]:
    """Return the lifts that robots may command by the site file; one that comes to be so later has changed its access."""
    return {name for name, lift in loaded.site.lifts.items() if lift.access == "control"}


def still_held(loaded: LoadedSite, held: Mapping[str, Hold]) -> dict[str, Hold]:
    """Return the lifts that nobody has tested since an update changed them: their test of that time, or none that fits, still counts."""
    store = _store_of(loaded, loaded.path)
    return {
        lift: hold
        for lift, hold in held.items()
        if lift in loaded.site.lifts and _tested(store, loaded, lift) in ("", hold.tested)
    }


def only_watched(loaded: LoadedSite, held: Mapping[str, Hold]) -> LoadedSite:
    """Return the site with these lifts at `access: monitor`."""
    lifts = {
        name: lift.model_copy(update={"access": "monitor"}) if name in held else lift
        for name, lift in loaded.site.lifts.items()
    }
    return replace(loaded, site=loaded.site.model_copy(update={"lifts": lifts}))


def _tested(store: Path | None, loaded: LoadedSite, lift: str) -> str:
    """Return what tells the test that lets robots use a lift from others, also from itself with more results; empty for none."""
    record: Record | None = None if store is None else find_approval(store, loaded, lift, datetime.now(UTC)).record
    return "" if record is None else f"{record.started_at.isoformat()}, {len(record.results)} results"


def _store_of(loaded: LoadedSite, site_file: Path) -> Path | None:
    try:
        return store_path(loaded.site.name, loaded.site.state, site_file, os.environ)
    except StoreUnusable:
        return None


def _map(loaded: LoadedSite, lift: str) -> object:
    return loaded.maps[lift].sha256


def _floors(loaded: LoadedSite, lift: str) -> object:
    return lift_digest(loaded, lift), list(loaded.site.lifts[lift].floors)


def _address(loaded: LoadedSite, lift: str) -> object:
    """Return where each device of a lift is."""
    found = {}
    for endpoint, device in devices(loaded.site, loaded.site.lifts[lift], loaded.maps[lift].map).items():
        place = loaded.site.controllers[device.controller]
        found[endpoint] = canonical_host(place.host), place.port, device.unit_id, place.tls
    return found


def _access(loaded: LoadedSite, lift: str) -> object:
    return loaded.site.lifts[lift].access


_TESTED = {"map": _map, "floors, doors or units": _floors, "address": _address, "access": _access}
"""What a test of a lift is about."""
