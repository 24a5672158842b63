"""Streams the Modbus frames of a link, for tools. A link is tapped only while it has readers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from lift_manager.api.events import Frame, Lost
from lift_manager.runtime.links import FrameSource, WireFrame
from lift_manager.web.events import sse
from lift_manager.web.events.readers import Entry, OpenStreams, Reader
from register_maps import frames


class _FrameEntry:
    """One frame, encoded once."""

    __slots__ = ("_frame", "_wire")

    def __init__(self, frame: WireFrame) -> None:
        self._frame = frame
        self._wire = b""

    def wire(self, now: float) -> bytes:
        """Return the encoded frame."""
        if not self._wire:
            self._wire = sse.event("frame", encode_frame(self._frame))
        return self._wire


class _WatchedLink:
    """The readers of one link."""

    def __init__(self) -> None:
        self.readers: dict[Reader, None] = {}
        self.tap = ExitStack()

    def put_frame(self, frame: WireFrame) -> None:
        entry = _FrameEntry(frame)
        for reader in self.readers:
            reader.put(entry)


class FrameFeed:
    """The frame streams of an application. Frames are not kept for readers that reconnect."""

    def __init__(self, source: FrameSource, open_streams: OpenStreams) -> None:
        self._source = source
        self._open_streams = open_streams
        self._links: dict[str, _WatchedLink] = {}

    @contextmanager
    def reader(self, link: str, admits: Callable[[], bool]) -> Iterator[Reader]:
        """Serve a reader of a link for as long as the context lasts."""
        reader = Reader(sse.retry(self._open_streams.retry_ms), (), _lost_event)
        watched_link = self._links.get(link)
        if watched_link is None:
            watched_link = self._links[link] = _WatchedLink()
            watched_link.tap.enter_context(self._source.tap_frames(link, watched_link.put_frame))
        watched_link.readers[reader] = None
        try:
            with self._open_streams.register(reader, admits):
                yield reader
        finally:
            del watched_link.readers[reader]
            if not watched_link.readers:
                del self._links[link]
                watched_link.tap.close()


def encode_frame(frame: WireFrame) -> Frame:
    """Convert a frame for the stream."""
    text = frames.describe(frame.frame) if frame.sent else frames.describe_answer(frame.frame)
    return Frame(link=frame.link, sent=frame.sent, hex=frame.frame.hex(" "), text=text, at_s=frame.at)


def _lost_event(count: int, _since: float) -> tuple[bytes, tuple[Entry, ...]]:
    return sse.event("lost", Lost(events=count)), ()
