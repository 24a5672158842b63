"""An adapter's place in RMF for tests: a domain that no other test has, and a hearer that can be waited for."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from uuid import uuid4

from lift_manager.rmf.dds import Dds
from lift_manager.rmf.dds_config import config_of
from lift_manager.rmf.messages import LiftRequest, LiftState, Time
from lift_manager.rmf.ros_settings import RosSettings
from tests.support.dds_oracle import Oracle

LIMIT_S = 120.0
ORACLE = Oracle()


def settings_of_test(**changed: Any) -> RosSettings:
    """LOCALHOST, in a domain with a tag of its own: other tests, and a ROS on this machine, are not heard."""
    tag = f"<CycloneDDS><Domain><Discovery><Tag>{uuid4()}</Tag></Discovery></Domain></CycloneDDS>"
    values: dict[str, Any] = {"domain": os.getpid() % 100 + 1, "discovery_range": "LOCALHOST", "cyclonedds_uri": tag}
    return RosSettings(**(values | changed))


def config(settings: RosSettings) -> str:
    """What a partner in a process of its own needs to live in the same domain."""
    return config_of(settings, os.getpid())


def padded(data: bytes) -> bytes:
    """A message as it is found on the network: Cyclone DDS fills up to four bytes."""
    return data.ljust(-(-len(data) // 4) * 4, b"\0")


def request(lift: str = "lift1", floor: str = "L2", session: str = "fleet/robot1", kind: int = 1) -> LiftRequest:
    return LiftRequest(lift, Time(1, 2), session, kind, floor, 2)


def state(lift: str = "lift1", floor: str = "L1", floors: tuple[str, ...] = ("L1", "L2")) -> LiftState:
    return LiftState(Time(1, 2), lift, floors, floor, "", 2, 0, (1, 2), 2, "")


@dataclass
class Heard:
    """Implements DdsListener: everything in order, as (what, with what)."""

    events: list[tuple[str, Any]] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def on_request(self, request: LiftRequest) -> None:
        self._note("requested", request)

    def on_fleet_request(self, request: LiftRequest) -> None:
        self._note("fleet requested", request)

    def on_unreadable(self, text: str) -> None:
        self._note("broken", text)

    def on_request_writer(self) -> None:
        self._note("matched", None)

    def on_rival(self, lift_name: str) -> None:
        self._note("rival", lift_name)

    def on_clock(self, seconds: float) -> None:
        self._note("clock", seconds)

    def of(self, what: str) -> list[Any]:
        return [value for name, value in self.events if name == what]

    def wait_for(self, what: str, count: int = 1) -> list[Any]:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.of(what)) >= count, LIMIT_S), self.events
            return self.of(what)

    def wait_until(self, what: str, right: Callable[[Any], bool]) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: any(map(right, self.of(what))), LIMIT_S), self.events

    def _note(self, what: str, value: object) -> None:
        with self.changed:
            self.events.append((what, value))
            self.changed.notify_all()


def at_once(call: Callable[[], None]) -> None:
    """Deliver in the thread that heard."""
    call()


@contextmanager
def adapter(settings: RosSettings, heard: Heard | None = None) -> Iterator[tuple[Dds, Heard]]:
    listener = heard or Heard()
    dds = Dds(settings, listener, at_once)
    try:
        yield dds, listener
    finally:
        dds.close()
