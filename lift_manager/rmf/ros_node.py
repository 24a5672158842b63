"""The lift adapter as a node of ROS 2; the only module that imports rclpy.

The adapter runs in the executor's one thread only: calls from other threads wait in a queue until a guard condition wakes it.
`deploy/ros/README.md` describes the differences between the distributions.
"""

from __future__ import annotations

import importlib
import logging
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rmf_lift_msgs.msg import LiftRequest as RosLiftRequest
from rmf_lift_msgs.msg import LiftState as RosLiftState

from lift_manager.plain.http import Address, BadAddress, Server
from lift_manager.plain.rmf import SiteView
from lift_manager.rmf.adapter import Adapter, RmfOutput
from lift_manager.rmf.lift_state import NO_CLOCK_S
from lift_manager.rmf.messages import LiftRequest, LiftState
from lift_manager.rmf.port import Answer, Manager
from lift_manager.rmf.remote_manager import RemoteManager
from lift_manager.rmf.ros_alarms import Publishers, RosAlarms
from lift_manager.rmf.ros_messages import message_of, request_of, state_of
from lift_manager.rmf.ros_settings import BadSettings, RosSettings, check_adapter_id, id_of_adapter

_log = logging.getLogger(__name__)


def _import_optional(name: str) -> Any:
    """Return a module, or None on distributions without it."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        return None


_EVENTS = _import_optional("rclpy.event_handler")
"""None on humble, which has no event for a matched writer."""
_UNSUPPORTED = () if _EVENTS is None else _EVENTS.UnsupportedEventTypeError

NODE = "lift_adapter"
KEY_VARIABLE = "LIFT_MANAGER_KEY"
"""The variable with the manager's key, as for the command line: everybody in the domain could read a parameter."""

MAX_PAUSE_S = 0.25
"""The longest pause of the timer. Chosen: a signal does not wake the executor, so it is noticed within this time."""
MIN_PAUSE_S = 0.001
"""The shortest pause of the timer."""
CHECK_S = 1.0
"""Between two checks for other publishers and for the clock."""
MAX_QUEUED = 10_000
"""Chosen: the manager answers fifty times a second at most, so the executor has not run for three minutes."""
MAX_SENT_STATES = 64
"""How many published states of each lift are remembered as our own. Chosen: 3 s of them at the fastest."""

STATES_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
    lifespan=Duration(seconds=1),
)
"""The only offer that every reader accepts (open-rmf 1.3). The lifespan is two publications: after a network outage a reader gets all
undelivered states, and would believe an old OPEN (`dds_topics` has the measurements)."""
REQUESTS_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10_000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""The only request that every writer meets without a replay. Deep: iron and jazzy send a request for each waiting robot after each state
of any lift, and humble sends an END only once."""
ALARMS_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


class Overrun(RuntimeError):
    """The executor's thread stood still for so long that its queue is full."""


