"""Part of /api/v1: sessions and their commands."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Depends, Query, Request, Response

from lift_manager.api.sessions import (
    CloseRequest,
    Command,
    CommandRequest,
    HandOverRequest,
    OpenSessionRequest,
    RenewRequest,
    Session,
)
from lift_manager.lift import commands
from lift_manager.lift.commands import CommandStatus, SessionInfo
from lift_manager.lift.refusals import Refusal
from lift_manager.runtime.errors import NotFound
from lift_manager.runtime.site import Site
from lift_manager.web.authenticator import face_refusal
from lift_manager.web.callers import (
    SESSION_FACE,
    ServedSite,
    belongs_to_caller,
    forbid_foreign_page,
    holder_named,
    holder_of,
    refuse_shared_key,
    require_successor_key,
    site_of,
)
from lift_manager.web.errors import RequestError
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import (
    EVERY_BODY,
    EVERY_CHANGE,
    EVERY_LIFT,
    LOCATION,
    NOT_FREE,
    LiftName,
    in_body,
    in_path,
    problems,
)
from lift_manager.web.query import require_once
from lift_manager.web.replies import naming_field, with_recorded

TAG = "sessions"
TAG_DESCRIPTION = """
A session gives one caller exclusive use of a lift, step by step. To move a robot from one floor to another, use a ride, which does all
of this.

- The **id** of a session is a secret: only the caller that opened it gets it, and it works only with the same key. For everybody else
  there is no such session.
- The **lease** (`ttl_s`) restarts with `renew` and with every request. When it ends, everything is released and the car stays where
  it is. However often it is renewed, a session ends after the site's `max_session_s`.
- **Accepted is not done.** A command gets 202 and ends `confirmed`, `rejected` or `unconfirmed`; poll it, or wait with `?wait=`.
  `go_to` is confirmed when the lift has the call: the arrival shows in the state of the lift.
- After a **restart** of the manager a session continues with the first request of its holder; until then `restored` is set.
- In a name made of key and robot, `amr-fleet/amr-7`, the key comes first. Without keys there is only the name of the robot, and
  any caller that knows the id of a session commands it.
