"""What Prometheus reads."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from fastapi import APIRouter, Request
from starlette.responses import Response

from lift_manager.web import health
from lift_manager.web.faces import answer, not_found

Scrape = Callable[[str], Awaitable[tuple[bytes, str]]]
"""From an `Accept` header to body and content type."""

_EXAMPLE = """# HELP lift_manager_lift_live Whether there is a reading young enough to act on.
# TYPE lift_manager_lift_live gauge
lift_manager_lift_live{lift="east"} 1
"""
_DESCRIPTION = """
Counters, gauges and histograms in the text format of Prometheus, or in OpenMetrics where `Accept` names it. Answered from
memory: no controller is waited for. Any key may read it; `deploy/prometheus/` has a scrape configuration and alert rules.
"""


def metrics_router(scrape: Scrape | None) -> APIRouter:
    """One route; without `scrape` it says that there is nothing here."""
    router = APIRouter(tags=[health.TAG])

    async def metrics(request: Request) -> Response:
        if scrape is None:
            return answer(request.url.path, not_found(request.url.path))
        body, content_type = await scrape(request.headers.get("accept", ""))
        return Response(body, headers={"content-type": content_type, "cache-control": "no-store"})

    router.add_api_route(
        "/metrics",
        metrics,
        methods=["GET"],
        summary="Measurements for Prometheus",
        description=_DESCRIPTION.strip(),
        response_class=Response,
        responses={
            200: {
                "description": "The measurements.",
                "content": {"text/plain": {"schema": {"type": "string", "example": _EXAMPLE}}},
            }
        },
    )
    return router
