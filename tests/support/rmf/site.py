"""The whole of an RMF site but the lift: one supervisor, fleet adapters, rmf-web, and the messages between them."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable
from copy import copy
from random import Random
from typing import TypeVar

from lift_manager.rmf.messages import LiftRequest, LiftState
from tests.support.rmf.fleet import FleetRobot
from tests.support.rmf.network import Channel
from tests.support.rmf.supervisors import SUPERVISORS, Supervisor

M = TypeVar("M")

DEPTH = 100
"""Old requests that a TRANSIENT_LOCAL writer keeps (open-rmf 1.3)."""


class Writer:
    """One publisher on `adapter_lift_requests`: a fleet adapter, or rmf-web."""

    def __init__(self, site: RmfSite) -> None:
        self._site = site
        self.history: deque[LiftRequest] = deque(maxlen=DEPTH)
        self.to_supervisor: Channel[LiftRequest]
        self.to_adapter = site.channel_of_fleets()
        self.connect()

    def connect(self) -> None:
        """Begin with a supervisor that has just started."""
        self.to_supervisor = self._site.channel(self._site.supervisor_asked)

    def publish(self, request: LiftRequest) -> None:
        """Send to the supervisor, if there is one, and to the adapter, which reads along."""
        self.history.append(request)
        self.to_adapter.send(request)
        if self._site.supervisor is not None:
            self.to_supervisor.send(request)


class Fleet(Writer):
    """A fleet adapter with its robots."""

    def __init__(self, site: RmfSite) -> None:
        super().__init__(site)
        self.states = site.channel(self._heard)
        self._robots: list[FleetRobot] = []
        self._timers: dict[str, asyncio.TimerHandle] = {}
        self._stepped: Callable[[FleetRobot], None] = site.stepped

    def add(self, robot: FleetRobot) -> None:
        """Let a robot belong to it."""
        self._robots.append(robot)

    def do(self, robot: FleetRobot, sent: list[LiftRequest]) -> None:
        """Publish what a step of a robot comes to."""
        for request in sent:
            self.publish(request)
        if (timer := self._timers.pop(robot.session, None)) is not None:
            timer.cancel()
        if robot.due < math.inf:
            self._timers[robot.session] = asyncio.get_running_loop().call_at(robot.due, self._tick, robot)
        self._stepped(robot)

    def _tick(self, robot: FleetRobot) -> None:
        self.do(robot, robot.tick(asyncio.get_running_loop().time()))

    def _heard(self, state: LiftState) -> None:
        for robot in self._robots:
            self.do(robot, robot.heard(state, asyncio.get_running_loop().time()))

    def stop(self) -> None:
        """End its timers."""
        for timer in self._timers.values():
            timer.cancel()


class RmfSite:
    """What RMF runs; the adapter is given as two callables."""

    def __init__(
        self,
        distribution: str,
        dice: Random,
        most_s: float,
        *,
        request: Callable[[LiftRequest], None],
        fleet_request: Callable[[LiftRequest], None],
        matched: Callable[[], None],
        stepped: Callable[[FleetRobot], None],
    ) -> None:
        """`most_s` is the longest delay of a message; `matched` is called for each new writer of `lift_requests`.

        `request` takes what comes on `lift_requests`, `fleet_request` what comes on `adapter_lift_requests`.
        """
        self._make = SUPERVISORS[distribution]
        self._dice = dice
        self._most_s = most_s
        self._request = request
        self._fleet_request = fleet_request
        self._dice_of_fleets = copy(dice)
        """Of its own, so that a schedule drawn before this topic was modelled comes to the same."""
        self._matched = matched
        self.stepped = stepped
        self.supervisor: Supervisor | None = None
        self._to_adapter: Channel[LiftRequest] = self.channel(request)
        self._states: Channel[LiftState] = self.channel(self._supervisor_heard)
        self._direct: dict[str, Channel[LiftRequest]] = {}
        self.fleets: dict[str, Fleet] = {}
        self.web = Writer(self)
        self.start_supervisor()

    def channel(self, deliver: Callable[[M], None]) -> Channel[M]:
        """Return a way to a reader, with delays as they are here."""
        return Channel(self._dice, self._most_s, deliver)

    def channel_of_fleets(self) -> Channel[LiftRequest]:
        """Return a way from a writer of `adapter_lift_requests` to the adapter, which gets no history: its reader is volatile."""
        return Channel(self._dice_of_fleets, self._most_s, self._fleet_request)

    # -- what the adapter and others publish

    def state(self, state: LiftState) -> None:
        """Take a LiftState of the adapter."""
        if self.supervisor is not None:
            self._states.send(state)
        for fleet in self.fleets.values():
            fleet.states.send(state)

    def direct(self, node: str, request: LiftRequest) -> None:
        """Publish straight on `lift_requests`, past the supervisor."""
        if node not in self._direct:
            self._direct[node] = self.channel(self._request)
            self._matched()
        self._direct[node].send(request)

    def repeat(self, request: LiftRequest) -> None:
        """Let a request of the supervisor come once more."""
        self._to_adapter.send(request)

    def fleet(self, name: str) -> Fleet:
        """Return a fleet adapter; the first time it is started."""
        if name not in self.fleets:
            self.fleets[name] = Fleet(self)
        return self.fleets[name]

    # -- what happens to the programs

    def start_supervisor(self) -> None:
        """Start one that has forgotten everything; from iron on it gets what every fleet adapter still keeps, all at once."""
        supervisor = self.supervisor = self._make()
        self._to_adapter = self.channel(self._request)
        self._states = self.channel(self._supervisor_heard)
        self._matched()
        for writer in (*self.fleets.values(), self.web):
            writer.connect()
            for old in tuple(writer.history) if supervisor.replays else ():
                writer.to_supervisor.send(old)

    def stop_supervisor(self) -> None:
        """Kill it, with all that is on its way to it and from it."""
        self.supervisor = None
        self._to_adapter.cut()
        self._states.cut()
        for writer in (*self.fleets.values(), self.web):
            writer.to_supervisor.cut()

    def adapter_gone(self) -> None:
        """Lose what is under way to the adapter and from it."""
        self._to_adapter.cut()
        for channel in (*self._direct.values(), *(writer.to_adapter for writer in (*self.fleets.values(), self.web))):
            channel.cut()

    def adapter_is_back(self) -> None:
        """Let the new adapter find the writers that there are."""
        for _ in range((self.supervisor is not None) + len(self._direct)):
            self._matched()

    def stop(self) -> None:
        """End every timer and message."""
        self.stop_supervisor()
        self.adapter_gone()
        for fleet in self.fleets.values():
            fleet.stop()
            fleet.states.cut()

    def supervisor_asked(self, request: LiftRequest) -> None:
        """Hand the supervisor what came for it."""
        if self.supervisor is not None:
            self._publish(self.supervisor.asked(request, asyncio.get_running_loop().time()))

    def _supervisor_heard(self, state: LiftState) -> None:
        if self.supervisor is not None:
            self._publish(self.supervisor.heard(state, asyncio.get_running_loop().time()))

    def _publish(self, requests: list[LiftRequest]) -> None:
        for request in requests:
            self._to_adapter.send(request)
