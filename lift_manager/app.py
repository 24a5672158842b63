"""The one place where the parts of a running manager are put together, and taken apart again."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from socket import socket
from zoneinfo import ZoneInfo

from drivers.driver import LiftDriver
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.lock import controller_lock
from drivers.modbus.plan import polled_points
from drivers.modbus.settings import LinkSettings
from drivers.modbus.tls import LinkTls
from drivers.modbus.units import Unit
from drivers.modbus.wire import PymodbusWire, Wire
from drivers.thread import in_thread
from lift_manager.config.check import canonical_host
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Api, Controller
from lift_manager.config.tls import path_of, tls_cautions
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.hours import RobotHours
from lift_manager.lift.journal import Row
from lift_manager.lift.state import Quality
from lift_manager.metrics.metrics import Metrics
from lift_manager.plain.text import counted
from lift_manager.plain.version import running_version
from lift_manager.rmf.dds import Dds
from lift_manager.rmf.local_manager import LocalManager
from lift_manager.rmf.ros_settings import RosSettings
from lift_manager.rmf.run import RunningAdapter
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.journal import manager_ended, manager_started
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.progress import patience_s
from lift_manager.runtime.recorder import Clock, MemoryRecorder, Recorder, wall_clock
from lift_manager.runtime.site import Site
from lift_manager.site_links import SiteLinks
from lift_manager.store.keys import KeyFile
from lift_manager.systemd import notifier, watch
from lift_manager.web.app import make_app
from lift_manager.web.connections import ConnectionLimits
from lift_manager.web.limits import connections_limit
from lift_manager.web.server import serve
from lift_manager.web.tls import ServerCertificates, ServerTls
from register_maps.codec import compile_map
from register_maps.schema import LinkDefaults

_log = logging.getLogger(__name__)

FIRST_LOOK_S = 1.0
"""How long the first answer to a client may wait for the first reading of every lift. Chosen: a controller that is there answers in
a fraction of it, and nobody waits longer for one that is not."""

RELEASE_WITHIN_S = 3.0
"""How long the end may wait for outputs to be let go and verified, of the 5 s in which the process must be out. Chosen: on a busy
computer of two cores the interpreter needs more than a second to clear up."""

RELEASE_AFTER_CLEARING_S = 0.8
"""The same after the wait for a robot that may be in a doorway (`lift.session.CLEAR_AT_STOP_S`)."""

REMIND_EVERY_S = 86400.0
"""Chosen: whoever reads the log finds it, and does not find much else."""

LOOK_EVERY_S = 1.0
"""How often the files of HTTPS are looked at. Chosen: nobody waits longer for a certificate that was just renewed."""

LOOK_WITHIN_S = 10.0
"""Chosen: a disk that takes longer is told of."""

REMEMBER_WITHIN_S = 0.5
"""How long the end may wait beyond that for the disk, while the web server closes: writing began with the release."""


@dataclass(frozen=True, slots=True)
class Faces:
    """What is particular to how others reach a manager."""

    keys: KeyFile | None = None
    """Of the API; none are asked for without."""
    rmf: RosSettings | None = None
    """Where its lifts are those of Open-RMF; nowhere without."""


@dataclass(frozen=True, slots=True)
class Building:
    """The parts of a running manager."""

    site: Site
    life: SiteLife
    actors: tuple[LiftActor, ...]
    """The lifts in the order of the site file."""
    recorder: Recorder
    links: tuple[Link, ...]
    sources: SiteLinks
    """What faces know of the links."""
    metrics: Metrics
    bus: Bus[Event]
    """What happens is published here; faces listen through the site."""


def over_network(folder: Path) -> Callable[[Controller], Wire]:
    """Make wires as a site file says, with TLS and without; `folder` is that of the file."""

    @cache  # one for all connections of a link: it remembers what it has read
    def tls_of(controller: Controller) -> LinkTls | None:
        if (said := controller.tls) is None:
            return None
        ca, certificate, key = (path_of(folder, file) for file in (said.ca, said.certificate, said.key))
        return LinkTls(ca=ca, certificate=certificate, key=key, server_name=said.server_name)

    return lambda controller: PymodbusWire(controller.host, controller.port, tls=tls_of(controller))


def build(
    loaded: LoadedSite,
    make_wire: Callable[[Controller], Wire] | None = None,
    *,
    recorder: Recorder | None = None,
    clock: Clock | None = None,
) -> Building:
    """Make one link per controller, over the network unless told otherwise, and hand it to the lifts on it.

    Without a recorder a restart forgets sessions, what people decided, and what was done.
    """
    recorder = recorder or MemoryRecorder()
    clock = clock or wall_clock(None if loaded.site.timezone is None else ZoneInfo(loaded.site.timezone))
    make_wire = make_wire or over_network(loaded.path.parent)
    bus: Bus[Event] = Bus()
    links = {name: _link(name, spec, loaded.links[name], make_wire) for name, spec in loaded.controllers.items()}
    actors = tuple(
        LiftActor(driver, lift_config(name, loaded, driver), bus, recorder, clock=clock)
        for name, driver in ((name, _driver(name, loaded, links)) for name in loaded.site.lifts)
    )
    site = Site(actors, bus, recorder, rmf=loaded.site.rmf.rules, clock=clock)
    life = SiteLife(site, actors)
    sources = SiteLinks(links)
    metrics = Metrics(site, life, sources, version=running_version())
    return Building(site, life, actors, recorder, tuple(links.values()), sources, metrics, bus)


def lift_config(name: str, loaded: LoadedSite, driver: LiftDriver) -> LiftConfig:
    """Return what site file and map say about a lift."""
    spec, doors = loaded.site.lifts[name], driver.capabilities.doors
    return LiftConfig(
        name=name,
        source=driver.source,
        floors=tuple(spec.floors),
        doors_at={floor: doors if entry.doors is None else entry.doors for floor, entry in spec.floors.items()},
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
) -> bool:
    """Serve a site on a listening socket until `stop` is set; returns whether every output was seen to be let go.

    Raises ControllerTaken, LockUnusable, ListenError for certificates that cannot be used, or DdsError, before anything is begun.
    """
    faces = faces or Faces()
    tls = _https(loaded)
    with ExitStack() as ends:
        for controller in loaded.controllers.values():
            ends.enter_context(controller_lock(canonical_host(controller.host), controller.port))
        building = build(loaded, recorder=recorder)
        systemd, site, life = notifier(), building.site, building.life
        adapter = _adapter(building, faces.rmf, ends)
        crashes: list[Exception] = []

        async def guarded(work: Coroutine[None, None, None]) -> None:
            """Let a bug in one part end the program only after every lift has been let go."""
            try:
                await work
            except Exception as bug:  # noqa: BLE001  it is raised again once nothing is held any more
                crashes.append(bug)
                stop.set()

        async with asyncio.TaskGroup() as tasks:
            building.recorder.note(_started(loaded))
            polling = tasks.create_task(guarded(life.run()))
            parts = _parts(building, loaded, faces.keys, tls, adapter)
            running = [tasks.create_task(guarded(part)) for part in parts]
            with suppress(TimeoutError):
                async with asyncio.timeout(FIRST_LOOK_S):
                    await life.first_look()
            serving = tasks.create_task(guarded(_serve(building, loaded.site.api, faces.keys, sock, tls)))
            patience_s_of = patience(loaded, building.links) if systemd.is_heard else {}
            alive = guarded(watch(systemd, patience_s_of, life.polls, lambda: _status(building)))
            running.append(tasks.create_task(alive))
            ready()
            await stop.wait()
            systemd.send("STOPPING=1", "STATUS=letting go of everything")
            if adapter is not None:
                # before a door is let go: no robot may begin to drive in
                adapter.go_offline()
            released = await _let_go(building)
            building.recorder.note(manager_ended(released=released, commands=bool(_commanded(site))))
            serving.cancel()
            await _write_down(building.recorder, polling)
            for task in running:
                task.cancel()
    if crashes:
        raise ExceptionGroup("the manager ended because of a bug", crashes)
    return released


def _parts(
    building: Building,
    loaded: LoadedSite,
    keys: KeyFile | None,
    tls: ServerCertificates | None,
    adapter: RunningAdapter | None,
) -> Iterator[Coroutine[None, None, None]]:
    """Yield what runs all the time, except for the polls and the web server."""
    recorder = building.recorder
    yield from (link.run() for link in building.links)
    yield from building.life.drives()
    yield from (recorder.run(building.site.report_disk), building.metrics.run(), remind(loaded))
    if keys is not None:
        yield keys.run(recorder.note)
    if tls is not None:
        yield renew(tls)
    if adapter is not None:
        yield adapter.run()


def _adapter(building: Building, settings: RosSettings | None, ends: ExitStack) -> RunningAdapter | None:
    """Join Open-RMF if there are settings for it, on the running loop. Raises DdsError."""
    if settings is None:
        return None
    adapter = RunningAdapter(
        lambda listener, deliver: Dds(settings, listener, deliver),
        lambda: LocalManager(building.site),
        use_sim_time=settings.use_sim_time,
        adapter_id=settings.adapter,
    )
    adapter.open()
    ends.callback(adapter.close)
    building.metrics.count_rmf(adapter.counts)
    return adapter


def patience(loaded: LoadedSite, links: tuple[Link, ...]) -> dict[str, float]:
    """Return how long the polls of each lift may stand still before its own loop must be what hangs, in seconds."""
    link_of = dict(zip(loaded.controllers, links, strict=True))
    used = {
        name: {device.controller for device in devices(loaded.site, spec, loaded.maps[name].map).values()}
        for name, spec in loaded.site.lifts.items()
    }
    found = {}
    for name, spec in loaded.site.lifts.items():
        codec = compile_map(loaded.maps[name].map, offset=spec.offset)
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


def _started(loaded: LoadedSite) -> Row:
    lifts = loaded.site.lifts.items()
    maps = {name: (lift.access, loaded.maps[name].map.name, loaded.maps[name].sha256) for name, lift in lifts}
    return manager_started(running_version(), maps)


async def remind(loaded: LoadedSite, *, every_s: float = REMIND_EVERY_S) -> None:
    """Say once a day which certificates expire soon: a manager may run for longer than they last."""
    while True:
        await asyncio.sleep(every_s)
        # in a thread, as whatever touches these files: a disk that hangs must not hold up the lifts
        with suppress(OSError):
            await in_thread(lambda: _remind(loaded))


def _remind(loaded: LoadedSite) -> None:
    for line in tls_cautions(loaded.site, loaded.path.parent):
        _log.warning("%s", line)


async def renew(tls: ServerCertificates, *, within_s: float = LOOK_WITHIN_S) -> None:
    """Keep HTTPS at what its files say."""
    loop = asyncio.get_running_loop()
    message = "api: the files of `tls` do not answer within %g s, the last certificate is shown on; look at the disk that they are on"
    while True:
        await asyncio.sleep(LOOK_EVERY_S)
        late = loop.call_later(within_s, _log.warning, message, within_s)
        try:
            with suppress(OSError):
                await in_thread(tls.renew)
        finally:
            late.cancel()


def _https(loaded: LoadedSite) -> ServerCertificates | None:
    said, folder = loaded.site.api.tls, loaded.path.parent
    if said is None:
        return None
    client_ca = None if said.client_ca is None else path_of(folder, said.client_ca)
    return ServerCertificates(ServerTls(path_of(folder, said.certificate), path_of(folder, said.key), client_ca))


def _status(building: Building) -> str:
    states = [building.site.state(name) for name in building.site.lift_names()]
    live = sum(state.quality is Quality.LIVE for state in states)
    return f"{counted(len(states), 'lift')}, {live} live, {sum(building.life.polls().values())} polls"


async def _serve(
    building: Building, api: Api, keys: KeyFile | None, sock: socket, tls: ServerCertificates | None
) -> None:
    names = (api.host, *api.host_names)
    web = make_app(building.site, keys, frames=building.sources, metrics=building.metrics.scrape, host_names=names)
    await serve(web, sock, tls=tls, limits=ConnectionLimits.of(connections_limit(), api.trusted_proxies))


async def _let_go(building: Building) -> bool:
    site, life = building.site, building.life
    commanded = _commanded(site)
    waited = await life.clear_doors()
    _log.info("stopping: %s", "releasing everything" if commanded else "nothing is held, every lift is only watched")
    within_s = RELEASE_AFTER_CLEARING_S if waited else RELEASE_WITHIN_S
    states = [site.state(name) for name in commanded]
    try:
        async with asyncio.timeout(within_s):
            await life.stop()
    except TimeoutError:
        _log.error("not every output could be verified as let go within %g s; look at the lift", within_s)
        return False
    unseen = [state.lift for state in states if state.quality is Quality.OFFLINE]
    for lift in unseen:
        _log.warning("%s: is offline, so nobody could look at what its controller holds", lift)
    if len(unseen) < len(states):
        _log.info("everything we held%s is let go and verified", " on the other lifts" if unseen else "")
    return True


def _commanded(site: Site) -> list[str]:
    """Name the lifts that may be commanded: of the others nothing is ever held."""
    return [name for name in site.lift_names() if site.config(name).control]


async def _write_down(recorder: Recorder, polling: asyncio.Task[None]) -> None:
    """End the polls and wait for the disk: to a poll in flight, the end of its link would be news that nobody writes down any more."""
    polling.cancel()
    await asyncio.wait([polling])
    try:
        async with asyncio.timeout(REMEMBER_WITHIN_S):
            await recorder.settled()
    except TimeoutError:
        _log.error(
            "sessions, people's words or rows of the journal are not on the disk after %g s more", REMEMBER_WITHIN_S
        )


def _link(name: str, spec: Controller, needs: LinkDefaults, make_wire: Callable[[Controller], Wire]) -> Link:
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
    return Link(lambda: make_wire(spec), settings, name=f"{name} ({spec.host}:{spec.port})")


def _driver(name: str, loaded: LoadedSite, links: Mapping[str, Link]) -> ModbusLift:
    spec, source = loaded.site.lifts[name], loaded.maps[name].map
    placed = devices(loaded.site, spec, source)
    lines = {endpoint: Unit(links[device.controller], device.unit_id) for endpoint, device in placed.items()}
    own = lines.pop("")
    # one limit for every device of a lift: the smallest
    needs = [loaded.links[device.controller] for device in placed.values()]
    settings = LiftSettings(
        name=name,
        floors={floor: entry.code for floor, entry in spec.floors.items()},
        unit_id=own.unit_id,
        control=spec.access == "control",
        max_age_s=spec.max_age_s or source.link.max_age_s,
        max_registers_per_read=min(need.max_registers_per_read for need in needs),
        max_bits_per_read=min(need.max_bits_per_read for need in needs),
    )
    return ModbusLift(compile_map(source, offset=spec.offset), own.link, settings, endpoints=lines)
