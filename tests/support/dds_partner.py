"""Somebody else in RMF: publishes and hears bytes on any topic, with any QoS.

In this process, or as a program of its own (`python -m`). The bytes are not looked at, so they may come from another
encoder, and may be no message at all.
"""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
    DcpsEndpoint,
)
from cyclonedds.core import DDSStatus, GuardCondition, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from lift_manager.rmf.dds_types import WireBool, WireClock, WireEmergencySignal, WireLiftRequest, WireLiftState

KINDS: dict[str, type[IdlStruct]] = {
    "request": WireLiftRequest,
    "state": WireLiftState,
    "alarm": WireBool,
    "emergency": WireEmergencySignal,
    "clock": WireClock,
}
ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 120.0


@dataclass(frozen=True)
class Offer:
    """A QoS in few words."""

    reliable: bool = True
    transient: bool = False
    depth: int = 100

    def qos(self) -> Qos:
        return Qos(
            Policy.Reliability.Reliable(duration(seconds=2)) if self.reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if self.transient else Policy.Durability.Volatile,
            Policy.History.KeepLast(self.depth),
            Policy.DurabilityService(0, Policy.History.KeepLast(self.depth), -1, -1, -1),
            Policy.DataRepresentation(use_cdrv0_representation=True),
            Policy.WriterDataLifecycle(autodispose=False),
        )


