"""Part of /api/v1: sessions, and what is asked within them."""

from __future__ import annotations

from urllib.parse import quote

from fastapi import APIRouter, Request
from starlette.responses import Response

from lift_manager.api.sessions import (
    CloseRequest,
    Command,
    CommandRequest,
    HandOverRequest,
    OpenSessionRequest,
    RenewRequest,
    Session,
)
from lift_manager.core.facade import Facade
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.keys import Keys
from lift_manager.domain.session_requests import Followed, OpenSession, SessionInfo, SessionRequest
from lift_manager.web import sessions_docs as docs
from lift_manager.web.access import turned_away
from lift_manager.web.answers import recorded, yes
from lift_manager.web.bodies import taken
from lift_manager.web.callers import SESSION_FACE, holder_of, is_of, named, no_shared_key, no_such_heir
from lift_manager.web.guards import no_foreign_page
from lift_manager.web.problem import refused
from lift_manager.web.waiting import wait_s

_NO_SESSION = Refused(
    Refusal.NO_SUCH_SESSION,
    "this lift has no session of that id, and remembers none that this caller opened; open one with POST .../sessions",
)
"""One text for an id that does not exist and for another caller's, so that nobody learns which it is."""


def sessions_router(facade: Facade, keys: Keys) -> APIRouter:
    """Open, read, renew, close and hand over a session; ask within it, and follow what was asked."""
    routes = _Sessions(facade, keys)
    router = APIRouter(prefix="/api/v1/lifts/{lift:path}/sessions", tags=[docs.TAG])
    router.add_api_route("/{session}/commands/{command}", routes.followed, methods=["GET"], **docs.followed())
    router.add_api_route("/{session}", routes.read, methods=["GET"], **docs.read())
    router.add_api_route("", routes.open, methods=["POST"], **docs.open_session())
    router.add_api_route("/{session}/renew", routes.renew, methods=["POST"], **docs.renew())
    router.add_api_route("/{session}/close", routes.close, methods=["POST"], **docs.close())
    router.add_api_route("/{session}/hand-over", routes.hand_over, methods=["POST"], **docs.hand_over())
    router.add_api_route("/{session}/commands", routes.command, methods=["POST"], **docs.command())
    return router


class _Sessions:
    def __init__(self, facade: Facade, keys: Keys) -> None:
        self._facade = facade
        self._keys = keys

    async def open(self, request: Request) -> Response:
        lift: str = request.path_params["lift"]
        if (no := no_foreign_page(self._facade, request, lift)) is not None:
            return no
        body = await taken(request, OpenSessionRequest, may_be_empty=True)
        if isinstance(body, Response):
            return body
        if (no := no_shared_key(request, body.robot, body.idempotency_key)) is not None:
            return no
        holder = holder_of(request, SESSION_FACE, body.robot)
        said = self._facade.open_session(OpenSession(lift, holder, body.idempotency_key or "", body.ttl_s))
        if isinstance(said, Refused):
            return refused(said)
        on_disk = await recorded(self._facade, lift)
        session = Session.of(said.session)
        if not said.anew:
            return yes(session, recorded=on_disk)
        return yes(session, 201, location=f"sessions/{quote(session.id, safe='')}", recorded=on_disk)

    async def read(self, request: Request) -> Response:
        own = self._own(request)
        return own if isinstance(own, Response) else yes(Session.of(own))

    async def renew(self, request: Request) -> Response:
        own = self._own_to_change(request)
        if isinstance(own, Response):
            return own
        body = await taken(request, RenewRequest, may_be_empty=True)
        if isinstance(body, Response):
            return body
        return await self._session(self._facade.renew_session(own.lift, own.id, own.holder, body.ttl_s))

    async def close(self, request: Request) -> Response:
        own = self._own_to_change(request)
        if isinstance(own, Response):
            return own
        body = await taken(request, CloseRequest, may_be_empty=True)
        if isinstance(body, Response):
            return body
        return await self._session(self._facade.close_session(own.lift, own.id, own.holder, body.robot))

    async def hand_over(self, request: Request) -> Response:
        own = self._own_to_change(request)
        if isinstance(own, Response):
            return own
        body = await taken(request, HandOverRequest)
        if isinstance(body, Response):
            return body
        if (no := no_such_heir(request, self._keys, body.to, own.lift)) is not None:
            return no
        to = named(SESSION_FACE, body.to, body.robot)
        return await self._session(self._facade.hand_session_over(own.lift, own.id, own.holder, to))

    async def command(self, request: Request) -> Response:
        own = self._own_to_change(request)
        if isinstance(own, Response):
            return own
        within_s = wait_s(request)
        if isinstance(within_s, Response):
            return within_s
        body = await taken(request, CommandRequest)
        if isinstance(body, Response):
            return body
        said = self._facade.ask_within(
            SessionRequest(
                lift=own.lift,
                session=own.id,
                holder=own.holder,
                do=body.do,
                floor=body.floor,
                hold_door=body.hold_door,
                side=body.door,
                key=body.idempotency_key or "",
            )
        )
        if isinstance(said, Refused):
            return _no(said, "floor" if said.code is Refusal.UNKNOWN_FLOOR else None)
        on_disk = await recorded(self._facade, own.lift)
        return await self._once_ended(own, said.id, within_s, status=202, on_disk=on_disk)

    async def followed(self, request: Request) -> Response:
        own = self._own(request)
        if isinstance(own, Response):
            return own
        within_s = wait_s(request)
        if isinstance(within_s, Response):
            return within_s
        return await self._once_ended(own, request.path_params["command"], within_s, status=200)

    async def _once_ended(
        self, own: SessionInfo, number: str, within_s: float, *, status: int, on_disk: bool = True
    ) -> Response:
        said: Followed | Refused
        if within_s > 0:
            said = await self._facade.until_ended(own.lift, own.id, own.holder, number, within_s)
        else:
            said = self._facade.followed(own.lift, own.id, own.holder, number)
        if isinstance(said, Refused):
            return _no(said)
        location = f"commands/{quote(said.id, safe='')}" if status == 202 else ""
        return yes(Command.of(said), status, location=location, recorded=on_disk)

    async def _session(self, said: SessionInfo | Refused) -> Response:
        if isinstance(said, Refused):
            return _no(said)
        return yes(Session.of(said), recorded=await recorded(self._facade, said.lift))

    def _own_to_change(self, request: Request) -> SessionInfo | Response:
        lift: str = request.path_params["lift"]
        return no_foreign_page(self._facade, request, lift) or self._own(request)

    def _own(self, request: Request) -> SessionInfo | Response:
        """Return the session of the path, if it is the caller's: its id, and the key that opened it, are what tells."""
        lift: str = request.path_params["lift"]
        said = self._facade.session(lift, request.path_params["session"], None)
        if isinstance(said, Refused):
            return _no(said)
        if said.holder.face == SESSION_FACE and is_of(request, said.holder):
            return said
        code = Refusal.NO_SUCH_SESSION
        self._facade.turned_away(turned_away(request, code, "the session is another caller's", lift))
        return _no(_NO_SESSION)


def _no(said: Refused, field: str | None = None) -> Response:
    return refused(_NO_SESSION if said.code is Refusal.NO_SUCH_SESSION else said, field)
