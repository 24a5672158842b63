"""Records the frames of a link, from the stream of a manager, as they come."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from lift_manager.api.events import Frame, Lost
from lift_manager.client.stream import Connected, Disconnected, StreamEvent
from lift_manager.commissioning.trace.exchanges import Exchange, Pairing
from lift_manager.commissioning.trace.recording import Gap, Header, Item, TracedFrame
from register_maps import frames
from register_maps.errors import ExceptionAnswer

Sink = Callable[[Item], None]
"""Receives every item, in order."""


@dataclass(slots=True)
class Counts:
    """What a recording holds so far."""

    frames: int = 0
    answers: int = 0
    writes: int = 0
    exceptions: int = 0
    troubles: int = 0
    """Requests without an answer, and answers that do not fit."""
    gaps: int = 0

    def add(self, exchanges: Iterable[Exchange]) -> None:
        """Count exchanges."""
        for exchange in exchanges:
            self.answers += exchange.answer is not None
            self.writes += exchange.is_write
            self.exceptions += exchange.exception is not None
            self.troubles += bool(exchange.trouble)


class Recorder:
    """Turns the events of a frame stream into the items of a recording.

    Times are those of the manager's monotonic clock, counted from the first frame after each gap: how late an event arrives here
    changes nothing.
    """

    def __init__(
        self,
        header: Header,
        sink: Sink,
        *,
        began_at_s: float | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """`now` is the clock of the header; `began_at_s` is its beginning on the manager's clock, where that is known."""
        self.counts = Counts()
        self.is_connected = False
        """Whether the manager sends frames at the moment."""
        self._began = header.began
        self._sink = sink
        self._now = now
        self._pairing = Pairing()
        self._moment: tuple[float, float] | None = None if began_at_s is None else (began_at_s, 0.0)
        """A time of the manager, and the same in this recording."""
        self._last_s = 0.0

    async def record(self, stream: AsyncIterator[StreamEvent]) -> None:
        """Record until the stream is closed or this is cancelled."""
        async for event in stream:
            self.take(event)

    def take(self, event: StreamEvent) -> None:
        """Take the next event."""
        match event:
            case Connected():
                self.is_connected = True
            case Disconnected():
                if self.is_connected:
                    self._gap(f"the connection to the manager broke: {event.reason}")
                self.is_connected = False
            case Lost():
                self._gap(f"{event.events} frames are lost: this program was too slow")
            case Frame():
                self._frame(event)
            case _:
                pass  # the stream of a link has no other events

    @property
    def lasted_s(self) -> float:
        """The time of the last frame or gap."""
        return self._last_s

    @property
    def elapsed_s(self) -> float:
        """Since the recording began."""
        return (self._now() - self._began) / timedelta(seconds=1)

    def end(self) -> None:
        """Count the requests that have no answer."""
        self.counts.add(self._pairing.end())

    def _frame(self, event: Frame) -> None:
        if self._moment is None:
            self._moment = event.at_s, max(self._last_s, self.elapsed_s)
        began_s, here_s = self._moment
        self._last_s = max(self._last_s, round(here_s + event.at_s - began_s, 6))
        frame = TracedFrame(self._last_s, event.sent, bytes.fromhex(event.hex), event.text)
        completed = self._pairing.take(frame)
        self.counts.add(completed)
        self.counts.frames += 1
        answered = next((one for one in completed if one.answer is frame), None)
        self._sink(frame if answered is None else replace(frame, text=answer_text(answered)))

    def _gap(self, reason: str) -> None:
        self.end()
        self._moment = None
        self._last_s = max(self._last_s, round(self.elapsed_s, 6))
        self.counts.gaps += 1
        self._sink(Gap(self._last_s, reason))


def answer_text(exchange: Exchange) -> str:
    """Describe an answer on one line. Its request says where the values are from."""
    answer, request = exchange.answer, exchange.parsed
    if answer is None:
        return exchange.trouble
    if exchange.exception is not None:
        function = answer.frame[7] & 0x7F
        return f"exception {exchange.exception:02X} ({ExceptionAnswer(function, exchange.exception).name})"
    if exchange.trouble or request is None:
        return exchange.trouble or frames.describe_answer(answer.frame)
    if exchange.values is not None:
        return f"{request.table} from {request.address}: {' '.join(map(str, exchange.values))}"
    return "written"
