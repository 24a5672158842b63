"""A whole manager on the loop of the bench, on a free port, and the handle for a test."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from socket import socket
from typing import Any, TypeVar

from drivers.model import FloorName, Outcome
from lift_manager import app
from lift_manager.config.load import load_site
from lift_manager.lab.bench.errors import BenchError, ConditionNotMet
from lift_manager.lab.bench.log import Log, LogEntry
from lift_manager.lab.bench.plan import LiftPlan
from lift_manager.lab.bench.simulator import HOST, WITHIN_S, LiftSimulator, Plant
from lift_manager.lab.bench.thread import LoopThread
from lift_manager.lab.bench.wire import ModbusFaults, Wires
from lift_manager.lift.events import Acknowledged, Restriction, RestrictionEnded
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Accepted, Refused
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.runtime.bus import Event, StateChanged, Subscription
from lift_manager.runtime.errors import RequestRefused
from lift_manager.web.app import make_app
from lift_manager.web.server import listen, serve
from register_maps.errors import MapFileError

FACE = "bench"
"""The face of requests that a test sends for another caller."""

Reply = TypeVar("Reply")

StateCondition = Callable[[LiftState], bool]
EventCondition = Callable[[Event | Refused], bool]


class RunningSite:
    """The manager of a test; call its methods on the loop of the bench."""

    def __init__(self, plans: Sequence[LiftPlan], wires: Wires, plants: Mapping[str, Plant], folder: Path) -> None:
        """`folder` takes the site file. Raises BenchError for an invalid site file."""
        path = folder / "site.yaml"
        path.write_text(json.dumps(site_file(plans, wires.ports, folder), indent=2), "utf-8")
        try:
            loaded = load_site(path)
        except MapFileError as error:
            found = "\n".join(f"{finding.key}: {finding.message}" for finding in error.findings)
            raise BenchError(f"the marker `lift` makes an invalid site:\n{found}") from error
        self.log = Log()
        self.port = 0
        self._plants = plants
        self._building = app.build(loaded)
        self.site = self._building.site
        self.site.refusals.on_raised.append(self.log.add)
        self._running: list[asyncio.Task[None]] = []

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Drive the lifts and serve the API. Raises the error of any part of the manager."""
        life = self._building.life
        with listen(HOST, 0) as sock, self.site.listen() as events:
            self.port = sock.getsockname()[1]
            async with asyncio.TaskGroup() as tasks:
                parts = [*(link.run() for link in self._building.links), *life.drives(), life.run()]
                self._running += [tasks.create_task(part) for part in (*parts, self._listen(events))]
                with suppress(TimeoutError):
                    async with asyncio.timeout(app.FIRST_READING_S):
                        await life.first_look()
                self._running.append(tasks.create_task(self._serve(sock)))
                yield
                self._cancel()

    async def stop(self) -> bool:
        """Stop the manager in order; returns whether the release of every output was verified."""
        released = False
        with suppress(TimeoutError):
            async with asyncio.timeout(app.RELEASE_WITHIN_S):
                await self._building.life.stop()
                released = True
        self._cancel()
        await asyncio.wait(self._running)
        return released

    async def wait_for_state(self, lift: str, condition: StateCondition, within_s: float) -> LiftState:
        """Return the first state that meets the condition. Raises ConditionNotMet."""
        with self.site.listen() as events:
            try:
                async with asyncio.timeout(within_s):
                    while True:
                        event = await events.next()
                        if isinstance(event, StateChanged) and event.lift == lift and condition(event.state):
                            return event.state
            except TimeoutError:
                raise ConditionNotMet(self._timeout_text(lift, within_s)) from None

    async def wait_for_entry(self, condition: EventCondition, within_s: float) -> LogEntry:
        """Return the first entry of the log that meets the condition. Raises ConditionNotMet."""
        with self.log.news.listen() as news:
            for entry in self.log.entries:
                if condition(entry.what):
                    return entry
            try:
                async with asyncio.timeout(within_s):
                    while not condition((entry := await news.next()).what):
                        pass
                    return entry
            except TimeoutError:
                found = "; ".join(str(entry.what) for entry in self.log.entries) or "nothing"
                raise ConditionNotMet(f"no such event within {within_s:g} s; there was {found}") from None

    async def _serve(self, sock: socket) -> None:
        await serve(make_app(self.site), sock)

    async def _listen(self, events: Subscription[Event]) -> None:
        while True:
            event = await events.next()
            if not isinstance(event, StateChanged):
                self.log.add(event.lift, event)

    def _cancel(self) -> None:
        for task in self._running:
            task.cancel()

    def _timeout_text(self, lift: str, within_s: float) -> str:
        lines = [
            f"{lift}: the condition was not met within {within_s:g} s",
            f"published: {self.site.state(lift)}",
            f"truth: {self._plants[lift].look()}",
            *(f"event: {entry.what}" for entry in self.log.entries if entry.lift == lift),
        ]
        return "\n".join(lines)