class _Bytes:
    """What a reader makes of a sample: nothing."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: object = None

    @classmethod
    def deserialize(cls, data: bytes) -> "_Bytes":
        return cls(bytes(data))

    deserialize_key = deserialize


@dataclass
class Ear:
    """What one reader of a partner heard."""

    samples: list[bytes] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def take(self, data: bytes) -> None:
        with self.changed:
            self.samples.append(data)
            self.changed.notify_all()

    def wait_for(self, enough: Callable[[list[bytes]], bool]) -> list[bytes]:
        with self.changed:
            assert self.changed.wait_for(lambda: enough(self.samples), LIMIT_S), self.samples
            return list(self.samples)


class Partner:
    """Lives in a domain that exists already, or in one of its own with `config`."""

    def __init__(self, domain: int, config: str | None = None) -> None:
        self._domain = Domain(domain, config) if config is not None else None
        self._participant = DomainParticipant(domain)
        self._writers: dict[str, tuple[DataWriter[Any], Any]] = {}
        self._watched: list[Callable[[], None]] = []
        self._stop = GuardCondition(self._participant)
        self._waitset = WaitSet(self._participant)
        self._waitset.attach(self._stop)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def offer(self, topic: str, kind: str, offer: Offer, matched: Callable[[int], None] | None = None) -> None:
        """Open a publisher; `matched` hears how many read it."""
        writer = DataWriter(self._participant, Topic(self._participant, topic, KINDS[kind]), offer.qos())

        class Raw(KINDS[kind]):  # type: ignore[misc, valid-type]
            def __init__(self, data: bytes) -> None:
                self.data_of_test = data

            def serialize(self, *_: object, **__: object) -> bytes:
                return self.data_of_test

        self._writers[topic] = writer, Raw
        if matched is not None:
            matched(0)
            writer.set_status_mask(DDSStatus.PublicationMatched)
            self._watched.append(lambda: _tell_matched(writer, matched))
            self._waitset.attach(writer)

    def write(self, topic: str, *samples: bytes) -> None:
        writer, raw = self._writers[topic]
        for data in samples:
            writer.write(raw(data))

    def hear(self, topic: str, kind: str, offer: Offer, heard: Callable[[bytes], None] | None = None) -> Ear:
        """Open a subscriber."""
        ear = Ear()
        found: Topic[Any] = Topic(self._participant, topic, KINDS[kind])
        found.data_type = _Bytes
        reader = DataReader(self._participant, found, offer.qos())
        waiting = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
        self._watched.append(lambda: _tell_heard(waiting.reader, offer.depth, heard or ear.take))
        self._waitset.attach(waiting)
        return ear

    def endpoints(self) -> list[tuple[str, DcpsEndpoint]]:
        """What everybody in the domain publishes (`writer`) and subscribes (`reader`)."""
        found: list[tuple[str, DcpsEndpoint]] = []
        for what, builtin in (("writer", BuiltinTopicDcpsPublication), ("reader", BuiltinTopicDcpsSubscription)):
            found += [(what, endpoint) for endpoint in BuiltinDataReader(self._participant, builtin).take(N=100)]
        return found

    def close(self) -> None:
        self._stop.set(True)
        self._thread.join()
        del self._waitset
        self._watched.clear()
        self._writers.clear()
        del self._stop, self._participant
        self._domain = None

    def _run(self) -> None:
        while not self._stop.read():
            self._waitset.wait(duration(infinite=True))
            for look in list(self._watched):
                look()


def _tell_matched(writer: DataWriter[Any], matched: Callable[[int], None]) -> None:
    status = writer.get_publication_matched_status()
    if status.total_count_change or status.current_count_change:
        matched(int(status.current_count))


def _tell_heard(reader: DataReader[Any], most: int, heard: Callable[[bytes], None]) -> None:
    for sample in reader.take(N=most):
        if isinstance(sample, _Bytes):
            heard(sample.data)


class Process:
    """A partner in a process of its own."""

    def __init__(self, domain: int, config: str) -> None:
        command = (sys.executable, "-m", "tests.support.dds_partner", str(domain), config)
        self.process = subprocess.Popen(
            command, cwd=ROOT, text=True, bufsize=1, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._said: list[dict[str, Any]] = []
        self._changed = threading.Condition()
        self._listening = threading.Thread(target=self._listen, daemon=True)
        self._listening.start()

    def offer(self, topic: str, kind: str, offer: Offer, readers: int = 1) -> None:
        """Open a publisher and wait until so many read it."""
        self._ask(do="offer", topic=topic, kind=kind, offer=vars(offer))
        self.says(lambda said: said.get("read_by", -1) >= readers and said["topic"] == topic)

    def write(self, topic: str, *samples: bytes) -> None:
        self._ask(do="write", topic=topic, samples=[data.hex() for data in samples])

    def hear(self, topic: str, kind: str, offer: Offer) -> None:
        self._ask(do="hear", topic=topic, kind=kind, offer=vars(offer))
        self.says(lambda said: said.get("hearing") == topic)

    def has_written(self, topic: str, samples: int) -> None:
        """Wait until so many samples at once are out: whoever comes now comes after them."""
        self.says(lambda said: said.get("written") == samples and said["topic"] == topic)

    def heard(self, topic: str, data: bytes) -> None:
        """Wait until it heard this on a topic."""
        self.says(lambda said: said.get("heard") == topic and said["data"] == data.hex())

    def hears(self, topic: str, data: bytes, publish: Callable[[], None]) -> None:
        """Publish until it hears this: what is said once, just after two have found each other, may be lost."""
        wanted = {"heard": topic, "data": data.hex()}
        with self._changed:
            ends_at = time.monotonic() + LIMIT_S
            while wanted not in self._said:
                assert time.monotonic() < ends_at, self._said
                publish()
                self._changed.wait(0.02)

    def says(self, right: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        with self._changed:
            found = self._changed.wait_for(lambda: next((said for said in self._said if right(said)), None), LIMIT_S)
        assert found, self._said
        return found

    def end(self) -> None:
        """As a power cut: nobody is told."""
        self.process.kill()
        self.process.wait()
        self._listening.join()
        for pipe in filter(None, (self.process.stdin, self.process.stdout)):
            pipe.close()

    def _ask(self, **what: object) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(what) + "\n")

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if not line.endswith("\n"):
                return  # it was ended in the middle of a word
            with self._changed:
                self._said.append(json.loads(line))
                self._changed.notify_all()


@contextmanager
def process(domain: int, config: str) -> Iterator[Process]:
    partner = Process(domain, config)
    try:
        yield partner
    finally:
        partner.end()


def main(domain: int, config: str) -> None:
    partner = Partner(domain, config)
    lock = threading.Lock()

    def say(**what: object) -> None:
        with lock:
            sys.stdout.write(json.dumps(what) + "\n")
            sys.stdout.flush()

    def matched(topic: str, count: int) -> None:
        say(topic=topic, read_by=count)

    def heard(topic: str, data: bytes) -> None:
        say(heard=topic, data=data.hex())

    for line in sys.stdin:
        asked = json.loads(line)
        topic = asked["topic"]
        if asked["do"] == "offer":
            partner.offer(topic, asked["kind"], Offer(**asked["offer"]), partial(matched, topic))
        elif asked["do"] == "hear":
            partner.hear(topic, asked["kind"], Offer(**asked["offer"]), partial(heard, topic))
            say(hearing=topic)
        else:
            partner.write(topic, *map(bytes.fromhex, asked["samples"]))
            say(topic=topic, written=len(asked["samples"]))


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
