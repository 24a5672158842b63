"""Part of /api/v1: what people say about a lift. Where there are no keys, only this computer may."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi import APIRouter, Request
from pydantic import BaseModel
from starlette.responses import Response

from lift_manager.api.people import (
    AcknowledgedAnswer,
    AcknowledgeRequest,
    DrainAnswer,
    DrainEndedAnswer,
    DrainRequest,
    EndDrainRequest,
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
from lift_manager.web.answers import recorded, yes
from lift_manager.web.bodies import Body, taken
from lift_manager.web.guards import no_foreign_page, no_other_computer
from lift_manager.web.problem import refused

_Act = Callable[[str, Request, Body], BaseModel | Refused]
"""What is done on a lift for the request of a person, whose body was read."""


def people_router(facade: LiftFacade) -> APIRouter:
    """Acknowledge, lock out, drain, end either, end the session of whoever holds the lift."""
    # a lift's name may hold a slash
    router = APIRouter(prefix="/api/v1/lifts/{lift:path}", tags=[docs.TAG])

    def post(path: str, name: str, form: type[Body], act: _Act[Body], about: dict[str, Any]) -> None:
        async def take(request: Request) -> Response:
            lift: str = request.path_params["lift"]
            return await _answer(facade, lift, request, form, lambda body: act(lift, request, body))

        router.add_api_route(path, take, methods=["POST"], name=name, **about)

    def acknowledge(lift: str, request: Request, body: AcknowledgeRequest) -> BaseModel | Refused:
        said = facade.acknowledge(lift, _signed(request, body.by))
        return said if isinstance(said, Refused) else AcknowledgedAnswer.of(lift, said)

    def lock_out(lift: str, request: Request, body: LockoutRequest) -> BaseModel | Refused:
        said = facade.lock_out(lift, _signed(request, body.by), body.reason, at_once=body.now)
        return said if isinstance(said, Refused) else LockoutAnswer.of(lift, said)

    def end_lockout(lift: str, request: Request, body: EndLockoutRequest) -> BaseModel | Refused:
        said = facade.end_lockout(lift, _signed(request, body.by))
        return said if isinstance(said, Refused) else LockoutEndedAnswer.of(lift, said)

    def force_release(lift: str, request: Request, body: ForceReleaseRequest) -> BaseModel | Refused:
        said = facade.force_release(lift, _signed(request, body.by), body.reason, at_once=body.now)
        return said if isinstance(said, Refused) else ForceReleasedAnswer.of(lift, said)

    post("/acknowledge", "acknowledge", AcknowledgeRequest, acknowledge, docs.acknowledge())
    post("/lockout", "lock_out", LockoutRequest, lock_out, docs.lock_out())
    post("/lockout/end", "end_lockout", EndLockoutRequest, end_lockout, docs.end_lockout())
    post("/drain", "begin_drain", DrainRequest, _begin_drain(facade), docs.begin_drain())
    post("/drain/end", "end_drain", EndDrainRequest, _end_drain(facade), docs.end_drain())
    post("/session/force-release", "force_release", ForceReleaseRequest, force_release, docs.force_release())
    return router


def _begin_drain(facade: LiftFacade) -> _Act[DrainRequest]:
    def act(lift: str, request: Request, body: DrainRequest) -> BaseModel | Refused:
        said = facade.begin_drain(lift, _signed(request, body.by), body.reason)
        return said if isinstance(said, Refused) else DrainAnswer.of(lift, said)

    return act


def _end_drain(facade: LiftFacade) -> _Act[EndDrainRequest]:
    def act(lift: str, request: Request, body: EndDrainRequest) -> BaseModel | Refused:
        said = facade.end_drain(lift, _signed(request, body.by))
        return said if isinstance(said, Refused) else DrainEndedAnswer.of(lift, said)

    return act


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
    if isinstance(answer, Refused):
        return refused(answer)
    return yes(answer, recorded=await recorded(facade, lift))
