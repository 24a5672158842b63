"""One site as the hub observes it: whether it runs, its lifts when they are requested, and the rows of its journal."""

from __future__ import annotations

import asyncio
import json
import logging
import sqlite3
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum, unique
from typing import TYPE_CHECKING, TypeVar

from pydantic import BaseModel, ValidationError

from lift_manager.hub import subjects
from lift_manager.hub.connection import Connection, cancellable, raise_if_cancelled
from lift_manager.hub.errors import BadReply, SiteRefused, SiteSilent
from lift_manager.hub.messages import (
    NEWS_EVERY_S,
    CommandMessage,
    CommandResult,
    LiftsRequest,
    News,
    Position,
    ProblemMessage,
    RemoteLifts,
    RemoteRides,
    RidesRequest,
    RowMessage,
    Ticket,
)
from lift_manager.hub.rate_limiter import RateLimiter

if TYPE_CHECKING:
    from nats.aio.msg import Msg
    from nats.aio.subscription import Subscription

SILENT_S = 3 * NEWS_EVERY_S
"""A site without news for this long is offline."""
REPLY_S = 2.0
"""How long a site may take to reply. Chosen: the limit of a command's ticket."""
COMMAND_REPLY_S = 4.0
"""The same for a command, which waits for the disk of the site."""
BATCH = 256
"""Rows read with one request."""
BATCH_BYTES = 512 * 1024
BATCH_GAP_S = 0.1
"""The shortest time between two batches of one site, so that none of them has the hub to itself: 2,560 rows a second."""
DISK_RETRY_S = 5.0
"""How long to wait for a disk that cannot be written."""
MOST_NEWS = 100
"""News of one site within FLOOD_S; one that sends more is not listened to for MUTED_S. An honest one sends ten a second at most."""
FLOOD_S = 5.0
MUTED_S = 30.0

Reply = TypeVar("Reply", bound=BaseModel)
AddRows = Callable[[str, Sequence[RowMessage], Position], Awaitable[None]]
Announce = Callable[[str, str, str], Awaitable[None]]
"""Takes a site, a word and a text."""
AnswerUpdate = Callable[[str, str, bytes], Awaitable[bytes | None]]
"""Takes a site, the kind of its request about updates, and the request; returns the reply, None for none."""

_log = logging.getLogger(__name__)


@unique
class SiteState(StrEnum):
    """Whether a site can be reached."""

    UNKNOWN = "unknown"
    """The hub has just started, or has not yet reached its NATS server, and there is no news yet."""
    ONLINE = "online"
    OFFLINE = "offline"
    FLOODING = "flooding"
    """It sent far more than an honest site does; it is not listened to for a while."""
    OFF = "off"
    """Switched off by a person."""


@dataclass(frozen=True, slots=True)
class LiftsReply:
    """The lifts of a site, with the time that request and reply took."""

    lifts: RemoteLifts
    round_trip_s: float


@dataclass(frozen=True, slots=True)
class RidesReply:
    """The rides of a site, with the time that request and reply took."""

    rides: RemoteRides
    round_trip_s: float


