"""Finds what prevents a valid site file from being served on this computer, or should be known, for `serve` and `check`."""

from __future__ import annotations

import os
import shlex
import socket
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from lift_manager.commissioning.checkout.approval import Approval, find_approval
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Api
from lift_manager.config.tls import path_of
from lift_manager.lift.config import Checkout
from lift_manager.store.errors import KeysUnusable, StoreUnusable
from lift_manager.store.keys import keys_path, read_kept_keys
from lift_manager.store.place import store_path
from lift_manager.store.site import read_records_of_site
from lift_manager.web.errors import ListenError
from lift_manager.web.origin import is_loopback
from lift_manager.web.server import resolved
from register_maps.errors import Finding, MapFileError

if TYPE_CHECKING:
    from lift_manager.hub.update.installation import Installation
    from lift_manager.hub.update.installed import Hold

_OUTPUTS_MAY_BE_ON = "until the manager starts, nothing releases what an earlier one held: outputs may still be on at the lifts, so look at each of them"


def obstacles(loaded: LoadedSite) -> Iterator[Finding]:
    """Yield why this site cannot be served: problems of its certificates, address, store or keys. Changes nothing."""
    yield from loaded.unusable
    loaded = as_served(loaded)
    site, file = loaded.site, str(loaded.path)
    try:
        place = store_path(site.name, site.state, loaded.path, os.environ)
        read_records_of_site(place, site.name, site.lifts.keys())
        keys = read_kept_keys(keys_path(place), site.name).live
    except StoreUnusable as error:
        yield Finding(file, None, "", f"{error}; {_OUTPUTS_MAY_BE_ON}")
        return
    except KeysUnusable as error:
        yield Finding(file, None, "", str(error))
        return
    try:
        _, address = resolved(site.api.host, site.api.port)
    except ListenError as error:
        yield Finding(file, None, "api.host", str(error))
        return
    host = str(address[0])
    if not keys and not allows_requests_without_keys(site.api, host):
        yield Finding(file, None, "api.host", _key_advice(host, loaded.path))
    if site.require_checkout:
        for lift, approval in _approvals(loaded).items():
            if approval.problem:
                advice = f"{_test_advice(loaded.path, lift)}, or use `access: monitor` until then"
                message = f"{approval.problem}, and `require_checkout` keeps robots off a lift without one that counts: {advice}"
                yield Finding(file, None, f"lifts.{lift}", message)


def cautions(loaded: LoadedSite) -> Iterator[str]:
    """Yield what people should know of a site at every start, a line each."""
    yield from loaded.cautions()
    yield from _machine_cautions(loaded)
    yield from _hub_caution(loaded)
    held = _held(loaded)
    yield from _update_cautions(loaded, held)
    for lift, approval in _approvals(_with_held(loaded, held)).items():
        if approval.problem:
            yield f"{lift}: robots may use it, and {approval.problem}; {_test_advice(loaded.path, lift)}"
        yield from (f"{lift}: {caution}" for caution in approval.cautions)


def _machine_cautions(loaded: LoadedSite) -> Iterator[str]:
    """Yield what should be known of this computer, if it is one of the machines of a cluster."""
    if (cluster := loaded.site.cluster) is None or (cluster.machine or socket.gethostname()) not in cluster.machines:
        return
    from lift_manager.cluster.errors import ClusterUnusable  # noqa: PLC0415  a manager that is alone does not load these
    from lift_manager.cluster.kept_packets import kept_packets_cautions  # noqa: PLC0415
    from lift_manager.cluster.solo_file import SoloFile  # noqa: PLC0415

    try:
        solo = SoloFile(store_path(loaded.site.name, loaded.site.state, loaded.path, os.environ)).read()
    except StoreUnusable:
        solo = None  # an obstacle, which is reported as such
    except ClusterUnusable as error:
        yield f"cluster: {error}"
        solo = None
    if solo is not None:
        yield f"cluster: {solo.text}"
    yield from kept_packets_cautions(controller.host for controller in loaded.controllers.values())
    if cluster.packet_filter is not None and not path_of(loaded.path.parent, cluster.packet_filter).exists():
        yield (
            f"cluster: no packet filter listens at {cluster.packet_filter}, so this machine does not command the lifts; start"
            " lift-manager-packet-filter"
        )


