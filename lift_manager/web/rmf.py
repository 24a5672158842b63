"""Part of /api/v1: what an adapter of Open-RMF reads, and how it passes on the sessions of RMF."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends

from lift_manager.api.rmf import RmfAccepted, RmfEndedRequest, RmfSiteAnswer, RmfWantedRequest
from lift_manager.lift.refusals import STOPPING, Refusal
from lift_manager.lift.rmf_view import rmf_holder
from lift_manager.runtime.errors import raised
from lift_manager.runtime.rmf_view import rmf_site
from lift_manager.runtime.site import Site
from lift_manager.web.callers import ServedSite, forbid_foreign_page
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import EVERY_BODY, EVERY_CHANGE, EVERY_LIFT, NOT_FREE, LiftName, in_body, problems
from lift_manager.web.replies import naming_field

TAG = "rmf"
TAG_DESCRIPTION = """
For adapters of Open-RMF only. On a site with keys, an adapter needs one with the role `rmf`.

- A session of RMF ends only by `ended`: neither an arrival nor a request without `hold_door` ends it. It has no lease, because on some
  distributions RMF is silent once the lift has arrived; the site's `max_session_s` limits it.
- `ended` is accepted at any floor, in any mode, for a lift that is offline, and repeatedly. It does not move the car. Within `grace_s` the
  same session may continue as if nothing had happened; others are refused until then.
- Repeats of the same request press nothing and do not count as changes.
- If several RMFs share a manager, each adapter sends its id with every request: a request about a session of another one is refused (`held`).
"""

_SESSION_CODES = (*EVERY_LIFT, *EVERY_CHANGE, *EVERY_BODY, "held", "stopping")

router = APIRouter(
    prefix="/api/v1",
    tags=[TAG],
    route_class=JsonRoute,
    strict_content_type=False,
)
_changes = [Depends(forbid_foreign_page)]


@router.get(
    "/rmf",
    name="site",
    summary="Every lift, for RMF",
    response_description="As it is.",
    responses=problems("stopping"),
)
async def lifts_for_rmf(site: ServedSite) -> RmfSiteAnswer:
    """By the names of RMF and of the site, from memory. `event` is the number of the newest event; `/api/v1/events` continues there."""
    if site.stopping:
        # no lift has a holder then, and an adapter would take sessions for over that are kept
        raise raised(STOPPING)
    return RmfSiteAnswer.model_validate(rmf_site(site))


@router.post(
    "/lifts/{lift}/rmf/wanted",
    summary="RMF's session wants the lift at a floor",
    dependencies=_changes,
    response_description="The session holds the lift.",
    responses=problems(*_SESSION_CODES, "unknown_floor", *NOT_FREE, "too_often", "not_recorded"),
)
async def request_lift(
    lift: LiftName,
    site: ServedSite,
    body: Annotated[
        RmfWantedRequest, in_body({"AGV mode": {"session_id": "fleet/amr-7", "floor": "L2", "hold_door": True}})
    ],
) -> RmfAccepted:
    """The first request opens the session. Accepted does not mean arrived: the state of the site shows the progress."""
    holder = rmf_holder(body.session_id, body.adapter)
    with naming_field({Refusal.UNKNOWN_FLOOR: "floor"}), site.numbering(lift):
        site.request(lift, holder, body.floor, hold_door=body.hold_door, stays=True)
    return _accepted(site)


@router.post(
    "/lifts/{lift}/rmf/ended",
    summary="RMF's session is over",
    dependencies=_changes,
    response_description="It is over once `grace_s` is.",
    responses=problems(*_SESSION_CODES),
)
async def ended(
    lift: LiftName,
    site: ServedSite,
    body: Annotated[RmfEndedRequest, in_body({"END_SESSION": {"session_id": "fleet/amr-7", "grace_s": 3.0}})],
) -> RmfAccepted:
    """Also accepted for a session that is over already."""
    with site.numbering(lift):
        site.end_session(lift, rmf_holder(body.session_id, body.adapter), body.grace_s)
    return _accepted(site)


def _accepted(site: Site) -> RmfAccepted:
    return RmfAccepted(boot=site.boot, event=site.newest)
