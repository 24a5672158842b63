"""The client: each operation of /api/v1 as a method, and helpers for sessions, rides and states."""

from __future__ import annotations

import asyncio
import logging
import random
import ssl
import uuid
from collections.abc import AsyncIterator, Coroutine, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx

from lift_manager.api.events import Links
from lift_manager.api.fields import Answer
from lift_manager.api.keys import Secret
from lift_manager.api.lifts import AGE_HEADER, Lift, LiftCapabilities, LiftCommands, Lifts, PlannedWrites, Signals
from lift_manager.api.people import (
    AcknowledgedAnswer,
    DrainAnswer,
    DrainEndedAnswer,
    ForceReleasedAnswer,
    LockoutAnswer,
    LockoutEndedAnswer,
)
from lift_manager.api.rides import Limits, Plan, Ride, RideRequest, Rides
from lift_manager.api.sessions import Command, CommandRequest, Session
from lift_manager.client.errors import ClientError, NotFound, Refused
from lift_manager.client.http import WITHIN_S, HttpClient, HttpRequest, Model, Reply
from lift_manager.client.ride import ActiveRide
from lift_manager.client.session import ActiveSession
from lift_manager.client.states import KnownLift, States
from lift_manager.client.stream import EventStream
from lift_manager.lift.occupancy import RobotWord
from lift_manager.plain.backoff import Backoff
from lift_manager.plain.http import MANAGER
from lift_manager.plain.paths import API, frames_path, lift_path, part, ride_path, session_path
from lift_manager.rides.ride import OVER, RideWord
from register_maps.words import Side

_log = logging.getLogger(__name__)

MAX_WAIT_S = 30.0
"""The longest that the manager waits for the outcome of a command."""


class Readiness(Answer):
    """Whether robots are served."""

    ready: bool
    journal: str
    state: str
    lifts: int
    live: int
    """Lifts that can be read."""