def _hub_caution(loaded: LoadedSite) -> Iterator[str]:
    """Yield that commands through the hub need a key to be signed with."""
    site = loaded.site
    if site.hub is None or not site.hub.commands:
        return
    yield "the hub: whoever has a key of this site may command its lifts from anywhere; `hub: {commands: true}` says so"
    try:
        keys = read_kept_keys(keys_path(store_path(site.name, site.state, loaded.path, os.environ)), site.name).live
    except (StoreUnusable, KeysUnusable):
        return  # an obstacle, which is reported as such
    if not keys:
        yield "the hub: nobody can command a lift, because a command is signed with a key of this site, and there is none"


def installation_of(site_file: Path) -> Installation | None:
    """Return the folder of updates that a site file is in; None for one that is in none, and loads nothing of them."""
    if site_file.absolute().parent.name != "current":
        return None
    from lift_manager.hub.update.installation import Installation  # noqa: PLC0415

    return Installation.of(site_file)


def as_served(loaded: LoadedSite) -> LoadedSite:
    """Return the site with the lifts only watched that an update has changed, and that nobody has tested since."""
    return _with_held(loaded, _held(loaded))


def _with_held(loaded: LoadedSite, held: Mapping[str, Hold]) -> LoadedSite:
    """Return the site with these lifts only watched."""
    if not held:
        return loaded
    from lift_manager.hub.update.changes import only_watched  # noqa: PLC0415

    return only_watched(loaded, held)


def _held(loaded: LoadedSite) -> Mapping[str, Hold]:
    """Return the lifts that are only watched because of an update."""
    if (installation := installation_of(loaded.path)) is None:
        return {}
    from lift_manager.hub.errors import UpdateRefused  # noqa: PLC0415
    from lift_manager.hub.update.changes import still_held  # noqa: PLC0415

    try:
        held = installation.read().current.held
    except UpdateRefused as error:
        raise MapFileError([Finding(str(loaded.path), None, "", str(error))]) from error
    return still_held(loaded, held)


def _update_cautions(loaded: LoadedSite, held: Mapping[str, Hold]) -> Iterator[str]:
    for lift, hold in held.items():
        yield f"{lift}: is only watched, whatever the site file says, because {hold.why}; {_test_advice(loaded.path, lift)}"
    hub = loaded.site.hub
    if hub is not None and hub.updates and installation_of(loaded.path) is None:
        yield "the hub: no updates are taken, because this file is in no folder for them; `lift-manager hub update adopt` makes one"


def with_checkouts(loaded: LoadedSite) -> LoadedSite:
    """Return the site with the records that let robots use its lifts."""
    found = {lift: approval.record for lift, approval in _approvals(loaded).items()}
    return replace(
        loaded,
        checkouts={
            lift: Checkout(record.sha256, record.ended_at or record.started_at)
            for lift, record in found.items()
            if record is not None
        },
    )


def _approvals(loaded: LoadedSite) -> Mapping[str, Approval]:
    """Return what the records say about each lift that robots may command; none if there is no place for records."""
    site = loaded.site
    try:
        place = store_path(site.name, site.state, loaded.path, os.environ)
    except StoreUnusable:
        return {}
    commanded = (name for name, lift in site.lifts.items() if lift.access == "control")
    return {lift: find_approval(place, loaded, lift, datetime.now(UTC)) for lift in commanded}


def _test_advice(site_file: Path, lift: str) -> str:
    return f"test and sign it with `lift-manager checkout {shlex.quote(str(site_file))} {lift}`"


def allows_requests_without_keys(api: Api, host: str) -> bool:
    """Whether requests are accepted at this address while the site has no key."""
    return is_loopback(host) or api.without_keys is not None


def _key_advice(host: str, site_file: Path) -> str:
    return (
        f"others can reach {host}, and there is no key to identify callers: make one with `lift-manager keys make {site_file}"
        " --name NAME --role ROLE`, or listen on 127.0.0.1, or give the reason why none is needed in the site file,"
        " with `api: {without_keys: ...}`"
    )
