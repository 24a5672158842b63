"""A manager for the tests of the web face, and ways to ask the application something."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from typing import Any, cast

import httpx
from fastapi import FastAPI
from starlette.types import ASGIApp

from lift_manager.core.facade import Facade
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused
from lift_manager.domain.events import Event, Occurrence
from lift_manager.domain.keys import Keys
from lift_manager.domain.rmf import RmfRules
from lift_manager.domain.service import (
    Acknowledged,
    Cause,
    Drain,
    DrainEnded,
    ForceReleased,
    Lockout,
    LockoutEnded,
    Remembered,
)
from lift_manager.domain.state import Holder, LiftState
from lift_manager.runtime.refusals import TurnedAway
from lift_manager.web.app import make_app
from lift_manager.web.connections import ConnectionLimits
from lift_manager.web.limits import HANDSHAKE_WITHIN_S
from lift_manager.web.server import listen, serve
from lift_manager.web.tls import ServerCertificates
from tests.lift_manager.web.fake_rides import FakeRides
from tests.lift_manager.web.fake_sessions import FakeSessions

BASE = "/open-rmf/demo-lift"
STATE = f"{BASE}/lift_state"
REQUEST = f"{BASE}/lift_request?lift_name=lift"
ACCEPTED = b'{"data":{},"success":true,"msg":""}'
AT = datetime(2026, 3, 1, 20, 15, tzinfo=UTC)
CALL = b'{"floor":"L2","door_state":0}'


async def _at_once(_lift: str, _within_s: float) -> bool:
    return True


@dataclass
class FakeManager(FakeSessions, FakeRides):
    """Says what it was told to say, and remembers what it was asked."""

    answer: Accepted | Refused = field(default_factory=Accepted)
    asked: list[Ask] = field(default_factory=list)
    ended: list[tuple[str, Holder, float]] = field(default_factory=list)
    unwritten: frozenset[str] = frozenset()
    refused: Refused | None = None
    """What people are told."""
    said: list[tuple[str, ...]] = field(default_factory=list)
    """What people said."""
    away: list[TurnedAway] = field(default_factory=list)
    """Whom the face refused by itself."""
    written: Callable[[str, float], Awaitable[bool]] = _at_once
    """How long a lift's words take to the disk."""
    boot: str = "b0"
    newest: int = 0
    stopping: bool = False
    rmf: RmfRules = field(default_factory=RmfRules)
    _ears: list[Callable[[Occurrence], None]] = field(default_factory=list)

    @property
    def changes(self) -> list[object]:
        """Everything that was asked to change something, by any face."""
        return [*self.asked, *self.ended, *self.said, *self.done, *self.wishes, *self.said_of_rides]

    def request(self, ask: Ask) -> Accepted | Refused:
        self.asked.append(ask)
        return self.answer

    def end_session(self, lift: str, holder: Holder, grace_s: float) -> Accepted | Refused:
        self.ended.append((lift, holder, grace_s))
        return self._unknown(lift) or self.answer

    def turned_away(self, who: TurnedAway) -> None:
        self.away.append(who)

    def acknowledge(self, lift: str, by: str) -> Acknowledged | Refused:
        self.said.append(("acknowledge", lift, by))
        return self._unknown(lift) or self.refused or Acknowledged(by, AT, (Cause.FIRE, Cause.OCCUPIED))

    def lock_out(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> Lockout | Refused:
        self.said.append(("lock_out", lift, by, reason, *(["now"] if at_once else [])))
        return self._unknown(lift) or self.refused or Lockout(by, reason, AT)

    def end_lockout(self, lift: str, by: str) -> LockoutEnded | Refused:
        self.said.append(("end_lockout", lift, by))
        return self._unknown(lift) or self.refused or LockoutEnded(by, AT, Lockout("A. Beck", "new ropes", AT))

    def begin_drain(self, lift: str, by: str, reason: str) -> Drain | Refused:
        self.said.append(("begin_drain", lift, by, reason))
        return self._unknown(lift) or self.refused or Drain(by, reason, AT)

    def end_drain(self, lift: str, by: str) -> DrainEnded | Refused:
        self.said.append(("end_drain", lift, by))
        return self._unknown(lift) or self.refused or DrainEnded(by, AT, Drain("A. Beck", "new ropes", AT))

    def force_release(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> ForceReleased | Refused:
        self.said.append(("force_release", lift, by, reason, *(["now"] if at_once else [])))
        released = ForceReleased(by, AT, reason, Holder("workshop", "robot-1"), maybe_aboard=True)
        return self._unknown(lift) or self.refused or released

    def hand_over(self, lift: str, holder: Holder, to: Holder) -> Accepted | Refused:
        return self._unknown(lift) or self.answer

    def remembered(self, lift: str) -> Remembered | None:
        return Remembered() if lift in self.lifts else None

    async def kept(self, lift: str, within_s: float) -> bool:
        return await self.written(lift, within_s)

    def freshen(self, lift: str | None = None) -> None:
        """Every state is as it was said to be."""

    @contextmanager
    def tap(self, hear: Callable[[Occurrence], None]) -> Iterator[None]:
        self._ears.append(hear)
        yield
        self._ears.remove(hear)

    def happens(self, event: Event) -> None:
        """Let everybody who listens hear of it."""
        self.newest += 1
        for hear in self._ears:
            hear(Occurrence(f"{self.boot}-{self.newest}", 0.0, event))

    def _unknown(self, lift: str) -> Refused | None:
        return None if lift in self.lifts else Refused(Refusal.UNKNOWN_LIFT, f"no lift {lift!r}; the lifts are lift")


def one_lift(state: LiftState) -> FakeManager:
    return FakeManager({state.lift: state})


NAME = "lifts"
"""By which `ask` addresses the manager."""


def _make(facade: Facade, keys: Keys | None) -> FastAPI:
    return make_app(facade, keys, host_names=(NAME,))


def ask(facade: Facade, method: str, url: str, *, keys: Keys | None = None, **more: Any) -> httpx.Response:
    return ask_app(app_of(facade, keys, _make, _made), method, url, host=NAME, **more)


class StandIn:
    """Passes everything on to one manager after the other: an application takes long to make, and serves them all."""

    def __init__(self, first: Facade) -> None:
        self.stands_for = first

    def __getattr__(self, name: str) -> Any:
        if callable(getattr(self.stands_for, name)):
            # what an application keeps of one manager must reach the next
            return partial(self._pass_on, name)
        return getattr(self.stands_for, name)

    def _pass_on(self, name: str, *given: Any, **named: Any) -> Any:
        return getattr(self.stands_for, name)(*given, **named)


Made = dict[tuple[int, tuple[str, ...]], tuple[StandIn, Keys | None, FastAPI]]
_made: Made = {}


def app_of(facade: Facade, keys: Keys | None, make: Callable[[Facade, Keys | None], FastAPI], made: Made) -> FastAPI:
    """An application for these two: one that was made for the same keys and the same names of lifts, if there is one in `made`."""
    of = (id(keys), facade.lift_names())
    if of not in made:
        while len(made) > 7:
            del made[next(iter(made))]
        stand_in = StandIn(facade)
        made[of] = stand_in, keys, make(cast("Facade", stand_in), keys)
    stand_in, _, app = made[of]
    stand_in.stands_for = facade
    return app


def ask_app(app: FastAPI, method: str, url: str, *, host: str = "127.0.0.1", **more: Any) -> httpx.Response:
    async def once() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=f"http://{host}") as client:
            return await client.request(method, url, **more)

    return asyncio.run(once())


@asynccontextmanager
async def serving(
    app: ASGIApp,
    tls: ServerCertificates | None = None,
    *,
    handshake_s: float = HANDSHAKE_WITHIN_S,
    connections: int | None = None,
) -> AsyncIterator[int]:
    """The application on a free port of 127.0.0.1, with at most so many `connections`."""
    sock = listen("127.0.0.1", 0)
    port: int = sock.getsockname()[1]
    limits = None if connections is None else ConnectionLimits.of(connections)
    task = asyncio.create_task(serve(app, sock, tls=tls, handshake_s=handshake_s, limits=limits))
    try:
        yield port
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


@asynccontextmanager
async def connected(port: int) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        yield reader, writer
    finally:
        writer.close()
        with suppress(ConnectionError):
            await writer.wait_closed()
