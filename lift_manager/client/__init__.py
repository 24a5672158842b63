"""A typed client of /api/v1: what a robot's program, the command line and the RMF adapter use to speak to a running manager.

Each name is imported when it is asked for: parts of this package hold without httpx and pydantic too.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lift_manager.client.client import LiftManagerClient
    from lift_manager.client.errors import (
        ClientError,
        Held,
        NotAllowed,
        NotAManager,
        NotFound,
        Refused,
        SessionLost,
        Stale,
        Unreachable,
    )
    from lift_manager.client.ride import ActiveRide
    from lift_manager.client.ride_step import Step
    from lift_manager.client.session import ActiveSession
    from lift_manager.client.states import States, open_at
    from lift_manager.client.stream import Connected, Disconnected, EventStream

_PLACES = {
    "ClientError": "errors",
    "Connected": "stream",
    "Disconnected": "stream",
    "EventStream": "stream",
    "Held": "errors",
    "LiftManagerClient": "client",
    "NotAManager": "errors",
    "NotAllowed": "errors",
    "NotFound": "errors",
    "Refused": "errors",
    "ActiveRide": "ride",
    "ActiveSession": "session",
    "SessionLost": "errors",
    "Stale": "errors",
    "States": "states",
    "Step": "ride_step",
    "Unreachable": "errors",
    "open_at": "states",
}
"""Module of this package by the name that it defines."""

__all__ = [
    "ActiveRide",
    "ActiveSession",
    "ClientError",
    "Connected",
    "Disconnected",
    "EventStream",
    "Held",
    "LiftManagerClient",
    "NotAManager",
    "NotAllowed",
    "NotFound",
    "Refused",
    "SessionLost",
    "Stale",
    "States",
    "Step",
    "Unreachable",
    "open_at",
]


if not TYPE_CHECKING:  # a checker would take every name for one of these

    def __getattr__(name: str) -> object:
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