class LiftManagerClient:
    """A running manager. `async with` opens and closes the connections; one client serves any number of tasks of one event loop.

    Every method raises ClientError. What begins something carries an idempotency key of its own, unless the caller has neither a key nor
    a robot's name, and is sent once more where nothing came back; so are reads and releases. Nothing else is ever sent twice.
    """

    def __init__(
        self,
        url: str = MANAGER,
        key: str | Secret | None = None,
        *,
        tls: ssl.SSLContext | Path | str | None = None,
        within_s: float = WITHIN_S,
        transport: httpx.AsyncBaseTransport | None = None,
        chance: random.Random | None = None,
    ) -> None:
        """`tls` is the CA of the manager's certificate, or a whole context; `within_s` bounds each try of each request.

        For tests there are `transport`, in the place of the network, and `chance`, seeded.
        """
        self._http = HttpClient(url, key, tls, within_s, transport)
        self._chance = chance
        self._tagged: dict[str, KnownLift] = {}

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close every connection."""
        await self._http.aclose()

    @property
    def url(self) -> str:
        """The address of the manager."""
        return self._http.url

    # lifts

    async def lifts(self) -> tuple[Lift, ...]:
        """Every lift, in the order of the site."""
        return (await self._http.get(f"{API}/lifts", Lifts)).lifts

    async def lift(self, name: str) -> Lift:
        """One lift. An unchanged state is not sent again, only its age."""
        return (await self._tagged_lift(name, HttpRequest("GET", lift_path(name), repeat=True))).lift

    async def known_lifts(self, lift: str | None, *, within_s: float) -> tuple[KnownLift, ...]:
        """One lift or all of them, each with the time at which the request was sent. Sent once."""
        if lift is not None:
            return (await self._tagged_lift(lift, HttpRequest("GET", lift_path(lift), within_s=within_s)),)
        requested_at = _now()
        ride_now = await self._http.send(HttpRequest("GET", f"{API}/lifts", within_s=within_s), Lifts)
        return tuple(KnownLift(item, requested_at) for item in ride_now.lifts)

    async def capabilities(self, lift: str) -> LiftCapabilities:
        """The signals, commands and limits of a lift."""
        return await self._http.get(lift_path(lift, "capabilities"), LiftCapabilities)

    async def signals(self, lift: str) -> Signals:
        """The value of each signal of a lift."""
        return await self._http.get(lift_path(lift, "signals"), Signals)

    async def commands(self, lift: str) -> LiftCommands:
        """Every command of a lift's map, and what its output does."""
        return await self._http.get(lift_path(lift, "commands"), LiftCommands)

    async def planned_writes(self, lift: str, *steps: str) -> PlannedWrites:
        """What steps such as `press go_to L2` and `release hold_door.front` would write; nothing is sent."""
        request = HttpRequest("GET", lift_path(lift, "commands", "writes"), {"step": steps}, repeat=True)
        return await self._http.send(request, PlannedWrites)

    # sessions; `session` is more convenient

    async def open_session(
        self, lift: str, *, robot: str | None = None, ttl_s: float | None = None, key: str | None = None
    ) -> Session:
        """Open a session; this does not call the lift."""
        key = key or self._new_key(robot)
        body = {"robot": robot, "ttl_s": ttl_s, "idempotency_key": key}
        return await self._post(lift_path(lift, "sessions"), body, Session, repeat=key is not None)

    async def get_session(self, lift: str, session: str) -> Session:
        """A session of this caller."""
        return await self._http.get(session_path(lift, session), Session)

    async def renew_session(
        self, lift: str, session: str, *, ttl_s: float | None = None, within_s: float | None = None
    ) -> Session:
        """Renew the lease of a session."""
        return await self._post(
            session_path(lift, session, "renew"), {"ttl_s": ttl_s}, Session, within_s=within_s, repeat=False
        )

    async def close_session(self, lift: str, session: str, *, robot: RobotWord | None = None) -> Session:
        """Close a session without moving the car."""
        return await self._post(session_path(lift, session, "close"), {"robot": robot}, Session, repeat=True)

    async def hand_over_session(self, lift: str, session: str, to: str, *, robot: str | None = None) -> Session:
        """Hand a session over to another caller; the reply has its new id."""
        body = {"to": to, "robot": robot}
        return await self._post(session_path(lift, session, "hand-over"), body, Session, repeat=False)

    async def command(self, lift: str, session: str, request: CommandRequest, *, wait: float = 0.0) -> Command:
        """Send a command; `wait` is how long to wait for its outcome, at most 30 s."""
        body = _body(request) | {"idempotency_key": request.idempotency_key or new_key()}
        return await self._post(session_path(lift, session, "commands"), body, Command, repeat=True, wait=wait)

    async def get_command(self, lift: str, session: str, command: str, *, wait: float = 0.0) -> Command:
        """The status of a command; `wait` as in `command`."""
        request = HttpRequest(
            "GET",
            session_path(lift, session, "commands", part(command)),
            _wait_query(wait),
            repeat=True,
            server_wait_s=wait,
        )
        return await self._http.send(request, Command)

    # rides; `ride` is more convenient

    async def begin_ride(self, request: RideRequest) -> Ride:
        """Begin or queue a ride; adds an idempotency key if there is none."""
        key = request.idempotency_key or self._new_key(request.robot)
        body = _body(request) | {"idempotency_key": key, "dry_run": False}
        return await self._post(f"{API}/rides", body, Ride, repeat=key is not None)

    async def plan_ride(self, request: RideRequest) -> Plan:
        """Plan a ride without beginning it."""
        return await self._post(f"{API}/rides", _body(request) | {"dry_run": True}, Plan, repeat=True)

    async def rides(self) -> tuple[Ride, ...]:
        """Current rides, and those that ended recently."""
        return (await self._http.get(f"{API}/rides", Rides)).rides

    async def get_ride(self, ride: str, *, within_s: float | None = None) -> Ride:
        """A ride; with `within_s` the request is sent only once."""
        return await self._http.send(
            HttpRequest("GET", ride_path(ride), repeat=within_s is None, within_s=within_s), Ride
        )

    async def ride_word(self, ride: str, word: RideWord, *, within_s: float | None = None) -> Ride:
        """Report for its robot; with `within_s` only once. `left` is repeated if no reply arrives, because it only releases."""
        repeat = word is RideWord.LEFT and within_s is None
        try:
            return await self._post(ride_path(ride, word), {}, Ride, repeat=repeat, within_s=within_s)
        except NotFound:
            raise
        except Refused:
            # the first of two may have been accepted: repeating `left` has no effect
            ride_now = await self.get_ride(ride, within_s=within_s) if word is RideWord.LEFT else None
            if ride_now is None or ride_now.phase not in OVER or ride_now.maybe_aboard:
                raise
            return ride_now

    async def cancel_ride(self, ride: str, reason: str = "cancelled") -> Ride:
        """End a ride safely: a robot that may be inside is let out first."""
        return await self._post(ride_path(ride, "cancel"), {"reason": reason}, Ride, repeat=True)

    # operator actions

    async def acknowledge(self, lift: str, by: str) -> AcknowledgedAnswer:
        """Acknowledge that a lift was checked after a fire, or that no robot is in its car."""
        return await self._post(lift_path(lift, "acknowledge"), {"by": by}, AcknowledgedAnswer, repeat=False)

    async def lock_out(self, lift: str, by: str, reason: str, *, now: bool = False) -> LockoutAnswer:
        """Keep robots off a lift; a held door is released `clear_s` later, with `now` at once."""
        body = {"by": by, "reason": reason, **_now_field(now=now)}
        return await self._post(lift_path(lift, "lockout"), body, LockoutAnswer, repeat=False)

    async def end_lockout(self, lift: str, by: str) -> LockoutEndedAnswer:
        """Let robots use a lift again."""
        return await self._post(lift_path(lift, "lockout", "end"), {"by": by}, LockoutEndedAnswer, repeat=False)

    async def begin_drain(self, lift: str, by: str, reason: str) -> DrainAnswer:
        """Let sessions on a lift end and no new one begin."""
        return await self._post(lift_path(lift, "drain"), {"by": by, "reason": reason}, DrainAnswer, repeat=False)

    async def end_drain(self, lift: str, by: str) -> DrainEndedAnswer:
        """End a drain."""
        return await self._post(lift_path(lift, "drain", "end"), {"by": by}, DrainEndedAnswer, repeat=False)

    async def force_release(self, lift: str, by: str, reason: str, *, now: bool = False) -> ForceReleasedAnswer:
        """End the session that holds a lift; a held door is released `clear_s` later, with `now` at once."""
        path, body = lift_path(lift, "session", "force-release"), {"by": by, "reason": reason, **_now_field(now=now)}
        return await self._post(path, body, ForceReleasedAnswer, repeat=False)

    # events

    def events(self, lift: str | None = None, ride: str | None = None) -> EventStream:
        """All events, or those of one lift or ride; begins with a snapshot."""
        query = {name: value for name, value in (("lift", lift), ("ride", ride)) if value is not None}
        return EventStream(self._http, f"{API}/events", query, backoff=Backoff(self._chance))

    def frames(self, link: str) -> EventStream:
        """The frames on the wire of one link, for tools."""
        return EventStream(self._http, frames_path(link), backoff=Backoff(self._chance))

    @asynccontextmanager
    async def states(self, lift: str | None = None) -> AsyncIterator[States]:
        """The current state of one lift or all of them, offline without contact to the manager."""
        states = States(self, lift)
        async with in_background(states.follow(), states.listen()):
            yield states

    @asynccontextmanager
    async def session(
        self, lift: str, *, robot: str | None = None, ttl_s: float | None = None
    ) -> AsyncIterator[ActiveSession]:
        """Open a session for the block, renew its lease, and close it at the end in any case."""
        requested_at = _now()
        handle = ActiveSession(self, await self.open_session(lift, robot=robot, ttl_s=ttl_s), requested_at, ttl_s)
        try:
            async with in_background(handle.follow(), handle.listen()):
                yield handle
        except BaseException:
            await self._end_quietly(handle)
            raise
        if not handle.closed:
            await handle.close()

    @asynccontextmanager
    async def ride(
        self,
        lift: str,
        start: str,
        destination: str,
        *,
        robot: str | None = None,
        door: Side | None = None,
        limits: Limits | None = None,
        key: str | None = None,
    ) -> AsyncIterator[ActiveRide]:
        """Begin a ride with a lift or with `any`; cancel it at the end of the block if it is not over."""
        # not validated here: the manager refuses what is not possible
        request = {
            "lift": lift,
            "from": start,
            "to": destination,
            "robot": robot,
            "door": door,
            "limits": None if limits is None else limits.model_dump(),
            "idempotency_key": (key := key or self._new_key(robot)),
        }
        requested_at = _now()
        ride = ActiveRide(self, await self._post(f"{API}/rides", request, Ride, repeat=key is not None), requested_at)
        try:
            async with in_background(ride.follow(), ride.listen()):
                yield ride
        except BaseException:
            await self._end_quietly(ride)
            raise
        if not ride.over:
            await ride.cancel(_LEFT_BLOCK)

    # health

    async def is_alive(self) -> bool:
        """Whether the process replies. Raises Unreachable if it does not."""
        return (await self._http.send_raw(HttpRequest("GET", "/healthz", repeat=True))).status == 200

    async def readiness(self) -> Readiness:
        """Whether robots are served, and if not, why."""
        return await self._http.send(HttpRequest("GET", "/readyz", repeat=True, accepted_statuses=(503,)), Readiness)

    async def metrics(self) -> str:
        """The metrics, as Prometheus reads them."""
        reply = await self._http.send_raw(HttpRequest("GET", "/metrics", repeat=True))
        return reply.content.decode("utf-8", "replace")

    async def links(self) -> tuple[str, ...]:
        """Every controller by its name, for `frames`."""
        return (await self._http.get(f"{API}/links", Links)).links

    async def _end_quietly(self, handle: ActiveSession | ActiveRide) -> None:
        """Close or cancel after a failure, which is raised in any case."""
        try:
            if isinstance(handle, ActiveSession):
                if not handle.closed:
                    await handle.close()
            elif not handle.over:
                await handle.cancel(_LEFT_BLOCK)
        except ClientError as error:
            _log.warning("the session or ride could not be ended: %s", error)

    async def _tagged_lift(self, name: str, request: HttpRequest) -> KnownLift:
        before = self._tagged.get(name)
        headers = {} if before is None or not before.etag else {"if-none-match": before.etag}
        requested_at = _now()
        reply = await self._http.send_raw(replace(request, headers=headers, accepted_statuses=(304,)))
        if reply.status == 304 and before is not None:
            known = before.unchanged(_age_header(reply), requested_at)
        else:
            known = KnownLift(self._http.parse(reply, Lift), requested_at, reply.headers.get("etag", ""))
        self._tagged[name] = known
        return known

    async def _post(
        self,
        path: str,
        body: Mapping[str, Any],
        model: type[Model],
        *,
        repeat: bool,
        wait: float = 0.0,
        within_s: float | None = None,
    ) -> Model:
        filled = {name: value for name, value in body.items() if value is not None}
        request = HttpRequest(
            "POST", path, _wait_query(wait), filled, repeat=repeat, server_wait_s=wait, within_s=within_s
        )
        return await self._http.send(request, model)

    def _new_key(self, robot: str | None) -> str | None:
        """Return an idempotency key; None for a caller without a key and a robot name, from whom the manager does not accept one."""
        return new_key() if self._http.has_key or robot else None