class _Inbox:
    """Calls from other threads. None may be lost, so an overflow is an error in the thread that runs them."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._calls: deque[Callable[[], None]] = deque()
        self._overrun = False

    def put(self, call: Callable[[], None]) -> None:
        """Queue a call without waiting. From any thread."""
        if len(self._calls) < MAX_QUEUED:
            self._calls.append(call)
        else:
            self._overrun = True
        self._wake()

    def drain(self) -> None:
        """Run all calls in order. Raises Overrun."""
        if self._overrun:
            raise Overrun(f"more than {MAX_QUEUED} answers of the manager were waiting; the node has to restart")
        while self._calls:
            self._calls.popleft()()


class _RivalDetector:
    """Detects another program that publishes states of our lifts.

    rclpy does not report the writer of a message before 2025's rolling, and never the identity of its own writer. So while the topic
    has more than one writer, every state on it is read; a state of one of our lifts that was not just sent from here is foreign.
    """

    def __init__(self, node: Node, topic: str, on_found: Callable[[str], None]) -> None:
        """`topic` is the full name, after namespace and remapping."""
        self._node = node
        self._topic = topic
        self._on_found = on_found
        self._sent_states: dict[str, deque[LiftState]] = {}
        self._subscription: Any = None

    def add_sent(self, state: LiftState) -> None:
        self._sent_states.setdefault(state.lift_name, deque(maxlen=MAX_SENT_STATES)).append(state)

    def check(self) -> None:
        several = len(self._node.get_publishers_info_by_topic(self._topic)) > 1
        if several and self._subscription is None:
            self._subscription = self._node.create_subscription(RosLiftState, self._topic, self._on_state, REQUESTS_QOS)
        elif not several and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _on_state(self, message: RosLiftState) -> None:
        ours = self._sent_states.get(message.lift_name)
        if ours is not None and state_of(message) not in ours:
            self._on_found(message.lift_name)


class _WriterDetector:
    """Detects new writers of requests, on distributions without an event for them."""

    def __init__(self, node: Node, topic: str, on_found: Callable[[], None]) -> None:
        self._node = node
        self._topic = topic
        self._on_found = on_found
        self._known: set[tuple[int, ...]] = set()

    def check(self) -> None:
        gids = {tuple(info.endpoint_gid) for info in self._node.get_publishers_info_by_topic(self._topic)}
        if gids - self._known:
            self._on_found()
        self._known = gids


class AdapterNode:
    """The adapter on a node. Implements `port.ManagerListener`; the connection to the manager calls it through `deliver`."""

    def __init__(self, node: Node, manager: Manager, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._node = node
        # not the steady clock of ROS, which is a different one (CLOCK_MONOTONIC_RAW): the manager's answers are dated with this one
        self._monotonic = monotonic
        defaults = RosSettings()
        topics = {
            name: str(node.declare_parameter(name, getattr(defaults, name)).value)
            for name in ("states_topic", "requests_topic", "adapter_requests_topic", "fire_topic", "emergency_topic")
        }
        self._states = node.create_publisher(RosLiftState, topics["states_topic"], STATES_QOS)
        self._rival_detector = _RivalDetector(node, self._states.topic_name, self._on_rival)
        alarms = RosAlarms(
            Publishers(lambda kind, topic: node.create_publisher(kind, topic, ALARMS_QOS), node.destroy_publisher),
            topics["fire_topic"],
            topics["emergency_topic"],
        )
        self._adapter = Adapter(
            manager,
            RmfOutput(self._publish, alarms),
            self._ros_time,
            adapter_id=_adapter_id(node, topics["requests_topic"]),
        )
        self._writer_detector: _WriterDetector | None = None
        self._requests: deque[tuple[Callable[[LiftRequest, float], None], RosLiftRequest]] = deque()
        """Received, and processed at the next timer call within `MIN_PAUSE_S`: a burst needs one tick."""
        self._subscribe(topics["requests_topic"])
        node.create_subscription(
            RosLiftRequest,
            topics["adapter_requests_topic"],
            lambda message: self._queue_request(self._adapter.on_fleet_request, message),
            REQUESTS_QOS,
        )
        self._guard = node.create_guard_condition(self._drain)
        self._inbox = _Inbox(self._guard.trigger)
        self._started_at = self._monotonic()
        self._check_at = self._started_at
        self._has_warned_no_clock = False
        self._timer_due_at = self._started_at + MIN_PAUSE_S
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(MIN_PAUSE_S, self._on_time, clock=steady)

    def deliver(self, call: Callable[[], None]) -> None:
        """Run a call in the executor's thread. From any thread, without waiting."""
        self._inbox.put(call)

    def on_site(self, site: SiteView, sent_at: float, now: float) -> None:
        """Take over an answer of the manager."""
        self._adapter.on_site(site, sent_at, now)

    def on_answer(self, answer: Answer, now: float) -> None:
        """Process the answer to a request."""
        self._adapter.on_answer(answer, now)

    def on_manager_lost(self, reason: str, now: float) -> None:
        """Show the lifts as offline while the manager does not answer."""
        self._adapter.on_manager_lost(reason, now)

    def stop(self) -> None:
        """Publish every lift as offline. From the executor's thread, or after it has ended."""
        self._adapter.stop(self._monotonic())

    def _subscribe(self, topic: str) -> None:
        events = None if _EVENTS is None else _EVENTS.SubscriptionEventCallbacks(matched=self._on_matched)
        try:
            requests = self._node.create_subscription(
                RosLiftRequest, topic, self._on_request, REQUESTS_QOS, event_callbacks=events
            )
        except _UNSUPPORTED:
            # this middleware has no such event
            events = None
            requests = self._node.create_subscription(RosLiftRequest, topic, self._on_request, REQUESTS_QOS)
        if events is None:
            self._writer_detector = _WriterDetector(self._node, requests.topic_name, self._on_writer_matched)

    def _on_request(self, message: RosLiftRequest) -> None:
        self._queue_request(self._adapter.on_request, message)

    def _queue_request(self, process: Callable[[LiftRequest, float], None], message: RosLiftRequest) -> None:
        self._requests.append((process, message))
        if self._timer_due_at > self._monotonic() + MIN_PAUSE_S:
            self._set_timer(MIN_PAUSE_S)

    def _process_queue(self) -> None:
        if self._writer_detector is not None and self._requests:
            # the first requests of a new writer are a replay, and the next regular check would be too late to know
            self._writer_detector.check()
        while self._requests:
            take, message = self._requests.popleft()
            take(request_of(message), self._monotonic())

    def _on_matched(self, event: Any) -> None:
        if event.total_count_change > 0:
            self._on_writer_matched()

    def _on_writer_matched(self) -> None:
        self._adapter.on_request_writer(self._monotonic())

    def _on_rival(self, lift_name: str) -> None:
        self._adapter.on_rival(lift_name, self._monotonic())

    def _drain(self) -> None:
        self._inbox.drain()
        self._tick()

    def _on_time(self) -> None:
        now = self._monotonic()
        if now >= self._check_at:
            self._check_at = now + CHECK_S
            self._check_others(now)
        self._tick()

    def _tick(self) -> None:
        self._process_queue()
        now = self._monotonic()
        self._set_timer(min(max(self._adapter.tick(now) - now, MIN_PAUSE_S), MAX_PAUSE_S))

    def _set_timer(self, pause_s: float) -> None:
        self._timer_due_at = self._monotonic() + pause_s
        self._timer.timer_period_ns = int(pause_s * 1e9)
        self._timer.reset()

    def _check_others(self, now: float) -> None:
        if self._writer_detector is not None:
            self._writer_detector.check()
        self._rival_detector.check()
        self._check_clock(now)

    def _check_clock(self, now: float) -> None:
        if self._has_warned_no_clock or now < self._started_at + NO_CLOCK_S:
            return
        if self._ros_time() == 0.0:
            self._has_warned_no_clock = True
            _log.warning(
                "use_sim_time is set, and nothing has arrived on /clock for %.0f s: the lifts are published all the same, with"
                " lift_time 0 until it does; start the simulation, or set use_sim_time to false",
                NO_CLOCK_S,
            )

    def _ros_time(self) -> float:
        """Return the node's time; 0 while use_sim_time is set and nothing has arrived on /clock."""
        return float(self._node.get_clock().now().nanoseconds) * 1e-9

    def _publish(self, state: LiftState) -> None:
        self._rival_detector.add_sent(state)
        self._states.publish(message_of(state))


