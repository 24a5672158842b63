"""What /docs says about lifts."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from lift_manager.api.lifts import Lift, LiftCapabilities, Lifts, Signals
from lift_manager.web import examples
from lift_manager.web.operations import EVERY_LIFT, IF_NONE_MATCH, LIFT, Gives, operation

TAG = "lifts"

TAG_DESCRIPTION = """
The lifts, from memory: no controller is asked, so an answer comes at once and says how old it is.

**ETag.** Each answer has one; it covers everything but `age_s` and the session's `for_s`; of `releases_in_s` it
covers the moment of the release, so a renewal changes it and the passing of time does not. Words count as they are, so one whose seconds
run, as the reason of a lift that is offline may, is another each time. Sent back as `If-None-Match`, it is answered with 304
and no body while nothing but time has changed. Both answers carry `lift-age-s`: how old the data is in seconds, left out when
nothing was ever read. A lift that has not been read for `max_age_s` turns `offline`, and that is a change: a 304 for a lift that
was live means that it still is. A key never shortens this: whoever has heard nothing for `max_age_s` knows nothing.

**Names.** A lift is named in the path as in the site file, percent-encoded; `/` is `%2F`. One whose name ends in `/capabilities`
or `/signals`, or holds `/sessions/` before its last part, is not read by its own address, for that is another's: `GET /api/v1/lifts` has it.
"""

_HEADERS = {
    "ETag": {
        "description": "Of everything but `age_s` and `for_s`; of the moment that `releases_in_s` counts down to.",
        "schema": {"type": "string"},
    },
    "Cache-Control": {"description": "`no-cache`: keep it, and ask each time.", "schema": {"type": "string"}},
    "lift-age-s": {
        "description": "How old the data is, in seconds; left out when nothing was ever read.",
        "schema": {"type": "number"},
    },
}


def lifts() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _read(
        "Every lift",
        "In the order of the site file, whether or not a lift can be read. `lift-age-s` is the age of the oldest among those"
        " that are live.",
        Lifts,
        Lifts(lifts=(examples.LIFT,)),
        one=False,
    )


def lift() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _read(
        "One lift",
        "Where it is, what its doors do, its mode, and who holds it. A robot drives on `robot_door: open` alone, and on nothing"
        " older than `max_age_s`.",
        Lift,
        examples.LIFT,
    )


def capabilities() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _read(
        "What a lift can do",
        "Which floors, doors, commands and signals it has, and how long the site lets robots have it. It stays the same while the"
        " manager runs.",
        LiftCapabilities,
        examples.CAPABILITIES,
    )


def signals() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return _read(
        "Every signal of a lift",
        "As read last, with the raw value and where it is: for people who compare it with the lift. Look at the ages.",
        Signals,
        examples.SIGNALS,
    )


def _read(
    summary: str, description: str, form: type[BaseModel], example: BaseModel, *, one: bool = True
) -> dict[str, Any]:
    return operation(
        summary,
        description,
        {
            200: Gives("As it is.", form, example, _HEADERS),
            304: Gives("As the caller has it, but for the passing of time.", headers=_HEADERS),
        },
        EVERY_LIFT if one else (),
        parameters=(LIFT, IF_NONE_MATCH) if one else (IF_NONE_MATCH,),
    )
