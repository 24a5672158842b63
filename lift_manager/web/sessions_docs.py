"""What /docs says about sessions."""

from __future__ import annotations

from typing import Any

from lift_manager.api.sessions import (
    CloseRequest,
    Command,
    CommandRequest,
    HandOverRequest,
    OpenSessionRequest,
    RenewRequest,
    Session,
)
from lift_manager.web import examples
from lift_manager.web.operations import (
    COMMAND,
    EVERY_BODY,
    EVERY_CHANGE,
    EVERY_LIFT,
    LIFT,
    SESSION,
    WAIT,
    Gives,
    Takes,
    operation,
)

TAG = "sessions"

TAG_DESCRIPTION = """
One caller has a lift for itself, and says step by step what it does. Whoever wants a robot brought from floor to floor takes a ride
instead: it does all of this.

- The **id** of a session is its secret: it is told to whoever opened it, and works with the same key alone. For everybody else there
  is no such session.
- The **lease** (`ttl_s`) begins anew with `renew` and with every request. When it ends, everything is let go and the car stays where
  it is. However often it is renewed, a session ends after the site's `max_session_s`.
- **Taken is not done.** A command is answered with 202 and ends `confirmed`, `rejected` or `unconfirmed`; ask for it, or wait with
  `?wait=`. `go_to` is confirmed when the lift has the call: the arrival is to be seen in the lift itself.
- After a **restart** of the manager a session goes on once its holder is heard; `restored` tells.
- In a name made of key and robot, `amr-fleet/amr-7`, the key comes first. Without keys the robot's name is all there is, and
  whoever knows the id of a session commands.
"""

_BUSY = ("not_recorded", "stopping")
_TAKEN_FROM = (
    "held",
    "queued",
    "offline",
    "mode",
    "fire_latched",
    "locked_out",
    "outside_hours",
    "monitor_only",
    "not_possible",
    "occupancy_unknown",
)
"""Why a lift cannot be had."""
_OF_A_SESSION = (*EVERY_LIFT, "no_such_session")
_THERE = (LIFT, SESSION)
_LOCATION = {
    "Location": {
        "description": "Where to ask for it, relative to the address of this request.",
        "schema": {"type": "string"},
    }
}


def open_session() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "Take a lift",
        "Nothing is called by it. The body may be left out. With an `idempotency_key` that was used before, the answer is that"
        " session, and 200; with another `ttl_s` than then it is refused. Without keys of the site it needs a `robot`.",
        {
            201: Gives("It is the caller's.", Session, examples.SESSION, _LOCATION),
            200: Gives("It was already, by this idempotency key.", Session, examples.SESSION),
        },
        (*EVERY_LIFT, *EVERY_CHANGE, *EVERY_BODY, *_TAKEN_FROM, "not_now", "key_reused", "too_often", *_BUSY),
        takes=Takes(
            OpenSessionRequest,
            {
                "a minute at a time": {"robot": "amr-7", "ttl_s": 60},
                "as long as the site gives": {},
                "with an idempotency key, a new one for each session": {"robot": "amr-7", "idempotency_key": "3f1c9a"},
            },
            required=False,
        ),
        parameters=(LIFT,),
    )


def read() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "A session",
        "Also one that was over not long ago: `over` says why. Reading renews nothing.",
        {200: Gives("As it is.", Session, examples.SESSION)},
        _OF_A_SESSION,
        parameters=_THERE,
    )


def renew() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "Keep the lift",
        "The lease begins anew, as long as it was, or as long as `ttl_s` says. A session from before a restart goes on with it.",
        {200: Gives("It goes on.", Session, examples.SESSION)},
        (*_OF_A_SESSION, *EVERY_CHANGE, *EVERY_BODY, *_TAKEN_FROM, "session_over", "not_now", "too_often", *_BUSY),
        takes=Takes(RenewRequest, {"a minute more": {"ttl_s": 60}, "as long as it was": {}}, required=False),
        parameters=_THERE,
    )


def close() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "Give the lift back",
        "Everything is let go, and the car is not moved. One that is over is answered as it is. `robot: left` says that the robot is"
        " out; without it, a car that the robot may have entered stays `maybe occupied`.",
        {200: Gives("It is over.", Session, examples.SESSION)},
        (*_OF_A_SESSION, *EVERY_CHANGE, *EVERY_BODY, "not_now", "not_possible", "session_over", *_BUSY),
        takes=Takes(CloseRequest, {"the robot is out": {"robot": "left"}, "no word": {}}, required=False),
        parameters=_THERE,
    )


def hand_over() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "Give the session to another caller",
        "Car and door stay as they are. The session gets a new id: pass it on to the one who goes on with it, whose key it needs."
        " With keys, `to` is the name of a live key that may command this lift. If nobody renews the session, its lease ends.",
        {200: Gives("It is the other's.", Session, examples.SESSION)},
        (*_OF_A_SESSION, *EVERY_CHANGE, *EVERY_BODY, *_TAKEN_FROM, "not_held", "session_over", "not_now", *_BUSY),
        takes=Takes(HandOverRequest, {"to another robot": {"to": "amr-8"}}),
        parameters=_THERE,
    )


def command() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "Ask for one thing",
        "`go_to` a floor, `hold_door`, `let_go_door`, `close_door`, or the words `robot_in_place` and `robot_left`. Every request renews"
        " the lease. With an `idempotency_key` that was used before in this session, the answer is that command as it is;"
        " for another command the key is refused.",
        {202: Gives("It is taken; `status` says how far it is.", Command, examples.PENDING, _LOCATION)},
        (
            *(*_OF_A_SESSION, *EVERY_CHANGE, *EVERY_BODY, *_TAKEN_FROM),
            *("unknown_floor", "no_such_command", "session_over", "not_now", "key_reused", "too_often", *_BUSY),
        ),
        takes=Takes(
            CommandRequest,
            {
                "come, and hold the door": {"do": "go_to", "floor": "L2"},
                "close the front door": {"do": "close_door", "door": "front", "clear": True},
                "the robot is inside": {"do": "robot_in_place"},
            },
        ),
        parameters=(*_THERE, WAIT),
    )


def followed() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "What became of it",
        "As it is, or with `wait` as soon as it is no longer pending.",
        {200: Gives("As it is.", Command, examples.CONFIRMED)},
        (*_OF_A_SESSION, "no_such_command", "malformed"),
        parameters=(*_THERE, COMMAND, WAIT),
    )