class RemoteSite:
    """One site. It observes while `run` runs."""

    def __init__(
        self,
        site: str,
        connection: Connection,
        position: Position | None,
        add_rows: AddRows,
        announce: Announce,
        answer_update: AnswerUpdate,
    ) -> None:
        """`position` is that of the newest row that the hub has."""
        self._answer_update = answer_update
        self.id = site
        self._connection, self._add_rows, self._announce = connection, add_rows, announce
        self.position = position
        self.news: News | None = None
        self._news_at = -SILENT_S
        self.state = SiteState.UNKNOWN
        self.rows_read = 0
        """Rows read from its stream since the start of the hub, known ones included."""
        self.times_offline = 0
        """How often it has turned offline."""
        self.unreadable = 0
        """Messages that could not be read."""
        self._changed = asyncio.Event()
        self._limiter = RateLimiter(MOST_NEWS, FLOOD_S)
        self._flooded = False

    @property
    def news_age_s(self) -> float | None:
        """How long ago the newest news arrived; None if there was none."""
        return None if self.news is None else _now() - self._news_at

    @property
    def rows_behind(self) -> int | None:
        """How many messages of its stream the hub has still to read; None while the site has no stream."""
        newest = None if self.news is None else self.news.newest
        if newest is None:
            return None
        is_same = self.position is not None and self.position.stream == newest.stream
        return max(0, newest.at - (self.position.at if is_same and self.position is not None else 0))

    async def run(self) -> None:
        """Observe until cancelled."""
        started_at = _now()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._read_rows())
            while True:
                news = await self._subscribe(subjects.news(self.id), self._receive)
                updates = await self._subscribe(subjects.update(self.id, "*"), self._receive_update)
                try:
                    while not self._flooded:
                        await asyncio.sleep(FLOOD_S / 10)
                        await self._judge(started_at)
                finally:
                    await self._unsubscribe(news)
                    await self._unsubscribe(updates)
                text = f"more than {MOST_NEWS} messages within {FLOOD_S:g} s; it is not listened to for {MUTED_S:g} s"
                await self._turn(SiteState.FLOODING, text)
                await asyncio.sleep(MUTED_S)
                self._flooded, self._limiter = False, RateLimiter(MOST_NEWS, FLOOD_S)

    async def lifts(self, lift: str | None) -> LiftsReply:
        """Request one lift, or all, from the site itself. Raises SiteSilent, BadReply and SiteRefused."""
        sent_at = _now()
        found = await self._request("lifts", LiftsRequest(lift=lift), RemoteLifts, REPLY_S)
        took_s = _now() - sent_at
        return LiftsReply(RemoteLifts(lifts=tuple(entry.after(took_s) for entry in found.lifts)), took_s)

    async def answers(self) -> bool:
        """Whether a request reaches the site."""
        try:
            with suppress(BadReply, SiteRefused):  # replies as well
                await self.lifts(None)
        except SiteSilent:
            return False
        return True

    async def rides(self, ride: str | None) -> RidesReply:
        """Request one ride, or all, from the site itself. Raises SiteSilent, BadReply and SiteRefused."""
        sent_at = _now()
        found = await self._request("rides", RidesRequest(ride=ride), RemoteRides, REPLY_S)
        return RidesReply(found, _now() - sent_at)

    async def ticket(self) -> Ticket:
        """Request a ticket for one command. Raises SiteSilent, BadReply and SiteRefused."""
        return await self._request("ticket", LiftsRequest(), Ticket, REPLY_S)

    async def command(self, message: CommandMessage) -> CommandResult:
        """Send a command. Raises SiteSilent and BadReply, after which it may have been carried out, and SiteRefused."""
        return await self._request("command", message, CommandResult, COMMAND_REPLY_S)

    async def _request(self, kind: str, message: BaseModel, model: type[Reply], within_s: float) -> Reply:
        from nats.errors import Error, NoRespondersError, OutboundBufferLimitError  # noqa: PLC0415

        if self.state in (SiteState.FLOODING, SiteState.OFF):
            raise SiteSilent(f"{self.id} is {self.state}, so nothing is sent to it", was_sent=False)
        data = message.model_dump_json().encode()
        try:
            reply = await self._connection.client.request(subjects.request(self.id, kind), data, timeout=within_s)
        except NoRespondersError as error:
            raise SiteSilent(f"{self.id} is not connected", was_sent=False) from error
        except OutboundBufferLimitError as error:
            raise SiteSilent("the hub has no connection to its NATS server", was_sent=False) from error
        except (Error, TimeoutError) as error:
            raise_if_cancelled()
            raise SiteSilent(f"{self.id} did not reply within {within_s:g} s", was_sent=True) from error
        try:
            if reply.headers and reply.headers.get("Lift-Manager") == "problem":
                raise SiteRefused(ProblemMessage.model_validate_json(reply.data))
            return model.model_validate_json(reply.data)
        except ValidationError as error:
            self.unreadable += 1
            raise BadReply(f"{self.id} sent a reply that cannot be read") from error

    async def _subscribe(self, subject: str, receive: Callable[[Msg], Awaitable[None]]) -> Subscription:
        from nats.errors import Error  # noqa: PLC0415

        while True:
            try:
                return await self._connection.client.subscribe(subject, cb=receive, pending_msgs_limit=MOST_NEWS)
            except Error as error:
                _log.warning("%s: cannot be subscribed to: %s", self.id, error)
                await asyncio.sleep(1.0)

    async def _unsubscribe(self, subscription: Subscription) -> None:
        from nats.errors import Error  # noqa: PLC0415

        try:
            await subscription.unsubscribe()
        except Error as error:
            _log.debug("%s: %s", self.id, error)  # the connection is gone, and the subscription with it

    async def _receive(self, message: Msg) -> None:
        now = _now()
        if not self._limiter.admits(now):
            self._flooded = True
            return
        try:
            self.news, self._news_at = News.model_validate_json(message.data), now
        except ValidationError:
            self.unreadable += 1
            return
        self._changed.set()

    async def _receive_update(self, message: Msg) -> None:
        """Reply to a request about configuration updates; they count against the same limit as news."""
        from nats.errors import Error  # noqa: PLC0415

        if not self._limiter.admits(_now()):
            self._flooded = True
            return
        kind = message.subject.rpartition(".")[2]
        reply = await self._answer_update(self.id, kind, message.data)
        if reply is not None:
            with suppress(Error):  # the connection is gone, and the site asks again
                await message.respond(reply)

    async def _judge(self, started_at: float) -> None:
        """Turn online or offline."""
        now = _now()
        if now - self._news_at < SILENT_S:
            await self._turn(SiteState.ONLINE, "" if self.news is None else self.news.name)
        elif now - started_at >= SILENT_S:
            await self._turn(SiteState.OFFLINE, f"no news for {SILENT_S:g} s")

    async def _turn(self, state: SiteState, text: str) -> None:
        if state is not self.state:
            self.state = state
            self.times_offline += state is SiteState.OFFLINE
            _log.info("%s: %s%s", self.id, state, f": {text}" if text else "")
            await self._announce(self.id, state, text)

    async def _read_rows(self) -> None:
        """Read the stream whenever there is news of more, from where the hub is."""
        from nats.errors import Error  # noqa: PLC0415

        while True:
            await self._changed.wait()
            self._changed.clear()
            try:
                while await self._read_batch():  # noqa: ASYNC110  it waits for the site
                    await asyncio.sleep(BATCH_GAP_S)
            except (Error, TimeoutError) as error:
                raise_if_cancelled()
                _log.debug("%s: rows cannot be read: %s", self.id, error)  # the next news is the next attempt
                await asyncio.sleep(1.0)
            except sqlite3.Error as error:
                _log.error("%s: rows cannot be stored: %s; they are read again", self.id, error)
                await asyncio.sleep(DISK_RETRY_S)
            await asyncio.sleep(BATCH_GAP_S)

    async def _read_batch(self) -> bool:
        """Read some rows; returns whether there are more."""
        newest = None if self.news is None else self.news.newest
        if newest is None or self.state in (SiteState.FLOODING, SiteState.OFF):
            return False
        at = self.position.at if self.position is not None and self.position.stream == newest.stream else 0
        if at >= newest.at:
            return False
        request = {"seq": at + 1, "batch": BATCH, "max_bytes": BATCH_BYTES}
        rows: list[RowMessage] = []
        last = at
        for message in await self._collect(json.dumps(request).encode()):
            number = _number_of(message)
            if number is None or number <= last:
                self.unreadable += 1
                continue
            last = number
            try:
                rows.append(RowMessage.model_validate_json(message.data))
            except ValidationError:
                self.unreadable += 1
        if last == at:
            return False
        self.rows_read += len(rows)
        position = Position(stream=newest.stream, at=last)
        await self._add_rows(self.id, rows, position)
        self.position = position
        return last < newest.at

    async def _collect(self, request: bytes) -> list[Msg]:
        """Return the messages that a batched direct get returns. A site that sends more than was requested is cut short."""
        client = self._connection.client
        inbox = client.new_inbox()
        subscription = await client.subscribe(inbox, pending_msgs_limit=2 * BATCH)
        found: list[Msg] = []
        try:
            await client.publish(subjects.rows(self.id), request, reply=inbox)
            with cancellable():
                async with asyncio.timeout(REPLY_S):
                    while len(found) < BATCH:
                        message = await subscription.next_msg(timeout=REPLY_S)
                        if (message.headers or {}).get("Status"):
                            break
                        found.append(message)
        finally:
            await self._unsubscribe(subscription)
        return found


def _number_of(message: Msg) -> int | None:
    """Return the number of a message in its stream; None for anything that a NATS server does not send."""
    text = (message.headers or {}).get("Nats-Sequence", "")
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 18 else None


def _now() -> float:
    return asyncio.get_running_loop().time()
