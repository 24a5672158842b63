"""In whose name a caller of /api/v1 holds a lift, and which sessions and rides are its own."""

from __future__ import annotations

from fastapi import Request

from lift_manager.domain.state import Holder
from lift_manager.web.access import caller

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
