"""Part of /api/v1: rides. Every reader sees all rides; the key of a robot controls those that it began."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Depends, Request, Response
from fastapi.types import DecoratedCallable

from lift_manager.api.rides import ANY, CancelRequest, Plan, Ride, RideRequest, Rides
from lift_manager.api.roles import Role, commandable
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides import ride as domain
from lift_manager.rides.ride import RideWord
from lift_manager.runtime.errors import NotFound
from lift_manager.runtime.site import Site
from lift_manager.web.authenticator import caller_key, face_refusal
from lift_manager.web.body import quoted
from lift_manager.web.callers import (
    RIDE_FACE,
    ServedSite,
    belongs_to_caller,
    forbid_foreign_page,
    holder_of,
    refuse_foreign_lifts,
    refuse_foreign_page,
    refuse_shared_key,
    site_of,
)
from lift_manager.web.errors import RequestError
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import EVERY_BODY, EVERY_CHANGE, LOCATION, NOT_FREE, in_body, in_path, problems
from lift_manager.web.replies import NO_STORE, naming_field, with_recorded

TAG = "rides"
TAG_DESCRIPTION = """
Moves one robot from one floor to another. The manager calls the lift, holds its door, sends it on and releases it; the robot follows
`guidance`, and reports when it has `entered` and `left`.

| guidance | the robot |
|---|---|
| `wait` | stays outside, clear of the door |
| `enter` | drives in: the door is open for it now |
| `stay` | stays inside |
| `leave` | drives out: the door is open for it now |
| `gave_up` | is on its own; `reason` says why, `advice` what to do |
| `done` | has arrived |

`enter` and `leave` are valid only while the door is open: do not act on anything older. A robot acts on a reply to GET, or on an event
whose `age_s` plus the time since it was received is within the lift's `max_age_s`; an older event only tells it to send a GET.

Every reader sees every ride; the key of a robot controls the rides that it began, the key of an operator controls all. Without keys
any caller that knows the id of a ride controls it.
"""

_UNAVAILABLE = (*NOT_FREE, "not_now")
_BUSY = ("too_often", "too_many", "not_recorded", "stopping")
_RIDE_CODES = ("unknown_ride", "unknown_lift", "no_such_path", "not_your_ride", *EVERY_CHANGE)

RideId = Annotated[str, in_path("The id from the reply to `POST /api/v1/rides`.", "r-81c0")]


async def _own_ride(ride: RideId, request: Request) -> domain.Ride:
    """Return the ride in the path, if the caller may control it."""
    site = site_of(request)
    try:
        own_ride = _find(site, ride)
    except RequestError:
        refuse_foreign_page(request, "")
        raise
    refuse_foreign_page(request, own_ride.lift)
    refuse_foreign_lifts(request, [own_ride.lift])
    if _speaking_for(request, own_ride) is not None and not belongs_to_caller(request, own_ride.caller):
        code = Refusal.NOT_YOUR_RIDE
        site.turned_away(face_refusal(request, code, "the ride is another caller's", own_ride.lift))
        raise RequestError(code, "another key began this ride; only that key, or an operator's, controls it")
    return own_ride


OwnRide = Annotated[domain.Ride, Depends(_own_ride)]

router = APIRouter(
    prefix="/api/v1/rides",
    tags=[TAG],
    route_class=JsonRoute,
    strict_content_type=False,
)


@router.get("", name="every", summary="Every ride", response_description="As they are.")
async def rides(site: ServedSite) -> Rides:
    """Current rides, and those that ended recently; the oldest first."""
    return Rides(rides=tuple(Ride.of(ride) for ride in site.rides.all()))


@router.post(
    "",
    summary="Begin a ride",
    dependencies=[Depends(forbid_foreign_page)],
    status_code=201,
    response_model=Ride,
    response_description="It has begun, or waits for its turn.",
    responses={
        201: {"headers": LOCATION},
        200: {"model": Ride | Plan, "description": "The ride of this idempotency key, or with `dry_run` the plan."},
        **problems(
            *("unknown_lift", *EVERY_CHANGE, *EVERY_BODY, "unknown_floor", *_UNAVAILABLE, "key_reused", *_BUSY),
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
                "only plan it": {"lift": "east", "from": "L1", "to": "L3", "dry_run": True},
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

    With `lift: any` the manager chooses among the lifts that serve both floors and that the key names. A repeated `idempotency_key` returns
    its ride with 200, and is refused for a different request; on a site without keys it needs a `robot`. One caller has at most 10 rides
    at once. With `dry_run` the reply is a plan, with 200.
    """
    if not body.dry_run:
        refuse_shared_key(request, body.robot, body.idempotency_key)
    lifts = _commandable_lifts(request, site) if body.lift == ANY else (body.lift,)
    refuse_foreign_lifts(request, lifts)
    ride_request = body.of(holder_of(request, RIDE_FACE, body.robot), lifts)
    with naming_field(_refusal_fields(site, ride_request)):
        if body.dry_run:
            plan = Plan.model_validate(site.rides.plan(ride_request))
            return Response(plan.model_dump_json(), 200, NO_STORE, "application/json")
        begun = site.rides.begin(ride_request)
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
    """With the current guidance for its robot."""
    return Ride.of(_find(site, ride))


