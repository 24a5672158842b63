"""The lift as a manager shows it, watched while something is done to it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from lift_manager.api.events import AlarmEvent, Frame
from lift_manager.api.lifts import Lift as LiftAnswer
from lift_manager.api.lifts import Signal
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import ClientError
from lift_manager.client.stream import EventStream
from lift_manager.commissioning.trace.exchanges import Exchange, Pairing
from lift_manager.commissioning.trace.recording import TracedFrame
from lift_manager.lift.state import Quality
from register_maps import frames
from register_maps.codec import Codec
from register_maps.errors import EXCEPTION_NAMES, BadRequest
from register_maps.words import Side


@dataclass(frozen=True, slots=True)
class Sample:
    """The lift at one moment."""

    at: float
    """Seconds of the loop."""
    signals: Mapping[str, Signal]
    lift: LiftAnswer

    def value(self, signal: str) -> str | bool | float | None:
        """Return the value of a signal; None without one."""
        found = self.signals.get(signal)
        return None if found is None else found.value

    @property
    def is_live(self) -> bool:
        """Whether the controller answers."""
        return self.lift.quality is Quality.LIVE

    def door_is_open(self, side: Side) -> bool:
        """Whether a door shows open."""
        return self.lift.doors.get(side) == "open"


Condition = Callable[[Sample], bool]


@dataclass(frozen=True, slots=True)
class Write:
    """One write on the wire."""

    at: float
    text: str
    pressed: tuple[str, ...]
    """The commands that are on after it, with the code of their floor."""
    beat: int | None = None
    """The heartbeat after it."""


@dataclass(frozen=True, slots=True)
class RefusedWrite:
    """One write that the controller answered with an exception."""

    at: float
    command: str
    """A command whose output it was for."""
    text: str


@dataclass
class Watch:
    """What was seen since the watch began."""

    samples: list[Sample] = field(default_factory=list)
    writes: list[Write] = field(default_factory=list)
    refused: list[RefusedWrite] = field(default_factory=list)
    alarms: list[str] = field(default_factory=list)
    _changed: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def newest(self) -> Sample:
        """The lift now."""
        return self.samples[-1]

    def add(self, sample: Sample) -> None:
        """Add what was just read."""
        self.samples.append(sample)
        self._changed.set()

    async def until(self, condition: Condition, within_s: float) -> bool:
        """Wait for a sample from now on that meets a condition; return whether there was one."""
        seen = len(self.samples) - 1
        try:
            async with asyncio.timeout(within_s):
                while True:
                    for sample in self.samples[max(seen, 0) :]:
                        if condition(sample):
                            return True
                    seen = len(self.samples)
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return False

    def changed(self, since: Sample) -> dict[str, list[object]]:
        """Return the values that signals took after a sample and that differ from it, by name, in order."""
        found: dict[str, list[object]] = {}
        for sample in self.samples:
            if sample.at <= since.at or not sample.is_live:
                continue
            for name in sample.signals:
                value = sample.value(name)
                if value != since.value(name) and value not in found.get(name, []):
                    found.setdefault(name, []).append(value)
        return found

    def pressed(self, since: float) -> set[str]:
        """Return every command that was on in a write since then."""
        return {name for write in self.writes if write.at >= since for name in write.pressed}


class WatchedLift:
    """One lift behind a manager."""

    def __init__(self, client: LiftManagerClient, name: str, codec: Codec, links: Iterable[str]) -> None:
        """`links` are the controllers that its outputs are on."""
        self.client = client
        self.name = name
        self._codec = codec
        self._links = tuple(links)

    async def look(self) -> Sample:
        """Return the lift now. Raises ClientError."""
        signals = await self.client.signals(self.name)
        lift = await self.client.lift(self.name)
        return Sample(_now(), {signal.name: signal for signal in signals.signals}, lift)

    @asynccontextmanager
    async def watched(self) -> AsyncIterator[Watch]:
        """Watch the lift within the context, as often as the manager reads it. Raises ClientError if it cannot be seen at all."""
        watch, poll_s = Watch(), (await self.client.capabilities(self.name)).poll_s
        watch.add(await self.look())
        tasks = [asyncio.create_task(self._sample(watch, poll_s)), asyncio.create_task(self._alarms(watch))]
        image = self._codec.empty_image()
        tasks += [asyncio.create_task(self._frames(watch, link, image)) for link in self._links]
        try:
            yield watch
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
        for task in tasks:
            if not task.cancelled():
                task.result()

    async def _sample(self, watch: Watch, every_s: float) -> None:
        while True:
            await asyncio.sleep(every_s)
            try:
                watch.add(await self.look())
            except ClientError as error:
                watch.alarms.append(str(error))

    async def _alarms(self, watch: Watch) -> None:
        async with self.client.events(lift=self.name) as events:
            async for event in events:
                if isinstance(event, AlarmEvent):
                    watch.alarms.append(event.text)

    async def _frames(self, watch: Watch, link: str, image: dict[str, list[int]]) -> None:
        stream: EventStream = self.client.frames(link)
        pairing = Pairing()
        async with stream as events:
            async for event in events:
                if not isinstance(event, Frame):
                    continue
                frame = bytes.fromhex(event.hex)
                if event.sent:
                    self._take(watch, frame, image)
                for exchange in pairing.take(TracedFrame(event.at_s, event.sent, frame)):
                    watch.refused += self._refused(exchange)

    def _refused(self, exchange: Exchange) -> Iterator[RefusedWrite]:
        request, code = exchange.parsed, exchange.exception
        if request is None or code is None or not request.is_write:
            return
        addresses = range(request.address, request.address + len(request.values))
        name = EXCEPTION_NAMES.get(code, "not in the specification")
        for command in self._codec.commands.values():
            if any(point.table is request.table and point.address in addresses for point in command.points):
                yield RefusedWrite(_now(), command.name, f"{request}: exception {code:02} ({name})")

    def _take(self, watch: Watch, frame: bytes, image: dict[str, list[int]]) -> None:
        try:
            request = frames.parse_request(frame, timed_coils=True)
        except BadRequest:
            return
        cells = image.get(str(request.table))
        if not request.is_write or cells is None or request.address + len(request.values) > len(cells):
            return
        if request.function == frames.MASK_WRITE:
            keep, put = request.values
            cells[request.address] = cells[request.address] & keep | put & ~keep & 0xFFFF
        else:
            cells[request.address : request.address + len(request.values)] = request.values
        on = {name: command.decode(image) for name, command in self._codec.commands.items()}
        pressed = tuple(
            f"{name} {code}" if self._codec.commands[name].is_call else name
            for name, code in on.items()
            if code is not None and not self._codec.commands[name].spec.is_heartbeat
        )
        beat = next((on[name] for name in on if self._codec.commands[name].spec.is_heartbeat), None)
        watch.writes.append(Write(_now(), str(request), pressed, beat))


def _now() -> float:
    return asyncio.get_running_loop().time()
