"""Health checks without a key, and metrics for Prometheus."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import JSONResponse, Response

from lift_manager.lift.state import Quality
from lift_manager.runtime.site import Site
from lift_manager.web.replies import NO_STORE, error_reply, not_found

TAG = "health"

TAG_DESCRIPTION = """
For monitoring of the process. The checks need no key, and reveal nothing about the site but the number of its lifts.
"""

_ALIVE = {"status": "ok"}
_WRITABLE = "written"
_NOT_WRITABLE = "not written: nothing is pressed; the manager's log says why"
_ALONE = {"alone": "north goes on alone since 2026-11-29 10:00, as M. Weber has decided because south is off"}
_EXAMPLE = {"ready": True, "journal": _WRITABLE, "state": _WRITABLE, "lifts": 3, "live": 3}


Scrape = Callable[[str], Awaitable[tuple[bytes, str]]]
"""Returns body and content type for an `Accept` header."""

_METRICS_EXAMPLE = """# HELP lift_manager_lift_live Whether there is a reading young enough to act on.
# TYPE lift_manager_lift_live gauge
lift_manager_lift_live{lift="east"} 1
"""
_METRICS_DESCRIPTION = """
Counters, gauges and histograms in the text format of Prometheus, or in OpenMetrics where `Accept` names it. Answered from
memory, without waiting for controllers. Any key may read it; `deploy/prometheus/` has a scrape configuration and alert rules.
"""


def health_router(site: Site, alone: str = "") -> APIRouter:
    """Return the routes of the health checks, which reply from memory.

    `alone` says in words that one machine of a cluster goes on without the other.
    """
    router = APIRouter(tags=[TAG])

    async def healthz() -> Response:
        return _answer(_ALIVE, 200)

    async def readyz() -> Response:
        names = site.lift_names()
        live = sum(site.state(name).quality is Quality.LIVE for name in names)
        unwritten = site.unwritten
        files = {file: _NOT_WRITABLE if file in unwritten else _WRITABLE for file in ("journal", "state")}
        body: dict[str, Any] = {"ready": not unwritten, **files, "lifts": len(names), "live": live}
        body |= {"alone": alone} if alone else {}
        return _answer(body, 503 if unwritten else 200)

    router.add_api_route(
        "/healthz",
        healthz,
        methods=["GET"],
        summary="The process answers",
        description="The process and its loop are alive. A problem with a lift or the disk is no reason to restart it.",
        response_class=Response,
        responses={200: _documented("It does.", _ALIVE)},
    )
    router.add_api_route(
        "/readyz",
        readyz,
        methods=["GET"],
        summary="Robots are served",
        description=(
            "Robots are served while the journal can be written. A lift that is offline is counted, but does not matter:"
            " the others continue. `alone` is there while one machine of a cluster goes on without the other, and says who decided it."
        ),
        response_class=Response,
        responses={
            200: _documented("They are.", _EXAMPLE, optional=_ALONE),
            503: _documented(
                "Journal and state cannot be written: nothing is pressed, while releases and states continue.",
                {**_EXAMPLE, "ready": False, "journal": _NOT_WRITABLE, "state": _NOT_WRITABLE},
                optional=_ALONE,
            ),
        },
    )
    return router


def metrics_router(scrape: Scrape | None) -> APIRouter:
    """Return the route of the metrics; without `scrape` it replies with 404."""
    router = APIRouter(tags=[TAG])

    async def metrics(request: Request) -> Response:
        if scrape is None:
            return error_reply(request.url.path, not_found(request.url.path))
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


def _documented(description: str, example: dict[str, Any], optional: Mapping[str, Any] | None = None) -> dict[str, Any]:
    properties = {name: {"type": _TYPES[type(value)]} for name, value in (example | dict(optional or {})).items()}
    schema = {
        "type": "object",
        "properties": properties,
        "required": list(example),
        "additionalProperties": False,
        "example": example,
    }
    return {"description": description, "content": {"application/json": {"schema": schema}}}


_TYPES = {bool: "boolean", int: "integer", str: "string"}
