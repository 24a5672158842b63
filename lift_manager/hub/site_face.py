"""The face of a running manager towards the hub: reports that it runs, shows its lifts, and takes commands if the site opts in.

Everything goes over the site's own leaf node. Nothing here waits for the hub, and nothing else of the manager waits for this.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import BaseModel, ValidationError

from lift_manager.api.lifts import Lift
from lift_manager.hub import subjects
from lift_manager.hub.commands import Commands, Signers
from lift_manager.hub.connection import Connection
from lift_manager.hub.errors import SiteRefused
from lift_manager.hub.messages import (
    NEWS_EVERY_S,
    CommandMessage,
    LiftsRequest,
    News,
    ProblemMessage,
    RemoteLift,
    RemoteLifts,
    RemoteRide,
    RemoteRides,
    RidesRequest,
    Ticket,
)
from lift_manager.hub.outbox import Outbox
from lift_manager.hub.rate_limiter import RateLimiter
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.state import Quality
from lift_manager.plain.version import running_version
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.site import Site
from lift_manager.web.error_codes import CODES

if TYPE_CHECKING:
    from nats.aio.msg import Msg

    from lift_manager.hub.update.follower import Follower

NEWS_GAP_S = 0.1
"""The shortest time between two reports, however many rows there are. Chosen: the hub reads them all at once."""

MOST_REQUESTS = 50
"""Requests of a kind that are carried out within a second. Chosen: more than people send, and a hundredth of a core."""
MOST_WAITING = 64
"""Requests of a kind that wait; more are dropped before they are read."""
HUB_REPLY_S = 10.0
"""How long the hub may take to reply with a part of an update. Chosen: 256 KB over a modem."""
RETRY_S = 2.0
"""How long to wait after a failure."""

_log = logging.getLogger(__name__)

NO_COMMANDS = "this site takes no commands from the hub; its site file would have to say `hub: {commands: true}`"


@dataclass(frozen=True, slots=True)
class HubSettings:
    """How a manager reaches its leaf node."""

    site: str
    """The id of the site at the hub."""
    server: str
    """The URL of the leaf node."""
    password: str
    """For the leaf node."""
    commands: bool
    """Whether the site takes commands from the hub."""
    journal: Path
    """The store of the site."""
    updates: Follower | None = None
    """Takes configuration updates; None if the site takes none."""


class SiteFace:
    """Serves the hub as long as `run` runs."""

    def __init__(self, settings: HubSettings, name: str, site: Site, signers: Signers | None) -> None:
        """`name` is that of the site file. Without `signers` there are no commands: nobody could sign one."""
        self._settings, self._name, self._site = settings, name, site
        self._connection = Connection("hub", (settings.server,), "manager", settings.password)
        self._commands = Commands(settings.site, site, signers) if settings.commands and signers is not None else None

    async def run(self) -> None:
        """Serve until cancelled. Without a leaf node the manager runs as it would without a hub."""
        from nats.errors import Error  # noqa: PLC0415  loaded only where there is a hub

        while True:
            try:
                await self._run_once()
            except* (Error, OSError, TimeoutError) as group:
                _log.warning("hub: %s; it is tried again", group.exceptions[0])
            # logged and not raised: the lifts do not depend on a hub, so what it sends must not stop them
            except* Exception:  # noqa: BLE001
                _log.exception(
                    "hub: a bug; the connection to the hub is made again, and the lifts are served as before"
                )
            await asyncio.sleep(RETRY_S)

    async def _run_once(self) -> None:
        try:
            await self._connection.open()
            self._connection.warn_of_old_server()
            for kind, reply in (
                ("lifts", self._lifts),
                ("rides", self._rides),
                ("ticket", self._ticket),
                ("command", self._command),
            ):
                await self._serve(kind, reply)
            outbox = Outbox(self._settings.site, self._settings.journal, self._connection)
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(outbox.run())
                tasks.create_task(self._report_news(outbox))
                if self._settings.updates is not None:
                    tasks.create_task(self._settings.updates.request_updates(self._request_of_hub))
        finally:
            await self._connection.close()

    async def _serve(self, kind: str, reply: Callable[[bytes], Awaitable[BaseModel]]) -> None:
        """Reply to requests of a kind, one after the other. Whoever has the hub cannot keep the manager from its lifts with them."""
        limiter = RateLimiter(MOST_REQUESTS, 1.0)

        async def respond(message: Msg) -> None:
            headers: dict[str, str] | None = _PROBLEM
            try:
                if not limiter.admits(_now()):
                    raise SiteRefused(_TOO_OFTEN)  # noqa: TRY301  refusals have one place below
                answer, headers = (await reply(message.data)).model_dump_json(by_alias=True), None
            except RequestRefused as refused:
                problem = ProblemMessage(
                    code=refused.code, status=CODES[refused.code].status, message=refused.message[:4000]
                )
                answer = problem.model_dump_json()
            except SiteRefused as refused:
                answer = refused.problem.model_dump_json()
            except ValidationError as error:
                text = f"the request of the hub cannot be read: {error.errors(include_url=False, include_input=False)[0]['msg']}"
                answer = ProblemMessage(code="malformed", status=422, message=text).model_dump_json()
            except Exception as bug:  # noqa: BLE001  it is logged; nats-py would drop its traceback
                _log.error("hub: a request of the hub failed (%s)", kind, exc_info=bug)
                text = "a bug in the manager of the site; its log has the details"
                answer = ProblemMessage(code="internal_error", status=500, message=text).model_dump_json()
            await self._publish(message.reply, answer, headers)

        await self._connection.client.subscribe(
            subjects.request(self._settings.site, kind), cb=respond, pending_msgs_limit=MOST_WAITING
        )

    async def _publish(self, subject: str, text: str, headers: dict[str, str] | None = None) -> None:
        """Send something; where the leaf node is away it is lost: what is late is wrong."""
        from nats.errors import Error  # noqa: PLC0415

        with suppress(Error):
            await self._connection.client.publish(subject, text.encode(), headers=headers)

    async def _request_of_hub(self, kind: str, data: bytes) -> bytes:
        """Send a request about updates. Raises HubSilent."""
        site = self._settings.site
        return await self._connection.request(subjects.update(site, kind), data, subjects.inbox(site), HUB_REPLY_S)

    async def _lifts(self, data: bytes) -> RemoteLifts:
        request = LiftsRequest.model_validate_json(data)
        names = self._site.lift_names() if request.lift is None else (request.lift,)
        shown = []
        for name in names:
            state = self._site.state(name)
            max_age_s = self._site.config(name).capabilities.max_age_s
            shown.append(RemoteLift.of(Lift.of(state, max_age_s=max_age_s)))
        return RemoteLifts(lifts=tuple(shown))

    async def _rides(self, data: bytes) -> RemoteRides:
        request = RidesRequest.model_validate_json(data)
        rides = self._site.rides.all() if request.ride is None else (self._site.rides.ride(request.ride),)
        return RemoteRides(rides=tuple(map(RemoteRide.of, rides)))

    async def _ticket(self, data: bytes) -> Ticket:
        return Ticket(ticket=self._require_commands().tickets.issue(_ticket_clock()))

    async def _command(self, data: bytes) -> BaseModel:
        received_at = _ticket_clock()
        commands = self._require_commands()
        return await commands.carry_out(CommandMessage.model_validate_json(data), received_at)

    def _require_commands(self) -> Commands:
        if self._commands is None:
            raise SiteRefused(ProblemMessage(code="monitor_only", status=409, message=NO_COMMANDS))
        return self._commands

    async def _report_news(self, outbox: Outbox) -> None:
        """Report every NEWS_EVERY_S, and soon after there are new rows in the stream."""
        while True:
            outbox.changed.clear()
            names = self._site.lift_names()
            news = News(
                name=self._name,
                version=running_version()[:64],
                lifts=len(names),
                live=sum(self._site.state(name).quality is Quality.LIVE for name in names),
                commands=self._commands is not None,
                newest=outbox.newest,
            )
            if self._connection.is_up:
                await self._publish(subjects.news(self._settings.site), news.model_dump_json())
            await asyncio.sleep(NEWS_GAP_S)
            with suppress(TimeoutError):
                async with asyncio.timeout(NEWS_EVERY_S - NEWS_GAP_S):
                    await outbox.changed.wait()


_TOO_OFTEN = ProblemMessage(
    code=Refusal.TOO_OFTEN,
    status=429,
    message=f"the site carries out {MOST_REQUESTS} requests of the hub within a second, and no more; nothing was done",
)
_PROBLEM = {"Lift-Manager": "problem"}
"""Marks a reply that is a ProblemMessage."""


def _ticket_clock() -> float:
    """Seconds of a clock that nobody sets, and that goes on while this computer sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def _now() -> float:
    return asyncio.get_running_loop().time()
