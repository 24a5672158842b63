"""RMF over DDS, without ROS: lift requests in, lift states and alarms out.

Cyclone DDS is loaded when it is used, so that a manager without the extra `[rmf]` starts, and starts fast.
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
    from lift_manager.rmf.dds_wire import Wire


class DdsError(RuntimeError):
    """RMF cannot be reached over DDS.

    DdsError
    ├── DdsMissing
    └── DdsFailed
    """


class DdsMissing(DdsError):
    """The package of Cyclone DDS is not installed or does not load; the message says what to do."""

    def __init__(self, cause: object) -> None:
        super().__init__(
            f"Cyclone DDS is needed to reach RMF without ROS, and it does not load ({cause}).\n"
            "Install the manager with its extra `rmf`: pip install '.[rmf]' in its folder, in its own environment.\n"
            "Where pip finds no wheel (Linux on ARM, Alpine, Python 3.14), build it from source, with git, cmake and a"
            " C compiler:\n"
            "  git clone --branch 11.0.1 https://github.com/eclipse-cyclonedds/cyclonedds && cd cyclonedds\n"
            "  cmake -B build -DCMAKE_INSTALL_PREFIX=/opt/cyclonedds && cmake --build build --target install\n"
            "  CYCLONEDDS_HOME=/opt/cyclonedds pip install --no-binary cyclonedds cyclonedds==11.0.1\n"
            "and set CYCLONEDDS_HOME wherever the manager runs. Where ROS 2 is installed, the package in deploy/ros does"
            " without."
        )


class DdsFailed(DdsError):
    """Cyclone DDS refused; the message says what and, as far as it says so, why."""


class DdsListener(Protocol):
    """What of the adapter is called, always through `deliver`, that is in the adapter's own thread."""

    def on_request(self, request: LiftRequest) -> None:
        """Take a request, whatever is in it, in the order of arrival."""
        ...

    def on_fleet_request(self, request: LiftRequest) -> None:
        """Take what a fleet sent to its lift supervisor, in the order of arrival."""
        ...

    def on_unreadable(self, text: str) -> None:
        """A request came that could not be read."""
        ...

    def on_request_writer(self) -> None:
        """A publisher of lift requests appeared; its first request is delivered after this."""
        ...

    def on_rival(self, lift_name: str) -> None:
        """Somebody else published the state of a lift that was published here."""
        ...

    def on_clock(self, seconds: float) -> None:
        """It is that time on /clock; only with `use_sim_time`, and not every message of it."""
        ...


class DdsAlarm:
    """Where a fire is told. Implements `alarms.AlarmPublisher`; nothing is offered before the site wants it."""

    def __init__(self, settings: RosSettings, wire: Wire) -> None:
        self._fire = settings.resolved(settings.fire_topic)
        self._emergency = settings.resolved(settings.emergency_topic)
        self._wire = wire
        self._alarms = Alarms()

    def offer(self, alarms: Alarms) -> None:
        """Be found by those who listen."""
        self._alarms = alarms
        if alarms.fire_alarm:
            self._wire.offer_fire_alarm(self._fire)
        if alarms.emergency_signal:
            self._wire.offer_emergency(self._emergency)

    def publish_alarms(self, alarms: Alarms, *, on: bool) -> None:
        """Publish what the site wants; whoever joins later sees the last of it, until it is forgotten."""
        self.offer(alarms)
        if alarms.fire_alarm:
            self._wire.send_fire_alarm(self._fire, on=on)
        if alarms.emergency_signal:
            self._wire.send_emergency(self._emergency, alarms.emergency_fleets, on=on)

    def forget(self) -> None:
        """Leave both topics with what was said there, and be found on them anew."""
        for topic in (self._fire, self._emergency):
            self._wire.leave(topic)
        self.offer(self._alarms)


