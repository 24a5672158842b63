"""Part of /api/v1: rides. Everybody who may read sees them; a robot's key speaks for those that it began."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any
from urllib.parse import quote

from fastapi import APIRouter, Request
from starlette.responses import Response

from lift_manager.api.rides import ANY, CancelRequest, Plan, Ride, RideRequest, Rides
from lift_manager.core.facade import Facade
from lift_manager.domain import ride as domain
from lift_manager.domain.access import Role
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.ride import RideLimits, RideWord
from lift_manager.domain.state import Holder
from lift_manager.web import rides_docs as docs
from lift_manager.web.access import caller, turned_away
from lift_manager.web.answers import recorded, yes
from lift_manager.web.bodies import taken
from lift_manager.web.body import shown
from lift_manager.web.callers import RIDE_FACE, holder_of, is_of, no_shared_key
from lift_manager.web.guards import no_foreign_lift, no_foreign_page
from lift_manager.web.problem import refused


def rides_router(facade: Facade) -> APIRouter:
    """Begin, plan, read, speak for and cancel rides."""
    routes = _Rides(facade)
    router = APIRouter(prefix="/api/v1/rides", tags=[docs.TAG])
    router.add_api_route("", routes.every, methods=["GET"], **docs.rides())
    router.add_api_route("", routes.begin, methods=["POST"], **docs.begin())
    router.add_api_route("/{ride}", routes.one, methods=["GET"], **docs.ride())
    for word in RideWord:
        router.add_api_route(f"/{{ride}}/{word}", routes.says(word), methods=["POST"], **docs.word(word))
    router.add_api_route("/{ride}/cancel", routes.cancel, methods=["POST"], **docs.cancel())
    return router


class _Rides:
    def __init__(self, facade: Facade) -> None:
        self._facade = facade

    async def every(self) -> Response:
        return yes(Rides(rides=tuple(Ride.of(ride) for ride in self._facade.rides())))

    async def one(self, request: Request) -> Response:
        found = self._find(request)
        return found if isinstance(found, Response) else yes(Ride.of(found))

    async def begin(self, request: Request) -> Response:
        if (no := no_foreign_page(self._facade, request, "")) is not None:
            return no
        body = await taken(request, RideRequest)
        if isinstance(body, Response):
            return body
        if not body.dry_run and (no := no_shared_key(request, body.robot, body.idempotency_key)) is not None:
            return no
        lifts = self._all_of(request) if body.lift == ANY else (body.lift,)
        if (no := no_foreign_lift(self._facade, request, lifts)) is not None:
            return no
        wish = _wish(body, lifts, holder_of(request, RIDE_FACE, body.robot))
        if body.dry_run:
            plan = self._facade.plan_ride(wish)
            return self._no(plan, wish) if isinstance(plan, Refused) else yes(Plan.of(plan))
        said = self._facade.begin_ride(wish)
        if isinstance(said, Refused):
            return self._no(said, wish)
        return await self._once_recorded(said.ride, anew=said.anew)

    def says(self, word: RideWord) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the route that takes a robot's word; a body is not looked at."""

        async def said(request: Request) -> Response:
            ride = self._to_speak_for(request)
            if isinstance(ride, Response):
                return ride
            return await self._changed(self._facade.ride_word(ride.id, word, _speaker(request, ride)))

        said.__name__ = word.value
        return said

    async def cancel(self, request: Request) -> Response:
        ride = self._to_speak_for(request)
        if isinstance(ride, Response):
            return ride
        body = await taken(request, CancelRequest, may_be_empty=True)
        if isinstance(body, Response):
            return body
        return await self._changed(self._facade.cancel_ride(ride.id, _speaker(request, ride), body.reason))

    async def _changed(self, said: domain.Ride | Refused) -> Response:
        return refused(said) if isinstance(said, Refused) else await self._once_recorded(said)

    async def _once_recorded(self, ride: domain.Ride, *, anew: bool = False) -> Response:
        """Answer with a ride as it is once what was said of it would be known after a crash."""
        on_disk = await recorded(self._facade, ride.lift)
        answer = Ride.of(self._facade.ride(ride.id) or ride)
        if not anew:
            return yes(answer, recorded=on_disk)
        return yes(answer, 201, location=f"rides/{quote(answer.id, safe='')}", recorded=on_disk)

    def _to_speak_for(self, request: Request) -> domain.Ride | Response:
        found = self._find(request)
        lift = "" if isinstance(found, Response) else found.lift
        if (no := no_foreign_page(self._facade, request, lift)) is not None or isinstance(found, Response):
            return no or found
        if (no := no_foreign_lift(self._facade, request, [lift])) is not None:
            return no
        if _speaker(request, found) is None or is_of(request, found.caller):
            return found
        code = Refusal.NOT_YOUR_RIDE
        self._facade.turned_away(turned_away(request, code, "the ride is another caller's", lift))
        text = "another key began this ride; only that key, or an operator's, speaks for it"
        return refused(Refused(code, text))

    def _find(self, request: Request) -> domain.Ride | Response:
        name: str = request.path_params["ride"]
        if (found := self._facade.ride(name)) is not None:
            return found
        text = f"no ride {shown(name)}; GET /api/v1/rides lists those that go on and those that ended not long ago"
        return refused(Refused(Refusal.UNKNOWN_RIDE, text))

    def _all_of(self, request: Request) -> tuple[str, ...]:
        """Return the lifts that the caller commands."""
        key, every = caller(request), self._facade.lift_names()
        return tuple(lift for lift in every if key is None or key.role is not Role.ROBOT or lift in key.lifts)

    def _no(self, said: Refused, wish: domain.RideRequest) -> Response:
        match said.code:
            case Refusal.UNKNOWN_LIFT:
                return refused(said, "lift")
            case Refusal.UNKNOWN_FLOOR:
                states = (self._facade.state(lift) for lift in wish.lifts)
                is_start = any(state is not None and wish.start in state.floors for state in states)
                return refused(said, "to" if is_start else "from")
            case _:
                return refused(said)


def _wish(body: RideRequest, lifts: tuple[str, ...], holder: Holder) -> domain.RideRequest:
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
