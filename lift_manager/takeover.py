"""Runs the manager of one of two machines: a standby until the key is taken, then active until its term ends, and so on."""

from __future__ import annotations

import asyncio
import logging
from asyncio import Task
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from socket import socket

from drivers.clock import boottime
from drivers.thread import Worker
from lift_manager import app
from lift_manager.app import Faces, renew_certificates, server_certificates
from lift_manager.cluster.certificates import EtcdCertificates
from lift_manager.cluster.connect import cluster_of, etcd_of
from lift_manager.cluster.content import Place, Solo
from lift_manager.cluster.errors import ClusterError
from lift_manager.cluster.fence import fences_of
from lift_manager.cluster.filter_client import filter_of
from lift_manager.cluster.member import ActiveTerm, Member
from lift_manager.cluster.replica import Replica, copy_all
from lift_manager.cluster.solo_file import SoloFile
from lift_manager.cluster.solo_member import SoloMember
from lift_manager.cluster.store import EtcdStore
from lift_manager.cluster.term import ANSWER_S
from lift_manager.config.load import LoadedSite
from lift_manager.lift.rmf_view import rmf_alarms
from lift_manager.rmf.dds import Dds
from lift_manager.rmf.lasting import LastingRmf
from lift_manager.store.committer import Committer
from lift_manager.store.errors import CommitFailed, StoreUnusable
from lift_manager.store.site import require_known_lifts
from lift_manager.store.store import Store
from lift_manager.systemd import notifier, report_to_systemd
from lift_manager.web.connections import ConnectionLimits
from lift_manager.web.limits import connections_limit
from lift_manager.web.server import serve
from lift_manager.web.standby import Standby

_log = logging.getLogger(__name__)

COPY_ANSWER_S = 5.0
"""How long the copy of the journal waits for etcd. Chosen: nothing waits for it."""


LOOK_EVERY_S = 1.0
"""How often a standby looks whether it could take over, for the log."""

LAST_COPY_S = 0.5
"""How long an orderly end waits for the last rows on the disk of this machine. They are in etcd, and copied at the next start."""


SOLO_CONNECT_S = 0.15
"""A machine that goes on alone passes over a member of etcd that does not accept a connection within this. Chosen: a connection takes
a millisecond, and with two members that are off a look has to end well within a term."""


@dataclass(frozen=True, slots=True)
class Alone:
    """The decision that this machine goes on alone, and where it is kept."""

    solo: Solo
    file: SoloFile


@dataclass(frozen=True, slots=True)
class ThisMachine:
    """The machine of a cluster that this process runs on."""

    name: str
    disk: Store
    """Where records and journal are copied to."""
    where: str
    """The name of that, for messages."""
    certificates: EtcdCertificates | None = None
    """With which it talks to etcd; None without TLS."""
    alone: Alone | None = None
    """Whether it goes on without the other machine."""


async def run_in_cluster(
    loaded: LoadedSite,
    sock: socket,
    machine: ThisMachine,
    *,
    stop: asyncio.Event,
    ready: Callable[[], None],
    faces: Faces,
) -> bool:
    """Serve a site on a listening socket until `stop` is set, in turn with the other machine, or alone if a person has decided that.

    Returns whether the release of every output was verified when this machine was active last. Raises what `app.run` raises, and
    ClusterUnusable. DdsError is raised at once, and not by a takeover.
    """
    certificates = machine.certificates
    with _in_rmf(loaded, faces) as joined:
        async with asyncio.TaskGroup() as tasks:
            renewing = None if certificates is None else tasks.create_task(renew_certificates(certificates, "cluster"))
            ready()
            command = partial(_command, loaded, sock, machine, stop=stop, faces=joined)
            if machine.alone is not None:
                released = await _run_alone(loaded, sock, machine, machine.alone, stop, command)
            else:
                released = await _run_as_one_of_two(loaded, sock, machine, stop, command)
            if renewing is not None:
                renewing.cancel()
    return released


@contextmanager
def _in_rmf(loaded: LoadedSite, faces: Faces) -> Iterator[Faces]:
    """Join RMF, if there are settings for it, for as long as this process lasts."""
    if faces.rmf is None:
        yield faces
        return
    lasting = LastingRmf(partial(Dds, faces.rmf), rmf_alarms(loaded.site.rmf.rules), boottime)
    try:
        yield replace(faces, lasting_rmf=lasting)
    finally:
        lasting.close()


async def _run_as_one_of_two(
    loaded: LoadedSite,
    sock: socket,
    machine: ThisMachine,
    stop: asyncio.Event,
    command: Callable[[ActiveTerm], Awaitable[bool]],
) -> bool:
    cluster, place, certificates = cluster_of(loaded), Place(loaded.site.name), machine.certificates
    address = cluster.machines[machine.name].address
    member = Member(machine.name, address, etcd_of(cluster, certificates, timeout_s=ANSWER_S), place)
    replica = Replica(machine.name, etcd_of(cluster, certificates, timeout_s=COPY_ANSWER_S), place, machine.disk)
    ended = asyncio.Event()
    async with asyncio.TaskGroup() as tasks:
        copying = tasks.create_task(copy_all(replica, ended))
        released = await _take_turns(loaded, sock, member, stop, command)
        ended.set()
        await asyncio.wait([copying], timeout=LAST_COPY_S)
        copying.cancel()
    return released


