"""What /docs says about the workshop API, in words an integrator can work from."""

from __future__ import annotations

from typing import Any

from starlette.responses import Response

TAG = "workshop"

TAG_DESCRIPTION = """
The small API that clients of `roscon_lift_adapter` use. Three rules hold for all of it.

**Look at `success`, not at the HTTP status.** Every answer is
`{"data": {...}, "success": true or false, "msg": "..."}`. A failure is HTTP 200 too, with `success: false`, an empty
`data` and a `msg` that says why and names what is allowed. Only what never got as far as a lift has another status,
with the same envelope: 400 (not HTTP, or a key in the address), 401 (a key is needed), 403 (the key may not do this, or
a site without keys was addressed by an unknown host name), 404 (no such path), 405 (wrong method), 431 (address and headers too
long), 500 (a bug in the manager).

**Accepted is not done.** A request is answered as soon as it is accepted, from memory. Poll `lift_state` to see the
car come: it stands ready for a robot when `current_floor` is the requested floor *and* `door_state` is 2.

**All callers without a key are one.** They share one session named `workshop`. A caller with a key has its own, named
`workshop:<name of the key>`; as soon as the site has a key, every request needs one, in the header
`Authorization: Bearer lm_...`. While somebody else holds the lift, a request is refused with the holder's name.
"""

FAILED = {"data": {}, "success": False}


def _envelope(data: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "required": ["data", "success", "msg"],
        "properties": {
            "data": {"type": "object", "properties": data, "description": "Empty when `success` is false."},
            "success": {"type": "boolean", "description": "Whether it worked."},
            "msg": {"type": "string", "description": "Why not; empty when `success` is true."},
        },
    }


ENVELOPE = _envelope({})
"""The schema of every answer."""

Example = dict[str, Any]


def lift_names(names: tuple[str, ...]) -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    data = {
        "lift_names": {"type": "array", "items": {"type": "string"}, "description": "In the order of the site file."}
    }
    return _route(
        summary="Names of the lifts",
        description="The names to use as `lift_name`. A lift that cannot be reached is listed too.",
        answer=_answer(data, {"Lifts": _yes("The lifts of this site", {"lift_names": list(names)})}),
        parameters=[],
    )


def lift_state(names: tuple[str, ...]) -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    floor = {"type": "string", "examples": ["L1"]}
    data = {
        "available_floors": {"type": "array", "items": floor, "description": "The floors that may be requested."},
        "current_floor": floor | {"description": CURRENT_FLOOR},
        "destination_floor": floor | {"description": DESTINATION_FLOOR},
        "door_state": {"type": "integer", "enum": [0, 1, 2], "description": DOOR_STATE},
        "motion_state": {"type": "integer", "enum": [0, 1, 2, 3], "description": MOTION_STATE},
    }
    standing = _state("L1", "L1", 0, 0)
    examples = {
        "Standing": _yes("At L1, door closed, no request", standing),
        "On the way": _yes("Going up to L2, passing L1", _state("L1", "L2", 0, 1)),
        "Ready": _yes("At L2, door open and held: drive", _state("L2", "L2", 2, 0)),
        "Offline": _no(
            "Nothing old is shown as current",
            f"lift {_quoted(names)} is offline, last reading 3.2 s ago: 10.0.0.7:502 is silent, limit 1.0 s",
        ),
        "Unknown lift": _no("The names to use are listed", _unknown_lift(names)),
    }
    return _route(
        summary="Where the car is, and what its door does",
        description=STATE_TEXT,
        answer=_answer(data, examples),
        parameters=[_lift_name(names)],
    )


def lift_request(names: tuple[str, ...]) -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    body = {
        "type": "object",
        "required": ["floor", "door_state"],
        "description": "Further keys are ignored.",
        "properties": {
            "floor": {"type": "string", "description": "One of `available_floors`.", "examples": ["L2"]},
            "door_state": {"type": "integer", "enum": [0, 2], "description": REQUEST_DOOR_STATE},
        },
    }
    requests = {
        "Call": {"summary": "Come to L2; over on arrival", "value": {"floor": "L2", "door_state": 0}},
        "Hold": {"summary": "Come to L2 and hold the door", "value": {"floor": "L2", "door_state": 2}},
        "Release": {"summary": "Release, while current_floor is L1", "value": {"floor": "L1", "door_state": 0}},
    }
    examples = {
        "Accepted": _yes("The lift will do it; watch lift_state", {}),
        "Wrong door_state": _no("1 cannot be requested", REFUSED_DOOR_STATE),
        "Wrong body": _no("What was expected is named", REFUSED_BODY),
        "Unknown lift": _no("The names to use are listed", _unknown_lift(names)),
    }
    return _route(
        summary="Call, hold and release a lift",
        description=REQUEST_TEXT,
        answer=_answer({}, examples),
        parameters=[_lift_name(names)],
        requestBody={"required": True, "content": {"application/json": {"schema": body, "examples": requests}}},
    )


