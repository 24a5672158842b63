"""What a site file says about its cluster: which machine this is, and how to reach etcd."""

from __future__ import annotations

import socket
import ssl
from pathlib import Path

from lift_manager.cluster.errors import ClusterUnusable
from lift_manager.cluster.etcd import Etcd
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Cluster
from lift_manager.config.tls import path_of


def cluster_of(loaded: LoadedSite) -> Cluster:
    """Return the cluster of a site. Raises ClusterUnusable for a site without one."""
    if loaded.site.cluster is None:
        raise ClusterUnusable(f"{loaded.path} has no `cluster`: its manager is alone")
    return loaded.site.cluster


def machine_of(cluster: Cluster) -> str:
    """Return the name of this machine. Raises ClusterUnusable if it is none of the cluster."""
    name = cluster.machine or socket.gethostname()
    if name not in cluster.machines:
        raise ClusterUnusable(
            f"this machine is called {name!r}, and the machines of the cluster are {', '.join(cluster.machines)}; give the one that"
            " this is as `cluster: {machine: ...}`, or with --machine"
        )
    return name


def etcd_of(cluster: Cluster, folder: Path, *, timeout_s: float) -> Etcd:
    """Return a client for the members; `folder` is that of the site file. Raises ClusterUnusable."""
    return Etcd(cluster.etcd, tls=_context(cluster, folder), timeout_s=timeout_s)


def _context(cluster: Cluster, folder: Path) -> ssl.SSLContext | None:
    if (tls := cluster.tls) is None:
        return None
    try:
        context = ssl.create_default_context(cafile=path_of(folder, tls.ca))
        context.load_cert_chain(path_of(folder, tls.certificate), path_of(folder, tls.key))
    except OSError as error:
        raise ClusterUnusable(f"the files of `cluster: tls` cannot be used ({error})") from error
    return context
