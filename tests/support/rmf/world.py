"""Open-RMF, the adapter, the manager and a simulated lift on virtual time, with the judge watching."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from random import Random
from typing import Protocol

from lift_manager.config.load import LoadedSite
from lift_manager.lab.virtual_time import elapse
from lift_manager.lab.world.reviewed import evidence_of
from lift_manager.lab.world.world import World
from lift_manager.plain.rmf import Alarms, SiteView
from lift_manager.rmf.adapter import Adapter, RmfOutput
from lift_manager.rmf.early_ends import EarlyEnds
from lift_manager.rmf.lasting import KEEP_ENDS_S
from lift_manager.rmf.lift_sessions import REPLAY_S
from lift_manager.rmf.local_manager import LocalManager
from lift_manager.rmf.messages import DOOR_CLOSED, END_SESSION, LiftRequest, LiftState, Time
from lift_manager.rmf.port import Answer, Manager, ManagerListener
from register_maps.codec import compile_map
from register_maps.words import Mode
from simulator.state import Parameters
from tests.support.rmf.fleet import TRAITS, FleetRobot
from tests.support.rmf.judge import Judge
from tests.support.rmf.site import RmfSite
from tests.support.rmf.way import Way

DWELL_S = 1.0
"""Of the doors, in real seconds however fast the machine runs: a hold has to come before it is over."""
LEAST_S = 0.001
"""Between two looks at the adapter."""


class AnyAdapter(ManagerListener, Protocol):
    """The adapter, or one that breaks a rule."""

    def on_request(self, request: LiftRequest, now: float) -> None: ...

    def on_fleet_request(self, request: LiftRequest, now: float) -> None: ...

    def on_request_writer(self, now: float) -> None: ...

    def tick(self, now: float) -> float: ...


MakeAdapter = Callable[[Manager, RmfOutput, Callable[[], float]], AnyAdapter]


@dataclass(frozen=True)
class Setting:
    """What stays the same for a whole run."""

    distribution: str = "kilted"
    seed: int = 1
    message_s: float = 0.02
    """The longest delay of a message of RMF."""
    way_s: float = 0.0
    """The longest delay between adapter and manager; 0 is the same process."""
    speed: float = 4.0
    """How fast time runs for the machine of the lift."""
    poll_s: float = 0.2


class Plant(World):
    """A world whose manager may be away for a while between its end and its next start."""

    async def kill(self) -> None:
        """Kill the manager as `kill -9` does."""
        program, self._program = self._program, []
        for task in program:
            task.cancel()
        await asyncio.gather(*program, return_exceptions=True)
        for controller in self._controllers.values():
            controller.hang_up()
        self._subscriptions.close()

    def plug(self, *, on: bool) -> None:
        """Take every controller off the network, or put it back."""
        for controller in self._controllers.values():
            controller.switch(on=on)

    def revive(self) -> None:
        """Start it with what it had written down."""
        self._build()
        self._start()


class RmfWorld:
    """One lift, and everybody who uses it."""

    def __init__(self, loaded: LoadedSite, setting: Setting, make_adapter: MakeAdapter = Adapter) -> None:
        self.setting = setting
        self.dice = Random(setting.seed)
        self._make_adapter = make_adapter
        (self.lift,) = loaded.site.lifts
        spec, codec = loaded.site.lifts[self.lift], compile_map(loaded.maps[self.lift].map)
        self.judge = Judge(
            lift=self.lift,
            floors={site: spec.rmf.floors.get(site, site) for site in spec.floors},
            grace_s=loaded.site.rmf.end_grace_s,
            max_age_s=spec.max_age_s or codec.map.link.max_age_s,
            holds=frozenset(name for name in codec.commands if name.startswith("hold_door.")),
            silent_driving=TRAITS[setting.distribution].timer,
            tells_fire=Mode.FIRE in evidence_of(codec.map)[0].modes,
        )
        self.name = spec.rmf.name or self.lift
        """The lift's name in RMF."""
        self.floors = tuple(self.judge.floors.values())
        settings = {self.lift: Parameters(speed=setting.speed, dwell_s=DWELL_S * setting.speed)}
        self.plant = Plant(loaded, (self.judge,), seed=setting.seed, settings=settings)
        self.way = Way(self.dice, setting.way_s)
        self._ends, self._fleet_ends = EarlyEnds(KEEP_ENDS_S), EarlyEnds(KEEP_ENDS_S)
        """What the other one of two machines has received."""
        self._writer_found_at = -math.inf
        self.adapter: AnyAdapter | None = None
        self._look_at: asyncio.Handle | None = None
        self._inside: LocalManager | None = None
        self.site: RmfSite
        self.manager_is_up = True
        self.states: list[tuple[float, LiftState]] = []
        self.stepped: set[asyncio.Event] = set()
        """Set with each step of a robot."""

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    @asynccontextmanager
    async def running(self) -> AsyncIterator[RmfWorld]:
        """Run everything for as long as the context lasts."""
        async with self.plant.running():
            self.site = RmfSite(
                self.setting.distribution,
                self.dice,
                self.setting.message_s,
                request=self._requested,
                fleet_request=self._fleet_requested,
                matched=self._matched,
                stepped=self._robot_stepped,
            )
            self._reach_manager()
            self.start_adapter()
            try:
                yield self
            finally:
                self.site.stop()
                self.kill_adapter()
                self._leave_manager()

    # -- what happens to the programs

    def start_adapter(self) -> None:
        """Start one that knows nothing."""
        self._begin_adapter()
        self.site.adapter_is_back()

    def _begin_adapter(self) -> None:
        adapter = self.adapter = self._make_adapter(self.way, RmfOutput(self._publish, _NoAlarm()), lambda: self.now)
        self.way.listener = _Ears(adapter, self._soon)
        self._leave_manager()
        self._reach_manager()
        self._soon()

    def kill_adapter(self) -> None:
        """End it as `kill -9` does."""
        self.site.adapter_gone()
        self._forget_adapter()

    def _forget_adapter(self) -> None:
        self.adapter = None
        self.way.forget()
        self.judge.quiet(self.now)
        if self._look_at is not None:
            self._look_at.cancel()

    async def kill_machine(self) -> None:
        """Kill the active one of two machines; what is under way to the other one arrives there."""
        self._forget_adapter()
        await self.kill_manager()

    async def take_over(self) -> None:
        """Let the other machine continue with what was written down, and with the ENDs that it has received."""
        await self.start_manager()
        self._begin_adapter()
        # before the manager's first answer, which the loop delivers
        if self.now - self._writer_found_at < REPLAY_S:
            self._tell_matched()
        for ends, reach in ((self._ends, self._reach_adapter), (self._fleet_ends, self._reach_adapter_of_fleets)):
            for lift, session in ends.at(self.now):
                self.judge.excuse(self.now, "ended", on=False, lasts_s=2.0)
                reach(LiftRequest(lift, Time.of(self.now), session, END_SESSION, "", DOOR_CLOSED))

    async def kill_manager(self) -> None:
        """End the manager as `kill -9` does; the adapter goes on."""
        self.cut_way("the manager is not there")
        self._leave_manager()
        self.manager_is_up = False
        await self.plant.kill()

    async def start_manager(self) -> None:
        """Start it again with what it had written down, which it takes up before any face is served."""
        self.plant.revive()
        self.manager_is_up = True
        await elapse(LEAST_S)
        self.mend_way()

    def cut_way(self, reason: str) -> None:
        """Let the adapter not hear the manager."""
        self.way.cut(reason)
        self._soon()

    def mend_way(self) -> None:
        """Let it hear the manager again."""
        self.way.mend()
        self._leave_manager()
        self._reach_manager()

    def _reach_manager(self) -> None:
        self._inside = LocalManager(self.plant.site)
        self.way.connect(self._inside)
        self._inside.start(self.way, _deliver)

    def _leave_manager(self) -> None:
        if self._inside is not None:
            self._inside.close()
            self._inside = None

    # -- what goes to and comes from the adapter

    def _requested(self, request: LiftRequest) -> None:
        self._ends.note(request, self.now)
        self._reach_adapter(request)

    def _fleet_requested(self, request: LiftRequest) -> None:
        self._fleet_ends.note(request, self.now)
        self._reach_adapter_of_fleets(request)

    def _reach_adapter(self, request: LiftRequest) -> None:
        if self.adapter is not None:
            self.judge.arrived(self.now, request)
            self.adapter.on_request(request, self.now)
            self._soon()

    def _reach_adapter_of_fleets(self, request: LiftRequest) -> None:
        if self.adapter is not None:
            self.judge.fleet_sent(self.now, request)
            self.adapter.on_fleet_request(request, self.now)
            self._soon()

    def _matched(self) -> None:
        self._writer_found_at = self.now
        self._tell_matched()

    def _tell_matched(self) -> None:
        if self.adapter is not None:
            self.adapter.on_request_writer(self.now)
            self._soon()

    def _publish(self, state: LiftState) -> None:
        self.states.append((self.now, state))
        self.judge.state_sent(self.now, state)
        self.site.state(state)

    def _soon(self) -> None:
        if self._look_at is not None:
            self._look_at.cancel()
        self._look_at = asyncio.get_running_loop().call_soon(self._look)

    def _look(self) -> None:
        if self.adapter is not None:
            due = max(self.adapter.tick(self.now), self.now + LEAST_S)
            self._look_at = asyncio.get_running_loop().call_at(due, self._look)

    def _robot_stepped(self, robot: FleetRobot) -> None:
        self.judge.wants(self.now, robot.session, robot.floor)
        for event in self.stepped:
            event.set()


class _Ears:
    """What the adapter hears of the manager; after each word somebody looks at it."""

    def __init__(self, adapter: AnyAdapter, then: Callable[[], None]) -> None:
        self._adapter = adapter
        self._then = then

    def on_site(self, site: SiteView, asked_at: float, now: float) -> None:
        self._adapter.on_site(site, asked_at, now)
        self._then()

    def on_answer(self, answer: Answer, now: float) -> None:
        self._adapter.on_answer(answer, now)
        self._then()

    def on_manager_lost(self, reason: str, now: float) -> None:
        self._adapter.on_manager_lost(reason, now)
        self._then()


def _deliver(call: Callable[[], None]) -> None:
    asyncio.get_running_loop().call_soon(call)


class _NoAlarm:
    """Fires are told by the mode here."""

    def offer(self, alarms: Alarms) -> None: ...

    def publish_alarms(self, alarms: Alarms, *, on: bool) -> None: ...

    def forget(self) -> None: ...
