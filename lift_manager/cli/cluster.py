"""`lift-manager cluster` and `handover`: what people do with the two machines of a site."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, TypeVar
from urllib.parse import urlsplit

import typer

from lift_manager.cli.common import (
    Machine,
    SiteFile,
    fail,
    load_site_or_exit,
    on_machine,
    print_lines,
    store_path_of,
)
from lift_manager.cli.packet_filter import packet_filter
from lift_manager.cluster import operations
from lift_manager.cluster.connect import certificates_of, cluster_of, etcd_of, machine_of, members_of, other_than
from lift_manager.cluster.content import Place, Solo, new_solo_id
from lift_manager.cluster.errors import ClusterError
from lift_manager.cluster.etcd import Etcd
from lift_manager.cluster.replica import Replica
from lift_manager.cluster.solo_file import SoloFile
from lift_manager.cluster.term import HIGHEST_EPOCH
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Cluster
from lift_manager.lift.journal import Json, Row, RowKind
from lift_manager.plain.text import counted
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.errors import StoreError
from lift_manager.store.read import RowFilter, microseconds, open_journal
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_copy, read_records_of_site
from lift_manager.store.sqlite import to_pending
from lift_manager.store.store import PendingRow, Store

app = typer.Typer(no_args_is_help=True, help="Prepare and inspect the two machines of a site.")
app.command("packet-filter")(packet_filter)

ANSWER_S = 5.0
"""How long a member of etcd may take. Chosen: people wait for it, and no lift does."""

ON_WITHIN_S = 2.0
"""How long a machine may take to accept a connection, or refuse it, and still counts as on. Chosen: it is in the same building."""

PORTS = {"http": 80, "https": 443}

Result = TypeVar("Result")

By = Annotated[str, typer.Option("--by", metavar="NAME", help="Your name; it is recorded in the journal.")]


Off = Annotated[
    str,
    typer.Option("--off", metavar="OTHER", help="The other machine: you know that it is off, and that it stays off."),
]


@app.command()
def init(
    site: SiteFile,
    *,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace what etcd holds for the site; both managers have ended.")
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
    if (solo := _solo_of(loaded)) is not None:
        raise fail(f"{solo.text}; `lift-manager cluster join` brings what it remembers to etcd")
    records, known = _records_of(loaded), _newest_epoch(loaded)
    bring = operations.replace if replace else operations.prepare
    _with_etcd(loaded, lambda etcd, place: bring(etcd, place, records, epoch=epoch, known_epoch=known))
    begins = _with_etcd(loaded, operations.read_status).key.epoch
    remembered = f"the records of {counted(len(records), 'lift')}"
    print_lines([f"{loaded.site.name}: etcd is prepared, with {remembered}; the first term has epoch {begins + 1}"])


@app.command()
def status(site: SiteFile) -> None:
    """Show which machine is active.

    Example: lift-manager cluster status site.yaml
    """
    loaded = load_site_or_exit(site)
    if (here := _solo_of(loaded)) is not None:
        print_lines([f"this machine: {here.text}"])
    found = _with_etcd(loaded, operations.read_status)
    active = f"{found.key.owner} is active, at {found.key.address}" if found.key.owner else "no machine is active"
    if found.solo is not None:
        active = found.solo.text
    lines = [f"{loaded.site.name}: {active}; epoch {found.key.epoch}, commit {found.commit}"]
    for machine in cluster_of(loaded).machines:
        copied = found.copied.get(machine, 0)
        behind = found.commit - copied
        state = "has every row on its disk" if not behind else f"is {counted(behind, 'commit')} behind"
        lines.append(f"{machine}: {state}")
    print_lines(lines)


@app.command()
def solo(site: SiteFile, by: By, off: Off, machine: Machine = None) -> None:
    """Let this machine command the lifts without etcd, because the other machine is off.

    For the time in which etcd has no majority. End the manager of this machine, run this, and start it again: it continues from the
    disk of this machine. Should the other machine run all the same, both may command the lifts at once. `cluster join` ends it.

    Example: lift-manager cluster solo site.yaml --by "M. Weber" --off south
    """
    loaded, cluster, here = _this_machine(site, machine)
    other = other_than(cluster, here)
    if off != other:
        raise typer.BadParameter(f"the other machine is {other}", param_hint="--off")
    place, file = Place(loaded.site.name), SoloFile(store_path_of(loaded))
    if (before := _solo_of(loaded)) is not None and not before.contested:
        raise fail(f"{before.text}; start its manager")
    with _opened_copy(loaded) as disk, _members(loaded) as members:
        if operations.answering_member(members, place) is not None:
            raise fail(
                f"etcd answers, so no machine has to go on alone: once {other} is off, a manager that runs here takes over by itself."
                " Nothing was changed"
            )
        if is_on(cluster.machines[other].address):
            raise fail(
                f"{other} answers at {cluster.machines[other].address}, so it is on; switch it off first. Nothing was changed"
            )
        known = operations.best_informed(members, place)
        copied = 0
        if known is not None:
            replica = Replica(here, known[0], place, disk, local=True)
            while replica.step(_now_us()).more:
                pass
            copied = known[2]
        rows = disk.tail(1)
        epochs = (0 if known is None else known[1].epoch, 0 if before is None else before.epoch, _newest_epoch(loaded))
        decided = Solo(
            id=new_solo_id(),
            machine=here,
            off=other,
            by=by,
            since=f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
            epoch=max(epochs) + operations.EPOCHS_AHEAD,
            revision=0 if known is None else known[1].revision,
            commit=copied,
        )
        file.write(decided)
        _write_down(disk, decided.text, by, {"off": other, "epoch": decided.epoch})
    source = (
        "no member of etcd answers, so nobody knows whether its copy lacks something"
        if known is None
        else f"its copy has everything that a member of etcd knows, up to commit {copied}"
    )
    print_lines(
        [
            f"{loaded.site.name}: {decided.text}",
            f"{source}; its journal ends with {_newest_text(rows)}",
            f"Start the manager here now. {other} must stay off, its etcd included, until `lift-manager cluster join` has been run here.",
        ]
    )


@app.command()
def join(
    site: SiteFile,
    by: By,
    *,
    discard: Annotated[
        bool,
        typer.Option(
            "--discard", help="What this machine has decided alone stays in its journal, and is not continued."
        ),
    ] = False,
    off: Annotated[
        str,
        typer.Option(
            "--off",
            metavar="OTHER",
            help="On the other machine, if the one that went on alone is lost: what etcd holds is continued.",
            show_default=False,
        ),
    ] = "",
    machine: Machine = None,
) -> None:
    """Let both machines serve again after one has gone on alone.

    Run it on the machine that has gone on alone, once etcd answers again and both managers have ended. What this machine remembers
    replaces what etcd holds. Then start both managers.

    Example: lift-manager cluster join site.yaml --by "M. Weber"
    """
    loaded, cluster, here = _this_machine(site, machine)
    if off:
        _join_without(loaded, cluster, here, off, by)
        return
    file, decided = SoloFile(store_path_of(loaded)), _solo_of(loaded)
    if decided is None:
        raise fail(
            f"{here} does not go on alone; on the other machine, `--off` lets both go on if the one that did is lost"
        )
    with _opened_copy(loaded) as disk:
        lost = 0
        if discard:
            _with_etcd(loaded, lambda etcd, place: operations.forget_solo(etcd, place, here, decided.epoch))
        else:
            records = _records_of(loaded)
            lost = _with_etcd(loaded, lambda etcd, place: operations.replace(etcd, place, records, decided))
        end = (
            "what it has decided alone is discarded"
            if discard
            else "what it remembers is what both machines continue with"
        )
        text = f"{here} goes on with {decided.off} again: {end}"
        _write_down(disk, text, by, {"lost_commits": lost})
        file.remove()
    lines = [f"{loaded.site.name}: {text}; start both managers"]
    if lost:
        lines.append(f"{counted(lost, 'commit')} of {decided.off} from before that are not in the journal of {here}")
    print_lines(lines)


def _join_without(loaded: LoadedSite, cluster: Cluster, here: str, off: str, by: str) -> None:
    """Continue with what etcd holds, because the machine that has gone on alone is lost."""
    other = other_than(cluster, here)
    if off != other:
        raise typer.BadParameter(f"the other machine is {other}", param_hint="--off")
    if is_on(cluster.machines[other].address):
        raise fail(
            f"{other} answers at {cluster.machines[other].address}; run `lift-manager cluster join` there. Nothing was changed"
        )
    with _opened_copy(loaded) as disk:
        _with_etcd(loaded, lambda etcd, place: operations.forget_solo(etcd, place, other))
        text = f"{here} goes on with what etcd holds: {other}, which went on alone, is lost"
        _write_down(disk, text, by, {"off": other})
    print_lines([f"{loaded.site.name}: {text}; start the manager here"])


def handover(site: SiteFile, by: By) -> None:
    """Let the standby take over, without releasing anything.

    Sessions, rides and held doors continue. Without a standby that is ready nothing changes.

    Example: lift-manager handover site.yaml --by "M. Weber"
    """
    loaded = load_site_or_exit(site)
    key = _with_etcd(loaded, lambda etcd, place: operations.hand_over(etcd, place, by))
    print_lines([f"{loaded.site.name}: {key.owner} is active, at {key.address}; epoch {key.epoch}"])


def is_on(address: str) -> bool:
    """Whether a machine answers at the address of its manager, if only to say that no manager is there."""
    url = urlsplit(address)
    try:
        socket.create_connection((url.hostname or "", url.port or PORTS[url.scheme]), timeout=ON_WITHIN_S).close()
    except ConnectionRefusedError:
        return True
    except OSError:
        return False
    return True


def _this_machine(site: Path, machine: str | None) -> tuple[LoadedSite, Cluster, str]:
    loaded = on_machine(load_site_or_exit(site), machine)
    try:
        cluster = cluster_of(loaded)
        return loaded, cluster, machine_of(cluster)
    except ClusterError as error:
        raise fail(str(error)) from error


def _solo_of(loaded: LoadedSite) -> Solo | None:
    try:
        return SoloFile(store_path_of(loaded)).read()
    except ClusterError as error:
        raise fail(str(error)) from error


def _records_of(loaded: LoadedSite) -> Mapping[str, SavedLift]:
    try:
        return read_records_of_site(store_path_of(loaded), loaded.site.name, loaded.site.lifts.keys())
    except StoreError as error:
        raise fail(str(error)) from error


@contextmanager
def _opened_copy(loaded: LoadedSite) -> Iterator[Store]:
    """Open the copy of this machine, or report why that is not possible, and exit with 1: its manager has to end first."""
    journal = loaded.site.journal
    try:
        disk = open_copy(store_path_of(loaded), loaded.site.name, Limits(journal.keep_days, journal.max_mb))
        try:
            yield disk
        finally:
            disk.close()
    except (ClusterError, StoreError) as error:
        raise fail(str(error)) from error


@contextmanager
def _members(loaded: LoadedSite) -> Iterator[list[Etcd]]:
    cluster = cluster_of(loaded)
    members = members_of(cluster, certificates_of(cluster, loaded.path.parent), timeout_s=ANSWER_S)
    try:
        yield members
    finally:
        for member in members:
            member.close()


def _write_down(disk: Store, text: str, by: str, data: Mapping[str, Json]) -> None:
    disk.commit({}, [PendingRow(_now_us(), Row(RowKind.PERSON, text, caller=by, data=data))])


def _newest_epoch(loaded: LoadedSite) -> int:
    """Return the epoch of the newest takeover in the journal of this machine; 0 if there is none."""
    store = store_path_of(loaded)
    if not store.exists():
        return 0
    takeovers = RowFilter(kinds=frozenset((RowKind.MANAGER,)), find="in epoch ")
    try:
        with open_journal(store) as journal:
            rows = journal.newest(takeovers, 1)
    except StoreError as error:
        raise fail(str(error)) from error
    epochs = [to_pending(row).row.data.get("epoch") for row in rows]
    return max((epoch for epoch in epochs if isinstance(epoch, int)), default=0)


def _newest_text(rows: Sequence[PendingRow]) -> str:
    if not rows:
        return "no row"
    at = datetime.fromtimestamp(rows[-1].at // 1_000_000, UTC)
    return f"the row of {at:%Y-%m-%d %H:%M:%S} UTC: {rows[-1].row.text}"


def _now_us() -> int:
    return microseconds(datetime.now(UTC))


def _with_etcd(loaded: LoadedSite, work: Callable[[Etcd, Place], Result]) -> Result:
    """Work with the etcd of a site, or report why that is not possible and exit with 1."""
    try:
        cluster = cluster_of(loaded)
        etcd = etcd_of(cluster, certificates_of(cluster, loaded.path.parent), timeout_s=ANSWER_S)
        try:
            return work(etcd, Place(loaded.site.name))
        finally:
            etcd.close()
    except ClusterError as error:
        raise fail(str(error)) from error
