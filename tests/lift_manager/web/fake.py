"""A site for the tests of the web face, and ways to request something of the application."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import httpx
from fastapi import FastAPI
from starlette.types import ASGIApp

from drivers.model import Capabilities, CommandInfo, PlannedWrite, Proof, SignalValue
from lift_manager.api.keys import Keys
from lift_manager.lift.commands import CommandRequest, CommandState, CommandStatus, SessionInfo, SessionOver
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import (
    Acknowledged,
    Cause,
    ForceReleased,
    Restriction,
    RestrictionEnded,
    RestrictionKind,
)
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Accepted, Refusal, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.rmf_view import RmfRules
from lift_manager.lift.session import EndReason, Holder
from lift_manager.lift.state import LiftSignals, LiftState
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.errors import raised
from lift_manager.runtime.recorder import MemoryRecorder, Recorder
from lift_manager.runtime.refusals import FaceRefusal
from lift_manager.runtime.site import Site
from lift_manager.web.app import make_app
from lift_manager.web.connections import ConnectionLimits
from lift_manager.web.limits import HANDSHAKE_WITHIN_S
from lift_manager.web.server import listen, serve
from lift_manager.web.tls import ServerCertificates
from tests.lift_manager.web.fake_lifts import ABLE, AT, DOOR, HOLD, IDLE, PRESS, config_of
from tests.lift_manager.web.fake_rides import FakeRides
from tests.lift_manager.web.fake_sessions import a_command, a_session

BASE = "/open-rmf/demo-lift"
STATE = f"{BASE}/lift_state"
REQUEST = f"{BASE}/lift_request?lift_name=lift"
ACCEPTED = b'{"data":{},"success":true,"msg":""}'
CALL = b'{"floor":"L2","door_state":0}'


class Requested(NamedTuple):
    """A request of a caller that knows no sessions."""

    lift: str
    holder: Holder
    floor: str
    hold_door: bool
    robot: RobotWord | None = None
    stays: bool = False


class FakeSite(Site):
    """Lifts as the test says. Remembers what is requested, and takes all of it, or refuses all of it.

    Events, and the wait for the disk, are those of every site.
    """

    def __init__(
        self,
        lifts: Mapping[str, LiftState] | None = None,
        *,
        able: Capabilities = ABLE,
        signals: tuple[SignalValue, ...] = (DOOR,),
        refuses: Refused | None = None,
        unwritten: frozenset[str] = frozenset(),
        newest: int = 0,
        stopping: bool = False,
        rmf: RmfRules | None = None,
        recorder: Recorder | None = None,
    ) -> None:
        """`able` and `signals` are those of every lift; `refuses` is the reply to every request that changes something."""
        self.bus: Bus[Event] = Bus("b0")
        self.bus.newest = newest
        super().__init__([], self.bus, recorder or MemoryRecorder(), rmf=rmf)
        self.lifts = {"lift": IDLE, "goods": replace(IDLE, lift="goods")} if lifts is None else dict(lifts)
        self.rides = self.fake_rides = FakeRides(self.lift_names, refuses)
        self.stopping = stopping
        self._able, self._signals, self._refuses, self._unwritten = able, signals, refuses, unwritten
        self.busy: dict[str, str] = {}
        """What is under way, by lift."""
        self.requests: list[Requested] = []
        self.ends: list[tuple[str, Holder, float]] = []
        self.decisions: list[tuple[str, ...]] = []
        """What people decided."""
        self.done: list[tuple[object, ...]] = []
        """What was requested of sessions."""
        self.away: list[FaceRefusal] = []
        self.logins: list[tuple[str, str, bool]] = []
        """Whom the face refused by itself."""
        self.sessions: dict[tuple[str, str], SessionInfo] = {}
        """By lift and id."""
        self.commands: dict[tuple[str, str], CommandStatus] = {}
        """By session and id: each is pending until somebody waits for it."""
        self.waited_s: list[float] = []
        self._keys: dict[tuple[Holder, str], str] = {}

    @property
    def changes(self) -> list[object]:
        """Everything that was requested to change something, by any face."""
        return [
            *(*self.requests, *self.ends, *self.decisions, *self.done),
            *(*self.fake_rides.requests, *self.fake_rides.reports),
        ]

    # -- what is known

    def lift_names(self) -> tuple[str, ...]:
        return tuple(self.lifts)

    def state(self, lift: str) -> LiftState:
        if lift not in self.lifts:
            raise raised(Refused(Refusal.UNKNOWN_LIFT, f"no lift {lift!r}; the lifts are {', '.join(self.lifts)}"))
        return self.lifts[lift]

    def lasting_state(self, lift: str) -> LiftState:
        return self.state(lift)

    def under_way(self, lift: str) -> str:
        return self.busy.get(lift, "")

    def age_s(self, lift: str) -> float | None:
        return self.state(lift).age_s

    def config(self, lift: str) -> LiftConfig:
        return config_of(self.state(lift), self._able)

    def signals(self, lift: str) -> LiftSignals:
        return LiftSignals(lift, self.state(lift).age_s, self._able.max_age_s, self._signals)

    def map_commands(self, lift: str) -> tuple[CommandInfo, ...]:
        self.state(lift)
        return (HOLD,)

    def planned_writes(self, lift: str, steps: Iterable[str]) -> tuple[PlannedWrite, ...]:
        self.state(lift)
        return tuple(replace(PRESS, name=step.partition(" ")[2]) for step in steps)

    @property
    def unwritten(self) -> frozenset[str]:
        return self._unwritten

    # -- callers that know no sessions

    def request(
        self,
        lift: str,
        holder: Holder,
        floor: str,
        *,
        hold_door: bool,
        robot: RobotWord | None = None,
        stays: bool = False,
    ) -> Accepted:
        self.requests.append(Requested(lift, holder, floor, hold_door, robot, stays))
        self._check(lift)
        return Accepted()

    def end_session(self, lift: str, holder: Holder, grace_s: float) -> Accepted:
        self.ends.append((lift, holder, grace_s))
        self._check(lift)
        return Accepted()

    # -- sessions that their holders open and close: a lift has as many as are wanted

    def there(self, *sessions: SessionInfo) -> None:
        """Let these sessions be open."""
        self.sessions |= {(session.lift, session.id): session for session in sessions}

    def open_session(self, lift: str, holder: Holder, *, key: str = "", ttl_s: float | None = None) -> SessionBegun:
        self.done.append(("open", lift, holder, key, ttl_s))
        self._check(lift)
        if key and (known := self._keys.get((holder, key))):
            return SessionBegun(self.sessions[lift, known], is_new=False)
        session = a_session(holder, f"s{len(self.sessions) + 1}", lift)
        self._keys[holder, key] = session.id
        self.there(session)
        return SessionBegun(session, is_new=True)

    def session(self, lift: str, session: str, holder: Holder | None) -> SessionInfo:
        self.state(lift)
        found = self.sessions.get((lift, session))
        if found is None or holder not in {None, found.holder}:
            raise raised(Refused(Refusal.NO_SUCH_SESSION, "the site's own words"))
        return found

    def renew_session(self, lift: str, session: str, holder: Holder, ttl_s: float | None) -> SessionInfo:
        return self._changed(("renew", lift, session, holder, ttl_s), lease_ends_in_s=ttl_s or 300.0)

    def close_session(self, lift: str, session: str, holder: Holder, robot: RobotWord | None) -> SessionInfo:
        over = SessionOver(EndReason.RELEASED, "released by its holder", None, AT)
        return self._changed(("close", lift, session, holder, robot), over=over)

    def hand_session_over(self, lift: str, session: str, holder: Holder, to: Holder) -> SessionInfo:
        handed = self._changed(("hand over", lift, session, holder, to), holder=to, id=f"{session}-2")
        del self.sessions[lift, session]
        self.there(handed)
        return handed

    def command(self, lift: str, request: CommandRequest) -> CommandStatus:
        self.done.append(("command", lift, request))
        found = self.session(lift, request.session, request.holder)
        if request.floor not in (None, "L1", "L2"):
            raise raised(Refused(Refusal.UNKNOWN_FLOOR, f"no floor {request.floor!r}; the floors are L1, L2"))
        self._check(lift)
        command = str(len(self.commands) + 1)
        status = replace(a_command(found, command), kind=request.kind, floor=request.floor)
        self.commands[request.session, command] = status
        return status

    def command_status(self, lift: str, session: str, holder: Holder | None, command: str) -> CommandStatus:
        self.session(lift, session, holder)
        if (session, command) not in self.commands:
            raise raised(Refused(Refusal.NO_SUCH_COMMAND, f"no command {command!r}"))
        return self.commands[session, command]

    async def until_ended(
        self, lift: str, session: str, holder: Holder | None, command: str, within_s: float
    ) -> CommandStatus:
        self.waited_s.append(within_s)
        status = self.command_status(lift, session, holder, command)
        ended = replace(status, state=CommandState.CONFIRMED, proof=Proof.LAMP, ended_at=AT)
        self.commands[session, command] = ended
        return ended

    # -- people

    def acknowledge(self, lift: str, by: str) -> Acknowledged:
        self._decided("acknowledge", lift, by)
        return Acknowledged(lift, by, AT, (Cause.FIRE, Cause.OCCUPIED))

    def lock_out(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> Restriction:
        self._decided("lock_out", lift, by, reason, *(["now"] if at_once else []))
        return Restriction(RestrictionKind.LOCKOUT, by, reason, AT)

    def end_lockout(self, lift: str, by: str) -> RestrictionEnded:
        self._decided("end_lockout", lift, by)
        return RestrictionEnded(lift, by, AT, Restriction(RestrictionKind.LOCKOUT, "A. Beck", "new ropes", AT))

    def begin_drain(self, lift: str, by: str, reason: str) -> Restriction:
        self._decided("begin_drain", lift, by, reason)
        return Restriction(RestrictionKind.DRAIN, by, reason, AT)

    def end_drain(self, lift: str, by: str) -> RestrictionEnded:
        self._decided("end_drain", lift, by)
        return RestrictionEnded(lift, by, AT, Restriction(RestrictionKind.DRAIN, "A. Beck", "new ropes", AT))

    def force_release(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> ForceReleased:
        self._decided("force_release", lift, by, reason, *(["now"] if at_once else []))
        return ForceReleased(lift, by, AT, reason, Holder("workshop", "robot-1"), maybe_aboard=True)

    def turned_away(self, who: FaceRefusal) -> None:
        self.away.append(who)

    def logged_in(self, key: str, address: str, *, ended: bool = False) -> None:
        self.logins.append((key, address, ended))

    # -- what happens

    def freshen(self, lift: str | None = None) -> None:
        """Every state is as it was published."""

    @contextmanager
    def numbering(self, lift: str) -> Iterator[None]:
        self.freshen(lift)
        yield
        self.freshen(lift)

    def happens(self, event: Event) -> None:
        """Let everybody who listens hear of it."""
        self.bus.publish(event)

    # -- inside

    def _check(self, lift: str) -> None:
        self.state(lift)
        if self._refuses is not None:
            raise raised(self._refuses)

    def _decided(self, *decision: str) -> None:
        self.decisions.append(decision)
        self._check(decision[1])

    def _changed(self, request: tuple[str, str, str, Holder, object], **change: object) -> SessionInfo:
        self.done.append(request)
        _, lift, session, holder, _ = request
        found = self.session(lift, session, holder)
        self._check(lift)
        changed = replace(found, **change)  # type: ignore[arg-type]  # some of its fields
        self.sessions[lift, session] = changed
        return changed


def one_lift(state: LiftState) -> FakeSite:
    return FakeSite({state.lift: state})


NAME = "lifts"
"""By which `ask` addresses the application."""


def _make(site: Site, keys: Keys | None) -> FastAPI:
    return make_app(site, keys, host_names=(NAME,))


def ask(site: Site, method: str, url: str, *, keys: Keys | None = None, **more: Any) -> httpx.Response:
    return ask_app(app_of(site, keys, _make, _made), method, url, host=NAME, **more)


class StandIn:
    """Passes everything on to one site after the other: an application takes long to make, and serves them all."""

    def __init__(self, first: Site) -> None:
        self.stands_for = first

    def __getattr__(self, name: str) -> Any:
        if callable(getattr(self.stands_for, name)):
            # what an application keeps of one site must reach the next
            return partial(self._pass_on, name)
        return getattr(self.stands_for, name)

    def _pass_on(self, name: str, *given: Any, **named: Any) -> Any:
        return getattr(self.stands_for, name)(*given, **named)


Made = dict[tuple[int, tuple[str, ...]], tuple[StandIn, Keys | None, FastAPI]]
_made: Made = {}


def app_of(site: Site, keys: Keys | None, make: Callable[[Site, Keys | None], FastAPI], made: Made) -> FastAPI:
    """An application for these two: one that was made for the same keys and the same names of lifts, if there is one in `made`."""
    of = (id(keys), site.lift_names())
    if of not in made:
        while len(made) > 7:
            del made[next(iter(made))]
        stand_in = StandIn(site)
        made[of] = stand_in, keys, make(cast("Site", stand_in), keys)
    stand_in, _, app = made[of]
    stand_in.stands_for = site
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
