"""Puts requests and their answers together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from lift_manager.commissioning.trace.recording import Gap, Item, TracedFrame
from register_maps import frames
from register_maps.errors import BadRequest, ExceptionAnswer, FrameError, Mismatch
from register_maps.frames import Request


@dataclass(frozen=True, slots=True)
class Exchange:
    """A request with its answer; or one of them without the other."""

    request: TracedFrame | None
    """None: an answer to no request of the recording."""
    answer: TracedFrame | None
    """None: no answer came."""
    parsed: Request | None = None
    """The request as a device reads it; None if it is none that the specification allows."""
    values: tuple[int, ...] | None = None
    """What a read returned: bits as 0 or 1, registers as 0 to 65535."""
    exception: int | None = None
    """The exception code in the answer."""
    trouble: str = ""
    """What is wrong with the answer, apart from an exception."""

    @property
    def at_s(self) -> float:
        """When it began."""
        first = self.request or self.answer
        return 0.0 if first is None else first.at_s

    @property
    def took_s(self) -> float | None:
        """From request to answer; None if one of them is missing."""
        return None if self.request is None or self.answer is None else self.answer.at_s - self.request.at_s

    @property
    def is_error(self) -> bool:
        """Whether it went wrong."""
        return self.exception is not None or bool(self.trouble)

    @property
    def is_write(self) -> bool:
        """Whether it is a write."""
        return self.parsed is not None and self.parsed.is_write


class Pairing:
    """Requests that wait for their answers."""

    def __init__(self) -> None:
        self._waiting: list[tuple[TracedFrame, Request | None]] = []
        self._has_begun = False

    def take(self, frame: TracedFrame) -> list[Exchange]:
        """Take the next frame; return the exchanges that it completes, or proves to be without an answer.

        The answer to a request from before the recording completes none.
        """
        if frame.is_request:
            self._has_begun = True
            tid = frames.tid_of(frame.frame)
            over = [entry for entry in self._waiting if frames.tid_of(entry[0].frame) == tid]
            self._waiting = [entry for entry in self._waiting if entry not in over]
            self._waiting.append((frame, _parsed(frame.frame)))
            return [_unanswered(*entry) for entry in over]
        found = self._request_of(frame)
        if found is None:
            return [Exchange(None, frame, trouble="an answer to no request")] if self._has_begun else []
        self._waiting.remove(found)
        return [_exchange(*found, frame)]

    def end(self) -> list[Exchange]:
        """Return the exchanges that have no answer, and begin again."""
        over, self._waiting, self._has_begun = self._waiting, [], False
        return [_unanswered(*entry) for entry in over]

    def _request_of(self, answer: TracedFrame) -> tuple[TracedFrame, Request | None] | None:
        tid = frames.tid_of(answer.frame)
        same_tid = (entry for entry in self._waiting if frames.tid_of(entry[0].frame) == tid)
        # some controllers return no transaction ids
        fitting = (entry for entry in self._waiting if entry[1] is not None and _fits(entry[1], answer.frame))
        return next(same_tid, None) or next(fitting, None)


def exchanges(items: Iterable[Item]) -> list[Exchange | Gap]:
    """Return exchanges and gaps in the order in which they began."""
    found: list[Exchange | Gap] = []
    pairing = Pairing()
    for item in items:
        if isinstance(item, Gap):
            found += [*pairing.end(), item]
        else:
            found += pairing.take(item)
    found += pairing.end()
    return sorted(found, key=lambda one: one.at_s)


def _unanswered(request: TracedFrame, parsed: Request | None) -> Exchange:
    return Exchange(request, None, parsed, trouble="no answer")


def _exchange(request: TracedFrame, parsed: Request | None, answer: TracedFrame) -> Exchange:
    if parsed is None:
        code = _exception_code(answer.frame)
        return Exchange(request, answer, exception=code)
    try:
        payload = frames.check(parsed, answer.frame)
    except ExceptionAnswer as error:
        return Exchange(request, answer, parsed, exception=error.code)
    except Mismatch as error:
        trouble = f"the answer does not fit: expected {error.expected}, received {error.received}"
        return Exchange(request, answer, parsed, trouble=trouble)
    return Exchange(request, answer, parsed, None if parsed.is_write else frames.values_of(parsed, payload))


def _fits(request: Request, answer: bytes) -> bool:
    try:
        frames.check(request, answer)
    except ExceptionAnswer:
        return True
    except Mismatch:
        return False
    return True


def _parsed(frame: bytes) -> Request | None:
    try:
        return frames.parse_request(frame, timed_coils=True)
    except (BadRequest, FrameError):
        return None


def _exception_code(frame: bytes) -> int | None:
    return frame[8] if len(frame) == 9 and frame[7] & 0x80 else None
