"""Why a request of RMF was ignored, in words for the person who reads the log. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from lift_manager.rmf.contract import TEXT_LIMIT, Disposition, LiftContract
from lift_manager.rmf.messages import LiftRequest

SHOWN = 64
"""Characters of what somebody sent that go into a log line."""

USUAL = frozenset({Disposition.HELD, Disposition.END_NOBODY, Disposition.END_NOT_HOLDER, Disposition.END_FOREIGN})
"""A robot that waits is no trouble, and some supervisors send these ENDs all day (open-rmf 1.4)."""

_WHY: Mapping[Disposition, str] = {
    Disposition.HELD: "{session} wants it, and {holder} has it; it gets it once that has ended its session",
    Disposition.END_NOBODY: (
        "END_SESSION without a session id ends nothing; the supervisors of iron and jazzy send it to idle lifts, and so"
        " does request_lift.py of rmf_demos, which sets no request_type (try `lift-manager rmf request`)"
    ),
    Disposition.END_NOT_HOLDER: "{session} ends a session that it does not have",
    Disposition.END_FOREIGN: "RMF ends the session of {session}, which is not this RMF's to end",
    Disposition.UNKNOWN_LIFT: "{session} wants the lift {lift}, which this manager does not have",
    Disposition.UNKNOWN_FLOOR: "{session} wants the floor {floor}, which is none of {floors}",
    Disposition.BAD_DOOR: "{session} wants door_state {door}; a request knows 0 (closed) and 2 (open)",
    Disposition.BAD_TYPE: "{session} sends request_type {type}; there are 0 (end), 1 (AGV) and 2 (human)",
    Disposition.BAD_SESSION: f"a request without a session id, or with one that is not printable or longer than {TEXT_LIMIT}",
    Disposition.NO_MANAGER: "{session} wants the lift {lift}, and the manager has not been heard yet",
}


def why_ignored(done: Disposition, request: LiftRequest, contract: LiftContract | None) -> str:
    """Return one sentence; what the sender wrote is quoted and cut short."""
    holder, floors = "", ""
    if contract is not None:
        holder = contract.session or str(contract.holder or "")
        floors = ", ".join(contract.view.floors.values())
    text = _WHY[done].format(
        session=quoted(request.session_id),
        holder=quoted(holder),
        lift=quoted(request.lift_name),
        floor=quoted(request.destination_floor),
        floors=floors,
        door=request.door_state,
        type=request.request_type,
    )
    return text if contract is None else f"{contract.view.name}: {text}"


def quoted(text: str) -> str:
    """Return what somebody sent as it may stand in a log line."""
    shown = repr(text[:SHOWN])
    return shown if len(text) <= SHOWN else f"{shown} (of {len(text)} characters)"
