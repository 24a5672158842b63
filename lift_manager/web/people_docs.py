"""What /docs says about what people say."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from starlette.responses import Response

from lift_manager.api.people import (
    AcknowledgedAnswer,
    AcknowledgeRequest,
    DrainAnswer,
    DrainEndedAnswer,
    DrainRequest,
    EndDrainRequest,
    EndLockoutRequest,
    ForceReleasedAnswer,
    ForceReleaseRequest,
    LockoutAnswer,
    LockoutEndedAnswer,
    LockoutRequest,
)
from lift_manager.api.problem import MEDIA_TYPE
from lift_manager.web.operations import LIFT
from lift_manager.web.schemas import PROBLEM, schema_of

TAG = "people"

TAG_DESCRIPTION = """
What people say about a lift. Each word is kept over restarts, with the name of who gave it.

With keys these need the role operator, and the name of the key is written down beside the name that was said. A site without
keys takes them from the manager's own computer alone. `lift-manager ack`, `lockout`, `drain` and `release` on the command line use
them. Errors are problem+json (RFC 9457) with a stable `code`.
"""

_ERRORS = {
    403: "Another computer asked a site without keys (`other_computer`), or another site's web page asked (`another_site`).",
    404: "There is no such lift (`unknown_lift`), or its name holds a line break (`no_such_path`).",
    413: "The body is too long (`too_long`).",
    422: "The body is not what is expected (`malformed`); `field` names the key.",
    503: "The manager is about to end (`stopping`), or cannot write it down (`not_recorded`).",
}


def acknowledge() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _route(
        "The lift was checked",
        "After a fire robots are refused until a person has checked the lift and says so; so are all others while a robot may be"
        " in the car that a session left there. This says both. It is refused while the lift still tells of a fire, and while it"
        " cannot be read, for then nobody knows.",
        (AcknowledgeRequest, AcknowledgedAnswer),
        "The lift still tells of a fire (`fire_active`), cannot be read (`offline`), or there is nothing to acknowledge"
        " (`nothing_to_acknowledge`).",
    )


def lock_out() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _route(
        "Keep robots off the lift",
        "Refuses every robot with this name and reason, and ends the session. A door that is held open for a robot stops inviting it at"
        " once and is released `clear_s` later (`now`: at once); everything else is released at once. A car that moves keeps robot mode"
        " until it stands.",
        (LockoutRequest, LockoutAnswer),
        "It is locked out already (`locked_out`): a second word does not cover up the first.",
    )


def end_lockout() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _route(
        "Let robots on the lift again",
        "Anybody at the manager's computer can end a lockout, so that a lift is not lost with a person; who did is written down."
        " Let only the person who made it do so, or who took the work over.",
        (EndLockoutRequest, LockoutEndedAnswer),
        "It is not locked out (`not_locked_out`).",
    )


def begin_drain() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _route(
        "Let sessions end and no new one begin",
        "A session that goes on is not touched, its ride goes to its end, and a robot that may be in the car may still ask to get out."
        " Every other request for a session is refused with this name and reason; rides wait in their queue. It survives a restart.",
        (DrainRequest, DrainAnswer),
        "There is a drain already (`draining`): a second one does not replace the first.",
    )


def end_drain() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _route(
        "Let sessions begin again",
        "Ends the drain; rides that wait go on.",
        (EndDrainRequest, DrainEndedAnswer),
        "There is no drain (`not_draining`).",
    )


def force_release() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _route(
        "Take a lift from its holder",
        "Ends the session of whoever holds the lift and lets everything go; the car is not moved. For a holder that does not answer"
        " any more. A door that is held open for its robot stops inviting it at once and is released `clear_s` later (`now`: at once).",
        (ForceReleaseRequest, ForceReleasedAnswer),
        "Nobody holds the lift (`not_held`).",
    )


def _route(
    summary: str, description: str, forms: tuple[type[BaseModel], type[BaseModel]], conflict: str
) -> dict[str, Any]:
    body, answer = forms
    errors = {
        status: {"description": text, "content": {MEDIA_TYPE: {"schema": PROBLEM}}}
        for status, text in sorted((_ERRORS | {409: conflict}).items())
    }
    return {
        "summary": summary,
        "description": description,
        "response_class": Response,
        "responses": {200: {"description": "It is noted.", "content": _json(answer)}, **errors},
        "openapi_extra": {"parameters": [LIFT], "requestBody": {"required": True, "content": _json(body)}},
    }


def _json(form: type[BaseModel]) -> dict[str, Any]:
    return {"application/json": {"schema": schema_of(form)}}
