"""Part of /api/v1: the lifts, their capabilities and their signals. From memory."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from hashlib import blake2b
from typing import Any

from fastapi import APIRouter, Request
from pydantic import BaseModel
from starlette.responses import Response

from lift_manager.api.lifts import (
    AGE_HEADER,
    Lift,
    LiftCapabilities,
    LiftCommand,
    LiftCommands,
    Lifts,
    PlannedWrite,
    PlannedWrites,
    Signals,
)
from lift_manager.lift.state import Quality
from lift_manager.runtime.site import Site
from lift_manager.web.body import quoted
from lift_manager.web.callers import site_of
from lift_manager.web.errors import RequestError
from lift_manager.web.lift_texts import LiftTexts
from lift_manager.web.openapi import EVERY_LIFT, LiftName, problems

TAG = "lifts"
TAG_DESCRIPTION = """
The lifts, from memory: no controller is contacted, so a reply comes at once and states its age.

**ETag.** Each reply has one. It covers everything except `age_s` and the session's `for_s`; of `releases_in_s` it covers the moment of
the release, so a renewal changes it and the passing of time does not. It covers texts literally, so a text with running seconds, such as
the reason of an offline lift, changes it each time. Sent back as `If-None-Match`, it gets 304 without a body while nothing but time has
changed. Both replies have `lift-age-s`: the age of the data in seconds, omitted if nothing was ever read. A lift that has not been read
for `max_age_s` turns `offline`, and that is a change: a 304 for a live lift means that it is still live. A client without a reply for
`max_age_s` must assume nothing about the lift.
"""

MOST_STEPS = 32
"""Chosen: a trip presses ten."""
_HEADERS = {
    "ETag": {
        "description": "Of everything but `age_s` and `for_s`; of the moment that `releases_in_s` counts down to.",
        "schema": {"type": "string"},
    },
    "Cache-Control": {
        "description": "`no-cache`: may be stored, but must be revalidated.",
        "schema": {"type": "string"},
    },
    AGE_HEADER: {
        "description": "The age of the data in seconds; omitted if nothing was ever read.",
        "schema": {"type": "number"},
    },
}
_TAGGED: dict[int | str, dict[str, Any]] = {
    200: {"description": "As it is.", "headers": _HEADERS},
    304: {"description": "Unchanged, except for the passing of time.", "headers": _HEADERS},
}
_LIFT_RESPONSES = _TAGGED | problems(*EVERY_LIFT)
_IF_NONE_MATCH = {
    "parameters": [
        {
            "name": "If-None-Match",
            "in": "header",
            "required": False,
            "description": "The `ETag` of an earlier reply, several of them, or `*`. Compared weakly.",
            "schema": {"type": "string", "examples": ['W/"5f0c7a31b2d94e68a1c3d7f0"']},
        }
    ]
}
"""Not a typed parameter: a header that is sent in several lines has the tags of all of them."""

_STEPS = {
    "parameters": [
        *_IF_NONE_MATCH["parameters"],
        {
            "name": "step",
            "in": "query",
            "required": True,
            "description": "`press` or `release`, a command of the map and, for a call, its floor; repeated for each step, in order.",
            "schema": {"type": "array", "items": {"type": "string"}, "minItems": 1, "maxItems": MOST_STEPS},
            "example": ["press robot_mode", "press go_to L2"],
        },
    ]
}

router = APIRouter(prefix="/api/v1/lifts", tags=[TAG])


@router.get(
    "", name="every", summary="Every lift", response_model=Lifts, responses=_TAGGED, openapi_extra=_IF_NONE_MATCH
)
async def lifts(request: Request) -> Response:
    """In the order of the site file, whether or not a lift can be read. `lift-age-s` is the age of the oldest among those that are live."""
    texts: LiftTexts = request.app.state.lift_texts
    every = [texts.of(name) for name in site_of(request).lift_names()]
    ages = [lift.age_s for lift in every if lift.state.quality is Quality.LIVE and lift.age_s is not None]
    bare = _listed(lift.bare for lift in every)
    return tagged(request, lambda: _listed(lift.whole() for lift in every), bare, max(ages, default=None))


def _listed(lifts: Iterable[bytes]) -> bytes:
    return b'{"lifts":[%b]}' % b",".join(lifts)


@router.get(
    "/{lift}/capabilities",
    summary="What a lift can do",
    response_model=LiftCapabilities,
    responses=_LIFT_RESPONSES,
    openapi_extra=_IF_NONE_MATCH,
)
async def capabilities(lift: LiftName, request: Request) -> Response:
    """Its floors, doors, commands and signals, and the time limits that the site sets for robots.

    It does not change while the manager runs.
    """
    site = _site_with_lift(request, lift)
    whole = LiftCapabilities.of(site.config(lift), simulated=lift in request.app.state.simulated)
    return _tagged_model(request, whole, whole, site.state(lift).age_s)


@router.get(
    "/{lift}/signals",
    summary="Every signal of a lift",
    response_model=Signals,
    responses=_LIFT_RESPONSES,
    openapi_extra=_IF_NONE_MATCH,
)
async def signals(lift: LiftName, request: Request) -> Response:
    """From the latest reading, with raw values and addresses, for people who compare them with the lift. Check the ages."""
    found = _site_with_lift(request, lift).signals(lift)
    whole = Signals.of(found)
    bare = tuple(signal.model_copy(update={"age_s": None}) for signal in whole.signals)
    return _tagged_model(request, whole, whole.model_copy(update={"age_s": None, "signals": bare}), found.age_s)


@router.get(
    "/{lift}/commands",
    name="commands",
    summary="Every command of a lift",
    response_model=LiftCommands,
    responses=_LIFT_RESPONSES,
    openapi_extra=_IF_NONE_MATCH,
)
async def lift_commands(lift: LiftName, request: Request) -> Response:
    """As its map has them, also on a lift that is only watched: addresses, how each ends, and what its output does now.

    A session commands a lift; this is for people who compare its outputs with the drawings of the lift.
    """
    site = _site_with_lift(request, lift)
    commands = tuple(LiftCommand.model_validate(command) for command in site.map_commands(lift))
    whole = LiftCommands(name=lift, same_floor_call=site.config(lift).capabilities.same_floor_call, commands=commands)
    return _tagged_model(request, whole, whole, site.state(lift).age_s)


@router.get(
    "/{lift}/commands/writes",
    name="writes",
    summary="What commands would write",
    response_model=PlannedWrites,
    responses=_TAGGED | problems(*EVERY_LIFT, "not_possible", "unknown_floor", "malformed"),
    openapi_extra=_STEPS,
)
async def planned_writes(lift: LiftName, request: Request) -> Response:
    """In order, byte for byte, from rest, as the driver would write them; what is on at the end is released. Nothing is sent.

    Left out are heartbeats, repetitions of what is held, and reads. A session presses `robot_mode` first where the map has it. A counter
    in a block that is always written as a whole is 0 here.
    """
    site = _site_with_lift(request, lift)
    steps = request.query_params.getlist("step")
    if not 1 <= len(steps) <= MOST_STEPS:
        text = f"give 1 to {MOST_STEPS} steps, such as ?step=press%20robot_mode&step=press%20go_to%20L2"
        raise RequestError("malformed", text, field="step")
    writes = tuple(PlannedWrite.model_validate(write) for write in site.planned_writes(lift, steps))
    whole = PlannedWrites(name=lift, writes=writes)
    return _tagged_model(request, whole, whole, site.state(lift).age_s)


@router.get(
    "/{lift}",
    name="one",
    summary="One lift",
    response_model=Lift,
    responses=_LIFT_RESPONSES,
    openapi_extra=_IF_NONE_MATCH,
)
async def one_lift(lift: LiftName, request: Request) -> Response:
    """Where it is, what its doors do, its mode, and who holds it.

    A robot drives only on `robot_door: open` that is not older than `max_age_s`.
    """
    _site_with_lift(request, lift)
    text = request.app.state.lift_texts.of(lift)
    return tagged(request, text.whole, text.bare, text.age_s)


def _tagged_model(request: Request, whole: BaseModel, bare: BaseModel, age_s: float | None) -> Response:
    return tagged(request, lambda: whole.model_dump_json().encode(), bare.model_dump_json().encode(), age_s)


def tagged(request: Request, whole: Callable[[], bytes], bare: bytes, age_s: float | None) -> Response:
    """Return 200 with `whole`, or 304 if the client has it; the tag is that of `bare`, which is `whole` without ages and durations."""
    tag = blake2b(bare, digest_size=12).hexdigest()
    # weak: two bodies with the same tag differ in their ages. `no-cache`: a cache may store it, but must revalidate
    headers = {"etag": f'W/"{tag}"', "cache-control": "no-cache"}
    if age_s is not None:
        headers[AGE_HEADER] = f"{age_s:.3f}"
    if matches_tag(tag, request.headers.getlist("if-none-match")):
        return Response(None, 304, headers)
    return Response(whole(), 200, headers, "application/json")


_TAG = re.compile(r'"([^"]*)"')


def matches_tag(tag: str, lines: Iterable[str]) -> bool:
    """Whether If-None-Match contains the tag, by the weak comparison of RFC 9110; an invalid header contains none."""
    return any(line.strip() == "*" or tag in _TAG.findall(line) for line in lines)


def _site_with_lift(request: Request, lift: str) -> Site:
    """Return the site. Raises RequestError if it does not have the lift; such a read does not count as a refused request."""
    site = site_of(request)
    if lift not in (lifts := site.lift_names()):
        raise RequestError("unknown_lift", f"no lift {quoted(lift)}; the lifts are {', '.join(lifts)}")
    return site
