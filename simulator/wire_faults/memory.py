"""Faults on a wire in memory: put between the wire and the device that answers on it. Pure."""

from __future__ import annotations

from collections.abc import Callable

from simulator.wire_faults.bases import Reply
from simulator.wire_faults.engine import Answer, Connection, ConnectOutcome, WireFaults


class FaultyAnswer:
    """A device behind a faulty wire: itself an `Answer`, which also admits connections."""

    def __init__(self, answer: Answer, engine: WireFaults, clock: Callable[[], float]) -> None:
        self._answer = answer
        self._engine = engine
        self._clock = clock
        self._connection: Connection | None = None

    def __call__(self, frame: bytes) -> list[Reply]:
        """Return the replies to one request. Connects first if not connected."""
        now = self._clock()
        if self._connection is None:
            self._connection = self._engine.connection(now)
        return self._connection.request(frame, now, self._answer)

    def admit(self) -> ConnectOutcome:
        """An attempt to connect; the connection before it is gone."""
        self.close()
        self._connection = self._engine.connection(self._clock())
        return self._connection.admission

    def close(self) -> None:
        """The client has gone, or the connection was reset: its place is free. May be repeated."""
        if self._connection is not None:
            self._connection.close(self._clock())
            self._connection = None


def faulty(answer: Answer, engine: WireFaults, clock: Callable[[], float]) -> FaultyAnswer:
    """Put the faults of `engine` in front of a device; one for each wire, for it stands for one connection at a time."""
    return FaultyAnswer(answer, engine, clock)
