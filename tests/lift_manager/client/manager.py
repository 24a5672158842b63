"""A manager for the tests of the client: in memory, in the place of the network, on virtual time if need be."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from random import Random
from typing import Any
from urllib.parse import unquote

import httpx

from lift_manager.api.events import AnyEvent, RideEvent, Snapshot, StateEvent
from lift_manager.api.lifts import Lift, Lifts, Restricted
from lift_manager.api.problem import Problem
from lift_manager.api.rides import Ride
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import Quality
from lift_manager.rides.ride import Guidance, Phase
from register_maps.words import Door, Mode, Motion, Side

AT = datetime(2026, 3, 1, 20, 15, tzinfo=UTC)
LIFT = "lift"
URL = "http://lifts"

IDLE = Lift(
    name=LIFT,
    floors=("L1", "L2"),
    quality=Quality.LIVE,
    reason="",
    age_s=0.1,
    max_age_s=1.0,
    floor="L1",
    standing=True,
    destination="L1",
    robot_door=RobotDoor.CLOSED,
    doors={Side.FRONT: Door.CLOSED},
    motion=Motion.STOPPED,
    mode=Mode.NORMAL,
    permissions={},
    session=None,
    waiting=0,
    restrictions=Restricted(fire_latched=False, lockout="", maybe_occupied_by=None, waiting_for=""),
    not_visible={},
)
OPEN = IDLE.model_copy(update={"robot_door": RobotDoor.OPEN, "doors": {Side.FRONT: Door.OPEN}})
QUEUED = Ride.model_validate(
    {
        "id": "r1",
        "lift": LIFT,
        "any_lift": False,
        "from": "L1",
        "to": "L2",
        "door": None,
        "robot": "amr-7",
        "caller": "ride:amr-7",
        "phase": "queued",
        "guidance": "wait",
        "reason": "",
        "advice": None,
        "ahead": 1,
        "phase_ends_in_s": 600.0,
        "maybe_aboard": False,
        "begun_at": AT,
        "changed_at": AT,
    }
)

Handler = Callable[[httpx.Request], httpx.Response]


def said(status: int, body: Any = None, **headers: str) -> httpx.Response:
    text = body if isinstance(body, str) else json.dumps(body)
    return httpx.Response(status, content=text, headers={"content-type": "application/json", **headers})


def no(status: int, code: str, detail: str = "no", **more: Any) -> httpx.Response:
    problem = Problem.of(status, code, code, detail).model_copy(update=more)
    return said(status, problem.model_dump_json(exclude_none=True))


@dataclass
class Manager(httpx.AsyncBaseTransport):
    """Answers as a manager does: lifts, one ride, events with replay. All that can go wrong with it is a field."""

    lifts: dict[str, Lift] = field(default_factory=lambda: {LIFT: IDLE})
    ride: Ride | None = None
    up: bool = True
    """Otherwise connections are refused."""
    deaf: bool = False
    """Connections are made, and then nothing comes."""
    loses: int = 0
    """So many answers are lost on their way: what was asked is done."""
    late_s: float = 0.0
    """Answers are under way for so long after they were given."""
    boot: str = "a"
    cuts: Random | None = None
    """Streams end anywhere."""
    handlers: dict[tuple[str, str], Handler] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)
    bodies: list[Any] = field(default_factory=list)
    headers: list[httpx.Headers] = field(default_factory=list)
    events: list[AnyEvent] = field(default_factory=list)
    streams: list[asyncio.Queue[None]] = field(default_factory=list)
    beats: bool = True

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        if not self.up:
            raise httpx.ConnectError("All connection attempts failed")
        path = unquote(request.url.raw_path.decode().partition("?")[0])
        self.asked.append(f"{request.method} {path}")
        self.headers.append(request.headers)
        self.bodies.append(json.loads(request.content) if request.content else None)
        if self.deaf:
            await asyncio.Event().wait()
        answer = self._answer(request, path)
        if self.late_s:
            await asyncio.sleep(self.late_s)
        if self.loses and "events" not in path:
            self.loses -= 1
            raise httpx.ReadError("cut")
        return answer

    def tell(self, phase: Phase, guidance: Guidance, reason: str = "") -> None:
        """The ride changes, and everybody is told."""
        assert self.ride is not None
        self.ride = self.ride.model_copy(update={"phase": phase, "guidance": guidance, "reason": reason, "ahead": None})
        self.publish(RideEvent(ride=self.ride))

    def show(self, lift: Lift) -> None:
        self.lifts[lift.name] = lift
        self.publish(StateEvent(lift=lift))

    def publish(self, event: AnyEvent) -> None:
        self.events.append(event)
        for stream in self.streams:
            stream.put_nowait(None)

    def restart(self) -> None:
        """What was said before is forgotten; streams are cut by whoever reads them."""
        self.boot += "b"
        self.events.clear()
        self.cut()

    def cut(self) -> None:
        for stream in self.streams:
            stream.shut = True  # type: ignore[attr-defined]
            stream.put_nowait(None)
        self.streams.clear()

    def _answer(self, request: httpx.Request, path: str) -> httpx.Response:
        handler = self.handlers.get((request.method, path))
        if handler is not None:
            return handler(request)
        match request.method, path.removeprefix("/api/v1/").split("/"):
            case "GET", ["lifts"]:
                return said(200, Lifts(lifts=tuple(self.lifts.values())).model_dump_json())
            case "GET", ["lifts", name] if name in self.lifts:
                return said(200, self.lifts[name].model_dump_json())
            case "POST", ["rides"]:
                self.ride = self.ride or QUEUED
                return self._ride(201)
            case _, ["rides", "r1", *word] if self.ride is not None:
                return self._word(*word) if word else self._ride(200)
            case "GET", ["events"]:
                last = request.headers.get("last-event-id", "")
                headers = {"content-type": "text/event-stream; charset=utf-8"}
                return httpx.Response(200, headers=headers, stream=_Stream(self._events(last), self.cuts))
            case _:
                return no(404, "unknown_lift", f"nothing at {path}")

    @property
    def _rides(self) -> tuple[Ride, ...]:
        return () if self.ride is None else (self.ride,)

    def _ride(self, status: int) -> httpx.Response:
        assert self.ride is not None
        return said(status, self.ride.model_dump_json(by_alias=True))

    def _word(self, word: str) -> httpx.Response:
        assert self.ride is not None
        match word, self.ride.phase:
            case "entered", Phase.BOARDING:
                self.tell(Phase.RIDING, Guidance.STAY)
            case "left", Phase.ALIGHTING | Phase.BOARDING:
                self.tell(Phase.DONE, Guidance.DONE)
            case "cancel", _:
                self.tell(Phase.CANCELLED, Guidance.DONE, "cancelled")
            case "here", _:
                pass
            case _:
                return no(409, "not_now", f"the ride is {self.ride.phase}")
        return self._ride(200)

    async def _events(self, last_id: str) -> AsyncIterator[bytes]:
        news: asyncio.Queue[None] = asyncio.Queue()
        self.streams.append(news)
        boot, _, number = last_id.partition("-")
        if boot == self.boot:
            sent = int(number)
        else:
            sent = len(self.events)
            snapshot = Snapshot(lifts=tuple(self.lifts.values()), rides=self._rides, lost=bool(last_id))
            yield _sse(f"{self.boot}-{sent}", snapshot)
        while not getattr(news, "shut", False):
            while sent < len(self.events):
                sent += 1
                yield _sse(f"{self.boot}-{sent}", self.events[sent - 1])
            try:
                async with asyncio.timeout(1.0 if self.beats else None):
                    await news.get()
            except TimeoutError:
                yield b":\n\n"
        raise httpx.ReadError("cut")


class _Stream(httpx.AsyncByteStream):
    def __init__(self, chunks: AsyncIterator[bytes], cuts: Random | None) -> None:
        self._chunks = chunks
        self._left = None if cuts is None else cuts.randrange(1, 3000)

    async def __aiter__(self) -> AsyncIterator[bytes]:
        async for chunk in self._chunks:
            if self._left is None:
                yield chunk
                continue
            yield chunk[: self._left]
            self._left -= len(chunk)
            if self._left <= 0:
                raise httpx.ReadError("cut")


def _sse(event_id: str, event: AnyEvent) -> bytes:
    return f"id: {event_id}\nevent: {event.event}\ndata: {event.model_dump_json(by_alias=True)}\n\n".encode()
