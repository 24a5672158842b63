"""Checks the `cluster` of a site file, and says what people should know of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from enum import StrEnum, unique
from ipaddress import ip_address
from pathlib import Path
from shutil import which
from urllib.parse import urlsplit

from lift_manager.config.devices import devices
from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Cluster, Site
from register_maps.schema import RegisterMap

MOST_LIFTS = 100
"""etcd takes 128 operations in one transaction (`--max-txn-ops`), and a commit may concern every lift."""


def check_cluster(site: Site, maps: Mapping[str, RegisterMap]) -> Iterator[Problem]:
    """Yield every problem of a cluster; none without one. `maps` are by lift, as far as they could be read."""
    if (cluster := site.cluster) is None:
        return
    key: Key = ("cluster",)
    if len(cluster.machines) != 2:
        yield Problem((*key, "machines"), f"a cluster has two machines, and there are {len(cluster.machines)}")
    addresses = [machine.address for machine in cluster.machines.values()]
    if len(set(addresses)) < len(addresses):
        yield Problem((*key, "machines"), "the machines have one address; give that of each, not one that they share")
    if cluster.machine is not None and cluster.machine not in cluster.machines:
        yield Problem((*key, "machine"), f"is none of the machines {', '.join(cluster.machines)}")
    if len(set(cluster.etcd)) < len(cluster.etcd):
        yield Problem((*key, "etcd"), "names a member twice")
    yield from _check_tls(key, cluster)
    if len(site.lifts) > MOST_LIFTS:
        message = f"serves {MOST_LIFTS} lifts at most, and there are {len(site.lifts)}; divide the controllers between two sites"
        yield Problem(key, message)
    yield from _check_names(key, site, cluster)
    for name, source in maps.items():
        latching = [command for command, spec in source.commands.items() if spec.on_link_loss == "latches"]
        is_closed = fence_of(site, name, source) in CLOSED or name in cluster.accept_latching
        if site.lifts[name].access == "control" and latching and not is_closed:
            message = (
                f"{', '.join(latching)} of {source.name} stay on until something lets them go, and a write of a manager that was just"
                " replaced may still arrive, which the controller cannot tell from one of its successor; close the way to it with"
                f" `cluster: {{fence: {{{site.lifts[name].controller}: ...}}}}`, say why that is acceptable here with `cluster:"
                f" {{accept_latching: {{{name}: ...}}}}`, or use `access: monitor`"
            )
            yield Problem(("lifts", name, "access"), message)


def _check_names(key: Key, site: Site, cluster: Cluster) -> Iterator[Problem]:
    for controller in cluster.fence.keys() - site.controllers.keys():
        message = f"there is no such controller; the controllers are {', '.join(site.controllers)}"
        yield Problem((*key, "fence", controller), message)
    for name, device in site.controllers.items():
        if cluster.packet_filter is not None and not _is_address(device.host):
            message = "is a name, and the packet filter of the cluster goes by addresses: write the address"
            yield Problem(("controllers", name, "host"), message)
    for lift in cluster.accept_latching.keys() - site.lifts.keys():
        yield Problem((*key, "accept_latching", lift), f"there is no such lift; the lifts are {', '.join(site.lifts)}")


@unique
class Kept(StrEnum):
    """What keeps a late write of a manager that was just replaced from a lift: the first that applies."""

    BY_CONTROLLER = "the controller itself, which obeys the manager of the highest epoch"
    BY_COMMAND = "a command of the site, which closes the way of the other machine"
    BY_FILTER = "the packet filter of its machine, unless it has left that already"
    BY_ACCEPTANCE = "nothing, which was accepted"
    BY_NOTHING = "nothing"


CLOSED = (Kept.BY_CONTROLLER, Kept.BY_COMMAND)
"""These leave nothing open."""


def fence_of(site: Site, name: str, source: RegisterMap) -> Kept:
    """Return what keeps late writes from a lift that is commanded in a cluster."""
    cluster, lift = site.cluster, site.lifts[name]
    if cluster is None:
        raise ValueError(f"{site.name} has no cluster")
    if source.arbitration is not None:
        return Kept.BY_CONTROLLER
    placed = devices(site, lift, source)
    written = {source.place(text).endpoint for command in source.commands.values() for text in command.addresses}
    if {placed[endpoint].controller for endpoint in written if endpoint in placed} <= cluster.fence.keys():
        return Kept.BY_COMMAND
    if cluster.packet_filter is not None:
        return Kept.BY_FILTER
    return Kept.BY_ACCEPTANCE if name in cluster.accept_latching else Kept.BY_NOTHING


def fence_lines(site: Site, maps: Mapping[str, RegisterMap]) -> Iterator[str]:
    """Yield a line for each lift that is commanded in a cluster: what keeps late writes from it."""
    if site.cluster is None:
        return
    for name, source in maps.items():
        if site.lifts[name].access == "control":
            yield f"{name}: a late write of a manager that was just replaced is kept away by {fence_of(site, name, source)}"


def _check_tls(key: Key, cluster: Cluster) -> Iterator[Problem]:
    schemes = {urlsplit(member).scheme for member in cluster.etcd}
    if len(schemes) > 1:
        yield Problem((*key, "etcd"), "some members have https and some http; use https for all of them")
    elif schemes == {"https"} and cluster.tls is None:
        yield Problem((*key, "tls"), "is missing: https needs the CA of the members, and a certificate of this machine")
    elif schemes == {"http"} and cluster.tls is not None:
        yield Problem((*key, "etcd"), "there is `tls`, and the members have http; write https")


def _etcd_cautions(cluster: Cluster) -> Iterator[str]:
    if len(cluster.etcd) < 3:
        yield (
            f"cluster: etcd has {len(cluster.etcd)} member{'s' * (len(cluster.etcd) > 1)}, so the loss of one stops both managers;"
            " run three, one of them on a third machine"
        )
    elif len(cluster.etcd) % 2 == 0:
        yield f"cluster: etcd has {len(cluster.etcd)} members, of which no more may fail than of {len(cluster.etcd) - 1}"
    named = [member for member in cluster.etcd if not _has_address(urlsplit(member).hostname or "")]
    if named:
        yield f"cluster: {', '.join(named)} has a name and no address: a name server that is silent would cost the term"
    if cluster.tls is None and not all(urlsplit(member).hostname in ("127.0.0.1", "::1") for member in cluster.etcd):
        yield "cluster: etcd is used without TLS: who reaches it can command the lifts, and change what the managers remember"


def _has_address(host: str) -> bool:
    return host == "localhost" or _is_address(host)


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def cluster_cautions(site: Site, maps: Mapping[str, RegisterMap], folder: Path) -> Iterator[str]:
    """Yield what people should know of a cluster, a line each; `folder` is that of the site file."""
    if (cluster := site.cluster) is None:
        return
    yield from _etcd_cautions(cluster)
    for what in ("switch", "supply"):
        names = [getattr(machine, what) for machine in cluster.machines.values()]
        if None in names:
            yield f"cluster: the site file does not say on which {what} each machine is; if it is one, both are lost with it"
        elif len(set(names)) < len(names):
            yield f"cluster: both machines are on the {what} {names[0]}, and are lost with it"
    for controller, fence in cluster.fence.items():
        # with a folder in it, a name is looked for from where the command runs
        program = str(folder / fence.command[0]) if os.sep in fence.command[0] else fence.command[0]
        if which(program) is None:
            yield f"{controller}: {fence.command[0]}, which closes its fence, is no program on this computer: without it its lifts stay offline"
    kept = {name: fence_of(site, name, source) for name, source in maps.items() if site.lifts[name].access == "control"}
    for lift, reason in cluster.accept_latching.items():
        if lift in kept and kept[lift] not in CLOSED:
            yield f"{lift}: a write of a manager that was just replaced may put an output on for good; accepted: {reason}"
    watched = [name for name, by in kept.items() if by not in CLOSED and name not in cluster.accept_latching]
    if watched:
        yield (
            f"{', '.join(watched)}: a write of a manager that was just replaced may still arrive; what it puts on, the controller"
            " itself takes off again"
        )
