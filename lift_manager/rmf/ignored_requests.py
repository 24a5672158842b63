"""Explains in the log why a request of RMF was ignored. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from lift_manager.rmf.lift_sessions import TEXT_LIMIT, Disposition, LiftSessions
from lift_manager.rmf.messages import LiftRequest

SHOWN_LIMIT = 64
"""Characters of a received text that go into a log line."""

USUAL = frozenset({Disposition.HELD, Disposition.END_NOBODY, Disposition.END_NOT_HOLDER, Disposition.END_FOREIGN})
"""A waiting robot is normal, and some supervisors send these ENDs all day (open-rmf 1.4)."""

_EXPLANATIONS: Mapping[Disposition, str] = {
    Disposition.HELD: "{session} requests the lift, and {holder} holds it; it has to wait until that session ends",
    Disposition.END_NOBODY: (
        "END_SESSION without a session id ends nothing; the supervisors of iron and jazzy send it to idle lifts, and so"
        " does request_lift.py of rmf_demos, which sets no request_type (try `lift-manager rmf request`)"
    ),
    Disposition.END_NOT_HOLDER: "{session} ends a session, but does not hold the lift",
    Disposition.END_FOREIGN: "RMF ends {session}, which is not a session of this RMF",
    Disposition.UNKNOWN_LIFT: "{session} requests the lift {lift}, which this manager does not have",
    Disposition.UNKNOWN_FLOOR: "{session} requests the floor {floor}, which is none of {floors}",
    Disposition.BAD_DOOR: "{session} requests door_state {door}; a request may have 0 (closed) or 2 (open)",
    Disposition.BAD_TYPE: "{session} sends request_type {type}; there are 0 (end), 1 (AGV) and 2 (human)",
    Disposition.BAD_SESSION: f"a request without a session id, or with one that is not printable or longer than {TEXT_LIMIT}",
    Disposition.NO_MANAGER: "{session} requests the lift {lift}, and the manager has not answered yet",
}


def explain_ignored(disposition: Disposition, request: LiftRequest, sessions: LiftSessions | None) -> str:
    """Return the reason as one sentence; received texts are quoted and shortened."""
    holder, floors = "", ""
    if sessions is not None:
        holder = sessions.session or str(sessions.holder or "")
        floors = ", ".join(sessions.view.floors.values())
    text = _EXPLANATIONS[disposition].format(
        session=quoted(request.session_id),
        holder=quoted(holder),
        lift=quoted(request.lift_name),
        floor=quoted(request.destination_floor),
        floors=floors,
        door=request.door_state,
        type=request.request_type,
    )
    return text if sessions is None else f"{sessions.view.name}: {text}"


def quoted(text: str) -> str:
    """Return a received text quoted and shortened for a log line."""
    shown = repr(text[:SHOWN_LIMIT])
    return shown if len(text) <= SHOWN_LIMIT else f"{shown} (of {len(text)} characters)"
