"""`lift-manager cluster packet-filter`: keeps everybody on this machine off the controllers, except a manager that has a term."""

from __future__ import annotations

import asyncio
import logging
import pwd
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli.common import SiteFile, fail, load_site_or_exit, print_lines
from lift_manager.cli.logs import LogFormat, LogOption, log_to_stderr
from lift_manager.cluster.connect import cluster_of
from lift_manager.cluster.errors import ClusterError, ClusterUnusable
from lift_manager.cluster.filter_helper import Filter, is_served, listening, load_rules, remove_rules, serve
from lift_manager.cluster.filter_kernel import Kernel
from lift_manager.config.load import LoadedSite
from lift_manager.config.tls import path_of
from lift_manager.plain.signals import stop_on_signals
from lift_manager.plain.text import counted
from lift_manager.systemd import notifier

_log = logging.getLogger("lift_manager")


def packet_filter(
    site: SiteFile,
    *,
    user: Annotated[
        str, typer.Option("--user", metavar="NAME", help="Whom the manager runs as; nobody else is let through.")
    ] = "lift-manager",
    remove: Annotated[
        bool,
        typer.Option(
            "--remove",
            help="Remove the filter, so that tools reach the controllers; a manager does not command them meanwhile.",
        ),
    ] = False,
    log_format: LogOption = LogFormat.HUMAN,
) -> None:
    """Let only a manager with a term reach the controllers from this machine.

    Runs beside each manager of a cluster, with the capability CAP_NET_ADMIN, and needs nftables. The filter stays when it ends, and then
    nobody reaches the controllers, until it runs again or the filter is removed.

    Example: lift-manager cluster packet-filter site.yaml
    """
    log_to_stderr(log_format)
    loaded = load_site_or_exit(site)
    try:
        path = _path_of(loaded)
        if remove:
            _remove(path)
            return
        asyncio.run(_run(path, [(each.host, each.port) for each in loaded.controllers.values()], _number_of(user)))
    except ClusterError as error:
        raise fail(str(error)) from error


def _remove(path: Path) -> None:
    if is_served(path):
        raise fail(f"the packet filter runs, and answers at {path}; end it first. Nothing was changed")
    remove_rules()
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise fail(f"{path}: {error.strerror or error}") from error
    print_lines(["the packet filter is removed; whoever can reach the network of the controllers reaches them"])


async def _run(path: Path, controllers: list[tuple[str, int]], user: int) -> None:
    stop = asyncio.Event()
    stop_on_signals(stop)
    with listening(path) as sock:
        load_rules(controllers)
        with closing(Kernel()) as kernel:
            _log.info(
                "nobody reaches %s from this machine, until a manager has a term",
                counted(len(controllers), "controller"),
            )
            notifier().send("READY=1")
            await serve(Filter(controllers, user, kernel, partial(load_rules, controllers)), sock, user, stop)


def _path_of(loaded: LoadedSite) -> Path:
    if (named := cluster_of(loaded).packet_filter) is None:
        raise ClusterUnusable(
            f"`cluster` of {loaded.path} has no `packet_filter`, so no manager would request to be let through"
        )
    return path_of(loaded.path.parent, named)


def _number_of(user: str) -> int:
    if user.isdecimal():
        return int(user)
    try:
        return pwd.getpwnam(user).pw_uid
    except KeyError as error:
        raise typer.BadParameter(f"this machine has no user {user!r}", param_hint="--user") from error