async def _run_alone(
    loaded: LoadedSite,
    sock: socket,
    machine: ThisMachine,
    alone: Alone,
    stop: asyncio.Event,
    command: Callable[[ActiveTerm], Awaitable[bool]],
) -> bool:
    """Continue from the disk of this machine. What etcd holds is not copied to it: it is older than what this machine decides."""
    cluster = cluster_of(loaded)
    etcd = etcd_of(cluster, machine.certificates, timeout_s=ANSWER_S, connect_s=SOLO_CONNECT_S)
    address = cluster.machines[machine.name].address
    member = SoloMember(alone.solo, address, etcd, Place(loaded.site.name), alone.file.write)
    return await _take_turns(loaded, sock, member, stop, command)


async def _take_turns(
    loaded: LoadedSite,
    sock: socket,
    member: Member | SoloMember,
    stop: asyncio.Event,
    command: Callable[[ActiveTerm], Awaitable[bool]],
) -> bool:
    """Stand by and command the lifts as the member allows, until `stop` is set; returns the result of the last command."""
    async with asyncio.TaskGroup() as tasks:
        watching = tasks.create_task(member.run())
        while True:
            standing_by = tasks.create_task(_stand_by(loaded, sock, member))
            term = await _until_active(member, stop)
            standing_by.cancel()  # nobody waits for its end: the lifts need a manager now
            released = True if term is None else await command(term)
            await member.give_up()
            if stop.is_set():
                break
            member.stand_by()
        watching.cancel()
    return released


async def _stand_by(loaded: LoadedSite, sock: socket, member: Member | SoloMember) -> None:
    """Reply as a standby until cancelled."""

    def address() -> str:
        key = member.key
        return "" if key is None or key.owner == member.name else key.address

    def status() -> str:
        return f"standby; {member.trouble}" if member.trouble else "standby"

    tls = server_certificates(loaded)
    standby = Standby(address, lambda: member.trouble)
    limits = ConnectionLimits.of(connections_limit(), loaded.site.api.trusted_proxies)
    with sock.dup() as own_sock:
        async with asyncio.TaskGroup() as work:
            work.create_task(serve(standby, own_sock, tls=tls, limits=limits))
            work.create_task(_log_trouble(member))
            work.create_task(report_to_systemd(notifier(), {}, dict, status))
            if tls is not None:
                work.create_task(renew_certificates(tls))


async def _log_trouble(member: Member | SoloMember) -> None:
    """Log why this machine could not take over, and that it can again."""
    logged = ""
    while True:
        if (trouble := member.trouble) and not logged:
            _log.error("cluster: this machine could not take over: %s", trouble)
        elif logged and not trouble:
            _log.warning("cluster: this machine can take over again")
        logged = trouble
        await asyncio.sleep(LOOK_EVERY_S)


async def _until_active(member: Member | SoloMember, stop: asyncio.Event) -> ActiveTerm | None:
    """Return the term of this machine; None once it is to stop."""
    taken: Task[ActiveTerm] = asyncio.ensure_future(member.until_active())
    stopped = asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait([taken, stopped], return_when=asyncio.FIRST_COMPLETED)
        return taken.result() if taken.done() else None
    finally:
        taken.cancel()
        stopped.cancel()


async def _command(
    loaded: LoadedSite, sock: socket, machine: ThisMachine, term: ActiveTerm, *, stop: asyncio.Event, faces: Faces
) -> bool:
    """Run the manager for a term; returns whether the release of every output was verified."""
    cluster = cluster_of(loaded)
    store: Store = machine.disk
    if not term.alone:
        etcd = etcd_of(cluster, machine.certificates, timeout_s=ANSWER_S)
        store = EtcdStore(etcd, Place(loaded.site.name), term.key, cluster.machines)
    where = machine.where if term.alone else "etcd"
    loading = Worker("lift-manager-load")
    try:
        records = await loading.submit(store.load)
        require_known_lifts(Path(where), records, loaded.site.lifts)
    except (ClusterError, CommitFailed, StoreUnusable) as error:
        _log.error("cluster: this machine cannot command the lifts: %s", error)
        return True
    finally:
        loading.stop()
    committer = Committer(store, where, records)
    with sock.dup() as own_sock:
        async with fenced(loaded, term):
            return await app.run(
                loaded,
                own_sock,
                stop=stop,
                ready=partial(_log.info, "cluster: the lifts are commanded"),
                recorder=committer,
                faces=faces,
                term=term,
            )


@asynccontextmanager
async def fenced(loaded: LoadedSite, term: ActiveTerm) -> AsyncIterator[None]:
    """Let the term do before each connection what the site file demands, and hold the permission of the packet filter meanwhile."""
    prepare: dict[str, Callable[[], Awaitable[None]]] = {
        controller: fence.close for controller, fence in fences_of(loaded, term.key.owner, term.key.epoch).items()
    }
    if (packet_filter := filter_of(loaded, term)) is None:
        term.prepare = prepare
        yield
        return
    # first the filter: the way of the other machine is not closed by one that reaches nothing itself
    term.prepare = {
        name: partial(_in_turn, partial(packet_filter.require, name), prepare.get(name)) for name in loaded.controllers
    }
    async with asyncio.TaskGroup() as tasks:
        holding = tasks.create_task(packet_filter.run())
        yield
        holding.cancel()


async def _in_turn(first: Callable[[], Awaitable[None]], then: Callable[[], Awaitable[None]] | None) -> None:
    await first()
    if then is not None:
        await then()
