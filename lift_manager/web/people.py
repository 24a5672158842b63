"""Part of /api/v1: what people do about a lift. Where there are no keys, only programs on this computer may."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import APIRouter, Depends, Request
from fastapi.types import DecoratedCallable

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
from lift_manager.runtime.site import Site
from lift_manager.web.access import caller
from lift_manager.web.answers import Model, marked
from lift_manager.web.callers import ServedSite, no_foreign_page, no_other_computer
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import LiftName, errors_of

TAG = "people"
TAG_DESCRIPTION = """
What people say about a lift. Each word is kept over restarts, with the name of who gave it.

With keys these need the role operator, and the name of the key is written down beside the name that was said. A site without
keys takes them from the manager's own computer alone. `lift-manager ack`, `lockout`, `drain` and `release` on the command line use
them. Errors are problem+json (RFC 9457) with a stable `code`.
"""

_ERRORS = {
    403: "Another computer asked a site without keys (`other_computer`), or another site's web page asked (`another_site`).",
    404: "There is no such lift (`unknown_lift`).",
    413: "The body is too long (`too_long`).",
    422: "The body is not what is expected (`malformed`); `field` names the key.",
    503: "The manager is about to end (`stopping`), or cannot write it down (`not_recorded`).",
}

router = APIRouter(
    prefix="/api/v1/lifts/{lift}",
    tags=[TAG],
    route_class=JsonRoute,
    strict_content_type=False,
    dependencies=[Depends(no_foreign_page), Depends(no_other_computer)],
)


def _action(path: str, summary: str, conflict: str) -> Callable[[DecoratedCallable], DecoratedCallable]:
    """Return the decorator of a route; `conflict` says when it is answered with 409."""
    errors = errors_of(_ERRORS | {409: conflict})
    return router.post(path, summary=summary, response_description="It is noted.", responses=errors)


@_action(
    "/acknowledge",
    "The lift was checked",
    "The lift still tells of a fire (`fire_active`), cannot be read (`offline`), or there is nothing to acknowledge"
    " (`nothing_to_acknowledge`).",
)
async def acknowledge(
    lift: LiftName, request: Request, site: ServedSite, body: AcknowledgeRequest
) -> AcknowledgedAnswer:
    """After a fire robots are refused until a person has checked the lift and says so.

    So are all others while a robot may be in the car that a session left there. This says both. It is refused while the lift still tells
    of a fire, and while it cannot be read, for then nobody knows.
    """
    return await _noted(site, lift, AcknowledgedAnswer.of(site.acknowledge(lift, _signed(request, body.by))))


@_action(
    "/lockout",
    "Keep robots off the lift",
    "It is locked out already (`locked_out`): a second word does not cover up the first.",
)
async def lock_out(lift: LiftName, request: Request, site: ServedSite, body: LockoutRequest) -> LockoutAnswer:
    """Refuses every robot with this name and reason, and ends the session.

    A door that is held open for a robot stops inviting it at once and is released `clear_s` later (`now`: at once); everything else is
    released at once. A car that moves keeps robot mode until it stands.
    """
    lockout = site.lock_out(lift, _signed(request, body.by), body.reason, at_once=body.now)
    return await _noted(site, lift, LockoutAnswer.of(lift, lockout))


@_action("/lockout/end", "Let robots on the lift again", "It is not locked out (`not_locked_out`).")
async def end_lockout(
    lift: LiftName, request: Request, site: ServedSite, body: EndLockoutRequest
) -> LockoutEndedAnswer:
    """Anybody at the manager's computer can end a lockout, so that a lift is not lost with a person; who did is written down.

    Let only the person who made it do so, or who took the work over.
    """
    return await _noted(site, lift, LockoutEndedAnswer.of(site.end_lockout(lift, _signed(request, body.by))))


@_action(
    "/drain",
    "Let sessions end and no new one begin",
    "There is a drain already (`draining`): a second one does not replace the first.",
)
async def begin_drain(lift: LiftName, request: Request, site: ServedSite, body: DrainRequest) -> DrainAnswer:
    """A session that goes on is not touched, its ride goes to its end, and a robot that may be in the car may still ask to get out.

    Every other request for a session is refused with this name and reason; rides wait in their queue. It survives a restart.
    """
    drain = site.begin_drain(lift, _signed(request, body.by), body.reason)
    return await _noted(site, lift, DrainAnswer.of(lift, drain))


@_action("/drain/end", "Let sessions begin again", "There is no drain (`not_draining`).")
async def end_drain(lift: LiftName, request: Request, site: ServedSite, body: EndDrainRequest) -> DrainEndedAnswer:
    """Ends the drain; rides that wait go on."""
    return await _noted(site, lift, DrainEndedAnswer.of(site.end_drain(lift, _signed(request, body.by))))


@_action("/session/force-release", "Take a lift from its holder", "Nobody holds the lift (`not_held`).")
async def force_release(
    lift: LiftName, request: Request, site: ServedSite, body: ForceReleaseRequest
) -> ForceReleasedAnswer:
    """Ends the session of whoever holds the lift and lets everything go; the car is not moved.

    For a holder that does not answer any more. A door that is held open for its robot stops inviting it at once and is released `clear_s`
    later (`now`: at once).
    """
    released = site.force_release(lift, _signed(request, body.by), body.reason, at_once=body.now)
    return await _noted(site, lift, ForceReleasedAnswer.of(released))


async def _noted(site: Site, lift: str, changed: Model) -> Model:
    return marked(changed, recorded=await site.recorded(lift))


def _signed(request: Request, by: str) -> str:
    """Return who acts: the name as it was given, and whose key vouches for it."""
    key = caller(request)
    return by if key is None else f"{by} (key {key.name})"
