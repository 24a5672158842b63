"""Frames on the wire of a link, for tools: only while somebody looks is anything listened to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from lift_manager.api.events import Frame, Lost
from lift_manager.runtime.links import FrameSource, WireFrame
from lift_manager.web.events import sse
from lift_manager.web.events.readers import Entry, OpenStreams, Reader
from register_maps import frames


class _Passed:
    """One frame; its bytes are made once."""

    __slots__ = ("_frame", "_wire")

    def __init__(self, frame: WireFrame) -> None:
        self._frame = frame
        self._wire = b""

    def wire(self, now: float) -> bytes:
        """Return its bytes."""
        if not self._wire:
            self._wire = sse.event("frame", told(self._frame))
        return self._wire


class _Link:
    """Who looks at one link."""

    def __init__(self) -> None:
        self.readers: dict[Reader, None] = {}
        self.tap = ExitStack()

    def hear(self, frame: WireFrame) -> None:
        passed = _Passed(frame)
        for reader in self.readers:
            reader.put(passed)


class FrameFeed:
    """One for an application. Frames are not kept: a reader that comes back hears what passes from then on."""

    def __init__(self, source: FrameSource, places: OpenStreams) -> None:
        self._source = source
        self._places = places
        self._links: dict[str, _Link] = {}

    @contextmanager
    def reader(self, link: str, admits: Callable[[], bool]) -> Iterator[Reader]:
        """Serve a reader of a link for as long as the context lasts."""
        reader = Reader(sse.retry(self._places.retry_ms), (), _lost)
        watched = self._links.get(link)
        if watched is None:
            watched = self._links[link] = _Link()
            watched.tap.enter_context(self._source.tap_frames(link, watched.hear))
        watched.readers[reader] = None
        try:
            with self._places.taken(reader, admits):
                yield reader
        finally:
            del watched.readers[reader]
            if not watched.readers:
                del self._links[link]
                watched.tap.close()


def told(frame: WireFrame) -> Frame:
    """Return a frame as the stream has it."""
    text = frames.describe(frame.frame) if frame.sent else frames.describe_answer(frame.frame)
    return Frame(link=frame.link, sent=frame.sent, hex=frame.frame.hex(" "), text=text, at_s=frame.at)


def _lost(count: int, _since: float) -> tuple[bytes, tuple[Entry, ...]]:
    return sse.event("lost", Lost(events=count)), ()
