"""Keeps tools that talk to a controller themselves off it while a machine of the site's cluster commands the lifts."""

from __future__ import annotations

from typing import Annotated

import typer

from lift_manager.cli.common import fail, store_path_of
from lift_manager.config.load import LoadedSite
from lift_manager.config.tls import path_of

ANSWER_S = 2.0
"""How long a member of etcd may take. Chosen: it answers in milliseconds, and a person waits."""

WithoutEtcd = Annotated[
    bool,
    typer.Option(
        "--without-etcd",
        help="In a cluster whose etcd does not answer: no manager of the site is active; you have looked at both machines.",
    ),
]


def require_no_active_machine(loaded: LoadedSite, *, without_etcd: bool) -> None:
    """Report `active_machine_problem`, if there is one, and exit with 1."""
    if problem := active_machine_problem(loaded, without_etcd=without_etcd):
        raise fail(problem)


def active_machine_problem(loaded: LoadedSite, *, without_etcd: bool) -> str:
    """Return in words why a tool must not talk to the controllers of a site now; empty if no machine of its cluster is active.

    A manager of this computer keeps a tool off by a lock. One on the other machine shows in etcd alone; finding that none is active takes
    as long as a takeover where one was active last.
    """
    if (cluster := loaded.site.cluster) is None:
        return ""
    # a site without a cluster does not load what talks to etcd
    from lift_manager.cluster import operations  # noqa: PLC0415
    from lift_manager.cluster.connect import certificates_of, etcd_of  # noqa: PLC0415
    from lift_manager.cluster.content import Place  # noqa: PLC0415
    from lift_manager.cluster.errors import ClusterError  # noqa: PLC0415
    from lift_manager.cluster.solo_file import SoloFile  # noqa: PLC0415

    try:
        if SoloFile(store_path_of(loaded)).read() is not None:
            return packet_filter_problem(loaded)  # the machine that goes on alone is this one
        etcd = etcd_of(cluster, certificates_of(cluster, loaded.path.parent), timeout_s=ANSWER_S)
        try:
            active = operations.find_active(etcd, Place(loaded.site.name))
        finally:
            etcd.close()
    except ClusterError as error:
        if without_etcd:
            return packet_filter_problem(loaded)
        return (
            f"a machine of the cluster may be active, and cannot be found out: {error}. Nothing was sent. If no manager of the site is active,"
            " say so with --without-etcd"
        )
    if not active:
        return packet_filter_problem(loaded)
    return (
        f"{active}, so nothing else may talk to the controllers of this site; nothing was sent. End both managers first; what goes through a"
        " running manager needs its address with --manager, and no site file"
    )


def packet_filter_problem(loaded: LoadedSite) -> str:
    """Return in words that the packet filter of this machine keeps tools off the controllers of a site; empty if it does not."""
    cluster = loaded.site.cluster
    if cluster is None or cluster.packet_filter is None:
        return ""
    # the file of its socket is there from before the filter until after its removal
    if not path_of(loaded.path.parent, cluster.packet_filter).exists():
        return ""
    return (
        "the packet filter of this machine lets only a manager with a term reach the controllers; nothing was sent. Once no manager of the site"
        f" runs, end lift-manager-packet-filter and remove the filter: lift-manager cluster packet-filter {loaded.path} --remove"
    )