_LEFT_BLOCK = "the robot's program ended its ride"


def new_key() -> str:
    """Return an idempotency key."""
    return uuid.uuid4().hex


def _wait_query(wait: float) -> dict[str, str]:
    return {"wait": f"{min(wait, MAX_WAIT_S):g}"} if wait > 0 else {}


def _body(request: RideRequest | CommandRequest) -> dict[str, Any]:
    return request.model_dump(mode="json", by_alias=True, exclude_none=True)


def _age_header(reply: Reply) -> float | None:
    try:
        return float(reply.headers[AGE_HEADER])
    except (KeyError, ValueError):
        return None


def _now() -> float:
    return asyncio.get_running_loop().time()


def _now_field(*, now: bool) -> dict[str, bool]:
    """Return the field `now` if it is set; an older manager does not know it, and never waits."""
    return {"now": True} if now else {}


@asynccontextmanager
async def in_background(*work: Coroutine[None, None, None]) -> AsyncIterator[None]:
    """Run work while the block lasts. An exception of the block is raised as it is, not in a group.

    The work itself raises only for bugs; those end the block.
    """
    failure: Exception | None = None
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(item) for item in work]
        try:
            yield
        except Exception as error:  # noqa: BLE001  raised again below, once the group has ended
            failure = error
        finally:
            for task in tasks:
                task.cancel()
    if failure is not None:
        raise failure
