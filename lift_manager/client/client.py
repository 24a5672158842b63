"""The client: each operation of /api/v1 as a method, and the helpers that make a session, a ride or a view of the lifts of them."""

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
from lift_manager.api.lifts import AGE_HEADER, Lift, LiftCapabilities, Lifts, Signals
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
from lift_manager.client.call import WITHIN_S, Call, Form, Http, Reply
from lift_manager.client.errors import ClientError, NotFound, Refused
from lift_manager.client.ride import ActiveRide
from lift_manager.client.session import ActiveSession
from lift_manager.client.states import KnownLift, States
from lift_manager.client.stream import EventStream
from lift_manager.lift.occupancy import RobotWord
from lift_manager.plain.backoff import Backoff
from lift_manager.plain.paths import API, frames_path, lift_path, part, ride_path, session_path
from lift_manager.rides.ride import OVER, RideWord
from register_maps.words import Side

_log = logging.getLogger(__name__)

MANAGER = "http://127.0.0.1:5003"
LONGEST_WAIT_S = 30.0
"""The manager waits no longer for the end of a command."""


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
        self._http = Http(url, key, tls, within_s, transport)
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
        """Where the manager is."""
        return self._http.url

    # lifts

    async def lifts(self) -> tuple[Lift, ...]:
        """Every lift, in the site's order."""
        return (await self._http.get(f"{API}/lifts", Lifts)).lifts

    async def lift(self, name: str) -> Lift:
        """One lift. What was not changed since the last time is not sent again, but for its age."""
        return (await self._tagged_lift(name, Call("GET", lift_path(name), repeat=True))).lift

    async def known_lifts(self, lift: str | None, *, within_s: float) -> tuple[KnownLift, ...]:
        """One lift or all of them, each with the time at which the question left. Asked once."""
        if lift is not None:
            return (await self._tagged_lift(lift, Call("GET", lift_path(lift), within_s=within_s)),)
        asked_at = _now()
        told = await self._http.ask(Call("GET", f"{API}/lifts", within_s=within_s), Lifts)
        return tuple(KnownLift(each, asked_at) for each in told.lifts)

    async def capabilities(self, lift: str) -> LiftCapabilities:
        """What a lift can say and be told."""
        return await self._http.get(lift_path(lift, "capabilities"), LiftCapabilities)

    async def signals(self, lift: str) -> Signals:
        """What each of its signals says."""
        return await self._http.get(lift_path(lift, "signals"), Signals)

    # sessions, by hand; `session` makes it easier

    async def open_session(
        self, lift: str, *, robot: str | None = None, ttl_s: float | None = None, key: str | None = None
    ) -> Session:
        """Take the lift for oneself; nothing is called by it."""
        key = key or self._new_key(robot)
        body = {"robot": robot, "ttl_s": ttl_s, "idempotency_key": key}
        return await self._post(lift_path(lift, "sessions"), body, Session, repeat=key is not None)

    async def get_session(self, lift: str, session: str) -> Session:
        """A session of one's own."""
        return await self._http.get(session_path(lift, session), Session)

    async def renew_session(
        self, lift: str, session: str, *, ttl_s: float | None = None, within_s: float | None = None
    ) -> Session:
        """Begin its lease anew."""
        return await self._post(
            session_path(lift, session, "renew"), {"ttl_s": ttl_s}, Session, within_s=within_s, repeat=False
        )

    async def close_session(self, lift: str, session: str, *, robot: RobotWord | None = None) -> Session:
        """End it, the car where it is."""
        return await self._post(session_path(lift, session, "close"), {"robot": robot}, Session, repeat=True)

    async def hand_over_session(self, lift: str, session: str, to: str, *, robot: str | None = None) -> Session:
        """Give it to another caller; the answer has its new id."""
        body = {"to": to, "robot": robot}
        return await self._post(session_path(lift, session, "hand-over"), body, Session, repeat=False)

    async def command(self, lift: str, session: str, wish: CommandRequest, *, wait: float = 0.0) -> Command:
        """Ask for something within a session. `wait`: so many seconds, 30 at the most, for the end of it."""
        body = _body(wish) | {"idempotency_key": wish.idempotency_key or new_key()}
        return await self._post(session_path(lift, session, "commands"), body, Command, repeat=True, wait=wait)

    async def get_command(self, lift: str, session: str, command: str, *, wait: float = 0.0) -> Command:
        """What became of a request; `wait` as in `command`."""
        call = Call(
            "GET", session_path(lift, session, "commands", part(command)), _wait(wait), repeat=True, waits_s=wait
        )
        return await self._http.ask(call, Command)

    # rides, by hand; `ride` makes it easier

    async def begin_ride(self, wish: RideRequest) -> Ride:
        """Begin a ride, or queue it; without an idempotency key of its own it is given one."""
        key = wish.idempotency_key or self._new_key(wish.robot)
        body = _body(wish) | {"idempotency_key": key, "dry_run": False}
        return await self._post(f"{API}/rides", body, Ride, repeat=key is not None)

    async def plan_ride(self, wish: RideRequest) -> Plan:
        """Say what a ride would come to, and begin nothing."""
        return await self._post(f"{API}/rides", _body(wish) | {"dry_run": True}, Plan, repeat=True)

    async def rides(self) -> tuple[Ride, ...]:
        """Rides that go on, and those that ended not long ago."""
        return (await self._http.get(f"{API}/rides", Rides)).rides

    async def get_ride(self, ride: str, *, within_s: float | None = None) -> Ride:
        """A ride as it is now; with a limit it is asked for only once."""
        return await self._http.ask(Call("GET", ride_path(ride), repeat=within_s is None, within_s=within_s), Ride)

    async def ride_word(self, ride: str, word: RideWord, *, within_s: float | None = None) -> Ride:
        """Say a word of its robot; with a limit it is said only once. `left` is said again where nothing came back: it lets go."""
        again = word is RideWord.LEFT and within_s is None
        try:
            return await self._post(ride_path(ride, word), {}, Ride, repeat=again, within_s=within_s)
        except NotFound:
            raise
        except Refused:
            # the first of two may have been heard: a robot that left twice has left once
            told = await self.get_ride(ride, within_s=within_s) if word is RideWord.LEFT else None
            if told is None or told.phase not in OVER or told.maybe_aboard:
                raise
            return told

    async def cancel_ride(self, ride: str, reason: str = "cancelled") -> Ride:
        """End it safely: a robot that may be inside is let out first."""
        return await self._post(ride_path(ride, "cancel"), {"reason": reason}, Ride, repeat=True)

    # a person's word

    async def acknowledge(self, lift: str, by: str) -> AcknowledgedAnswer:
        """Say that a lift was checked after a fire, or that no robot is in its car."""
        return await self._post(lift_path(lift, "acknowledge"), {"by": by}, AcknowledgedAnswer, repeat=False)

    async def lock_out(self, lift: str, by: str, reason: str, *, now: bool = False) -> LockoutAnswer:
        """Keep robots off a lift; a held door is released `clear_s` later unless it has to be `now`."""
        body = {"by": by, "reason": reason, **_at_once(now=now)}
        return await self._post(lift_path(lift, "lockout"), body, LockoutAnswer, repeat=False)

    async def end_lockout(self, lift: str, by: str) -> LockoutEndedAnswer:
        """Let robots on it again."""
        return await self._post(lift_path(lift, "lockout", "end"), {"by": by}, LockoutEndedAnswer, repeat=False)

    async def begin_drain(self, lift: str, by: str, reason: str) -> DrainAnswer:
        """Let sessions on a lift end and no new one begin."""
        return await self._post(lift_path(lift, "drain"), {"by": by, "reason": reason}, DrainAnswer, repeat=False)

    async def end_drain(self, lift: str, by: str) -> DrainEndedAnswer:
        """Let sessions on it begin again."""
        return await self._post(lift_path(lift, "drain", "end"), {"by": by}, DrainEndedAnswer, repeat=False)

    async def force_release(self, lift: str, by: str, reason: str, *, now: bool = False) -> ForceReleasedAnswer:
        """End the session of whoever holds a lift; a held door is released `clear_s` later unless it has to be `now`."""
        path, body = lift_path(lift, "session", "force-release"), {"by": by, "reason": reason, **_at_once(now=now)}
        return await self._post(path, body, ForceReleasedAnswer, repeat=False)

    # what happens

    def events(self, lift: str | None = None, ride: str | None = None) -> EventStream:
        """Everything that happens, or what concerns one lift or one ride; begins with a snapshot."""
        query = {name: value for name, value in (("lift", lift), ("ride", ride)) if value is not None}
        return EventStream(self._http, f"{API}/events", query, backoff=Backoff(self._chance))

    def frames(self, link: str) -> EventStream:
        """What goes over one link, for tools."""
        return EventStream(self._http, frames_path(link), backoff=Backoff(self._chance))

    @asynccontextmanager
    async def states(self, lift: str | None = None) -> AsyncIterator[States]:
        """One lift or all of them as they are now, offline as soon as nothing is heard."""
        states = States(self, lift)
        async with _background(states.follow(), states.listen()):
            yield states

    @asynccontextmanager
    async def session(
        self, lift: str, *, robot: str | None = None, ttl_s: float | None = None
    ) -> AsyncIterator[ActiveSession]:
        """Take a lift for the block, renewing the lease; it is closed at the end, whatever ends it."""
        asked_at = _now()
        held = ActiveSession(self, await self.open_session(lift, robot=robot, ttl_s=ttl_s), asked_at, ttl_s)
        try:
            async with _background(held.follow(), held.listen()):
                yield held
        except BaseException:
            await self._quietly(held)
            raise
        if not held.closed:
            await held.close()

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
        """Begin a ride, with a lift or with `any`; one that is not over at the end of the block is cancelled."""
        # as it is: what cannot be is refused by the manager, in its words
        wish = {
            "lift": lift,
            "from": start,
            "to": destination,
            "robot": robot,
            "door": door,
            "limits": None if limits is None else limits.model_dump(),
            "idempotency_key": (key := key or self._new_key(robot)),
        }
        asked_at = _now()
        ride = ActiveRide(self, await self._post(f"{API}/rides", wish, Ride, repeat=key is not None), asked_at)
        try:
            async with _background(ride.follow(), ride.listen()):
                yield ride
        except BaseException:
            await self._quietly(ride)
            raise
        if not ride.over:
            await ride.cancel(_LEFT_BLOCK)

    # health

    async def is_alive(self) -> bool:
        """Whether the process answers. Raises Unreachable where it does not."""
        return (await self._http.reply(Call("GET", "/healthz", repeat=True))).status == 200

    async def readiness(self) -> Readiness:
        """Whether robots are served, and what stands in the way."""
        return await self._http.ask(Call("GET", "/readyz", repeat=True, also=(503,)), Readiness)

    async def links(self) -> tuple[str, ...]:
        """Every controller by its name, for `frames`."""
        return (await self._http.get(f"{API}/links", Links)).links

    async def _quietly(self, held: ActiveSession | ActiveRide) -> None:
        """Let go after a failure, which is told in any case."""
        try:
            if isinstance(held, ActiveSession):
                if not held.closed:
                    await held.close()
            elif not held.over:
                await held.cancel(_LEFT_BLOCK)
        except ClientError as error:
            _log.warning("what was begun could not be ended: %s", error)

    async def _tagged_lift(self, name: str, call: Call) -> KnownLift:
        before = self._tagged.get(name)
        headers = {} if before is None or not before.etag else {"if-none-match": before.etag}
        asked_at = _now()
        reply = await self._http.reply(replace(call, headers=headers, also=(304,)))
        if reply.status == 304 and before is not None:
            known = before.same(_age(reply), asked_at)
        else:
            known = KnownLift(self._http.read(reply, Lift), asked_at, reply.headers.get("etag", ""))
        self._tagged[name] = known
        return known

    async def _post(
        self,
        path: str,
        body: Mapping[str, Any],
        form: type[Form],
        *,
        repeat: bool,
        wait: float = 0.0,
        within_s: float | None = None,
    ) -> Form:
        said = {name: value for name, value in body.items() if value is not None}
        call = Call("POST", path, _wait(wait), said, repeat=repeat, waits_s=wait, within_s=within_s)
        return await self._http.ask(call, form)

    def _new_key(self, robot: str | None) -> str | None:
        """Return an idempotency key; None for a caller that has neither a key nor a robot's name: the manager takes none of it."""
        return new_key() if self._http.has_key or robot else None


