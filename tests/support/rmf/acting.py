"""Lets events happen in a world, robots and people among them."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace

from lift_manager.lab.virtual_time import elapse
from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lift.rmf_view import rmf_holder
from lift_manager.lift.session import Holder
from lift_manager.runtime.errors import RequestRefused
from register_maps.words import Mode
from simulator import faults as device
from tests.support.refusals import reply
from tests.support.rmf import events as happens
from tests.support.rmf.events import Event, Ride
from tests.support.rmf.fleet import TRAITS, FleetRobot, Phase
from tests.support.rmf.others import RmfWeb, panel_request, request_lift_script
from tests.support.rmf.site import Fleet
from tests.support.rmf.world import RmfWorld

PERSON = "the guard"
STAYS_AWAY_S = 1.0
"""Between two tries of a client of the REST API, and two looks of a person."""
GAVE_UP = "gave up"
LEAVES = "leaves"
LEAVES_WITHIN_S = 30.0
"""So long an outage waits for a robot that leaves the car, and ends its session in it."""
PANEL = "rviz"
AMR = Holder("api", "amr")
WEB = RmfWeb()


@dataclass
class Actors:
    """Everybody who does something, and how far robots got."""

    world: RmfWorld
    rides: dict[str, str] = field(default_factory=dict)
    """Robots under way, and what they wait for."""
    done: int = 0
    gave_up: int = 0
    steps: int = 0
    """Grows whenever a robot gets further."""
    robots: dict[str, FleetRobot] = field(default_factory=dict)
    inside: set[str] = field(default_factory=set)
    """Robots in the car, or in its door."""

    @property
    def waiting(self) -> str:
        return "; ".join(f"{session}: {step}" for session, step in self.rides.items())

    def serve_instead(self, session: str, other: str) -> None:
        """Do what `lift-manager rmf request --session SESSION --instead-of OTHER` sends first."""
        world, robot = self.world, self.robots.get(session)
        world.site.web.publish(WEB.end(world.name, other, "", world.now))
        if robot is not None and robot.floor is not None:
            world.site.web.publish(replace(WEB.request(world.name, robot.floor, world.now), session_id=session))

    async def act(self, event: Event) -> None:
        """Let one event happen when it is due."""
        if isinstance(event, Ride):
            self.rides[event.session] = "not begun"
        await elapse(event.at)
        match event:
            case Ride():
                await self._ride(event)
            case happens.WebRequest():
                await self._ask_in_web(event)
            case happens.Panel():
                await self._ask_in_panel(event)
            case happens.OtherFace():
                await self._use_rest(event)
            case happens.OtherRmf():
                await self._use_other_rmf(event)
            case happens.Ends() | happens.Repeats() | happens.WebEnd() | happens.Script():
                await self._send(event)
            case _:
                await self._strike(event)

    def _floor(self, index: int) -> str:
        """Return RMF's name of a floor."""
        return self.world.floors[index % len(self.world.floors)]

    def _site_floor(self, index: int) -> str:
        floors = tuple(self.world.judge.floors)
        return floors[index % len(floors)]

    # -- robots

    async def _ride(self, ride: Ride) -> None:
        """Ride there, and back again as often as it is to."""
        world, crowds = self.world, iter([True] * ride.crowded)
        traits = TRAITS[world.setting.distribution]
        robot = FleetRobot(ride.session, world.name, traits, crowded=lambda: next(crowds, False))
        self.robots[ride.session] = robot
        fleet = world.site.fleet(ride.session.split("/")[0])
        fleet.add(robot)
        start, end = self._floor(ride.pickup), self._floor(ride.destination)
        if start == end:
            end = self._floor(ride.destination + 1)
        for _ in range(ride.trips):
            if not await self._board(ride, fleet, robot, start):
                robot.abandon(idle=True, now=world.now)
                fleet.do(robot, [])
                self.rides[ride.session] = GAVE_UP
                while robot.floor is not None or self._is_served(ride.session):
                    await elapse(STAYS_AWAY_S)
                self.gave_up += 1
                break
            await self._ride_along(ride, fleet, robot, start, end)
            self.done += 1
            start, end = end, start
        del self.rides[ride.session]

    async def _board(self, ride: Ride, fleet: Fleet, robot: FleetRobot, floor: str) -> bool:
        """Call the lift and get in; False for a robot that gave up outside."""
        fleet.do(robot, robot.request_lift(floor, inside=False, now=self.world.now))
        if ride.replans_outside and not await self._over(robot, "outside", ride.drives_s):
            fleet.do(robot, robot.request_lift(floor, inside=False, now=self.world.now))
        if not await self._over(robot, "outside", ride.gives_up_after_s):
            return False
        await self._drive(ride, robot, floor)
        return True

    async def _ride_along(self, ride: Ride, fleet: Fleet, robot: FleetRobot, start: str, end: str) -> None:
        """Ride, get out, and end the session."""
        fleet.do(robot, robot.request_lift(end, inside=True, now=self.world.now))
        if ride.replans_after_s is not None:
            await elapse(ride.replans_after_s)
            if robot.phase is not Phase.NONE:
                fleet.do(robot, robot.request_lift(start, inside=True, now=self.world.now))
                await elapse(ride.replans_after_s)
                fleet.do(robot, robot.request_lift(end, inside=True, now=self.world.now))
        await self._over(robot, "inside")
        await self._drive(ride, robot, end)
        fleet.do(robot, robot.end_lift_session(self.world.now))
        await self._over(robot, "ending")

    async def _over(self, robot: FleetRobot, where: str, within_s: float | None = None) -> bool:
        """Wait until a phase is over; False where it is not so in time."""
        self.rides[robot.session] = where
        stepped = asyncio.Event()
        self.world.stepped.add(stepped)
        try:
            async with asyncio.timeout(within_s):
                while robot.phase is not Phase.NONE:
                    stepped.clear()
                    await stepped.wait()
        except TimeoutError:
            return False
        finally:
            self.world.stepped.remove(stepped)
        self.steps += 1
        return True

    async def _drive(self, ride: Ride, robot: FleetRobot, floor: str) -> None:
        since = self.world.now
        boards = ride.session not in self.inside
        self.rides[ride.session] = f"drives at {floor}" if boards else f"{LEAVES} at {floor}"
        self.inside.add(ride.session)
        await elapse(ride.drives_s)
        if not boards:
            self.inside.remove(ride.session)
        if robot.saw_it:
            self.world.judge.drove(since, self.world.now, ride.session, floor)
        self.steps += 1

    # -- people and others

    async def _ask_in_web(self, event: happens.WebRequest) -> None:
        world, floor = self.world, self._floor(event.floor)
        world.judge.wants(world.now, WEB.node, floor)
        world.site.web.publish(WEB.request(world.name, floor, world.now))
        await elapse(event.for_s)
        world.judge.wants(world.now, WEB.node, None)
        world.site.web.publish(WEB.end(world.name, WEB.node, floor, world.now))
        await self._until_gone(WEB.node)

    async def _until_gone(self, session: str) -> None:
        """Press END again for as long as the lift is shown as held by one's own."""
        world = self.world
        while True:
            await elapse(5 * STAYS_AWAY_S)
            if not self._is_served(session):
                return
            if session == PANEL:
                world.site.direct(PANEL, WEB.end(world.name, session, "", world.now))
            else:
                world.site.web.publish(WEB.end(world.name, session, "", world.now))

    def _is_served(self, session: str) -> bool:
        """Whether the supervisor or the lift has a session still."""
        supervisor, states = self.world.site.supervisor, self.world.states
        kept = supervisor is not None and any(one.session_id == session for one in supervisor.current.values())
        return kept or (bool(states) and states[-1][1].session_id == session)

    async def _ask_in_panel(self, event: happens.Panel) -> None:
        world, floor = self.world, self._floor(event.floor)
        world.judge.wants(world.now, PANEL, floor)
        world.site.direct(PANEL, panel_request(world.name, floor, PANEL, world.now))
        await elapse(event.for_s)
        world.judge.wants(world.now, PANEL, None)
        world.site.direct(PANEL, WEB.end(world.name, PANEL, floor, world.now))
        await self._until_gone(PANEL)

    async def _use_rest(self, event: happens.OtherFace) -> None:
        """Take the lift as soon as it is to be had, hold it for a while, and let go."""
        world, floor = self.world, self._site_floor(event.floor)
        world.judge.excuse(world.now, "taken", on=True)
        request = FloorRequest(world.lift, AMR, floor, hold_door=True)
        until = world.now + event.for_s
        while world.now < until:
            if world.plant.request(request) is None:
                until = min(until, world.now + event.for_s)
            await elapse(STAYS_AWAY_S)
        while world.judge.holder.last == AMR:
            world.plant.request(FloorRequest(world.lift, AMR, floor, hold_door=False))
            await elapse(STAYS_AWAY_S)
        world.judge.wants(world.now, str(AMR), None)
        world.judge.excuse(world.now, "taken", on=False, lasts_s=10.0)

    async def _use_other_rmf(self, event: happens.OtherRmf) -> None:
        """Take the lift as soon as it is to be had, hold it for a while, and end the session."""
        world, holder = self.world, rmf_holder(event.session, "other")
        world.judge.excuse(world.now, "taken", on=True)
        request = FloorRequest(world.lift, holder, self._site_floor(event.floor), hold_door=True, stays=True)
        until = world.now + event.for_s
        while world.now < until:
            world.plant.request(request)
            await elapse(STAYS_AWAY_S)
        while world.judge.holder.last == holder:
            reply(lambda: world.plant.site.end_session(world.lift, holder, 0.0))
            await elapse(STAYS_AWAY_S)
        world.judge.wants(world.now, str(holder), None)
        world.judge.excuse(world.now, "taken", on=False, lasts_s=10.0)

    async def _send(self, event: Event) -> None:
        world = self.world
        match event:
            case happens.WebEnd(session=session, floor=floor):
                world.judge.excuse(world.now, "ended", on=False, lasts_s=2.0)
                world.site.web.publish(WEB.end(world.name, session, self._floor(floor), world.now))
            case happens.Script(floor=floor):
                script = request_lift_script(world.name, self._floor(floor), round(event.at * 1e6), world.now)
                world.site.direct("request_lift.py", script)
            case happens.Ends(session=session, floor=floor_text, count=count, every_s=every_s):
                for _ in range(count):
                    world.judge.excuse(world.now, "ended", on=False, lasts_s=2.0)
                    world.site.direct("somebody", WEB.end(world.name, session, floor_text, world.now))
                    await elapse(every_s)
            case happens.Repeats(count=count, every_s=every_s):
                for _ in range(count):
                    supervisor = world.site.supervisor
                    for request in () if supervisor is None else tuple(supervisor.current.values()):
                        world.site.repeat(request)
                    await elapse(every_s)
            case _:
                pass

    # -- what strikes the programs and the lift

    async def _strike(self, event: Event) -> None:
        world, judge = self.world, self.world.judge
        match event:
            case happens.Unplugged(for_s=for_s):
                judge.excuse(world.now, "offline", on=True)
                world.plant.plug(on=False)
                await elapse(for_s)
                world.plant.plug(on=True)
                judge.excuse(world.now, "offline", on=False, lasts_s=10.0)
            case happens.Fire():
                await self._burn(event)
            case happens.LockedOut(for_s=for_s):
                await self._manager_is_up()
                reply(lambda: world.plant.site.lock_out(world.lift, PERSON, "moving furniture"))
                await elapse(for_s)
                await self._manager_is_up()
                reply(lambda: world.plant.site.end_lockout(world.lift, PERSON))
            case _:
                await self._strike_program(event)

    async def _manager_is_up(self) -> None:
        """Wait as a person does whose command finds nobody."""
        while not self.world.manager_is_up:
            await elapse(STAYS_AWAY_S)

    async def _strike_program(self, event: Event) -> None:
        world, judge = self.world, self.world.judge
        match event:
            case happens.SupervisorRestarts(down_s=down_s):
                world.site.stop_supervisor()
                await elapse(down_s)
                world.site.start_supervisor()
            case happens.AdapterRestarts(down_s=down_s):
                await self._restart_adapter(down_s)
            case happens.ManagerRestarts(down_s=down_s):
                judge.excuse(world.now, "down", on=True)
                await world.kill_manager()
                await elapse(down_s)
                await world.start_manager()
                judge.excuse(world.now, "down", on=False, lasts_s=3.0)
            case happens.Takeover(down_s=down_s):
                judge.excuse(world.now, "down", on=True)
                judge.excuse(world.now, "adapter", on=True)
                await world.kill_machine()
                await elapse(down_s)
                await world.take_over()
                judge.excuse(world.now, "adapter", on=False)
                judge.excuse(world.now, "down", on=False, lasts_s=3.0)
            case happens.WayCut(for_s=for_s):
                await self._cut_way(for_s)
            case happens.Outage(for_s=for_s):
                until = world.now + LEAVES_WITHIN_S
                while world.now < until and not any(step.startswith(LEAVES) for step in self.rides.values()):
                    await elapse(0.1)
                await self._cut_way(for_s, restarts=True)
            case happens.UnheardEnd(session=session, down_s=down_s):
                world.site.stop_supervisor()
                await elapse(down_s / 2)
                world.site.web.publish(WEB.end(world.name, session, "", world.now))
                await elapse(down_s / 2)
                world.site.start_supervisor()
            case _:
                raise AssertionError(f"nobody knows how to let {event} happen")

    async def _restart_adapter(self, down_s: float) -> None:
        world, judge = self.world, self.world.judge
        judge.excuse(world.now, "adapter", on=True)
        world.kill_adapter()
        await elapse(down_s)
        world.start_adapter()
        judge.excuse(world.now, "adapter", on=False)

    async def _cut_way(self, for_s: float, *, restarts: bool = False) -> None:
        world, judge = self.world, self.world.judge
        judge.excuse(world.now, "down", on=True)
        world.cut_way("the network is cut")
        await elapse(for_s / 2)
        if restarts:
            await self._restart_adapter(0.0)
        await elapse(for_s / 2)
        world.mend_way()
        judge.excuse(world.now, "down", on=False, lasts_s=3.0)

    async def _burn(self, event: happens.Fire) -> None:
        world, judge = self.world, self.world.judge
        fire = device.InMode(Mode.FIRE)
        judge.excuse(world.now, "fire", on=True)
        world.plant.begin(world.lift, fire)
        await elapse(event.for_s)
        world.plant.end(world.lift, fire)
        await elapse(event.acknowledged_after_s)

        def acknowledge() -> object:
            return world.plant.site.acknowledge(world.lift, PERSON)

        while isinstance(reply(acknowledge), RequestRefused) and self._latched():
            await elapse(STAYS_AWAY_S)
        judge.excuse(world.now, "fire", on=False, lasts_s=10.0)

    def _latched(self) -> bool:
        return self.world.plant.site.state(self.world.lift).restrictions.fire_latched
