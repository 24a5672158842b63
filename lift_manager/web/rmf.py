"""Part of /api/v1: what an adapter of Open-RMF reads, and what it passes on of RMF's sessions."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends

from lift_manager.api.rmf import RmfAccepted, RmfEndedRequest, RmfSiteAnswer, RmfWantedRequest
from lift_manager.lift.refusals import STOPPING, Refusal
from lift_manager.lift.rmf import rmf_holder
from lift_manager.runtime.errors import raised
from lift_manager.runtime.rmf import rmf_site
from lift_manager.runtime.site import Site
from lift_manager.web.answers import naming_field
from lift_manager.web.callers import ServedSite, no_foreign_page
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import EVERY_BODY, EVERY_CHANGE, EVERY_LIFT, NOT_FREE, LiftName, in_body, problems

TAG = "rmf"
TAG_DESCRIPTION = """
What an adapter of Open-RMF needs, and nothing else does: with keys it is a key of the role `rmf` that may speak for RMF's sessions.

- A session of RMF ends by `ended` alone: neither arrival nor a request without `hold_door` ends it. It has no lease, for on some
  distributions RMF is silent once the lift is where it is wanted; the site's `max_session_s` bounds it.
- `ended` is taken at any floor, in any mode, of a lift that is offline, and as often as it is said. The car is not moved by it.
  Within `grace_s` the same session may go on as if nothing had been said; others are refused until then.
- Repeats of what is wanted already press nothing and cost no turn.
- Where several RMFs share a manager, each adapter says its id with every request: what one says of a session of another is refused (`held`).
"""

_OF_A_WORD = (*EVERY_LIFT, *EVERY_CHANGE, *EVERY_BODY, "held", "stopping")

router = APIRouter(
    prefix="/api/v1",
    tags=[TAG],
    route_class=JsonRoute,
    strict_content_type=False,
)
_changes = [Depends(no_foreign_page)]


@router.get(
    "/rmf",
    name="site",
    summary="Every lift, for RMF",
    response_description="As it is.",
    responses=problems("stopping"),
)
async def lifts_for_rmf(site: ServedSite) -> RmfSiteAnswer:
    """By RMF's names and the site's, from memory. `event` is the number of the newest event: `/api/v1/events` tells of the next."""
    if site.stopping:
        # nobody holds a lift then, and an adapter would take sessions for over that are kept
        raise raised(STOPPING)
    return RmfSiteAnswer.model_validate(rmf_site(site))


@router.post(
    "/lifts/{lift}/rmf/wanted",
    summary="RMF's session wants the lift at a floor",
    dependencies=_changes,
    response_description="The session holds the lift.",
    responses=problems(*_OF_A_WORD, "unknown_floor", *NOT_FREE, "too_often", "not_recorded"),
)
async def wanted(
    lift: LiftName,
    site: ServedSite,
    body: Annotated[
        RmfWantedRequest, in_body({"AGV mode": {"session_id": "fleet/amr-7", "floor": "L2", "hold_door": True}})
    ],
) -> RmfAccepted:
    """The first one opens the session. Taken is not arrived: the site tells what became of it."""
    holder = rmf_holder(body.session_id, body.adapter)
    with naming_field({Refusal.UNKNOWN_FLOOR: "floor"}):
        site.request(lift, holder, body.floor, hold_door=body.hold_door, stays=True)
    return _taken(site, lift)


@router.post(
    "/lifts/{lift}/rmf/ended",
    summary="RMF's session is over",
    dependencies=_changes,
    response_description="It is over once `grace_s` is.",
    responses=problems(*_OF_A_WORD),
)
async def ended(
    lift: LiftName,
    site: ServedSite,
    body: Annotated[RmfEndedRequest, in_body({"END_SESSION": {"session_id": "fleet/amr-7", "grace_s": 3.0}})],
) -> RmfAccepted:
    """Of a session that is over already the answer is yes."""
    site.end_session(lift, rmf_holder(body.session_id, body.adapter), body.grace_s)
    return _taken(site, lift)


def _taken(site: Site, lift: str) -> RmfAccepted:
    site.freshen(lift)
    return RmfAccepted(boot=site.boot, event=site.newest)
