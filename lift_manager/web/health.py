"""For whatever watches the process: whether it lives and can do its work, without a key, and measurements for Prometheus."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import JSONResponse, Response

from lift_manager.lift.state import Quality
from lift_manager.runtime.site import Site
from lift_manager.web.answers import NO_STORE, answer, not_found

TAG = "health"

TAG_DESCRIPTION = """
For whoever watches the process. Neither needs a key, and neither tells more of the site than how many lifts it has.
"""

_ALIVE = {"status": "ok"}
_WRITTEN = "written"
_NOT_WRITTEN = "not written: nothing is pressed; the manager's log says why"
_EXAMPLE = {"ready": True, "journal": _WRITTEN, "state": _WRITTEN, "lifts": 3, "live": 3}


Scrape = Callable[[str], Awaitable[tuple[bytes, str]]]
"""From an `Accept` header to body and content type."""

_METRICS_EXAMPLE = """# HELP lift_manager_lift_live Whether there is a reading young enough to act on.
# TYPE lift_manager_lift_live gauge
lift_manager_lift_live{lift="east"} 1
"""
_METRICS_DESCRIPTION = """
Counters, gauges and histograms in the text format of Prometheus, or in OpenMetrics where `Accept` names it. Answered from
memory: no controller is waited for. Any key may read it; `deploy/prometheus/` has a scrape configuration and alert rules.
"""


def health_router(site: Site) -> APIRouter:
    """Two routes that answer from memory."""
    router = APIRouter(tags=[TAG])

    async def healthz() -> Response:
        return _answer(_ALIVE, 200)

    async def readyz() -> Response:
        names = site.lift_names()
        live = sum(site.state(name).quality is Quality.LIVE for name in names)
        unwritten = site.unwritten
        files = {file: _NOT_WRITTEN if file in unwritten else _WRITTEN for file in ("journal", "state")}
        body = {"ready": not unwritten, **files, "lifts": len(names), "live": live}
        return _answer(body, 503 if unwritten else 200)

    router.add_api_route(
        "/healthz",
        healthz,
        methods=["GET"],
        summary="The process answers",
        description="The process and its loop. What is wrong with a lift, or with the disk, is no reason to start it anew.",
        response_class=Response,
        responses={200: _documented("It does.", _ALIVE)},
    )
    router.add_api_route(
        "/readyz",
        readyz,
        methods=["GET"],
        summary="Robots are served",
        description=(
            "Robots are served while what is done can be written down. A lift that is offline is counted, and does not matter:"
            " the others go on."
        ),
        response_class=Response,
        responses={
            200: _documented("They are.", _EXAMPLE),
            503: _documented(
                "Journal and state cannot be written: nothing is pressed, while letting go and states go on.",
                {**_EXAMPLE, "ready": False, "journal": _NOT_WRITTEN, "state": _NOT_WRITTEN},
            ),
        },
    )
    return router


def metrics_router(scrape: Scrape | None) -> APIRouter:
    """One route; without `scrape` it says that there is nothing here."""
    router = APIRouter(tags=[TAG])

    async def metrics(request: Request) -> Response:
        if scrape is None:
            return answer(request.url.path, not_found(request.url.path))
        body, content_type = await scrape(request.headers.get("accept", ""))
        return Response(body, headers={"content-type": content_type, **NO_STORE})

    router.add_api_route(
        "/metrics",
        metrics,
        methods=["GET"],
        summary="Measurements for Prometheus",
        description=_METRICS_DESCRIPTION.strip(),
        response_class=Response,
        responses={
            200: {
                "description": "The measurements.",
                "content": {"text/plain": {"schema": {"type": "string", "example": _METRICS_EXAMPLE}}},
            }
        },
    )
    return router


def _answer(body: dict[str, Any], status: int) -> Response:
    return JSONResponse(body, status, NO_STORE)


def _documented(description: str, example: dict[str, Any]) -> dict[str, Any]:
    properties = {name: {"type": _TYPES[type(value)]} for name, value in example.items()}
    schema = {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
        "example": example,
    }
    return {"description": description, "content": {"application/json": {"schema": schema}}}


_TYPES = {bool: "boolean", int: "integer", str: "string"}
