"""A participant of a DDS domain, and the thread that waits for what comes in.

A thread of our own takes the samples, and no listener: a listener runs in the receiving thread of Cyclone DDS, or in
the writer's where both are in one process, it may run before its reader exists, and what it raises or waits for hurts
them.
"""

from __future__ import annotations

import logging
import os
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
from cyclonedds.qos import Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from lift_manager.rmf.dds import DdsFailed
from lift_manager.rmf.dds_config import config_of
from lift_manager.rmf.ros_settings import RosSettings

_log = logging.getLogger(__name__)

_AT_ONCE = 50
"""Samples of one reader before the next reader has its turn."""
_PAUSE_S = 1.0
"""After a failure of Cyclone DDS itself, so that a lasting one does not fill log and processor; chosen."""
_POLICIES = {2: "durability", 11: "reliability", 23: "data representation"}
"""DDS 1.4 and DDS-XTypes 1.3, QosPolicyId."""


@dataclass
class _Source:
    """A reader and what is done with what it brings."""

    name: str
    reader: DataReader[Any]
    waiting: ReadCondition
    heard: Callable[[Any], None]
    broken: Callable[[str], None]
    matched: Callable[[], None]

    def drain(self) -> None:
        """One at a time: where one of many cannot be decoded, `take` loses all of them."""
        self._look_around()
        for _ in range(_AT_ONCE):
            if not self._take_one():
                return

    def _take_one(self) -> bool:
        try:
            samples = self.reader.take(N=1)
        except DDSException:
            raise
        except Exception as error:  # noqa: BLE001  whatever strange bytes do to the decoder, the next sample counts
            self.broken(f"{self.name}: a message cannot be read: {error}")
            return True
        for sample in samples:
            if not isinstance(sample, InvalidSample):
                self._look_around()  # its writer may have come since
                self.heard(sample)
        return bool(samples)

    def _look_around(self) -> None:
        if self.reader.get_subscription_matched_status().total_count_change > 0:
            self.matched()
        refused = self.reader.get_requested_incompatible_qos_status()
        if refused.total_count_change > 0:
            policy = _POLICIES.get(refused.last_policy_id, f"policy {refused.last_policy_id}")
            _log.warning(
                "%s: somebody publishes it in a way that cannot be heard: its %s does not fit", self.name, policy
            )


class DdsLink:
    """Readers and writers by topic. Raises DdsFailed. Everything but the thread is for one thread."""

    def __init__(self, settings: RosSettings) -> None:
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

    def open_reader(
        self,
        name: str,
        kind: type[IdlStruct],
        qos: Qos,
        *,
        heard: Callable[[Any], None],
        broken: Callable[[str], None],
        matched: Callable[[], None],
    ) -> None:
        """Call `heard` with each sample, in the thread of this link; `matched` before the first one of a new writer."""
        with _refusals(f"{name} cannot be listened to"):
            reader = DataReader(self._participant, self._topic(name, kind), qos=qos)
            reader.set_status_mask(DDSStatus.SubscriptionMatched | DDSStatus.RequestedIncompatibleQos)
            # A writer that has left does not take its last samples along: hence `Any`, and not only living instances
            waiting = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
            self._waitset.attach(reader)
            self._waitset.attach(waiting)
        self._sources.append(_Source(name, reader, waiting, heard, broken, matched))

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
        while not self._stopping.is_set():
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


@contextmanager
def _refusals(what: str) -> Iterator[None]:
    try:
        yield
    except DDSException as error:
        raise DdsFailed(f"{what}: {error}") from error
