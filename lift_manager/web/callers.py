"""In whose name a caller of /api/v1 holds a lift, and which sessions and rides are its own."""

from __future__ import annotations

from fastapi import Request
from starlette.responses import Response

from lift_manager.domain.access import Need, refusal
from lift_manager.domain.keys import Keys
from lift_manager.domain.state import Holder
from lift_manager.web.access import caller
from lift_manager.web.problem import problem

SESSION_FACE = "api"
RIDE_FACE = "ride"
ANONYMOUS = "anonymous"
"""Every caller with neither a key nor a robot's name."""
BETWEEN = "/"
"""Stands between the name of a key and that of a robot; `lift-manager keys make` lets no key's name hold one."""


def holder_of(request: Request, face: str, robot: str | None) -> Holder:
    """Return the caller: the name of its key, and behind it that of the robot, if one was told."""
    key = caller(request)
    if key is None:
        return Holder(face, robot or ANONYMOUS)
    return named(face, key.name, robot)


def named(face: str, name: str, robot: str | None) -> Holder:
    """Return a caller by the name of its key and that of its robot."""
    return Holder(face, f"{name}{BETWEEN}{robot}" if robot else name)


def is_of(request: Request, holder: Holder) -> bool:
    """Whether a holder is this caller, or another robot of the same key. Without keys nobody can tell callers apart."""
    key = caller(request)
    return key is None or holder.name.partition(BETWEEN)[0] == key.name


def no_shared_key(request: Request, robot: str | None, idempotency_key: str | None) -> Response | None:
    """Return the answer no to an idempotency key of a caller that nothing tells from others, who may have chosen the same."""
    if idempotency_key is None or robot is not None or caller(request) is not None:
        return None
    text = "robot is missing: without keys an idempotency key needs a robot name, or two robots could share what only one began"
    return problem(422, "malformed", text, field="robot")


def no_such_heir(request: Request, keys: Keys, to: str, lift: str) -> Response | None:
    """Return the answer no to a session that is to go to a name which is no live key, or one that may not command the lift."""
    if caller(request) is None:
        return None
    heir = keys.named(to)
    if heir is None:
        text = "to is not the name of a live key; `lift-manager keys list` shows them"
    elif refusal(heir.role, heir.lifts, Need.COMMAND, [lift]):
        text = f"to is the name of a key that may not command {lift}"
    else:
        return None
    return problem(422, "malformed", text, field="to")