"""

MAX_WAIT_S = 30.0
"""Chosen: common proxies and clients give up on a reply after 60 s."""

_NO_SESSION = "this lift has no session of that id that this caller opened, or it ended too long ago; open one with POST .../sessions"
"""The same text for an unknown id and for the session of another caller, so that it does not reveal which."""
_BUSY = ("not_recorded", "stopping")
_SESSION_CODES = (*EVERY_LIFT, "no_such_session")
_CHANGE_CODES = (*_SESSION_CODES, *EVERY_CHANGE, *EVERY_BODY)


async def _own_session(
    lift: LiftName,
    session: Annotated[str, in_path("The id from the reply to `POST .../sessions`.", "s-4f1d2c")],
    request: Request,
) -> AsyncIterator[SessionInfo]:
    """Yield the session in the path, if the caller knows its id and has the key that opened it."""
    site = site_of(request)
    try:
        found = site.session(lift, session, None)
        if found.holder.face == SESSION_FACE and belongs_to_caller(request, found.holder):
            yield found
            return
        site.turned_away(face_refusal(request, Refusal.NO_SUCH_SESSION, "the session is another caller's", lift))
    except NotFound as refused:  # also raised by the route: the session may be forgotten while the body is read
        if refused.code is not Refusal.NO_SUCH_SESSION:
            raise
    raise RequestError(Refusal.NO_SUCH_SESSION, _NO_SESSION)


OwnSession = Annotated[SessionInfo, Depends(_own_session)]


async def _wait_s(
    request: Request,
    wait: Annotated[
        float,
        Query(
            ge=0,
            le=MAX_WAIT_S,
            description="Seconds to wait for the outcome: the reply comes once the command is no longer pending, or after this time.",
            examples=[5],
        ),
    ] = 0,
) -> float:
    require_once(request, "wait")
    return wait


WaitSeconds = Annotated[float, Depends(_wait_s)]

router = APIRouter(
    prefix="/api/v1/lifts/{lift}/sessions",
    tags=[TAG],
    route_class=JsonRoute,
    strict_content_type=False,
)
_changes = [Depends(forbid_foreign_page)]


@router.get(
    "/{session}/commands/{command}",
    summary="The outcome of a command",
    response_description="As it is.",
    responses=problems(*_SESSION_CODES, "no_such_command", "malformed"),
)
async def followed(
    session: OwnSession,
    command: Annotated[str, in_path("The id from the reply to `POST .../commands`.", "7")],
    site: ServedSite,
    wait_s: WaitSeconds,
) -> Command:
    """As it is, or with `wait` as soon as it is no longer pending."""
    return Command.of(await _status(site, session, command, wait_s))


@router.get("/{session}", summary="A session", response_description="As it is.", responses=problems(*_SESSION_CODES))
async def read(session: OwnSession) -> Session:
    """Also one that ended recently: `over` says why. Reading does not renew the lease."""
    return Session.model_validate(session)


@router.post(
    "",
    name="open",
    summary="Open a session",
    dependencies=_changes,
    status_code=201,
    response_description="The caller holds the lift.",
    responses={
        201: {"headers": LOCATION},
        200: {"model": Session, "description": "The session that this idempotency key opened before."},
        **problems(
            *(*EVERY_LIFT, *EVERY_CHANGE, *EVERY_BODY, *NOT_FREE, "not_now", "key_reused", "too_often", *_BUSY),
        ),
    },
)
async def open_session(
    lift: LiftName,
    request: Request,
    response: Response,
    site: ServedSite,
    body: Annotated[
        OpenSessionRequest,
        in_body(
            {
                "a minute at a time": {"robot": "amr-7", "ttl_s": 60},
                "as long as the site allows": {},
                "with an idempotency key, a new one for each session": {"robot": "amr-7", "idempotency_key": "3f1c9a"},
            },
            otherwise=OpenSessionRequest,
        ),
    ],
) -> Session:
    """Does not call the lift. The body is optional.

    A repeated `idempotency_key` returns its session with 200, and is refused with a different `ttl_s`. On a site without keys it needs a
    `robot`.
    """
    refuse_shared_key(request, body.robot, body.idempotency_key)
    holder = holder_of(request, SESSION_FACE, body.robot)
    opened = site.open_session(lift, holder, key=body.idempotency_key or "", ttl_s=body.ttl_s)
    if opened.is_new:
        response.headers["location"] = f"sessions/{quote(opened.session.id, safe='')}"
    else:
        response.status_code = 200
    return await _recorded(site, opened.session)


@router.post(
    "/{session}/renew",
    summary="Renew the lease",
    dependencies=_changes,
    response_description="The lease is renewed.",
    responses=problems(*_CHANGE_CODES, *NOT_FREE, "session_over", "not_now", "too_often", *_BUSY),
)
async def renew(
    session: OwnSession,
    site: ServedSite,
    body: Annotated[RenewRequest, in_body({"another minute": {"ttl_s": 60}, "as before": {}}, otherwise=RenewRequest)],
) -> Session:
    """Restarts the lease, with its previous duration or with `ttl_s`. A session from before a restart continues with it."""
    return await _recorded(site, site.renew_session(session.lift, session.id, session.holder, body.ttl_s))


@router.post(
    "/{session}/close",
    summary="Close a session",
    dependencies=_changes,
    response_description="It is over.",
    responses=problems(*_CHANGE_CODES, "not_now", "not_possible", "session_over", *_BUSY),
)
async def close(
    session: OwnSession,
    site: ServedSite,
    body: Annotated[
        CloseRequest, in_body({"the robot is out": {"robot": "left"}, "without a report": {}}, otherwise=CloseRequest)
    ],
) -> Session:
    """Releases everything and does not move the car. A session that is over is returned as it is.

    `robot: left` reports that the robot is out; without it, a car that the robot may have entered stays `maybe occupied`.
    """
    return await _recorded(site, site.close_session(session.lift, session.id, session.holder, body.robot))


@router.post(
    "/{session}/hand-over",
    summary="Give the session to another caller",
    dependencies=_changes,
    response_description="The other caller holds the lift.",
    responses=problems(*_CHANGE_CODES, *NOT_FREE, "not_held", "session_over", "not_now", *_BUSY),
)
async def hand_over(
    session: OwnSession,
    request: Request,
    site: ServedSite,
    body: Annotated[HandOverRequest, in_body({"to another robot": {"to": "amr-8"}})],
) -> Session:
    """Car and door stay as they are.

    The session gets a new id: pass it on to the new holder, whose key it needs. With keys, `to` is the name of a live key that may
    command this lift. If nobody renews the session, its lease ends.
    """
    require_successor_key(request, request.app.state.keys, body.to, session.lift)
    to = holder_named(SESSION_FACE, body.to, body.robot)
    return await _recorded(site, site.hand_session_over(session.lift, session.id, session.holder, to))


@router.post(
    "/{session}/commands",
    summary="Send a command",
    dependencies=_changes,
    status_code=202,
    response_description="It is accepted; `status` shows its progress.",
    responses={
        202: {"headers": LOCATION},
        **problems(
            *(*_CHANGE_CODES, *NOT_FREE, "unknown_floor", "no_such_command", "session_over", "not_now", "key_reused"),
            *("too_often", *_BUSY),
        ),
    },
)
async def command(
    session: OwnSession,
    response: Response,
    site: ServedSite,
    body: Annotated[
        CommandRequest,
        in_body(
            {
                "come, and hold the door": {"do": "go_to", "floor": "L2"},
                "close the front door": {"do": "close_door", "door": "front", "clear": True},
                "the robot is inside": {"do": "robot_in_place"},
            }
        ),
    ],
    wait_s: WaitSeconds,
) -> Command:
    """`go_to` a floor, `hold_door`, `let_go_door`, `close_door`, or the reports `robot_in_place` and `robot_left`.

    Every command renews the lease. A repeated `idempotency_key` of this session returns its command, and is refused for a different one.
    """
    request_given = commands.CommandRequest(
        session=session.id,
        holder=session.holder,
        kind=body.do,
        floor=body.floor,
        hold_door=body.hold_door,
        side=body.door,
        key=body.idempotency_key or "",
    )
    with naming_field({Refusal.UNKNOWN_FLOOR: "floor"}):
        accepted = site.command(session.lift, request_given)
    is_recorded = await site.recorded(session.lift)
    response.headers["location"] = f"commands/{quote(accepted.id, safe='')}"
    return with_recorded(Command.of(await _status(site, session, accepted.id, wait_s)), recorded=is_recorded)


async def _status(site: Site, session: SessionInfo, command: str, wait_s: float) -> CommandStatus:
    if wait_s > 0:
        return await site.until_ended(session.lift, session.id, session.holder, command, wait_s)
    return site.command_status(session.lift, session.id, session.holder, command)


async def _recorded(site: Site, session: SessionInfo) -> Session:
    return with_recorded(Session.model_validate(session), recorded=await site.recorded(session.lift))
