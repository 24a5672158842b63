"""Puts the stand-in for rclpy in front, for one distribution, and takes it away again."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from lift_manager.plain.rmf import Alarms, HeldBy, LiftView, SiteView
from lift_manager.rmf.port import ManagerRequest

FOLDER = Path(__file__).parent / "fake_rclpy"
DISTROS = ("humble", "iron", "jazzy", "kilted", "rolling")
_NAMES = ("rclpy", "ros_world", "ros_messages", "rmf_lift_msgs", "rmf_fleet_msgs", "std_msgs", "builtin_interfaces")
_LOADED = ("lift_manager.rmf.ros_node", "lift_manager.rmf.ros_messages", "lift_manager.rmf.ros_alarms")


@dataclass
class Asking:
    """A manager that keeps what it is asked and never answers by itself."""

    asked: list[ManagerRequest] = field(default_factory=list)

    def send(self, asked: ManagerRequest) -> None:
        self.asked.append(asked)


@dataclass
class Ros:
    """The modules of one distribution, and the adapter on a node of it."""

    ros_node: Any
    messages: Any
    world: Any
    rclpy: Any
    lift_msgs: Any
    fleet_msgs: Any
    manager: Asking = field(default_factory=Asking)
    node: Any = None
    executor: Any = None
    shell: Any = None

    def start(self, **parameters: object) -> None:
        """Make the node and the adapter on it, as `run` does."""
        self.world.parameters.update(parameters)
        self.rclpy.init()
        self.node = importlib.import_module("rclpy.node").Node("lift_adapter")
        self.executor = importlib.import_module("rclpy.executors").SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.shell = self.ros_node.AdapterNode(self.node, self.manager, self.world.monotonic)

    def spin(self, seconds: float) -> None:
        """Let so much time go by."""
        end = self.world.steady() + int(seconds * 1e9)
        while self.world.steady() < end:
            self.executor.spin_once(timeout_sec=(end - self.world.steady()) * 1e-9)

    def hear(self, view: LiftView, alarms: Alarms | None = None, event: int = 1) -> None:
        """Let the manager answer."""
        now = self.world.monotonic()
        site = SiteView("boot", event, (view,), 3.0, alarms or Alarms())
        self.shell.deliver(lambda: self.shell.on_site(site, now, self.world.monotonic()))
        self.spin(0.01)

    def offer(
        self,
        depth: int = 100,
        *,
        reliable: bool = True,
        transient_local: bool = False,
        lifespan_s: float | None = None,
    ) -> Any:
        return importlib.import_module("ros_world").Offer(depth, reliable, transient_local, lifespan_s)

    def reader(self, topic: str = "/lift_states", **offer: Any) -> Any:
        """Another program reads a topic."""
        return self.world.reader(topic, self._kind(topic), self.offer(**offer))

    def writer(self, topic: str = "/lift_requests", node: str = "supervisor", **offer: Any) -> Any:
        """Another program writes a topic."""
        return self.world.writer(topic, self._kind(topic), self.offer(**offer), node)

    def request(self, **values: object) -> Any:
        said = {"lift_name": "Lift 1", "session_id": "fleet/robot1", "request_type": 1, "destination_floor": "L2"}
        return self.lift_msgs.LiftRequest(**{**said, "door_state": 2, **values})

    def logged(self, level: str) -> list[str]:
        return [text for at, text in self.world.log if at == level]

    def _kind(self, topic: str) -> Any:
        kinds = {
            "lift_states": self.lift_msgs.LiftState,
            "lift_requests": self.lift_msgs.LiftRequest,
            "adapter_lift_requests": self.lift_msgs.LiftRequest,
            "fire_alarm_trigger": importlib.import_module("std_msgs.msg").Bool,
            "emergency_signal": getattr(self.fleet_msgs, "EmergencySignal", None),
        }
        return kinds[topic.rpartition("/")[2]]


@contextmanager
def installed(distro: str) -> Iterator[Ros]:
    """Import the node on this distribution, with a new world around it; nothing of it is left afterwards."""
    _forget()
    sys.modules.update(_KEPT.get(distro, {}))
    sys.path.insert(0, str(FOLDER))
    try:
        world = importlib.import_module("ros_world").world
        world.begin(distro)
        yield Ros(
            ros_node=importlib.import_module(_LOADED[0]),
            messages=importlib.import_module(_LOADED[1]),
            world=world,
            rclpy=importlib.import_module("rclpy"),
            lift_msgs=importlib.import_module("rmf_lift_msgs.msg"),
            fleet_msgs=importlib.import_module("rmf_fleet_msgs.msg"),
        )
    finally:
        sys.path.remove(str(FOLDER))
        _KEPT[distro] = _forget()


_KEPT: dict[str, dict[str, ModuleType]] = {}
"""To import everything for each test takes longer than the tests."""


def _forget() -> dict[str, ModuleType]:
    names = [name for name in sys.modules if name in _LOADED or name.split(".")[0] in _NAMES]
    return {name: sys.modules.pop(name) for name in names}


def lift(**values: Any) -> LiftView:
    """A lift that stands at L1 with its door open; every word differs between the site and RMF."""
    said: dict[str, Any] = {
        "lift": "east",
        "name": "Lift 1",
        "floors": {"ground": "L1", "first": "L2"},
        "live": True,
        "reason": "",
        "age_s": 0.0,
        "max_age_s": 1000.0,
        "floor": "ground",
        "standing": True,
        "destination": None,
        "door": "open",
        "motion": "stopped",
        "mode": "normal",
        "robot_mode_on": None,
        "holder": None,
        "ending": False,
        "fire_latched": False,
        "waiting_for": "",
        "keeps_off": "",
    }
    return LiftView(**{**said, **values})


def held(session: str) -> HeldBy:
    return HeldBy("rmf", session)
