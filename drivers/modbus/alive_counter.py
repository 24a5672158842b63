"""Detects a controller whose program has stopped, by the alive counter of its map."""

from __future__ import annotations

import math
from collections.abc import Mapping

from drivers.errors import HeartbeatAwaited, HeartbeatStopped
from register_maps.codec import Codec

SIGNAL = "alive"
BIT_IN_STEP = "; a bit that changes in step with the polls always reads the same; it must stay for more than two polls"


class AliveCounter:
    """Watches the alive counter of one lift.

    Readings over a new connection count only once the counter has changed on it: a restarted controller whose program is frozen
    or stopped serves a counter that differs from the one read last.
    """

    # every poll touches it: see benchmarks/README.md
    __slots__ = ("_endpoint", "_epoch", "_hint", "_name", "_since", "_within_s", "live_until")

    def __init__(self, codec: Codec, name: str) -> None:
        """`name` begins every message. Without a counter in the map the program always counts as running."""
        self._name = name
        spec = codec.map.signals.get(SIGNAL)
        self._within_s = math.inf if spec is None else spec.must_change_within_s or math.inf
        points = codec.signals[SIGNAL].points if spec is not None else ()
        self._endpoint = points[0].endpoint if points else None
        self._hint = BIT_IN_STEP if [point.mask for point in points] == [1] else ""
        self._epoch: int | None = None
        self._since = 0.0
        """When the counter last changed or was first read on this connection."""
        self.live_until = math.inf if spec is None else -math.inf
        """Until when the last change shows that the program runs."""

    @property
    def is_awaited(self) -> bool:
        """Whether the counter has not changed yet on a connection that was read."""
        return self._epoch is not None and self.live_until == -math.inf

    def connected(self, epochs: Mapping[str, int], at: float) -> None:
        """Take a poll requested at `at` that came over a new connection to some device; `epochs` by endpoint."""
        if self._endpoint is not None and epochs[self._endpoint] != self._epoch:
            self._epoch, self._since, self.live_until = epochs[self._endpoint], at, -math.inf

    def beat(self, at: float) -> None:
        """Record that the counter has changed by the poll requested at `at`."""
        self._since, self.live_until = at, at + self._within_s

    def error(self, at: float) -> HeartbeatStopped:
        """Return the error of a poll requested at `at`, after `live_until`."""
        still_s = at - self._since
        waits = self.live_until == -math.inf and still_s <= self._within_s
        return (HeartbeatAwaited if waits else HeartbeatStopped)(self._name, still_s, self._within_s, self._hint)
