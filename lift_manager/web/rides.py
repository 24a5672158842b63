"""Part of /api/v1: rides. Everybody who may read sees them; a robot's key speaks for those that it began."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Depends, Request, Response
from fastapi.types import DecoratedCallable

from lift_manager.api.access import Role
from lift_manager.api.rides import ANY, CancelRequest, Plan, Ride, RideRequest, Rides
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides import ride as domain
from lift_manager.rides.ride import RideLimits, RideWord
from lift_manager.runtime.errors import NotFound
from lift_manager.runtime.site import Site
from lift_manager.web.access import caller, turned_away
from lift_manager.web.answers import NO_STORE, marked, naming_field
from lift_manager.web.body import shown
from lift_manager.web.callers import (
    RIDE_FACE,
    ServedSite,
    holder_of,
    is_of,
    no_foreign_page,
    refuse_foreign_lifts,
    refuse_foreign_page,
    refuse_shared_key,
    site_of,
)
from lift_manager.web.errors import RequestError
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import EVERY_BODY, EVERY_CHANGE, LOCATION, NOT_FREE, in_body, in_path, problems

TAG = "rides"
TAG_DESCRIPTION = """
One robot from one floor to another. The manager calls the lift, holds its door, sends it on and lets it go; the robot does what
`guidance` says, and tells when it has `entered` and `left`.

| guidance | the robot |
|---|---|
| `wait` | stays outside, clear of the door |
| `enter` | drives in: the door is open for it now |
| `stay` | stays inside |
| `leave` | drives out: the door is open for it now |
| `gave_up` | is on its own; `reason` says why, `advice` what is best |
| `done` | is there |

`enter` and `leave` stand only while the door is open: drive on nothing older. An event tells when to ask: what a robot acts on is the
answer of GET, or an event whose `age_s` plus the time since it was received is within the lift's `max_age_s`.

Everybody who may read sees every ride; a robot's key speaks for the rides that it began, an operator's for all. Without keys
whoever knows the id of a ride speaks for it.
"""

_NOT_NOW = (*NOT_FREE, "not_now")
_BUSY = ("too_often", "too_many", "not_recorded", "stopping")
_OF_A_RIDE = ("unknown_ride", "unknown_lift", "no_such_path", "not_your_ride", *EVERY_CHANGE)

RideId = Annotated[str, in_path("The id that the answer to `POST /api/v1/rides` told.", "r-81c0")]


async def _own_ride(ride: RideId, request: Request) -> domain.Ride:
    """Return the ride of the path, if the caller may speak for it."""
    site = site_of(request)
    try:
        found = _find(site, ride)
    except RequestError:
        refuse_foreign_page(request, "")
        raise
    refuse_foreign_page(request, found.lift)
    refuse_foreign_lifts(request, [found.lift])
    if _speaker(request, found) is not None and not is_of(request, found.caller):
        code = Refusal.NOT_YOUR_RIDE
        site.turned_away(turned_away(request, code, "the ride is another caller's", found.lift))
        raise RequestError(code, "another key began this ride; only that key, or an operator's, speaks for it")
    return found


OwnRide = Annotated[domain.Ride, Depends(_own_ride)]

router = APIRouter(
    prefix="/api/v1/rides",
    tags=[TAG],
    route_class=JsonRoute,
    strict_content_type=False,
)


@router.get("", name="every", summary="Every ride", response_description="As they are.")
async def rides(site: ServedSite) -> Rides:
    """Those that go on, and those that ended not long ago; the oldest first."""
    return Rides(rides=tuple(Ride.of(ride) for ride in site.rides.all()))


@router.post(
    "",
    summary="Ride",
    dependencies=[Depends(no_foreign_page)],
    status_code=201,
    response_model=Ride,
    response_description="It is begun, or waits for its turn.",
    responses={
        201: {"headers": LOCATION},
        200: {"model": Ride | Plan, "description": "The ride of this idempotency key, or with `dry_run` the plan."},
        **problems(
            *("unknown_lift", *EVERY_CHANGE, *EVERY_BODY, "unknown_floor", *_NOT_NOW, "key_reused", *_BUSY),
        ),
    },
)
async def begin(
    request: Request,
    response: Response,
    site: ServedSite,
    body: Annotated[
        RideRequest,
        in_body(
            {
                "by any lift": {"lift": "any", "from": "L1", "to": "L3", "robot": "amr-7"},
                "what would it come to": {"lift": "east", "from": "L1", "to": "L3", "dry_run": True},
                "with an idempotency key, a new one for each ride": {
                    "lift": "any",
                    "from": "L1",
                    "to": "L3",
                    "robot": "amr-7",
                    "idempotency_key": "3f1c9a",
                },
            }
        ),
    ],
) -> Ride | Response:
    """Begins a ride or queues it.

    With `lift: any` the manager chooses among the lifts that serve both floors and that the key names; a robot's key rides on no other.
    With an `idempotency_key` that was used before, the answer is that ride, and 200, and another wish is refused; without keys of the
    site it needs a `robot`. One caller has at most 10 rides at once. With `dry_run` the answer is a plan, and 200.
    """
    if not body.dry_run:
        refuse_shared_key(request, body.robot, body.idempotency_key)
    lifts = _commanded(request, site) if body.lift == ANY else (body.lift,)
    refuse_foreign_lifts(request, lifts)
    wanted = _wanted(body, lifts, holder_of(request, RIDE_FACE, body.robot))
    with naming_field(_fields(site, wanted)):
        if body.dry_run:
            plan = Plan.model_validate(site.rides.plan(wanted))
            return Response(plan.model_dump_json(), 200, NO_STORE, "application/json")
        begun = site.rides.begin(wanted)
    ride = await _recorded(site, begun.ride)
    if begun.is_new:
        response.headers["location"] = f"rides/{quote(ride.id, safe='')}"
    else:
        response.status_code = 200
    return ride


@router.get(
    "/{ride}",
    name="one",
    summary="A ride",
    response_description="As it is.",
    responses=problems("unknown_ride", "no_such_path"),
)
async def one_ride(ride: RideId, site: ServedSite) -> Ride:
    """And what its robot is to do now."""
    return Ride.of(_find(site, ride))


def _reports(word: RideWord, summary: str) -> Callable[[DecoratedCallable], DecoratedCallable]:
    """Return the decorator of a route that takes a robot's word; a body is not looked at."""
    return router.post(
        f"/{{ride}}/{word}",
        summary=summary,
        response_description="It is heard.",
        responses=problems(*_OF_A_RIDE, *_NOT_NOW, *_BUSY),
    )


