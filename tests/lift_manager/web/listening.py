"""A manager to which things happen, and a client of few lines that hears of them; it shares no code with the manager's own."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any, NamedTuple

from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import Ride
from lift_manager.runtime.bus import StateChanged
from tests.lift_manager.web.fake import FakeSite, connected
from tests.support.programs import HANGS_S

EVENTS = "/api/v1/events"


class Happening(FakeSite):
    """Its lifts change, and it says so."""

    @property
    def has_ears(self) -> bool:
        """Whether anybody listens."""
        return self.bus.received

    def shift(self, lift: str = "lift", **changes: Any) -> None:
        """Let a lift change."""
        self.lifts[lift] = replace(self.lifts[lift], **changes)
        self.happens(StateChanged(lift, self.lifts[lift]))

    def rides_on(self, ride: Ride) -> None:
        """Let a ride begin or change."""
        self.fake_rides.going_on(ride)
        self.happens(RideChanged(ride.lift, ride))


class Message(NamedTuple):
    """One event as it came."""

    id: str
    """Empty where it has none."""
    event: str
    data: dict[str, Any]


def messages(body: bytes) -> list[Message]:
    """Return the whole events of a stream; what is cut off at its end is none."""
    found = []
    for block in body.split(b"\n\n")[:-1]:
        fields = dict(line.split(": ", 1) for line in block.decode().split("\n") if line and not line.startswith(":"))
        if "data" in fields:
            found.append(Message(fields.get("id", ""), fields["event"], json.loads(fields["data"])))
    return found


def unchunked(sent: bytes) -> bytes:
    """Return the body of an answer in chunks, as far as it has come."""
    parts, at = [], 0
    while (end := sent.find(b"\r\n", at)) >= 0:
        count = int(sent[at:end], 16)
        parts.append(sent[end + 2 : end + 2 + count])
        at = end + 2 + count + 2
    return b"".join(parts)


class Stream:
    """One open stream."""

    def __init__(self, reader: asyncio.StreamReader) -> None:
        self.reader = reader
        self.raw = b""
        self.head = b""

    def messages(self) -> list[Message]:
        """Return the whole events that have come."""
        return messages(unchunked(self.raw))

    async def begin(self) -> int:
        """Read the head; returns the status."""
        self.head = await self.reader.readuntil(b"\r\n\r\n")
        return int(self.head.split()[1])

    async def take(self, count: int) -> list[Message]:
        """Read until so many events have come."""
        async with asyncio.timeout(HANGS_S):
            while len(found := self.messages()) < count:
                sent = await self.reader.read(65536)
                assert sent, "the stream has ended"
                self.raw += sent
        return found

    async def rest(self) -> list[Message]:
        """Read to the end of the stream; the connection may stay."""
        async with asyncio.timeout(HANGS_S):
            while not self.raw.endswith(b"\r\n0\r\n\r\n"):
                sent = await self.reader.read(65536)
                assert sent, "the stream was broken off"
                self.raw += sent
        return self.messages()


async def until(true: Callable[[], bool]) -> None:
    """Let others go on until this is so."""
    async with asyncio.timeout(HANGS_S):
        while not true():  # noqa: ASYNC110  it is another party's state, and nobody sets an event for it
            await asyncio.sleep(0)


@asynccontextmanager
async def listening(port: int, path: str = EVENTS, headers: Mapping[str, str] | None = None) -> AsyncIterator[Stream]:
    """Ask for a stream, and hang up at the end of the context."""
    async with connected(port) as (reader, writer):
        lines = [
            f"GET {path} HTTP/1.1",
            f"Host: 127.0.0.1:{port}",
            *(f"{name}: {said}" for name, said in (headers or {}).items()),
        ]
        writer.write("\r\n".join([*lines, "", ""]).encode())
        yield Stream(reader)
