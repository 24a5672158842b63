"""What an adapter says and hears over DDS, with the QoS that matches every distribution (open-rmf 1.3)."""

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
"""Of what is heard, until it is taken: more than a second of what one program sends in a loop (7,000 a second measured)."""
_STATES_DEPTH = 100
"""Of what is said: one second of fifty lifts."""
STATES_LIFESPAN_S = 1
"""Of a state that could not be delivered: two publications. Measured with Cyclone DDS 11.0.1 in a network namespace: after a break
shorter than the participant's lease (10 s) a RELIABLE reader got every state of the break in one burst, OPEN ones of 3.5 to 5 s
before in the middle of a fire, and RequestLift is done with one that says OPEN (open-rmf 1.5). Matches every reader all the same."""
_AT_ONCE = duration(milliseconds=0)
"""How long a write may wait for a slow reader: the adapter has other lifts to tell about."""


class Wire:
    """The topics of an adapter, or of somebody who looks on. What is `heard` comes in a thread of its own.

    Raises DdsFailed.
    """

    def __init__(self, settings: RosSettings, failed: Callable[[Exception], None]) -> None:
        """`failed` is called in that thread, too, with a bug after which nothing is heard any more."""
        self._link = DdsLink(settings, failed)
        self.start = self._link.start
        self.close = self._link.close
        self.readers_of = self._link.readers_of

    def hear_requests(
        self,
        topic: str,
        heard: Callable[[LiftRequest], None],
        broken: Callable[[str], None],
        matched: Callable[[], None],
        overrun: Callable[[], None],
    ) -> None:
        """Volatile: it matches every publisher, and gets no replay of old requests."""
        self._link.open_reader(
            topic,
            WireLiftRequest,
            _reliable(WireLiftRequest, Policy.Durability.Volatile, _DEPTH),
            ReaderCallbacks(lambda wire: heard(request_of(wire)), broken, matched, overrun),
        )

    def hear_states(
        self,
        topic: str,
        heard: Callable[[LiftState], None],
        broken: Callable[[str], None],
        overrun: Callable[[], None],
    ) -> None:
        self._link.open_reader(
            topic,
            WireLiftState,
            _reliable(WireLiftState, Policy.Durability.Volatile, _DEPTH),
            ReaderCallbacks(lambda wire: heard(state_of(wire)), broken, overrun=overrun),
        )

    def hear_states_of_others(self, topic: str, heard: Callable[[LiftState], None]) -> None:
        """Best effort: missing one of them is no loss, and nobody has to wait for this reader."""
        self._link.open_reader(
            topic,
            WireLiftState,
            Qos(*_best_effort(WireLiftState, _STATES_DEPTH), Policy.IgnoreLocal.Participant),
            ReaderCallbacks(lambda wire: heard(state_of(wire))),
        )

    def hear_clock(self, heard: Callable[[float], None]) -> None:
        self._link.open_reader(
            "clock",
            WireClock,
            Qos(*_best_effort(WireClock, 1)),
            ReaderCallbacks(lambda wire: heard(seconds_of(wire))),
        )

    def offer_states(self, topic: str) -> None:
        """Of what could not be delivered, nothing older than a second is: it would be believed."""
        span = Policy.Lifespan(duration(seconds=STATES_LIFESPAN_S))
        self._link.open_writer(
            topic, WireLiftState, _reliable(WireLiftState, Policy.Durability.Volatile, _STATES_DEPTH, span)
        )

    def offer_requests(self, topic: str) -> None:
        """Transient local: as fleet adapters do, and the supervisors of iron and later want it."""
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
        """Publish there no more; who joins later gets nothing of what was said."""
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
