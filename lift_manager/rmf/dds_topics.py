"""The DDS topics of an adapter, with a QoS that matches every distribution (open-rmf 1.3)."""

from __future__ import annotations

from collections.abc import Callable

from cyclonedds.idl import IdlStruct
from cyclonedds.qos import Policy, Qos
from cyclonedds.util import duration

from lift_manager.rmf.dds_link import DdsLink, ReaderCallbacks
from lift_manager.rmf.dds_types import (
    TYPE_HASHES,
    WireBool,
    WireClock,
    WireEmergencySignal,
    WireLiftRequest,
    WireLiftState,
    request_of,
    seconds_of,
    state_of,
    wire_request,
    wire_state,
)
from lift_manager.rmf.messages import LiftRequest, LiftState
from lift_manager.rmf.ros_settings import RosSettings

_DEPTH = 10_000
"""Of received messages: more than a second of what one program sends in a loop (7,000 a second measured)."""
_STATES_DEPTH = 100
"""Of published states: one second of fifty lifts."""
STATES_LIFESPAN_S = 1
"""Of an undelivered state: two publications. Measured with Cyclone DDS 11.0.1 in a network namespace: after an outage shorter than the
participant's lease (10 s) a RELIABLE reader got every state of the outage in one burst, among them OPEN states 3.5 to 5 s old in the middle
of a fire, and RequestLift is satisfied by one OPEN (open-rmf 1.5). It matches every reader all the same."""
_AT_ONCE = duration(milliseconds=0)
"""How long a write may wait for a slow reader: not at all, because the other lifts would wait too."""


class DdsTopics:
    """The topics of an adapter or a monitor. Callbacks run in a thread of their own. Raises DdsFailed."""

    def __init__(self, settings: RosSettings, on_failure: Callable[[Exception], None]) -> None:
        """`on_failure` is called in that thread, too, with a bug after which nothing is received any more."""
        self._link = DdsLink(settings, on_failure)
        self.start = self._link.start
        self.close = self._link.close
        self.readers_of = self._link.readers_of

    def read_requests(
        self,
        topic: str,
        on_request: Callable[[LiftRequest], None],
        on_unreadable: Callable[[str], None],
        on_matched: Callable[[], None],
        on_overrun: Callable[[], None],
    ) -> None:
        """Subscribe as VOLATILE, which matches every publisher and gets no replay of old requests."""
        self._link.open_reader(
            topic,
            WireLiftRequest,
            _reliable(WireLiftRequest, Policy.Durability.Volatile, _DEPTH),
            ReaderCallbacks(lambda wire: on_request(request_of(wire)), on_unreadable, on_matched, on_overrun),
        )

    def read_states(
        self,
        topic: str,
        on_state: Callable[[LiftState], None],
        on_unreadable: Callable[[str], None],
        on_overrun: Callable[[], None],
    ) -> None:
        self._link.open_reader(
            topic,
            WireLiftState,
            _reliable(WireLiftState, Policy.Durability.Volatile, _DEPTH),
            ReaderCallbacks(lambda wire: on_state(state_of(wire)), on_unreadable, on_overrun=on_overrun),
        )

    def read_states_of_others(self, topic: str, on_state: Callable[[LiftState], None]) -> None:
        """Subscribe as BEST_EFFORT: a missed state does not matter, and no writer has to wait for this reader."""
        self._link.open_reader(
            topic,
            WireLiftState,
            Qos(*_best_effort(WireLiftState, _STATES_DEPTH), Policy.IgnoreLocal.Participant),
            ReaderCallbacks(lambda wire: on_state(state_of(wire))),
        )

    def read_clock(self, on_time: Callable[[float], None]) -> None:
        self._link.open_reader(
            "clock",
            WireClock,
            Qos(*_best_effort(WireClock, 1)),
            ReaderCallbacks(lambda wire: on_time(seconds_of(wire))),
        )

    def offer_states(self, topic: str) -> None:
        """Publish states with a lifespan, so that no reader gets and believes an undelivered state older than a second."""
        span = Policy.Lifespan(duration(seconds=STATES_LIFESPAN_S))
        self._link.open_writer(
            topic, WireLiftState, _reliable(WireLiftState, Policy.Durability.Volatile, _STATES_DEPTH, span)
        )

    def offer_requests(self, topic: str) -> None:
        """Publish as TRANSIENT_LOCAL, like fleet adapters; the supervisors of iron and later require it."""
        self._link.open_writer(topic, WireLiftRequest, _reliable(WireLiftRequest, Policy.Durability.TransientLocal, 1))

    def send_state(self, topic: str, state: LiftState) -> None:
        self._link.write(topic, wire_state(state))

    def send_request(self, topic: str, request: LiftRequest) -> None:
        self._link.write(topic, wire_request(request))

    def offer_fire_alarm(self, topic: str) -> None:
        self._link.open_writer(topic, WireBool, _reliable(WireBool, Policy.Durability.TransientLocal, 1))

    def offer_emergency(self, topic: str) -> None:
        self._link.open_writer(
            topic, WireEmergencySignal, _reliable(WireEmergencySignal, Policy.Durability.TransientLocal, 1)
        )

    def leave(self, topic: str) -> None:
        """Close a topic; later readers get nothing of its history."""
        self._link.close_writer(topic)

    def send_fire_alarm(self, topic: str, *, on: bool) -> None:
        self._link.write(topic, WireBool(on))

    def send_emergency(self, topic: str, fleets: tuple[str, ...], *, on: bool) -> None:
        self._link.write(topic, WireEmergencySignal(list(fleets), on))


def _reliable(kind: type[IdlStruct], durability: Policy.Durability, depth: int, *others: Policy.Lifespan) -> Qos:
    return Qos(
        *_common(kind, depth),
        Policy.Reliability.Reliable(max_blocking_time=_AT_ONCE),
        durability,
        Policy.WriterDataLifecycle(
            autodispose=False
        ),  # a ROS subscriber of a keyless topic would see its one instance go
        *others,
    )


def _best_effort(kind: type[IdlStruct], depth: int) -> tuple[object, ...]:
    return (*_common(kind, depth), Policy.Reliability.BestEffort, Policy.Durability.Volatile)


def _common(kind: type[IdlStruct], depth: int) -> tuple[object, ...]:
    return (
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.Userdata(f"typehash={TYPE_HASHES[kind]};".encode()),
    )
