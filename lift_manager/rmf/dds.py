"""RMF over DDS, without ROS: lift requests in, lift states and alarms out.

Cyclone DDS is loaded on first use, so that a manager without the extra `[rmf]` starts, and starts fast.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Protocol

from lift_manager.plain.rmf import Alarms
from lift_manager.rmf.dds_inbox import Inbox
from lift_manager.rmf.messages import END_SESSION, LiftRequest, LiftState
from lift_manager.rmf.port import Deliver
from lift_manager.rmf.ros_settings import RosSettings

if TYPE_CHECKING:
    from lift_manager.rmf.dds_topics import DdsTopics


class DdsError(RuntimeError):
    """RMF cannot be reached over DDS.

    DdsError
    ├── DdsMissing
    └── DdsFailed
    """


class DdsMissing(DdsError):
    """Cyclone DDS is not installed or does not load; the message says what to do."""

    def __init__(self, cause: object) -> None:
        super().__init__(
            f"Cyclone DDS is needed to reach RMF without ROS, and it does not load ({cause}).\n"
            "Install the manager with its extra `rmf`: pip install '.[rmf]' in its folder, in its own environment.\n"
            "Where pip finds no wheel (Linux on ARM, Alpine, Python 3.14), build it from source, with git, cmake and a"
            " C compiler:\n"
            "  git clone --branch 11.0.1 https://github.com/eclipse-cyclonedds/cyclonedds && cd cyclonedds\n"
            "  cmake -B build -DCMAKE_INSTALL_PREFIX=/opt/cyclonedds && cmake --build build --target install\n"
            "  CYCLONEDDS_HOME=/opt/cyclonedds pip install --no-binary cyclonedds cyclonedds==11.0.1\n"
            "and set CYCLONEDDS_HOME where the manager runs. With ROS 2 installed, use the package in deploy/ros instead,"
            " which does not need it."
        )


class DdsFailed(DdsError):
    """A call of Cyclone DDS failed; the message says which and, as far as known, why."""


class DdsListener(Protocol):
    """The callbacks of an adapter for RMF, always called through `deliver`, so in the adapter's own thread."""

    def on_request(self, request: LiftRequest) -> None:
        """Process a request with any content, in the order of arrival."""
        ...

    def on_fleet_request(self, request: LiftRequest) -> None:
        """Process what a fleet sent to its lift supervisor, in the order of arrival."""
        ...

    def on_unreadable(self, text: str) -> None:
        """Count a request that cannot be decoded."""
        ...

    def on_request_writer(self) -> None:
        """React to a new publisher of lift requests; its first request is delivered after this."""
        ...

    def on_rival(self, lift_name: str) -> None:
        """React to another program that publishes the state of one of our lifts."""
        ...

    def on_clock(self, seconds: float) -> None:
        """Set the time to that on /clock; only with `use_sim_time`, and not for every message."""
        ...


class DdsAlarms:
    """Publishes fire alarms. Implements `alarms.AlarmPublisher`; a topic is opened only if the site uses it."""

    def __init__(self, settings: RosSettings, topics: DdsTopics) -> None:
        self._fire = settings.resolved(settings.fire_topic)
        self._emergency = settings.resolved(settings.emergency_topic)
        self._topics = topics
        self._alarms = Alarms()

    def offer(self, alarms: Alarms) -> None:
        """Open the topics, so that readers find them."""
        self._alarms = alarms
        if alarms.fire_alarm:
            self._topics.offer_fire_alarm(self._fire)
        if alarms.emergency_signal:
            self._topics.offer_emergency(self._emergency)

    def publish_alarms(self, alarms: Alarms, *, on: bool) -> None:
        """Publish on the topics that the site uses; later readers get the latest message, until it is forgotten."""
        self.offer(alarms)
        if alarms.fire_alarm:
            self._topics.send_fire_alarm(self._fire, on=on)
        if alarms.emergency_signal:
            self._topics.send_emergency(self._emergency, alarms.emergency_fleets, on=on)

    def forget(self) -> None:
        """Close both topics with their history, and open them again."""
        for topic in (self._fire, self._emergency):
            self._topics.leave(topic)
        self.offer(self._alarms)


