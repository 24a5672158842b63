"""Part of /api/v1: the lifts, what they can do, and what each of their signals says. From memory."""

from __future__ import annotations

from fastapi import APIRouter, Request
from starlette.responses import Response

from lift_manager.api.lifts import Lift, LiftCapabilities, Lifts, Signals
from lift_manager.core.facade import LiftFacade
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.state import LiftState, Quality
from lift_manager.web import lifts_docs as docs
from lift_manager.web.body import shown
from lift_manager.web.etags import unless_known
from lift_manager.web.problem import refused


def lifts_router(facade: LiftFacade) -> APIRouter:
    """Every lift, and what one can do and says. Include it before the sessions: `signals` is no session's id."""
    routes = _Lifts(facade)
    router = APIRouter(prefix="/api/v1/lifts", tags=[docs.TAG])
    router.add_api_route("", routes.every, methods=["GET"], **docs.lifts())
    router.add_api_route("/{lift:path}/capabilities", routes.capabilities, methods=["GET"], **docs.capabilities())
    router.add_api_route("/{lift:path}/signals", routes.signals, methods=["GET"], **docs.signals())
    return router


def lift_router(facade: LiftFacade) -> APIRouter:
    """One lift. Include it after all that is read below the lifts: the name of a lift may hold a slash, so it takes the rest."""
    router = APIRouter(prefix="/api/v1/lifts", tags=[docs.TAG])
    router.add_api_route("/{lift:path}", _Lifts(facade).one, methods=["GET"], **docs.lift())
    return router


def timeless(lift: Lift, state: LiftState) -> Lift:
    """Return a lift without its ages. The reason stays as it is: the seconds in it may be a limit as well as an age.

    Of `releases_in_s` the moment stays, for a renewal moves it.
    """
    session = None if lift.session is None else lift.session.model_copy(update={"for_s": 0.0})
    return lift.model_copy(update={"age_s": None, "session": session, "releases_in_s": state.releases_at})


class _Lifts:
    def __init__(self, facade: LiftFacade) -> None:
        self._facade = facade
        self._max_age_s: dict[str, float] = {}
        """A lift's never changes while the process lives, and each state is shown with it."""

    async def every(self, request: Request) -> Response:
        states = [state for name in self._facade.lift_names() if (state := self._facade.state(name)) is not None]
        said = Lifts(lifts=tuple(self._shown(state) for state in states))
        ages = [state.age_s for state in states if state.quality is Quality.LIVE and state.age_s is not None]
        known = Lifts(lifts=tuple(timeless(lift, state) for lift, state in zip(said.lifts, states, strict=True)))
        return unless_known(request, said, known, max(ages, default=None))

    async def one(self, request: Request) -> Response:
        name: str = request.path_params["lift"]
        state = self._facade.state(name)
        if state is None:
            return self._unknown(name)
        said = self._shown(state)
        return unless_known(request, said, timeless(said, state), state.age_s)

    async def capabilities(self, request: Request) -> Response:
        name: str = request.path_params["lift"]
        lift, state = self._facade.describe(name), self._facade.state(name)
        if lift is None or state is None:
            return self._unknown(name)
        said = LiftCapabilities.of(lift)
        return unless_known(request, said, said, state.age_s)

    async def signals(self, request: Request) -> Response:
        name: str = request.path_params["lift"]
        lift = self._facade.signals(name)
        if lift is None:
            return self._unknown(name)
        said = Signals.of(lift)
        bare = tuple(signal.model_copy(update={"age_s": None}) for signal in said.signals)
        return unless_known(request, said, said.model_copy(update={"age_s": None, "signals": bare}), lift.age_s)

    def _shown(self, state: LiftState) -> Lift:
        max_age_s = self._max_age_s.get(state.lift)
        if max_age_s is None:
            lift = self._facade.describe(state.lift)
            max_age_s = self._max_age_s[state.lift] = 0.0 if lift is None else lift.able.max_age_s
        return Lift.of(state, max_age_s=max_age_s)

    def _unknown(self, name: str) -> Response:
        lifts = ", ".join(self._facade.lift_names())
        return refused(Refused(Refusal.UNKNOWN_LIFT, f"no lift {shown(name)}; the lifts are {lifts}"))