class LiftSite:
    """A manager of simulated lifts, for use from any thread. In a test with one lift, its name may be omitted."""

    def __init__(
        self, site: RunningSite, simulators: Mapping[str, LiftSimulator], faults: ModbusFaults, thread: LoopThread
    ) -> None:
        self._running = site
        self._simulators = simulators
        self._faults = faults
        self._thread = thread

    @property
    def address(self) -> str:
        """The address of the manager, such as `http://127.0.0.1:40123`."""
        return f"http://{HOST}:{self._running.port}"

    @property
    def url(self) -> str:
        """The base of the workshop API: `lift_names`, `lift_state` and `lift_request` are below it."""
        return f"{self.address}/open-rmf/demo-lift"

    @property
    def lifts(self) -> tuple[str, ...]:
        """The names of the lifts, in the order of their markers."""
        return tuple(self._simulators)

    def simulator(self, lift: str | None = None) -> LiftSimulator:
        """Return one lift itself."""
        return self._simulators[self._named(lift)]

    def modbus_faults(self, lift: str | None = None) -> ModbusFaults:
        """Return the wire of one lift."""
        return self._faults.of(self._named(lift))

    # -- what the manager publishes

    def state(self, lift: str | None = None) -> LiftState:
        """Return the current published state of a lift."""
        name = self._named(lift)
        return self._thread.call(lambda: self._running.site.state(name))

    def wait_for(self, condition: StateCondition, *, within_s: float = WITHIN_S, lift: str | None = None) -> LiftState:
        """Return the first state from now on that meets the condition. Raises ConditionNotMet, which fails the test.

        The condition runs on another thread whenever the state changes in more than its age; it must not wait.
        """
        return self._thread.run(self._running.wait_for_state(self._named(lift), condition, within_s), within_s=within_s)

    async def when(
        self, condition: StateCondition, *, within_s: float = WITHIN_S, lift: str | None = None
    ) -> LiftState:
        """Like `wait_for`, for an asyncio test, without blocking its loop."""
        return await self._thread.run_async(self._running.wait_for_state(self._named(lift), condition, within_s))

    def wait_for_event(self, condition: EventCondition, *, within_s: float = WITHIN_S) -> LogEntry:
        """Return the first event of this test that meets the condition, past events included. Raises ConditionNotMet."""
        return self._thread.run(self._running.wait_for_entry(condition, within_s), within_s=within_s)

    async def when_event(self, condition: EventCondition, *, within_s: float = WITHIN_S) -> LogEntry:
        """Like `wait_for_event`, for an asyncio test."""
        return await self._thread.run_async(self._running.wait_for_entry(condition, within_s))

    @property
    def events(self) -> tuple[LogEntry, ...]:
        """Sessions, outcomes, alarms, advice, refusals and operator actions, oldest first."""
        return self._thread.call(lambda: tuple(self._running.log.entries))

    @property
    def alarms(self) -> tuple[str, ...]:
        """The texts of alarms."""
        return self._thread.call(lambda: self._running.log.alarms)

    @property
    def refusals(self) -> tuple[Refused, ...]:
        """All refusals, to any caller."""
        return self._thread.call(lambda: self._running.log.refusals)

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes of the commands to the lifts."""
        return self._thread.call(lambda: self._running.log.outcomes)

    # -- what others do

    def request(
        self,
        floor: FloorName,
        *,
        by: str = "another robot",
        hold_door: bool = True,
        robot: RobotWord | None = None,
        lift: str | None = None,
    ) -> Accepted | Refused:
        """Request the car for a caller that is not a client of the workshop API."""
        name, holder = self._named(lift), Holder(FACE, by)
        return self._reply(lambda: self._running.site.request(name, holder, floor, hold_door=hold_door, robot=robot))

    @contextmanager
    def held(self, floor: FloorName, *, by: str = "another robot", lift: str | None = None) -> Iterator[None]:
        """Let another caller hold the lift within the context. Raises BenchError if it is refused."""
        answer = self.request(floor, by=by, lift=lift)
        if isinstance(answer, Refused):
            raise BenchError(f"{by} may not hold the lift: {answer.message}")
        try:
            yield
        finally:
            self.request(floor, by=by, hold_door=False, robot=RobotWord.LEFT, lift=lift)

    def acknowledge(self, *, by: str, lift: str | None = None) -> Acknowledged | Refused:
        """Acknowledge as a person who has checked the lift: after a fire, or because a robot may be aboard."""
        name = self._named(lift)
        return self._reply(lambda: self._running.site.acknowledge(name, by))

    def lock_out(self, *, by: str, reason: str, lift: str | None = None) -> Restriction | Refused:
        """Lock out the lift as a person."""
        name = self._named(lift)
        return self._reply(lambda: self._running.site.lock_out(name, by, reason))

    def end_lockout(self, *, by: str, lift: str | None = None) -> RestrictionEnded | Refused:
        """End the lockout as a person."""
        name = self._named(lift)
        return self._reply(lambda: self._running.site.end_lockout(name, by))

    def stop(self) -> bool:
        """Stop the manager in order; returns whether the release of every output was verified. Its port then refuses connections."""
        return self._thread.run(self._running.stop(), within_s=app.RELEASE_WITHIN_S)

    def _reply(self, request: Callable[[], Reply]) -> Reply | Refused:
        def reply() -> Reply | Refused:
            try:
                return request()
            except RequestRefused as error:
                return Refused(error.code, error.message, error.blocking)

        return self._thread.call(reply)

    def _named(self, lift: str | None) -> str:
        lifts = ", ".join(self.lifts)
        if lift is None:
            if len(self._simulators) > 1:
                raise BenchError(f"there are several lifts, {lifts}; name one, such as lift={self.lifts[0]!r}")
            return self.lifts[0]
        if lift not in self._simulators:
            raise BenchError(f"no lift {lift!r}; there is {lifts}")
        return lift


def site_file(plans: Sequence[LiftPlan], ports: Mapping[str, Mapping[str, int]], folder: Path) -> dict[str, Any]:
    """Return the contents of a site file: each lift on a controller of its own name, its endpoints on further ones.

    Copies each map into `folder`.
    """
    controllers: dict[str, Any] = {}
    lifts: dict[str, Any] = {}
    for number, plan in enumerate(plans):
        (folder / f"map-{number}.yaml").write_bytes(plan.map.path.read_bytes())
        for endpoint, port in ports[plan.name].items():
            controllers[_controller(plan.name, endpoint)] = {"host": HOST, "port": port} | (
                {} if endpoint else {"map": f"./map-{number}.yaml"}
            )
        lifts[plan.name] = {
            "controller": _controller(plan.name, ""),
            "floors": {
                floor: {"code": code} | ({"doors": sorted(plan.doors[floor])} if floor in plan.doors else {})
                for floor, code in plan.floors.items()
            },
            "endpoints": {
                endpoint: {"controller": _controller(plan.name, endpoint), "unit_id": plan.codec.map.unit_of(endpoint)}
                for endpoint in ports[plan.name]
                if endpoint
            },
            **plan.keys,
        }
    return {"schema": 1, "name": "bench", "controllers": controllers, "lifts": lifts}


def _controller(lift: str, endpoint: str) -> str:
    return f"{lift} {endpoint}" if endpoint else lift