@_reports(RideWord.ENTERED, "The robot is inside")
async def entered(ride: OwnRide, request: Request, site: ServedSite) -> Ride:
    """And the door may close behind it. Say it only once the robot stands where it may stand. It has no body."""
    return await _recorded(site, site.rides.report(ride.id, RideWord.ENTERED, _speaker(request, ride)))


@_reports(RideWord.LEFT, "The robot is outside")
async def left(ride: OwnRide, request: Request, site: ServedSite) -> Ride:
    """Clear of the door. Also taken once the ride is over: it clears a car that is `maybe occupied`. It has no body."""
    return await _recorded(site, site.rides.report(ride.id, RideWord.LEFT, _speaker(request, ride)))


@_reports(RideWord.HERE, "The robot goes on")
async def here(ride: OwnRide, request: Request, site: ServedSite) -> Ride:
    """Needed after a restart of the manager, when nothing is pressed before the robot is heard; harmless otherwise. It has no body."""
    return await _recorded(site, site.rides.report(ride.id, RideWord.HERE, _speaker(request, ride)))


@router.post(
    "/{ride}/cancel",
    summary="Cancel a ride",
    response_description="It ends, or has ended.",
    responses=problems(*_OF_A_RIDE, *EVERY_BODY, *_NOT_NOW, *_BUSY),
)
async def cancel(
    ride: OwnRide,
    request: Request,
    site: ServedSite,
    body: Annotated[
        CancelRequest, in_body({"with a reason": {"reason": "the order was withdrawn"}}, otherwise=CancelRequest)
    ],
) -> Ride:
    """Safely: a robot that may be inside is let out first, and somebody is told. Twice is once. The body may be left out."""
    return await _recorded(site, site.rides.cancel(ride.id, _speaker(request, ride), body.reason))


async def _recorded(site: Site, ride: domain.Ride) -> Ride:
    """Return a ride as it is once what changed of it would be known after a crash."""
    is_recorded = await site.recorded(ride.lift)
    with suppress(NotFound):  # it may be forgotten meanwhile
        ride = site.rides.ride(ride.id)
    return marked(Ride.of(ride), recorded=is_recorded)


def _find(site: Site, ride: str) -> domain.Ride:
    """Return a ride. Raises RequestError for one that is not known."""
    try:
        return site.rides.ride(ride)
    except NotFound as refused:
        text = f"no ride {shown(ride)}; GET /api/v1/rides lists those that go on and those that ended not long ago"
        raise RequestError("unknown_ride", text) from refused


def _commanded(request: Request, site: Site) -> tuple[str, ...]:
    """Return the lifts that the caller commands."""
    key, every = caller(request), site.lift_names()
    return tuple(lift for lift in every if key is None or key.role is not Role.ROBOT or lift in key.lifts)


def _fields(site: Site, wanted: domain.RideRequest) -> dict[Refusal, str]:
    """Return which key of the body a refusal is about."""
    known = set(site.lift_names())
    has_start = any(wanted.start in site.config(lift).floors for lift in wanted.lifts if lift in known)
    return {Refusal.UNKNOWN_LIFT: "lift", Refusal.UNKNOWN_FLOOR: "to" if has_start else "from"}


def _wanted(body: RideRequest, lifts: tuple[str, ...], holder: Holder) -> domain.RideRequest:
    return domain.RideRequest(
        lifts=lifts,
        any_lift=body.lift == ANY,
        start=body.from_,
        destination=body.to,
        door=body.door,
        robot=body.robot or "",
        caller=holder,
        key=body.idempotency_key or "",
        limits=RideLimits(**body.limits.model_dump()),
    )


def _speaker(request: Request, ride: domain.Ride) -> Holder | None:
    """Return who speaks: None is a person, who speaks for every robot."""
    key = caller(request)
    return None if key is not None and key.role is not Role.ROBOT else ride.caller
