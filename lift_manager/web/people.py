"""Part of /api/v1: what people say about a lift. Where there are no keys, only this computer may."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import APIRouter, Request
from pydantic import BaseModel
from starlette.responses import Response

from lift_manager.api.people import (
    AcknowledgedAnswer,
    AcknowledgeRequest,
    EndLockoutRequest,
    ForceReleasedAnswer,
    ForceReleaseRequest,
    LockoutAnswer,
    LockoutEndedAnswer,
    LockoutRequest,
)
from lift_manager.core.facade import LiftFacade
from lift_manager.domain.asking import Refused
from lift_manager.web import people_docs as docs
from lift_manager.web.access import caller
from lift_manager.web.answers import yes
from lift_manager.web.bodies import Body, taken
from lift_manager.web.guards import no_foreign_page, no_other_computer
from lift_manager.web.problem import refused


def people_router(facade: LiftFacade) -> APIRouter:
    """Acknowledge, lock out, end a lockout, end the session of whoever holds the lift."""
    # a lift's name may hold a slash
    router = APIRouter(prefix="/api/v1/lifts/{lift:path}", tags=[docs.TAG])

    async def acknowledge(request: Request) -> Response:
        lift: str = request.path_params["lift"]

        def act(body: AcknowledgeRequest) -> BaseModel | Refused:
            said = facade.acknowledge(lift, _signed(request, body.by))
            return said if isinstance(said, Refused) else AcknowledgedAnswer.of(lift, said)

        return await _answer(facade, lift, request, AcknowledgeRequest, act)

    async def lock_out(request: Request) -> Response:
        lift: str = request.path_params["lift"]

        def act(body: LockoutRequest) -> BaseModel | Refused:
            said = facade.lock_out(lift, _signed(request, body.by), body.reason)
            return said if isinstance(said, Refused) else LockoutAnswer.of(lift, said)

        return await _answer(facade, lift, request, LockoutRequest, act)

    async def end_lockout(request: Request) -> Response:
        lift: str = request.path_params["lift"]

        def act(body: EndLockoutRequest) -> BaseModel | Refused:
            said = facade.end_lockout(lift, _signed(request, body.by))
            return said if isinstance(said, Refused) else LockoutEndedAnswer.of(lift, said)

        return await _answer(facade, lift, request, EndLockoutRequest, act)

    async def force_release(request: Request) -> Response:
        lift: str = request.path_params["lift"]

        def act(body: ForceReleaseRequest) -> BaseModel | Refused:
            said = facade.force_release(lift, _signed(request, body.by), body.reason)
            return said if isinstance(said, Refused) else ForceReleasedAnswer.of(lift, said)

        return await _answer(facade, lift, request, ForceReleaseRequest, act)

    router.add_api_route("/acknowledge", acknowledge, methods=["POST"], **docs.acknowledge())
    router.add_api_route("/lockout", lock_out, methods=["POST"], **docs.lock_out())
    router.add_api_route("/lockout/end", end_lockout, methods=["POST"], **docs.end_lockout())
    router.add_api_route("/session/force-release", force_release, methods=["POST"], **docs.force_release())
    return router


def _signed(request: Request, by: str) -> str:
    """Return who said so: the name as it was given, and whose key vouches for it."""
    key = caller(request)
    return by if key is None else f"{by} (key {key.name})"


async def _answer(
    facade: LiftFacade, lift: str, request: Request, form: type[Body], act: Callable[[Body], BaseModel | Refused]
) -> Response:
    no = no_foreign_page(facade, request, lift) or no_other_computer(facade, request, lift)
    if no is not None:
        return no
    body = await taken(request, form)
    if isinstance(body, Response):
        return body
    answer = act(body)
    return refused(answer) if isinstance(answer, Refused) else yes(answer)
