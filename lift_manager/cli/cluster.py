"""`lift-manager cluster` and `handover`: what people do with the two machines of a site."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

import typer

from lift_manager.cli.common import SiteFile, fail, load_site_or_exit, print_lines, store_path_of
from lift_manager.cluster import operations
from lift_manager.cluster.connect import cluster_of, etcd_of
from lift_manager.cluster.content import Place
from lift_manager.cluster.errors import ClusterError
from lift_manager.cluster.etcd import Etcd
from lift_manager.cluster.term import HIGHEST_EPOCH
from lift_manager.config.load import LoadedSite
from lift_manager.plain.text import counted
from lift_manager.store.errors import StoreError
from lift_manager.store.site import read_records_of_site

app = typer.Typer(no_args_is_help=True, help="Prepare and inspect the two machines of a site.")

ANSWER_S = 5.0
"""How long a member of etcd may take. Chosen: people wait for it, and no lift does."""

Result = TypeVar("Result")

By = Annotated[str, typer.Option("--by", metavar="NAME", help="Your name; it is recorded in the journal.")]


@app.command()
def init(
    site: SiteFile,
    *,
    replace: Annotated[
        bool, typer.Option("--replace", help="Remove what etcd holds for the site first; both managers have ended.")
    ] = False,
    epoch: Annotated[
        int,
        typer.Option(
            "--epoch",
            metavar="N",
            min=0,
            max=HIGHEST_EPOCH - 1,
            help="The highest epoch that a controller of the site shows, for an etcd that was set up again.",
        ),
    ] = 0,
) -> None:
    """Prepare etcd for a site, once.

    What the manager of this machine remembers, such as lockouts, becomes what both machines remember. Run it on the machine whose
    manager has served the site so far, after that manager has ended.

    Controllers that arbitrate keep the epoch that they have obeyed. An etcd that was set up again begins at 0, and with --epoch above theirs.

    Example: lift-manager cluster init site.yaml
    """
    loaded = load_site_or_exit(site)
    try:
        records = read_records_of_site(store_path_of(loaded), loaded.site.name, loaded.site.lifts.keys())
    except StoreError as error:
        raise fail(str(error)) from error
    if replace:
        _with_etcd(loaded, operations.clear)
    begins = _with_etcd(loaded, lambda etcd, place: operations.prepare(etcd, place, records, epoch=epoch))
    remembered = f"the records of {counted(len(records), 'lift')}"
    print_lines([f"{loaded.site.name}: etcd is prepared, with {remembered}; the first term has epoch {begins + 1}"])


@app.command()
def status(site: SiteFile) -> None:
    """Show which machine is active.

    Example: lift-manager cluster status site.yaml
    """
    loaded = load_site_or_exit(site)
    found = _with_etcd(loaded, operations.read_status)
    active = f"{found.key.owner} is active, at {found.key.address}" if found.key.owner else "no machine is active"
    lines = [f"{loaded.site.name}: {active}; epoch {found.key.epoch}, commit {found.commit}"]
    for machine in _cluster_machines(loaded):
        copied = found.copied.get(machine, 0)
        behind = found.commit - copied
        state = "has every row on its disk" if not behind else f"is {counted(behind, 'commit')} behind"
        lines.append(f"{machine}: {state}")
    print_lines(lines)


def handover(site: SiteFile, by: By) -> None:
    """Let the standby take over, without releasing anything.

    Sessions, rides and held doors continue. Without a standby that is ready nothing changes.

    Example: lift-manager handover site.yaml --by "M. Weber"
    """
    loaded = load_site_or_exit(site)
    key = _with_etcd(loaded, lambda etcd, place: operations.hand_over(etcd, place, by))
    print_lines([f"{loaded.site.name}: {key.owner} is active, at {key.address}; epoch {key.epoch}"])


def _cluster_machines(loaded: LoadedSite) -> list[str]:
    return list(cluster_of(loaded).machines)


def _with_etcd(loaded: LoadedSite, work: Callable[[Etcd, Place], Result]) -> Result:
    """Work with the etcd of a site, or report why that is not possible and exit with 1."""
    try:
        etcd = etcd_of(cluster_of(loaded), loaded.path.parent, timeout_s=ANSWER_S)
        try:
            return work(etcd, Place(loaded.site.name))
        finally:
            etcd.close()
    except ClusterError as error:
        raise fail(str(error)) from error