CURRENT_FLOOR = (
    "The floor the car stands at or passes; empty when nobody reports it. Never the destination before arrival."
)
DESTINATION_FLOOR = "The requested floor; without a request the current floor, and empty when that is not known."
DOOR_STATE = """0 closed, 1 moving, 2 open. 2 is an invitation to drive: the car stands at `current_floor`, the door is
fully open and, while a session holds the lift, the hold is confirmed. In fire, emergency and the like it is never 2."""
MOTION_STATE = "0 stopped, 1 up, 2 down, 3 not known (or moving without a word on the direction)."
REQUEST_DOOR_STATE = (
    "2: come, open and hold the door. 0: come without holding; for the current floor, release. No other."
)
REFUSED_DOOR_STATE = "door_state must be 0 (no hold; for the current floor a release) or 2 (open and hold), not 1"
REFUSED_BODY = 'the body is empty; expected {"floor": one of L1, L2, "door_state": 0 or 2}'

STATE_TEXT = """
The lift as it was at the last reading; no controller is contacted, so the answer comes at once.

A lift that has been silent for longer than its limit answers `success: false` with the age, the limit and the reason.
Treat that as "door not open".

    curl '127.0.0.1:5003/open-rmf/demo-lift/lift_state?lift_name=lift'
"""

REQUEST_TEXT = """
| you send | the lift does |
|---|---|
| a floor, `door_state` 2 | comes to the floor, opens and **holds** the door there |
| another floor, `door_state` 0 | comes to the floor; the session **ends on arrival** |
| the floor that `lift_state` calls `current_floor`, `door_state` 0 | **is released**: hold and lease end; nothing moves |

**The lease.** With `door_state` 2 the lift is yours until you release it, and no longer than the lease (300 s unless the
site says otherwise). It runs from the later of two moments: your last request, and the door standing open at the
floor you requested. Then the lift goes back to people. Repeat the request to keep it; a repeat does not press the button
again. A new floor while the car travels is fine.

**When it is refused.** The lift is held by somebody else, offline, in a mode that is for people only (fire, inspection,
independent service and the like), locked out, outside the hours of robots, or waits for a person after a fire or because
a robot may be in its car; or the request itself is wrong: the `msg` says which, and names what helps.

The body is read as JSON whatever content type is declared, and at most 64 KB of it. Requests from web pages of other
sites are refused.

    curl '127.0.0.1:5003/open-rmf/demo-lift/lift_request?lift_name=lift' -d '{"floor": "L2", "door_state": 2}'
"""


def _route(*, summary: str, description: str, answer: dict[str, Any], **openapi: object) -> dict[str, Any]:
    return {
        "summary": summary,
        "description": description,
        "response_class": Response,
        "responses": {200: answer},
        "openapi_extra": openapi,
    }


def _answer(data: dict[str, Any], examples: dict[str, Example]) -> dict[str, Any]:
    schema = _envelope(data)
    return {
        "description": "`success` says whether it worked; failures are 200 too.",
        "content": {"application/json": {"schema": schema, "examples": examples}},
    }


def _lift_name(names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "name": "lift_name",
        "in": "query",
        "required": True,
        "description": "One of the names that `lift_names` lists, percent-encoded where it needs to be; exactly once.",
        "schema": {"type": "string"},
        "examples": {name: {"value": name} for name in names},
    }


def _state(current: str, destination: str, door: int, motion: int) -> dict[str, Any]:
    return {
        "available_floors": ["L1", "L2"],
        "current_floor": current,
        "destination_floor": destination,
        "door_state": door,
        "motion_state": motion,
    }


def _yes(summary: str, data: dict[str, Any]) -> Example:
    return {"summary": summary, "value": {"data": data, "success": True, "msg": ""}}


def _no(summary: str, message: str) -> Example:
    return {"summary": summary, "value": FAILED | {"msg": message}}


def _quoted(names: tuple[str, ...]) -> str:
    return f'"{names[0] if names else "lift"}"'


def _unknown_lift(names: tuple[str, ...]) -> str:
    return f'unknown lift "elevator"; lift_name must be one of: {", ".join(names)}'