class Dds:
    """The lift adapter's connection to RMF. Raises DdsMissing and DdsFailed. Call it from one thread."""

    def __init__(self, settings: RosSettings, listener: DdsListener, deliver: Deliver) -> None:
        self._settings = settings
        self._listener = listener
        self._inbox = Inbox(deliver)
        self._names: set[str] = set()
        self._states = settings.resolved(settings.states_topic)
        self._topics = _join(settings, self._open, deliver)
        self.alarm = DdsAlarms(settings, self._topics)

    def _open(self, topics: DdsTopics) -> None:
        requests = self._settings.resolved(self._settings.requests_topic)
        topics.read_requests(
            requests, self._on_request, self._on_unreadable, self._on_writer_matched, self._inbox.overrun
        )
        # volatile, too: a replay would contain old ENDs of sessions that go on
        fleets = self._settings.resolved(self._settings.adapter_requests_topic)
        topics.read_requests(fleets, self._on_fleet_request, self._on_unreadable, _do_nothing, self._inbox.overrun)
        topics.read_states_of_others(self._states, self._on_state)
        topics.offer_states(self._states)
        if self._settings.use_sim_time:
            topics.read_clock(self._on_clock)

    @property
    def dropped(self) -> int:
        """The least number of requests that were dropped because they were not processed in time."""
        return self._inbox.dropped

    def publish(self, state: LiftState) -> None:
        """Send a state to all present readers. Never waits for a slow one."""
        self._names.add(state.lift_name)
        self._topics.send_state(self._states, state)

    def close(self) -> None:
        """Leave after a moment in which the last messages can arrive. Nothing is delivered afterwards."""
        self._inbox.close()
        self._topics.close()

    def _on_request(self, request: LiftRequest) -> None:
        ends = request.request_type == END_SESSION and request.session_id != ""  # some supervisors send it only once
        self._inbox.put(partial(self._listener.on_request, request), _text_size(request), keep=ends)

    def _on_fleet_request(self, request: LiftRequest) -> None:
        # a fleet repeats its requests, so none of them has to be kept
        self._inbox.put(partial(self._listener.on_fleet_request, request), _text_size(request))

    def _on_unreadable(self, text: str) -> None:
        self._inbox.put(partial(self._listener.on_unreadable, text), len(text))

    def _on_writer_matched(self) -> None:
        self._inbox.put_newest("matched", self._listener.on_request_writer)

    def _on_state(self, state: LiftState) -> None:
        if state.lift_name in self._names:
            self._inbox.put_newest(f"rival {state.lift_name}", partial(self._listener.on_rival, state.lift_name))

    def _on_clock(self, seconds: float) -> None:
        self._inbox.put_newest("clock", partial(self._listener.on_clock, seconds))


class MonitorListener(Protocol):
    """The callbacks of a program that watches RMF, always called through `deliver`."""

    def on_state(self, state: LiftState) -> None: ...

    def on_request(self, topic: str, request: LiftRequest) -> None:
        """Process a request to the supervisor (`adapter_requests_topic`) or from it (`requests_topic`)."""
        ...

    def on_unreadable(self, text: str) -> None: ...


class Monitor:
    """Receives all messages about lifts, and can request a lift as a robot does. Raises DdsMissing and DdsFailed."""

    def __init__(self, settings: RosSettings, listener: MonitorListener, deliver: Deliver) -> None:
        self._settings = settings
        self._listener = listener
        self._inbox = Inbox(deliver)
        self._topics = _join(settings, self._open, deliver)

    def _open(self, topics: DdsTopics) -> None:
        settings = self._settings
        states = settings.resolved(settings.states_topic)
        topics.read_states(states, self._on_state, self._on_unreadable, self._inbox.overrun)
        for topic in (settings.adapter_requests_topic, settings.requests_topic):
            resolved = settings.resolved(topic)
            on_request = partial(self._on_request, topic)
            topics.read_requests(resolved, on_request, self._on_unreadable, _do_nothing, self._inbox.overrun)
            topics.offer_requests(resolved)

    def send_request(self, request: LiftRequest, *, direct: bool = False) -> None:
        """Send a request to the supervisor, or `direct`ly to the lift adapter, in which case a supervisor soon ends the session."""
        self._topics.send_request(self._request_topic(direct=direct), request)

    def count_readers(self, *, direct: bool = False) -> int:
        """Return how many readers would get a request."""
        return self._topics.readers_of(self._request_topic(direct=direct))

    def close(self) -> None:
        """Leave after a moment in which a request can arrive."""
        self._inbox.close()
        self._topics.close()

    def _request_topic(self, *, direct: bool) -> str:
        settings = self._settings
        return settings.resolved(settings.requests_topic if direct else settings.adapter_requests_topic)

    def _on_state(self, state: LiftState) -> None:
        self._inbox.put(partial(self._listener.on_state, state), len(state.session_id))

    def _on_request(self, topic: str, request: LiftRequest) -> None:
        self._inbox.put(partial(self._listener.on_request, topic, request), _text_size(request))

    def _on_unreadable(self, text: str) -> None:
        self._inbox.put(partial(self._listener.on_unreadable, text), len(text))


def _text_size(request: LiftRequest) -> int:
    return len(request.lift_name) + len(request.session_id) + len(request.destination_floor)


def _raise(error: Exception) -> None:
    """Raise a bug of the reading thread in the adapter's thread: the adapter must not go on without receiving anything."""
    raise error


def _do_nothing() -> None:
    """Ignore new writers of this topic."""


def _join(settings: RosSettings, open_topics: Callable[[DdsTopics], None], deliver: Deliver) -> DdsTopics:
    """Load Cyclone DDS, join the domain, open the topics and begin to receive."""

    def on_failure(error: Exception) -> None:
        deliver(partial(_raise, error))

    try:
        module = import_module("lift_manager.rmf.dds_topics")
    except Exception as error:
        # a build from source raises an exception of its own if it does not find its C library
        if isinstance(error, ImportError) or type(error).__module__.startswith("cyclonedds"):
            raise DdsMissing(error) from error
        raise
    topics: DdsTopics = module.DdsTopics(settings, on_failure)
    open_topics(topics)
    topics.start()
    return topics
