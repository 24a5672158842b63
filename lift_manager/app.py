"""Assembles the parts of a running manager, runs them, and stops them in order."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from pathlib import Path
from socket import socket
from typing import TYPE_CHECKING, Protocol
from zoneinfo import ZoneInfo

from drivers.driver import LiftDriver
from drivers.modbus.capabilities import KINDS, LiftSettings
from drivers.modbus.controller_lock import controller_lock
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.read_plan import polled_points
from drivers.modbus.settings import LinkSettings
from drivers.modbus.tls import LinkTls
from drivers.modbus.units import Unit
from drivers.modbus.wire import PymodbusWire, Wire
from drivers.thread import in_thread
from lift_manager.api.keys import Keys
from lift_manager.config.check import canonical_host
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Controller, Floor
from lift_manager.config.tls import path_of, tls_cautions
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.hours import RobotHours
from lift_manager.lift.session import CLEAR_AT_STOP_S
from lift_manager.lift.state import Quality
from lift_manager.metrics.metrics import Metrics
from lift_manager.plain.text import counted
from lift_manager.plain.version import running_version
from lift_manager.rmf.dds import Dds, DdsListener
from lift_manager.rmf.local_manager import LocalManager
from lift_manager.rmf.port import Deliver
from lift_manager.rmf.ros_settings import RosSettings
from lift_manager.rmf.run import Rmf, RunningAdapter
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.journal import manager_ended, manager_handed_over, manager_started, manager_took_over
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.links import WireFrame
from lift_manager.runtime.progress import patience_s
from lift_manager.runtime.recorder import Clock, MemoryRecorder, Recorder, wall_clock
from lift_manager.runtime.site import Site
from lift_manager.site_links import SiteLinks
from lift_manager.store.keys import KeyFile
from lift_manager.systemd import notifier, report_to_systemd
from lift_manager.web.app import make_app
from lift_manager.web.connections import ConnectionLimits
from lift_manager.web.limits import connections_limit
from lift_manager.web.server import serve
from lift_manager.web.standby import Standby, WhileActive
from lift_manager.web.tls import ServerCertificates, ServerTls
from register_maps.arbitration import Claim
from register_maps.schema import LinkDefaults
from register_maps.words import Side

if TYPE_CHECKING:  # a manager that is alone does not load what talks to etcd, or to a hub
    from lift_manager.cluster.member import ActiveTerm
    from lift_manager.hub.site_face import HubSettings
    from lift_manager.rmf.lasting import LastingRmf

_log = logging.getLogger(__name__)

FIRST_READING_S = 1.0
"""How long the web server waits for the first reading of every lift. Chosen: a reachable controller answers in a fraction of it, and
nobody waits longer for one that is not."""

RELEASE_WITHIN_S = 3.0
"""How long shutdown waits for outputs to be released and verified, of the 5 s in which the process must exit. Chosen: on a busy
computer with two cores the interpreter needs more than a second to exit."""

RELEASE_AFTER_CLEARING_S = 0.8
"""The same limit after the wait for a robot that may be in a doorway (`lift.session.CLEAR_AT_STOP_S`)."""

WARN_EVERY_S = 86400.0
"""Chosen: often enough to be found in the log, and rarely enough not to fill it."""

CHECK_EVERY_S = 1.0
"""How often the files of HTTPS are checked. Chosen: a renewed certificate is used within a second."""

CHECK_WITHIN_S = 10.0
"""Chosen: a disk that takes longer is reported."""

FLUSH_WITHIN_S = 0.5
"""How long shutdown waits for the disk after that, while the web server closes; writing began with the release."""


@dataclass(frozen=True, slots=True)
class Faces:
    """Settings of the northbound interfaces."""

    keys: Keys | None = None
    """Keys of the API; None if it needs none. Those of a file are watched."""
    rmf: RosSettings | None = None
    """The RMF domain to join; None for none."""
    hub: HubSettings | None = None
    """The hub of many sites to take part in; None for none."""
    on_frame: Callable[[WireFrame], None] | None = None
    """Receives every frame of every link, from the first one on; it must neither wait nor raise."""
    lasting_rmf: LastingRmf | None = None
    """The connection to the RMF domain that lasts over the terms of this machine of a cluster."""


@dataclass(frozen=True, slots=True)
class ManagerParts:
    """The parts of a running manager."""

    site: Site
    life: SiteLife
    actors: tuple[LiftActor, ...]
    """The lifts in the order of the site file."""
    recorder: Recorder
    links: tuple[Link, ...]
    sources: SiteLinks
    """The links, for faces."""
    metrics: Metrics
    bus: Bus[Event]
    """Carries all events; faces subscribe through the site."""


def network_wires(folder: Path, term: ActiveTerm | None = None) -> Callable[[Controller], Wire]:
    """Return a factory of wires as configured in a site file, with or without TLS; `folder` is that of the file.

    In a cluster nothing is sent, or sent again by the kernel, after the `term`.
    """
    remaining_s = None if term is None else lambda: term.remaining_s

    @cache  # one for all connections of a link: it caches the files
    def tls_of(controller: Controller) -> LinkTls | None:
        if (tls_settings := controller.tls) is None:
            return None
        ca, certificate, key = (
            path_of(folder, file) for file in (tls_settings.ca, tls_settings.certificate, tls_settings.key)
        )
        return LinkTls(ca=ca, certificate=certificate, key=key, server_name=tls_settings.server_name)

    return lambda controller: PymodbusWire(
        controller.host, controller.port, tls=tls_of(controller), remaining_s=remaining_s
    )


def build(
    loaded: LoadedSite,
    make_wire: Callable[[Controller], Wire] | None = None,
    *,
    recorder: Recorder | None = None,
    clock: Clock | None = None,
    claim: Claim | None = None,
    prepare: Mapping[str, Callable[[], Awaitable[None]]] = {},
) -> ManagerParts:
    """Assemble a manager, with one link per controller for all its lifts, over the network by default.

    In a cluster, `claim` is that of a term, for controllers that arbitrate, and `prepare` has what is to be done before connecting to a
    controller, by its name. Without a recorder, a restart loses sessions, decisions of people, and the journal.
    """
    recorder = recorder or MemoryRecorder()
    clock = clock or wall_clock(None if loaded.site.timezone is None else ZoneInfo(loaded.site.timezone))
    make_wire = make_wire or network_wires(loaded.path.parent)
    bus: Bus[Event] = Bus()
    links = {
        name: _link(name, spec, loaded.links[name], make_wire, prepare.get(name))
        for name, spec in loaded.controllers.items()
    }
    actors = tuple(
        LiftActor(driver, lift_config(name, loaded, driver), bus, recorder, clock=clock)
        for name, driver in ((name, _driver(name, loaded, links, claim)) for name in loaded.site.lifts)
    )
    site = Site(actors, bus, recorder, rmf=loaded.site.rmf.rules, clock=clock)
    life = SiteLife(site, actors)
    sources = SiteLinks(links)
    metrics = Metrics(site, life, sources, version=running_version())
    return ManagerParts(site, life, actors, recorder, tuple(links.values()), sources, metrics, bus)


def lift_config(name: str, loaded: LoadedSite, driver: LiftDriver) -> LiftConfig:
    """Return the configuration of a lift from site file and map."""
    spec = loaded.site.lifts[name]
    return LiftConfig(
        name=name,
        source=driver.source,
        floors=tuple(spec.floors),
        doors_at=_doors_at(tuple(spec.floors.items()), driver.capabilities.doors),
        control=spec.access == "control",
        capabilities=driver.capabilities,
        display_name=spec.display_name or "",
        lease_s=spec.lease_s,
        max_session_hold_s=spec.max_session_hold_s,
        max_session_s=spec.max_session_s,
        clear_s=spec.clear_s,
        rmf_clear_s=loaded.site.rmf.clear_s,
        takeover_after_s=spec.takeover_after_s,
        infer_occupancy=spec.infer_occupancy,
        board_min_s=spec.board_min_s,
        robot_hours=None if spec.robot_hours is None else RobotHours(spec.robot_hours),
        between_sessions_s=spec.between_sessions_s,
        fire_release_delay_s=spec.fire_release_delay_s,
        poll_s=loaded.poll_s(name),
        poll_ridden_s=loaded.poll_ridden_s(name),
        checkout=loaded.checkouts.get(name),
        rmf_name=spec.rmf.name or "",
        rmf_floors=spec.rmf.floors,
    )


async def run(
    loaded: LoadedSite,
    sock: socket,
    *,
    stop: asyncio.Event,
    ready: Callable[[], None],
    recorder: Recorder | None = None,
    faces: Faces | None = None,
    term: ActiveTerm | None = None,
) -> bool:
    """Serve a site on a listening socket until `stop` is set; returns whether the release of every output was verified.

    In a cluster it also ends with the `term` of this machine, after which nothing is written.

    Raises ControllerTaken, LockUnusable, ListenError for unusable certificates, or DdsError, before anything starts.
    """
    faces = faces or Faces()
    tls = server_certificates(loaded)
    with ExitStack() as ends:
        for controller in loaded.controllers.values():
            ends.enter_context(controller_lock(canonical_host(controller.host), controller.port))
        parts = _tapped(_build_for(term, loaded, recorder), faces.on_frame, ends)
        systemd, life = notifier(), parts.life
        adapter = _adapter(parts, faces, term, ends)
        crashes: list[Exception] = []

        async def guarded(work: Coroutine[None, None, None]) -> None:
            """Stop the program after a bug in one task, once every lift is released."""
            try:
                await work
            except Exception as bug:  # noqa: BLE001  it is raised again once nothing is held any more
                crashes.append(bug)
                stop.set()

        async with asyncio.TaskGroup() as tasks:
            _note_start(parts.recorder, loaded, term)
            polling = tasks.create_task(guarded(life.run()))
            background = _background_tasks(parts, loaded, faces, tls, adapter, stop)
            running = [tasks.create_task(guarded(task)) for task in background]
            with suppress(TimeoutError):
                async with asyncio.timeout(FIRST_READING_S):
                    await life.first_look()
            serving = tasks.create_task(guarded(_serve(parts, loaded, faces.keys, sock, tls, term)))
            patience_s_of = poll_patience_s(loaded, parts.links) if systemd.is_enabled else {}
            watching = guarded(report_to_systemd(systemd, patience_s_of, life.polls, lambda: _status_text(parts, term)))
            running.append(tasks.create_task(watching))
            ready()
            await _first_of(stop, stop if term is None else term.ends)
            if stop.is_set():
                systemd.send("STOPPING=1", "STATUS=releasing everything")
            if adapter is not None:
                # before a door is released: no robot may begin to drive in
                adapter.go_offline()
            released = await _end(parts, term, faces)
            serving.cancel()
            await _flush_journal(parts.recorder, polling)
            for task in running:
                task.cancel()
    if crashes:
        raise ExceptionGroup("the manager stopped because of a bug", crashes)
    return released


def _tapped(parts: ManagerParts, on_frame: Callable[[WireFrame], None] | None, ends: ExitStack) -> ManagerParts:
    """Pass on every frame of every link, if somebody wants them."""
    if on_frame is not None:
        for link in parts.sources.link_names():
            ends.enter_context(parts.sources.tap_frames(link, on_frame))
    return parts


def _background_tasks(
    parts: ManagerParts,
    loaded: LoadedSite,
    faces: Faces,
    tls: ServerCertificates | None,
    adapter: RunningAdapter | None,
    stop: asyncio.Event,
) -> Iterator[Coroutine[None, None, None]]:
    """Yield the background tasks, except for the polls and the web server."""
    recorder = parts.recorder
    key_file = faces.keys if isinstance(faces.keys, KeyFile) else None
    yield from (link.run() for link in parts.links)
    yield from parts.life.drives()
    yield from (recorder.run(parts.site.report_disk), parts.metrics.run(), warn_of_expiry(loaded))
    if key_file is not None:
        yield key_file.run(recorder.note)
    if tls is not None:
        yield renew_certificates(tls)
    if adapter is not None:
        yield adapter.run()
    if faces.hub is not None:
        from lift_manager.hub.site_face import SiteFace  # noqa: PLC0415  see TYPE_CHECKING

        yield SiteFace(faces.hub, loaded.site.name, parts.site, key_file).run()
        if faces.hub.updates is not None:
            yield faces.hub.updates.run(parts.site, recorder.note, stop.set)


def _adapter(parts: ManagerParts, faces: Faces, term: ActiveTerm | None, ends: ExitStack) -> RunningAdapter | None:
    """Make the adapter for Open-RMF if there are settings for it. A manager that is alone joins RMF with it. Raises DdsError."""
    if (settings := faces.rmf) is None:
        return None
    make_rmf: Callable[[DdsListener, Deliver], Rmf] = partial(Dds, settings)
    lasting, first_reading_s = faces.lasting_rmf, 0.0
    if lasting is not None and term is not None:
        make_rmf, first_reading_s = partial(lasting.attach, lambda: term.remaining_s > 0), FIRST_READING_S
    adapter = RunningAdapter(
        make_rmf,
        lambda: LocalManager(parts.site),
        use_sim_time=settings.use_sim_time,
        adapter_id=settings.adapter,
        first_reading_s=first_reading_s,
    )
    if lasting is None:
        adapter.open()
    ends.callback(adapter.close)
    parts.metrics.count_rmf(adapter.counts)
    return adapter


def poll_patience_s(loaded: LoadedSite, links: tuple[Link, ...]) -> dict[str, float]:
    """Return for each lift after how many seconds without a finished poll its own task must be stuck."""
    link_of = dict(zip(loaded.controllers, links, strict=True))
    used = {
        name: {device.controller for device in devices(loaded.site, spec, loaded.maps[name].map).values()}
        for name, spec in loaded.site.lifts.items()
    }
    found = {}
    for name, codec in loaded.codecs.items():
        outputs = {point.cell for command in codec.commands.values() for point in command.read_points}
        settings = [link_of[controller].settings for controller in used[name]]
        found[name] = patience_s(
            poll_s=loaded.poll_s(name),
            addresses=len({point.cell for point in polled_points(codec)} | outputs),
            lifts=max(sum(controller in other for other in used.values()) for controller in used[name]),
            answer_s=max(setting.most_timeout_s + setting.busy_retries * setting.busy_pause_s for setting in settings),
            gap_s=max(setting.min_gap_s for setting in settings),
        )
    return found


def _build_for(term: ActiveTerm | None, loaded: LoadedSite, recorder: Recorder | None) -> ManagerParts:
    """Assemble a manager; in a cluster it writes only while its term lasts."""
    if term is None:
        return build(loaded, recorder=recorder)
    cluster = loaded.site.cluster
    claim = Claim(term.key.epoch, 0 if cluster is None else cluster.number_of(term.key.owner))
    wires = network_wires(loaded.path.parent, term)
    parts = build(loaded, wires, recorder=recorder, claim=claim, prepare=term.prepare)
    for actor in parts.actors:
        term.follow(actor.driver.fence)
    return parts


def _note_start(recorder: Recorder, loaded: LoadedSite, term: ActiveTerm | None) -> None:
    lifts = loaded.site.lifts.items()
    maps = {name: (lift.access, loaded.maps[name].map.name, loaded.maps[name].sha256) for name, lift in lifts}
    recorder.note(manager_started(running_version(), maps, loaded.checkouts))
    if term is not None:
        recorder.note(manager_took_over(term.key.owner, term.key.epoch, term.alone))


async def warn_of_expiry(loaded: LoadedSite, *, every_s: float = WARN_EVERY_S) -> None:
    """Warn once a day of certificates that expire soon: a manager may run for longer than they last."""
    while True:
        await asyncio.sleep(every_s)
        # in a thread, because a disk that hangs must not block the lifts
        with suppress(OSError):
            await in_thread(lambda: _log_expiring(loaded))


def _log_expiring(loaded: LoadedSite) -> None:
    for line in tls_cautions(loaded.site, loaded.path.parent):
        _log.warning("%s", line)


class Renewable(Protocol):
    """Certificates whose files may change."""

    def renew(self) -> None:
        """Use the files if they have changed. Blocks."""
        ...


async def renew_certificates(tls: Renewable, owner: str = "api", *, within_s: float = CHECK_WITHIN_S) -> None:
    """Reload certificates whenever their files change; `owner` is the part of the site file that names them."""
    loop = asyncio.get_running_loop()
    message = "%s: the files of `tls` do not answer within %g s, the previous certificate stays in use; check the disk that they are on"
    while True:
        await asyncio.sleep(CHECK_EVERY_S)
        timer = loop.call_later(within_s, _log.warning, message, owner, within_s)
        try:
            with suppress(OSError):
                await in_thread(tls.renew)
        finally:
            timer.cancel()


def server_certificates(loaded: LoadedSite) -> ServerCertificates | None:
    """Return the certificates of HTTPS; None for HTTP. Raises ListenError for unusable ones."""
    tls_settings, folder = loaded.site.api.tls, loaded.path.parent
    if tls_settings is None:
        return None
    client_ca = None if tls_settings.client_ca is None else path_of(folder, tls_settings.client_ca)
    return ServerCertificates(
        ServerTls(path_of(folder, tls_settings.certificate), path_of(folder, tls_settings.key), client_ca)
    )


def _status_text(parts: ManagerParts, term: ActiveTerm | None) -> str:
    states = [parts.site.state(name) for name in parts.site.lift_names()]
    live = sum(state.quality is Quality.LIVE for state in states)
    alone = "" if term is None or not term.alone else f"; {term.alone}"
    return f"{counted(len(states), 'lift')}, {live} live, {sum(parts.life.polls().values())} polls{alone}"


async def _serve(
    parts: ManagerParts,
    loaded: LoadedSite,
    keys: Keys | None,
    sock: socket,
    tls: ServerCertificates | None,
    term: ActiveTerm | None,
) -> None:
    api = loaded.site.api
    web = make_app(
        parts.site,
        keys,
        frames=parts.sources,
        metrics=parts.metrics.scrape,
        host_names=(api.host, *api.host_names),
        simulated=loaded.simulated,
        announcements=loaded.announcements(),
        alone="" if term is None else term.alone,
    )
    limits = ConnectionLimits.of(connections_limit(), api.trusted_proxies)
    if term is None:
        await serve(web, sock, tls=tls, limits=limits)
    else:
        nobody = Standby(lambda: "", lambda: "")
        await serve(WhileActive(web, lambda: term.remaining_s, nobody), sock, tls=tls, limits=limits)


async def _first_of(*events: asyncio.Event) -> None:
    """Return once one of these is set."""
    waiting = [asyncio.ensure_future(event.wait()) for event in events]
    try:
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for wait in waiting:
            wait.cancel()


async def _end(parts: ManagerParts, term: ActiveTerm | None, faces: Faces) -> bool:
    """Release everything, unless the other machine of a cluster continues with it; returns whether nothing is left to do."""
    if term is not None and term.handed_over_by:
        parts.site.begin_stopping()
        parts.recorder.note(manager_handed_over(term.key.owner, term.handed_over_by))
        return True
    released = await (_release_outputs(parts) if term is None else _release_in_term(parts, term))
    parts.recorder.note(manager_ended(released=released, commands=bool(_commandable_lifts(parts.site))))
    if faces.hub is not None and faces.hub.updates is not None:
        faces.hub.updates.finish(parts.site, released=released)
    return released


async def _release_in_term(parts: ManagerParts, term: ActiveTerm) -> bool:
    """Release everything as far as the term lasts."""
    clear_s = min(CLEAR_AT_STOP_S, term.clear_s) if term.ends.is_set() else CLEAR_AT_STOP_S
    releasing = asyncio.ensure_future(_release_outputs(parts, clear_s, term.releases))
    over = asyncio.ensure_future(term.over.wait())
    try:
        await asyncio.wait([releasing, over], return_when=asyncio.FIRST_COMPLETED)
        return releasing.result() if releasing.done() else False
    finally:
        for task in (releasing, over):
            task.cancel()
        await asyncio.wait([releasing, over])


async def _release_outputs(
    parts: ManagerParts, clear_s: float = CLEAR_AT_STOP_S, hurry: asyncio.Event | None = None
) -> bool:
    site, life = parts.site, parts.life
    commandable = _commandable_lifts(site)
    waited = await life.clear_doors(clear_s, hurry)
    _log.info(
        "stopping: %s", "releasing everything" if commandable else "nothing is held, every lift is only monitored"
    )
    within_s = RELEASE_AFTER_CLEARING_S if waited else RELEASE_WITHIN_S
    states = [site.state(name) for name in commandable]
    try:
        async with asyncio.timeout(within_s):
            await life.stop()
    except TimeoutError:
        _log.error("not every output could be verified as released within %g s; check the lift", within_s)
        return False
    offline = [state.lift for state in states if state.quality is Quality.OFFLINE]
    for lift in offline:
        _log.warning("%s: is offline, so the outputs of its controller could not be verified", lift)
    if len(offline) < len(states):
        _log.info("everything held%s is released and verified", " on the other lifts" if offline else "")
    return True


def _commandable_lifts(site: Site) -> list[str]:
    """Return the lifts that may be commanded; the others never have held outputs."""
    return [name for name in site.lift_names() if site.config(name).control]


async def _flush_journal(recorder: Recorder, polling: asyncio.Task[None]) -> None:
    """Stop the polls, then wait for the disk; a poll in flight would otherwise report the end of its link after the last commit."""
    polling.cancel()
    await asyncio.wait([polling])
    try:
        async with asyncio.timeout(FLUSH_WITHIN_S):
            await recorder.settled()
    except TimeoutError:
        _log.error(
            "sessions, decisions of people or journal rows are not on the disk after another %g s", FLUSH_WITHIN_S
        )


def _link(
    name: str,
    spec: Controller,
    needs: LinkDefaults,
    make_wire: Callable[[Controller], Wire],
    prepare: Callable[[], Awaitable[None]] | None,
) -> Link:
    settings = LinkSettings(
        timeout_s=needs.timeout_s,
        connect_timeout_s=spec.connect_timeout_s,
        min_gap_s=needs.min_gap_s,
        reconnect_min_s=needs.reconnect_min_s,
        reconnect_max_s=max(needs.reconnect_min_s, LinkSettings().reconnect_max_s),
        max_connections=needs.max_connections,
        tid_echo=needs.tid_echo,
        tls=spec.tls is not None,
    )
    return Link(lambda: make_wire(spec), settings, name=f"{name} ({spec.host}:{spec.port})", prepare=prepare)


@lru_cache(maxsize=KINDS)
def _codes(floors: tuple[tuple[str, Floor], ...]) -> Mapping[str, int]:
    """Return the floor codes of a lift. Lifts with the same floors share them, as what follows."""
    return {name: floor.code for name, floor in floors}


@lru_cache(maxsize=KINDS)
def _doors_at(floors: tuple[tuple[str, Floor], ...], doors: tuple[Side, ...]) -> Mapping[str, tuple[Side, ...]]:
    """Return which doors serve each floor; `doors` are those of the map."""
    return {name: doors if floor.doors is None else floor.doors for name, floor in floors}


def _driver(name: str, loaded: LoadedSite, links: Mapping[str, Link], claim: Claim | None) -> ModbusLift:
    spec, source = loaded.site.lifts[name], loaded.maps[name].map
    placed = devices(loaded.site, spec, source)
    lines = {endpoint: Unit(links[device.controller], device.unit_id) for endpoint, device in placed.items()}
    own = lines.pop("")
    # one limit for all devices of a lift: the smallest
    needs = [loaded.links[device.controller] for device in placed.values()]
    settings = LiftSettings(
        name=name,
        floors=_codes(tuple(spec.floors.items())),
        unit_id=own.unit_id,
        control=spec.access == "control",
        max_age_s=spec.max_age_s or source.link.max_age_s,
        max_registers_per_read=min(need.max_registers_per_read for need in needs),
        max_bits_per_read=min(need.max_bits_per_read for need in needs),
    )
    return ModbusLift(loaded.codecs[name], own.link, settings, endpoints=lines, claim=claim)
