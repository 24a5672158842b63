"""Part of /api/v1: what people say about a lift. Where there are no keys, only this computer may."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from fastapi import APIRouter, Request
from pydantic import BaseModel, ValidationError
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
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.web import people_docs as docs
from lift_manager.web.access import caller, turned_away
from lift_manager.web.body import LingeringResponse, decode_object, read_body
from lift_manager.web.errors import BodyTooLongError, InputError
from lift_manager.web.origin import from_another_site, from_this_computer
from lift_manager.web.problem import problem

Body = TypeVar("Body", bound=BaseModel)


def people_router(facade: LiftFacade) -> APIRouter:
    """Acknowledge, lock out, end a lockout, end the session of whoever holds the lift."""
    # a lift's name may hold a slash
    router = APIRouter(prefix="/api/v1/lifts/{lift:path}", tags=[docs.TAG])

    async def acknowledge(lift: str, request: Request) -> Response:
        def act(body: AcknowledgeRequest) -> BaseModel | Refused:
            said = facade.acknowledge(lift, _signed(request, body.by))
            return said if isinstance(said, Refused) else AcknowledgedAnswer.of(lift, said)

        return await _answer(facade, lift, request, AcknowledgeRequest, act)

    async def lock_out(lift: str, request: Request) -> Response:
        def act(body: LockoutRequest) -> BaseModel | Refused:
            said = facade.lock_out(lift, _signed(request, body.by), body.reason)
            return said if isinstance(said, Refused) else LockoutAnswer.of(lift, said)

        return await _answer(facade, lift, request, LockoutRequest, act)

    async def end_lockout(lift: str, request: Request) -> Response:
        def act(body: EndLockoutRequest) -> BaseModel | Refused:
            said = facade.end_lockout(lift, _signed(request, body.by))
            return said if isinstance(said, Refused) else LockoutEndedAnswer.of(lift, said)

        return await _answer(facade, lift, request, EndLockoutRequest, act)

    async def force_release(lift: str, request: Request) -> Response:
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
    if from_another_site(request):
        facade.turned_away(turned_away(request, "another_site", "a web page of another site asked", lift))
        return problem(
            403, "another_site", "a web page of another site asked; only programs and this manager's own may"
        )
    if caller(request) is None and not from_this_computer(request):
        text = (
            "this site has no keys to tell people by, so only a program on the manager's own computer may say this, to"
            " 127.0.0.1 or the address that the manager listens on, and not through a proxy; use the command line there, or"
            " make keys with `lift-manager keys make`"
        )
        said = "a person's word without a key, from another computer or through a proxy"
        facade.turned_away(turned_away(request, "other_computer", said, lift))
        return problem(403, "other_computer", text)
    try:
        body = form.model_validate(decode_object(await read_body(request)))
    except BodyTooLongError as error:
        return problem(413, "too_long", str(error), kind=LingeringResponse)
    except InputError as error:
        return problem(422, "malformed", f"{error}; expected {_expected(form)}")
    except ValidationError as error:
        field, text = _first(error)
        return problem(422, "malformed", f"{field} {text}; expected {_expected(form)}", field=field)
    answer = act(body)
    if isinstance(answer, Refused):
        status = 404 if answer.code is Refusal.UNKNOWN_LIFT else 409
        return problem(status, answer.code, answer.message)
    return Response(answer.model_dump_json(), headers={"cache-control": "no-store"}, media_type="application/json")


def _expected(form: type[BaseModel]) -> str:
    return "{" + ", ".join(f'"{name}": text' for name in form.model_fields) + "}"


def _first(error: ValidationError) -> tuple[str, str]:
    found: Any = error.errors(include_url=False, include_input=False)[0]
    field = ".".join(str(part) for part in found["loc"])
    match found["type"]:
        case "missing":
            return field, "is missing"
        case "extra_forbidden":
            return field, "is not known here"
        case "string_too_short":
            return field, "must not be empty"
        case "string_too_long":
            return field, f"must not be longer than {found['ctx']['max_length']} characters"
        case "string_type":
            return field, "must be text"
        case _:
            return field, str(found["msg"])
