"""Two RMFs in two domains, each with a supervisor and an adapter, and one manager with one lift: real DDS, HTTP and Modbus."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, contextmanager
from urllib.parse import urlsplit

import pytest

from lift_manager.lab.bench import LiftSite
from lift_manager.plain.http import Address, Server
from lift_manager.rmf.dds import Dds
from lift_manager.rmf.dds_types import WireLiftState, state_of
from lift_manager.rmf.messages import DOOR_OPEN, LiftState
from lift_manager.rmf.remote_manager import RemoteManager
from lift_manager.rmf.ros_settings import RosSettings
from lift_manager.rmf.run import RunningAdapter
from tests.support.dds_partner import LIMIT_S, Offer, Partner
from tests.support.dds_rig import ORACLE, settings_of_test
from tests.support.rmf.fleet import TRAITS, FleetRobot, Phase
from tests.support.rmf.supervisors import Kilted

LIFT = "goods-1"
ROBOT = "fleet/robot1"
"""In both."""
REQUESTS, STATES = "rt/lift_requests", "rt/lift_states"


class Rmf:
    """A supervisor of kilted and a robot, in one domain; everything in the thread that hears."""

    def __init__(self, domain: int) -> None:
        self.robot = FleetRobot(ROBOT, LIFT, TRAITS["kilted"])
        self.states: list[LiftState] = []
        self._supervisor = Kilted()
        self._changed = threading.Condition()
        self._partner = Partner(domain)
        self._partner.offer(REQUESTS, "request", Offer(transient=True))
        self._partner.hear(STATES, "state", Offer(), self._heard)

    def request(self, floor: str) -> None:
        """Begin RequestLift."""
        with self._changed:
            self.robot.request_lift(floor, inside=False, now=time.monotonic())

    def end(self) -> None:
        """Begin EndLiftSession."""
        with self._changed:
            self.robot.end_lift_session(time.monotonic())

    def wait_until(self, right: Callable[[], bool]) -> None:
        with self._changed:
            assert self._changed.wait_for(right, LIMIT_S), self.states[-5:]

    def has_arrived(self) -> bool:
        return self.robot.phase is Phase.NONE and self.robot.saw_it

    def sessions(self) -> set[str]:
        return {state.session_id for state in self.states}

    def close(self) -> None:
        self._partner.close()

    def _heard(self, data: bytes) -> None:
        state, now = state_of(WireLiftState.deserialize(data)), time.monotonic()
        with self._changed:
            self.states.append(state)
            for asked in self.robot.heard(state, now):
                for passed_on in self._supervisor.asked(asked, now):
                    self._partner.write(REQUESTS, ORACLE.request(passed_on))
            for repeated in self._supervisor.heard(state, now):
                self._partner.write(REQUESTS, ORACLE.request(repeated))
            self._changed.notify_all()


@asynccontextmanager
async def _adapter(settings: RosSettings, port: int) -> AsyncIterator[None]:
    running = RunningAdapter(
        lambda hears, deliver: Dds(settings, hears, deliver),
        lambda: RemoteManager(Server(Address("127.0.0.1", port))),
        adapter_id=settings.adapter,
    )
    running.open()
    task = asyncio.create_task(running.run())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait([task])


@contextmanager
def adapters(port: int, *domains: RosSettings) -> Iterator[None]:
    """Run one for each domain, in a thread of their own."""
    begun, stop, loops = threading.Event(), asyncio.Event(), []

    async def main() -> None:
        loops.append(asyncio.get_running_loop())
        async with AsyncExitStack() as stack:
            for settings in domains:
                await stack.enter_async_context(_adapter(settings, port))
            begun.set()
            await stop.wait()

    thread = threading.Thread(target=asyncio.run, args=(main(),))
    thread.start()
    assert begun.wait(LIMIT_S)
    try:
        yield
    finally:
        loops[0].call_soon_threadsafe(stop.set)
        thread.join()


@pytest.mark.lift(LIFT, speed=10)
def test_two_rmfs_share_a_lift_and_neither_ends_the_session_of_the_other(lift_site: LiftSite) -> None:
    port = urlsplit(lift_site.address).port
    assert port is not None
    domains = settings_of_test(domain=101), settings_of_test(domain=102)
    with adapters(port, *domains), ExitStack() as closing:
        first, second = (Rmf(settings.domain) for settings in domains)
        for rmf in (first, second):
            closing.callback(rmf.close)
        first.request("L3")
        first.wait_until(first.has_arrived)
        second.request("L1")
        held = f"rmf:{ROBOT}@101"
        second.wait_until(lambda: [state.session_id for state in second.states[-4:]] == [held] * 4)
        assert DOOR_OPEN not in {state.door_state for state in second.states if state.session_id}
        assert first.states[-1].session_id == ROBOT, "its door is held still"
        first.end()
        second.wait_until(second.has_arrived)
        first.wait_until(lambda: first.states[-1].session_id == f"rmf:{ROBOT}@102")
        assert first.robot.phase is Phase.NONE
        assert first.sessions() <= {"", ROBOT, f"rmf:{ROBOT}@102"}
