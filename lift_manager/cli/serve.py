"""`lift-manager serve`: open the store of a site, and run its manager."""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import Callable
from dataclasses import dataclass
from socket import socket
from typing import Annotated

import typer

from drivers.errors import ControllerTaken, LockUnusable
from lift_manager import app as running
from lift_manager import takeover as running_in_cluster
from lift_manager.cli.common import (
    SiteFile,
    fail,
    load_site_or_exit,
    open_store_or_exit,
    out,
    print_lines,
    report_mistakes,
    store_path_of,
)
from lift_manager.cli.logs import LogFormat, LogOption, log_to_stderr
from lift_manager.cli.loop import run
from lift_manager.cli.rmf_options import describe_rmf, report_join_failure, settings_of_site
from lift_manager.cli.serve_checks import allows_requests_without_keys, cautions, obstacles, with_checkouts
from lift_manager.cluster.connect import cluster_of, machine_of
from lift_manager.cluster.errors import ClusterError
from lift_manager.config.load import LoadedSite
from lift_manager.plain.signals import remember_sigterm, stop_on_signals
from lift_manager.plain.text import counted
from lift_manager.rmf.dds import DdsError
from lift_manager.rmf.ros_settings import RosSettings
from lift_manager.store.committer import Committer
from lift_manager.store.errors import StoreError
from lift_manager.store.keys import KeyFile, keys_path
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_copy
from lift_manager.web.errors import ListenError
from lift_manager.web.limits import raise_file_limit
from lift_manager.web.server import listen
from register_maps.errors import MapFileError

_log = logging.getLogger("lift_manager")


NO_WORKERS = (
    "a site is served by one process, because a lift has one holder and its controller takes one connection; one process polls 1,000"
    " lifts ten times a second. For more, divide the controllers between two site files, and run a manager for each of them, on a port"
    " of its own"
)
"""Web servers offer `--workers`, so people try it."""


Machine = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="In a cluster: which machine this is, instead of the host name."),
]


@dataclass(frozen=True, slots=True)
class Stores:
    """The files of a site on the disk."""

    committer: Committer | running_in_cluster.ThisMachine
    """In a cluster records and journal are in etcd, and copied to this machine."""
    keys: KeyFile


def serve(
    site: SiteFile,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Listen here instead of the site file's port.")
    ] = None,
    *,
    rmf: Annotated[
        bool,
        typer.Option("--rmf", help="Also run the Open-RMF lift adapter of these lifts, with `rmf` of the site file."),
    ] = False,
    machine: Machine = None,
    log_format: LogOption = LogFormat.HUMAN,
    workers: Annotated[int | None, typer.Option(hidden=True)] = None,
) -> None:
    """Run the lift manager for a site.

    Ctrl-C or SIGTERM releases everything, and then ends it.

    Example: lift-manager serve site.yaml
    """
    if workers is not None:
        raise typer.BadParameter(NO_WORKERS, param_hint="--workers")
    stopped_early = remember_sigterm()
    log_to_stderr(log_format)
    raise_file_limit()
    loaded = load_site_or_exit(site, for_rmf=rmf)
    if loaded.unusable:
        raise report_mistakes(MapFileError(loaded.unusable))
    for obstacle in obstacles(loaded):
        raise fail(obstacle.message)
    for line in cautions(loaded):
        _log.warning("%s", line)
    loaded = with_checkouts(loaded)
    settings = settings_of_site(loaded.site.rmf) if rmf else None
    api = loaded.site.api
    committer = open_store_or_exit(loaded) if loaded.site.cluster is None else _machine(loaded, machine)
    try:
        sock = listen(api.host, api.port if port is None else port)
    except ListenError as error:
        raise fail(str(error)) from error
    with sock:
        stores = Stores(committer, _keys(loaded, sock))
        try:
            serving = _serve(loaded, sock, stores, settings, stopped_early)
            released = run(serving, sends_at_once=loaded.site.cluster is not None)
        except* DdsError as group:
            raise report_join_failure(group.exceptions[0]) from group
        except* (ControllerTaken, LockUnusable, ListenError, ClusterError) as group:
            raise fail(str(group.exceptions[0])) from group
    if not released:
        raise typer.Exit(1)


def _machine(loaded: LoadedSite, name: str | None) -> running_in_cluster.ThisMachine:
    """Open the copy of the store on this machine, or report why it cannot be used and exit with 1."""
    cluster, journal = cluster_of(loaded), loaded.site.journal
    try:
        machine = machine_of(cluster if name is None else cluster.model_copy(update={"machine": name}))
        disk = open_copy(store_path_of(loaded), loaded.site.name, Limits(journal.keep_days, journal.max_mb))
    except (ClusterError, StoreError) as error:
        raise fail(str(error)) from error
    return running_in_cluster.ThisMachine(machine, disk)


def _keys(loaded: LoadedSite, sock: socket) -> KeyFile:
    """Read the keys of a site, or report why they cannot be used and exit with 1."""
    site, host = loaded.site, sock.getsockname()[0]
    path = keys_path(store_path_of(loaded))
    try:
        keys = KeyFile(path, site.name, open_without_keys=allows_requests_without_keys(site.api, host))
    except StoreError as error:
        raise fail(str(error)) from error
    live = (
        f"every request needs one of {counted(len(keys.names), 'key')}"
        if keys.names
        else "there are none, so no request needs one"
    )
    _log.info("keys: %s; they are kept in %s", live, path)
    return keys


async def _serve(
    loaded: LoadedSite, sock: socket, stores: Stores, rmf: RosSettings | None, stopped_early: Callable[[], bool]
) -> bool:
    stop = asyncio.Event()
    stop_on_signals(stop)
    if stopped_early():
        # an earlier manager may have left outputs on: they are released before this one ends
        stop.set()
    host, port = sock.getsockname()[:2]
    scheme = "http" if loaded.site.api.tls is None else "https"

    def ready() -> None:
        gc.freeze()  # a full collection of all that lives as long as the process would stop every lift for a tenth of a second
        where = f"{scheme}://{host}:{port}/docs"
        out.print(f"{loaded.site.name}: {counted(len(loaded.site.lifts), 'lift')} on {where}", highlight=False)
        if rmf is not None:
            print_lines([f"Open-RMF lift adapter: {describe_rmf(rmf)}"])

    faces = running.Faces(stores.keys, rmf)
    if isinstance(stores.committer, running_in_cluster.ThisMachine):
        return await running_in_cluster.run_in_cluster(
            loaded, sock, stores.committer, stop=stop, ready=ready, faces=faces
        )
    return await running.run(loaded, sock, stop=stop, ready=ready, recorder=stores.committer, faces=faces)
