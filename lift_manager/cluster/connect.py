"""What a site file says about its cluster: which machine this is, and how to reach etcd."""

from __future__ import annotations

import socket
from pathlib import Path

from lift_manager.cluster.certificates import EtcdCertificates, TlsFiles
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


def etcd_of(
    cluster: Cluster, certificates: EtcdCertificates | None, *, timeout_s: float, connect_s: float | None = None
) -> Etcd:
    """Return a client for the members; the times are as in `Etcd`."""
    tls = None if certificates is None else certificates.latest
    return Etcd(cluster.etcd, tls=tls, timeout_s=timeout_s, connect_s=connect_s)


def members_of(cluster: Cluster, certificates: EtcdCertificates | None, *, timeout_s: float) -> list[Etcd]:
    """Return a client for each member alone."""
    return [
        etcd_of(cluster.model_copy(update={"etcd": (member,)}), certificates, timeout_s=timeout_s)
        for member in cluster.etcd
    ]


def other_than(cluster: Cluster, machine: str) -> str:
    """Return the name of the other machine."""
    return next(name for name in cluster.machines if name != machine)


def certificates_of(cluster: Cluster, folder: Path) -> EtcdCertificates | None:
    """Return the certificates for etcd; None without TLS. `folder` is that of the site file. Raises ClusterUnusable."""
    if (tls := cluster.tls) is None:
        return None
    files = TlsFiles(path_of(folder, tls.ca), path_of(folder, tls.certificate), path_of(folder, tls.key))
    return EtcdCertificates(cluster.etcd, files)
