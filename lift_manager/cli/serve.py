"""`lift-manager serve`: open the store of a site, and run its manager."""

from __future__ import annotations

import asyncio
import gc
import logging
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from socket import socket
from typing import TYPE_CHECKING, Annotated, Protocol

import typer

from drivers.errors import ControllerTaken, LockUnusable
from lift_manager import app as running
from lift_manager.cli.common import (
    Machine,
    SiteFile,
    fail,
    load_site_or_exit,
    on_machine,
    open_store_or_exit,
    out,
    print_lines,
    print_stderr,
    report_mistakes,
    store_path_of,
)
from lift_manager.cli.logs import LogFormat, LogOption, log_to_stderr
from lift_manager.cli.loop import run
from lift_manager.cli.rmf_options import describe_rmf, report_join_failure, settings_of_site
from lift_manager.cli.serve_checks import (
    allows_requests_without_keys,
    as_served,
    cautions,
    installation_of,
    obstacles,
    with_checkouts,
)
from lift_manager.cluster.errors import ClusterError
from lift_manager.config.hub import hub_password
from lift_manager.config.load import LoadedSite
from lift_manager.plain.signals import remember_sigterm, stop_on_signals
from lift_manager.plain.text import counted
from lift_manager.rmf.dds import DdsError
from lift_manager.store.errors import StoreError
from lift_manager.store.keys import KeyFile, keys_path
from lift_manager.web.errors import ListenError
from lift_manager.web.limits import raise_file_limit
from lift_manager.web.server import listen
from register_maps.errors import MapFileError

if TYPE_CHECKING:
    from lift_manager.hub.site_face import HubSettings
    from lift_manager.hub.update.follower import Follower

_log = logging.getLogger("lift_manager")


SWITCH_S = 0.001
"""How long a thread waits at most for the one that runs Python. Chosen: the threads of the store and of DDS run for less, but take turns
many times in each commit; with the 5 ms of Python a press waited for its row until the loop had nothing else to do."""

NO_WORKERS = (
    "a site is served by one process, because a lift has one holder and its controller takes one connection; one process polls 1,000"
    " lifts ten times a second. For more, divide the controllers between two site files, and run a manager for each of them, on a port"
    " of its own"
)
"""Web servers offer `--workers`, so people try it."""


class Run(Protocol):
    """Serves a site on its socket until `stop` is set; returns whether the release of every output was verified."""

    async def __call__(self, *, stop: asyncio.Event, ready: Callable[[], None], faces: running.Faces) -> bool:
        """Run."""
        ...


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
    serve_site = partial(_serve_site, site, port, rmf=rmf, machine=machine, stopped_early=stopped_early)
    if (installation := installation_of(site)) is None:
        serve_site(None)
        return
    from lift_manager.cli.serve_updates import serve_installed  # noqa: PLC0415  only a site with updates loads it

    serve_installed(installation, serve_site)


def _serve_site(
    site: Path,
    port: int | None,
    updates: Follower | None,
    *,
    rmf: bool,
    machine: str | None,
    stopped_early: Callable[[], bool],
) -> None:
    loaded = as_served(on_machine(load_site_or_exit(site, for_rmf=rmf), machine))
    if loaded.unusable:
        raise report_mistakes(MapFileError(loaded.unusable))
    for obstacle in obstacles(loaded):
        raise fail(obstacle.message)
    for line in cautions(loaded):
        _log.warning("%s", line)
    loaded = with_checkouts(loaded)
    settings = settings_of_site(loaded.site.rmf) if rmf else None
    hub = _hub_settings(loaded, updates)
    api = loaded.site.api
    run_on = _run(loaded)
    try:
        sock = listen(api.host, api.port if port is None else port)
    except ListenError as error:
        raise fail(str(error)) from error
    with sock:
        faces = running.Faces(_keys(loaded, sock), settings, hub)
        try:
            released = run(_serve(loaded, sock, run_on(sock), faces, stopped_early))
        except* DdsError as group:
            raise report_join_failure(first_error(group)) from group
        except* (ControllerTaken, LockUnusable, ListenError, ClusterError) as group:
            raise fail(str(first_error(group))) from group
    if not released:
        raise typer.Exit(1)


def first_error(group: BaseExceptionGroup[Exception]) -> Exception:
    """Return the first error itself: in a cluster, task groups are in each other."""
    error = group.exceptions[0]
    return first_error(error) if isinstance(error, BaseExceptionGroup) else error


def _run(loaded: LoadedSite) -> Callable[[socket], Run]:
    """Open the store of a site, and return what runs its manager on a socket; or report why it cannot be opened, and exit with 1."""
    if loaded.site.cluster is not None:
        from lift_manager.cli.serve_in_cluster import this_machine  # noqa: PLC0415  loads what talks to etcd
        from lift_manager.takeover import run_in_cluster  # noqa: PLC0415

        here = this_machine(loaded)
        return lambda sock: partial(run_in_cluster, loaded, sock, here)
    committer = open_store_or_exit(loaded)
    return lambda sock: partial(running.run, loaded, sock, recorder=committer)


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


def _hub_settings(loaded: LoadedSite, updates: Follower | None) -> HubSettings | None:
    """Return how to reach the leaf node of the site, if it belongs to a hub; exit with 2 if something has to be installed first."""
    hub = loaded.site.hub
    if hub is None:
        return None
    from lift_manager.hub.connection import require_nats  # noqa: PLC0415  a site without a hub does not load what talks to it
    from lift_manager.hub.errors import NatsMissing  # noqa: PLC0415
    from lift_manager.hub.site_face import HubSettings  # noqa: PLC0415

    try:
        require_nats()
    except NatsMissing as error:
        print_stderr(str(error))
        raise typer.Exit(2) from error
    password = hub_password(loaded.site, loaded.path.parent)
    return HubSettings(hub.site, hub.server, password, hub.commands, store_path_of(loaded), updates)


async def _serve(
    loaded: LoadedSite, sock: socket, run_site: Run, faces: running.Faces, stopped_early: Callable[[], bool]
) -> bool:
    stop = asyncio.Event()
    stop_on_signals(stop)
    if stopped_early():
        # an earlier manager may have left outputs on: they are released before this one ends
        stop.set()
    host, port = sock.getsockname()[:2]
    scheme = "http" if loaded.site.api.tls is None else "https"

    def ready() -> None:
        sys.setswitchinterval(SWITCH_S)
        gc.freeze()  # a full collection of all that lives as long as the process would stop every lift for a tenth of a second
        where = f"{scheme}://{host}:{port}/docs"
        out.print(f"{loaded.site.name}: {counted(len(loaded.site.lifts), 'lift')} on {where}", highlight=False)
        if faces.rmf is not None:
            print_lines([f"Open-RMF lift adapter: {describe_rmf(faces.rmf)}"])
        if faces.hub is not None:
            print_lines([f"hub: site {faces.hub.site}, over the leaf node {faces.hub.server}"])

    return await run_site(stop=stop, ready=ready, faces=faces)
