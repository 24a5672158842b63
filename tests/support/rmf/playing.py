"""Plays a schedule of events around one lift to its end, and judges it."""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.rmf.adapter import Adapter
from register_maps.load import MapChanges, load
from tests.support.refusals import reply
from tests.support.rmf.acting import PERSON, Actors
from tests.support.rmf.events import Ends, Event, Fire, LockedOut, SupervisorRestarts, UnheardEnd, WebEnd
from tests.support.rmf.judge import Found, Judge, kept_for
from tests.support.rmf.world import MakeAdapter, RmfWorld, Setting
from tests.support.trip_sites import COMPLETIONS, Completion, site_of

LIFT = "north"
RMF_NAME = "North lift"
STARTS_S = 1.0
"""Before the first event: the manager has read its lift."""
ENDS_WITHIN_S = 400.0
SETTLES_S = 6.0
"""After the last robot: graces and people's turns are over."""
PATIENCE_S = 25.0
"""A person does something about robots that get no further for so long, where RMF itself has lost them."""


NEEDS_HELP = (SupervisorRestarts, Ends, WebEnd, UnheardEnd, Fire, LockedOut)
"""After these RMF, or a robot that nobody can see, may need a person: see `_help`."""


@cache
def loaded_site(name: str, between_sessions_s: float = 2.0, poll_s: float = 0.2) -> LoadedSite:
    """Return a site with one lift of a shipped map, which RMF's building map names otherwise."""
    added = COMPLETIONS.get(name, Completion())
    loaded = load(name, changes=MapChanges(added.parameters, added.override))
    floors = dict(site_of(name).floors)
    lift = {
        "controller": "plc",
        "access": "control",
        "floors": floors,
        "poll_s": max(poll_s, loaded.map.link.min_poll_s),
        "endpoints": {endpoint: {"controller": endpoint} for endpoint in loaded.map.endpoints},
        "infer_occupancy": True,
        "accept_latching": "the controller is simulated",
        "between_sessions_s": between_sessions_s,
        "rmf": {"name": RMF_NAME, "floors": {floor: f"level {number}" for number, floor in enumerate(floors, start=1)}},
    }
    devices = {"plc": {"host": "memory", "port": 1, "map": name}} | {
        endpoint: {"host": "memory", "port": number} for number, endpoint in enumerate(loaded.map.endpoints, start=2)
    }
    site = Site.model_validate({"schema": 1, "name": "campaign", "controllers": devices, "lifts": {LIFT: lift}})
    return LoadedSite(site, {LIFT: loaded}, Path("campaign"))


@dataclass
class Played:
    """What became of one schedule."""

    findings: list[Found] = field(default_factory=list)
    states: int = 0
    opens: int = 0
    requests: int = 0
    presses: int = 0
    writes: int = 0
    rides: int = 0
    helped: int = 0
    """How often a person had to do what RMF itself cannot get out of."""
    lasted_s: float = 0.0
    judge: Judge | None = None
    """Who knows everything that happened; None after a crash at the start."""


def play(
    setting: Setting,
    events: Sequence[Event],
    *,
    map_name: str = "generic-registers",
    make: MakeAdapter = Adapter,
    to_first: bool = False,
) -> Played:
    """Play events to their end, or only until something is found; a crash is a finding."""
    played = Played()

    async def main() -> None:
        world = RmfWorld(loaded_site(map_name, poll_s=setting.poll_s), setting, make)
        played.findings, played.judge = world.judge.findings, world.judge
        async with world.running():
            await elapse(STARTS_S)
            await _all(world, events, played, to_first=to_first)
            judge = world.judge
            played.states, played.opens, played.presses = judge.states, judge.opens, judge.presses
            played.requests, played.writes, played.lasted_s = judge.requests, judge.writes, world.now

    try:
        run_virtual(main, limit_s=2 * ENDS_WITHIN_S)
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        *before, last = traceback.format_exception(_innermost(error))
        played.findings.append(Found(0.0, "crash", f"{last.strip()}\n{''.join(before)}"))
    return played


def _innermost(error: BaseException) -> BaseException:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


async def _all(world: RmfWorld, events: Sequence[Event], played: Played, *, to_first: bool) -> None:
    actors = Actors(world)
    stop = asyncio.Event()
    if to_first:
        world.judge.hears = stop.set
    late = {asyncio.ensure_future(actors.act(event)) for event in events}
    person, found = asyncio.ensure_future(_help(world, actors, played)), asyncio.ensure_future(stop.wait())
    done: list[asyncio.Task[None]] = []
    while late and world.now < ENDS_WITHIN_S and not stop.is_set():
        left_s = ENDS_WITHIN_S - world.now
        over, _ = await asyncio.wait((*late, found), timeout=left_s, return_when=asyncio.FIRST_COMPLETED)
        done += [task for task in late if task in over]
        late = {task for task in late if task not in over}
    if not stop.is_set():
        await elapse(SETTLES_S)
        world.judge.finish(world.now, waiting=actors.waiting, held=world.judge.holder.last is not None)
    for task in (*late, person, found):
        task.cancel()
    await asyncio.gather(*late, person, found, return_exceptions=True)
    for task in done:
        task.result()
    played.rides = actors.done
    if played.helped and not any(isinstance(event, NEEDS_HELP) for event in events):
        world.judge.findings.append(Found(world.now, "never done", "a person had to help, and nothing had happened"))


async def _help(world: RmfWorld, actors: Actors, played: Played) -> None:
    """Do what a person does about a robot that waits for a message that RMF has lost for good.

    A supervisor that was restarted may serve a robot that waits outside before the one in the car: it drops every request of the other
    for as long as the first one asks.
    """
    got, since = (0, ""), world.now
    while True:
        await elapse(5.0)
        if (actors.steps, actors.waiting) != got or not actors.rides:
            got, since = (actors.steps, actors.waiting), world.now
        if world.now - since < PATIENCE_S or not world.states:
            continue
        shown, supervisor = world.states[-1][1].session_id, world.site.supervisor
        doubt = kept_for(world.plant.site.state(world.lift))
        current = None if supervisor is None else supervisor.current.get(world.name)
        if doubt is not None and not actors.inside:
            reply(lambda: world.plant.site.acknowledge(world.lift, PERSON))
        elif current is not None and current.session_id != shown:
            kept = shown if doubt is None else doubt.name  # a robot that a fire or a lockout has left in the car
            actors.serve_instead(kept, current.session_id)
        else:
            continue
        played.helped += 1
        since = world.now
