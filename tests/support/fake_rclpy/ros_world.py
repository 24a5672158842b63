"""What the nodes of one process share: the network with other programs on it, clocks, parameters and the log."""

from __future__ import annotations

import copy
import itertools
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

DISTROS = ("humble", "iron", "jazzy", "kilted", "rolling")


@dataclass(frozen=True)
class Offer:
    """Quality of service, as far as it decides who meets whom and what is kept."""

    depth: int
    reliable: bool
    transient_local: bool
    lifespan_s: float | None = None
    """None for ever. It decides no match."""

    def serves(self, wish: Offer) -> bool:
        return (self.reliable or not wish.reliable) and (self.transient_local or not wish.transient_local)


@dataclass(eq=False)
class Reader:
    kind: type[Any]
    offer: Offer
    node: str
    on_matched: Callable[[int, int, int, int], None] | None = None
    got: deque[Any] = field(default_factory=deque)
    ever_matched: int = 0
    news: int = 0
    current: int = 0
    current_news: int = 0

    def take(self, message: Any) -> None:
        if len(self.got) == self.offer.depth:
            self.got.popleft()
        self.got.append(message)

    def match(self, change: int) -> None:
        self.current += change
        self.current_news += change
        if change > 0:
            self.ever_matched += change
            self.news += change


@dataclass(eq=False)
class Writer:
    world: World
    topic: str
    kind: type[Any]
    offer: Offer
    node: str
    namespace: str
    gid: list[int]
    kept: deque[Any] = field(default_factory=deque)

    def publish(self, message: Any) -> None:
        if type(message) is not self.kind:
            raise TypeError(f"Expected {self.kind}, got {type(message)}")
        for reader in self.readers():
            reader.take(copy.deepcopy(message))
        if len(self.kept) == self.offer.depth:
            self.kept.popleft()
        self.kept.append(copy.deepcopy(message))
        self.world.published(self.topic, message)

    def readers(self) -> list[Reader]:
        found = self.world.topics.get(self.topic, Topic()).readers
        return [reader for reader in found if self.meets(reader)]

    def meets(self, reader: Reader) -> bool:
        return reader.kind is self.kind and self.offer.serves(reader.offer)


@dataclass
class Topic:
    writers: list[Writer] = field(default_factory=list)
    readers: list[Reader] = field(default_factory=list)


class World:
    def __init__(self) -> None:
        self.begin(os.environ.get("FAKE_ROS_DISTRO", DISTROS[-1]))

    def begin(self, distro: str) -> None:
        """Begin anew, with nobody there."""
        self.distro = distro
        self.real_time = "FAKE_ROS_REAL_TIME" in os.environ
        self.prints = "FAKE_ROS_PRINTS" in os.environ
        self.supports_matched = True
        self.on_published: Callable[[str, Any], None] = _nobody_looks
        self.topics: dict[str, Topic] = {}
        self.parameters: dict[str, object] = {}
        self.namespace = "/"
        self.domain = 0
        self.remaps: dict[str, str] = {}
        self.steady_ns = 5_000_000_000
        self.system_ns = 1_700_000_000_000_000_000
        self.sim_ns = 0
        self.log: list[tuple[str, str]] = []
        self.context_is_up = False
        self.signal_handlers = "none yet"
        self.thread = threading.get_ident()
        self.wakes = threading.Condition()
        self.looks = 0
        """How often somebody asked who publishes on a topic, which costs rclpy a query of the graph."""
        self._next_gid = 0

    def has(self, distro: str) -> bool:
        return DISTROS.index(self.distro) >= DISTROS.index(distro)

    def monotonic(self) -> float:
        """`time.monotonic` of this world: not the clock that is ROS's steady one."""
        return time.monotonic() if self.real_time else self.steady_ns * 1e-9 + 100.0

    def steady(self) -> int:
        return time.monotonic_ns() if self.real_time else self.steady_ns

    def pass_time(self, ns: int) -> None:
        """Wait so long, or until somebody calls `wake`."""
        if not self.real_time:
            self.steady_ns += ns
            self.system_ns += ns
            return
        with self.wakes:
            self.wakes.wait(ns * 1e-9)

    def wake(self) -> None:
        with self.wakes:
            self.wakes.notify_all()

    def writer(self, topic: str, kind: type[Any], offer: Offer, node: str = "other", namespace: str = "/") -> Writer:
        self._next_gid += 1
        gid = [*self._next_gid.to_bytes(16, "big")]
        writer = Writer(self, topic, kind, offer, node, namespace, gid)
        place = self.topics.setdefault(topic, Topic())
        place.writers.append(writer)
        for reader in place.readers:
            if writer.meets(reader):
                reader.match(1)
        return writer

    def reader(self, topic: str, kind: type[Any], offer: Offer, node: str = "other") -> Reader:
        reader = Reader(kind, offer, node)
        place = self.topics.setdefault(topic, Topic())
        place.readers.append(reader)
        for writer in place.writers:
            if not writer.meets(reader):
                continue
            reader.match(1)
            if reader.offer.transient_local:
                for message in writer.kept:
                    reader.take(copy.deepcopy(message))
        return reader

    def remove_writer(self, writer: Writer) -> None:
        place = self.topics[writer.topic]
        place.writers.remove(writer)
        for reader in place.readers:
            if writer.meets(reader):
                reader.match(-1)

    def remove_reader(self, topic: str, reader: Reader) -> None:
        self.topics[topic].readers.remove(reader)

    def take_arguments(self, args: Sequence[str]) -> None:
        """Take `-p name:=value` after `--ros-args`, with the type that YAML gives a value."""
        said = list(args[args.index("--ros-args") :]) if "--ros-args" in args else []
        for flag, text in itertools.pairwise(said):
            if flag == "-p":
                name, _, value = text.partition(":=")
                words: dict[str, object] = {"true": True, "false": False}
                self.parameters[name] = int(value) if value.isdecimal() else words.get(value, value)

    def published(self, topic: str, message: Any) -> None:
        self.on_published(topic, message)
        if self.prints:
            sys.stdout.write(f"{topic} {message}\n")
            sys.stdout.flush()

    def logged(self, level: str, text: str) -> None:
        self.log.append((level, text))
        if self.prints:
            sys.stderr.write(f"[{level}] {text}\n")

    def whole(self, name: str) -> str:
        """Make a name whole as rcl does: the namespace before a relative one, then the remapping."""
        full = name if name.startswith("/") else f"{self.namespace.rstrip('/')}/{name}"
        return self.remaps.get(full, full)


def _nobody_looks(topic: str, message: Any) -> None:
    pass


world = World()
