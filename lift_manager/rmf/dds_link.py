"""A participant of a DDS domain, and the thread that receives its messages.

It uses a thread of its own instead of a DDS listener: a listener runs in the receiving thread of Cyclone DDS, or in the
writer's if both are in one process, it may run before its reader exists, and its exceptions and waits affect these threads.
"""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event, Thread
from typing import Any

from cyclonedds.core import (
    DDSException,
    DDSStatus,
    GuardCondition,
    InstanceState,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from lift_manager.rmf.dds import DdsFailed
from lift_manager.rmf.dds_config import config_of
from lift_manager.rmf.ros_settings import RosSettings

_log = logging.getLogger(__name__)

_AT_ONCE = 50
"""Samples in one call of Cyclone DDS, during which other threads of this program stand still (1.2 ms, measured)."""
_MOST_BYTES = 32_000_000
"""Bytes taken from one reader before the next one gets its turn; a full history of requests is a few megabytes."""
_PAUSE_S = 1.0
"""After a failure of Cyclone DDS itself, so that a lasting one does not fill the log or the processor. Chosen."""
_POLICIES = {2: "durability", 11: "reliability", 23: "data representation"}
"""DDS 1.4 and DDS-XTypes 1.3, QosPolicyId."""


def _do_nothing() -> None:
    """Ignore an event."""


def _ignore(_: str) -> None:
    """Ignore an unreadable message that is not for us."""


@dataclass(frozen=True)
class ReaderCallbacks:
    """The callbacks of a reader, called in the thread of the link."""

    on_sample: Callable[[Any], None]
    on_unreadable: Callable[[str], None] = _ignore
    """With the reason why one message cannot be read."""
    on_matched: Callable[[], None] = _do_nothing
    """Before the first sample of each new writer."""
    on_overrun: Callable[[], None] = _do_nothing
    """When more messages came than the reader keeps, so that the oldest may be lost."""


class _Bytes:
    """An undecoded sample: if the reader decoded them, `take` would lose all samples because of one that cannot be decoded."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    @classmethod
    def deserialize(cls, data: bytes) -> _Bytes:
        return cls(data)

    deserialize_key = deserialize


@dataclass
class _Subscription:
    """A reader and its callbacks."""

    name: str
    kind: type[IdlStruct]
    reader: DataReader[Any]
    waiting: ReadCondition
    depth: int
    callbacks: ReaderCallbacks

    def drain(self) -> None:
        """Empty the reader before processing the samples, so that it has room for new ones meanwhile."""
        received = self._take()
        self._check_writers()  # after taking: the writer of each of these has been matched
        if len(received) >= self.depth:  # Cyclone DDS 11.0.1 does not count what its history loses as SAMPLE_LOST
            self.callbacks.on_overrun()
        while received:
            self._decode(received.popleft())

    def _take(self) -> deque[bytes]:
        received: deque[bytes] = deque()
        size = 0
        while len(received) < self.depth and size < _MOST_BYTES:
            samples = self.reader.take(N=_AT_ONCE)
            messages = [sample.data for sample in samples if not isinstance(sample, InvalidSample)]
            received.extend(messages)
            size += sum(map(len, messages))
            if len(samples) < _AT_ONCE:
                break
        return received

    def _decode(self, data: bytes) -> None:
        try:
            sample = self.kind.deserialize(data)
        except Exception as error:  # noqa: BLE001  strange bytes may break the decoder in any way; the next sample still counts
            self.callbacks.on_unreadable(f"{_why_unreadable(error)} ({self.name})")
            return
        self.callbacks.on_sample(sample)

    def _check_writers(self) -> None:
        if self.reader.get_subscription_matched_status().total_count_change > 0:
            self.callbacks.on_matched()
        refused = self.reader.get_requested_incompatible_qos_status()
        if refused.total_count_change > 0:
            policy = _POLICIES.get(refused.last_policy_id, f"policy {refused.last_policy_id}")
            _log.warning(
                "%s: another program publishes it with an incompatible %s, so it cannot be received", self.name, policy
            )


class DdsLink:
    """Readers and writers by topic. Raises DdsFailed. Use it from one thread, besides its own."""

    def __init__(self, settings: RosSettings, on_failure: Callable[[Exception], None]) -> None:
        """`on_failure` is called in the link's thread with a bug that ends it: nothing is received afterwards."""
        self._on_failure = on_failure
        self._domain = _domain(settings)
        with _dds_errors(f"domain {settings.domain} cannot be joined"):
            self._participant = DomainParticipant(settings.domain)
            self._stop = GuardCondition(self._participant)
            self._waitset = WaitSet(self._participant)
            self._waitset.attach(self._stop)
        self._topics: dict[str, Topic[Any]] = {}
        self._writers: dict[str, DataWriter[Any]] = {}
        self._slow_topics: set[str] = set()
        self._subscriptions: list[_Subscription] = []
        self._stopping = Event()
        self._thread = Thread(target=self._run, name="dds", daemon=True)

    def open_reader(self, name: str, kind: type[IdlStruct], qos: Qos, callbacks: ReaderCallbacks) -> None:
        """Open a reader. The QoS needs a history depth."""
        with _dds_errors(f"{name} cannot be subscribed to"):
            topic: Topic[Any] = Topic(self._participant, f"rt/{name}", kind)
            topic.data_type = _Bytes
            reader = DataReader(self._participant, topic, qos=qos)
            reader.set_status_mask(DDSStatus.SubscriptionMatched | DDSStatus.RequestedIncompatibleQos)
            # `Any` and not only living instances, because the last samples of a writer that has left still count
            waiting = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
            self._waitset.attach(reader)
            self._waitset.attach(waiting)
        self._subscriptions.append(_Subscription(name, kind, reader, waiting, qos[Policy.History].depth, callbacks))

    def open_writer(self, name: str, kind: type[IdlStruct], qos: Qos) -> None:
        """Open a writer once; further calls change nothing."""
        if name not in self._writers:
            with _dds_errors(f"{name} cannot be published"):
                self._writers[name] = DataWriter(self._participant, self._topic(name, kind), qos=qos)

    def close_writer(self, name: str) -> None:
        """Close a writer and drop its history for later readers. Does nothing if it is not open."""
        self._writers.pop(name, None)

    def write(self, name: str, sample: IdlStruct) -> None:
        """Send a sample to all readers. One that cannot be sent at once is skipped, and logged once: the next one follows soon."""
        try:
            self._writers[name].write(sample)
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise DdsFailed(f"{name} cannot be published: {error}") from error
            if name not in self._slow_topics:
                self._slow_topics.add(name)
                _log.warning("%s: the network is too slow for it: some messages are skipped", name)

    def readers_of(self, name: str) -> int:
        return int(self._writers[name].get_publication_matched_status().current_count)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Leave the domain; the process can join it again. Cyclone's objects are deleted once nothing refers to them."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self._stop.set(True)
        if self._thread.is_alive():
            self._thread.join()
        del self._waitset
        self._subscriptions.clear()
        self._writers.clear()
        self._topics.clear()
        del self._stop, self._participant, self._domain

    def _topic(self, name: str, kind: type[IdlStruct]) -> Topic[Any]:
        if name not in self._topics:
            self._topics[name] = Topic(self._participant, f"rt/{name}", kind)
        return self._topics[name]

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._wait_and_drain()
        except Exception as error:  # noqa: BLE001  raised again in the adapter's thread
            self._on_failure(error)

    def _wait_and_drain(self) -> None:
        try:
            self._waitset.wait(duration(infinite=True))
            for subscription in self._subscriptions:
                subscription.drain()
        except DDSException:
            _log.exception("Cyclone DDS failed; trying again")
            self._stopping.wait(_PAUSE_S)


def _domain(settings: RosSettings) -> Domain:
    uri = settings.cyclonedds_uri
    try:
        return Domain(settings.domain, config_of(settings, os.getpid()))
    except UnicodeEncodeError as error:
        raise DdsFailed(f"CYCLONEDDS_URI is {uri!r}: Cyclone DDS takes ASCII letters only") from error
    except DDSException as error:
        if error.code == DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            raise DdsFailed(f"this program is in domain {settings.domain} already; it can be there once") from error
        own = f"; CYCLONEDDS_URI is {uri!r}" if uri else ""
        raise DdsFailed(
            f"domain {settings.domain} cannot be joined: Cyclone DDS wrote the reason to the error output, in lines with"
            f" [{settings.domain}] (more than 33 programs of it on this machine, a wrong configuration, no network{own})"
        ) from error


def _why_unreadable(error: Exception) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "its text is not UTF-8"
    return str(error) or type(error).__name__


@contextmanager
def _dds_errors(what: str) -> Iterator[None]:
    try:
        yield
    except DDSException as error:
        raise DdsFailed(f"{what}: {error}") from error