def _report_route(word: RideWord, summary: str) -> Callable[[DecoratedCallable], DecoratedCallable]:
    """Return the decorator of a route for a report of a robot; a body is ignored."""
    return router.post(
        f"/{{ride}}/{word}",
        summary=summary,
        response_description="The ride after the report.",
        responses=problems(*_RIDE_CODES, *_UNAVAILABLE, *_BUSY),
    )


@_report_route(RideWord.ENTERED, "The robot is inside")
async def entered(ride: OwnRide, request: Request, site: ServedSite) -> Ride:
    """The door may then close behind it. Send this only once the robot has reached its place in the car. It has no body."""
    return await _recorded(site, site.rides.report(ride.id, RideWord.ENTERED, _speaking_for(request, ride)))


@_report_route(RideWord.LEFT, "The robot is outside")
async def left(ride: OwnRide, request: Request, site: ServedSite) -> Ride:
    """The robot is clear of the door. Also accepted after the end of the ride: it clears a car that is `maybe occupied`. It has no body."""
    return await _recorded(site, site.rides.report(ride.id, RideWord.LEFT, _speaking_for(request, ride)))


@_report_route(RideWord.HERE, "The robot continues")
async def here(ride: OwnRide, request: Request, site: ServedSite) -> Ride:
    """Needed after a restart of the manager, and for a ride begun through a hub: nothing is pressed before; harmless otherwise. It has no body."""
    return await _recorded(site, site.rides.report(ride.id, RideWord.HERE, _speaking_for(request, ride)))


@router.post(
    "/{ride}/cancel",
    summary="Cancel a ride",
    response_description="It ends, or has ended.",
    responses=problems(*_RIDE_CODES, *EVERY_BODY, *_UNAVAILABLE, *_BUSY),
)
async def cancel(
    ride: OwnRide,
    request: Request,
    site: ServedSite,
    body: Annotated[
        CancelRequest, in_body({"with a reason": {"reason": "the order was withdrawn"}}, otherwise=CancelRequest)
    ],
) -> Ride:
    """Ends safely: a robot that may be inside is let out first, and people are alerted. May be repeated. The body is optional."""
    return await _recorded(site, site.rides.cancel(ride.id, _speaking_for(request, ride), body.reason))


async def _recorded(site: Site, ride: domain.Ride) -> Ride:
    """Wait until a ride is recorded, and return it as it is then."""
    is_recorded = await site.recorded(ride.lift)
    with suppress(NotFound):  # it may have been forgotten meanwhile
        ride = site.rides.ride(ride.id)
    return with_recorded(Ride.of(ride), recorded=is_recorded)


def _find(site: Site, ride: str) -> domain.Ride:
    """Return a ride. Raises RequestError if it is unknown."""
    try:
        return site.rides.ride(ride)
    except NotFound as error:
        text = f"no ride {quoted(ride)}; GET /api/v1/rides lists current rides and those that ended recently"
        raise RequestError("unknown_ride", text) from error


def _commandable_lifts(request: Request, site: Site) -> tuple[str, ...]:
    """Return the lifts that the caller may command."""
    key, every = caller_key(request), site.lift_names()
    return every if key is None else commandable(key.role, key.lifts, every)


def _refusal_fields(site: Site, ride_request: domain.RideRequest) -> dict[Refusal, str]:
    """Return which key of the body a refusal concerns."""
    known = set(site.lift_names())
    has_start = any(ride_request.start in site.config(lift).floors for lift in ride_request.lifts if lift in known)
    return {Refusal.UNKNOWN_LIFT: "lift", Refusal.UNKNOWN_FLOOR: "to" if has_start else "from"}


def _speaking_for(request: Request, ride: domain.Ride) -> Holder | None:
    """Return the caller on whose behalf a request is made; None for a person, who may act for every robot."""
    key = caller_key(request)
    return None if key is not None and key.role is not Role.ROBOT else ride.caller
