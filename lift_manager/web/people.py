"""Part of /api/v1: operator actions. On a site without keys, only programs on this computer may send them."""

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
from lift_manager.web.authenticator import caller_key
from lift_manager.web.callers import ServedSite, forbid_foreign_page, forbid_other_computer
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import LiftName, errors_of
from lift_manager.web.replies import Model, with_recorded

TAG = "people"
TAG_DESCRIPTION = """
Decisions of people about a lift. They survive restarts, with the name of the person.

With keys these need the role operator, and the journal has the name of the key next to the given name. A site without keys accepts
them only from the manager's own computer. `lift-manager ack`, `lockout`, `drain` and `release` on the command line use them. Errors
are problem+json (RFC 9457) with a stable `code`.
"""

_ERRORS = {
    403: "A request to a site without keys from another computer (`other_computer`), or from a web page of another site (`another_site`).",
    404: "There is no such lift (`unknown_lift`).",
    413: "The body is too long (`too_long`).",
    422: "The body is not what is expected (`malformed`); `field` names the key.",
    503: "The manager is stopping (`stopping`), or cannot record it (`not_recorded`).",
}

router = APIRouter(
    prefix="/api/v1/lifts/{lift}",
    tags=[TAG],
    route_class=JsonRoute,
    strict_content_type=False,
    dependencies=[Depends(forbid_foreign_page), Depends(forbid_other_computer)],
)


def _action(path: str, summary: str, conflict: str) -> Callable[[DecoratedCallable], DecoratedCallable]:
    """Return the decorator of a route; `conflict` describes its replies with 409."""
    errors = errors_of(_ERRORS | {409: conflict})
    return router.post(path, summary=summary, response_description="It is recorded.", responses=errors)


@_action(
    "/acknowledge",
    "Acknowledge that a lift was checked",
    "The lift still reports a fire (`fire_active`), cannot be read (`offline`), or there is nothing to acknowledge"
    " (`nothing_to_acknowledge`).",
)
async def acknowledge(
    lift: LiftName, request: Request, site: ServedSite, body: AcknowledgeRequest
) -> AcknowledgedAnswer:
    """After a fire, robots are refused until a person has checked the lift and acknowledges it.

    While a session may have left its robot in the car, all others are refused as well. This acknowledges both. It is refused while the
    lift still reports a fire, and while it cannot be read.
    """
    return await _with_recorded(
        site, lift, AcknowledgedAnswer.of(site.acknowledge(lift, _signature(request, body.by, body.stood_at_lift)))
    )


@_action(
    "/lockout",
    "Lock a lift out",
    "It is locked out already (`locked_out`): a second lockout does not replace the first.",
)
async def lock_out(lift: LiftName, request: Request, site: ServedSite, body: LockoutRequest) -> LockoutAnswer:
    """Refuses every robot with this name and reason, and ends the session.

    A door that is held open for a robot stops inviting it at once and is released `clear_s` later (`now`: at once); everything else is
    released at once. A car that moves keeps robot mode until it stands.
    """
    lockout = site.lock_out(lift, _signature(request, body.by, body.stood_at_lift), body.reason, at_once=body.now)
    return await _with_recorded(site, lift, LockoutAnswer.of(lift, lockout))


@_action("/lockout/end", "End a lockout", "It is not locked out (`not_locked_out`).")
async def end_lockout(
    lift: LiftName, request: Request, site: ServedSite, body: EndLockoutRequest
) -> LockoutEndedAnswer:
    """Anybody at the manager's computer can end a lockout, so that a lift does not depend on one person; the journal has who did.

    Only the person who made it should do so, or the one who took over the work.
    """
    return await _with_recorded(
        site, lift, LockoutEndedAnswer.of(site.end_lockout(lift, _signature(request, body.by, body.stood_at_lift)))
    )


@_action(
    "/drain",
    "Drain a lift",
    "There is a drain already (`draining`): a second one does not replace the first.",
)
async def begin_drain(lift: LiftName, request: Request, site: ServedSite, body: DrainRequest) -> DrainAnswer:
    """Current sessions and rides run to their end, and a robot that may be in the car may still request to get out.

    Every other request for a session is refused with this name and reason; rides wait in their queue. It survives a restart.
    """
    drain = site.begin_drain(lift, _signature(request, body.by), body.reason)
    return await _with_recorded(site, lift, DrainAnswer.of(lift, drain))


@_action("/drain/end", "End a drain", "There is no drain (`not_draining`).")
async def end_drain(lift: LiftName, request: Request, site: ServedSite, body: EndDrainRequest) -> DrainEndedAnswer:
    """Ends the drain; waiting rides continue."""
    return await _with_recorded(site, lift, DrainEndedAnswer.of(site.end_drain(lift, _signature(request, body.by))))


@_action("/session/force-release", "Take a lift from its holder", "Nobody holds the lift (`not_held`).")
async def force_release(
    lift: LiftName, request: Request, site: ServedSite, body: ForceReleaseRequest
) -> ForceReleasedAnswer:
    """Ends the session that holds the lift and releases everything; the car is not moved.

    For a holder that no longer responds. A door that is held open for its robot stops inviting it at once and is released `clear_s`
    later (`now`: at once).
    """
    released = site.force_release(lift, _signature(request, body.by), body.reason, at_once=body.now)
    return await _with_recorded(site, lift, ForceReleasedAnswer.of(released))


async def _with_recorded(site: Site, lift: str, changed: Model) -> Model:
    return with_recorded(changed, recorded=await site.recorded(lift))


def _signature(request: Request, by: str, stood_at_lift: bool = False) -> str:  # noqa: FBT001, FBT002  a field of the body
    """Return the person for the journal: the name as given, with the key that vouches for it, and where the person says to have stood."""
    key = caller_key(request)
    known = [] if key is None else [f"key {key.name}"]
    if stood_at_lift:
        known.append("stood at the lift")
    return f"{by} ({', '.join(known)})" if known else by