class RosLog(logging.Handler):
    """Forwards log records to the node's logger, and so to /rosout."""

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._logger = node.get_logger()

    def emit(self, record: logging.LogRecord) -> None:
        text = self.format(record)
        # each level on a separate line: rclpy refuses a different level from the same line
        if record.levelno >= logging.CRITICAL:
            self._logger.fatal(text)
        elif record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        elif record.levelno >= logging.INFO:
            self._logger.info(text)
        else:
            self._logger.debug(text)


def _adapter_id(node: Node, requests_topic: str) -> str:
    """Return the adapter's id at the manager, the same as without ROS. Raises BadSettings."""
    given = str(node.declare_parameter("adapter_id", "").value)
    check_adapter_id(given)
    return given or id_of_adapter(node.context.get_domain_id(), node.resolve_topic_name(requests_topic))


def server_of(node: Node) -> Server:
    """Declare and read the parameters for the connection to the manager. Raises BadAddress."""
    address = str(node.declare_parameter("manager_address", "localhost").value)
    port = node.declare_parameter("manager_port", 5003).value
    key_file = str(node.declare_parameter("manager_key_file", "").value)
    ca_file = str(node.declare_parameter("manager_ca_file", "").value)
    return Server(Address.of(address, port), _read_key(key_file), Path(ca_file) if ca_file else None)


def _read_key(file: str) -> str:
    if not file:
        return os.environ.get(KEY_VARIABLE, "").strip()
    try:
        return Path(file).read_text(encoding="ascii").strip()
    except (OSError, UnicodeError) as error:
        raise BadAddress(f"manager_key_file: {file} cannot be read ({error})") from error


def run(node: Node, stopping: threading.Event) -> None:
    """Run until `stopping` is set or ROS ends. Raises BadAddress, BadSettings, and any bug after publishing the lifts as offline."""
    manager = RemoteManager(server_of(node))
    adapter_node = AdapterNode(node, manager)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    manager.start(adapter_node, adapter_node.deliver)
    try:
        while not stopping.is_set():
            executor.spin_once()  # the timer ends it after MAX_PAUSE_S
    except ExternalShutdownException:
        pass  # ROS has ended; nothing can be published any more
    finally:
        manager.close()
        if rclpy.ok():
            adapter_node.stop()
        executor.shutdown()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit code."""
    stopping = threading.Event()

    def stop(_number: int, _frame: FrameType | None) -> None:
        stopping.set()

    # rclpy's own handlers end the context first, after which nothing can be published: the last state must be "offline"
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    node = Node(NODE)
    handler = RosLog(node)
    root = logging.getLogger("lift_manager")
    root.addHandler(handler)
    root.setLevel(logging.DEBUG)  # the node's own level decides
    try:
        run(node, stopping)
    except (BadAddress, BadSettings) as error:
        _log.critical("%s", error)
        return 2
    finally:
        root.removeHandler(handler)
        node.destroy_node()
        if rclpy.ok():
            rclpy.shutdown()
    return 0
