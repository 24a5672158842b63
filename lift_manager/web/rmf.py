"""Part of /api/v1: what an adapter of Open-RMF is told, and what it passes on of RMF's sessions."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import APIRouter, Request
from starlette.responses import Response

from lift_manager.api.rmf import RmfEndedRequest, RmfSiteAnswer, RmfTaken, RmfWantedRequest
from lift_manager.core.facade import Facade
from lift_manager.core.keeper import STOPPING
from lift_manager.core.rmf_site import rmf_site
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused
from lift_manager.domain.rmf import rmf_holder
from lift_manager.web import rmf_docs as docs
from lift_manager.web.answers import yes
from lift_manager.web.bodies import Body, taken
from lift_manager.web.guards import no_foreign_page
from lift_manager.web.problem import refused


def rmf_router(facade: Facade) -> APIRouter:
    """The site for RMF, and the two words of a session."""
    routes = _Rmf(facade)
    router = APIRouter(prefix="/api/v1", tags=[docs.TAG])
    router.add_api_route("/rmf", routes.site, methods=["GET"], **docs.site())
    router.add_api_route("/lifts/{lift:path}/rmf/wanted", routes.wanted, methods=["POST"], **docs.wanted())
    router.add_api_route("/lifts/{lift:path}/rmf/ended", routes.ended, methods=["POST"], **docs.ended())
    return router


class _Rmf:
    def __init__(self, facade: Facade) -> None:
        self._facade = facade

    async def site(self, request: Request) -> Response:
        if self._facade.stopping:
            # nobody holds a lift then, and an adapter would take sessions for over that are kept
            return refused(STOPPING)
        return yes(RmfSiteAnswer.of(rmf_site(self._facade)))

    async def wanted(self, request: Request) -> Response:
        def decide(lift: str, body: RmfWantedRequest) -> Accepted | Refused:
            holder = rmf_holder(body.session_id, body.adapter)
            return self._facade.request(Ask(lift, holder, body.floor, body.hold_door, stays=True))

        return await self._decided(request, RmfWantedRequest, decide)

    async def ended(self, request: Request) -> Response:
        def decide(lift: str, body: RmfEndedRequest) -> Accepted | Refused:
            return self._facade.end_session(lift, rmf_holder(body.session_id, body.adapter), body.grace_s)

        return await self._decided(request, RmfEndedRequest, decide)

    async def _decided(
        self, request: Request, form: type[Body], decide: Callable[[str, Body], Accepted | Refused]
    ) -> Response:
        lift: str = request.path_params["lift"]
        if (no := no_foreign_page(self._facade, request, lift)) is not None:
            return no
        body = await taken(request, form)
        if isinstance(body, Response):
            return body
        said = decide(lift, body)
        if isinstance(said, Refused):
            return refused(said, "floor" if said.code is Refusal.UNKNOWN_FLOOR else None)
        self._facade.freshen(lift)
        return yes(RmfTaken(boot=self._facade.boot, event=self._facade.newest))