class Dds:
    """The lift adapter's place in RMF. Raises DdsMissing and DdsFailed. Call it from one thread."""

    def __init__(self, settings: RosSettings, listener: DdsListener, deliver: Deliver) -> None:
        self._settings = settings
        self._listener = listener
        self._inbox = Inbox(deliver)
        self._names: set[str] = set()
        self._states = settings.resolved(settings.states_topic)
        self._wire = _wire(settings, self._open, deliver)
        self.alarm = DdsAlarm(settings, self._wire)

    def _open(self, wire: Wire) -> None:
        requests = self._settings.resolved(self._settings.requests_topic)
        wire.hear_requests(requests, self._heard_request, self._heard_broken, self._matched, self._inbox.overrun)
        # volatile, too: a replay would hold old ENDs of sessions that go on
        fleets = self._settings.resolved(self._settings.adapter_requests_topic)
        wire.hear_requests(fleets, self._heard_fleet, self._heard_broken, _nothing, self._inbox.overrun)
        wire.hear_states_of_others(self._states, self._heard_state)
        wire.offer_states(self._states)
        if self._settings.use_sim_time:
            wire.hear_clock(self._heard_clock)

    @property
    def dropped(self) -> int:
        """Requests given up because nobody took them, at least so many."""
        return self._inbox.dropped

    def publish(self, state: LiftState) -> None:
        """Send it to everybody who listens now. Never waits for a slow one."""
        self._names.add(state.lift_name)
        self._wire.send_state(self._states, state)

    def close(self) -> None:
        """Give what was published last a moment to arrive, then leave. Nothing is delivered afterwards."""
        self._inbox.close()
        self._wire.close()

    def _heard_request(self, request: LiftRequest) -> None:
        ends = request.request_type == END_SESSION and request.session_id != ""  # some supervisors send it only once
        self._inbox.put(partial(self._listener.on_request, request), _text_of(request), kept=ends)

    def _heard_fleet(self, request: LiftRequest) -> None:
        # a fleet repeats what it wants, so nothing of it has to be kept
        self._inbox.put(partial(self._listener.on_fleet_request, request), _text_of(request))

    def _heard_broken(self, text: str) -> None:
        self._inbox.put(partial(self._listener.on_unreadable, text), len(text))

    def _matched(self) -> None:
        self._inbox.put_newest("matched", self._listener.on_request_writer)

    def _heard_state(self, state: LiftState) -> None:
        if state.lift_name in self._names:
            self._inbox.put_newest(f"rival {state.lift_name}", partial(self._listener.on_rival, state.lift_name))

    def _heard_clock(self, seconds: float) -> None:
        self._inbox.put_newest("clock", partial(self._listener.on_clock, seconds))


class OnlookerListener(Protocol):
    """What of somebody who only looks on is called, always through `deliver`."""

    def on_state(self, state: LiftState) -> None: ...

    def on_request(self, topic: str, request: LiftRequest) -> None:
        """Take a request to the supervisor (`adapter_requests_topic`) or from it (`requests_topic`)."""
        ...

    def on_unreadable(self, text: str) -> None: ...


class Onlooker:
    """Hears all that is said about lifts, and can ask for one as a robot does. Raises DdsMissing and DdsFailed."""

    def __init__(self, settings: RosSettings, listener: OnlookerListener, deliver: Deliver) -> None:
        self._settings = settings
        self._listener = listener
        self._inbox = Inbox(deliver)
        self._wire = _wire(settings, self._open, deliver)

    def _open(self, wire: Wire) -> None:
        settings = self._settings
        states = settings.resolved(settings.states_topic)
        wire.hear_states(states, self._heard_state, self._heard_broken, self._inbox.overrun)
        for topic in (settings.adapter_requests_topic, settings.requests_topic):
            found = settings.resolved(topic)
            heard = partial(self._heard_request, topic)
            wire.hear_requests(found, heard, self._heard_broken, _nothing, self._inbox.overrun)
            wire.offer_requests(found)

    def request(self, request: LiftRequest, *, direct: bool = False) -> None:
        """Send it to the supervisor, or `direct`ly to the lift adapter, whose supervisor will end it soon."""
        self._wire.send_request(self._asked_topic(direct=direct), request)

    def listeners(self, *, direct: bool = False) -> int:
        """Return how many would hear a request."""
        return self._wire.readers_of(self._asked_topic(direct=direct))

    def close(self) -> None:
        """Give a request a moment to arrive, then leave."""
        self._inbox.close()
        self._wire.close()

    def _asked_topic(self, *, direct: bool) -> str:
        settings = self._settings
        return settings.resolved(settings.requests_topic if direct else settings.adapter_requests_topic)

    def _heard_state(self, state: LiftState) -> None:
        self._inbox.put(partial(self._listener.on_state, state), len(state.session_id))

    def _heard_request(self, topic: str, request: LiftRequest) -> None:
        self._inbox.put(partial(self._listener.on_request, topic, request), _text_of(request))

    def _heard_broken(self, text: str) -> None:
        self._inbox.put(partial(self._listener.on_unreadable, text), len(text))


def _text_of(request: LiftRequest) -> int:
    return len(request.lift_name) + len(request.session_id) + len(request.destination_floor)


def _fail(error: Exception) -> None:
    """Let a bug of the thread that hears end the adapter, which would go on without hearing: its own thread is the one that can."""
    raise error


def _nothing() -> None:
    """Who publishes does not matter here."""


def _wire(settings: RosSettings, opened: Callable[[Wire], None], deliver: Deliver) -> Wire:
    """Load Cyclone DDS, join the domain, open what is needed and begin to listen."""

    def failed(error: Exception) -> None:
        deliver(partial(_fail, error))

    try:
        module = import_module("lift_manager.rmf.dds_wire")
    except Exception as error:
        # Built from source, it raises an exception of its own where it does not find its C library
        if isinstance(error, ImportError) or type(error).__module__.startswith("cyclonedds"):
            raise DdsMissing(error) from error
        raise
    wire: Wire = module.Wire(settings, failed)
    opened(wire)
    wire.start()
    return wire
