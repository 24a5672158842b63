"""Part of /api/v1: sessions, and what is asked within them."""

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
from lift_manager.web.access import turned_away
from lift_manager.web.answers import marked, naming_field
from lift_manager.web.callers import (
    SESSION_FACE,
    ServedSite,
    holder_of,
    is_of,
    named,
    no_foreign_page,
    refuse_heir,
    refuse_shared_key,
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

TAG = "sessions"
TAG_DESCRIPTION = """
One caller has a lift for itself, and says step by step what it does. Whoever wants a robot brought from floor to floor takes a ride
instead: it does all of this.

- The **id** of a session is its secret: it is told to whoever opened it, and works with the same key alone. For everybody else there
  is no such session.
- The **lease** (`ttl_s`) begins anew with `renew` and with every request. When it ends, everything is let go and the car stays where
  it is. However often it is renewed, a session ends after the site's `max_session_s`.
- **Taken is not done.** A command is answered with 202 and ends `confirmed`, `rejected` or `unconfirmed`; ask for it, or wait with
  `?wait=`. `go_to` is confirmed when the lift has the call: the arrival is to be seen in the lift itself.
- After a **restart** of the manager a session goes on once its holder is heard; `restored` tells.
- In a name made of key and robot, `amr-fleet/amr-7`, the key comes first. Without keys the robot's name is all there is, and
  whoever knows the id of a session commands.
"""

LONGEST_WAIT_S = 30.0
"""Chosen: common proxies and clients give up on an answer after 60 s."""

_NO_SESSION = (
    "this lift has no session of that id, and remembers none that this caller opened; open one with POST .../sessions"
)
"""One text for an id that does not exist and for another caller's, so that nobody learns which it is."""
_BUSY = ("not_recorded", "stopping")
_OF_A_SESSION = (*EVERY_LIFT, "no_such_session")
_CHANGE = (*_OF_A_SESSION, *EVERY_CHANGE, *EVERY_BODY)


async def _own_session(
    lift: LiftName,
    session: Annotated[str, in_path("The id that the answer to `POST .../sessions` told.", "s-4f1d2c")],
    request: Request,
) -> AsyncIterator[SessionInfo]:
    """Yield the session of the path, if it is the caller's: its id, and the key that opened it, are what tells."""
    site = site_of(request)
    try:
        found = site.session(lift, session, None)
        if found.holder.face == SESSION_FACE and is_of(request, found.holder):
            yield found
            return
        site.turned_away(turned_away(request, Refusal.NO_SUCH_SESSION, "the session is another caller's", lift))
    except NotFound as refused:  # of the route as well: it may be forgotten while the body is read
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
            le=LONGEST_WAIT_S,
            description="Seconds to wait for the end: answered as soon as it is no longer pending, or as it is then.",
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
_changes = [Depends(no_foreign_page)]


@router.get(
    "/{session}/commands/{command}",
    summary="What became of it",
    response_description="As it is.",
    responses=problems(*_OF_A_SESSION, "no_such_command", "malformed"),
)
async def followed(
    session: OwnSession,
    command: Annotated[str, in_path("The id that the answer to `POST .../commands` told.", "7")],
    site: ServedSite,
    wait_s: WaitSeconds,
) -> Command:
    """As it is, or with `wait` as soon as it is no longer pending."""
    return Command.of(await _status(site, session, command, wait_s))


@router.get("/{session}", summary="A session", response_description="As it is.", responses=problems(*_OF_A_SESSION))
async def read(session: OwnSession) -> Session:
    """Also one that was over not long ago: `over` says why. Reading renews nothing."""
    return Session.model_validate(session)


@router.post(
    "",
    name="open",
    summary="Take a lift",
    dependencies=_changes,
    status_code=201,
    response_description="It is the caller's.",
    responses={
        201: {"headers": LOCATION},
        200: {"model": Session, "description": "It was already, by this idempotency key."},
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
                "as long as the site gives": {},
                "with an idempotency key, a new one for each session": {"robot": "amr-7", "idempotency_key": "3f1c9a"},
            },
            otherwise=OpenSessionRequest,
        ),
    ],
) -> Session:
    """Nothing is called by it. The body may be left out.

    With an `idempotency_key` that was used before, the answer is that session, and 200; with another `ttl_s` than then it is refused.
    Without keys of the site it needs a `robot`.
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
    summary="Keep the lift",
    dependencies=_changes,
    response_description="It goes on.",
    responses=problems(*_CHANGE, *NOT_FREE, "session_over", "not_now", "too_often", *_BUSY),
)
async def renew(
    session: OwnSession,
    site: ServedSite,
    body: Annotated[
        RenewRequest, in_body({"a minute more": {"ttl_s": 60}, "as long as it was": {}}, otherwise=RenewRequest)
    ],
) -> Session:
    """The lease begins anew, as long as it was, or as long as `ttl_s` says. A session from before a restart goes on with it."""
    return await _recorded(site, site.renew_session(session.lift, session.id, session.holder, body.ttl_s))


@router.post(
    "/{session}/close",
    summary="Give the lift back",
    dependencies=_changes,
    response_description="It is over.",
    responses=problems(*_CHANGE, "not_now", "not_possible", "session_over", *_BUSY),
)
async def close(
    session: OwnSession,
    site: ServedSite,
    body: Annotated[
        CloseRequest, in_body({"the robot is out": {"robot": "left"}, "no word": {}}, otherwise=CloseRequest)
    ],
) -> Session:
    """Everything is let go, and the car is not moved. One that is over is answered as it is.

    `robot: left` says that the robot is out; without it, a car that the robot may have entered stays `maybe occupied`.
    """
    return await _recorded(site, site.close_session(session.lift, session.id, session.holder, body.robot))


@router.post(
    "/{session}/hand-over",
    summary="Give the session to another caller",
    dependencies=_changes,
    response_description="It is the other's.",
    responses=problems(*_CHANGE, *NOT_FREE, "not_held", "session_over", "not_now", *_BUSY),
)
async def hand_over(
    session: OwnSession,
    request: Request,
    site: ServedSite,
    body: Annotated[HandOverRequest, in_body({"to another robot": {"to": "amr-8"}})],
) -> Session:
    """Car and door stay as they are.

    The session gets a new id: pass it on to the one who goes on with it, whose key it needs. With keys, `to` is the name of a live key
    that may command this lift. If nobody renews the session, its lease ends.
    """
    refuse_heir(request, request.app.state.keys, body.to, session.lift)
    to = named(SESSION_FACE, body.to, body.robot)
    return await _recorded(site, site.hand_session_over(session.lift, session.id, session.holder, to))


@router.post(
    "/{session}/commands",
    summary="Ask for one thing",
    dependencies=_changes,
    status_code=202,
    response_description="It is taken; `status` says how far it is.",
    responses={
        202: {"headers": LOCATION},
        **problems(
            *(*_CHANGE, *NOT_FREE, "unknown_floor", "no_such_command", "session_over", "not_now", "key_reused"),
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
    """`go_to` a floor, `hold_door`, `let_go_door`, `close_door`, or the words `robot_in_place` and `robot_left`.

    Every request renews the lease. With an `idempotency_key` that was used before in this session, the answer is that command as it is;
    for another command the key is refused.
    """
    given = commands.CommandRequest(
        session=session.id,
        holder=session.holder,
        kind=body.do,
        floor=body.floor,
        hold_door=body.hold_door,
        side=body.door,
        key=body.idempotency_key or "",
    )
    with naming_field({Refusal.UNKNOWN_FLOOR: "floor"}):
        taken = site.command(session.lift, given)
    is_recorded = await site.recorded(session.lift)
    response.headers["location"] = f"commands/{quote(taken.id, safe='')}"
    return marked(Command.of(await _status(site, session, taken.id, wait_s)), recorded=is_recorded)


async def _status(site: Site, session: SessionInfo, command: str, wait_s: float) -> CommandStatus:
    if wait_s > 0:
        return await site.until_ended(session.lift, session.id, session.holder, command, wait_s)
    return site.command_status(session.lift, session.id, session.holder, command)


async def _recorded(site: Site, session: SessionInfo) -> Session:
    return marked(Session.model_validate(session), recorded=await site.recorded(session.lift))
