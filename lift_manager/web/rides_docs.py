"""What /docs says about rides."""

from __future__ import annotations

from typing import Any

from lift_manager.api.rides import CancelRequest, Plan, Ride, RideRequest, Rides
from lift_manager.domain.ride import RideWord
from lift_manager.web import examples
from lift_manager.web.operations import EVERY_BODY, EVERY_CHANGE, RIDE, Gives, Takes, operation
from lift_manager.web.schemas import kept, schema_of

TAG = "rides"

TAG_DESCRIPTION = """
One robot from one floor to another. The manager calls the lift, holds its door, sends it on and lets it go; the robot does what
`guidance` says, and tells when it has `entered` and `left`.

| guidance | the robot |
|---|---|
| `wait` | stays outside, clear of the door |
| `enter` | drives in: the door is open for it now |
| `stay` | stays inside |
| `leave` | drives out: the door is open for it now |
| `gave_up` | is on its own; `reason` says why, `advice` what is best |
| `done` | is there |

`enter` and `leave` stand only while the door is open: drive on nothing older. An event tells when to ask: what a robot acts on is the
answer of GET, or an event whose `age_s` plus the time since it was received is within the lift's `max_age_s`.

Everybody who may read sees every ride; a robot's key speaks for the rides that it began, an operator's for all. Without keys
whoever knows the id of a ride speaks for it.
"""

_LOCATION = {
    "Location": {
        "description": "Where to ask for it, relative to the address of this request.",
        "schema": {"type": "string"},
    }
}
_NOT_TO_BE_HAD = (
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
    "not_now",
)
_BUSY = ("too_often", "too_many", "not_recorded", "stopping")
_OF_A_RIDE = ("unknown_ride", "unknown_lift", "no_such_path", "not_your_ride", *EVERY_CHANGE)

_WORDS = {
    RideWord.ENTERED: (
        "The robot is inside",
        "And the door may close behind it. Say it only once the robot stands where it may stand.",
    ),
    RideWord.LEFT: (
        "The robot is outside",
        "Clear of the door. Also taken once the ride is over: it clears a car that is `maybe occupied`.",
    ),
    RideWord.HERE: (
        "The robot goes on",
        "Needed after a restart of the manager, when nothing is pressed before the robot is heard; harmless otherwise.",
    ),
}


def rides() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "Every ride",
        "Those that go on, and those that ended not long ago; the oldest first.",
        {200: Gives("As they are.", Rides, Rides(rides=(examples.RIDE,)))},
        (),
    )


def ride() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "A ride",
        "And what its robot is to do now.",
        {200: Gives("As it is.", Ride, examples.RIDE)},
        ("unknown_ride", "no_such_path"),
        parameters=(RIDE,),
    )


def begin() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    said = operation(
        "Ride",
        "Begins a ride or queues it. With `lift: any` the manager chooses among the lifts that serve both floors and that the key"
        " names; a robot's key rides on no other. With an `idempotency_key` that was used before, the answer is that ride, and 200,"
        " and another wish is refused; without keys of the site it needs a `robot`. One caller has at most 10 rides at once. With"
        " `dry_run` the answer is a plan, and 200.",
        {
            201: Gives("It is begun, or waits for its turn.", Ride, examples.RIDE, _LOCATION),
            200: Gives("The ride of this idempotency key, or with `dry_run` the plan.", Ride, examples.RIDE),
        },
        ("unknown_lift", *EVERY_CHANGE, *EVERY_BODY, "unknown_floor", *_NOT_TO_BE_HAD, "key_reused", *_BUSY),
        takes=Takes(
            RideRequest,
            {
                "by any lift": {"lift": "any", "from": "L1", "to": "L3", "robot": "amr-7"},
                "what would it come to": {"lift": "east", "from": "L1", "to": "L3", "dry_run": True},
                "with an idempotency key, a new one for each ride": {
                    "lift": "any",
                    "from": "L1",
                    "to": "L3",
                    "robot": "amr-7",
                    "idempotency_key": "3f1c9a",
                },
            },
        ),
    )
    content = said["responses"][200]["content"]["application/json"]
    content["schema"] = {"anyOf": [content["schema"], schema_of(Plan)]}
    content["examples"]["plan"] = {"value": kept(examples.PLAN.model_dump(mode="json"))}
    return said


def word(what: RideWord) -> dict[str, Any]:
    """What the registration of the route for this word wants to know, docs included."""
    summary, description = _WORDS[what]
    return operation(
        summary,
        f"{description} It has no body.",
        {200: Gives("It is heard.", Ride, examples.RIDE)},
        (*_OF_A_RIDE, *_NOT_TO_BE_HAD, *_BUSY),
        parameters=(RIDE,),
    )


def cancel() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "Cancel a ride",
        "Safely: a robot that may be inside is let out first, and somebody is told. Twice is once. The body may be left out.",
        {200: Gives("It ends, or has ended.", Ride, examples.RIDE)},
        (*_OF_A_RIDE, *EVERY_BODY, *_NOT_TO_BE_HAD, *_BUSY),
        takes=Takes(CancelRequest, {"with a reason": {"reason": "the order was withdrawn"}}, required=False),
        parameters=(RIDE,),
    )