_LEFT_BLOCK = "the robot's program ended its ride"


def new_key() -> str:
    """Return an idempotency key."""
    return uuid.uuid4().hex


def _wait(wait: float) -> dict[str, str]:
    return {"wait": f"{min(wait, LONGEST_WAIT_S):g}"} if wait > 0 else {}


def _body(wish: RideRequest | CommandRequest) -> dict[str, Any]:
    return wish.model_dump(mode="json", by_alias=True, exclude_none=True)


def _age(reply: Reply) -> float | None:
    try:
        return float(reply.headers[AGE_HEADER])
    except (KeyError, ValueError):
        return None


def _now() -> float:
    return asyncio.get_running_loop().time()


def _at_once(*, now: bool) -> dict[str, bool]:
    """Return what a manager is told that is not to wait; an older one knows no such field, and never waits."""
    return {"now": True} if now else {}


@asynccontextmanager
async def _background(*work: Coroutine[None, None, None]) -> AsyncIterator[None]:
    """Run work for as long as the block lasts. What the block raises comes out as it is, and not in a group.

    The work itself raises nothing but bugs; those end the block.
    """
    failure: Exception | None = None
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(each) for each in work]
        try:
            yield
        except Exception as error:  # noqa: BLE001  raised again below, once the group has ended
            failure = error
        finally:
            for task in tasks:
                task.cancel()
    if failure is not None:
        raise failure
