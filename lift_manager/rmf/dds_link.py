"""A participant of a DDS domain, and the thread that waits for what comes in.

A thread of our own takes the samples, and no listener: a listener runs in the receiving thread of Cyclone DDS, or in
the writer's where both are in one process, it may run before its reader exists, and what it raises or waits for hurts
them.
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
"""Samples in one call of Cyclone DDS; other threads of this program stand still for that time (1.2 ms, measured)."""
_MOST_BYTES = 32_000_000
"""Of one reader before the next reader has its turn; a full history of requests is a few megabytes."""
_PAUSE_S = 1.0
"""After a failure of Cyclone DDS itself, so that a lasting one does not fill log and processor; chosen."""
_POLICIES = {2: "durability", 11: "reliability", 23: "data representation"}
"""DDS 1.4 and DDS-XTypes 1.3, QosPolicyId."""


def _nothing() -> None:
    """Nobody wants to know."""


def _ignore(_: str) -> None:
    """A broken message of somebody else's is somebody else's."""


@dataclass(frozen=True)
class ReaderCallbacks:
    """What is called, in the thread of the link, with what a reader brings."""

    heard: Callable[[Any], None]
    broken: Callable[[str], None] = _ignore
    """With why one message cannot be read."""
    matched: Callable[[], None] = _nothing
    """Before the first sample of each new writer."""
    overrun: Callable[[], None] = _nothing
    """Where more came than the reader keeps, and the oldest may be lost."""


class _Bytes:
    """A sample as it came, for the reader: where one of many cannot be decoded, `take` would lose all of them."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    @classmethod
    def deserialize(cls, data: bytes) -> _Bytes:
        return cls(data)

    deserialize_key = deserialize


@dataclass
class _Source:
    """A reader and what is done with what it brings."""

    name: str
    kind: type[IdlStruct]
    reader: DataReader[Any]
    waiting: ReadCondition
    depth: int
    hearer: ReaderCallbacks

    def drain(self) -> None:
        """Empty the reader before anything is done with what it held, so that it has room for what comes meanwhile."""
        found = self._take()
        self._look_around()  # after taking: the writer of each of these has been matched
        if len(found) >= self.depth:  # Cyclone DDS 11.0.1 does not count what its history loses as SAMPLE_LOST
            self.hearer.overrun()
        while found:
            self._hear(found.popleft())

    def _take(self) -> deque[bytes]:
        found: deque[bytes] = deque()
        size = 0
        while len(found) < self.depth and size < _MOST_BYTES:
            samples = self.reader.take(N=_AT_ONCE)
            messages = [sample.data for sample in samples if not isinstance(sample, InvalidSample)]
            found.extend(messages)
            size += sum(map(len, messages))
            if len(samples) < _AT_ONCE:
                break
        return found

    def _hear(self, data: bytes) -> None:
        try:
            sample = self.kind.deserialize(data)
        except Exception as error:  # noqa: BLE001  whatever strange bytes do to the decoder, the next sample counts
            self.hearer.broken(f"{_why_unreadable(error)} ({self.name})")
            return
        self.hearer.heard(sample)

    def _look_around(self) -> None:
        if self.reader.get_subscription_matched_status().total_count_change > 0:
            self.hearer.matched()
        refused = self.reader.get_requested_incompatible_qos_status()
        if refused.total_count_change > 0:
            policy = _POLICIES.get(refused.last_policy_id, f"policy {refused.last_policy_id}")
            _log.warning(
                "%s: somebody publishes it in a way that cannot be heard: its %s does not fit", self.name, policy
            )


class DdsLink:
    """Readers and writers by topic. Raises DdsFailed. Everything but the thread is for one thread."""

    def __init__(self, settings: RosSettings, failed: Callable[[Exception], None]) -> None:
        """`failed` is called in the thread, at its end, with a bug that ended it: from then on nothing is heard."""
        self._failed = failed
        self._domain = _domain(settings)
        with _refusals(f"domain {settings.domain} cannot be joined"):
            self._participant = DomainParticipant(settings.domain)
            self._stop = GuardCondition(self._participant)
            self._waitset = WaitSet(self._participant)
            self._waitset.attach(self._stop)
        self._topics: dict[str, Topic[Any]] = {}
        self._writers: dict[str, DataWriter[Any]] = {}
        self._late: set[str] = set()
        self._sources: list[_Source] = []
        self._stopping = Event()
        self._thread = Thread(target=self._run, name="dds", daemon=True)

    def open_reader(self, name: str, kind: type[IdlStruct], qos: Qos, hearer: ReaderCallbacks) -> None:
        """Tell the hearer of what comes. The QoS has a history of a certain depth."""
        with _refusals(f"{name} cannot be listened to"):
            topic: Topic[Any] = Topic(self._participant, f"rt/{name}", kind)
            topic.data_type = _Bytes
            reader = DataReader(self._participant, topic, qos=qos)
            reader.set_status_mask(DDSStatus.SubscriptionMatched | DDSStatus.RequestedIncompatibleQos)
            # A writer that has left does not take its last samples along: hence `Any`, and not only living instances
            waiting = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
            self._waitset.attach(reader)
            self._waitset.attach(waiting)
        self._sources.append(_Source(name, kind, reader, waiting, qos[Policy.History].depth, hearer))

    def open_writer(self, name: str, kind: type[IdlStruct], qos: Qos) -> None:
        """Open it once; further calls change nothing."""
        if name not in self._writers:
            with _refusals(f"{name} cannot be published"):
                self._writers[name] = DataWriter(self._participant, self._topic(name, kind), qos=qos)

    def close_writer(self, name: str) -> None:
        """Close it; what it kept for readers that join later is gone. One that is not open stays so."""
        self._writers.pop(name, None)

    def write(self, name: str, sample: IdlStruct) -> None:
        """Send it to all who listen. What cannot go at once is left out, and logged once: the next one follows soon."""
        try:
            self._writers[name].write(sample)
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise DdsFailed(f"{name} cannot be published: {error}") from error
            if name not in self._late:
                self._late.add(name)
                _log.warning("%s: the network does not take it as fast as it comes: some of it is left out", name)

    def readers_of(self, name: str) -> int:
        return int(self._writers[name].get_publication_matched_status().current_count)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Leave; the process can join the domain again. Cyclone's objects are deleted when nothing refers to them."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self._stop.set(True)
        if self._thread.is_alive():
            self._thread.join()
        del self._waitset
        self._sources.clear()
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
                self._hear()
        except Exception as error:  # noqa: BLE001  raised again in the adapter's thread
            self._failed(error)

    def _hear(self) -> None:
        try:
            self._waitset.wait(duration(infinite=True))
            for source in self._sources:
                source.drain()
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
            f"domain {settings.domain} cannot be joined: Cyclone DDS said why on the error output, in lines with"
            f" [{settings.domain}] (more than 33 programs of it on this machine, a wrong configuration, no network{own})"
        ) from error


def _why_unreadable(error: Exception) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "its text is not UTF-8"
    return str(error) or type(error).__name__


@contextmanager
def _refusals(what: str) -> Iterator[None]:
    try:
        yield
    except DDSException as error:
        raise DdsFailed(f"{what}: {error}") from error
